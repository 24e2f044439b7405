/* Coefficients of sums of interpolants on tensor grids, and sums of squares of coefficients. There is one lane for each
   response. Blocks of responses fit into a cache, so that they are read from memory only once. */
#ifndef TENSOR_FIT_H
#define TENSOR_FIT_H

#include <stdlib.h>

#include "lanes.h"

#define CACHED 8192 /* vectors that fit into a cache */
#define LONGEST 64  /* vectors of a row that a thread takes at a time. With more, other threads would wait */

typedef struct {
  long count, n, largest;    /* tensor grids, nodes of all of them together, and of the largest */
  const double *factors;     /* (count) of their interpolants in the sum */
  const long *first_row;     /* (count + 1) of each grid */
  const int *rows;           /* numbers of nodes */
  const long *first_axis;    /* (count + 1) of each grid */
  const long *lengths;       /* nodes along each axis */
  const long *matrices;      /* where in `fits` the matrix of each axis begins */
  const double *fits;        /* from values to coefficients */
} Tensors;

/* Rows a to a + 3, or fewer, of a matrix (n, n), applied to vectors at distances of `after`. Each vector is loaded once for
   four sums, which are independent of each other. */
static inline void four_rows(const double *A, long n, long a, long after, const V *in, V *out) {
  const double *r0 = A + a * n, *r1 = a + 1 < n ? r0 + n : r0, *r2 = a + 2 < n ? r1 + n : r0, *r3 = a + 3 < n ? r2 + n : r0;
  V s0 = zero(), s1 = zero(), s2 = zero(), s3 = zero();
  for (long b = 0; b < n; ++b) {
    const V y = in[b * after];
    s0 += r0[b] * y, s1 += r1[b] * y, s2 += r2[b] * y, s3 += r3[b] * y;
  }
  out[a * after] = s0;
  if (a + 1 < n) out[(a + 1) * after] = s1;
  if (a + 2 < n) out[(a + 2) * after] = s2;
  if (a + 3 < n) out[(a + 3) * after] = s3;
}

/* A matrix (n, n) applied along the middle axis of a block (before, n, after). */
static void along(const double *A, long before, long n, long after, const V *in, V *out) {
  for (long o = 0; o < before; ++o, in += n * after, out += n * after)
    for (long i = 0; i < after; ++i)
      for (long a = 0; a < n; a += 4) four_rows(A, n, a, after, in + i, out + i);
}

/* Values y (n) at the nodes -> coefficients, in place. `in` and `out` have the size of the largest grid, and `sum` has the size
   of y. */
static void interpolate(const Tensors *t, V *y, V *sum, V *in, V *out) {
  for (long k = 0; t->count > 1 && k < t->n; ++k) sum[k] = zero();
  for (long g = 0; g < t->count; ++g) {
    const int *rows = t->rows + t->first_row[g];
    const long n = t->first_row[g + 1] - t->first_row[g];
    for (long k = 0; k < n; ++k) in[k] = y[rows[k]];
    for (long x = t->first_axis[g], before = 1; x < t->first_axis[g + 1]; before *= t->lengths[x++]) {
      along(t->fits + t->matrices[x], before, t->lengths[x], n / before / t->lengths[x], in, out);
      V *other = in;
      in = out, out = other;
    }
    if (t->count == 1) {
      for (long k = 0; k < n; ++k) y[rows[k]] = t->factors[g] * in[k];
      return;
    }
    for (long k = 0; k < n; ++k) sum[rows[k]] += t->factors[g] * in[k];
  }
  memcpy(y, sum, t->n * sizeof *y);
}

/* Values Y (n, m) at the nodes -> coefficients C (n, m). The rows of Y may be anywhere in memory. `next` counts the responses
   that threads have taken. A thread takes many responses at a time, because memory is fast only for long parts of rows. Returns
   0 if there is not enough memory. */
int fit(const Tensors *t, long *next, long m, const double *const *Y, double *C);
int fit(const Tensors *t, long *next, long m, const double *const *Y, double *C) {
  const long n = t->n, most = CACHED / n, tile = most < 1 ? 1 : most < LONGEST ? most : LONGEST;
  V *y = aligned_alloc(sizeof(V), ((tile + 1) * n + 2 * t->largest) * sizeof(V)), *sum = y + tile * n, *in = sum + n;
  for (long i; y && (i = __atomic_fetch_add(next, tile * W, __ATOMIC_RELAXED)) < m;) {
    const long end = m - i < tile * W ? m - i : tile * W;
    for (long k = 0; k < n; ++k)
      for (long v = 0; v < end; v += W) y[v / W * n + k] = some_of(Y[k] + i + v, end - v);
    for (long v = 0; v < end; v += W) interpolate(t, y + v / W * n, sum, in, in + t->largest);
    for (long k = 0; k < n; ++k)
      for (long v = 0; v < end; v += W) to_some(C + k * m + i + v, y[v / W * n + k], end - v);
  }
  const int enough = y != NULL;
  free(y);
  return enough;
}

/* Coefficients C (.., m) -> sums of squares (count, m) over groups. Group g has the rows[first[g]] to rows[first[g + 1] -
   1]. */
void squares(long m, const double *C, long count, const long *first, const long *rows, double *sums);
void squares(long m, const double *C, long count, const long *first, const long *rows, double *sums) {
  for (long begin = 0; begin < m; begin += LONGEST * W) { /* parts of rows that stay in the cache for all groups */
    const long end = m - begin < LONGEST * W ? m : begin + LONGEST * W;
    for (long g = 0; g < count; ++g) {
      double *sum = sums + g * m;
      for (long i = begin; i < end; ++i) sum[i] = 0.0;
      for (long k = first[g]; k < first[g + 1]; ++k) {
        const double *c = C + rows[k] * m;
        for (long i = begin; i < end; i += W) {
          const V a = some_of(c + i, end - i);
          to_some(sum + i, some_of(sum + i, end - i) + a * a, end - i);
        }
      }
    }
  }
}

#endif
