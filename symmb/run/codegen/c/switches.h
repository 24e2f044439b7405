/* Switches: kinks and jumps of the equations. No step passes over a switch, because the error of such a step would decrease
   only with the first or second power of the step. The step control would then reject many steps.

   Switches of time have known times, at which steps end. Within a step, the equations keep their branches on one side of each
   switch of the state, so that all stages are smooth. u is a switch times its side. The switch is passed when u falls below 0.
   Then the step ends, and the side changes. After this, u is raised by a hysteresis above rounding, until a step begins beyond
   the hysteresis. Otherwise rounding would pass the switch again at once. switches(x, c, t, u) computes the N_S switches, and
   changes(x, c, t, u) computes their rates. Sides, 1 or -1, are the last parameters.

   The search must also find a pass if a switch falls below 0 and rises again within a step. Therefore the search has three
   stages, each more expensive than the stage before. may_pass examines signs at the ends of the step, and ranges over a box
   around the step. rough_pass finds a root between the ends. first_pass examines ranges over parts of the step, which are
   halved until all passes are excluded or found.

   The last N_G switches are gaps of N_I open contacts (1 for closed contacts), and margins of conditions of joints that open
   and close. They keep their sides. A gap or margin that begins below 0 because of rounding is raised to 0. A closed contact
   opens when its force falls to 0: number N_S + k is the force in contact k. */
#ifndef SWITCHES_H
#define SWITCHES_H

#include "projection.h"

#define STOP_MARGIN 4.5e-16 /* relative rounding error of switches of time */

/* Finds the next switch of time of a sample in the block. Returns whether there is a switch at t. Rates are evaluated after the
   previous switch and before the next switch, also with rounding. */
