/* Impacts, and contacts that close and open. Velocities jump by B P, where P are impulses along the gaps of contacts.

   Events are located one by one (Acary and Brogliato 2008, chapter 8). This needs three decisions that do not follow from
   equations of motion. For several impacts at one instant, in_turn chooses the order. For several slow contacts, close_contacts
   chooses the contacts that stay closed, by the complementarity of gaps and forces. A sequence of impacts with intervals that
   decrease to 0 (Zeno) must end in a closed contact. Therefore rates below `rest` count as 0. At such rates, a gap would rise
   by at most its rounding.

   A joint that opens or closes has a state, flag_state, which is 1 while its rows are active; other_state are the same states
   of other events of this joint. The state changes at the instant at which the margin of a condition falls below 0.
   holding_state is 1 from this instant on, until the margin rises above 0. When rows become active, velocities jump, and
   place_state stores the position at which the joint closes.

   A block is one sample here, because the velocities of each sample jump at different times. The model defines these functions.
   gaps(x, c, t, out): gaps, their rates, and the sizes of the coordinates in them. forces(x, c, t, out): forces in closed
   contacts, accelerations of gaps, sizes of the terms of both, and effective inertias. impulses(x, c, t, out): W (N_I, N_V) and
   B (N_V, N_I) by columns, rates of gaps at rest, and restitutions. held(x, c, t, out): the state, projected onto its closed
   contacts. margins(x, c, t, out): margins and their rates. places(x, c, t, out): the values of place_state that events set.
   jump(x, c, t, out): velocities after the jump, impulses of the N_ROWS rows, and their work. contact_state lists the states
   that are 1 for closed contacts. LENGTH and ENERGY are sizes of the motion, and `displacement` (N_V) are sizes of
   displacements. */
#ifndef IMPACTS_H
#define IMPACTS_H

#include "switches.h"

enum { IMPACT, CLOSES, OPENS, BLAMED }; /* kinds of events; BLAMED contacts cause a failure */

#if N_G > 0
#define MOST_IMPACTS (1 + 1000 * N_I * N_I) /* at one instant: a row of bodies without restitution needs 100 N_I^2 */
#define MOST_NOTED 50       /* impacts at one instant recorded one by one. More impacts are one event of each contact */
#define SAME_JUMP 1e-6    /* difference of jumps of velocity, over their size, above which the order of impacts matters */
#define CROWD_SPAN 1e-12  /* fraction of the run's time. More than CROWD events in it are an endless sequence */
#define CROWD 1000
#define MOST_EVENTS 50000   /* of a run. With more events, a motion bounces faster and faster */
#define CONTACT_STEP 1e-13  /* fraction of the run's time: shorter steps after an event are lost in rounding */
#define MOST_IMPULSES 6     /* rows of a joint */
#define ROUNDS 3            /* of joints and impacts at one instant */
#define EVENT (8 + MOST_IMPULSES)

/* Contacts at one instant. */
typedef struct {
  double rate[SIZE(N_I)], rest[SIZE(N_I)]; /* rates of gaps, and largest rates at rest */
  double D[SIZE(N_I)][SIZE(N_I)], impulse[SIZE(N_I)], work[SIZE(N_I)]; /* D = W B: rates of gaps by impulses (Delassus) */
  int touching[SIZE(N_I)], movable[SIZE(N_I)];
} Instant;

/* Records event `what` of contact or joint k, with its n impulses L. If there is no space, events are only counted. The run is
   then repeated with enough space. */
PRIVATE void note_event(
    const Block *b, Study *s, int what, int k, double from, double to, double work, int ordered, const V *L, int n) {
  const long i = __atomic_fetch_add(&s->n_events, 1, __ATOMIC_RELAXED);
  double event[EVENT] = {b->sample[0], k, what, b->t, from, to, work, ordered};
  for (int j = 0; j < n && j < MOST_IMPULSES; ++j) event[8 + j] = L[j][0];
  if (i < s->most_events) memcpy(s->events + EVENT * i, event, sizeof event);
}

