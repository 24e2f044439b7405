/* Extremes of tensor polynomials of up to three parameters: the best of a dense grid of samples, then Newton's steps
   in all of them. One lane for each polynomial. */
#ifndef DENSE_SEARCH_H
#define DENSE_SEARCH_H

#include <stdlib.h>

#include "lanes.h"

#define ORDERS 65 /* one more than the highest degree */
#define PIECES 4  /* of a wavy polynomial's last parameter: each holds a start of Newton's method */
enum { STEPS = 15, DIRECTIONS = 3 };
#define TINY 1e-300
#define ENOUGH 1e-7 /* share of the range */

typedef struct {
  long n[DIRECTIONS], K[DIRECTIONS];     /* polynomials and samples along each parameter; 1 along missing ones */
  const double *x[DIRECTIONS];           /* (K) samples */
  const double *values[DIRECTIONS];      /* (K, n) Legendre polynomials there */
  const double *factors;                 /* (ORDERS, 2) of their recurrence */
  const int *rows;                       /* (n0 n1 n2) of the coefficients, the last parameter's degrees fastest */
  long pieces;                           /* of the last parameter: Newton's steps start from the best sample of each */
} Grid;

/* Legendre polynomials at x, and their first two derivatives. */
static void legendre(const Grid *g, V x, long n, V f[3][ORDERS]) {
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

static Local local(const Grid *g, const V *c, const V *x, double sign) {
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

/* A direction of descent: Newton's where the Hessian is positive definite, along parameters that do not push against an
   end. */
static void direction(const Grid *g, const Local *l, const V *x, V *p) {
  V h[6], z[DIRECTIONS], free[DIRECTIONS];
  memcpy(h, l->h, sizeof h);
  for (int k = 0; k < DIRECTIONS; ++k) {
    const M stuck = (M)((x[k] <= -1.0) & (l->g[k] >= 0.0)) | (M)((x[k] >= 1.0) & (l->g[k] <= 0.0));
    free[k] = g->n[k] > 1 ? blend(stuck, zero(), each(1.0)) : zero();
    z[k] = -free[k] * l->g[k];
  }
  h[1] *= free[0] * free[1], h[3] *= free[0] * free[2], h[4] *= free[1] * free[2];
  const V d0 = v_fabs(h[0]) + TINY, l1 = h[1] / d0, l3 = h[3] / d0;
  const V d1 = v_fabs(h[2] - l1 * h[1]) + TINY, mixed = h[4] - l3 * h[1], l4 = mixed / d1;
  const V d2 = v_fabs(h[5] - l3 * h[3] - l4 * mixed) + TINY;
  z[1] -= l1 * z[0];
  z[2] -= l3 * z[0] + l4 * z[1];
  p[2] = free[2] * z[2] / d2;
  p[1] = free[1] * (z[1] / d1 - l4 * p[2]);
  p[0] = free[0] * (z[0] / d0 - l1 * p[1] - l3 * p[2]);
}

/* From the best sample x to the extreme near it, until steps gain less than enough; sign is 1 for minima, -1 for maxima. */
static V polish(const Grid *g, const V *c, V *x, V enough, double sign) {
  Local here = local(g, c, x, sign);
  V reach = each(1.0); /* longest step, in samples */
  for (int step = 0; step < STEPS; ++step) {
    V p[DIRECTIONS], to[DIRECTIONS], part = each(1.0), gain = zero();
    direction(g, &here, x, p);
    for (int k = 0; k < DIRECTIONS; ++k) {
      const double gap = 3.14159265358979 / g->K[k];
      const V longest = reach * gap * (v_sqrt(v_larger(1.0 - x[k] * x[k], zero())) + 0.5 * gap);
      part = v_smaller(part, longest / (v_fabs(p[k]) + TINY));
    }
    for (int k = 0; k < DIRECTIONS; ++k) {
      to[k] = v_larger(v_smaller(x[k] + part * p[k], each(1.0)), each(-1.0));
      gain -= here.g[k] * (to[k] - x[k]);
    }
    if (none((M)(gain > enough))) break;
    const Local there = local(g, c, to, sign);
    const M better = (M)(there.y < here.y);
    reach *= choose(better, 2.0, 0.25);
    for (int k = 0; k < DIRECTIONS; ++k) x[k] = blend(better, to[k], x[k]), here.g[k] = blend(better, there.g[k], here.g[k]);
    for (int k = 0; k < 6; ++k) here.h[k] = blend(better, there.h[k], here.h[k]);
    here.y = blend(better, there.y, here.y);
  }
  return here.y;
}

/* The best values and numbers of samples, of minima and maxima. */
typedef struct {
  V low, high, lowest, highest;
} Best;

static inline void meet(Best *b, V y, V number) {
  b->lowest = blend((M)(y < b->low), number, b->lowest);
  b->highest = blend((M)(y > b->high), number, b->highest);
  b->low = v_smaller(y, b->low);
  b->high = v_larger(y, b->high);
}

/* The best samples of each piece of the last parameter. Samples are symmetric about 0, and so are the polynomials: those
   at x and -x are the sum and the difference of what even and odd degrees give. */
static void scan(const Grid *g, const V *c, V *plane, V *row, Best best[PIECES]) {
  const long n12 = g->n[1] * g->n[2], n = g->n[2], half = g->K[2] / 2, parts = (g->pieces + 1) / 2;
  for (long s = 0; s < g->pieces; ++s) best[s] = (Best){each(INFINITY), each(-INFINITY), zero(), zero()};
  for (long p = 0, first = 0; p < g->K[0]; ++p) {
    for (long j = 0; j < n12; ++j) {
      plane[j] = zero();
      for (long a = 0; a < g->n[0]; ++a) plane[j] += g->values[0][p * g->n[0] + a] * c[a * n12 + j];
    }
    for (long q = 0; q < g->K[1]; ++q, first += g->K[2]) {
      for (long j = 0; j < n; ++j) {
        row[j] = zero();
        for (long b = 0; b < g->n[1]; ++b) row[j] += g->values[1][q * g->n[1] + b] * plane[b * n + j];
      }
      V up = each((double)first), down = each((double)(first + g->K[2] - 1)), even, odd;
      for (long s = 0, r = 0; s < parts; ++s) {
        Best near = best[s], far = best[g->pieces - 1 - s];
        for (; r < half * (s + 1) / parts; ++r, up += 1.0, down -= 1.0) {
          const double *v = g->values[2] + r * n;
          even = v[0] * row[0], odd = zero();
          for (long e = 1; e < n; e += 2) odd += v[e] * row[e];
          for (long e = 2; e < n; e += 2) even += v[e] * row[e];
          meet(&near, even + odd, up);
          meet(&far, even - odd, down);
        }
        if (g->pieces > 1) {
          best[s] = near, best[g->pieces - 1 - s] = far;
        } else {
          meet(&near, far.low, far.lowest);
          meet(&near, far.high, far.highest);
          best[0] = near;
        }
      }
      even = zero();
      for (long e = 0; e < n; e += 2) even += g->values[2][half * n + e] * row[e];
      meet(&best[parts - 1], even, up);
    }
  }
}

/* C (n0 n1 n2, m) -> values (2, m) and points (2, 3, m) of minima and maxima. `next` counts the polynomials that
   threads have taken. Returns 0 if there is not enough memory. */
int dense(const Grid *g, long *next, long m, const double *C, double *values, double *points);
int dense(const Grid *g, long *next, long m, const double *C, double *values, double *points) {
  const long n = g->n[0] * g->n[1] * g->n[2], n12 = g->n[1] * g->n[2];
  V *c = aligned_alloc(sizeof(V), (n + n12 + g->n[2]) * sizeof(V));
  Best best[PIECES];
  for (long i; c && (i = __atomic_fetch_add(next, W, __ATOMIC_RELAXED)) < m;) {
    const size_t some = (m - i < W ? m - i : W) * sizeof *C;
    for (long j = 0; j < n; ++j) c[j] = zero(), memcpy(c + j, C + g->rows[j] * m + i, some);
    scan(g, c, c + n, c + n + n12, best);
    V low = best[0].low, high = best[0].high;
    for (long s = 1; s < g->pieces; ++s) low = v_smaller(low, best[s].low), high = v_larger(high, best[s].high);
    for (int side = 0; side < 2; ++side) {
      const double sign = side ? -1.0 : 1.0;
      V least = each(INFINITY), at[DIRECTIONS], x[DIRECTIONS];
      for (long s = 0; s < g->pieces; ++s) {
        for (int l = 0; l < W; ++l) {
          long number = (long)(side ? best[s].highest : best[s].lowest)[l];
          for (int k = DIRECTIONS - 1; k >= 0; number /= g->K[k--]) x[k][l] = g->x[k][number % g->K[k]];
        }
        const V y = polish(g, c, x, ENOUGH * (high - low), sign);
        const M better = (M)(y < least);
        least = blend(better, y, least);
        for (int k = 0; k < DIRECTIONS; ++k) at[k] = blend(better, x[k], at[k]);
      }
      least *= sign;
      memcpy(values + side * m + i, &least, some);
      for (int k = 0; k < DIRECTIONS; ++k) memcpy(points + (side * DIRECTIONS + k) * m + i, at + k, some);
    }
  }
  const int enough = c != NULL;
  free(c);
  return enough;
}

#endif
