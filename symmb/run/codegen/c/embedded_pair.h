/* Steps of an embedded explicit pair, with lengths from the tolerances, and with dense output.

   Hairer, Norsett and Wanner (1993), Solving Ordinary Differential Equations I, section II.5 and code DOP853. There are three
   differences from this code. All samples of a block have the same step, so each norm is the norm of the worst lane. Steps end
   at switches, so that every step integrates smooth equations. A step is not finished until its outputs are stored, because
   projections and events change the state at its end, but the interpolant belongs to the state before.

   The generated tableau defines these functions and constants. stages(b) computes the slopes k before the end of the step, and
   x_new. errors(a, h, e5, e3) computes the estimates of orders 5 and 3. interpolant(b) computes F of the states that outputs
   need, and the state x_at of its last stage, at the fraction LAST_STAGE of the step. END is the place in k of the slope at the
   end of the step. Further constants are those of the step control. */
#ifndef EMBEDDED_PAIR_H
#define EMBEDDED_PAIR_H

#include "impacts.h"
#include "tableau.h"

enum { REJECTED, ACCEPTED, FAILED };

/* The absolute tolerances at the start of the motion. A state may stay far below the typical size of its scene. With the
   tolerance of this size, it would have few correct digits. So the tolerances of all states begin with the fraction `least` of
   their values. */
PRIVATE void begin_tolerances(Block *b, const Study *s) {
  EACH_PART(b)
    for (int i = 0; i < N_X; ++i) a->atol[place[i]] = each(s->least * s->atol[i]);
}

/* The absolute tolerances follow the largest values of the states. They never decrease. Errors made at large values remain in a
   state that passes 0. Smaller tolerances would then require digits that are already lost. */
PRIVATE void follow_sizes(Block *b, const Study *s) {
  EACH_PART(b)
    for (int i = 0; i < N_X; ++i) a->atol[i] = v_larger(a->atol[i], s->growth * v_fabs(a->x[i]));
}

/* The norm of DOP853 in each lane; NaN for lanes that are not finite.

   The estimate e5 alone is O(h^6), and e3 is O(h^4). In short steps e5^2 / sqrt(e5^2 + 0.01 e3^2) is O(h^8), like the error of
   a method of order 8. In long steps with e3 < 10 e5, the orders are not valid, and the norm is nearly e5. */
PRIVATE V error_norm(Part *a, double h, const Study *s) {
  V *e5 = a->scratch, *e3 = a->scratch + SIZE(N_X), sum5 = zero(), sum3 = zero();
  errors(a, h, e5, e3);
  for (int i = 0; i < N_X; ++i) {
    V scale = 1.0 / (a->atol[i] + s->rtol * v_larger(v_fabs(a->x[i]), v_fabs(a->x_new[i])));
    e5[i] *= scale;
    e3[i] *= scale;
    sum5 += e5[i] * e5[i];
    sum3 += e3[i] * e3[i];
  }
  V denominator = sum5 + 0.01 * sum3;
  /* Without errors, the norm would be 0 / 0. The comparison is also false for NaN, so NaN is returned. */
  return choose(denominator > 0.0, fabs(h) * sum5 / v_sqrt(denominator * (double)N_X), denominator);
}

/* The larger of two numbers, or NaN. */
PRIVATE double larger(double a, double b) { return a > b || a != a ? a : b; }

