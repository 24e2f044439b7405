/* An ensemble of n samples: threads take one block after another and store the values of all samples, or running extremes. */
#ifndef ENSEMBLE_H
#define ENSEMBLE_H

#include "begin.h"

/* Samples of a block that run out of steps alone too, before the others are taken to do so as well. */
#define MOST_LOST 3

/* Runs the samples that begin() starts, again without those that fail, until the others reach the end. Their extremes extend
   those in lower and upper, of n numbers. */
static void run_samples(Block *b, Study *s, double *restrict lower, double *restrict upper, long n) {
  int started;
  b->steps = b->iterations = b->most = 0;
  while ((started = begin(b, s)) && !run(b, s)) {}
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

/* The sample that runs alone next: of those that need to, the one that needs the fewest steps. -1 if none is left. */
static int least_suspicious(const Block *b) {
  int least = -1;
  for (int l = 0; l < WIDTH; ++l)
    if (b->suspicion[l] > 0.0 && (least < 0 || b->suspicion[l] < b->suspicion[least])) least = l;
  return least;
}

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
    b->alone = 0;
    memset(b->suspicion, 0, sizeof b->suspicion);
    run_samples(b, s, lower, upper, n);
    /* Steps that run out or become too short may be the fault of a neighbour, so that samples fail only if they fail alone too.
       A run alone that runs out of steps is expensive. Therefore samples that need the fewest steps run first, and behind
       MOST_LOST such runs, the other samples, which need more steps, are taken to fail alone too. */
    for (int lost = 0, l; lost < MOST_LOST && (l = least_suspicious(b)) >= 0;) {
      const long i = b->number * WIDTH + l;
      b->suspicion[l] = 0.0;
      b->alone = i + 1;
      s->t_failed[i] = NAN;
      s->failure[i] = 0;
      run_samples(b, s, lower, upper, n);
      lost += s->t_failed[i] == s->t_failed[i] && s->failure[i] == MANY;
    }
  }
  free(b);
  free(part);
  return enough;
}

extern const int width;
const int width = WIDTH;

#endif
