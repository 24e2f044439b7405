/* Integrates the model and prints time and coordinates (Runge-Kutta method of order 4).
 * Needs model.c and model.h beside it and a C compiler, nothing else:
 *
 *     cc main.c model.c -lm -o model && ./model
 *
 * The state is x = (q, v, s). Constraints hold as closely as the steps are small: nothing projects back.
 */
#include <stdio.h>

#include "model.h"

enum { N_Q = 3, N_V = 3, N_S = 0, N_X = N_Q + N_V + N_S, STEPS = 100 };

static const double T0 = 0.0, T1 = 1.0;

static const double START[] = {
    0.0, /* rod.x */
    0.0, /* rod.y */
    0.0, /* rod.theta */
    0.0, /* v[0] */
    0.0, /* v[1] */
    0.0, /* v[2] */
};

static const double P[] = {
    1.0, /* l */
    5.0, /* k */
};

static const char *const HEADS[] = {"rod.x", "rod.y", "rod.theta"};

/* Spreads the stored entries of a column over x; see the header for the pattern. */
static void scatter(const casadi_int *pattern, const double *stored, double *x)
{
    casadi_int i;
    if (pattern[2]) {
        for (i = 0; i < pattern[0]; ++i) x[i] = stored[i];
        return;
    }
    for (i = 0; i < pattern[0]; ++i) x[i] = 0.0;
    for (i = 0; i < pattern[3]; ++i) x[pattern[4 + i]] = stored[i];
}

/* dx = time derivative of x. */
static int rate(double t, const double *x, double *dx, int mem)
{
    static casadi_int iw[1];
    static double w[16], rates[N_X];
    const int first[] = {0, N_Q, N_Q + N_V};
    const double *arg[4] = {x, x + N_Q, P, &t};
    double *res[2] = {rates, rates + N_Q};
    int block, flag = model_rhs(arg, res, iw, w, mem);
    for (block = 0; block < 2; ++block)
        scatter(model_rhs_sparsity_out(block), rates + first[block], dx + first[block]);
    return flag;
}

/* One step of length h from time t, in place. */
static int step(double t, double h, double *x, int mem)
{
    static const double node[] = {0.0, 0.5, 0.5, 1.0};
    static const double weight[] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
    double y[N_X], k[N_X] = {0.0}, sum[N_X] = {0.0};
    int i, stage;
    for (stage = 0; stage < 4; ++stage) {
        for (i = 0; i < N_X; ++i) y[i] = x[i] + h * node[stage] * k[i];
        if (rate(t + h * node[stage], y, k, mem)) return 1;
        for (i = 0; i < N_X; ++i) sum[i] += weight[stage] * k[i];
    }
    for (i = 0; i < N_X; ++i) x[i] += h * sum[i];
    for (i = 0; i < N_X; ++i)
        if (x[i] - x[i] != 0.0) return 2; /* infinite or NaN */
    return 0;
}

static void row(double t, const double *x)
{
    int i;
    printf("%24.16e", t);
    for (i = 0; i < N_Q; ++i) printf(" %24.16e", x[i]);
    printf("\n");
}

int main(void)
{
    const double h = (T1 - T0) / STEPS;
    double x[N_X];
    int i, n, mem = model_rhs_checkout();
    for (i = 0; i < N_X; ++i) x[i] = START[i];
    printf("%24s", "t");
    for (i = 0; i < N_Q; ++i) printf(" %24s", HEADS[i]);
    printf("\n");
    row(T0, x);
    for (n = 0; n < STEPS; ++n) {
        const int flag = step(T0 + n * h, h, x, mem);
        if (flag) {
            fprintf(stderr, "The %s in the step from t = %g s.%s\n",
                    flag == 1 ? "right-hand side failed" : "state became infinite or NaN", T0 + n * h,
                    flag == 1 ? "" : " Take more steps.");
            return 1;
        }
        row(T0 + (n + 1) * h, x);
    }
    model_rhs_release(mem);
    return 0;
}
