/* An example of the model that the generator writes before the other files: a harmonic oscillator.

   x' = v, v' = -omega^2 x, with the parameter omega and the output x. Each file of this folder can be compiled with this model
   alone. The functions receive the values c of a part. The first N_C of them are values that prepare() computes from the
   parameters, and numbers of the equations. N_OTHER numbers of the engine follow, then space for values of the functions. */
#ifndef MODEL_H
#define MODEL_H

#include "lanes.h"

#define N_P 1       /* parameters */
#define N_C 1       /* values that depend on parameters alone, and numbers of the equations */
#define N_OTHER 0   /* numbers of the engine behind them */
#define N_NUMBERS 0 /* numbers of both kinds, which the engine copies to their places in c */
#define N_CARRIED 0 /* values that pieces of a function pass to later pieces */
#define N_Y 1       /* outputs */
#define N_USED 1    /* states that outputs need */
#define PROJECTED 0 /* 1: project() projects states onto the constraints */
#define N_RANGED 0  /* states that the bounds of switches depend on; switches.h */
#define N_S 0       /* switches of the state, whose sides are the last parameters; switches.h */
#define N_G 0       /* contacts, and events of joints, whose gaps and margins are the last switches; impacts.h */
#define N_I 0       /* contacts among them */
#define N_E 0       /* events of joints among them */
#define STARTED 0   /* 1: newton() and start() compute the state at the start from N_U unknowns; otherwise they do nothing */
#define N_U 0
enum { STEPS, OUTPUT, NEWTON, MANY, STICKS, IMMOVABLE, UNENDING, DEPENDENT, ENDLESS, OPEN }; /* why a sample failed, see FailureCode */

MODEL void prepare(const V *p, V *c) { c[0] = p[0] * p[0]; }
MODEL void newton(const V *x, V *c, V t, V *out) { (void)x, (void)c, (void)t, (void)out; }
MODEL void start(const V *x, V *c, V t, V *out) { (void)x, (void)c, (void)t, (void)out; }

#ifndef IMPLICIT_STEP_H

#define N_X 2
#define N_BOX 2     /* states of the model's functions of a box. Runs need not integrate the last one */
#define N_OWN 2     /* the last states, with own slopes; the other states are integrals of these states */
#define N_K (3 * N_OWN)

MODEL void rates(const V *x, V *c, V t, V *out) {
  (void)t;
  out[0] = x[1];
  out[1] = -c[0] * x[0];
}

#else

/* The implicit Euler method. x contains the history (2), the length of the step, and the unknowns, which are the new state
   (2). */
#define N_W 2
#define N_Z 2
#define N_TESTED 2
#define N_ERRORS 0
#define N_X (N_W + 1 + N_Z)
#define N_BOX N_X
#define N_OWN 0
#define N_K 4
#define ORDER 1
#define GROWTH 5.0

MODEL void history(const V *x, V *c, V t, V *out) {
  (void)c, (void)t;
  memcpy(out, x, N_W * sizeof(V));
}
MODEL void guess(const V *x, V *c, V t, V *out) { history(x, c, t, out); }
MODEL void correct(const V *x, V *c, V t, V *out) {
  const V h = x[2], r0 = x[3] - x[0] - h * x[4], r1 = x[4] - x[1] + h * c[0] * x[3], det = 1.0 + h * h * c[0];
  (void)t;
  out[0] = out[2] = (r0 + h * r1) / det;
  out[1] = out[3] = (r1 - h * c[0] * r0) / det;
}
MODEL void follow(const V *x, V *c, V t, V *out) {
  (void)c, (void)t;
  memcpy(out, x + N_W + 1, N_Z * sizeof(V));
}

#endif

MODEL void outputs(const V *x, V *c, V t, V *out) {
  (void)c, (void)t;
  out[0] = x[0];
}

DATA const int place[] = {0, 1, 2, 3, 4}; /* place in x of each state of the model */
DATA const int used[] = {0};              /* the states that outputs need */
DATA const int number_place[] = {0};      /* places in c of the numbers */

#endif
