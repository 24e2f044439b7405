/* The common part of FMI 2 and FMI 3: an instance of an FMU, which uses the run of scene.h.

   Value references: 0 is the time. Then follow parameters and inputs, outputs, states, their rates and switches. */
#ifndef FMU_H
#define FMU_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene.h"

/* Functions of FMI must have all parameters of the standard, also unused ones. */
#pragma GCC diagnostic ignored "-Wunused-parameter"
#define PRIVATE static __attribute__((unused)) /* a function that one of the versions may not use */
#define EXPORT __attribute__((visibility("default")))

#define NO_INSTANCE "the token does not match, the FMU has no model exchange, or there is not enough memory"

typedef enum { FMI_OK, FMI_WARNING, FMI_DISCARD, FMI_ERROR, FMI_FATAL } Status;
/* Sets of phases are sums. A run of co-simulation is STEPPING; one of model exchange is at an EVENT or CONTINUOUS. */
typedef enum { IDLE = 1, STARTING = 2, EVENT = 4, CONTINUOUS = 8, STEPPING = 16, ENDED = 32, FAILED = 64 } Phase;
enum { RUNNING = EVENT | CONTINUOUS | STEPPING, ANY = 127 };
enum { OUTPUTS = 1 + SCENE_N_P, STATES = OUTPUTS + SCENE_N_Y, RATES = STATES + SCENE_N_X, SWITCHES = RATES + SCENE_N_X };
enum { N_VALUES = SWITCHES + SCENE_N_SWITCHES };

typedef struct Instance {
  Scene *scene;
  Phase phase;
  int exchange, changed; /* whether the importing program integrates; whether parameters have changed since their last use */
  double t, end, tolerance;
  int logs;
  void (*log)(struct Instance *, Status, const char *text);
  void *environment, *callback; /* for log messages */
  char name[100];
} Instance;

PRIVATE void say(Instance *i, Status status, const char *call, const char *text) {
  char line[400];
  snprintf(line, sizeof line, "%s: %s", call, text);
  if (i && i->logs && i->log) i->log(i, status, line);
}

PRIVATE Status fault(Instance *i, const char *call, const char *text) {
  say(i, FMI_ERROR, call, text);
  return FMI_ERROR;
}

/* Whether a call is allowed in the present phase. */
PRIVATE Status allow(Instance *i, const char *call, int phases) {
  return i && i->phase & phases ? FMI_OK : fault(i, call, "this function is not allowed in this state");
}

/* Changes the phase, if the instance is in one of the phases `from`. */
PRIVATE Status go(Instance *i, const char *call, int from, Phase to) {
  if (allow(i, call, from) != FMI_OK) return FMI_ERROR;
  i->phase = to;
  return FMI_OK;
}

/* Reports a function that the FMU does not support. */
PRIVATE Status refuse(Instance *i, const char *call) { return fault(i, call, "this FMU does not support this function"); }

/* Reports the fault that has ended the run. */
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

PRIVATE Status reset(Instance *i, const char *call) {
  if (go(i, call, ANY, IDLE) != FMI_OK) return FMI_ERROR;
  memcpy(scene_parameters(i->scene), scene_nominal, SCENE_N_P * sizeof(double));
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
    i->phase = IDLE;
    reset(i, __func__);
  }
  return i;
}

/* Sets the times of a run. A run begins at the first time of the scene, because consistent starts are computed there. */
PRIVATE Status set_up(Instance *i, const char *call, int has_tolerance, double tolerance, double begin, int has_end, double end) {
  if (allow(i, call, IDLE) != FMI_OK) return FMI_ERROR;
  if (begin != scene_times[0]) return fault(i, call, "the start time must be that of the default experiment");
  i->end = has_end ? end : scene_times[SCENE_N_T - 1];
  i->tolerance = has_tolerance ? tolerance : 0.0;
  return FMI_OK;
}

PRIVATE Status enter(Instance *i, const char *call) {
  if (go(i, call, IDLE, STARTING) != FMI_OK) return FMI_ERROR;
  i->t = scene_times[0];
  i->changed = 1;
  return FMI_OK;
}

/* Passes new values of parameters and inputs to the run. */
PRIVATE Status update(Instance *i, const char *call) {
  if (i->phase == FAILED) return fault(i, call, "the run has failed");
  if (!i->changed || i->phase == IDLE) return FMI_OK;
  i->changed = 0;
#if SCENE_HAS_RATES
  if (i->exchange && i->phase & RUNNING) {
    scene_renew(i->scene);
    return FMI_OK;
  }
#endif
  const int goes_on = i->phase == STARTING ? scene_start(i->scene, i->end, i->tolerance) : scene_change(i->scene);
  return goes_on ? FMI_OK : fail(i, call);
}

