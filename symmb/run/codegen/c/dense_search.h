/* Extremes of tensor polynomials of up to three parameters: the best sample of a dense grid, in single precision, then Newton's
   steps. There is one lane for each polynomial.

   A response has one polynomial for each output and time, thousands in all, with the same degrees. Branch and bound uses
   different boxes for each polynomial, so it cannot run in lanes. A grid is the same for all polynomials. Its samples are sums
   over one parameter after another, so a sample takes about as many products as the degree of one parameter. Ehlich and Zeller
   (1964) prove a bound for the range of a polynomial beyond samples at the extremes of a Chebyshev polynomial with a multiple
   of its degree. */
#ifndef DENSE_SEARCH_H
#define DENSE_SEARCH_H

#include <stdlib.h>

#include "lanes.h"

#define HIGHEST_DEGREE 64 /* not calibrated by a test. Larger values take more of the stack: local() takes 37 kB in lanes of 8 */
#define ORDERS (HIGHEST_DEGREE + 1)
#define DIRECTIONS 3 /* largest number of parameters: the size of the grid grows with its power */
#define PIECES 4     /* of the last parameter of a polynomial with many waves. Newton's method starts in each piece */
enum { STEPS = 15 };
#define TINY 1e-300
#define ENOUGH 1e-7 /* the search ends when a step gains less than this fraction of the range */

typedef struct {
  long n[DIRECTIONS], K[DIRECTIONS];     /* polynomials and samples along each parameter; 1 along missing ones */
  const double *x[DIRECTIONS];           /* (K) samples */
  const double *values[DIRECTIONS];      /* (K, n) Legendre polynomials at the samples */
  const float *single[DIRECTIONS];       /* the same in single precision */
  const double *factors;                 /* (ORDERS, 2) factors of their recurrence */
  const int *rows;                       /* (n0 n1 n2) of the coefficients, the last parameter's degrees fastest */
  long pieces;                           /* of the last parameter. Newton's steps start from the best sample of each piece */
  double reach;                          /* largest difference between an extreme and the best sample near it, over the range */
} Grid;

/* Legendre polynomials at x, and their first two derivatives. */
static void legendre(const Grid *g, V x, long n, V f[3][ORDERS]) {
  /* P'_(j+1) = P'_(j-1) + (2 j + 1) P_j is also valid at the ends, where most extremes are. The formula with only P_j and
     P_(j-1) divides by 1 - x^2, which is 0 there. */
  f[0][0] = each(1.0);
  f[1][0] = f[2][0] = zero();
  if (n > 1) f[0][1] = x, f[1][1] = each(1.0), f[2][1] = zero();
  for (long j = 1; j + 1 < n; ++j) {
    const double two = 2.0 * j + 1.0;
    f[0][j + 1] = g->factors[2 * j] * x * f[0][j] - g->factors[2 * j + 1] * f[0][j - 1];
    f[1][j + 1] = f[1][j - 1] + two * f[0][j];
    f[2][j + 1] = f[2][j - 1] + two * f[1][j];
  }
}

typedef struct {
  V y, g[DIRECTIONS], h[6]; /* value, gradient, and the Hessian's lower triangle by rows */
} Local;

/* The polynomials at points x, times the sign. */
static Local local(const Grid *g, const V *c, const V *x, double sign) {
  /* Sums over one parameter are nested in sums over the next parameter. So coefficients are read once, and each coefficient
     needs three products instead of the ten products of a value with all its first and second derivatives. */
  V f[DIRECTIONS][3][ORDERS];
  Local l = {0};
  for (int k = 0; k < DIRECTIONS; ++k) legendre(g, x[k], g->n[k], f[k]);
  for (long a = 0; a < g->n[0]; ++a) {
    V t0 = zero(), t1 = zero(), t2 = zero(), t01 = zero(), t11 = zero(), t02 = zero();
    for (long b = 0; b < g->n[1]; ++b) {
      V s0 = zero(), s1 = zero(), s2 = zero();
      for (long e = 0; e < g->n[2]; ++e, ++c) s0 += *c * f[2][0][e], s1 += *c * f[2][1][e], s2 += *c * f[2][2][e];
      const V f0 = f[1][0][b], f1 = f[1][1][b];
      t0 += f0 * s0, t1 += f1 * s0, t2 += f[1][2][b] * s0, t01 += f0 * s1, t11 += f1 * s1, t02 += f0 * s2;
    }
    const V f0 = sign * f[0][0][a], f1 = sign * f[0][1][a];
    l.y += f0 * t0;
    l.g[0] += f1 * t0, l.g[1] += f0 * t1, l.g[2] += f0 * t01;
    l.h[0] += sign * f[0][2][a] * t0, l.h[1] += f1 * t1, l.h[2] += f0 * t2;
    l.h[3] += f1 * t01, l.h[4] += f0 * t11, l.h[5] += f0 * t02;
  }
  return l;
}

