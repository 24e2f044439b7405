/* The step loop of an embedded explicit pair with dense output, W samples side by side with one step for all.

   Given before: lanes.h; N_X, N_P, N_C, N_Y, PROJECTED; prepare(p, c), rates(x, c, t, dx), outputs(x, c, t, y) and, if
   PROJECTED, project(x, c, t, x_new); stages(x, c, t, h, k, x_new) up to the slope at the end of the step,
   errors(k, e5, e3), and dense(x, x_new, c, t, h, k, F) for the interpolant of the step. */

enum { FINISHED = 0, LANES_LOST = 1, TOO_MANY_STEPS = 2 };

typedef struct {
  double rtol, atol;
  long most_steps;
} Options;

static double worst(V a) {
  double m = 0.0;
  for (int l = 0; l < W; ++l) m = a[l] > m || a[l] != a[l] ? a[l] : m;
  return m;
}

/* The norm of Hairer's DOP853, the largest of all lanes; lanes that are not finite show as NaN. */
static V error_norm(const V *x, const V *x_new, const V *k, double h, Options o) {
  V e5[N_X], e3[N_X], sum5 = zero(), sum3 = zero();
  errors(k, e5, e3);
  for (int i = 0; i < N_X; ++i) {
    V a = choose(x[i] < 0.0, -x[i], x[i]), b = choose(x_new[i] < 0.0, -x_new[i], x_new[i]);
    V scale = 1.0 / (o.atol + o.rtol * choose(a > b, a, b));
    e5[i] *= scale;
    e3[i] *= scale;
    sum5 += e5[i] * e5[i];
    sum3 += e3[i] * e3[i];
  }
  V denominator = sum5 + 0.01 * sum3;
  return choose(denominator > 0.0, fabs(h) * sum5 / v_sqrt(denominator * (double)N_X), denominator);
}

static double first_step(const V *x, const V *c, const V *k0, double t, double span, Options o) {
  V d0 = zero(), d1 = zero(), d2 = zero(), x1[N_X], k1[N_X], scale[N_X];
  for (int i = 0; i < N_X; ++i) {
    scale[i] = 1.0 / (o.atol + o.rtol * choose(x[i] < 0.0, -x[i], x[i]));
    d0 += x[i] * scale[i] * x[i] * scale[i];
    d1 += k0[i] * scale[i] * k0[i] * scale[i];
  }
  double n0 = sqrt(worst(d0) / N_X), n1 = sqrt(worst(d1) / N_X);
  double h0 = n0 < 1e-5 || n1 < 1e-5 ? 1e-6 : 0.01 * n0 / n1;
  h0 = h0 < span ? h0 : span;
  for (int i = 0; i < N_X; ++i) x1[i] = x[i] + h0 * k0[i];
  rates(x1, c, zero() + (t + h0), k1);
  for (int i = 0; i < N_X; ++i) {
    V d = (k1[i] - k0[i]) * scale[i];
    d2 += d * d;
  }
  double n2 = sqrt(worst(d2) / N_X) / h0, most = n1 > n2 ? n1 : n2;
  double h1 = most <= 1e-15 ? (1e-6 > h0 * 1e-3 ? 1e-6 : h0 * 1e-3) : pow(0.01 / most, 1.0 / 8.0);
  double h = 100.0 * h0 < h1 ? 100.0 * h0 : h1;
  return h < span ? h : span;
}

