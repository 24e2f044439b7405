/* A block of WIDTH samples that have the same steps: its data, and the results that it stores.

   Vector instructions are useful only if all lanes do the same. Therefore the lane with the largest error determines the step.
   Before a sample fails, it shortens the steps of the other samples. Therefore its block runs again from the first time without
   this sample, so that the results of the other samples do not depend on it. If a block takes too many steps, the samples that
   made the steps short fail at first. They run alone later, see ensemble.h.

   The model before this file, such as model.h, defines the sizes and functions. */
#ifndef BLOCK_H
#define BLOCK_H

#include "lanes.h"
#include "model.h"

#define CHUNK (N_X > 512 ? 1 : N_X > 64 ? 4 : 16) /* output times at once; the states at these times fit into a cache */
#define SIZE(n) ((n) > 0 ? (n) : 1)
#define N_INTEGRALS (N_X - N_OWN) /* the first states, which are integrals of the next states; see the generator of stages */

/* A study of n samples at n_t times. p (n, N_P) and, unless STARTED, x0 (n, N_X) have a row for each sample. */
typedef struct {
  const double *x0, *p, *times;
  long n, n_t;
  double rtol, growth; /* for step control; absolute tolerance over the largest value of a state */
  double ahead, least; /* time [s] over which slopes predict the sizes of the states; first tolerances over atol */
  const double *atol;  /* (N_X,) absolute tolerances by the sizes of the states */
  double longest;    /* step, or 0 */
  double newton;     /* Newton's method ends at smaller changes of unknowns over their sizes */
  long most_steps;
  long next_block;  /* number of the block that the next free thread takes */
  double *t_failed; /* (n,) time at which a sample failed [s], NaN while it has not */
  char *failure;    /* (n,) reason of the failure */
  double *x_failed; /* (n, N_X) the state at the start of its last step */
  double *Y;        /* (n, n_t, N_Y) values, or NULL */
  const double *stops; /* (n, n_stops) switches of time in order [s], infinite after the last one, or NULL */
  long n_stops;
  double *passes; /* (n, most_passes) times at which switches of the state are passed [s], NaN after the last, or NULL */
  long most_passes;
  double *reach; /* (n, 2, N_S) smallest and largest value of each switch of the state in a run, see switches.h, or NULL */
  long steps, iterations, most; /* of all blocks; iterations of Newton's method, and their maximum in a step */
  double *events;               /* (most_events, EVENT) recorded by impacts.h; there may be more events */
  long n_events, most_events;
  const double *numbers; /* (N_NUMBERS,) numbers in the equations */
  long is_reduced; /* whether nobody reads the values of failed samples, see kernel.h */
} Study;

/* Arrays of a part whose sizes are those of the model. An engine that is compiled apart from the model knows these sizes only in
   its runs, and has the arrays behind the block; see ensemble.h. */
#define ARRAYS(ARRAY) \
  ARRAY(x, SIZE(N_X)) \
  ARRAY(x_new, SIZE(N_X)) \
  ARRAY(k, SIZE(N_K)) \
  ARRAY(x_at, CHUNK * SIZE(N_X))                    /* states at some times */ \
  ARRAY(atol, SIZE(N_X))                            /* from the largest value of each state so far */ \
  ARRAY(F, 7 * SIZE(N_USED)) \
  ARRAY(box, N_S > 0 ? 4 * N_BOX + 3 : 1)           /* of a part of a step, and four lists of states; see switches.h */ \
  ARRAY(x_low, SIZE(N_RANGED)) \
  ARRAY(dx_low, SIZE(N_RANGED)) \
  ARRAY(x_end, SIZE(N_RANGED)) \
  ARRAY(dx_end, SIZE(N_RANGED)) \
  ARRAY(c, SIZE(N_C + N_OTHER + N_CARRIED))   /* values and numbers of the model, numbers of the engine, space for functions */ \
  ARRAY(y, CHUNK * SIZE(N_Y))                       /* outputs at some times */ \
  ARRAY(p, SIZE(N_P))                               /* parameters */ \
  ARRAY(scratch, 2 * (N_X > N_U ? SIZE(N_X) : N_U)) /* errors of a step, or unknowns at the start */
#ifdef APART
#define MEMBER(name, n) V *name;
#else
#define MEMBER(name, n) V name[n];
#endif

/* The data of W lanes of a block. */
typedef struct {
  V load; /* sum of the errors of all steps of the run, each at most 1 */
  ARRAYS(MEMBER)
#if N_S > 0
  V u[N_S], du[N_S], u_new[N_S], u_low[N_S], u_at[N_S]; /* switches times their sides, and their rates, see switches.h */
  V raised[N_S], when, which, reach[2 * N_S];
#endif
} Part;

