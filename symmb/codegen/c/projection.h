/* The projection of a state onto the constraints, by the model's project(), for scenes that ask for it. */
#ifndef PROJECTION_H
#define PROJECTION_H

#include "block.h"

/* Writes the state x (N_X) of a part at time t, moved onto the constraints, to out (N_X); x and out do not overlap. */
PRIVATE void move_onto_constraints(Part *a, const V *x, double t, V *out) {
#if PROJECTED
  project(x, a->c, each(t), out);
#else
  (void)t, (void)a;
  memcpy(out, x, N_X * sizeof(V));
#endif
}

/* Moves the block onto the constraints and computes its outputs there. */
PRIVATE void observe(Block *b) {
  EACH_PART(b) {
#if PROJECTED
    move_onto_constraints(a, a->x, b->t, a->x_new);
    memcpy(a->x, a->x_new, sizeof a->x);
#endif
    outputs(a->x, a->c, each(b->t), a->y);
  }
}

#endif