PRIVATE Status leave(Instance *i, const char *call) {
  if (allow(i, call, STARTING) != FMI_OK || update(i, call) != FMI_OK) return FMI_ERROR;
  i->phase = i->exchange ? EVENT : STEPPING;
  return FMI_OK;
}

PRIVATE Status step(Instance *i, const char *call, double t, double length) {
  if (allow(i, call, STEPPING) != FMI_OK) return FMI_ERROR;
  if (!(isfinite(t) && fabs(t - i->t) <= 1e-9 * (fabs(t) + length))) return fault(i, call, "a step must begin at the end of the previous step");
  if (!(length >= 0.0 && length < INFINITY)) return fault(i, call, "the length of a step must be a finite number of at least 0");
  if (update(i, call) != FMI_OK) return FMI_ERROR;
  i->t = t + length;
  return scene_step(i->scene, i->t) ? FMI_OK : fail(i, call);
}

PRIVATE Status get(Instance *i, const char *call, const unsigned *reference, size_t n, double *values) {
  double x[SCENE_N_X + 1], rates[SCENE_N_X + 1], switches[SCENE_N_SWITCHES + 1];
  int has_x = 0, has_rates = 0, has_switches = 0;
  if (allow(i, call, ANY) != FMI_OK) return FMI_ERROR;
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
  if (allow(i, call, IDLE | STARTING | RUNNING) != FMI_OK) return FMI_ERROR;
  for (size_t k = 0; k < n; ++k) {
    if (reference[k] < 1 || reference[k] >= OUTPUTS) return fault(i, call, "only parameters and inputs can be set");
    double *p = scene_parameters(i->scene) + reference[k] - 1;
    i->changed |= *p != values[k];
    *p = values[k];
  }
  return FMI_OK;
}

#if SCENE_HAS_RATES
/* The time of model exchange. */
PRIVATE Status set_time(Instance *i, const char *call, double t) {
  double x[SCENE_N_X + 1];
  if (allow(i, call, EVENT | CONTINUOUS) != FMI_OK || update(i, call) != FMI_OK) return FMI_ERROR;
  if (!isfinite(t)) return fault(i, call, "the time is not a finite number");
  scene_states(i->scene, x);
  scene_move(i->scene, i->t = t, x);
  return FMI_OK;
}

PRIVATE Status set_states(Instance *i, const char *call, const double *x, size_t n) {
  if (allow(i, call, EVENT | CONTINUOUS) != FMI_OK || update(i, call) != FMI_OK) return FMI_ERROR;
  if (n != SCENE_N_X) return fault(i, call, "the FMU has a different number of states");
  scene_move(i->scene, i->t, x);
  return FMI_OK;
}

/* Values of the references from `first` up to, but not including, `end`. */
PRIVATE Status get_part(Instance *i, const char *call, unsigned first, unsigned end, size_t n, double *values) {
  unsigned references[N_VALUES];
  if (allow(i, call, ANY) != FMI_OK) return FMI_ERROR;
  if (!i->exchange) return refuse(i, call);
  if (n != end - first) return fault(i, call, "the FMU has a different number of these values");
  for (unsigned k = 0; k < n; ++k) references[k] = first + k;
  return get(i, call, references, n, values);
}

PRIVATE Status settle_switches(Instance *i, const char *call, double *next) {
  if (allow(i, call, EVENT) != FMI_OK || update(i, call) != FMI_OK) return FMI_ERROR;
  scene_settle(i->scene);
  *next = scene_next_event(i->scene);
  return FMI_OK;
}
#else
PRIVATE Status set_time(Instance *i, const char *call, double t) { return refuse(i, call); }
PRIVATE Status set_states(Instance *i, const char *call, const double *x, size_t n) { return refuse(i, call); }
PRIVATE Status get_part(Instance *i, const char *call, unsigned first, unsigned end, size_t n, double *values) {
  return refuse(i, call);
}
PRIVATE Status settle_switches(Instance *i, const char *call, double *next) { return *next = INFINITY, refuse(i, call); }
#endif

PRIVATE Status get_nominals(Instance *i, const char *call, double *nominals, size_t n) {
  if (n != SCENE_N_X) return fault(i, call, "the FMU has a different number of states");
  for (size_t k = 0; k < n; ++k) nominals[k] = 1.0;
  return allow(i, call, ANY);
}

PRIVATE Status to_continuous(Instance *i, const char *call) {
  return allow(i, call, EVENT) == FMI_OK && update(i, call) == FMI_OK ? go(i, call, EVENT, CONTINUOUS) : FMI_ERROR;
}

PRIVATE Status set_logging(Instance *i, const char *call, int logs) {
  if (allow(i, call, ANY) != FMI_OK) return FMI_ERROR;
  i->logs = logs;
  return FMI_OK;
}

#endif