/* A block at the time t, in a step of length h. */
typedef struct {
  Part part[PARTS];
  double t, t_new, h, h_next;
  double before; /* logarithm of the error of the previous step */
  double soon;   /* longest step from t on, because a contact may close soon after t */
  long number, next, live, sample[WIDTH];
  long alone;                 /* 1 + the number of the sample that runs alone, or 0 */
  double suspicion[WIDTH];    /* of samples that may have failed because of other samples: largest for samples that
                                 need most steps, 0 without suspicion */
  long stop[WIDTH];           /* the next switch of time of each sample, and the first of them */
  double stop_time, from, to; /* rates are evaluated between these times */
  long steps, iterations, most;
  int under_way, meets, contact; /* whether a step is not finished, and has events at its end; see impacts.h */
  double pass;                   /* the fraction of the step at which a switch is passed; 2 without a pass */
  int shortened, missed, grazes; /* whether the step was shortened, so that it ends just after a switch; the number of
                                    shortened steps just before it that did not reach the switch; and whether switches fall
                                    below 0 until the end of the step, but all by less than the hysteresis */
  int starting;                  /* whether all steps since the start were shortened or passed a switch */
  double wanted, first;          /* of implicit steps: the next length, and the first length of a run or after a stop */
  int fresh;                     /* of implicit steps: whether the history starts with the next step */
  double *lower, *upper; /* extremes of the block, (n_t, N_Y) */
#if N_G > 0
  V gap[SIZE(3 * N_I)], force[SIZE(4 * N_I)], law[SIZE(2 * N_I * (N_V + 1))]; /* values of the functions of contacts, see
                                                                              impacts.h */
  V margin[SIZE(2 * N_E)], closing[SIZE(N_PLACE)], jumped[N_V + N_ROWS + 1];  /* and of joints */
  double crowd_start;     /* start of a sequence of events without pause [s] */
  long n_events, n_crowd; /* events of the run, and since crowd_start */
#endif
} Block;

#define EACH_PART(b) for (Part *a = (b)->part; a < (b)->part + PARTS; ++a)

/* The slope of state i, from x and the stored slopes k. The slope of a position is a velocity, which x already contains. */
PRIVATE inline V slope(const V *x, const V *k, int i) { return i < N_INTEGRALS ? x[N_INTEGRALS + i] : k[i - N_INTEGRALS]; }

/* The time t of a stage, moved between the switches of time before and after the step. A stage at the end of a step is at a
   switch, or after it because of rounding. After the switch, the rates would have the other branch, and the step would contain
   a jump. */
PRIVATE double between_stops(const Block *b, double t) { return t < b->from ? b->from : t > b->to ? b->to : t; }

#define SHORTEST 1e-14 /* fraction of the time, about 45 rounding errors: shorter steps are lost in rounding */

/* The shortest step at the time t of a block. It does not follow from the time span, because fast motions at the start may take
   a fraction of 1e-14 of the span. At time 0, steps have a limit all the same, so that samples fail if no step succeeds. */
PRIVATE double shortest_step(const Block *b, const Study *s) {
  return SHORTEST * fmax(fabs(b->t), SHORTEST * (s->times[s->n_t - 1] - s->times[0]));
}

/* Marks the sample of a lane as failed. */
PRIVATE void fail_sample(const Block *b, Study *s, long lane, double t, char why) {
  /* Lanes from `live` on repeat samples. They fail together with the repeated samples, because they have the same sample
     numbers. */
  const long i = b->sample[lane % b->live];
  s->t_failed[i] = t;
  s->failure[i] = why;
  for (int j = 0; j < N_X; ++j) s->x_failed[i * N_X + j] = b->part[lane / W].x[place[j]][lane % W];
}

/* Records that a failed sample runs alone later, if other samples are in its block. */
PRIVATE void suspect(Block *b, long lane, double suspicion) {
  b->suspicion[b->sample[lane] % WIDTH] = b->live > 1 ? suspicion : 0.0;
}

/* Fraction of the largest load of a run. Lanes with a smaller load do not cause the short steps. Errors of order 8 have this
   ratio if one lane needs 1.8 times the steps of another lane. */
#define SMALL_LOAD 1e-2

