/* Switches: where equations have kinks or jumps. No step passes over one.

   Switches of time have known places, where steps end. Within a step the equations keep their branches on one side of each
   switch of the state, so that all stages are smooth. u is a switch times its side. The switch is passed where u falls
   below 0. The step then ends there, and the side changes. u is raised by a hysteresis above rounding from then on until a
   step begins beyond it. switches(x, c, t, u) gives the N_S switches and their rates. Sides, 1 or -1, are the last of the
   parameters. */
#ifndef SWITCHES_H
#define SWITCHES_H

#include "projection.h"

#define STOP_MARGIN 4.5e-16 /* share of a time by which switches of time may be off by rounding */

/* Finds the next switch of time of a sample in the block. Returns whether there is one at t. Rates are evaluated behind the
   switch before and before the next one, whatever their rounding. */
PRIVATE int find_stop(Block *b, const Study *s) {
  const double least = 1e-3 * (s->times[s->n_t - 1] - s->times[0]);
  int at_stop = 0;
  b->stop_time = INFINITY;
  for (long l = 0; l < b->live && s->stops; ++l) {
    const double *stops = s->stops + b->sample[l] * s->n_stops;
    for (; b->stop[l] < s->n_stops && stops[b->stop[l]] <= b->t; ++b->stop[l]) at_stop = 1;
    if (b->stop[l] < s->n_stops && stops[b->stop[l]] < b->stop_time) b->stop_time = stops[b->stop[l]];
  }
  if (at_stop) b->from = b->t + STOP_MARGIN * fmax(fabs(b->t), least);
  b->to = b->stop_time < INFINITY ? b->stop_time - STOP_MARGIN * fmax(fabs(b->stop_time), least) : INFINITY;
  return at_stop;
}

#define LATE 0.99    /* share of a step before which a switch is passed again, by a shorter step */
#define BEYOND 1.002 /* length of the shorter step over that to the switch */

#if N_S > 0
#define PARTS_OF_STEP 6     /* in each of which a switch and its rate may change sign once */
#define SETTLINGS 8         /* passes over switches that depend on the sides of others */
#define MOST_ROOT_STEPS 150 /* every third is a bisection, of which 52 are enough */
#define SCREEN 0.05         /* share of a switch's change in a step by which a cubic through its ends may be off */
#define REVERSAL 10.0       /* hystereses that a motion must come back in a tenth of a step to count as sticking */

PRIVATE V *sides(Part *a) { return a->p + N_P - N_S; }

/* The switches u on their sides at x, then their rates. */
PRIVATE void on_sides(Part *a, const V *x, V t, V *u) {
  switches(x, a->c, t, u);
  for (int k = 0; k < N_S; ++k) {
    u[k] = u[k] * sides(a)[k] + a->raised[k];
    u[N_S + k] *= sides(a)[k];
  }
}

/* The sides at the start of a step. Where a switch is 0 its rate decides. */
PRIVATE void settle(Block *b) {
  EACH_PART(b) {
    M changed = (M)zero() == 0;
    for (int n = 0; n < SETTLINGS && !none(changed); ++n) { /* switches may depend on the sides of others */
      switches(a->x, a->c, each(between_stops(b, b->t)), a->u);
      changed = (M)zero();
      for (int k = 0; k < N_S; ++k) {
        const V u = choose(v_fabs(a->u[k]) > hysteresis[k], a->u[k], a->u[N_S + k]);
        const V side = choose(u > 0.0, each(1.0), choose(u < 0.0, each(-1.0), sides(a)[k]));
        changed |= (M)(side != sides(a)[k]);
        sides(a)[k] = side;
      }
      prepare(a->p, a->c);
    }
    for (int k = 0; k < N_S; ++k) a->raised[k] = each(hysteresis[k]);
    on_sides(a, a->x, each(between_stops(b, b->t)), a->u);
  }
}

