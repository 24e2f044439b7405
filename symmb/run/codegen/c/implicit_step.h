/* Steps of an implicit scheme, of fixed length or with step control. Newton's method computes their unknowns.

   x contains the history w (N_W), the length of the step, and the unknowns z (N_Z). The history begins with the state. The
   model defines history(x, c, t, w), which computes w from the state at t. For t at the end of the step, it defines three more
   functions. guess(x, c, t, z) computes a first guess. correct(x, c, t, d) computes Newton's change of z, then N_TESTED parts
   of the change over their sizes, which decide convergence. follow(x, c, t, w) computes the new history, then estimated errors
   (N_ERRORS) of the state, if there are any. ORDER is the order of the scheme. GROWTH is the largest ratio of a step to the previous
   step.

   Hairer and Wanner (1996), Solving Ordinary Differential Equations II, section IV.8: Newton's method and step control. */
#ifndef IMPLICIT_STEP_H
#define IMPLICIT_STEP_H

#include "switches.h"

enum { MOST_ITERATIONS = 12 };
#define STALLED 1e-6 /* smaller changes of unknowns over their sizes are rounding if they no longer decrease */

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
      /* Lanes that have converged are not changed, because the result of a sample must not depend on the other samples. */
      for (int i = 0; i < N_Z; ++i) z[i] -= blend(active, a->k[i], zero());
      /* Convergence is quadratic. So a small change that is more than a quarter of the previous change is rounding of the
         residual, as in ill-conditioned systems. Further iterations would not make it smaller. */
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

/* The largest error of all lanes, divided by the tolerances. Marks the lanes with an error that is too large. */
PRIVATE double largest_error(Block *b, const Study *s, M *large) {
  /* Comparisons are written so that NaN counts as an error that is too large, here and in run_until. */
  double e = 0.0;
  EACH_PART(b) {
    V sum = zero();
    for (int i = 0; i < N_ERRORS; ++i) {
      const V r = a->k[N_W + i] / (s->atol[i] + s->rtol * v_larger(v_fabs(a->x[i]), v_fabs(a->k[i])));
      sum += r * r;
    }
    sum = v_sqrt(sum / (double)SIZE(N_ERRORS));
    large[a - b->part] = ~(M)(sum <= 1.0);
    a->load += v_smaller(sum, each(1.0)); /* 1 for NaN */
    const double here = largest_lane(sum);
    e = here > e || here != here ? here : e;
  }
  return e;
}

/* The samples of the marked lanes fail, because no shorter step is left. Returns 0. */
PRIVATE int fail_samples(Block *b, Study *s, const M *marked, char why) {
  /* If other samples make steps very short, residuals and estimated errors are rounding, and good samples also fail. */
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
  /* The first step of an explicit method follows from slopes. The functions of an implicit scheme do not give slopes. Therefore
     the first step is a ten-thousandth of the horizon. It is halved if Newton's method fails, and grows by GROWTH if errors are
     small. */
  b->first = b->wanted = s->rtol > 0.0 && longest > 1e-4 * span ? 1e-4 * span : longest;
  b->fresh = 1;
  b->steps = b->iterations = b->most = 0;
  /* The scheme does not use between_stops. So a run that starts at a switch starts just after the switch. */
  if (find_stop(b, s)) b->t = b->from;
  return 1;
}

/* Runs the block until it has its first n outputs. Returns 0 if samples failed. */
PRIVATE int run_until(Block *b, Study *s, long n) {
  const double span = s->times[s->n_t - 1] - s->times[0], longest = s->longest > 0.0 ? s->longest : span;
  M marked[PARTS];
  while (b->next < n) {
    const double shortest = s->rtol > 0.0 ? shortest_step(b, s) : 1e-4 * longest;
    if (!(b->wanted > shortest)) b->wanted = shortest;
    const double goal = b->to < s->times[b->next] ? b->to : s->times[b->next];
    /* Equal steps up to the goal. Otherwise the remaining last step could be as short as rounding. With 1e-9, a step that fits
       except for rounding is one step. */
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
    /* Newton's method fails if its guess is inaccurate. A shorter step has a better guess. */
    if (!solve(b, s, marked)) {
      if (!(b->h > 1.0000001 * shortest)) return fail_samples(b, s, marked, NEWTON);
      b->wanted = 0.5 * b->h;
      continue;
    }
    EACH_PART(b) follow(a->x, a->c, each(b->t_new), a->k);
    double factor = GROWTH;
    if (s->rtol > 0.0) {
      const double e = largest_error(b, s, marked);
      /* The estimate has order ORDER + 1 in h. So this factor changes it to 0.9^(ORDER + 1) tolerances. */
      const double best = e > 1e-12 ? 0.9 * pow(e, -1.0 / (ORDER + 1)) : GROWTH;
      factor = best < GROWTH ? best : GROWTH;
      if (!(e <= 1.0)) {
        if (!(b->h > 1.0000001 * shortest)) return fail_samples(b, s, marked, STEPS);
        b->wanted = b->h * (e == e && factor > 0.1 ? factor : 0.1);
        continue;
      }
    }
    /* A step that was short only because of a near output time must not shorten later steps. The wanted length is kept, but it
       grows at most by GROWTH over the length of the actual step. */
    const double next = factor * b->h < longest ? factor * b->h : longest;
    b->wanted = factor < 1.0 || next > b->wanted ? next : b->wanted < GROWTH * b->h ? b->wanted : GROWTH * b->h;
    b->fresh = 0;
    b->t = b->t_new;
    EACH_PART(b) memcpy(a->x, a->k, N_W * sizeof(V));
    if (b->t < goal) continue;
    const int at_stop = goal == b->to;
    /* The history before a switch belongs to other equations. So the scheme starts again after the switch, with a first
       step. */
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

/* Continues from that time with other parameters. Returns 0 if samples failed. */
PRIVATE int go_on_with(Block *b, Study *s, double t) {
  if (!reach_constraints(b, s, t)) return 0;
  b->fresh = 1;
  b->wanted = b->first;
  return 1;
}

/* Runs the block from the first time to the last. Returns 0 if samples failed. */
PRIVATE int run(Block *b, Study *s) { return begin_run(b, s) && run_until(b, s, s->n_t); }

#endif