PRIVATE int find_stop(Block *b, const Study *s) {
  /* The margin is relative to the time. Near time 0 it would vanish, although switches there have rounding errors of the terms
     from which they are computed. A thousandth of the horizon is used as the size of these terms. */
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

#define LATE 0.99    /* a pass before this fraction of a step is early, and a shorter step replaces the step */
#define BEYOND 1.002 /* length of the shorter step over the length to the pass */
#define ROUGH 4e-3   /* error of a rough pass: 1 / (1.002 * 1.004) > 0.99, so that a shorter step has a late pass */

#if N_S > 0
#define AT_ONCE 2.220446049250313e-16 /* fraction of a step, 2^-52, for its start */
#define LEAST_PART 9.094947017729282e-13 /* fraction of a step, 2^-40. In shorter parts, only ends are examined */
#define MOST_PARTS 256      /* maximum number of examined parts of a step if ranges do not exclude a pass. The step then
                               ends before the next part */
#define LONG_PART 0.015625  /* fraction of a step, 2^-6: the smallest examined length after MOST_PARTS */
#define SETTLINGS 8         /* repetitions for switches that depend on the sides of other switches */
#define MOST_ROOT_STEPS 150 /* every third step is a bisection, and 52 bisections are enough */
#define SCREEN 0.25         /* largest distance of a state from the cubic of its step, over the distance of cubic and chord:
                               four times the value of a sine with a change of phase of 2 in a step */
#define SLIGHT 1e-3         /* fraction of a hysteresis that counts as 0 within a step. A hysteresis may be larger than the
                               height of a narrow pulse */
#define SLOPE_OFF 3.0792    /* 16 sqrt(3) / 9, the largest slope of 16 z^2 (1 - z)^2, which is at most 1. A function has this
                               distance from the cubic with its values and slopes at both ends */
#define ROUNDED 1.7763568394002505e-15 /* fraction of lengths, 2^-49, below which a gap is 0: eight rounding errors */
#ifdef APART /* lanes receive these numbers behind those of the equations */
#define OTHER_NUMBER(a, k) ((a)->c[N_C + (k)][0])
#define HYSTERESIS(a, k) OTHER_NUMBER(a, k)
#define DISPLACEMENT(a, k) OTHER_NUMBER(a, N_S + (k))
#define LENGTH_OF(a) OTHER_NUMBER(a, N_S + N_V)
#define ENERGY_OF(a) OTHER_NUMBER(a, N_S + N_V + 1)
#else
#define HYSTERESIS(a, k) hysteresis[k]
#define DISPLACEMENT(a, k) displacement[k]
#define LENGTH_OF(a) scales[0]
#define ENERGY_OF(a) scales[1]
#endif
#if N_G == 0
#undef LENGTH_OF
#define LENGTH_OF(a) 0.0
#endif
#define REVERSAL 10.0       /* a motion sticks if it returns by this number of hystereses in a tenth of a step */
#define SMALL 1e-12         /* fraction of the terms of a sum below which the sum is rounding */
#define FORCE_PARTS 4       /* parts of a step in which a force that opens a contact or a joint is evaluated, at both ends and
                               in the middle. Ranges of forces from linear systems are too wide */
#define LOOKS 4             /* parts of a step at whose ends the reach of switches is noted */
#define DIP 0.15            /* largest fall of a switch within a step below the values at its ends, over its change during the
                               run until now: twice that of a cosine in a step with a change of phase of 1.1 */
#define HARDLY 0.1          /* reach beyond 0, over the reach on the other side, up to which it is noted exactly */
#define TOUCH 1e-300         /* reach of a switch beyond 0 where it is passed */
#define FORCE_LEAST 6.103515625e-05 /* fraction of a step, 2^-14. In shorter parts, only ends are examined */

PRIVATE V *sides(Part *a) { return a->p + N_P - N_S; }

/* The switches u at x, times their sides, and raised by the hysteresis. */
PRIVATE void on_sides(Part *a, const V *x, V t, V *u) {
  switches(x, a->c, t, u);
  for (int k = 0; k < N_S; ++k) u[k] = u[k] * sides(a)[k] + a->raised[k];
}

/* The rates du of the switches at x, times their sides. */
PRIVATE void rates_on_sides(Part *a, const V *x, V t, V *du) {
  changes(x, a->c, t, du);
  for (int k = 0; k < N_S; ++k) du[k] *= sides(a)[k];
}

/* Chooses the sides at the start of a step. */
PRIVATE void settle(Block *b) {
  EACH_PART(b) {
    M changed = (M)zero() == 0;
    /* The side of a switch within the hysteresis around 0 follows from its rate. If the rate is 0 too, the side does not
       change. Gaps and margins keep their sides, because events of contacts decide about them. A switch may depend on the sides
       of other switches, so one pass over all switches is not enough. Two switches may also change each other forever, so the
       number of passes is limited. */
    for (int n = 0; n < SETTLINGS && !none(changed); ++n) {
      switches(a->x, a->c, each(between_stops(b, b->t)), a->u);
      changes(a->x, a->c, each(between_stops(b, b->t)), a->du);
      changed = (M)zero();
      for (int k = 0; k < N_S - N_G; ++k) {
        const V u = choose(v_fabs(a->u[k]) > HYSTERESIS(a, k), a->u[k], a->du[k]);
        const V side = choose(u > 0.0, each(1.0), choose(u < 0.0, each(-1.0), sides(a)[k]));
        changed |= (M)(side != sides(a)[k]);
        sides(a)[k] = side;
      }
      prepare(a->p, a->c); /* sides are parameters, and c holds values that depend on them */
    }
    for (int k = 0; k < N_S; ++k) a->raised[k] = each(HYSTERESIS(a, k));
    on_sides(a, a->x, each(between_stops(b, b->t)), a->u);
    /* A gap that begins below 0 because of rounding would be passed in each step. Therefore it is raised to 0. */
    for (int k = N_S - N_G; k < N_S; ++k) {
      const V lift = v_larger(-a->u[k], zero());
      a->raised[k] += lift;
      a->u[k] += lift;
    }
  }
}

#if N_I > 0
/* Whether contact k is closed. */
PRIVATE int is_closed(const Part *a, int k) { return a->x[place[contact_state[k]]][0] > 0.5; }

/* The force in closed contact k at x, raised by its rounding, so that only a pull above rounding opens the contact. */
PRIVATE V contact_force(const Part *a, Block *b, int k, const V *x, V t) {
  forces(x, (V *)a->c, t, b->force);
  return b->force[k] + SMALL * b->force[2 * N_I + k] * b->force[3 * N_I + k];
}
#else
PRIVATE int is_closed(const Part *a, int k) { (void)a, (void)k; return 0; }
PRIVATE V contact_force(const Part *a, Block *b, int k, const V *x, V t) {
  (void)a, (void)b, (void)k, (void)x, (void)t;
  return zero();
}
#endif

/* The box of a state and its slope in a part of a step. `share` is the length of the part, divided by the step. The inputs are
   x and dx at both ends of the part, with slopes for the whole step, and the largest distance `off` of the state from the cubic
   with these values and slopes. */
PRIVATE void bound_state(Part *a, int row, double share, V x, V dx, V x_end, V dx_end, V off) {
  /* With the change d of the state in the part, the cubic is x + z d + z (1 - z) ((1 - z) (first - d) + z (d - last)). Its
     distance from the chord is z (1 - z), at most 1 / 4, times a number between first - d and d - last. Its slope is (1 - z)
     first + z last + z (1 - z) (6 d - 3 first - 3 last). This is at most `bend` outside of the range of the slopes at the ends.
     These bounds are slightly too wide, but need no roots, unlike the extremes of the cubic. */
  const V d = x_end - x, first = share * dx, last = share * dx_end, bend = 0.75 * (2.0 * d - first - last);
  const V from = 0.25 * (first - d), to = 0.25 * (d - last);
  const V slope_off = SLOPE_OFF * off;
  V *box = a->box + row;
  box[0] = v_smaller(x, x_end) + v_smaller(zero(), v_smaller(from, to)) - off;
  box[N_BOX] = v_larger(x, x_end) + v_larger(zero(), v_larger(from, to)) + off;
  box[2 * N_BOX] = v_smaller(first, last) + v_smaller(zero(), bend) - slope_off;
  box[3 * N_BOX] = v_larger(first, last) + v_larger(zero(), bend) + slope_off;
}

/* Whether switch k is the gap of a contact. */
PRIVATE int is_gap(int k) { return k >= N_S - N_G && k < N_S - N_G + N_I; }

/* Whether switch k is the margin of a joint that opens by its force. */
PRIVATE int is_by_force(int k) {
#if N_E > 0
  return k >= N_S - N_E && by_force[k - N_S + N_E];
#else
  return 0 * k;
#endif
}

/* Lanes in which a part of a step may contain a pass that the values u and u_end at its ends do not show. Such a switch is not
   monotone, and may fall below 0 by more than rounding and rise again. Ranges of the switches and of their rates over the box
   decide this. Ranges that are too wide cause a search, but no pass is missed. */
PRIVATE M is_open(Part *a, V begin, V end, double share, double h, const V *u, const V *u_end) {
  V *time = a->box + 4 * N_BOX, range[4 * N_S];
  M open = (M)zero();
  time[0] = begin;
  time[1] = end;
  time[2] = each(share * h);
  bounds(a->box, a->c, zero(), range);
  for (int k = 0; k < N_S; ++k) {
    if (is_by_force(k)) continue; /* see first_release */
    const M up = (M)(sides(a)[k] > 0.0);
    const V least = blend(up, range[k], -range[N_S + k]) + a->raised[k];
    const double slight = is_gap(k) ? ROUNDED * LENGTH_OF(a) : SLIGHT * HYSTERESIS(a, k);
    /* For a switch that stays at 0, ranges cannot exclude a pass because of rounding, even in short parts. Therefore rounding
       is allowed in parts. It is not allowed in a whole step, because the halves of a step cost little and exclude more. */
    const V rounding = each(share < 1.0 ? slight : 0.0);
    const V fall = blend(up, range[2 * N_S + k], -range[3 * N_S + k]), rise = blend(up, range[3 * N_S + k], -range[2 * N_S + k]);
    /* Between two values with rates in [fall, rise], a switch stays above the intersection of two straight lines. One line
       falls from the first value with the rate `fall`. The other line rises to the last value with the rate `rise`. */
    const V from = u[k] + rounding, to = u_end[k] + rounding;
    const M between = (M)(from >= 0.0) & (M)(from * rise - to * fall > -fall * rise);
    /* A switch that ends below 0 has a known pass. If it is not monotone, an earlier pass may exist. */
    const M above = (M)(u_end[k] >= 0.0) & ((M)(least > -rounding) | between);
    open |= ~(above | (M)(fall >= 0.0) | (M)(rise <= 0.0));
  }
  return open;
}

/* Whether a switch may have been passed in a step. `last` is the place in k of the slope at the end. */
PRIVATE int may_pass(Block *b, int last) {
  M any = (M)zero(), falls = any, deep = any;
  /* Ranges of forces are too wide. So steps with a closed contact, or with a joint that opens by its force, are always
     searched. */
  for (int k = 0; k < N_I; ++k) any |= is_closed(b->part, k) - (M)zero();
  for (int k = 0; k < N_S; ++k) any |= is_by_force(k) - (M)zero();
  EACH_PART(b) {
    /* A switch that is above the hysteresis is no longer raised, because its next fall below 0 is not rounding. */
    for (int k = 0; k < N_S; ++k) {
      const V u = a->u[k] - a->raised[k];
      const M beyond = (M)(u > a->raised[k]);
      a->u[k] = blend(beyond, u, a->u[k]);
      a->raised[k] = blend(beyond, zero(), a->raised[k]);
    }
    on_sides(a, a->x_new, each(between_stops(b, b->t_new)), a->u_new);
    for (int k = 0; k < N_S; ++k) {
      any |= (M)(a->u[k] < 0.0) | (M)(a->u_new[k] < 0.0);
      falls |= (M)(a->u_new[k] < 0.0);
      deep |= (M)(a->u_new[k] < -HYSTERESIS(a, k));
    }
  }
  b->grazes = !none(falls) && none(deep);
  /* Signs at the ends do not show a switch that is passed twice in between. For most steps, ranges over a box around the step
     exclude this at the cost of one evaluation. Only the other steps are searched. The interpolant costs three evaluations, and
     does not exist yet. Therefore the cubic through the ends is used, with SCREEN for its distance from the state. */
  if (!none(any)) return 1;
  EACH_PART(b) {
    for (int j = 0; j < N_RANGED; ++j) {
      const int i = place[ranged[j]];
      const V d = a->x_new[i] - a->x[i], dx = b->h * slope(a->x, a->k, i), dx_end = b->h * slope(a->x_new, a->k + last * N_OWN, i);
      bound_state(a, ranged[j], 1.0, a->x[i], dx, a->x_new[i], dx_end, 0.25 * SCREEN * v_larger(v_fabs(dx - d), v_fabs(d - dx_end)));
    }
    any |= is_open(a, each(b->t), each(b->t_new), 1.0, b->h, a->u, a->u_new);
    if (!none(any)) return 1;
  }
  return 0;
}

/* The states x at fractions z of the step. Each lane has a different fraction. */
PRIVATE void state_at(const Part *a, V z, V *x) {
  const V r = 1.0 - z;
  for (int i = 0; i < N_X; ++i) {
    const V *f = a->F + 7 * i;
    x[i] = a->x[i] + z * (f[0] + r * (f[1] + z * (f[2] + r * (f[3] + z * (f[4] + r * (f[5] + z * f[6]))))));
  }
}

/* The derivative of state i with respect to the fraction z of the step. */
PRIVATE V change_at(const Part *a, int i, double z) {
  /* The product rule for the nested form of the interpolant. y and dy are the value and the slope of the inner part. The
     factors are z and 1 - z in turn. */
  const V *f = a->F + 7 * i;
  const double r = 1.0 - z;
  V y = f[6], dy = zero();
  for (int j = 5; j >= 0; --j) {
    dy = j % 2 ? z * dy + y : r * dy - y;
    y = f[j] + (j % 2 ? z : r) * y;
  }
  return z * dy + y;
}

/* Switch k, or the force in contact k - N_S, at fractions z of the step. */
PRIVATE V switch_at(Part *a, Block *b, int k, V z) {
  state_at(a, z, a->x_at);
  if (k >= N_S) return contact_force(a, b, k - N_S, a->x_at, b->t + z * b->h);
  on_sides(a, a->x_at, b->t + z * b->h, a->u_at);
  return a->u_at[k];
}

/* The sign change of switch or force k between fractions low and high of the step, in marked lanes. The result is the upper end
   of an interval around the sign change, with a relative length of at most `off`. So the state at the result is after the
   pass. */
PRIVATE V sign_change(Part *a, Block *b, int k, M marked, V low, V high, V at_low, V at_high, double off) {
  /* Values at the ends. The value at the end that does not move is reduced by the rule of Anderson and Bjoerck (1973).
     Otherwise, for a convex function, one end of regula falsi would never move, and convergence would be linear. */
  V kept_low = at_low, kept_high = at_high;
  for (int n = 0; n < MOST_ROOT_STEPS; ++n) {
    const M open = marked & (M)(high - low > off * high + 4.4e-16);
    if (none(open)) break;
    /* For a switch with a corner, convergence may still be slow. Bisection alone takes 52 steps, so every third step is a
       bisection. */
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

/* The first fraction of a step at which a switch falls below 0, with an error of ROUGH. Only switches that are below 0 at the
   end of the step are examined. The result is 2 without a pass. */
PRIVATE double rough_pass(Block *b) {
  /* An earlier pass of a switch that returns is not found here. The shorter step or first_pass will find it. */
  double first = 2.0;
  EACH_PART(b)
    for (int k = 0; k < N_S; ++k) {
      const M passes = (M)(a->u[k] >= 0.0) & (M)(a->u_new[k] < 0.0);
      if (none(passes)) continue;
      const V when = sign_change(a, b, k, passes, zero(), each(1.0), a->u[k], a->u_new[k], ROUGH);
      for (int l = 0; l < W; ++l) first = passes[l] && when[l] < first ? when[l] : first;
    }
  return first;
}

/* The box of a part of a step between fractions low and high. The state at the end of the part is x_at. */
PRIVATE void bound_part(Part *a, double low, double high) {
  const double share = high - low, square = share * share;
  for (int j = 0; j < N_RANGED; ++j) {
    const int i = place[ranged[j]];
    const V *f = a->F + 7 * i;
    /* The distance of a function from the cubic through its ends is at most its fourth derivative over 384, times the fourth
       power of the length. In z, the terms z^2 r^2, z^3 r^2, z^3 r^3 and z^4 r^3 of f[3] to f[6] with r = 1 - z have fourth
       derivatives of at most 24, 72, 72 and 96. Because of the fourth power, boxes of short parts are nearly exact, and few
       halvings are enough. */
    const V off = 0.0625 * v_fabs(f[3]) + 0.1875 * (v_fabs(f[4]) + v_fabs(f[5])) + 0.25 * v_fabs(f[6]);
    a->x_end[j] = a->x_at[i];
    a->dx_end[j] = change_at(a, i, high);
    bound_state(a, ranged[j], share, a->x_low[j], a->dx_low[j], a->x_end[j], a->dx_end[j], square * square * off);
  }
}

/* Whether a parabola through three values of at least 0, with twice its curvature, falls below 0 between them. Three values do
   not determine a force. The doubled curvature is a margin for higher derivatives of the force. */
PRIVATE int may_fall(double from, double middle, double to) {
  const double bend = 4.0 * (from + to - 2.0 * middle), slope = to - from - bend;
  return bend > 0.0 && slope < 0.0 && slope + 2.0 * bend > 0.0 && from < slope * slope / (4.0 * bend);
}

/* The first fraction of the step, before `first`, at which force k falls below 0; otherwise `first`. Parts are halved until no
   parabola through values of at least 0 falls below 0. */
PRIVATE double first_fall(Part *a, Block *b, int k, double first) {
  double low = 0.0, share = 1.0 / FORCE_PARTS;
  V from = switch_at(a, b, k, zero());
  /* If several forces fall below 0 at one instant, the search finds the first. The others may be below 0 only after the event,
     because of rounding. */
  if (from[0] < 0.0) return AT_ONCE;
  while (low < first && low < 1.0) {
    const double half = low + 0.5 * share, high = low + share;
    const V middle = switch_at(a, b, k, each(half)), to = switch_at(a, b, k, each(high));
    if (from[0] >= 0.0 && (middle[0] < 0.0 || to[0] < 0.0)) {
      const int early = middle[0] < 0.0;
      const V when = sign_change(a, b, k, ~(M)zero(), each(early ? low : half), each(early ? half : high), early ? from : middle,
                                 early ? middle : to, 0.0);
      return when[0] < first ? when[0] : first;
    }
    if (from[0] >= 0.0 && share > FORCE_LEAST && may_fall(from[0], middle[0], to[0])) {
      share *= 0.5;
      continue;
    }
    low = high;
    from = to;
    while (share < 1.0 / FORCE_PARTS && fmod(low, 2.0 * share) == 0.0) share *= 2.0;
  }
  return first;
}

/* The first fraction of the step, before `first`, at which a force opens a closed contact or a joint; otherwise `first`. */
PRIVATE double first_release(Block *b, double first) {
  Part *a = b->part;
  for (int k = 0; k < N_S + N_I; ++k) {
    if (k < N_S ? !is_by_force(k) : !is_closed(a, k - N_S)) continue;
    const double when = first_fall(a, b, k, first);
    if (when >= first) continue;
    first = when;
    a->when = each(when);
    a->which = each((double)k);
  }
  return first;
}

/* Finds the first switch that each lane passes, in `which`, and the fraction of the step, in `when`. Parts of the step are
   halved until ranges along the interpolant exclude all passes that the signs at their ends do not show. Returns the smallest
   fraction, or 2 without a pass. If no lane passes a switch at this fraction, the step after it has not been examined. */
PRIVATE double first_pass(Block *b) {
  double first = 2.0, low = 0.0, share = 1.0;
  int parts = 0;
  EACH_PART(b) {
    a->when = each(2.0);
    if (N_I) rates_on_sides(a, a->x, each(between_stops(b, b->t)), a->du);
    /* A switch that has jumped below 0 at the start of the step is passed there. A gap that is 0 and closes is also passed
       there, because rounding may hide its change in the first part. */
    for (int k = 0; k < N_S; ++k) {
      const M closes = is_gap(k) ? (M)(a->u[k] == 0.0) & (M)(a->du[k] < 0.0) : (M)zero();
      const M jumped = ((M)(a->u[k] < 0.0) | closes) & (M)(a->when > 1.0);
      a->when = blend(jumped, each(AT_ONCE), a->when);
      a->which = blend(jumped, each((double)k), a->which);
      first = none(jumped) ? first : AT_ONCE;
      a->u_low[k] = a->u[k];
    }
    for (int j = 0; j < N_RANGED; ++j) {
      const int i = place[ranged[j]];
      a->x_low[j] = a->x[i];
      a->dx_low[j] = change_at(a, i, 0.0);
    }
  }
  /* Parts in order, from the start of the step on. A part that may contain an unseen pass is halved. The following parts become
     longer again. Parts begin at multiples of their length, so that their ends are exact and the last part ends at 1. All lanes
     have the same parts. The search ends with the first part in which a lane passes a switch, because the step ends there. */
  while (low < 1.0 && first > 1.0) {
    const double high = low + share;
    M open = (M)zero();
    EACH_PART(b) {
      state_at(a, each(high), a->x_at);
      on_sides(a, a->x_at, b->t + high * each(b->h), a->u_new);
      bound_part(a, low, high);
      open |= is_open(a, each(b->t + low * b->h), each(b->t + high * b->h), share, b->h, a->u_low, a->u_new);
    }
    /* If ranges never exclude a pass, as for a switch that stays near 0, the step ends after the examined parts. A shorter step
       is better than a search without an end. */
    if (++parts > MOST_PARTS && low >= LONG_PART) return first_release(b, low);
    if (!none(open) && share > (parts > MOST_PARTS ? LONG_PART : LEAST_PART)) {
      share *= 0.5;
      continue;
    }
    EACH_PART(b) {
      for (int k = 0; k < N_S; ++k) {
        const V end = a->u_new[k];
        const M passes = (M)(end < 0.0);
        if (none(passes)) continue;
        /* A root needs two values of different sign, so the value at `low` is replaced by 0 if it is below 0. */
        const V when = sign_change(a, b, k, passes, each(low), each(high), v_larger(a->u_low[k], zero()), end, 0.0);
        const M sooner = passes & (M)(when < a->when);
        a->when = blend(sooner, when, a->when);
        a->which = blend(sooner, each((double)k), a->which);
      }
      for (int k = 0; k < N_S; ++k) a->u_low[k] = a->u_new[k];
      memcpy(a->x_low, a->x_end, N_RANGED * sizeof(V));
      memcpy(a->dx_low, a->dx_end, N_RANGED * sizeof(V));
      for (int l = 0; l < W; ++l) first = a->when[l] < first ? a->when[l] : first;
    }
    low = high;
    while (share < 1.0 && fmod(low, 2.0 * share) == 0.0 && low + 2.0 * share <= 1.0) share *= 2.0;
  }
  return first_release(b, first);
}

/* The number of the contact that closes at the fraction z at which the step ends, or N_G plus the number of the contact that
   opens there; -1 if there is none. */
PRIVATE int contact_at(const Block *b, double z) {
  const Part *a = b->part;
  return N_G > 0 && z <= 1.0 && a->when[0] <= z ? (int)fmax(a->which[0] - (N_S - N_G), -1.0) : -1;
}

/* Moves x_new to the fraction z of the step, at t_new, and changes the sides of the switches that are passed there. Returns 0
   if samples stick. If the motion returns to a switch from both sides, it would pass the switch forever. */
PRIVATE int change_sides(Block *b, Study *s, double z) {
  int moves = 1;
  EACH_PART(b) {
    /* After the pass, the rates are those of the other side. If the motion moves to the switch from both sides, it slides along
       the switch (Filippov). Neither branch describes such a motion, and steps would end there forever. For this test, the
       motion must return by REVERSAL hystereses within a tenth of a step. Slower returns are rounding, or a motion that touches
       the switch. */
    const V t = each(between_stops(b, b->t_new));
    V before[SIZE(N_S)];
    M passed[SIZE(N_S)];
    state_at(a, each(z), a->x_new);
    rates_on_sides(a, a->x_new, t, before);
    for (int k = 0; k < N_S; ++k) {
      passed[k] = k < N_S - N_G ? (M)(a->when <= z) & (M)(a->which == (double)k) : (M)zero();
      sides(a)[k] = blend(passed[k], -sides(a)[k], sides(a)[k]);
      a->raised[k] = blend(passed[k], each(HYSTERESIS(a, k)), a->raised[k]);
    }
    for (long l = 0; l < W && s->passes; ++l)
      if (a->when[l] <= z && a->which[l] < N_S - N_G && (a - b->part) * W + l < b->live) note_pass(b, s, (a - b->part) * W + l, b->t_new);
    prepare(a->p, a->c);
    on_sides(a, a->x_new, t, a->u);
    rates_on_sides(a, a->x_new, t, a->du);
    for (int k = 0; k < N_S; ++k) {
      const V margin = each(REVERSAL * HYSTERESIS(a, k));
      const M turned = (M)(before[k] < 0.0) & (M)(0.1 * b->h * a->du[k] < -margin);
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

/* Raises the switches that are 0 after a pass. The projection has moved the state, and may have moved other switches to 0.
   These are passed only if they also fall. */
PRIVATE void raise_switches(Block *b) {
  EACH_PART(b) {
    V before[SIZE(N_S)];
    memcpy(before, a->u, sizeof before);
    if (PROJECTED) {
      on_sides(a, a->x, each(between_stops(b, b->t)), a->u);
      rates_on_sides(a, a->x, each(between_stops(b, b->t)), a->du);
    }
    for (int k = 0; k < N_S; ++k) {
      const V least = each(HYSTERESIS(a, k));
      const V aim = choose(a->du[k] > 0.0, least, v_smaller(before[k], least));
      const V lift = choose(before[k] > -least, v_larger(aim - a->u[k], zero()), zero());
      a->raised[k] += lift;
      a->u[k] += lift;
    }
  }
}

/* Uses the switches at the end of a step for the start of the next step. This saves an evaluation. */
PRIVATE void keep_switches(Block *b) {
  EACH_PART(b) memcpy(a->u, a->u_new, sizeof a->u);
}

/* Notes the reach of the switches at the start of a run: their smallest and largest values until now, without sides. */
PRIVATE void begin_reach(Block *b) {
  EACH_PART(b) {
    switches(a->x, a->c, each(between_stops(b, b->t)), a->reach);
    memcpy(a->reach + N_S, a->reach, sizeof a->u);
  }
}

/* Lanes in which switch k has been on one side until now, or hardly beyond, and may extend this end of its reach between two
   values. */
PRIVATE M may_reach(const Part *a, int k, V begin, V end) {
  const V least = a->reach[k], most = a->reach[N_S + k], off = DIP * (most - least);
  const M low = (M)(least > -HARDLY * most) & (M)(v_smaller(begin, end) < least + off);
  return low | ((M)(most < -HARDLY * least) & (M)(v_larger(begin, end) > most - off));
}

/* Extends the reach by the step up to its fraction z, before the block moves there; z is 2 for a whole step. A switch that is
   passed there has been on both sides. Switches are evaluated within the step only if this may be needed. */
PRIVATE void extend_reach(Block *b, double z, int last) {
  const double whole = z < 1.0 ? z : 1.0;
  EACH_PART(b) {
    V values[LOOKS + 1][N_S];
    M any = (M)zero();
    for (int k = 0; k < N_S; ++k) {
      values[0][k] = (a->u[k] - a->raised[k]) * sides(a)[k];
      values[LOOKS][k] = (a->u_new[k] - a->raised[k]) * sides(a)[k];
      any |= z <= 1.0 ? ~(M)zero() : may_reach(a, k, values[0][k], values[LOOKS][k]);
    }
    for (int j = 1; j <= LOOKS && !none(any); ++j) {
      const V at = each(whole * j / LOOKS), r = 1.0 - at;
      if (j == LOOKS && z > 1.0) break;
      if (z <= 1.0) state_at(a, at, a->x_at);
      /* Without a pass, there may be no interpolant. The cubic through both ends is close enough. */
      for (int i = 0; i < N_X && z > 1.0; ++i) {
        const V d = a->x_new[i] - a->x[i], from = b->h * slope(a->x, a->k, i) - d;
        const V to = d - b->h * slope(a->x_new, a->k + last * N_OWN, i);
        a->x_at[i] = a->x[i] + at * (d + r * (r * from + at * to));
      }
      switches(a->x_at, a->c, b->t + at * b->h, values[j]);
    }
    for (int k = 0; k < N_S; ++k) {
      V least = v_smaller(values[0][k], values[LOOKS][k]), most = v_larger(values[0][k], values[LOOKS][k]);
      for (int j = 1; j < LOOKS && !none(any); ++j) {
        /* The vertex of the parabola through three values, if it is between them. */
        const V bend = values[j + 1][k] - 2.0 * values[j][k] + values[j - 1][k], rise = 0.5 * (values[j + 1][k] - values[j - 1][k]);
        const V vertex = values[j][k] - choose(v_fabs(rise) < v_fabs(bend), 0.5 * rise * rise / bend, zero());
        least = v_smaller(least, v_smaller(values[j][k], vertex));
        most = v_larger(most, v_larger(values[j][k], vertex));
      }
      const M passed = z <= 1.0 ? (M)(a->when <= z) & (M)(a->which == (double)k) : (M)zero();
      least = blend(passed, v_smaller(least, each(-TOUCH)), least);
      most = blend(passed, v_larger(most, each(TOUCH)), most);
      a->reach[k] = v_smaller(a->reach[k], least);
      a->reach[N_S + k] = v_larger(a->reach[N_S + k], most);
    }
  }
}

/* Stores the reach of the samples of the block, at the end of a run. */
PRIVATE void store_reach(const Block *b, const Study *s) {
  for (long l = 0; l < b->live && s->reach; ++l)
    for (int j = 0; j < 2 * N_S; ++j) s->reach[b->sample[l] * 2 * N_S + j] = b->part[l / W].reach[j][l % W];
}

#else
PRIVATE void settle(Block *b) { (void)b; }
PRIVATE int may_pass(Block *b, int last) { (void)b, (void)last; return 0; }
PRIVATE double rough_pass(Block *b) { (void)b; return 2.0; }
PRIVATE double first_pass(Block *b) { (void)b; return 2.0; }
PRIVATE int contact_at(const Block *b, double z) { (void)b, (void)z; return -1; }
PRIVATE int change_sides(Block *b, Study *s, double z) { (void)b, (void)s, (void)z; return 1; }
PRIVATE void raise_switches(Block *b) { (void)b; }
PRIVATE void keep_switches(Block *b) { (void)b; }
PRIVATE void begin_reach(Block *b) { (void)b; }
PRIVATE void extend_reach(Block *b, double z, int last) { (void)b, (void)z, (void)last; }
PRIVATE void store_reach(const Block *b, const Study *s) { (void)b, (void)s; }
#endif

#endif