/* A direction of descent for the free parameters. It is Newton's direction if the Hessian is positive definite. */
static void direction(const Grid *g, const Local *l, const V *x, V *p) {
  /* A parameter at an end is fixed if its slope points out of the box. Its row and column are removed from the Hessian. A
     Newton step of all parameters that is cut off at the end might not descend. */
  V h[6], z[DIRECTIONS], free[DIRECTIONS];
  memcpy(h, l->h, sizeof h);
  for (int k = 0; k < DIRECTIONS; ++k) {
    const M stuck = (M)((x[k] <= -1.0) & (l->g[k] >= 0.0)) | (M)((x[k] >= 1.0) & (l->g[k] <= 0.0));
    free[k] = g->n[k] > 1 ? blend(stuck, zero(), each(1.0)) : zero();
    z[k] = -free[k] * l->g[k];
  }
  h[1] *= free[0] * free[1], h[3] *= free[0] * free[2], h[4] *= free[1] * free[2];
  /* The factorization L D L^T with absolute values of D instead of D. If all pivots are positive, it is exact and gives
     Newton's step. Otherwise it still gives a direction of descent, away from saddle points and maxima. TINY prevents 0 / 0 for
     missing parameters. */
  const V d0 = v_fabs(h[0]) + TINY, l1 = h[1] / d0, l3 = h[3] / d0;
  const V d1 = v_fabs(h[2] - l1 * h[1]) + TINY, mixed = h[4] - l3 * h[1], l4 = mixed / d1;
  const V d2 = v_fabs(h[5] - l3 * h[3] - l4 * mixed) + TINY;
  z[1] -= l1 * z[0];
  z[2] -= l3 * z[0] + l4 * z[1];
  p[2] = free[2] * z[2] / d2;
  p[1] = free[1] * (z[1] / d1 - l4 * p[2]);
  p[0] = free[0] * (z[0] / d0 - l1 * p[1] - l3 * p[2]);
}

/* From the best sample x to the extreme near it, until steps gain less than enough. sign is 1 for minima and -1 for maxima. */
static V polish(const Grid *g, const V *c, V *x, V enough, double sign) {
  /* A trust region. The extreme is near the best sample, so the first step covers at most the distance of one sample. The limit
     may double after a gain, and is divided by four after a failure. Steps are compared with the distance of samples near x.
     Samples are closer together at the ends, because x = cos(theta). */
  Local here = local(g, c, x, sign);
  V reach = each(1.0); /* longest step, in distances between samples */
  for (int step = 0; step < STEPS; ++step) {
    V p[DIRECTIONS], to[DIRECTIONS], part = each(1.0), gain = zero();
    direction(g, &here, x, p);
    for (int k = 0; k < DIRECTIONS; ++k) {
      if (g->n[k] == 1) continue;
      const double gap = 3.14159265358979 / g->K[k];
      const V longest = reach * gap * (v_sqrt(v_larger(1.0 - x[k] * x[k], zero())) + 0.5 * gap);
      part = v_smaller(part, longest / (v_fabs(p[k]) + TINY));
    }
    for (int k = 0; k < DIRECTIONS; ++k) {
      to[k] = v_larger(v_smaller(x[k] + part * p[k], each(1.0)), each(-1.0));
      gain -= here.g[k] * (to[k] - x[k]);
    }
    if (none((M)(gain > enough))) break; /* other lanes continue: their steps are better or are not used */
    const Local there = local(g, c, to, sign);
    const M better = (M)(there.y < here.y);
    reach *= choose(better, 2.0, 0.25);
    for (int k = 0; k < DIRECTIONS; ++k) x[k] = blend(better, to[k], x[k]), here.g[k] = blend(better, there.g[k], here.g[k]);
    for (int k = 0; k < 6; ++k) here.h[k] = blend(better, there.h[k], here.h[k]);
    here.y = blend(better, there.y, here.y);
  }
  return here.y;
}

