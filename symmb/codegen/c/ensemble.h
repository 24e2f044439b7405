/* A study: blocks of WIDTH samples side by side, values of all or running extremes; samples that fail are taken out.

   Given before: lanes.h; N_X, N_P, N_C, N_Y, PROJECTED, STARTED; N_OWN, the number of states with slopes of their own,
   which stand first; place[] (N_X), where a state that is given stands; the states used[] (N_USED) that outputs need;
   prepare(p, c), rates(x, c, t, dx), outputs(x, c, t, y); if PROJECTED, project(x, c, t, x_new); if STARTED, N_U,
   newton(u, c, t, du) and start(u, c, t, x); N_K, slopes or other values that steps keep. Given after: run(), which takes
   the steps. */

#include <stdlib.h>

enum { CHUNK = N_X > 512 ? 1 : N_X > 64 ? 4 : 16 }; /* times at once; the block should fit into a cache */
#define SIZE(n) ((n) > 0 ? (n) : 1)
enum { STEPS, OUTPUT, NEWTON, MANY }; /* what failed, see REASONS of engine.py */

/* A study: n samples, rows of p (n, N_P) and, unless STARTED, x0 (n, N_X), at n_t times. */
typedef struct {
  const double *x0, *p, *times;
  long n, n_t;
  double rtol, atol; /* of steps with control */
  double longest;    /* step, or 0 */
  double newton;     /* largest change of unknowns, over their sizes, at which Newton's method ends */
  long most_steps;
  long dealt;       /* blocks given to threads */
  double *t_failed; /* (n,) NaN while a sample has not */
  char *failure;    /* (n,) of what */
  double *x_failed; /* (n, N_X) the state where its last step began */
  double *Y;        /* (n, n_t, N_Y) values, or NULL */
  long steps, iterations, most; /* taken by all blocks; iterations of Newton's method, and the most in a step */
} Study;

/* What a block holds of W of its lanes. */
typedef struct {
  V x[SIZE(N_X)], x_new[SIZE(N_X)], k[SIZE(N_K)], c[SIZE(N_C)], F[7 * SIZE(N_USED)];
  V x_at[CHUNK * SIZE(N_X)], y[CHUNK * SIZE(N_Y)]; /* states and outputs at some times */
} Part;

/* A block under way, at t, on a step of length h. */
typedef struct {
  Part part[PARTS];
  double t, t_new, h, h_next;
  double before; /* logarithm of the error of the step before */
  long number, next, live, sample[WIDTH];
  long steps, iterations, most;
  double *lower, *upper; /* extremes of the block, (n_t, N_Y) */
} Block;

#define EACH_PART(b) for (Part *a = (b)->part; a < (b)->part + PARTS; ++a)

/* The slope of state i from x and the slopes that are kept. */
static inline V slope(const V *x, const V *k, int i) { return i < N_OWN ? k[i] : x[i - N_OWN]; }

/* The sample of a lane fails. */
static void lose(const Block *b, Study *s, long lane, double t, char why) {
  const long i = b->sample[lane % b->live];
  s->t_failed[i] = t;
  s->failure[i] = why;
  for (int j = 0; j < N_X; ++j) s->x_failed[i * N_X + j] = b->part[lane / W].x[place[j]][lane % W];
}

static int run(Block *b, Study *s); /* from the first time to the last, or until samples fail: 0 */

static double worst(V a) {
  double m = 0.0;
  for (int l = 0; l < W; ++l) m = a[l] > m || a[l] != a[l] ? a[l] : m;
  return m;
}

/* Smallest and largest lanes of each of n vectors in every part. The last vectors of a tree overlap those before. */
static void extremes(const Block *b, long n, double *lower, double *upper) {
  long i = 0;
#ifdef TREE
  for (; n >= W && i < n; i += W) {
    if (i > n - W) i = n - W;
    const V *least = b->part->y + i, *most = least;
#if PARTS > 1
    V smallest[W], largest[W];
    for (int k = 0; k < W; ++k) {
      smallest[k] = largest[k] = least[k];
      for (int q = 1; q < PARTS; ++q) {
        smallest[k] = v_smaller(smallest[k], b->part[q].y[i + k]);
        largest[k] = v_larger(largest[k], b->part[q].y[i + k]);
      }
    }
    least = smallest;
    most = largest;
#endif
    const V low = tree_smaller(least), high = tree_larger(most);
    memcpy(lower + i, &low, sizeof low);
    memcpy(upper + i, &high, sizeof high);
  }
#endif
  for (; i < n; ++i) {
    lower[i] = upper[i] = b->part[0].y[i][0];
    for (int l = 1; l < WIDTH; ++l) {
      const double y = b->part[l / W].y[i][l % W];
      lower[i] = y < lower[i] ? y : lower[i];
      upper[i] = y > upper[i] ? y : upper[i];
    }
  }
}