/* The length of the first step after Hairer, Norsett and Wanner, section II.4. */
PRIVATE double first_step(Block *b, const Study *s) {
  /* An Euler step h0 changes the states by 1 % of their sizes. The change of the slopes over this step estimates the second
     derivative. With h1, the larger derivative times h1^8 is 1 % of the tolerances. */
  const double span = s->times[s->n_t - 1] - b->t;
  double n0 = 0.0, n1 = 0.0, n2 = 0.0;
  EACH_PART(b) {
    V d0 = zero(), d1 = zero();
    for (int i = 0; i < N_X; ++i) {
      V scale = 1.0 / (a->atol[i] + s->rtol * v_fabs(a->x[i])), d = slope(a->x, a->k, i) * scale;
      d0 += a->x[i] * scale * a->x[i] * scale;
      d1 += d * d;
    }
    /* The norm of the worst lane is used, not of all lanes together. So a block of equal samples has the steps of one
       sample. */
    n0 = larger(sqrt(largest_lane(d0) / N_X), n0);
    n1 = larger(sqrt(largest_lane(d1) / N_X), n1);
  }
  double h0 = n0 < 1e-5 || n1 < 1e-5 ? 1e-6 : 0.01 * n0 / n1;
  h0 = h0 < span ? h0 : span;
  EACH_PART(b) {
    V *x1 = a->x_new, *k1 = a->k + N_OWN, d2 = zero();
    for (int i = 0; i < N_X; ++i) x1[i] = a->x[i] + h0 * slope(a->x, a->k, i);
    rates(x1, a->c, each(between_stops(b, b->t + h0)), k1);
    for (int i = 0; i < N_X; ++i) {
      V d = (slope(x1, k1, i) - slope(a->x, a->k, i)) / (a->atol[i] + s->rtol * v_fabs(a->x[i]));
      d2 += d * d;
    }
    n2 = larger(sqrt(largest_lane(d2) / N_X) / h0, n2);
  }
  const double most = larger(n1, n2);
  double h1 = most <= 1e-15 ? larger(1e-6, h0 * 1e-3) : pow(0.01 / most, 1.0 / 8.0);
  /* Both derivatives may be 0 by chance, for example at rest. Then h1 has no meaning, so h0 limits the step. */
  double h = 100.0 * h0 < h1 ? 100.0 * h0 : h1;
  return h < span ? h : span;
}

/* State used[u] at the fraction z of the step, by the interpolant of DOP853 (section II.6). */
PRIVATE V interpolated(const Part *a, int u, double z) {
  const V *f = a->F + 7 * u;
  const double r = 1.0 - z;
  return a->x[used[u]] + z * (f[0] + r * (f[1] + z * (f[2] + r * (f[3] + z * (f[4] + r * (f[5] + z * f[6]))))));
}

/* The error of the interpolant, divided by the largest allowed error, in the worst lane. Errors of a step do not show errors of
   its interpolant: for stiff equations, stages of an accepted step may be inaccurate. The state of the last extra stage and the
   interpolant at this stage are two estimates of the same state. Their difference costs no evaluation. */
PRIVATE double interpolation_error(Block *b, const Study *s) {
  double most = 0.0;
  EACH_PART(b) {
    V sum = zero();
    for (int u = 0; u < N_USED; ++u) {
      const int i = used[u];
      const V missed = a->x_at[i] - interpolated(a, u, LAST_STAGE);
      const V share = missed / (a->atol[i] + s->rtol * v_larger(v_fabs(a->x[i]), v_fabs(a->x_new[i])));
      sum += share * share;
    }
    most = larger(largest_lane(sum), most);
  }
  return sqrt(most / SIZE(N_USED)) / MOST_MISSED;
}

/* Stores the outputs at times in the step up to `until`, for the first n_t times. Returns 0 if an output is not finite. */
PRIVATE int sample_outputs(Block *b, Study *s, double until, long n_t) {
  /* Many times are computed at once. The coefficients of a state are loaded once for all times, and the iterations of the loop
     over times are independent. */
  while (b->next < n_t && s->times[b->next] <= until) {
    double share[CHUNK];
    long n = 0;
    for (; n < CHUNK && b->next + n < n_t && s->times[b->next + n] <= until; ++n)
      share[n] = (s->times[b->next + n] - b->t) / b->h;
    EACH_PART(b) {
      for (int u = 0; u < N_USED; ++u) {
        const V *f = a->F + 7 * u, x = a->x[used[u]];
        const V f0 = f[0], f1 = f[1], f2 = f[2], f3 = f[3], f4 = f[4], f5 = f[5], f6 = f[6];
        for (long j = 0; j < n; ++j) {
          const double z = share[j], r = 1.0 - z;
          a->x_at[j * N_X + used[u]] = x + z * (f0 + r * (f1 + z * (f2 + r * (f3 + z * (f4 + r * (f5 + z * f6))))));
        }
      }
      for (long j = 0; j < n; ++j)
        outputs(a->x_at + j * N_X, a->c, each(s->times[b->next + j]), a->y + j * N_Y);
    }
    b->next += n;
    if (!store_outputs(b, s, b->next - n, n)) return 0;
  }
  return 1;
}

