/* Steps of an implicit scheme, of fixed length or with step control. Newton's method computes their unknowns.

   x holds the history w (N_W), then the length of the step and the unknowns z (N_Z). The history begins with the state. The
   model gives history(x, c, t, w), which makes w from the state at t. With t at the end of the step it gives guess(x, c, t, z);
   correct(x, c, t, d), Newton's change of z, then N_TESTED parts of it over their sizes, which decide convergence; and
   follow(x, c, t, w), the new history, then estimated errors (N_E) of the state, if there are any. ORDER is the order of
   the scheme. GROWTH is the largest ratio of a step to the step before.

   Hairer and Wanner (1996), Solving Ordinary Differential Equations II, section IV.8: Newton's method and step control. */
#ifndef IMPLICIT_STEP_H
#define IMPLICIT_STEP_H

#include "switches.h"

enum { MOST_ITERATIONS = 12 };
#define STALLED 1e-6 /* a change of this size, over the sizes of the unknowns, that no longer falls is rounding */

/* Newton's method for the step from t to t_new. Marks the lanes that do not converge, and returns 0 if there are any. */
PRIVATE int solve(Block *b, const Study *s, M *unsolved) {
  int solved = 1, most = 0;
  EACH_PART(b) {
    V *z = a->x + N_W + 1, before = each(INFINITY);
    M active = (M)zero() == 0;
    guess(a->x, a->c, each(b->t_new), z);
    int n = 0;
    for (; N_Z > 0 && n < MOST_ITERATIONS && !none(active); ++n) {
      /* NaN must stay in `change`: a lane that has left the domain of a function never converges, and is reported. */
      V change = zero();
      correct(a->x, a->c, each(b->t_new), a->k);
      for (int i = 0; i < N_TESTED; ++i) {
        const V d = v_fabs(a->k[N_Z + i]);
        change = choose((d > change) | (d != d), d, change);
      }
      /* Lanes that have converged stay as they are: the result of a sample must not depend on how long its neighbours take. */
      for (int i = 0; i < N_Z; ++i) z[i] -= blend(active, a->k[i], zero());
      /* Convergence is quadratic. A small change that is more than a quarter of the one before is therefore rounding of the
         residual, as in ill-conditioned systems, and further iterations would not reach a smaller limit. */
      active &= ~((M)(change <= s->newton) | ((M)(change <= STALLED) & (M)(change > 0.25 * before)));
      before = change;
    }
    b->iterations += n;
    most = n > most ? n : most;
    unsolved[a - b->part] = N_Z > 0 ? active : (M)zero();
    a->load += truth(unsolved[a - b->part]);
    solved &= none(unsolved[a - b->part]);
  }
  if (solved && most > b->most) b->most = most;
  return solved;
}

/* The largest error of all lanes over the tolerances; marks the lanes whose error is too large. */
PRIVATE double largest_error(Block *b, const Study *s, M *large) {
  /* Comparisons are written so that NaN counts as an error that is too large, here and in run_until. */
  double e = 0.0;
  EACH_PART(b) {
    V sum = zero();
    for (int i = 0; i < N_E; ++i) {
      const V r = a->k[N_W + i] / (s->atol[i] + s->rtol * v_larger(v_fabs(a->x[i]), v_fabs(a->k[i])));
      sum += r * r;
    }
    sum = v_sqrt(sum / (double)SIZE(N_E));
    large[a - b->part] = ~(M)(sum <= 1.0);
    a->load += v_smaller(sum, each(1.0)); /* 1 for NaN */
    const double here = largest_lane(sum);
    e = here > e || here != here ? here : e;
  }
  return e;
}

/* The samples of the marked lanes fail, because no shorter step is left. Returns 0. */
PRIVATE int fail_samples(Block *b, Study *s, const M *marked, char why) {
  /* In steps that neighbours make very short, residuals and estimated errors are rounding, and good samples fail too. */
  for (int l = 0; l < b->live; ++l)
    if (marked[l / W][l % W]) {
      fail_sample(b, s, l, b->t, why);
      suspect(b, l, 1.0);
    }
  return 0;
}