/* The sample fails, and the marked contacts are recorded as the reason. Returns 0. */
PRIVATE int blame(Block *b, Study *s, const int *marked, char why) {
  for (int k = 0; k < N_I; ++k)
    if (marked[k]) note_event(b, s, BLAMED, k, 0.0, 0.0, 0.0, 0, NULL, 0);
  fail_sample(b, s, 0, b->t, why);
  return 0;
}

PRIVATE int hits(const Instant *c, int k) { return c->touching[k] && c->rate[k] < -c->rest[k]; }

/* Orders of impacts at one instant. */
enum { FIRST_TO_LAST, LAST_TO_FIRST, STRONGEST };

/* Impacts in rounds, until no touching contact closes. A round has one impact for each contact that closes at its start: from
   the first contact to the last, or from the last to the first. With STRONGEST, a round has an impact only for the contact with
   the most energy. Impacts are recorded if a study is given. Returns the number of impacts plus 1, or 0 if the impacts do not
   end.

   Newton's law is applied to one impact after another, not to all contacts at once. At once, a ball that hits a row of equal
   balls would move all of them. In a real row, a wave runs through the row, and only the last ball moves. */
PRIVATE int in_turn(Instant *c, const Block *b, int order, Study *s, int ordered) {
  int number = 0, before = -1;
  memset(c->impulse, 0, sizeof c->impulse);
  memset(c->work, 0, sizeof c->work);
  /* Impulses of a round change the rates of other gaps. Contacts that begin to close because of this have their impacts in the
     next round. */
  while (number > before && number < MOST_IMPACTS) {
    int closing[SIZE(N_I)];
    double energy[SIZE(N_I)], most = 0.0;
    before = number;
    for (int k = 0; k < N_I; ++k) {
      closing[k] = hits(c, k) && c->movable[k];
      energy[k] = closing[k] ? c->rate[k] * c->rate[k] / c->D[k][k] : 0.0;
      most = fmax(most, energy[k]);
    }
    for (int k = 0; k < N_I; ++k) closing[k] = closing[k] && (order != STRONGEST || energy[k] == most);
    for (int n = 0; n < N_I; ++n) {
      const int k = order == LAST_TO_FIRST ? N_I - 1 - n : n;
      if (!closing[k] || !hits(c, k)) continue; /* an impulse of this round may have opened contact k */
      const double from = c->rate[k], to = -b->law[2 * N_I * N_V + N_I + k][0] * from;
      const double P = (to - from) / c->D[k][k];
      /* The work of an impulse is the impulse times the mean rate, without the rate of a surface that a law of time moves. */
      const double work = P * ((from + to) / 2 - b->law[2 * N_I * N_V + k][0]);
      const V L = each(P);
      if (s) note_event(b, s, IMPACT, k, from, to, work, ordered, &L, 1);
      for (int i = 0; i < N_I; ++i) c->rate[i] += c->D[i][k] * P;
      c->rate[k] = to; /* not a sum, because restitution 0 must give exactly 0 */
      c->impulse[k] += P;
      c->work[k] += work;
      ++number;
    }
  }
  return number > before ? 0 : number + 1;
}

/* The jump of velocity i by the impulses P. */
PRIVATE double jump_of(const Block *b, int i, const double *P) {
  double jump = 0.0;
  for (int k = 0; k < N_I; ++k) jump += b->law[N_I * N_V + i + N_V * k][0] * P[k];
  return jump;
}

/* Whether impacts in another order would change the velocities differently from `all`. The laws of rigid bodies do not
   determine the order. If the result depends on the order, the events record this, and there is a warning. */
PRIVATE int order_matters(const Instant *c, const Instant *all, const Block *b) {
  double size = 0.0, change = 0.0;
  for (int order = LAST_TO_FIRST; order <= STRONGEST; ++order) {
    Instant other = *c;
    in_turn(&other, b, order, NULL, 0);
    for (int i = 0; i < N_V; ++i) {
      size = fmax(size, fabs(jump_of(b, i, all->impulse)));
      change = fmax(change, fabs(jump_of(b, i, other.impulse) - jump_of(b, i, all->impulse)));
    }
  }
  return change > SAME_JUMP * size;
}

