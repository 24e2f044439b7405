/* The start of a block: its samples at the first time, with their parameters, states and first outputs.

   The file of steps before this file defines run(): embedded_pair.h, fixed_step.h or implicit_step.h. */
#ifndef BEGIN_H
#define BEGIN_H

#include "embedded_pair.h"

#define START_CONVERGED 1e-9 /* step over the size of the unknowns. Convergence is quadratic, so the error is rounding */
#define START_ITERATIONS 30
#define START_SIZE 1e-3 /* smallest size of the unknowns */

/* The state at the first time, by Newton's method from u = 0. In each lane, the method ends when the step of this lane is
   small. The state is NaN in lanes without convergence. */
static void assemble(Part *a, V t) {
  V *u = a->scratch, *du = a->scratch + SIZE(N_U);
  memset(u, 0, SIZE(N_U) * sizeof(V));
  M active = (M)zero() == 0;
  for (int n = 0; n < START_ITERATIONS && N_U > 0 && !none(active); ++n) {
    V step = zero(), size = each(START_SIZE);
    newton(u, a->c, t, du);
    for (int i = 0; i < N_U; ++i) {
      u[i] -= blend(active, du[i], zero());
      step = v_larger(v_fabs(du[i]), step);
      size = v_larger(v_fabs(u[i]), size);
    }
    active &= (M)(step > START_CONVERGED * size);
  }
  start(u, a->c, t, a->x);
  for (int i = 0; N_U > 0 && i < N_X; ++i) a->x[i] = blend(active, each(NAN), a->x[i]);
}

/* The states at the first time of the samples of a block that did not fail. Lanes without a sample repeat other samples, so
   that they do not change the common step. Returns 0 if a state is not finite; its sample then fails. */
static int place_samples(Block *b, Study *s) {
  int finite = 1;
  EACH_PART(b) {
    V sum = zero();
    for (int l = 0; l < W; ++l) {
      const long i = b->sample[((a - b->part) * W + l) % b->live];
      for (int j = 0; j < N_P - N_S; ++j) a->p[j][l] = s->p[i * (N_P - N_S) + j];
      for (int j = N_P - N_S; j < N_P; ++j) a->p[j][l] = 1.0;
      for (int j = 0; j < N_X && !STARTED; ++j) a->x[place[j]][l] = s->x0[i * N_X + j];
    }
    for (int j = 0; j < N_NUMBERS; ++j) a->c[number_place[j]] = each(s->numbers[j]);
    prepare(a->p, a->c);
    if (STARTED) assemble(a, each(b->t));
    for (int j = 0; j < N_X; ++j) sum += a->x[j] * 0.0;
    for (int l = 0; l < W; ++l)
      if (sum[l] != 0.0) {
        fail_sample(b, s, (a - b->part) * W + l, b->t, STEPS);
        finite = 0;
      }
  }
  return finite;
}

/* Starts the samples of a block that did not fail, or the sample that runs alone. Returns 0 if there are none. A block that
   lost samples starts again without them, see block.h. Its values and passes are deleted, and its samples move to the free
   lanes. */
PRIVATE int begin(Block *b, Study *s) {
  b->t = s->times[0];
  b->next = 1;
  for (;;) {
    b->live = 0;
    for (long i = b->number * WIDTH; i < b->number * WIDTH + WIDTH && i < s->n; ++i)
      if (s->t_failed[i] != s->t_failed[i] && (!b->alone || b->alone == i + 1)) b->sample[b->live++] = i;
    if (!b->live) return 0;
    EACH_PART(b) a->load = zero();
    for (long l = 0; l < b->live && s->Y && !s->is_reduced; ++l)
      for (long i = 0; i < s->n_t * N_Y; ++i) s->Y[b->sample[l] * s->n_t * N_Y + i] = NAN;
    for (long l = 0; l < b->live && s->passes; ++l)
      for (long j = 0; j < s->most_passes; ++j) s->passes[b->sample[l] * s->most_passes + j] = NAN;
    memset(b->stop, 0, sizeof b->stop);
    b->stop_time = b->to = b->soon = INFINITY;
    b->from = -INFINITY;
    if (!place_samples(b, s)) continue;
    observe(b);
    if (begin_contacts(b, s) && store_outputs(b, s, 0, 1)) return 1;
  }
}

#endif