/* Whether a switch may have been passed in a step, told by the cubics through its ends. */
PRIVATE int may_pass(Block *b) {
  M any = (M)zero();
  EACH_PART(b) {
    for (int k = 0; k < N_S; ++k) {
      const V u = a->u[k] - a->raised[k];
      const M beyond = (M)(u > a->raised[k]);
      a->u[k] = blend(beyond, u, a->u[k]);
      a->raised[k] = blend(beyond, zero(), a->raised[k]);
    }
    on_sides(a, a->x_new, each(between_stops(b, b->t_new)), a->u_new);
    for (int k = 0; k < N_S; ++k) {
      const V first = b->h / 3.0 * a->u[N_S + k], last = b->h / 3.0 * a->u_new[N_S + k], end = a->u_new[k];
      const V margin = SCREEN * (v_fabs(first) + v_fabs(last) + v_fabs(end - a->u[k]));
      any |= (M)(end < 0.0) | (M)(a->u[k] + first < margin) | (M)(end - last < margin);
    }
  }
  for (int l = 0; l < W; ++l)
    if (any[l]) return 1;
  return 0;
}

PRIVATE void state_at(const Part *a, V z, V *x) {
  const V r = 1.0 - z;
  for (int i = 0; i < N_X; ++i) {
    const V *f = a->F + 7 * i;
    x[i] = a->x[i] + z * (f[0] + r * (f[1] + z * (f[2] + r * (f[3] + z * (f[4] + r * (f[5] + z * f[6]))))));
  }
}

/* Number k of the switches and rates at shares z of the step. */
PRIVATE V switch_at(Part *a, const Block *b, int k, V z) {
  state_at(a, z, a->x_at);
  on_sides(a, a->x_at, b->t + z * b->h, a->u_at);
  return a->u_at[k];
}

/* Where number k changes its sign between shares low and high of the step, in marked lanes: the end behind it. */
PRIVATE V sign_change(Part *a, const Block *b, int k, M marked, V low, V high, V at_low, V at_high) {
  V kept_low = at_low, kept_high = at_high; /* by the rule of Anderson and Bjoerck, which shrinks the end that stays */
  for (int n = 0; n < MOST_ROOT_STEPS; ++n) {
    const M open = marked & (M)(high - low > 4.4e-16);
    if (none(open)) break;
    V z = low + (high - low) * (n % 3 == 2 ? each(0.5) : kept_low / (kept_low - kept_high));
    z = choose((z > low) & (z < high), z, low + 0.5 * (high - low));
    const V at = switch_at(a, b, k, z);
    const M is_low = (M)((at < 0.0) == (at_low < 0.0));
    const V share_low = 1.0 - at / kept_low, share_high = 1.0 - at / kept_high;
    const V new_high = choose(share_low > 0.0, share_low, each(0.5)) * kept_high;
    const V new_low = choose(share_high > 0.0, share_high, each(0.5)) * kept_low;
    low = blend(open & is_low, z, low);
    high = blend(open & ~is_low, z, high);
    kept_high = blend(open, blend(is_low, new_high, at), kept_high);
    kept_low = blend(open, blend(is_low, at, new_low), kept_low);
  }
  return high;
}

/* The first switch that each lane passes: the share of the step, 2 without one, and the switch. Needs the interpolant. */
PRIVATE double first_pass(Block *b) {
  double first = 2.0;
  EACH_PART(b) {
    a->when = each(2.0);
    for (int k = 0; k < 2 * N_S; ++k) a->u_low[k] = a->u[k];
  }
  for (int j = 1; j <= PARTS_OF_STEP && first > 1.0; ++j)
    EACH_PART(b) {
      const V low = each((j - 1.0) / PARTS_OF_STEP), high = each((double)j / PARTS_OF_STEP);
      state_at(a, high, a->x_at);
      on_sides(a, a->x_at, b->t + high * b->h, a->u_new);
      for (int k = 0; k < N_S; ++k) {
        const V begin = v_larger(a->u_low[k], zero()), end = a->u_new[k], falls = a->u_low[N_S + k], rises = a->u_new[N_S + k];
        M passes = (M)(end < 0.0), turns = ~passes & (M)(falls < 0.0) & (M)(rises > 0.0);
        V behind = high, there = end;
        if (!none(turns)) { /* it may be passed twice: its least value decides */
          const V turn = sign_change(a, b, N_S + k, turns, low, high, falls, rises);
          const V least = switch_at(a, b, k, turn);
          turns &= (M)(least < 0.0);
          behind = blend(turns, turn, behind);
          there = blend(turns, least, there);
        }
        passes |= turns;
        if (none(passes)) continue;
        const V when = sign_change(a, b, k, passes, low, behind, begin, there);
        const M sooner = passes & (M)(when < a->when);
        a->when = blend(sooner, when, a->when);
        a->which = blend(sooner, each((double)k), a->which);
      }
      for (int k = 0; k < 2 * N_S; ++k) a->u_low[k] = a->u_new[k];
      for (int l = 0; l < W; ++l) first = a->when[l] < first ? a->when[l] : first;
    }
  return first;
}