/* Changes the velocities by the impacts. Returns 0 if the sample fails. */
PRIVATE int apply_impulses(Instant *c, Block *b, Study *s) {
  Part *a = b->part;
  int immovable[SIZE(N_I)], any = 0;
  /* An impulse cannot change a gap that the constraints determine. Its effective inertia 1 / D[k][k] is infinite except for
     rounding, and is at least 1e12 times the largest inertia of the scene. */
  impulses(a->x, a->c, each(b->t), b->law);
  for (int k = 0; k < N_I; ++k) {
    double size = 0.0;
    for (int i = 0; i < N_I; ++i) {
      c->D[k][i] = 0.0;
      for (int j = 0; j < N_V; ++j) c->D[k][i] += b->law[k + N_I * j][0] * b->law[N_I * N_V + j + N_V * i][0];
    }
    for (int j = 0; j < N_V; ++j) size += pow(b->law[k + N_I * j][0] * DISPLACEMENT(b->part, j), 2.0);
    c->movable[k] = c->D[k][k] * ENERGY_OF(b->part) > SMALL * size;
  }
  /* The first trial does not record events. Each event records whether the order matters, and this is known only after all
     impacts. */
  Instant all = *c;
  const int number = in_turn(&all, b, FIRST_TO_LAST, NULL, 0), is_few = number <= MOST_NOTED;
  const int ordered = number > 2 && order_matters(c, &all, b);
  for (int k = 0; !is_few && k < N_I; ++k) {
    const V P = each(all.impulse[k]);
    if (all.impulse[k] != 0.0) note_event(b, s, IMPACT, k, c->rate[k], all.rate[k], all.work[k], ordered, &P, 1);
  }
  in_turn(c, b, FIRST_TO_LAST, is_few ? s : NULL, ordered);
  for (int k = 0; k < N_I; ++k) any |= immovable[k] = hits(c, k) && !c->movable[k];
  if (any) return blame(b, s, immovable, IMMOVABLE);
  if (!number) return blame(b, s, c->touching, UNENDING);
  for (int k = 0; N_WORK && k < N_I; ++k) a->x[place[N_X - 1]] += c->work[k];
  for (int i = 0; i < N_V; ++i) a->x[place[N_Q + i]] += jump_of(b, i, c->impulse);
  return 1;
}

/* Closes the slow contacts with forces that push. Returns 0 if these contacts depend on each other. */
PRIVATE int close_contacts(Block *b, const int *slow, const int *released) {
  Part *a = b->part;
  int closed[SIZE(N_I)], any_closed = 0;
  for (int k = 0; k < N_I; ++k) closed[k] = slow[k] && !released[k];
  /* A linear complementarity problem. It is solved by single changes of the set of closed contacts, as in pivoting methods,
     because the force in a contact depends on the other closed contacts. The contact with the strongest pull opens first. A
     contact closes only if no contact pulls. The changes end when all forces push and no open gap closes. Pulls are compared as
     accelerations over the size of their terms, because contacts of light and heavy bodies have forces of different sizes. A
     set may occur again without end, so the number of changes is limited. */
  for (int n = 0; n < 3 * N_I + 3; ++n) {
    double pull[SIZE(N_I)], most = 0.0;
    int changed = 0;
    for (int k = 0; k < N_I; ++k) a->x[place[contact_state[k]]] = each(closed[k]);
    forces(a->x, a->c, each(b->t), b->force);
    for (int k = 0; k < N_I; ++k) {
      const double force = b->force[k][0], size = b->force[2 * N_I + k][0];
      if (force * 0.0 != 0.0) return 0; /* the contacts depend on each other: their forces are not determined */
      pull[k] = closed[k] ? force / b->force[3 * N_I + k][0] / (size > 0.0 ? size : 1.0) : 0.0;
      most = fmin(most, pull[k]);
    }
    for (int k = 0; k < N_I; ++k) {
      const int opens = pull[k] == most && most < -SMALL;
      const int closes = !(most < -SMALL) && slow[k] && !closed[k] && b->force[N_I + k][0] < -SMALL * b->force[2 * N_I + k][0];
      changed |= opens || closes;
      closed[k] = (closed[k] && !opens) || closes;
    }
    if (!changed) break;
  }
  for (int k = 0; k < N_I; ++k) any_closed |= is_closed(a, k);
  if (any_closed) {
    /* A contact closes with a gap and a rate that are small, but not 0. Constraints on accelerations alone would not change the
       rate, and the gap would drift while the contact is closed. */
    held(a->x, a->c, each(b->t), a->x_new);
    memcpy(a->x, a->x_new, N_X * sizeof(V));
  }
  return 1;
}