/* Twice as many polynomials in single precision. Its seven digits are enough to choose the best samples, because samples that
   differ by rounding are equally good starts of Newton's method, which uses double precision. */
typedef float F __attribute__((vector_size(8 * W), aligned(8 * W)));
typedef int N __attribute__((vector_size(8 * W), aligned(8 * W)));
typedef float H __attribute__((vector_size(4 * W), aligned(4 * W)));
#define MANY (2 * W)
#if W >= 4
BY_INSTRUCTION_2(F, f_smaller, "vminps")
BY_INSTRUCTION_2(F, f_larger, "vmaxps")
#else
static inline F f_blend(N mask, F a, F b) { return (F)(((N)a & mask) | ((N)b & ~mask)); }
static inline F f_smaller(F a, F b) { return f_blend((N)(a < b), a, b); }
static inline F f_larger(F a, F b) { return f_blend((N)(a > b), a, b); }
#endif

/* The smallest and largest samples of a row, and of all rows with the numbers of their rows. */
typedef struct {
  F low, high;
} Span;
typedef struct {
  Span y;
  N lowest, highest;
} Best;

static inline void meet(Span *span, F low, F high) {
  span->low = f_smaller(span->low, low);
  span->high = f_larger(span->high, high);
}

static inline void meet_row(Best *b, Span y, int number) {
  /* Only rows are stored. place() finds the sample within a row again, once for each polynomial. Storing it here would cost a
     blend for each sample. */
  const N low = (N)(y.low < b->y.low), high = (N)(y.high > b->y.high);
  b->lowest = (low & number) | (~low & b->lowest);
  b->highest = (high & number) | (~high & b->highest);
  b->y.low = f_smaller(b->y.low, y.low);
  b->y.high = f_larger(b->y.high, y.high);
}

/* Extremes y of samples of two rows `up` and `down`, in a piece (y[0], y[2]) and in its mirror image (y[1], y[3]). Samples are
   symmetric about 0, and Legendre polynomials are even or odd. The values at x and -x are therefore the sum and the difference
   of the sums over even and odd degrees. Both values together need no more products than one value. */
static void samples(const float *v, long n, long from, long to, const F *up, const F *down, Span y[4]) {
  Span near = y[0], far = y[1], near_down = y[2], far_down = y[3];
  for (long r = from; r < to; r += 2) { /* two at a time, because their number is even. These sums are independent */
    const float *f = v + r * n, *g = f + n;
    F a = f[0] * up[0], b = g[0] * up[0], c = f[0] * down[0], d = g[0] * down[0];
    for (long e = 2; e < n; e += 2) a += f[e] * up[e], b += g[e] * up[e], c += f[e] * down[e], d += g[e] * down[e];
    F odd_a = {0}, odd_b = odd_a, odd_c = odd_a, odd_d = odd_a;
    for (long e = 1; e < n; e += 2)
      odd_a += f[e] * up[e], odd_b += g[e] * up[e], odd_c += f[e] * down[e], odd_d += g[e] * down[e];
    meet(&near, f_smaller(a + odd_a, b + odd_b), f_larger(a + odd_a, b + odd_b));
    meet(&far, f_smaller(a - odd_a, b - odd_b), f_larger(a - odd_a, b - odd_b));
    meet(&near_down, f_smaller(c + odd_c, d + odd_d), f_larger(c + odd_c, d + odd_d));
    meet(&far_down, f_smaller(c - odd_c, d - odd_d), f_larger(c - odd_c, d - odd_d));
  }
  y[0] = near, y[1] = far, y[2] = near_down, y[3] = far_down;
}

