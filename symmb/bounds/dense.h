/* Extremes of tensor polynomials of up to three parameters: the best of a dense grid of samples, then Newton's steps along
   one parameter after the other. One lane for each polynomial. Given before: lanes.h. */

enum { SWEEPS = 3, ORDERS = 65, DIRECTIONS = 3, PIECES = 4 };

typedef struct {
  long n[DIRECTIONS], K[DIRECTIONS];     /* polynomials and samples along each parameter; 1 along missing ones */
  const double *x[DIRECTIONS];           /* (K) samples */
  const double *values[DIRECTIONS];      /* (K, n) Legendre polynomials there */
  const double *factors;                 /* (ORDERS, 2) of their recurrence */
  long pieces;                           /* of the last parameter: Newton's steps start from the best sample of each */
} Grid;

/* Legendre polynomials at x: factors holds (2 j + 1) / (j + 1) and j / (j + 1). */
static void legendre(const Grid *g, V x, long n, V *f) {
  f[0] = each(1.0);
  if (n > 1) f[1] = x;
  for (long j = 1; j + 1 < n; ++j) f[j + 1] = g->factors[2 * j] * x * f[j] - g->factors[2 * j + 1] * f[j - 1];
}

/* First and second derivative of the sum of w f, with Legendre polynomials f. */
static void slopes(const V *w, const V *f, long n, V *slope, V *bend) {
  V first[ORDERS] = {zero(), each(1.0)}, second[ORDERS] = {zero(), zero()};
  *slope = w[1];
  *bend = zero();
  for (long j = 1; j + 1 < n; ++j) {
    first[j + 1] = first[j - 1] + (2.0 * j + 1.0) * f[j];
    second[j + 1] = second[j - 1] + (2.0 * j + 1.0) * first[j];
    *slope += w[j + 1] * first[j + 1];
    *bend += w[j + 1] * second[j + 1];
  }
}

/* The polynomial in x_k alone, all others being where their values f are. */
static void along(const Grid *g, const V *c, V f[DIRECTIONS][ORDERS], int k, V *w) {
  for (long j = 0; j < g->n[k]; ++j) w[j] = zero();
  for (long a = 0; a < g->n[0]; ++a)
    for (long b = 0; b < g->n[1]; ++b)
      for (long e = 0; e < g->n[2]; ++e) {
        const long at[] = {a, b, e};
        V term = c[(a * g->n[1] + b) * g->n[2] + e];
        for (int i = 0; i < DIRECTIONS; ++i)
          if (i != k && g->n[i] > 1) term *= f[i][at[i]];
        w[at[k]] += term;
      }
}

static V sum(const V *w, const V *f, long n) {
  V y = zero();
  for (long j = 0; j < n; ++j) y += w[j] * f[j];
  return y;
}

/* From the best sample x to the extreme near it; sign is 1 for minima and -1 for maxima. */
static V polish(const Grid *g, const V *c, V *x, V best, double sign) {
  V f[DIRECTIONS][ORDERS], further[DIRECTIONS][ORDERS], w[ORDERS], there[ORDERS], slope, bend;
  for (int i = 0; i < DIRECTIONS; ++i) legendre(g, x[i], g->n[i], f[i]);
  for (int sweep = 0; sweep < SWEEPS; ++sweep) {
    V before[DIRECTIONS];
    M moved = {0};
    memcpy(before, x, sizeof before);
    for (int k = 0; k < DIRECTIONS; ++k) {
      if (g->n[k] == 1) continue;
      along(g, c, f, k, w);
      slopes(w, f[k], g->n[k], &slope, &bend);
      slope *= sign;
      bend *= sign;
      const double gap = 3.14159265358979 / (g->K[k] - 1);
      const V reach = gap * v_sqrt(v_larger(1.0 - x[k] * x[k], zero())) + 0.5 * gap * gap;
      V step = choose(bend > 0.0, -slope / bend, choose(slope > 0.0, -reach, reach));
      step = v_larger(v_smaller(step, reach), -reach);
      const V to = v_larger(v_smaller(x[k] + step, each(1.0)), each(-1.0));
      legendre(g, to, g->n[k], there);
      const V y = sign * sum(w, there, g->n[k]);
      const M better = (M)(y < best);
      moved |= better;
      best = blend(better, y, best);
      x[k] = blend(better, to, x[k]);
      for (long j = 0; j < g->n[k]; ++j) f[k][j] = blend(better, there[j], f[k][j]);
    }
    if (none(moved)) break;
    /* Along a valley the sweeps go in one direction, which leads further. */
    for (double far = 4.0; far >= 1.0; far *= 0.5) {
      V to[DIRECTIONS];
      for (int k = 0; k < DIRECTIONS; ++k) {
        to[k] = v_larger(v_smaller(x[k] + far * (x[k] - before[k]), each(1.0)), each(-1.0));
        legendre(g, to[k], g->n[k], further[k]);
      }
      along(g, c, further, 0, w);
      const V y = sign * sum(w, further[0], g->n[0]);
      const M better = (M)(y < best);
      best = blend(better, y, best);
      for (int k = 0; k < DIRECTIONS; ++k) {
        x[k] = blend(better, to[k], x[k]);
        for (long j = 0; j < g->n[k]; ++j) f[k][j] = blend(better, further[k][j], f[k][j]);
      }
    }
  }
  return best;
}