/* Whether events follow each other without end. */
PRIVATE int is_endless(Block *b, double span) {
  /* There are two limits. A joint that closes and opens at once stays at one instant. A ball between two walls that approach
     each other bounces faster and faster, and time advances a little with each impact. */
  const int moved = b->t - b->crowd_start > CROWD_SPAN * span;
  if (moved) b->crowd_start = b->t;
  b->n_crowd = moved ? 0 : b->n_crowd + 1;
  return b->n_crowd > CROWD || ++b->n_events > MOST_EVENTS;
}

#if N_E > 0
PRIVATE double flag(const Part *a, const int *states, int k) { return a->x[place[states[k]]][0]; }

/* Whether event k would change its joint: it opens a closed joint, or closes an open joint. */
PRIVATE int is_armed(const Part *a, int k) {
  double closed = flag(a, flag_state, k);
  for (int i = 0; i < N_OTHERS; ++i) closed += other_owner[i] == k ? flag(a, other_state, i) : 0.0;
  return opens[k] == (closed > 0.5);
}

/* Opens or closes the joint of event k. */
PRIVATE void move_joint(Block *b, int k) {
  Part *a = b->part;
  a->x[place[flag_state[k]]] = each(!opens[k]);
  for (int i = 0; i < N_OTHERS; ++i)
    if (other_owner[i] == k) a->x[place[other_state[i]]] = zero();
  for (int i = 0; i < N_PLACE; ++i)
    if (place_owner[i] == k) a->x[place[place_state[i]]] = b->closing[i];
}

/* Whether the clutch of event k begins to slip before the clutch of event i. Clutches with an impact are first, then clutches
   that have just stuck, then clutches in the order of their torques above the limit, the largest first. */
PRIVATE int is_sooner(const Block *b, const int *fresh, int k, int i) {
  if (slips[k] != slips[i]) return slips[k] > slips[i];
  return fresh[k] > fresh[i] || (fresh[k] == fresh[i] && b->margin[k][0] < b->margin[i][0]);
}

/* Opens and closes joints with conditions that become true: first the joint of event `passed`, then joints with conditions that
   become true because of this. A condition that is true before its event is armed must first become false. A condition on a
   reaction is false while the joint is open, because there is no reaction. If several clutches can slip, only one begins to
   slip at a time, because the others may then stick. Clutches that stick before any impulse of this instant have a slip that is
   only an error of the step. This slip is removed by projection. Otherwise the clutches would stick again when they begin to
   slip in the other direction. Returns 0 if the sample fails. */
