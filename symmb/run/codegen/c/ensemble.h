/* An ensemble of n samples. Each thread takes one block after another, and stores the values of all samples or their
   extremes. */
#ifndef ENSEMBLE_H
#define ENSEMBLE_H

#include <stdlib.h>

#include "begin.h"

/* Maximum number of samples of a block that also need too many steps alone. After these, the other samples fail without another
   run. */
#define MOST_LOST 3

/* Runs the samples that begin() starts. The run is repeated without failed samples, until the other samples reach the end.
   Their extremes extend the extremes in lower and upper, of n numbers. */
static void run_samples(Block *b, Study *s, double *restrict lower, double *restrict upper, long n) {
  int started;
  b->steps = b->iterations = b->most = 0;
  while ((started = begin(b, s)) && !run(b, s)) {}
  __atomic_fetch_add(&s->steps, b->steps, __ATOMIC_RELAXED);
  __atomic_fetch_add(&s->iterations, b->iterations, __ATOMIC_RELAXED);
  /* An atomic maximum, which C does not have. A failed exchange reads the maximum of another thread. */
  for (long most = s->most; b->most > most &&
       !__atomic_compare_exchange_n(&s->most, &most, b->most, 0, __ATOMIC_RELAXED, __ATOMIC_RELAXED);) {}
  for (long i = 0; started && i < n; ++i) {
    lower[i] = b->lower[i] < lower[i] ? b->lower[i] : lower[i];
    upper[i] = b->upper[i] > upper[i] ? b->upper[i] : upper[i];
  }
}

/* A new block. NULL if there is not enough memory. */
static Block *new_block(void) {
#ifdef APART
#define BEHIND(name, n) + (n)
#define SET(name, n) a->name = room, room += n;
  Block *b = aligned_alloc(sizeof(V), sizeof(Block) + PARTS * (0 ARRAYS(BEHIND)) * sizeof(V));
  V *room = (V *)(b + 1);
  if (b) EACH_PART(b) { ARRAYS(SET) }
  return b;
#else
  return aligned_alloc(sizeof(V), sizeof(Block));
#endif
}

/* The next sample that runs alone: of all samples that must run alone, it needs the fewest steps. -1 if there is none. */
static int least_suspicious(const Block *b) {
  int least = -1;
  for (int l = 0; l < WIDTH; ++l)
    if (b->suspicion[l] > 0.0 && (least < 0 || b->suspicion[l] < b->suspicion[least])) least = l;
  return least;
}

/* The work of one thread: it runs blocks until all blocks are taken. It writes values to s->Y, or extremes to lower and upper
   (n_t, N_Y), which also contain the extremes of earlier blocks. Returns 0 if there is not enough memory. */
int work(Study *s, double *restrict lower, double *restrict upper);
int work(Study *s, double *restrict lower, double *restrict upper) {
  const long n = s->Y ? 0 : s->n_t * N_Y;
  Block *b = new_block();
  double *part = malloc((2 * n + 1) * sizeof(double));
  const int enough = b && part;
  while (enough && (b->number = __atomic_fetch_add(&s->next_block, 1, __ATOMIC_RELAXED)) * WIDTH < s->n) {
    b->lower = part;
    b->upper = part + n;
    b->alone = 0;
    memset(b->suspicion, 0, sizeof b->suspicion);
    run_samples(b, s, lower, upper, n);
    /* Another sample of the block may cause too many or too short steps. Therefore samples fail only if they also fail alone. A
       run alone with too many steps is expensive. Therefore samples that need the fewest steps run first. After MOST_LOST runs
       with too many steps, the other samples, which need more steps, fail without a run. */
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