/* The rows, p K1 + q, of the best samples in each piece of the last parameter. */
static void scan(const Grid *g, const F *c, F *plane, F *up, Best best[PIECES]) {
  /* Minima of a polynomial with many waves may differ by less than the errors of samples. Therefore Newton's method starts in
     each piece of the parameter with the highest degree, which is the last parameter. */
  const long n1 = g->n[1], n = g->n[2], n12 = n1 * n, K1 = g->K[1], half = g->K[2] / 2, parts = (g->pieces + 1) / 2;
  const F none = {0};
  const Span empty = {none + INFINITY, none - INFINITY};
  F *down = up + n;
  for (long s = 0; s < g->pieces; ++s) best[s] = (Best){empty, {0}, {0}};
  for (long p = 0; p < g->K[0]; ++p) {
    for (long j = 0; j < n12; ++j) {
      plane[j] = none;
      for (long a = 0; a < g->n[0]; ++a) plane[j] += g->single[0][p * g->n[0] + a] * c[a * n12 + j];
    }
    for (long q = 0; q <= K1 / 2; ++q) { /* half of the rows. The other rows are their mirror images, `down` */
      const float *f = g->single[1] + q * n1;
      F middle[2] = {none, none};
      for (long j = 0; j < n; ++j) {
        F even = f[0] * plane[j], odd = none;
        for (long b = 1; b < n1; b += 2) odd += f[b] * plane[b * n + j];
        for (long b = 2; b < n1; b += 2) even += f[b] * plane[b * n + j];
        up[j] = even + odd, down[j] = even - odd;
      }
      for (long e = 0; e < n; e += 2) {
        const float at = g->single[2][half * n + e];
        middle[0] += at * up[e], middle[1] += at * down[e];
      }
      for (long s = 0; s < parts; ++s) {
        Span y[4] = {empty, empty, empty, empty};
        const long far = g->pieces - 1 - s;
        if (s == parts - 1) meet(y, middle[0], middle[0]), meet(y + 2, middle[1], middle[1]);
        samples(g->single[2], n, half * s / parts, half * (s + 1) / parts, up, down, y);
        for (int turned = 0; turned < 2; ++turned) {
          const int row = (int)(p * K1 + (turned ? K1 - 1 - q : q));
          meet_row(best + s, y[2 * turned], row);
          meet_row(best + far, y[2 * turned + 1], row);
        }
      }
    }
  }
}

/* The best sample x of a piece, in the row of each lane. sign is 1 for minima and -1 for maxima. The bounds of a piece must be
   equal to the bounds in scan(), which has mirrored pieces. */
static void place(const Grid *g, const V *c, const int *rows, long piece, double sign, V *row, V *x) {
  const long n = g->n[2], half = g->K[2] / 2, parts = (g->pieces + 1) / 2, mirror = g->pieces - 1 - piece;
  long from = half * piece / parts, to = piece == parts - 1 ? half + 1 : half * (piece + 1) / parts;
  if (piece >= parts) from = g->K[2] - half * (mirror + 1) / parts, to = g->K[2] - half * mirror / parts;
  if (g->pieces == 1) to = g->K[2];
  const double *values[2][W];
  for (int l = 0; l < W; ++l) {
    const long number[] = {rows[l] / g->K[1], rows[l] % g->K[1]};
    for (int k = 0; k < 2; ++k) x[k][l] = g->x[k][number[k]], values[k][l] = g->values[k] + number[k] * g->n[k];
  }
  for (long j = 0; j < n; ++j) row[j] = zero();
  for (long a = 0; a < g->n[0]; ++a)
    for (long b = 0; b < g->n[1]; ++b, c += n) {
      V f;
      for (int l = 0; l < W; ++l) f[l] = sign * values[0][l][a] * values[1][l][b];
      for (long j = 0; j < n; ++j) row[j] += f * c[j];
    }
  V least = each(INFINITY);
  for (long r = from; r < to; ++r) {
    V y = zero();
    for (long j = 0; j < n; ++j) y += g->values[2][r * n + j] * row[j];
    const M better = (M)(y < least);
    x[2] = blend(better, each(g->x[2][r]), x[2]);
    least = blend(better, y, least);
  }
}

/* Coefficients (n, MANY) in single precision, divided by the sum of their absolute values, `size`. So they cannot overflow or
   vanish. The constant is left out, because it does not move extremes, and a large constant would reduce the digits of all
   values. */
static void to_single(const V *c, long n, H *single, V *size) {
  V sum = zero();
  for (long j = 1; j < n; ++j) sum += v_fabs(c[j]);
  const V factor = blend((M)(sum > TINY), 1.0 / sum, zero());
  for (long j = 0; j < n; ++j) single[2 * j] = __builtin_convertvector(j ? c[j] * factor : zero(), H);
  *size = sum;
}

/* Lanes in which a polynomial is certainly monotone along each parameter, and then the corner x of its minimum. |P_j'| is at
   most j (j + 1) / 2. So a linear term that is larger than the sum of the others in this measure determines the sign of the
   slope. Most responses to small tolerances are of this kind, and need no grid. */