/* Shortens a step with a given error. */
PRIVATE void shorten(Block *b, double error) {
  /* An infinite error or NaN does not determine a length. The memory becomes the smallest error, which multiplies the next
     length by ERROR_LEAST^MEMORY, about 0.7. So steps after a rejection grow slowly. */
  const double factor = error < 1e300 ? SAFETY * exp(-EXPONENT * log(error)) : 0.1;
  b->h *= factor > SHRINK_LEAST ? factor : SHRINK_LEAST;
  b->before = log(ERROR_LEAST);
}

/* Accepts the step or shortens it. At the shortest step, samples with an error that is too large fail. */
PRIVATE int accept_step(Block *b, Study *s, double shortest) {
  V norm[PARTS] = {{0}};
  double e = 0.0;
  EACH_PART(b) {
    norm[a - b->part] = error_norm(a, b->h, s);
    e = larger(largest_lane(norm[a - b->part]), e);
  }
  const double size = log(e), least = log(ERROR_LEAST);
  /* The comparisons treat NaN as an error that is too large. So a lane that left the domain of a function requires a shorter
     step, and its sample fails only at the shortest step. The length t_new - t of a shortest step is rounded, and may be
     slightly larger than `shortest`. */
  EACH_PART(b) a->load += v_smaller(norm[a - b->part], each(1.0)); /* 1 for NaN */
  if (++b->steps == s->most_steps) {
    fail_by_steps(b, s);
    return FAILED;
  }
  if (!(e <= 1.0) && b->h <= shortest * 1.0000001) {
    for (int l = 0; l < WIDTH; ++l)
      if (!(norm[l / W][l % W] <= 1.0)) fail_sample(b, s, l, b->t, STEPS);
    return FAILED;
  }
  if (!(e <= 1.0)) {
    shorten(b, e);
    return REJECTED;
  }
  /* Gustafsson's control: the error of the previous step damps changes of the length. The steps of a block do not depend on the
     thread that runs it, because all its data are in the block, and its samples are chosen by their numbers. */
  const double factor = SAFETY * exp((-EXPONENT + 0.2 * MEMORY) * size + MEMORY * b->before);
  b->h_next = b->h * (factor > CHANGE_MOST ? CHANGE_MOST : factor < CHANGE_LEAST ? CHANGE_LEAST : factor);
  b->before = size > least ? size : least;
  return ACCEPTED;
}

/* The slope and the first step at the start of the motion, and after each switch. */
PRIVATE void restart(Block *b, const Study *s) {
  b->before = log(ERROR_LEAST);
  EACH_PART(b) {
    /* The last slope of the previous step belongs to the other branch. So the pair cannot use it as first slope here. */
    rates(a->x, a->c, each(between_stops(b, b->t)), a->k);
    /* The tolerance of a state at rest follows from the change that its slope predicts. This change is limited by the size of
       the state, because the large slope in a short pulse does not last. */
    for (int i = 0; i < N_X; ++i) {
      const int j = place[i];
      const V to_come = s->growth * s->ahead * v_fabs(slope(a->x, a->k, j));
      a->atol[j] = v_larger(a->atol[j], v_smaller(to_come, each(s->atol[i])));
    }
  }
  b->h = first_step(b, s);
}

#define MOST_MISSES 6 /* number of shortened steps in a row that miss their passes. In bristle friction, five do */

/* Whether a shorter step replaces a step that passes a switch at its fraction z. Steps close to the shortest step are not
   replaced, because their length is hardly more than the rounding of times. */
PRIVATE int is_early(const Block *b, double z, double shortest) {
  /* Contacts that touch at the start close one after the other, and fall by less than their rounding until the end of a shortened
     step. They are passed there as exactly as in a shorter step, which might miss the pass. Later, a motion that slides along a
     switch would be moved off it. */
  return z < LATE && !(b->starting && b->shortened && b->grazes) && z * b->h > 10.0 * shortest;
}