/* The best samples of each piece of the last parameter: values and numbers of minima, then of maxima. */
static void scan(const Grid *g, const V *c, V *plane, V *row, V best[2][PIECES], V sample[2][PIECES]) {
  const long n12 = g->n[1] * g->n[2];
  V number = zero();
  for (long s = 0; s < g->pieces; ++s) best[0][s] = each(INFINITY), best[1][s] = each(-INFINITY);
  for (long p = 0; p < g->K[0]; ++p) {
    for (long j = 0; j < n12; ++j) {
      plane[j] = zero();
      for (long a = 0; a < g->n[0]; ++a) plane[j] += g->values[0][p * g->n[0] + a] * c[a * n12 + j];
    }
    for (long q = 0; q < g->K[1]; ++q) {
      for (long j = 0; j < g->n[2]; ++j) {
        row[j] = zero();
        for (long b = 0; b < g->n[1]; ++b) row[j] += g->values[1][q * g->n[1] + b] * plane[b * g->n[2] + j];
      }
      for (long s = 0, r = 0; s < g->pieces; ++s) {
        V low = best[0][s], high = best[1][s], lowest = sample[0][s], highest = sample[1][s];
        for (; r < g->K[2] * (s + 1) / g->pieces; ++r) {
          V y = zero();
          for (long e = 0; e < g->n[2]; ++e) y += g->values[2][r * g->n[2] + e] * row[e];
          lowest = blend((M)(y < low), number, lowest);
          highest = blend((M)(y > high), number, highest);
          low = v_smaller(y, low);
          high = v_larger(y, high);
          number += 1.0;
        }
        best[0][s] = low, best[1][s] = high, sample[0][s] = lowest, sample[1][s] = highest;
      }
    }
  }
}

/* C (n0 n1 n2, m) by rows -> values (2, m) and points (2, 3, m) of minima and maxima, of polynomials from number begin to
   end, multiples of W. 0 if there is not enough memory. */
int dense(const Grid *g, long m, long begin, long end, const double *C, double *values, double *points) {
  const long n = g->n[0] * g->n[1] * g->n[2], n12 = g->n[1] * g->n[2];
  V *c = aligned_alloc(sizeof(V), (n + n12 + g->n[2]) * sizeof(V)), best[2][PIECES], sample[2][PIECES] = {{{0}}};
  for (long i = begin; c && i < end; i += W) {
    for (long j = 0; j < n; ++j) memcpy(c + j, C + j * m + i, sizeof(V));
    scan(g, c, c + n, c + n + n12, best, sample);
    for (int side = 0; side < 2; ++side) {
      const double sign = side ? -1.0 : 1.0;
      V least = each(INFINITY), at[DIRECTIONS], x[DIRECTIONS];
      for (long s = 0; s < g->pieces; ++s) {
        for (int l = 0; l < W; ++l) {
          long number = (long)sample[side][s][l];
          for (int k = DIRECTIONS - 1; k >= 0; number /= g->K[k--]) x[k][l] = g->x[k][number % g->K[k]];
        }
        const V y = polish(g, c, x, sign * best[side][s], sign);
        const M better = (M)(y < least);
        least = blend(better, y, least);
        for (int k = 0; k < DIRECTIONS; ++k) at[k] = blend(better, x[k], at[k]);
      }
      least *= sign;
      memcpy(values + side * m + i, &least, sizeof(V));
      for (int k = 0; k < DIRECTIONS; ++k) memcpy(points + (side * DIRECTIONS + k) * m + i, at + k, sizeof(V));
    }
  }
  const int enough = c != NULL;
  free(c);
  return enough;
}
