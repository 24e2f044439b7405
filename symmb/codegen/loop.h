/* The step loop of an embedded explicit pair with dense output: blocks of W samples that share their steps.

   Given before: lanes.h; N_X, N_P, N_C, N_Y, N_USED, PROJECTED, STARTED; the states used[] that outputs need;
   prepare(p, c), rates(x, c, t, dx), outputs(x, c, t, y); if PROJECTED, project(x, c, t, x_new); if STARTED, N_U,
   newton(u, c, t, du) and start(u, c, t, x). Given after: the functions of the pair, declared below. */

#include <stdlib.h>

enum { CHUNK = N_X > 64 ? 4 : 16 };
#define SIZE(n) ((n) > 0 ? (n) : 1)

/* A study: n samples, rows of p (n, N_P) and, unless STARTED, x0 (n, N_X), at n_t times. */
typedef struct {
  const double *x0, *p, *times;
  long n, n_t;
  double rtol, atol;
  long most_steps;
  long dealt;       /* blocks given to threads */
  double *t_failed; /* (n,) NaN while a sample has not */
  char *irregular;  /* (n,) whether it failed by an output that is not finite */
  double *Y;        /* (n, n_t, N_Y) values, or NULL */
} Study;

/* A block under way, at t, on a step of length h. */
typedef struct {
  V x[SIZE(N_X)], x_new[SIZE(N_X)], k[16 * SIZE(N_X)], c[SIZE(N_C)], F[7 * SIZE(N_USED)];
  V x_at[CHUNK * SIZE(N_X)], y[CHUNK * SIZE(N_Y)]; /* states and outputs at some times */
  double t, t_new, h, h_next;
  double before; /* logarithm of the error of the step before */
  long number, next, steps, live, sample[W];
  double *lower, *upper; /* extremes of the block, (n_t, N_Y) */
} Block;

static void stages(Block *b);                     /* k before the end of the step, x_new */
static void errors(const V *k, V *e5, V *e3);     /* estimates of orders 5 and 3 */
static void interpolant(Block *b);                /* F of used states */

enum { REJECTED, ACCEPTED, LOST };

static double worst(V a) {
  double m = 0.0;
  for (int l = 0; l < W; ++l) m = a[l] > m || a[l] != a[l] ? a[l] : m;
  return m;
}

/* The norm of Hairer's DOP853 in each lane; lanes that are not finite show as NaN. */
static V error_norm(const Block *b, const Study *s) {
  V e5[SIZE(N_X)], e3[SIZE(N_X)], sum5 = zero(), sum3 = zero();
  errors(b->k, e5, e3);
  for (int i = 0; i < N_X; ++i) {
    V scale = 1.0 / (s->atol + s->rtol * v_larger(v_fabs(b->x[i]), v_fabs(b->x_new[i])));
    e5[i] *= scale;
    e3[i] *= scale;
    sum5 += e5[i] * e5[i];
    sum3 += e3[i] * e3[i];
  }
  V denominator = sum5 + 0.01 * sum3;
  return choose(denominator > 0.0, fabs(b->h) * sum5 / v_sqrt(denominator * (double)N_X), denominator);
}

static double first_step(Block *b, const Study *s) {
  const double span = s->times[s->n_t - 1] - b->t;
  V d0 = zero(), d1 = zero(), d2 = zero(), *x1 = b->x_new, *k1 = b->k + N_X;
  for (int i = 0; i < N_X; ++i) {
    V scale = 1.0 / (s->atol + s->rtol * v_fabs(b->x[i]));
    d0 += b->x[i] * scale * b->x[i] * scale;
    d1 += b->k[i] * scale * b->k[i] * scale;
  }
  double n0 = sqrt(worst(d0) / N_X), n1 = sqrt(worst(d1) / N_X);
  double h0 = n0 < 1e-5 || n1 < 1e-5 ? 1e-6 : 0.01 * n0 / n1;
  h0 = h0 < span ? h0 : span;
  for (int i = 0; i < N_X; ++i) x1[i] = b->x[i] + h0 * b->k[i];
  rates(x1, b->c, each(b->t + h0), k1);
  for (int i = 0; i < N_X; ++i) {
    V d = (k1[i] - b->k[i]) / (s->atol + s->rtol * v_fabs(b->x[i]));
    d2 += d * d;
  }
  double n2 = sqrt(worst(d2) / N_X) / h0, most = n1 > n2 ? n1 : n2;
  double h1 = most <= 1e-15 ? (1e-6 > h0 * 1e-3 ? 1e-6 : h0 * 1e-3) : pow(0.01 / most, 1.0 / 8.0);
  double h = 100.0 * h0 < h1 ? 100.0 * h0 : h1;
  return h < span ? h : span;
}

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

/* Smallest and largest lanes of each of n vectors: eight of them become one of minima and one of maxima by a tree of
   shuffles, the last eight overlap those before. */
