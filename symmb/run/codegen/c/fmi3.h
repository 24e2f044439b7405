/* The functions of FMI 3.0 for co-simulation and, if states have rates, for model exchange. */
#ifndef FMI3_H
#define FMI3_H

#include <stdbool.h>
#include <stdint.h>

#include "fmu.h"

typedef unsigned Reference;
typedef void (*Log3)(void *environment, Status, const char *category, const char *text);
#define F EXPORT Status
#define ONE_VALUE "each variable has one value"
#define NOT_HAD(name, ...) F name(Instance *i, __VA_ARGS__) { return refuse(i, #name); }

static void log_3(Instance *i, Status status, const char *text) {
  ((Log3)i->callback)(i->environment, status, "logStatusError", text);
}

static Instance *new3(const char *token, bool logs, void *environment, Log3 log, int exchange) {
  Instance *i = instance_of(token, exchange);
  if (i) {
    i->logs = logs;
    i->environment = environment;
    i->callback = (void *)log;
    i->log = log ? log_3 : NULL;
  } else if (log)
    log(environment, FMI_ERROR, "logStatusError", NO_INSTANCE);
  return i;
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

F fmi3SetDebugLogging(Instance *i, bool logs, size_t n, const char *const categories[]) {
  return set_logging(i, __func__, logs);
}

EXPORT Instance *fmi3InstantiateCoSimulation(
    const char *name, const char *token, const char *resources, bool visible, bool logs, bool event_mode, bool early_return,
    const Reference intermediate[], size_t n, void *environment, Log3 log, void *intermediate_update) {
  return event_mode ? NULL : new3(token, logs, environment, log, 0);
}

EXPORT Instance *fmi3InstantiateModelExchange(
    const char *name, const char *token, const char *resources, bool visible, bool logs, void *environment, Log3 log) {
  return new3(token, logs, environment, log, 1);
}

EXPORT Instance *fmi3InstantiateScheduledExecution(
    const char *name, const char *token, const char *resources, bool visible, bool logs, void *environment, Log3 log,
    void *update, void *lock, void *unlock) {
  return NULL;
}

EXPORT void fmi3FreeInstance(Instance *i) { release(i); }
F fmi3Reset(Instance *i) { return reset(i, __func__); }
F fmi3Terminate(Instance *i) { return go(i, __func__, RUNNING, ENDED); }
F fmi3EnterInitializationMode(Instance *i, bool has_tolerance, double tolerance, double begin, bool has_end, double end) {
  const Status status = set_up(i, __func__, has_tolerance, tolerance, begin, has_end, end);
  return status == FMI_OK ? enter(i, __func__) : status;
}
F fmi3ExitInitializationMode(Instance *i) { return leave(i, __func__); }
F fmi3EnterConfigurationMode(Instance *i) { return refuse(i, __func__); }
F fmi3ExitConfigurationMode(Instance *i) { return refuse(i, __func__); }
F fmi3EnterStepMode(Instance *i) { return refuse(i, __func__); }

F fmi3DoStep(
    Instance *i, double t, double length, bool no_set_before, bool *event, bool *terminates, bool *early, double *reached) {
  const Status status = step(i, __func__, t, length);
  *event = *terminates = *early = false;
  *reached = i ? i->t : 0.0;
  return status;
}

F fmi3GetFloat64(Instance *i, const Reference r[], size_t n, double values[], size_t n_values) {
  return n_values == n ? get(i, __func__, r, n, values) : fault(i, __func__, ONE_VALUE);
}
F fmi3SetFloat64(Instance *i, const Reference r[], size_t n, const double values[], size_t n_values) {
  return n_values == n ? set(i, __func__, r, n, values) : fault(i, __func__, ONE_VALUE);
}

/* There are no variables of other types. */
#define TYPE(name, type) \
  F fmi3Get##name(Instance *i, const Reference r[], size_t n, type values[], size_t m) { \
    return n ? refuse(i, __func__) : FMI_OK; \
  } \
  F fmi3Set##name(Instance *i, const Reference r[], size_t n, const type values[], size_t m) { \
    return n ? refuse(i, __func__) : FMI_OK; \
  }
