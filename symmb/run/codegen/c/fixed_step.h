/* Fixed steps of an explicit Runge-Kutta method. Every interval between two output times is divided into equal steps.

   The generated tableau defines stages(b), which computes x_new. */
#ifndef FIXED_STEP_H
#define FIXED_STEP_H

#include "projection.h"
#include "tableau.h"

/* Runs the block from the first time to the last. Returns 0 if samples failed. */
PRIVATE int run(Block *b, Study *s) {
  for (; b->next < s->n_t; ++b->next) {
    const double begin = s->times[b->next - 1], span = s->times[b->next] - begin;
    const long count = (long)fmax(ceil(span / s->longest - 1e-9), 1.0);
    b->h = span / count;
    for (long i = 0; i < count; ++i) {
      b->t = begin + i * b->h;
      EACH_PART(b) rates(a->x, a->c, each(b->t), a->k);
      stages(b);
      EACH_PART(b) memcpy(a->x, a->x_new, N_X * sizeof(V));
    }
    b->t = s->times[b->next];
    observe(b);
    if (!store_outputs(b, s, b->next, 1)) return 0;
  }
  return 1;
}

#endif
