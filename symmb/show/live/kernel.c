/* Bounds of outputs from runs at nodes. ranges.c has the bounds of polynomials in a file of its own, because their vectors have
   another width. */
#include <stdlib.h>
#include <string.h>

#define EXPORT(name) __attribute__((export_name(#name))) name

int find_ranges(const void *basis, const int *given, long n, long m, const double *C, double *found, double *points);

/* The nodes and the polynomials of a number of parameters and a level of refinement. */
typedef struct {
  long d, n;           /* parameters and nodes */
  const int *degrees;  /* (n, d) of the polynomials. They are also the numbers of the nodes of each parameter */
  const Tensors *fit;  /* to Chebyshev coefficients */
  const void *const *basis;
  const int *given;    /* (n) numbers of the coefficients in the basis */
} Level;

#include "levels.h"

static double *arena;
static long arena_size;

/* Memory for n numbers. It replaces the memory of the call before. NULL if there is not enough. */
double *EXPORT(room)(long n) {
  if (n <= arena_size) return arena;
  free(arena);
  arena = aligned_alloc(64, (n * sizeof *arena + 63) / 64 * 64);
  arena_size = arena ? n : 0;
  return arena;
}

/* Coordinate k of node i of a level. */
double EXPORT(node)(long level, long i, long k) {
  const Level *l = levels + level;
  return line[l->degrees[i * l->d + k]];
}

/* Coefficients C (n, m) from values Y at the nodes, which are `stride` numbers apart. */
static int coefficients(const Level *l, long stride, long m, const double *Y, double *C) {
  long next = 0;
  const double **rows = malloc(l->n * sizeof *rows);
  for (long k = 0; rows && k < l->n; ++k) rows[k] = Y + k * stride;
  const int done = rows && fit(l->fit, &next, m, rows, C);
  free(rows);
  return done;
}

/* Bounds (2, m) of m responses from values Y at the nodes, which are `stride` numbers apart, and their points (2, m, d). Returns
   0 if there is not enough memory. */
int EXPORT(bounds)(long level, long stride, long m, const double *Y, double *found, double *points) {
  const Level *l = levels + level;
  double *C = malloc(l->n * m * sizeof *C);
  const int done = C && coefficients(l, stride, m, Y, C) && find_ranges(*l->basis, l->given, l->n, m, C, found, points);
  free(C);
  return done;
}

/* Values (n, m) of the polynomials of m responses at the nodes times a factor. */
int EXPORT(scaled)(long level, long stride, long m, const double *Y, double factor, double *values) {
  enum { HIGHEST = 16 };
  const Level *l = levels + level;
  double *C = malloc(l->n * m * sizeof *C), *f = malloc(l->d * (HIGHEST + 1) * sizeof *f);
  const int done = C && f && coefficients(l, stride, m, Y, C);
  for (long i = 0; done && i < l->n; ++i) {
    for (long k = 0; k < l->d; ++k) {
      double *T = f + k * (HIGHEST + 1);
      const double x = factor * node(level, i, k);
      T[0] = 1.0, T[1] = x;
      for (long j = 1; j < HIGHEST; ++j) T[j + 1] = 2.0 * x * T[j] - T[j - 1];
    }
    double *to = values + i * m;
    memset(to, 0, m * sizeof *to);
    for (long b = 0; b < l->n; ++b) {
      double product = 1.0;
      for (long k = 0; k < l->d; ++k) product *= f[k * (HIGHEST + 1) + l->degrees[b * l->d + k]];
      for (long r = 0; r < m; ++r) to[r] += product * C[b * m + r];
    }
  }
  free(C);
  free(f);
  return done;
}
