/* The functions of FMI 2.0 for co-simulation and, if states have rates, for model exchange. */
#ifndef FMI2_H
#define FMI2_H

#include "fmu.h"

typedef unsigned Reference;
typedef int Boolean;
typedef struct {
  void (*log)(void *environment, const char *name, Status, const char *category, const char *text, ...);
  void *(*allocate)(size_t n, size_t size);
  void (*free)(void *);
  void (*step_finished)(void *environment, Status);
  void *environment;
} Callbacks;
typedef struct {
  Boolean again, terminates, nominals, states, has_next;
  double next;
} EventInfo;
#define F EXPORT Status
#define NOT_HAD(name, ...) F name(Instance *i, __VA_ARGS__) { return refuse(i, #name); }

static void log_2(Instance *i, Status status, const char *text) {
  const Callbacks *c = i->callback;
  c->log(c->environment, i->name, status, "logStatusError", "%s", text);
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

F fmi2SetDebugLogging(Instance *i, Boolean logs, size_t n, const char *const categories[]) {
  return set_logging(i, __func__, logs);
}

EXPORT Instance *fmi2Instantiate(
    const char *name, int type, const char *guid, const char *resources, const Callbacks *callbacks, Boolean visible,
    Boolean logs) {
  const int exchange = type == 0;
  Instance *i = instance_of(guid, exchange);
  const int can_log = callbacks && callbacks->log;
  if (!i) {
    if (can_log)
      callbacks->log(callbacks->environment, name, FMI_ERROR, "logStatusError", NO_INSTANCE);
    return NULL;
  }
  i->logs = logs;
  i->callback = (void *)callbacks;
  i->log = can_log ? log_2 : NULL;
  snprintf(i->name, sizeof i->name, "%s", name ? name : "");
  return i;
}

EXPORT void fmi2FreeInstance(Instance *i) { release(i); }
F fmi2Reset(Instance *i) { return reset(i, __func__); }
F fmi2Terminate(Instance *i) { return go(i, __func__, RUNNING, ENDED); }
F fmi2SetupExperiment(Instance *i, Boolean has_tolerance, double tolerance, double begin, Boolean has_end, double end) {
  return set_up(i, __func__, has_tolerance, tolerance, begin, has_end, end);
}
F fmi2EnterInitializationMode(Instance *i) { return enter(i, __func__); }
F fmi2ExitInitializationMode(Instance *i) { return leave(i, __func__); }

F fmi2GetReal(Instance *i, const Reference r[], size_t n, double values[]) { return get(i, __func__, r, n, values); }
F fmi2SetReal(Instance *i, const Reference r[], size_t n, const double values[]) { return set(i, __func__, r, n, values); }

/* There are no variables of other types. */
#define TYPE(name, type) \
  F fmi2Get##name(Instance *i, const Reference r[], size_t n, type values[]) { return n ? refuse(i, __func__) : FMI_OK; } \
  F fmi2Set##name(Instance *i, const Reference r[], size_t n, const type values[]) { return n ? refuse(i, __func__) : FMI_OK; }
typedef const char *String;
TYPE(Integer, int)
TYPE(Boolean, Boolean)
TYPE(String, String)
NOT_HAD(fmi2GetFMUstate, void **state)
NOT_HAD(fmi2SetFMUstate, void *state)
NOT_HAD(fmi2FreeFMUstate, void **state)
NOT_HAD(fmi2SerializedFMUstateSize, void *state, size_t *size)
NOT_HAD(fmi2SerializeFMUstate, void *state, char bytes[], size_t size)
NOT_HAD(fmi2DeSerializeFMUstate, const char bytes[], size_t size, void **state)
NOT_HAD(fmi2GetDirectionalDerivative, const Reference u[], size_t n, const Reference k[], size_t m, const double s[],
        double v[])

F fmi2DoStep(Instance *i, double t, double length, Boolean no_set_before) { return step(i, __func__, t, length); }
F fmi2CancelStep(Instance *i) { return refuse(i, __func__); }
NOT_HAD(fmi2SetRealInputDerivatives, const Reference r[], size_t n, const int orders[], const double values[])
NOT_HAD(fmi2GetRealOutputDerivatives, const Reference r[], size_t n, const int orders[], double values[])
NOT_HAD(fmi2GetStatus, int kind, Status *value)
NOT_HAD(fmi2GetIntegerStatus, int kind, int *value)
NOT_HAD(fmi2GetStringStatus, int kind, String *value)
F fmi2GetRealStatus(Instance *i, int kind, double *value) {
  *value = i ? i->t : 0.0;
  return allow(i, __func__, ANY);
}
F fmi2GetBooleanStatus(Instance *i, int kind, Boolean *value) {
  *value = 0;
  return allow(i, __func__, ANY);
}

F fmi2EnterEventMode(Instance *i) { return go(i, __func__, EVENT | CONTINUOUS, EVENT); }
F fmi2EnterContinuousTimeMode(Instance *i) { return to_continuous(i, __func__); }
F fmi2NewDiscreteStates(Instance *i, EventInfo *info) {
  *info = (EventInfo){0};
  const Status status = settle_switches(i, __func__, &info->next);
  info->has_next = info->next < INFINITY;
  return status;
}
F fmi2CompletedIntegratorStep(Instance *i, Boolean no_set_before, Boolean *event, Boolean *terminates) {
  *event = *terminates = 0;
  return allow(i, __func__, CONTINUOUS);
}
F fmi2SetTime(Instance *i, double t) { return set_time(i, __func__, t); }
F fmi2SetContinuousStates(Instance *i, const double x[], size_t n) { return set_states(i, __func__, x, n); }
F fmi2GetContinuousStates(Instance *i, double x[], size_t n) { return get_part(i, __func__, STATES, RATES, n, x); }
F fmi2GetDerivatives(Instance *i, double rates[], size_t n) {
  return get_part(i, __func__, RATES, SWITCHES, n, rates);
}
F fmi2GetEventIndicators(Instance *i, double values[], size_t n) {
  return get_part(i, __func__, SWITCHES, N_VALUES, n, values);
}
F fmi2GetNominalsOfContinuousStates(Instance *i, double nominals[], size_t n) {
  return get_nominals(i, __func__, nominals, n);
}

#endif