PRIVATE int move_joints(Block *b, Study *s, int passed, int is_first) {
  Part *a = b->part;
  const V t = each(between_stops(b, b->t));
  int fresh[N_E]; /* clutches that began to stick at this instant */
  memset(fresh, 0, sizeof fresh);
  /* A joint that opens or closes changes the margins of other joints at the same instant. All margins are evaluated again until
     no joint changes. */
  for (int n = 0; n <= 4 * N_E; ++n, passed = -1, is_first = 0) {
    int acts[N_E], any = 0, closes = 0, sticks = 0, first = -1;
    double rate[N_E], work = 0.0;
    margins(a->x, a->c, t, b->margin);
    places(a->x, a->c, t, b->closing);
    for (int k = 0; k < N_E; ++k) {
      const double off = HYSTERESIS(b->part, N_S - N_E + k), margin = b->margin[k][0];
      const int held = flag(a, holding_state, k) > 0.5, armed = is_armed(a, k);
      /* The margin of the event that the search has found is 0 except for rounding, so its sign has no meaning: this event
         always takes place. Other events have a hysteresis, within which the rate decides. */
      const int falls = margin < -off || (armed && margin <= off && b->margin[N_E + k][0] < 0.0);
      const int holds = k == passed ? !held : held ? margin <= off && (armed || !opens[k] || !by_force[k]) : falls;
      a->x[place[holding_state[k]]] = each(holds);
      rate[k] = b->margin[N_E + k][0];
      acts[k] = armed && holds && !held;
      any |= acts[k];
      closes |= acts[k] && !opens[k];
      if (acts[k] && slips[k] && (first < 0 || is_sooner(b, fresh, k, first))) first = k;
    }
    if (!any) return 1;
    for (int k = 0; k < N_E; ++k) {
      /* The condition of a clutch that must wait is reset, so that the clutch slips in a later round if its torque is still too
         large. */
      if (slips[k] && k != first) acts[k] = (a->x[place[holding_state[k]]] = zero(), 0);
      for (int i = 0; i < N_E && acts[k]; ++i) {
        const int stuck = slips[i] && !opens[k] && flag_state[i] == flag_state[k];
        fresh[i] |= stuck;
        sticks |= stuck;
      }
      if (acts[k]) move_joint(b, k);
    }
    if (sticks && is_first) {
      move_onto_constraints(a, a->x, b->t, a->x_new);
      memcpy(a->x, a->x_new, N_X * sizeof(V));
    }
    memset(b->jumped, 0, sizeof b->jumped);
    /* Joints that close at one instant have one common jump. One after another, each jump would violate the rows of the joint
       before. Margins are computed again for the rates after the jump, because the events report these margins. */
    if (closes) {
      jump(a->x, a->c, t, b->jumped);
      for (int i = 0; i < N_V; ++i) a->x[place[N_Q + i]] = b->jumped[i];
      work = b->jumped[N_V + N_ROWS][0];
      if (N_WORK) a->x[place[N_X - 1]] += work;
      margins(a->x, a->c, t, b->margin);
    }
    for (int k = 0; k < N_E; ++k) {
      if (!acts[k]) continue;
      const double after = b->margin[N_E + k][0];
      if (opens[k]) note_event(b, s, OPENS, N_I + k, rate[k], after, 0.0, 0, NULL, 0);
      else note_event(b, s, CLOSES, N_I + k, rate[k], after, work, 0, b->jumped + N_V + first_row[k], count_row[k]);
      work = opens[k] ? work : 0.0; /* the first joint records the work of the common jump */
    }
  }
  fail_sample(b, s, 0, b->t, ENDLESS);
  return 0;
}
#else
PRIVATE int move_joints(Block *b, Study *s, int passed, int is_first) {
  (void)b, (void)s, (void)passed, (void)is_first;
  return 1;
}
#endif

/* Continues after an event: contact number `contact` closes, or contact number contact - N_G opens, or the condition of a joint
   changes. `contact` is -1 if no event is known. Returns 0 if the sample fails. */