static M monotone(const Grid *g, const V *c, V *x) {
  const V *linear[] = {c + g->n[1] * g->n[2], c + g->n[2], c + 1};
  V steepest[DIRECTIONS] = {{0}};
  for (long a = 0; a < g->n[0]; ++a)
    for (long b = 0; b < g->n[1]; ++b)
      for (long e = 0; e < g->n[2]; ++e, ++c) {
        const V size = v_fabs(*c);
        steepest[0] += 0.5 * a * (a + 1) * size;
        steepest[1] += 0.5 * b * (b + 1) * size;
        steepest[2] += 0.5 * e * (e + 1) * size;
      }
  M is_monotone = ~(M){0};
  for (int k = 0; k < DIRECTIONS; ++k) {
    x[k] = zero();
    if (g->n[k] == 1) continue;
    x[k] = choose(*linear[k] > 0.0, -1.0, 1.0);
    is_monotone &= (M)(2.0 * v_fabs(*linear[k]) >= steepest[k]); /* steepest also contains the linear term */
  }
  return is_monotone;
}

/* C (n0 n1 n2, m) -> values (2, m) and points (2, 3, m) of minima and maxima. `next` counts the polynomials that threads have
   taken. Returns 0 if there is not enough memory. */
int dense(const Grid *g, long *next, long m, const double *C, double *values, double *points);
int dense(const Grid *g, long *next, long m, const double *C, double *values, double *points) {
  const long n = g->n[0] * g->n[1] * g->n[2], n12 = g->n[1] * g->n[2];
  V *c = aligned_alloc(sizeof(V), (3 * n + n12 + 3 * g->n[2]) * sizeof(V)), *row = c + 2 * n;
  F *single = (F *)(row + g->n[2]), *plane = single + n;
  Best best[PIECES];
  for (long first; c && (first = __atomic_fetch_add(next, MANY, __ATOMIC_RELAXED)) < m;) {
    V size[2], corner[2][DIRECTIONS];
    M is_monotone = ~(M){0};
    for (int h = 0; h < 2; ++h) {
      const long i = first + h * W;
      V *own = c + h * n;
      for (long j = 0; j < n; ++j) own[j] = some_of(C + g->rows[j] * m + i, i < m ? m - i : 0);
      is_monotone &= monotone(g, own, corner[h]);
      to_single(own, n, (H *)single + h, size + h);
    }
    /* The grid is left out only if no lane needs it, because a vector takes as long for one lane as for all. */
    const int at_corners = none(~is_monotone);
    Span all;
    F range;
    if (!at_corners) {
      scan(g, single, plane, plane + n12, best);
      all = best[0].y;
      for (long s = 1; s < g->pieces; ++s) meet(&all, best[s].y.low, best[s].y.high);
      range = all.high - all.low;
    }
    for (long h = 0, i = first; h < 2 && i < m; ++h, i += W)
      for (int side = 0; side < 2; ++side) {
        const double sign = side ? -1.0 : 1.0;
        V least = each(INFINITY), at[DIRECTIONS], x[DIRECTIONS];
        for (int k = 0; k < DIRECTIONS; ++k) at[k] = x[k] = zero();
        if (at_corners) {
          for (int k = 0; k < DIRECTIONS; ++k) at[k] = sign * corner[h][k];
          least = local(g, c + h * n, at, sign).y;
        } else {
          const V enough = ENOUGH * size[h] * __builtin_convertvector(((const H *)&range)[h], V);
          for (long s = 0; s < g->pieces; ++s) {
            const F gap = side ? all.high - best[s].y.high : best[s].y.low - all.low;
            const N *rows = side ? &best[s].highest : &best[s].lowest, is_far = (N)(gap > (float)g->reach * range);
            V tolerance = enough;
            for (int l = 0; l < W; ++l)
              if (is_far[h * W + l]) tolerance[l] = INFINITY; /* no steps, because the extreme must be in another piece */
            place(g, c + h * n, (const int *)rows + h * W, s, sign, row, x);
            const V y = polish(g, c + h * n, x, tolerance, sign);
            const M better = (M)(y < least);
            least = blend(better, y, least);
            for (int k = 0; k < DIRECTIONS; ++k) at[k] = blend(better, x[k], at[k]);
          }
        }
        to_some(values + side * m + i, sign * least, m - i);
        for (int k = 0; k < DIRECTIONS; ++k) to_some(points + (side * DIRECTIONS + k) * m + i, at[k], m - i);
      }
  }
  const int enough = c != NULL;
  free(c);
  return enough;
}

#endif
