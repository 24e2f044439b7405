/* An example of the tableau that the generator writes: Heun's method, with Euler's method for the error estimate. */
#ifndef TABLEAU_H
#define TABLEAU_H

#include "block.h"

#define END 2            /* place in k of the slope at the end of the step */
#define SAFETY 0.9       /* fraction of the step that the error allows */
#define EXPONENT 0.5     /* exponent of the error */
#define MEMORY 0.08      /* weight of the error of the previous step */
#define SHRINK_LEAST 0.2 /* smallest factor of a rejected step */
#define CHANGE_LEAST 0.3
#define CHANGE_MOST 5.0  /* bounds of the factor of an accepted step */
#define ERROR_LEAST 1e-4 /* smaller previous errors are replaced by this value */
#define MOST_MISSED 300.0 /* largest error of the interpolant at its last stage, in tolerances */
#define LAST_STAGE 1.0   /* fraction of the step of the last stage */
#define ROUNDED_STEP 1e-6 /* step over time. In shorter steps, rounding of the end changes the length */

/* Slopes before the end of the step, and x_new. */
PRIVATE void stages(Block *b) {
  EACH_PART(b) {
    for (int i = 0; i < N_X; ++i) a->x_at[i] = a->x[i] + b->h * a->k[i];
    rates(a->x_at, a->c, each(b->t + b->h), a->k + N_OWN);
    for (int i = 0; i < N_X; ++i) a->x_new[i] = a->x[i] + 0.5 * b->h * (a->k[i] + a->k[N_OWN + i]);
  }
}

/* Estimated errors of two orders, divided by the length of the step. */
PRIVATE void errors(const Part *a, double h, V *e5, V *e3) {
  (void)h;
  for (int i = 0; i < N_X; ++i) e5[i] = e3[i] = 0.5 * (a->k[N_OWN + i] - a->k[i]);
}

/* Coefficients F of the interpolant of the states that outputs need. x_at is the state of its last stage. */
PRIVATE void interpolant(Block *b) {
  EACH_PART(b)
    for (int u = 0; u < N_USED; ++u) {
      V *f = a->F + 7 * u;
      const V d = a->x_new[used[u]] - a->x[used[u]], first = a->k[used[u]], last = a->k[END * N_OWN + used[u]];
      f[0] = d;
      f[1] = b->h * first - d;
      f[2] = 2.0 * d - b->h * (first + last);
      for (int j = 3; j < 7; ++j) f[j] = zero();
      a->x_at[used[u]] = a->x_new[used[u]];
    }
}

#endif