/* The samples with errors that made the steps short fail, because there are too many steps. Returns 0. */
PRIVATE int fail_by_steps(Block *b, Study *s) {
  double most = 0.0;
  for (long l = 0; l < b->live; ++l) most = fmax(most, b->part[l / W].load[l % W]);
  for (long l = 0; l < b->live; ++l) {
    const double load = b->part[l / W].load[l % W];
    if (load < SMALL_LOAD * most) continue;
    fail_sample(b, s, l, b->t, MANY);
    /* Samples that fail in earlier runs, with more samples in the block, need more steps than samples that fail later. */
    suspect(b, l, b->live + load / b->steps);
  }
  return 0;
}

/* Records that the sample of a lane passes a switch at time t. */
PRIVATE void note_pass(const Block *b, const Study *s, long lane, double t) {
  double *own = s->passes + b->sample[lane] * s->most_passes;
  for (long j = 0; j < s->most_passes; ++j)
    if (own[j] != own[j]) {
      own[j] = t;
      return;
    }
}

/* The largest of numbers that are not negative, over all lanes; NaN if one of them is NaN. */
PRIVATE double largest_lane(V a) {
  /* Comparisons with NaN are false, so a NaN in m stays. Without the NaN, a step would be accepted although a lane has left the
     domain of a function. */
  double m = 0.0;
  for (int l = 0; l < W; ++l) m = a[l] > m || a[l] != a[l] ? a[l] : m;
  return m;
}

/* Smallest and largest lanes of each of n vectors in every part. */
PRIVATE void extremes(const Block *b, long n, double *lower, double *upper) {
  long i = 0;
#ifdef TREE
  /* Lane by lane, W vectors need W (W - 1) comparisons. A tree of shuffles needs only W - 1 vector minima. The last W vectors
     overlap the vectors before them. This has no effect, because the same extremes are computed again. */
  for (; n >= W && i < n; i += W) {
    if (i > n - W) i = n - W;
    const V *least = b->part->y + i, *most = least;
#if PARTS > 1
    V smallest[W], largest[W];
    for (int k = 0; k < W; ++k) {
      smallest[k] = largest[k] = least[k];
      for (int q = 1; q < PARTS; ++q) {
        smallest[k] = v_smaller(smallest[k], b->part[q].y[i + k]);
        largest[k] = v_larger(largest[k], b->part[q].y[i + k]);
      }
    }
    least = smallest;
    most = largest;
#endif
    const V low = tree_smaller(least), high = tree_larger(most);
    memcpy(lower + i, &low, sizeof low);
    memcpy(upper + i, &high, sizeof high);
  }
#endif
  for (; i < n; ++i) {
    lower[i] = upper[i] = b->part[0].y[i][0];
    for (int l = 1; l < WIDTH; ++l) {
      const double y = b->part[l / W].y[i][l % W];
      lower[i] = y < lower[i] ? y : lower[i];
      upper[i] = y > upper[i] ? y : upper[i];
    }
  }
}

/* Stores the outputs at n times from number `first` on. Returns 0 if a lane is not finite; its sample then fails. */
PRIVATE int store_outputs(Block *b, Study *s, long first, long n) {
  /* A number times 0 is NaN if the number is not finite, otherwise 0. So one sum tests all outputs without a branch. The sample
     is searched only if the test fails. There are two sums, because each addition waits for the previous addition. */
  V even = zero(), odd = zero();
  EACH_PART(b) {
    long i = n * N_Y % 2;
    if (i) even += a->y[0] * 0.0;
    for (; i < n * N_Y; i += 2) {
      even += a->y[i] * 0.0;
      odd += a->y[i + 1] * 0.0;
    }
  }
  const int finite = largest_lane(even + odd) == 0.0;
  for (long l = 0; l < b->live && !finite; ++l)
    for (long i = 0; i < n * N_Y; ++i)
      if (b->part[l / W].y[i][l % W] * 0.0 != 0.0) {
        fail_sample(b, s, l, s->times[first + i / SIZE(N_Y)], OUTPUT);
        break;
      }
  /* Values are stored even after a failure. A failed sample keeps its values up to that time. The values of other samples are
     overwritten when the block runs again. Extremes of a block are used only after a complete run, see ensemble.h. */
  for (long l = 0; l < b->live && s->Y; ++l) {
    double *to = s->Y + (b->sample[l] * s->n_t + first) * N_Y;
    for (long i = 0; i < n * N_Y; ++i) to[i] = b->part[l / W].y[i][l % W];
  }
  if (!s->Y) extremes(b, n * N_Y, b->lower + first * N_Y, b->upper + first * N_Y);
  return finite;
}

#endif