/* Begins the run at the first time. Returns 0 if samples failed. */
PRIVATE int begin_run(Block *b, Study *s) {
  b->steps = b->shortened = b->missed = b->grazes = b->under_way = 0;
  b->starting = 1;
  if (s->n_t == 1) return 1;
  begin_tolerances(b, s);
  follow_sizes(b, s);
  const int begins = find_stop(b, s);
  settle(b);
  if (s->reach) begin_reach(b);
  if (N_E > 0 && begins && !meet_contacts(b, s, -1)) return 0;
  restart(b, s);
  return 1;
}

/* Takes a step. The step is shortened until it is accepted. Returns 0 if samples failed. */
PRIVATE int take_step(Block *b, Study *s) {
  const double end = s->times[s->n_t - 1], shortest = shortest_step(b, s);
  for (;;) {
    if (s->longest > 0.0 && b->h > s->longest) b->h = s->longest;
    if (!(b->h > shortest)) b->h = shortest;
    /* After a rebound, the step ends soon after the contact may close again. The gap has one maximum in this step, so the
       search finds the pass at once. */
    if (b->h > b->soon) b->h = b->soon;
    b->soon = INFINITY;
    const double last = b->stop_time < end ? b->stop_time : end;
    b->t_new = b->t + b->h;
    if (b->t_new >= last) b->t_new = last;
    /* The sum t + h is rounded. For a step that is short compared with its time, the length is the difference of the rounded
       times. Otherwise the last stages would not be at the start of the next step. */
    if (b->t_new == last || b->h < ROUNDED_STEP * fabs(b->t)) b->h = b->t_new - b->t;
    stages(b);
    const int verdict = accept_step(b, s, shortest);
    if (verdict == FAILED) return 0;
    if (verdict == REJECTED) continue;
    /* The slope at the end is computed only now, because a rejected step does not need it. An accepted step uses it twice: as
       first slope of the next step, and in the interpolant. */
    EACH_PART(b) rates(a->x_new, a->c, each(between_stops(b, b->t_new)), a->k + END * N_OWN);
    /* The interpolant costs three stages. It is computed only if outputs are in the step, or if a switch may be passed. */
    const int searched = may_pass(b, END), interpolates = searched || s->times[b->next] <= b->t_new;
    if (interpolates) interpolant(b);
    const double missed = interpolates ? interpolation_error(b, s) : 0.0;
    /* At the shortest step, the interpolant is accepted with any error. The errors of the step decide whether samples fail. */
    if (!(missed <= 1.0) && b->h > shortest * 1.0000001) {
      shorten(b, missed);
      continue;
    }
    /* After a pass, the stages continue the old branch, which is no motion there. The interpolant of a long step is least exact
       in its middle, and the state at an early pass would have this error. So an early pass is found roughly, and a step to
       just after the pass replaces the step. The pass is then found again near the end of this step, where interpolants are as
       exact as steps. The rough search examines only the ends of the step. It is omitted in a shortened step, because its pass
       must be the first pass. If several shortened steps miss their passes, for example because they move the state by less
       than its rounding, the next step is not replaced. Otherwise short steps could follow each other without end. */
    const double rough = searched && !b->shortened && b->missed < MOST_MISSES ? rough_pass(b) : 2.0;
    b->pass = !searched ? 2.0 : is_early(b, rough, shortest) ? rough : first_pass(b);
    if (b->missed < MOST_MISSES && is_early(b, b->pass, shortest)) {
      b->shortened = 1;
      b->h *= b->pass * BEYOND; /* the pass must be within the shorter step, although this interpolant has an error */
      continue;
    }
    b->missed = b->shortened && b->pass > 1.0 ? b->missed + 1 : 0;
    b->starting &= b->shortened || b->pass <= 1.0;
    b->shortened = 0;
    if (b->pass <= 1.0) b->t_new = b->t + b->pass * b->h;
    const int jumps = N_E > 0 && b->t_new >= b->stop_time; /* laws of time and margins of joints may jump there */
    b->contact = contact_at(b, b->pass);
    b->meets = N_G > 0 && (b->contact >= 0 || jumps || b->t_new >= end);
    return b->under_way = 1;
  }
}

