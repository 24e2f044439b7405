/* An ensemble of n samples: threads take one block after another and store the values of all samples, or running extremes. */
#ifndef ENSEMBLE_H
#define ENSEMBLE_H

#include "begin.h"

/* The work of one thread: it runs blocks until none is left. Values go to s->Y, or extremes to lower and upper (n_t, N_Y),
   which also contain those of earlier blocks. Returns 0 if there is not enough memory. */
int work(Study *s, double *restrict lower, double *restrict upper);
int work(Study *s, double *restrict lower, double *restrict upper) {
  const long n = s->Y ? 0 : s->n_t * N_Y;
  Block *b = aligned_alloc(sizeof(V), sizeof(Block));
  double *part = malloc((2 * n + 1) * sizeof(double));
  const int enough = b && part;
  while (enough && (b->number = __atomic_fetch_add(&s->next_block, 1, __ATOMIC_RELAXED)) * WIDTH < s->n) {
    b->lower = part;
    b->upper = part + n;
    int started;
    b->steps = b->iterations = b->most = 0;
    while ((started = begin(b, s)) && !run(b, s)) {} /* again without samples that failed, until the others reach the end */
    __atomic_fetch_add(&s->steps, b->steps, __ATOMIC_RELAXED);
    __atomic_fetch_add(&s->iterations, b->iterations, __ATOMIC_RELAXED);
    /* An atomic maximum, which C does not have: a failed exchange reads the maximum of another thread. */
    for (long most = s->most; b->most > most &&
         !__atomic_compare_exchange_n(&s->most, &most, b->most, 0, __ATOMIC_RELAXED, __ATOMIC_RELAXED);) {}
    for (long i = 0; started && i < n; ++i) {
      lower[i] = b->lower[i] < lower[i] ? b->lower[i] : lower[i];
      upper[i] = b->upper[i] > upper[i] ? b->upper[i] : upper[i];
    }
  }
  free(b);
  free(part);
  return enough;
}

extern const int width;
const int width = WIDTH;

#endif