/* Outputs at n times from number `first` on; 0 if a lane is not finite: its sample fails. */
static int keep(Block *b, Study *s, long first, long n) {
  V even = zero(), odd = zero(); /* two, since each addition waits for the one before */
  EACH_PART(b) {
    long i = n * N_Y % 2;
    if (i) even += a->y[0] * 0.0;
    for (; i < n * N_Y; i += 2) {
      even += a->y[i] * 0.0;
      odd += a->y[i + 1] * 0.0;
    }
  }
  const int finite = worst(even + odd) == 0.0;
  for (long l = 0; l < b->live && !finite; ++l)
    for (long i = 0; i < n * N_Y; ++i)
      if (b->part[l / W].y[i][l % W] * 0.0 != 0.0) {
        lose(b, s, l, s->times[first + i / SIZE(N_Y)], OUTPUT);
        break;
      }
  for (long l = 0; l < b->live && s->Y; ++l) {
    double *to = s->Y + (b->sample[l] * s->n_t + first) * N_Y;
    for (long i = 0; i < n * N_Y; ++i) to[i] = b->part[l / W].y[i][l % W];
  }
  if (!s->Y) extremes(b, n * N_Y, b->lower + first * N_Y, b->upper + first * N_Y);
  return finite;
}

#if STARTED
/* The state at the first time: Newton from u = 0, in each lane until its own step is small: convergence is quadratic,
   and a step below 1e-9 leaves an error at rounding level. NaN where it does not converge. */
static void assemble(Part *a, V t) {
  V u[SIZE(N_X)] = {zero()}, du[SIZE(N_U)];
  M active = (M)zero() == 0;
  for (int n = 0; n < 30 && N_U > 0 && !none(active); ++n) {
    V step = zero(), size = each(1e-3);
    newton(u, a->c, t, du);
    for (int i = 0; i < N_U; ++i) {
      V *ui = u + place[i];
      *ui -= blend(active, du[i], zero());
      step = v_larger(v_fabs(du[i]), step);
      size = v_larger(v_fabs(*ui), size);
    }
    active &= (M)(step > 1e-9 * size);
  }
  start(u, a->c, t, a->x);
  for (int i = 0; N_U > 0 && i < N_X; ++i) a->x[i] = blend(active, each(NAN), a->x[i]);
}
#endif

/* States of a block at the first time, from those of its samples that did not fail; lanes without a sample repeat one
   that has, and do not change the common step. 0 if a state is not finite: its sample fails. */
static int place_samples(Block *b, Study *s) {
  int finite = 1;
  EACH_PART(b) {
    V p[SIZE(N_P)], sum = zero();
    for (int l = 0; l < W; ++l) {
      const long i = b->sample[((a - b->part) * W + l) % b->live];
      for (int j = 0; j < N_P; ++j) p[j][l] = s->p[i * N_P + j];
      for (int j = 0; j < N_X && !STARTED; ++j) a->x[place[j]][l] = s->x0[i * N_X + j];
    }
    prepare(p, a->c);
#if STARTED
    assemble(a, each(b->t));
#endif
    for (int j = 0; j < N_X; ++j) sum += a->x[j] * 0.0;
    for (int l = 0; l < W; ++l)
      if (sum[l] != 0.0) {
        lose(b, s, (a - b->part) * W + l, b->t, STEPS);
        finite = 0;
      }
  }
  return finite;
}

/* The block on the constraints, and its outputs there. */
static void observe(Block *b) {
  EACH_PART(b) {
#if PROJECTED
    project(a->x, a->c, each(b->t), a->x_new);
    memcpy(a->x, a->x_new, sizeof a->x);
#endif
    outputs(a->x, a->c, each(b->t), a->y);
  }
}

/* The samples of a block that did not fail, at the first time; 0 if there are none. */
static int begin(Block *b, Study *s) {
  b->t = s->times[0];
  b->next = 1;
  for (;;) {
    b->live = 0;
    for (long i = b->number * WIDTH; i < b->number * WIDTH + WIDTH && i < s->n; ++i)
      if (s->t_failed[i] != s->t_failed[i]) b->sample[b->live++] = i;
    if (!b->live) return 0;
    if (!place_samples(b, s)) continue;
    observe(b);
    if (keep(b, s, 0, 1)) return 1;
  }
}

/* What one thread does: blocks until none is left. Values go to s->Y, or extremes to lower and upper (n_t, N_Y), where
   they join those of earlier blocks. 0 if there is not enough memory. */
int work(Study *s, double *restrict lower, double *restrict upper) {
  const long n = s->Y ? 0 : s->n_t * N_Y;
  Block *b = aligned_alloc(sizeof(V), sizeof(Block));
  double *part = malloc((2 * n + 1) * sizeof(double));
  const int enough = b && part;
  while (enough && (b->number = __atomic_fetch_add(&s->dealt, 1, __ATOMIC_RELAXED)) * WIDTH < s->n) {
    b->lower = part;
    b->upper = part + n;
    int found;
    b->steps = b->iterations = b->most = 0;
    while ((found = begin(b, s)) && !run(b, s)) {}
    __atomic_fetch_add(&s->steps, b->steps, __ATOMIC_RELAXED);
    __atomic_fetch_add(&s->iterations, b->iterations, __ATOMIC_RELAXED);
    for (long most = s->most; b->most > most && !__atomic_compare_exchange_n(&s->most, &most, b->most, 0, __ATOMIC_RELAXED, __ATOMIC_RELAXED);) {}
    for (long i = 0; found && i < n; ++i) {
      lower[i] = b->lower[i] < lower[i] ? b->lower[i] : lower[i];
      upper[i] = b->upper[i] > upper[i] ? b->upper[i] : upper[i];
    }
  }
  free(b);
  free(part);
  return enough;
}

const int width = WIDTH;
