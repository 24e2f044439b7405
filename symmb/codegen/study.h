/* A study: blocks of W samples side by side, values of all or running extremes; samples that fail are taken out.

   Given before: lanes.h; N_X, N_P, N_C, N_Y, PROJECTED, STARTED; N_OWN, the number of states with slopes of their own,
   which stand first; place[] (N_X), where a state that is given stands; the states used[] (N_USED) that outputs need;
   prepare(p, c), rates(x, c, t, dx), outputs(x, c, t, y); if PROJECTED, project(x, c, t, x_new); if STARTED, N_U,
   newton(u, c, t, du) and start(u, c, t, x); STAGES. Given after: run(), which takes the steps. */

#include <stdlib.h>

enum { CHUNK = N_X > 512 ? 1 : N_X > 64 ? 4 : 16 }; /* times at once; the block should fit into a cache */
#define SIZE(n) ((n) > 0 ? (n) : 1)

/* A study: n samples, rows of p (n, N_P) and, unless STARTED, x0 (n, N_X), at n_t times. */
typedef struct {
  const double *x0, *p, *times;
  long n, n_t;
  double rtol, atol; /* of steps with control */
  double longest;    /* of fixed steps */
  long most_steps;
  long dealt;       /* blocks given to threads */
  double *t_failed; /* (n,) NaN while a sample has not */
  char *irregular;  /* (n,) whether it failed by an output that is not finite */
  double *Y;        /* (n, n_t, N_Y) values, or NULL */
} Study;

/* A block under way, at t, on a step of length h. */
typedef struct {
  V x[SIZE(N_X)], x_new[SIZE(N_X)], k[STAGES * SIZE(N_OWN)], c[SIZE(N_C)], F[7 * SIZE(N_USED)];
  V x_at[CHUNK * SIZE(N_X)], y[CHUNK * SIZE(N_Y)]; /* states and outputs at some times */
  double t, t_new, h, h_next;
  double before; /* logarithm of the error of the step before */
  long number, next, steps, live, sample[W];
  double *lower, *upper; /* extremes of the block, (n_t, N_Y) */
} Block;

/* The slope of state i from x and the slopes that are kept. */
static inline V slope(const V *x, const V *k, int i) { return i < N_OWN ? k[i] : x[i - N_OWN]; }

static int run(Block *b, Study *s); /* from the first time to the last, or until samples fail: 0 */

static double worst(V a) {
  double m = 0.0;
  for (int l = 0; l < W; ++l) m = a[l] > m || a[l] != a[l] ? a[l] : m;
  return m;
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
      V *ui = u + place[i];
      *ui -= blend(active, du[i], zero());
      step = v_larger(v_fabs(du[i]), step);
      size = v_larger(v_fabs(*ui), size);
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
      for (int j = 0; j < N_X; ++j) b->x[place[j]][l] = s->x0[b->sample[l % b->live] * N_X + j];
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
    return 1;
  }
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