static void extremes(const V *y, long n, double *lower, double *upper) {
  long i = 0;
#ifdef TREE
  for (; n >= 8 && i < n; i += 8) {
    if (i > n - 8) i = n - 8;
    V a[4], b[4];
    for (int k = 0; k < 4; ++k) {
      V l = LOW_1(y[i + 2 * k], y[i + 2 * k + 1]), h = HIGH_1(y[i + 2 * k], y[i + 2 * k + 1]);
      a[k] = v_smaller(l, h);
      b[k] = v_larger(l, h);
    }
    for (int k = 0; k < 2; ++k) {
      a[k] = v_smaller(LOW_2(a[2 * k], a[2 * k + 1]), HIGH_2(a[2 * k], a[2 * k + 1]));
      b[k] = v_larger(LOW_2(b[2 * k], b[2 * k + 1]), HIGH_2(b[2 * k], b[2 * k + 1]));
    }
    V least = v_smaller(LOW_4(a[0], a[1]), HIGH_4(a[0], a[1])), most = v_larger(LOW_4(b[0], b[1]), HIGH_4(b[0], b[1]));
    memcpy(lower + i, &least, sizeof least);
    memcpy(upper + i, &most, sizeof most);
  }
#endif
  for (; i < n; ++i) {
    lower[i] = upper[i] = y[i][0];
    for (int l = 1; l < W; ++l) {
      lower[i] = y[i][l] < lower[i] ? y[i][l] : lower[i];
      upper[i] = y[i][l] > upper[i] ? y[i][l] : upper[i];
    }
  }
}

/* Outputs at n times from number `first` on; 0 if a lane is not finite: its sample fails. */
static int keep(Block *b, Study *s, long first, long n) {
  const V *y = b->y;
  V sum[4] = {zero(), zero(), zero(), zero()}; /* several, since each addition waits for the one before */
  for (long i = 0; i < n * N_Y; ++i) sum[i % 4] += y[i] * 0.0;
  const int finite = worst(sum[0] + sum[1] + sum[2] + sum[3]) == 0.0;
  if (!finite) {
    for (long l = 0; l < b->live; ++l)
      for (long i = 0; i < n * N_Y; ++i)
        if (y[i][l] * 0.0 != 0.0) {
          s->irregular[b->sample[l]] = 1;
          s->t_failed[b->sample[l]] = s->times[first + i / SIZE(N_Y)];
          break;
        }
  }
  if (s->Y)
    for (long l = 0; l < b->live; ++l) {
      double *to = s->Y + (b->sample[l] * s->n_t + first) * N_Y;
      for (long i = 0; i < n * N_Y; ++i) to[i] = y[i][l];
    }
  else
    extremes(y, n * N_Y, b->lower + first * N_Y, b->upper + first * N_Y);
  return finite;
}

#if STARTED
/* The state at the first time: Newton from u = 0, in each lane until its own step is small: convergence is quadratic,
   and a step below 1e-9 leaves an error at rounding level. NaN where it does not converge. */
static void assemble(Block *b) {
  V u[SIZE(N_X)] = {zero()}, du[SIZE(N_U)];
  M active = (M)zero() == 0;
  for (int n = 0; n < 30 && N_U > 0 && !none(active); ++n) {
    V step = zero(), size = each(1e-3);
    newton(u, b->c, each(b->t), du);
    for (int i = 0; i < N_U; ++i) {
      u[i] -= blend(active, du[i], zero());
      step = v_larger(v_fabs(du[i]), step);
      size = v_larger(v_fabs(u[i]), size);
    }
    active &= (M)(step > 1e-9 * size);
  }
  start(u, b->c, each(b->t), b->x);
  for (int i = 0; N_U > 0 && i < N_X; ++i) b->x[i] = blend(active, each(NAN), b->x[i]);
}
#endif

/* The samples of a block that did not fail, at the first time; lanes without a sample repeat one that has, and do not
   change the common step. 0 if there are none. */
static int begin(Block *b, Study *s) {
  V p[SIZE(N_P)];
  b->t = s->times[0];
  b->next = 1;
  b->steps = 0;
  b->before = log(1e-4);
  for (;;) {
    b->live = 0;
    for (long i = b->number * W; i < b->number * W + W && i < s->n; ++i)
      if (s->t_failed[i] != s->t_failed[i]) b->sample[b->live++] = i;
    if (!b->live) return 0;
    for (long l = 0; l < W; ++l)
      for (int j = 0; j < N_P; ++j) p[j][l] = s->p[b->sample[l % b->live] * N_P + j];
    prepare(p, b->c);
#if STARTED
    assemble(b);
#else
    for (long l = 0; l < W; ++l)
      for (int j = 0; j < N_X; ++j) b->x[j][l] = s->x0[b->sample[l % b->live] * N_X + j];
#endif
    V sum = zero();
    for (int j = 0; j < N_X; ++j) sum += b->x[j] * 0.0;
    for (long l = 0; l < b->live; ++l)
      if (sum[l] != 0.0) s->t_failed[b->sample[l]] = b->t;
    if (worst(sum) != 0.0) continue;
#if PROJECTED
    project(b->x, b->c, each(b->t), b->x_new);
    memcpy(b->x, b->x_new, sizeof b->x);
#endif
    outputs(b->x, b->c, each(b->t), b->y);
    if (!keep(b, s, 0, 1)) continue;
    if (s->n_t == 1) return 1;
    rates(b->x, b->c, each(b->t), b->k);
    b->h = first_step(b, s);
    return 1;
  }
}