/* Begins the run at the first time. Returns 0 if samples failed. */
PRIVATE int begin_run(Block *b, Study *s) {
  const double span = s->times[s->n_t - 1] - s->times[0], longest = s->longest > 0.0 ? s->longest : span;
  /* The first step of an explicit method follows from slopes, which the functions of an implicit scheme do not give. A
     ten-thousandth of the horizon is tried instead: it is halved if Newton's method fails, and grows by GROWTH if errors are
     small. */
  b->first = b->wanted = s->rtol > 0.0 && longest > 1e-4 * span ? 1e-4 * span : longest;
  b->fresh = 1;
  b->steps = b->iterations = b->most = 0;
  /* The scheme evaluates at its own times, not through between_stops: a run that starts at a switch starts just behind it. */
  if (find_stop(b, s)) b->t = b->from;
  return 1;
}

/* Runs the block until it has its first n outputs. Returns 0 if samples failed. */
PRIVATE int run_until(Block *b, Study *s, long n) {
  const double span = s->times[s->n_t - 1] - s->times[0], longest = s->longest > 0.0 ? s->longest : span;
  const double shortest = s->rtol > 0.0 ? 1e-14 * span : 1e-4 * longest;
  M marked[PARTS];
  while (b->next < n) {
    if (!(b->wanted > shortest)) b->wanted = shortest;
    const double goal = b->to < s->times[b->next] ? b->to : s->times[b->next];
    /* Equal steps up to the goal: a last step that takes what the others leave could be as short as rounding. With 1e-9, a step
       that fits but for rounding counts as one. */
    const double left = goal - b->t, parts = ceil(left / b->wanted - 1e-9);
    b->t_new = parts > 1.0 ? b->t + left / parts : goal;
    b->h = parts > 1.0 ? left / parts : left;
    EACH_PART(b) {
      a->x[N_W] = each(b->h);
      if (b->fresh) {
        history(a->x, a->c, each(b->t), a->k);
        memcpy(a->x, a->k, N_W * sizeof(V));
      }
    }
    if (++b->steps > s->most_steps) return fail_by_steps(b, s);
    /* Newton's method fails if its guess is far off. A shorter step has a closer guess. */
    if (!solve(b, s, marked)) {
      if (!(b->h > 1.0000001 * shortest)) return fail_samples(b, s, marked, NEWTON);
      b->wanted = 0.5 * b->h;
      continue;
    }
    EACH_PART(b) follow(a->x, a->c, each(b->t_new), a->k);
    double factor = GROWTH;
    if (s->rtol > 0.0) {
      const double e = largest_error(b, s, marked);
      /* The estimate is of order ORDER + 1 in h, so that this factor brings it to 0.9^(ORDER + 1) tolerances. */
      const double best = e > 1e-12 ? 0.9 * pow(e, -1.0 / (ORDER + 1)) : GROWTH;
      factor = best < GROWTH ? best : GROWTH;
      if (!(e <= 1.0)) {
        if (!(b->h > 1.0000001 * shortest)) return fail_samples(b, s, marked, STEPS);
        b->wanted = b->h * (factor > 0.1 ? factor : 0.1);
        continue;
      }
    }
    /* A step that was short only because an output time was near must not shorten the steps behind it: the wanted length stays,
       but it grows by no more than the scheme allows over the step that was really taken. */
    const double next = factor * b->h < longest ? factor * b->h : longest;
    b->wanted = factor < 1.0 || next > b->wanted ? next : b->wanted < GROWTH * b->h ? b->wanted : GROWTH * b->h;
    b->fresh = 0;
    b->t = b->t_new;
    EACH_PART(b) memcpy(a->x, a->k, N_W * sizeof(V));
    if (b->t < goal) continue;
    const int at_stop = goal == b->to;
    /* The history before a switch belongs to other equations: the scheme begins anew behind it, with a first step. */
    if (at_stop) {
      b->t = b->stop_time;
      find_stop(b, s);
      b->t = b->from;
      b->fresh = 1;
      b->wanted = b->first;
    }
    if (b->t < s->times[b->next]) continue;
    observe(b);
    if (!store_outputs(b, s, b->next++, 1)) return 0;
  }
  return 1;
}

/* State i of a part at time t, up to which the block has its outputs. */
PRIVATE V state_of(const Block *b, const Part *a, int i, double t) { (void)b, (void)t; return a->x[i]; }

/* Goes on from that time with other parameters. Returns 0 if samples failed. */
PRIVATE int go_on_with(Block *b, Study *s, double t) {
  if (!reach_constraints(b, s, t)) return 0;
  b->fresh = 1;
  b->wanted = b->first;
  return 1;
}

/* Runs the block from the first time to the last. Returns 0 if samples failed. */
PRIVATE int run(Block *b, Study *s) { return begin_run(b, s) && run_until(b, s, s->n_t); }

#endif
