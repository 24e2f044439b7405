/* Bounds (2, m) and points (2, m, d) of polynomials with Chebyshev coefficients C (n, m), by branch and bound. `given` has the
   number of each coefficient in the basis. Returns 0 if there is not enough memory. */
#include <stdlib.h>

int find_ranges(const void *basis, const int *given, long n, long m, const double *C, double *found, double *points);
int find_ranges(const void *basis, const int *given, long n, long m, const double *C, double *found, double *points) {
  const Basis *b = basis;
  const long depth = 64 * b->d, one = b->order + 1; /* after 64 halvings, the size of a box is only rounding */
  const long sizes[] = {depth * (b->padded + 2 * b->d + 2), b->padded, b->d * one, b->d, b->d, b->n_sums, 4 * b->d,
                        2 * one, b->padded, m * b->padded, 2 * m};
  enum { PARTS = sizeof sizes / sizeof *sizes };
  double *part[PARTS], *memory, *next_part;
  long size = 0, next = 0;
  for (int k = 0; k < PARTS; ++k) size += sizes[k];
  if (!(memory = next_part = calloc(size, sizeof *memory))) return 0;
  for (int k = 0; k < PARTS; ++k) part[k] = next_part, next_part += sizes[k];
  const Search search = {.basis = b, .tolerance = TOLERANCE, .budget = BUDGET, .depth = depth, .proves = 1, .stack = part[0], .values = part[1], .powers = part[2], .x = part[3],
                         .z = part[4], .slope = part[5], .local = part[6], .terms = part[7], .changed = part[8],
                         .next = &next};
  double *own = part[9], *gaps = part[10];
  for (long k = 0; k < n; ++k)
    for (long i = 0; i < m; ++i) own[i * b->padded + given[k]] = C[k * m + i];
  ranges(&search, m, own, NULL, n, found, points, gaps);
  free(memory);
  return 1;
}