/* Moves the block to the end of its step, and computes the events there. Returns 0 if samples failed. */
PRIVATE int finish_step(Block *b, Study *s) {
  const double z = b->pass;
  const int contact = b->contact;
  b->under_way = 0;
  if (s->reach) extend_reach(b, z, END);
  /* The sides of passed switches change first. Then the projection follows, which may move the state over a switch again:
     raise_switches and settle choose the sides after it. Events of contacts are last, because their jumps of velocities must
     start from a state that satisfies its constraints. */
  if (z <= 1.0 && !change_sides(b, s, z)) return 0;
  EACH_PART(b) {
    /* The next step uses the slope before the projection. It differs from the slope after the projection only by the error of
       this step. A new evaluation would cost as much as a stage. */
    memcpy(a->k, a->k + END * N_OWN, N_OWN * sizeof(V));
    move_onto_constraints(a, a->x_new, b->t_new, a->x);
  }
  follow_sizes(b, s);
  b->t = b->t_new;
  b->h = b->h_next;
  const int at_stop = b->t >= b->stop_time && find_stop(b, s);
  if (z <= 1.0) raise_switches(b);
  if (at_stop) settle(b);
  if (b->meets && !(meet_contacts(b, s, contact) && observe_due(b, s))) return 0;
  /* After a switch, earlier slopes do not predict the length of the next step. After an event of a contact, the length is kept,
     because the motion between impacts is as smooth as before, and a restart for each impact would be expensive. Only the slope
     at the end is evaluated again, because the velocities have jumped. */
  if (at_stop || (z <= 1.0 && contact < 0)) restart(b, s);
  else if (contact < 0) keep_switches(b);
  else EACH_PART(b) rates(a->x, a->c, each(between_stops(b, b->t)), a->k);
  return 1;
}

/* Runs the block until it has its first n outputs. The last step may end after these times, and is then not finished: its end
   may wait for later times. Returns 0 if samples failed. */
PRIVATE int run_until(Block *b, Study *s, long n) {
  for (;;) {
    if (b->under_way) {
      /* Outputs at the time of an event have their values after the event. meet_contacts and observe_due compute these. The
         interpolant gives only the outputs before that time. */
      if (!sample_outputs(b, s, b->meets ? nextafter(b->t_new, -INFINITY) : b->t_new, n)) return 0;
      if (b->next >= n) return 1;
      if (!finish_step(b, s)) return 0;
    }
    if (b->next >= n) return 1;
    if (!take_step(b, s)) return 0;
  }
}

/* State i of a part at time t, up to which the block has its outputs. In a single run, outputs need all states, so state i has
   the coefficients with number i. */
PRIVATE V state_of(const Block *b, const Part *a, int i, double t) {
  return b->under_way ? interpolated(a, i, (t - b->t) / b->h) : a->x[i];
}

/* Continues from that time with other parameters. Returns 0 if samples failed. */
PRIVATE int go_on_with(Block *b, Study *s, double t) {
  /* The present step continues after t with the old parameters. It is not used further. The motion continues from the state of
     its interpolant at t. */
  EACH_PART(b) {
    for (int i = 0; i < N_X; ++i) a->x_new[i] = state_of(b, a, i, t);
    memcpy(a->x, a->x_new, N_X * sizeof(V));
  }
  if (!reach_constraints(b, s, t)) return 0;
  b->t = t;
  b->under_way = b->shortened = b->missed = 0;
  b->soon = INFINITY;
  /* Parameters also move switches of time, so the search for the next switch starts with the first switch. */
  memset(b->stop, 0, sizeof b->stop);
  find_stop(b, s);
  follow_sizes(b, s);
  settle(b);
  if (!meet_contacts(b, s, -1)) return 0;
  restart(b, s);
  return 1;
}

/* Runs the block from the first time to the last. Returns 0 if samples failed. */
PRIVATE int run(Block *b, Study *s) {
  if (!begin_run(b, s) || !run_until(b, s, s->n_t) || (b->under_way && !finish_step(b, s))) return 0;
  store_reach(b, s);
  return 1;
}

#endif