/* Y (n_t, N_Y) at the times; on LANES_LOST, `lost` marks the lanes that are not finite and `*at` says when. */
int run_block(const V *x0, const V *p, const double *times, long n_t, const Options *options, V *Y, long *lost, double *at,
              long *counts) {
  const Options o = *options;
  V c[N_C > 0 ? N_C : 1], x[N_X], x_new[N_X], k[16 * N_X], F[7 * N_X], x_at[N_X];
  prepare(p, c);
  memcpy(x, x0, sizeof x);
  double t = times[0], end = times[n_t - 1];
#if PROJECTED
  project(x, c, zero() + t, x_new);
  memcpy(x, x_new, sizeof x);
#endif
  outputs(x, c, zero() + t, Y);
  if (n_t == 1) return FINISHED;
  rates(x, c, zero() + t, k);
  double h = first_step(x, c, k, t, end - t, o), before = 1e-4;
  const double shortest = 1e-14 * (end - times[0]);
  long next = 1, rejected = 0;
  for (long step = 0; next < n_t; ++step) {
    if (step == o.most_steps) { *at = t; return TOO_MANY_STEPS; }
    if (!(h > shortest)) h = shortest;
    double t_new = t + h;
    if (t_new >= end) { t_new = end; h = end - t; }
    stages(x, c, t, h, k, x_new);
    V norm = error_norm(x, x_new, k, h, o);
    double e = worst(norm);
    if (!(e <= 1.0)) {
      if (h <= shortest * 1.0000001) {
        *at = t;
        for (int l = 0; l < W; ++l) lost[l] = !(norm[l] <= 1.0);
        return LANES_LOST;
      }
      double factor = e == e && e < 1e300 ? 0.9 * pow(e, -1.0 / 8.0) : 0.1;
      h *= factor > 0.2 ? factor : 0.2;
      ++rejected;
      before = 1e-4;
      continue;
    }
    if (times[next] <= t_new) {
      dense(x, x_new, c, t, h, k, F);
      for (; next < n_t && times[next] <= t_new; ++next) {
        double s = (times[next] - t) / h;
        for (int i = 0; i < N_X; ++i) {
          const V *f = F + 7 * i;
          x_at[i] = x[i] + s * (f[0] + (1 - s) * (f[1] + s * (f[2] + (1 - s) * (f[3] + s * (f[4] + (1 - s) * (f[5] + s * f[6]))))));
        }
        outputs(x_at, c, zero() + times[next], Y + next * N_Y);
      }
    }
#if PROJECTED
    project(x_new, c, zero() + t_new, x);
    rates(x, c, zero() + t_new, k);
#else
    memcpy(x, x_new, sizeof x);
    memcpy(k, k + 12 * N_X, sizeof x);
#endif
    t = t_new;
    counts[0] += 1;
    /* A controller with memory keeps the step from swinging. */
    double factor = e > 0.0 ? 0.9 * pow(e, -1.0 / 8.0 + 0.2 * 0.04) * pow(before, 0.04) : 6.0;
    before = e > 1e-4 ? e : 1e-4;
    h *= factor > 6.0 ? 6.0 : factor < 0.333 ? 0.333 : factor;
  }
  counts[1] += rejected;
  return FINISHED;
}

/* Marks the lanes in which some of Y (n,) is NaN or infinite. */
void irregular(const V *restrict Y, long n, long *restrict marks) {
  V sum = zero();
  for (long i = 0; i < n; ++i) sum += Y[i] * 0.0;
  for (int l = 0; l < W; ++l) marks[l] = sum[l] != 0.0;
}

static inline V smaller(V a, V b) { return choose(a < b, a, b); }
static inline V larger(V a, V b) { return choose(a > b, a, b); }

#if W == 8 && defined(__has_builtin)
#if __has_builtin(__builtin_shufflevector)
#define TREE
#define LOW_1(a, b) __builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14)
#define HIGH_1(a, b) __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15)
#define LOW_2(a, b) __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13)
#define HIGH_2(a, b) __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15)
#define LOW_4(a, b) __builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11)
#define HIGH_4(a, b) __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15)
#endif
#endif

/* Running extremes: lower and upper (n,) grow by the lanes of Y (n,). They hold numbers, not lanes, so that they stay in
   a cache near the core: eight vectors become one of minima and one of maxima by a tree of shuffles. */
void extend(const V *restrict Y, long n, V *restrict lower, V *restrict upper) {
  double *low = (double *)lower, *high = (double *)upper;
  long i = 0;
#ifdef TREE
  for (; i + 8 <= n; i += 8, ++lower, ++upper) {
    V a[4], b[4];
    for (int k = 0; k < 4; ++k) {
      V l = LOW_1(Y[i + 2 * k], Y[i + 2 * k + 1]), h = HIGH_1(Y[i + 2 * k], Y[i + 2 * k + 1]);
      a[k] = smaller(l, h);
      b[k] = larger(l, h);
    }
    for (int k = 0; k < 2; ++k) {
      a[k] = smaller(LOW_2(a[2 * k], a[2 * k + 1]), HIGH_2(a[2 * k], a[2 * k + 1]));
      b[k] = larger(LOW_2(b[2 * k], b[2 * k + 1]), HIGH_2(b[2 * k], b[2 * k + 1]));
    }
    *lower = smaller(*lower, smaller(LOW_4(a[0], a[1]), HIGH_4(a[0], a[1])));
    *upper = larger(*upper, larger(LOW_4(b[0], b[1]), HIGH_4(b[0], b[1])));
  }
#endif
  for (; i < n; ++i)
    for (int l = 0; l < W; ++l) {
      low[i] = Y[i][l] < low[i] ? Y[i][l] : low[i];
      high[i] = Y[i][l] > high[i] ? Y[i][l] : high[i];
    }
}

const int width = W;