typedef const char *String;
TYPE(Float32, float)
TYPE(Int8, int8_t)
TYPE(UInt8, uint8_t)
TYPE(Int16, int16_t)
TYPE(UInt16, uint16_t)
TYPE(Int32, int32_t)
TYPE(UInt32, uint32_t)
TYPE(Int64, int64_t)
TYPE(UInt64, uint64_t)
TYPE(Boolean, bool)
TYPE(String, String)
NOT_HAD(fmi3GetBinary, const Reference r[], size_t n, size_t sizes[], const uint8_t *values[], size_t m)
NOT_HAD(fmi3SetBinary, const Reference r[], size_t n, const size_t sizes[], const uint8_t *const values[], size_t m)
NOT_HAD(fmi3GetClock, const Reference r[], size_t n, bool values[])
NOT_HAD(fmi3SetClock, const Reference r[], size_t n, const bool values[])
NOT_HAD(fmi3GetNumberOfVariableDependencies, Reference r, size_t *n)
NOT_HAD(fmi3GetVariableDependencies, Reference r, size_t d[], Reference on[], size_t e[], int kinds[], size_t n)
NOT_HAD(fmi3GetFMUState, void **state)
NOT_HAD(fmi3SetFMUState, void *state)
NOT_HAD(fmi3FreeFMUState, void **state)
NOT_HAD(fmi3SerializedFMUStateSize, void *state, size_t *size)
NOT_HAD(fmi3SerializeFMUState, void *state, uint8_t bytes[], size_t size)
NOT_HAD(fmi3DeserializeFMUState, const uint8_t bytes[], size_t size, void **state)
NOT_HAD(fmi3GetDirectionalDerivative, const Reference u[], size_t n, const Reference k[], size_t m, const double s[],
        size_t ns, double v[], size_t nv)
NOT_HAD(fmi3GetAdjointDerivative, const Reference u[], size_t n, const Reference k[], size_t m, const double s[], size_t ns,
        double v[], size_t nv)
NOT_HAD(fmi3GetIntervalDecimal, const Reference r[], size_t n, double intervals[], int qualifiers[])
NOT_HAD(fmi3GetIntervalFraction, const Reference r[], size_t n, uint64_t counters[], uint64_t resolutions[], int qualifiers[])
NOT_HAD(fmi3GetShiftDecimal, const Reference r[], size_t n, double shifts[])
NOT_HAD(fmi3GetShiftFraction, const Reference r[], size_t n, uint64_t counters[], uint64_t resolutions[])
NOT_HAD(fmi3SetIntervalDecimal, const Reference r[], size_t n, const double intervals[])
NOT_HAD(fmi3SetIntervalFraction, const Reference r[], size_t n, const uint64_t counters[], const uint64_t resolutions[])
NOT_HAD(fmi3SetShiftDecimal, const Reference r[], size_t n, const double shifts[])
NOT_HAD(fmi3SetShiftFraction, const Reference r[], size_t n, const uint64_t counters[], const uint64_t resolutions[])
NOT_HAD(fmi3GetOutputDerivatives, const Reference r[], size_t n, const int32_t orders[], double values[], size_t m)
NOT_HAD(fmi3ActivateModelPartition, Reference r, double time)

F fmi3EvaluateDiscreteStates(Instance *i) { return allow(i, __func__, STARTING | EVENT); }
F fmi3EnterEventMode(Instance *i) { return go(i, __func__, EVENT | CONTINUOUS, EVENT); }
F fmi3EnterContinuousTimeMode(Instance *i) { return to_continuous(i, __func__); }
F fmi3UpdateDiscreteStates(
    Instance *i, bool *again, bool *terminates, bool *nominals, bool *states, bool *has_next, double *next) {
  *again = *terminates = *nominals = *states = *has_next = false;
  return settle_switches(i, __func__, next) == FMI_OK ? (*has_next = *next < INFINITY, FMI_OK) : FMI_ERROR;
}
F fmi3CompletedIntegratorStep(Instance *i, bool no_set_before, bool *event, bool *terminates) {
  *event = *terminates = false;
  return allow(i, __func__, CONTINUOUS);
}
F fmi3SetTime(Instance *i, double t) { return set_time(i, __func__, t); }
F fmi3SetContinuousStates(Instance *i, const double x[], size_t n) { return set_states(i, __func__, x, n); }
F fmi3GetContinuousStates(Instance *i, double x[], size_t n) { return get_part(i, __func__, STATES, RATES, n, x); }
F fmi3GetContinuousStateDerivatives(Instance *i, double rates[], size_t n) {
  return get_part(i, __func__, RATES, SWITCHES, n, rates);
}
F fmi3GetEventIndicators(Instance *i, double values[], size_t n) {
  return get_part(i, __func__, SWITCHES, N_VALUES, n, values);
}
F fmi3GetNominalsOfContinuousStates(Instance *i, double nominals[], size_t n) {
  return get_nominals(i, __func__, nominals, n);
}
F fmi3GetNumberOfEventIndicators(Instance *i, size_t *n) {
  *n = SCENE_N_SWITCHES;
  return allow(i, __func__, ANY);
}
F fmi3GetNumberOfContinuousStates(Instance *i, size_t *n) {
  *n = SCENE_N_X;
  return allow(i, __func__, ANY);
}

#endif