/* Outputs at the times that the step has passed; 0 if one is not finite. */
static int sample(Block *b, Study *s) {
  while (b->next < s->n_t && s->times[b->next] <= b->t_new) {
    double share[CHUNK];
    long n = 0;
    for (; n < CHUNK && b->next + n < s->n_t && s->times[b->next + n] <= b->t_new; ++n)
      share[n] = (s->times[b->next + n] - b->t) / b->h;
    for (int u = 0; u < N_USED; ++u) {
      const V *f = b->F + 7 * u, x = b->x[used[u]];
      const V f0 = f[0], f1 = f[1], f2 = f[2], f3 = f[3], f4 = f[4], f5 = f[5], f6 = f[6];
      for (long j = 0; j < n; ++j) {
        const double a = share[j], r = 1.0 - a;
        b->x_at[j * N_X + used[u]] = x + a * (f0 + r * (f1 + a * (f2 + r * (f3 + a * (f4 + r * (f5 + a * f6))))));
      }
    }
    for (long j = 0; j < n; ++j)
      outputs(b->x_at + j * N_X, b->c, each(s->times[b->next + j]), b->y + j * N_Y);
    b->next += n;
    if (!keep(b, s, b->next - n, n)) return 0;
  }
  return 1;
}

/* Accepts the step, or shortens it; where there is no shorter one, samples whose error is too large fail. */
static int judge(Block *b, Study *s, double shortest) {
  const V norm = error_norm(b, s);
  const double e = worst(norm), size = log(e), least = log(1e-4);
  const int too_many = ++b->steps == s->most_steps;
  if (too_many || (!(e <= 1.0) && b->h <= shortest * 1.0000001)) {
    for (int l = 0; l < W; ++l)
      if (too_many || !(norm[l] <= 1.0)) s->t_failed[b->sample[l % b->live]] = b->t;
    return LOST;
  }
  if (!(e <= 1.0)) {
    const double factor = e < 1e300 ? 0.9 * exp(-1.0 / 8.0 * size) : 0.1;
    b->h *= factor > 0.2 ? factor : 0.2;
    b->before = least;
    return REJECTED;
  }
  /* A controller with memory keeps the step from swinging. */
  const double factor = 0.9 * exp((-1.0 / 8.0 + 0.2 * 0.04) * size + 0.04 * b->before);
  b->h_next = b->h * (factor > 6.0 ? 6.0 : factor < 0.333 ? 0.333 : factor);
  b->before = size > least ? size : least;
  return ACCEPTED;
}

/* The block to its end, or until samples fail: 0. */
static int run(Block *b, Study *s) {
  const double end = s->times[s->n_t - 1], shortest = 1e-14 * (end - s->times[0]);
  while (b->next < s->n_t) {
    if (!(b->h > shortest)) b->h = shortest;
    b->t_new = b->t + b->h;
    if (b->t_new >= end) {
      b->t_new = end;
      b->h = end - b->t;
    }
    stages(b);
    const int verdict = judge(b, s, shortest);
    if (verdict == LOST) return 0;
    if (verdict == REJECTED) continue;
    rates(b->x_new, b->c, each(b->t_new), b->k + 12 * N_X);
    if (s->times[b->next] <= b->t_new) {
      interpolant(b);
      if (!sample(b, s)) return 0;
    }
    /* The slope before the projection serves the next step: it is as far off as the error of this one. */
    memcpy(b->k, b->k + 12 * N_X, sizeof b->x);
#if PROJECTED
    project(b->x_new, b->c, each(b->t_new), b->x);
#else
    memcpy(b->x, b->x_new, sizeof b->x);
#endif
    b->t = b->t_new;
    b->h = b->h_next;
  }
  return 1;
}

/* What one thread does: blocks until none is left. Values go to s->Y, or extremes to lower and upper (n_t, N_Y), where
   they join those of earlier blocks. 0 if there is not enough memory. */
int work(Study *s, double *restrict lower, double *restrict upper) {
  const long n = s->Y ? 0 : s->n_t * N_Y;
  Block *b = aligned_alloc(sizeof(V), sizeof(Block));
  double *part = malloc((2 * n + 1) * sizeof(double));
  const int enough = b && part;
  while (enough && (b->number = __atomic_fetch_add(&s->dealt, 1, __ATOMIC_RELAXED)) * W < s->n) {
    b->lower = part;
    b->upper = part + n;
    int found;
    while ((found = begin(b, s)) && !run(b, s)) {}
    for (long i = 0; found && i < n; ++i) {
      lower[i] = b->lower[i] < lower[i] ? b->lower[i] : lower[i];
      upper[i] = b->upper[i] > upper[i] ? b->upper[i] : upper[i];
    }
  }
  free(b);
  free(part);
  return enough;
}

const int width = W;