PRIVATE int meet_contacts(Block *b, Study *s, int contact) {
  Part *a = b->part;
  const double span = s->times[s->n_t - 1] - s->times[0];
  int before[SIZE(N_I)], slow[SIZE(N_I)], released[SIZE(N_I)], now[SIZE(N_I)];
  double flight = INFINITY, rounding[SIZE(N_I)];
  Instant c;
  for (int n = 0, hit = 1; hit && n < ROUNDS; ++n) { /* the next round finds clutches that slip because of impulses */
    double fastest = 0.0;
    if (!move_joints(b, s, n == 0 && contact < N_G ? contact - N_I : -1, n == 0)) return 0;
    gaps(a->x, a->c, each(b->t), b->gap);
    forces(a->x, a->c, each(b->t), b->force);
    /* A contact is included if it was closed, if its gap is 0 except for rounding, or if the search found its pass. The time of
       a pass is rounded. Within this rounding, a fast gap may change by more than its own rounding. */
    for (int k = 0; k < N_I; ++k) {
      const double slack = SMALL * b->force[2 * N_I + k][0] * b->force[3 * N_I + k][0];
      rounding[k] = ROUNDED * (LENGTH_OF(b->part) + b->gap[2 * N_I + k][0]);
      before[k] = is_closed(a, k);
      released[k] = before[k] && (contact == N_G + k || (contact >= N_G && b->force[k][0] + slack < 0.0));
      c.touching[k] = before[k] || contact == k || b->gap[k][0] <= rounding[k];
      c.rate[k] = b->gap[N_I + k][0];
      if (c.touching[k]) fastest = fmax(fastest, fabs(c.rate[k]));
    }
    /* With the rate v and the acceleration a, a gap rises by v^2 / (2 a). The contact is at rest if this is at most a rounding
       error. Otherwise a ball that comes to rest would bounce forever. It is also at rest if the rate changes the gap by less
       than its rounding in the whole run. Otherwise a row of bodies without forces, with slower and slower impacts, would never
       rest. */
    for (int k = 0; k < N_I; ++k) {
      const double slow_rate = fmax(SMALL * fastest, rounding[k] / span);
      c.rest[k] = fmax(sqrt(2.0 * rounding[k] * b->force[2 * N_I + k][0]), slow_rate);
    }
    if (!apply_impulses(&c, b, s)) return 0;
    hit = 0;
    for (int k = 0; k < N_I; ++k) hit |= N_E > 0 && c.impulse[k] != 0.0;
  }
  /* A gap that joints determine needs no contact force, and the equations would not determine such a force. */
  for (int k = 0; k < N_I; ++k) slow[k] = c.touching[k] && c.movable[k] && fabs(c.rate[k]) <= c.rest[k];
  const int closes = close_contacts(b, slow, released);
  for (int k = 0; k < N_I; ++k) now[k] = is_closed(a, k);
  if (!closes) return blame(b, s, now, DEPENDENT);
  for (int k = 0; k < N_I; ++k)
    if (now[k] && !before[k]) note_event(b, s, CLOSES, k, 0.0, 0.0, 0.0, 0, NULL, 0);
  for (int k = 0; k < N_I; ++k)
    if (before[k] && !now[k]) note_event(b, s, OPENS, k, 0.0, 0.0, 0.0, 0, NULL, 0);
  settle(b);
  for (int k = 0, i = N_S - N_G; k < N_I; ++k, ++i) {
    const double acceleration = b->force[N_I + k][0];
    if (now[k] || !c.touching[k]) continue;
    if (c.rate[k] > c.rest[k] && acceleration < 0.0) flight = fmin(flight, -2.0 * c.rate[k] / acceleration);
    if (!slow[k]) continue;
    /* The gap opens so slowly that rounding may make it negative. Without this value, the next step would end at once. */
    a->raised[i] += rounding[k];
    a->u[i] += rounding[k];
  }
  /* The flight on a parabola lasts 2 v / a. A step that is 1.5 times as long ends after the next contact. The gap has only one
     maximum in this step, so the sign of the gap at the end shows the pass. */
  b->soon = fmax(1.5 * flight, CONTACT_STEP * span);
  if (!is_endless(b, span)) return 1;
  fail_sample(b, s, 0, b->t, ENDLESS);
  return 0;
}

/* Events at the first time, and the outputs after them. Returns 0 if the sample fails. */
PRIVATE int begin_contacts(Block *b, Study *s) {
  b->crowd_start = b->t;
  b->n_events = b->n_crowd = 0;
  if (!meet_contacts(b, s, -1)) return 0;
  EACH_PART(b) outputs(a->x, a->c, each(b->t), a->y);
  return 1;
}

/* Outputs at output times that are reached, after the event at this time. Returns 0 if an output is not finite. */
PRIVATE int observe_due(Block *b, Study *s) {
  while (b->next < s->n_t && s->times[b->next] <= b->t) {
    EACH_PART(b) outputs(a->x, a->c, each(b->t), a->y);
    if (!store_outputs(b, s, b->next++, 1)) return 0;
  }
  return 1;
}
#else
PRIVATE int meet_contacts(Block *b, Study *s, int contact) { (void)b, (void)s, (void)contact; return 1; }
PRIVATE int begin_contacts(Block *b, Study *s) { (void)b, (void)s; return 1; }
PRIVATE int observe_due(Block *b, Study *s) { (void)b, (void)s; return 1; }
#endif

#endif
