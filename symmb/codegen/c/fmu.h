/* What FMI 2 and FMI 3 have in common: an instance of an FMU, over the run of scene.h.

   Value references: 0 is the time. Behind it stand parameters and inputs, outputs, states, their rates and switches. */
#ifndef FMU_H
#define FMU_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene.h"

/* Functions of FMI have all parameters that FMI gives them. */
#pragma GCC diagnostic ignored "-Wunused-parameter"
#define PRIVATE static __attribute__((unused)) /* a function that one of the versions may do without */
#define EXPORT __attribute__((visibility("default")))

#define NO_INSTANCE "the token is another one, the FMU has no model exchange, or the memory does not suffice"

typedef enum { FMI_OK, FMI_WARNING, FMI_DISCARD, FMI_ERROR, FMI_FATAL } Status;
typedef enum { IDLE, STARTING, RUNNING, FAILED } Phase;
enum { OUTPUTS = 1 + SCENE_N_P, STATES = OUTPUTS + SCENE_N_Y, RATES = STATES + SCENE_N_X, SWITCHES = RATES + SCENE_N_X };
enum { N_VALUES = SWITCHES + SCENE_N_SWITCHES };

typedef struct Instance {
  Scene *scene;
  Phase phase;
  int exchange, changed; /* whether others integrate; whether parameters have changed since they were last used */
  double t, end, tolerance;
  int logs;
  void (*log)(struct Instance *, Status, const char *text);
  void *environment, *callback; /* of the program that logs */
  char name[100];
} Instance;

PRIVATE void say(Instance *i, Status status, const char *call, const char *text) {
  char line[400];
  snprintf(line, sizeof line, "%s: %s", call, text);
  if (i->logs && i->log) i->log(i, status, line);
}

PRIVATE Status fault(Instance *i, const char *call, const char *text) {
  say(i, FMI_ERROR, call, text);
  return FMI_ERROR;
}

/* A call for something that the FMU does not have. */
PRIVATE Status refuse(Instance *i, const char *call) { return fault(i, call, "this FMU does not have it"); }

/* The run has ended by a fault. */
PRIVATE Status fail(Instance *i, const char *call) {
  char text[300];
  snprintf(text, sizeof text, "t = %g s: %s", i->t, scene_fault(i->scene));
  i->phase = FAILED;
  return fault(i, call, text);
}

PRIVATE void release(Instance *i) {
  if (!i) return;
  scene_free(i->scene);
  free(i);
}

PRIVATE Status reset(Instance *i) {
  memcpy(scene_parameters(i->scene), scene_nominal, SCENE_N_P * sizeof(double));
  i->phase = IDLE;
  i->end = scene_times[SCENE_N_T - 1];
  i->tolerance = 0.0;
  return FMI_OK;
}

PRIVATE Instance *instance_of(const char *token, int exchange) {
  Instance *i = strcmp(token ? token : "", SCENE_TOKEN) || (exchange && !SCENE_HAS_RATES) ? NULL : calloc(1, sizeof *i);
  if (i && !(i->scene = scene_new())) {
    free(i);
    return NULL;
  }
  if (i) {
    i->exchange = exchange;
    reset(i);
  }
  return i;
}

/* The times of a run, which begins at the first time of the scene: starts hold there. */
PRIVATE Status set_up(Instance *i, const char *call, int has_tolerance, double tolerance, double begin, int has_end, double end) {
  if (begin != scene_times[0]) return fault(i, call, "a run starts at the start time of the default experiment only");
  i->end = has_end ? end : scene_times[SCENE_N_T - 1];
  i->tolerance = has_tolerance ? tolerance : 0.0;
  return FMI_OK;
}

PRIVATE Status enter(Instance *i) {
  i->t = scene_times[0];
  i->phase = STARTING;
  i->changed = 1;
  return FMI_OK;
}

/* Lets the run have the parameters and inputs that were set. */
PRIVATE Status update(Instance *i, const char *call) {
  if (i->phase == FAILED) return fault(i, call, "the run has failed");
  if (!i->changed || i->phase == IDLE) return FMI_OK;
  i->changed = 0;
#if SCENE_HAS_RATES
  if (i->exchange && i->phase == RUNNING) {
    scene_renew(i->scene);
    return FMI_OK;
  }
#endif
  const int goes_on = i->phase == STARTING ? scene_start(i->scene, i->end, i->tolerance) : scene_change(i->scene);
  return goes_on ? FMI_OK : fail(i, call);
}

