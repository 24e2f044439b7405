/* The projection of a state onto the constraints by the function project() of the model, if the model has this function. */
#ifndef PROJECTION_H
#define PROJECTION_H

#include "block.h"

/* Writes the state x (N_X) of a part at time t, projected onto the constraints, to out (N_X). x and out do not overlap. */
PRIVATE void move_onto_constraints(Part *a, const V *x, double t, V *out) {
#if PROJECTED
  project(x, a->c, each(t), out);
#else
  (void)t, (void)a;
  memcpy(out, x, N_X * sizeof(V));
#endif
}

#define REACHED 1e-9 /* change over the largest state. Convergence is quadratic, so the error is rounding */
enum { PROJECTIONS_AT_MOST = PROJECTED ? 20 : 0 };

/* Projects the block onto the constraints at time t after a change of parameters, which may be large. Returns 0 if a sample
   fails. */
PRIVATE int reach_constraints(Block *b, Study *s, double t) {
  int reached = 1;
  EACH_PART(b) {
    M active = (M)zero() == (PROJECTED ? 0 : 1);
    for (int n = 0; n < PROJECTIONS_AT_MOST && !none(active); ++n) {
      V change = zero(), size = zero();
      move_onto_constraints(a, a->x, t, a->x_new);
      for (int i = 0; i < N_X; ++i) {
        change = v_larger(v_fabs(a->x_new[i] - a->x[i]), change);
        size = v_larger(v_fabs(a->x_new[i]), size);
      }
      memcpy(a->x, a->x_new, N_X * sizeof(V));
      active = ~(M)(change <= REACHED * size);
    }
    for (int l = 0; l < W; ++l)
      if (active[l]) {
        fail_sample(b, s, (a - b->part) * W + l, t, OPEN);
        reached = 0;
      }
  }
  return reached;
}

/* Projects the block onto the constraints, and computes its outputs there. */
PRIVATE void observe(Block *b) {
  EACH_PART(b) {
#if PROJECTED
    move_onto_constraints(a, a->x, b->t, a->x_new);
    memcpy(a->x, a->x_new, N_X * sizeof(V));
#endif
    outputs(a->x, a->c, each(b->t), a->y);
  }
}

#endif