/* Moves x_new to the share z of the step, at t_new, and changes the sides of the switches that are passed there. Returns 0
   if samples stick: a switch that turns a motion back from both sides is passed for ever. */
PRIVATE int change_sides(Block *b, Study *s, double z) {
  int moves = 1;
  EACH_PART(b) {
    state_at(a, each(z), a->x_new);
    on_sides(a, a->x_new, each(between_stops(b, b->t_new)), a->u_new);
    M passed[SIZE(N_S)];
    for (int k = 0; k < N_S; ++k) {
      passed[k] = (M)(a->when <= z) & (M)(a->which == (double)k);
      sides(a)[k] = blend(passed[k], -sides(a)[k], sides(a)[k]);
      a->raised[k] = blend(passed[k], each(hysteresis[k]), a->raised[k]);
    }
    for (long l = 0; l < W && s->passes; ++l)
      if (a->when[l] <= z && (a - b->part) * W + l < b->live) note_pass(b, s, (a - b->part) * W + l, b->t_new);
    prepare(a->p, a->c);
    on_sides(a, a->x_new, each(between_stops(b, b->t_new)), a->u);
    for (int k = 0; k < N_S; ++k) {
      const V margin = each(REVERSAL * hysteresis[k]);
      const M turned = (M)(a->u_new[N_S + k] < 0.0) & (M)(0.1 * b->h * a->u[N_S + k] < -margin);
      const M sticks = passed[k] & turned & (M)(a->u[k] < margin);
      for (int l = 0; l < W; ++l)
        if (sticks[l] && (a - b->part) * W + l < b->live) {
          fail_sample(b, s, (a - b->part) * W + l, b->t_new, STICKS);
          moves = 0;
        }
    }
  }
  return moves;
}

/* Raises the switches that are 0 behind a pass. The projection moves the state, and another switch may begin to act: it
   is passed if it falls only. */
PRIVATE void raise_switches(Block *b) {
  EACH_PART(b) {
    V before[SIZE(N_S)];
    memcpy(before, a->u, sizeof before);
    if (PROJECTED) on_sides(a, a->x, each(between_stops(b, b->t)), a->u);
    for (int k = 0; k < N_S; ++k) {
      const V least = each(hysteresis[k]);
      const V aim = choose(a->u[N_S + k] > 0.0, least, v_smaller(before[k], least));
      const V lift = choose(before[k] > -least, v_larger(aim - a->u[k], zero()), zero());
      a->raised[k] += lift;
      a->u[k] += lift;
    }
  }
}

/* The switches at the end of a step are those at the beginning of the next one. */
PRIVATE void keep_switches(Block *b) {
  EACH_PART(b) memcpy(a->u, a->u_new, sizeof a->u);
}

#else
PRIVATE void settle(Block *b) { (void)b; }
PRIVATE int may_pass(Block *b) { (void)b; return 0; }
PRIVATE double first_pass(Block *b) { (void)b; return 2.0; }
PRIVATE int change_sides(Block *b, Study *s, double z) { (void)b, (void)s, (void)z; return 1; }
PRIVATE void raise_switches(Block *b) { (void)b; }
PRIVATE void keep_switches(Block *b) { (void)b; }
#endif

#endif