PRIVATE Status leave(Instance *i, const char *call) {
  const Status status = update(i, call);
  if (status == FMI_OK) i->phase = RUNNING;
  return status;
}

PRIVATE Status step(Instance *i, const char *call, double t, double length) {
  if (i->phase != RUNNING || i->exchange) return fault(i, call, "no run is under way");
  if (fabs(t - i->t) > 1e-9 * (fabs(t) + length)) return fault(i, call, "a step begins where the one before ended");
  if (!(length >= 0.0 && length < INFINITY)) return fault(i, call, "the length of a step is no number from 0 on");
  if (update(i, call) != FMI_OK) return FMI_ERROR;
  i->t = t + length;
  return scene_step(i->scene, i->t) ? FMI_OK : fail(i, call);
}

PRIVATE Status get(Instance *i, const char *call, const unsigned *reference, size_t n, double *values) {
  double x[SCENE_N_X + 1], rates[SCENE_N_X + 1], switches[SCENE_N_SWITCHES + 1];
  int has_x = 0, has_rates = 0, has_switches = 0;
  for (size_t k = 0; k < n; ++k) {
    const unsigned r = reference[k];
    if (r >= N_VALUES) return fault(i, call, "there is no such value reference");
    if (r == 0) values[k] = i->phase == IDLE ? scene_times[0] : i->t;
    else if (r < OUTPUTS) values[k] = scene_parameters(i->scene)[r - 1];
    else {
      if (update(i, call) != FMI_OK) return FMI_ERROR;
      if (i->phase == IDLE) return fault(i, call, "there are no values before the initialization");
      if (r < STATES) values[k] = scene_outputs(i->scene)[r - OUTPUTS];
      else if (r < RATES) {
        if (!has_x++) scene_states(i->scene, x);
        values[k] = x[r - STATES];
      }
#if SCENE_HAS_RATES
      else if (r < SWITCHES) {
        if (!has_rates++) scene_rates(i->scene, rates);
        values[k] = rates[r - RATES];
      } else {
        if (!has_switches++) scene_switches(i->scene, switches);
        values[k] = switches[r - SWITCHES];
      }
#endif
    }
  }
  (void)has_rates, (void)has_switches, (void)rates, (void)switches;
  return FMI_OK;
}

PRIVATE Status set(Instance *i, const char *call, const unsigned *reference, size_t n, const double *values) {
  for (size_t k = 0; k < n; ++k) {
    if (reference[k] < 1 || reference[k] >= OUTPUTS) return fault(i, call, "only parameters and inputs can be set");
    double *p = scene_parameters(i->scene) + reference[k] - 1;
    i->changed |= *p != values[k];
    *p = values[k];
  }
  return FMI_OK;
}

#if SCENE_HAS_RATES
/* The states and the time of model exchange: NULL leaves the states as they are. */
PRIVATE Status move(Instance *i, const char *call, double t, const double *x) {
  double own[SCENE_N_X + 1];
  if (i->phase != RUNNING || !i->exchange) return fault(i, call, "no run of model exchange is under way");
  if (update(i, call) != FMI_OK) return FMI_ERROR;
  scene_states(i->scene, own);
  scene_move(i->scene, i->t = t, x ? x : own);
  return FMI_OK;
}

/* A part of the values, from a reference on. */
PRIVATE Status get_part(Instance *i, const char *call, unsigned first, size_t n, double *values) {
  unsigned references[N_VALUES];
  for (unsigned k = 0; k < n && first + k < N_VALUES; ++k) references[k] = first + k;
  return first + n > N_VALUES ? fault(i, call, "there are fewer") : get(i, call, references, n, values);
}

PRIVATE Status settle_switches(Instance *i, const char *call, double *next) {
  if (update(i, call) != FMI_OK) return FMI_ERROR;
  scene_settle(i->scene);
  *next = scene_next_event(i->scene);
  return FMI_OK;
}
#else
PRIVATE Status move(Instance *i, const char *call, double t, const double *x) { return refuse(i, call); }
PRIVATE Status get_part(Instance *i, const char *call, unsigned first, size_t n, double *values) { return refuse(i, call); }
PRIVATE Status settle_switches(Instance *i, const char *call, double *next) { return *next = INFINITY, update(i, call); }
#endif

#endif
