/* One run of one sample: the functions of scene.h. A block of one lane advances from one requested time to the next. */
#ifndef ONE_RUN_H
#define ONE_RUN_H

#include <stdlib.h>

#include "begin.h"
#include "scene.h"
#include "step_control.h"

struct Scene {
  Study study;
  Block block;
  double stops[SIZE(STOPS_AT_MOST)];
  double t, p[SIZE(SCENE_N_P)], times[3], Y[3 * SIZE(N_Y)], t_failed, x_failed[SIZE(N_X)], atol[SIZE(N_X)];
  char failure;
  const char *fault;
};

Scene *scene_new(void) {
  Scene *scene = aligned_alloc(64, (sizeof(Scene) + 63) / 64 * 64);
  if (!scene) return NULL;
  memset(scene, 0, sizeof *scene);
  memcpy(scene->p, scene_nominal, SCENE_N_P * sizeof(double));
  return scene;
}

void scene_free(Scene *scene) { free(scene); }
double *scene_parameters(Scene *scene) { return scene->p; }
const double *scene_outputs(const Scene *scene) { return scene->Y + N_Y; }
const char *scene_fault(const Scene *scene) { return scene->fault; }

/* Returns whether the run continues. If it does not, the reason is stored. */
static int note_fault(Scene *scene, int goes_on) {
  if (!goes_on) scene->fault = faults[1 + scene->failure];
  return goes_on;
}

/* The outputs at the state of the block. */
static void note_outputs(Scene *scene) {
  Part *a = scene->block.part;
  outputs(a->x, a->c, each(scene->t), a->y);
  for (int i = 0; i < N_Y; ++i) scene->Y[N_Y + i] = a->y[i][0];
}

#if N_TIMES > 0
static int compare_times(const void *a, const void *b) {
  const double one = *(const double *)a, other = *(const double *)b;
  return (one > other) - (one < other);
}
#endif

/* The times at which steps end, in order. Times that differ by rounding become equal, because no step fits between them. */
static void find_stops(Scene *scene) {
  memcpy(scene->stops, stops, N_STOPS * sizeof(double));
#if N_TIMES > 0
  Part *a = scene->block.part;
  V values[2 * N_TIMES];
  const double *knot = knots;
  long n = N_STOPS;
  time_switches(a->x, a->c, zero(), values);
  for (int k = 0; k < N_TIMES; ++k)
    for (int j = 0; j < (n_knots[k] ? n_knots[k] : 1); ++j) {
      const double time = ((n_knots[k] ? *knot++ : 0.0) - values[k][0]) / values[N_TIMES + k][0];
      scene->stops[n++] = time >= scene_times[0] ? time : INFINITY;
    }
  qsort(scene->stops, STOPS_AT_MOST, sizeof(double), compare_times);
  for (long i = 1; i < STOPS_AT_MOST; ++i)
    if (scene->stops[i] - scene->stops[i - 1] <= 8.0 * 2.220446049250313e-16 * fabs(scene->stops[i])) scene->stops[i] = scene->stops[i - 1];
#endif
}

int scene_start(Scene *scene, double end, double tolerance) {
  const double begin_time = scene_times[0], factor = tolerance > 0.0 && RTOL > 0.0 ? tolerance / RTOL : 1.0;
  Study *s = &scene->study;
  for (int i = 0; i < N_X; ++i) scene->atol[i] = factor * absolute[i];
  *s = (Study){.p = scene->p, .times = scene->times, .n = 1, .n_t = 3, .rtol = factor * RTOL, .growth = factor * ATOL_GROWTH,
               .ahead = ATOL_AHEAD, .least = ATOL_LEAST, .atol = scene->atol, .longest = LONGEST, .newton = NEWTON_CHANGE,
               .most_steps = STEPS_AT_MOST, .t_failed = &scene->t_failed, .failure = &scene->failure,
               .x_failed = scene->x_failed, .Y = scene->Y, .stops = STOPS_AT_MOST ? scene->stops : NULL, .n_stops = STOPS_AT_MOST};
  memset(&scene->block, 0, sizeof scene->block);
  scene->t = scene->times[0] = begin_time;
  scene->times[1] = scene->times[2] = end > begin_time ? end : begin_time + 1.0;
  scene->t_failed = NAN;
  scene->fault = faults[0];
  if (!begin(&scene->block, s)) return 0;
  find_stops(scene);
  if (!note_fault(scene, begin_run(&scene->block, s))) return 0;
  memcpy(scene->Y + N_Y, scene->Y, N_Y * sizeof(double));
  return 1;
}

int scene_step(Scene *scene, double t) {
  Block *b = &scene->block;
  if (!(t > scene->t)) return 1;
  if (N_STOPS > 0 && t > scene_times[SCENE_N_T - 1] + 1e-9 * (t - scene_times[0])) {
    scene->fault = "sampled values are known until the last time of the scene only";
    return 0;
  }
  scene->times[1] = t;
  if (t > scene->times[2]) scene->times[2] = t;
  b->next = 1;
  b->steps = 0;
  if (!note_fault(scene, run_until(b, &scene->study, 2))) return 0;
  scene->t = t;
  return 1;
}

static void take_parameters(Scene *scene) {
  Part *a = scene->block.part;
  for (int i = 0; i < SCENE_N_P; ++i) a->p[i] = each(scene->p[i]);
  prepare(a->p, a->c);
}

int scene_change(Scene *scene) {
  Block *b = &scene->block;
  take_parameters(scene);
  find_stops(scene);
  if (!note_fault(scene, go_on_with(b, &scene->study, scene->t))) return 0;
  note_outputs(scene);
  return 1;
}

void scene_states(const Scene *scene, double *x) {
  for (int i = 0; i < SCENE_N_X; ++i) x[i] = state_of(&scene->block, scene->block.part, place[i], scene->t)[0];
}

#if SCENE_HAS_RATES
/* The part of the run. Its x_at is the state at the present time. */
static Part *at_time(Scene *scene) {
  Part *a = scene->block.part;
  for (int i = 0; i < N_X; ++i) a->x_at[i] = state_of(&scene->block, a, i, scene->t);
  return a;
}

void scene_move(Scene *scene, double t, const double *x) {
  scene->t = scene->block.t = t;
  scene->block.under_way = 0;
  for (int i = 0; i < SCENE_N_X; ++i) scene->block.part->x[place[i]] = each(x[i]);
  note_outputs(scene);
}

void scene_renew(Scene *scene) {
  take_parameters(scene);
  note_outputs(scene);
}

void scene_rates(Scene *scene, double *out) {
  Part *a = at_time(scene);
  rates(a->x_at, a->c, each(between_stops(&scene->block, scene->t)), a->scratch);
  for (int i = 0; i < SCENE_N_X; ++i) out[i] = slope(a->x_at, a->scratch, place[i])[0];
}

void scene_switches(Scene *scene, double *out) {
#if N_S > 0
  Part *a = at_time(scene);
  switches(a->x_at, a->c, each(scene->t), a->u_at);
  for (int k = 0; k < N_S; ++k) out[k] = a->u_at[k][0];
#else
  (void)scene, (void)out;
#endif
}

double scene_next_event(const Scene *scene) { return scene->block.stop_time; }

void scene_settle(Scene *scene) {
  memset(scene->block.stop, 0, sizeof scene->block.stop);
  find_stop(&scene->block, &scene->study);
  settle(&scene->block);
  note_outputs(scene);
}
#endif

#endif
