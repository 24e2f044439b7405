"""Calls of an exported FMU in random orders, by a program of C under sanitizers, against the phases of FMI's standard."""

# ruff: noqa: E501  (a program of C)

import re
import subprocess
import zipfile
from pathlib import Path

import symmb as mb

SANITIZED = "-std=gnu11 -O0 -g -w -fsanitize=address,undefined -fno-sanitize-recover=all".split()
DRIVER = r"""
#include "fmi.c"
#include <sys/time.h>
#if VERSION == 2
#define CALL(two, three) two
#else
#define CALL(two, three) three
#endif
enum { EITHER = EVENT | CONTINUOUS, LIVE = RUNNING | ENDED };
static unsigned long long state;
static unsigned draw(unsigned n) { return state = state * 6364136223846793005ull + 1442695040888963407ull, (state >> 33) % n; }
static double uniform(void) { return draw(1 << 30) / (double)(1 << 30); }
static const double odd[] = {NAN, INFINITY, -INFINITY, 1e300, -1e300, 1e-300, -1.0, 0.0};
static int nonsense; /* a value was no plain one since the last reset: a run may fail */
static double value(double plain) { return draw(12) ? plain : (nonsense = 1, odd[draw(8)]); }
static const char *name;

/* Makes one call; `legal` and `next` tell the phases in which it may come and the one behind it, 0 for the same. */
static Status make(Instance *i, int exchange, int call, int *legal, int *next) {
  double y[N_VALUES + 2], x[SCENE_N_X + 1];
  unsigned r[N_VALUES + 2];
  Boolean_ b[5];
  const double h = (scene_times[SCENE_N_T - 1] - scene_times[0]) / 50;
  *next = 0;
#define IS(phases, then) (name = #phases " -> " #then, *legal = (phases), *next = (then))
  switch (call) {
    case 0: IS(ANY, IDLE); nonsense = 0; return CALL(fmi2Reset(i), fmi3Reset(i));
    case 1: {
      const double begin = draw(8) ? scene_times[0] : value(scene_times[0] + 1);
      const double tolerance = value(1e-6), end = value(scene_times[SCENE_N_T - 1]);
      const int right = begin == scene_times[0], has_end = draw(2), has_tolerance = draw(2);
#if VERSION == 2
      IS(right ? IDLE : 0, 0);
      return fmi2SetupExperiment(i, has_tolerance, tolerance, begin, has_end, end);
#else
      IS(right ? IDLE : 0, STARTING);
      return fmi3EnterInitializationMode(i, has_tolerance, tolerance, begin, has_end, end);
#endif
    }
#if VERSION == 2
    case 2: IS(IDLE, STARTING); return fmi2EnterInitializationMode(i);
#endif
    case 3: IS(STARTING, exchange ? EVENT : STEPPING); return CALL(fmi2ExitInitializationMode(i), fmi3ExitInitializationMode(i));
    case 4: {
      const double t = value(i->t), length = value(h * uniform());
      IS(isfinite(t) && length >= 0 && length < INFINITY ? STEPPING : 0, 0);
      if (length > 2 * h) nonsense = 1;
      return CALL(fmi2DoStep(i, t, length, 1), fmi3DoStep(i, t, length, 1, b, b + 1, b + 2, y));
    }
    case 5: case 6: {
      const int n = draw(N_VALUES + 2);
      IS(STARTING | LIVE, 0);
      for (int k = 0; k < n; ++k) {
        r[k] = draw(N_VALUES + (draw(20) == 0));
        if (r[k] >= N_VALUES) *legal = 0;
      }
      if (!n || call == 6) r[0] = 0, *legal = STARTING | LIVE;
      const int m = call == 6 ? 1 : n;
      for (int k = 0, plain = 1; k < m; ++k) if (plain &= r[k] < OUTPUTS, plain && k == m - 1) *legal = ANY;
      if (!m) *legal = ANY;
      return CALL(fmi2GetReal(i, r, m, y), fmi3GetFloat64(i, r, m, y, m));
    }
    case 7: {
      if (!SCENE_N_P) return IS(0, 0), FMI_ERROR;
      r[0] = 1 + draw(SCENE_N_P);
      y[0] = value(scene_nominal[r[0] - 1] * (1 + 1e-3 * uniform()));
      IS(IDLE | STARTING | RUNNING, 0);
      return CALL(fmi2SetReal(i, r, 1, y), fmi3SetFloat64(i, r, 1, y, 1));
    }
    case 8: IS(0, 0), r[0] = OUTPUTS; return CALL(fmi2SetReal(i, r, 1, y), fmi3SetFloat64(i, r, 1, y, 1));
    case 9: IS(RUNNING, ENDED); return CALL(fmi2Terminate(i), fmi3Terminate(i));
    case 10: IS(EITHER, EVENT); return CALL(fmi2EnterEventMode(i), fmi3EnterEventMode(i));
    case 11: IS(EVENT, CONTINUOUS); return CALL(fmi2EnterContinuousTimeMode(i), fmi3EnterContinuousTimeMode(i));
    case 12: {
      IS(EVENT, 0);
#if VERSION == 2
      EventInfo info;
      return fmi2NewDiscreteStates(i, &info);
#else
      return fmi3UpdateDiscreteStates(i, b, b + 1, b + 2, b + 3, b + 4, y);
#endif
    }
    case 13: {
      const double t = value(i->t + h * (uniform() - 0.3));
      IS(isfinite(t) ? EITHER : 0, 0);
      return CALL(fmi2SetTime(i, t), fmi3SetTime(i, t));
    }
    case 14: {
      const int n = SCENE_N_X - (draw(20) == 0);
      IS(n == SCENE_N_X ? EITHER : 0, 0);
      for (int k = 0; k < SCENE_N_X; ++k) x[k] = value(2 * uniform() - 1);
      return CALL(fmi2SetContinuousStates(i, x, n), fmi3SetContinuousStates(i, x, n));
    }
    case 15: IS(exchange ? STARTING | LIVE : 0, 0); return CALL(fmi2GetContinuousStates(i, x, SCENE_N_X), fmi3GetContinuousStates(i, x, SCENE_N_X));
    case 16: IS(exchange ? STARTING | LIVE : 0, 0); return CALL(fmi2GetDerivatives(i, x, SCENE_N_X), fmi3GetContinuousStateDerivatives(i, x, SCENE_N_X));
    case 17:
      IS(exchange ? (SCENE_N_SWITCHES ? STARTING | LIVE : ANY) : 0, 0);
      return CALL(fmi2GetEventIndicators(i, y, SCENE_N_SWITCHES), fmi3GetEventIndicators(i, y, SCENE_N_SWITCHES));
    case 18: IS(ANY, 0); return CALL(fmi2GetNominalsOfContinuousStates(i, x, SCENE_N_X), fmi3GetNominalsOfContinuousStates(i, x, SCENE_N_X));
    case 19: IS(CONTINUOUS, 0); return CALL(fmi2CompletedIntegratorStep(i, 1, b, b + 1), fmi3CompletedIntegratorStep(i, 1, b, b + 1));
    case 20: IS(ANY, 0); return CALL(fmi2SetDebugLogging(i, draw(2), 0, NULL), fmi3SetDebugLogging(i, draw(2), 0, NULL));
    case 21: IS(0, 0); return CALL(fmi2CancelStep(i), fmi3EnterStepMode(i));
    case 22: IS(0, 0); return CALL(fmi2GetFMUstate(i, NULL), fmi3GetFMUState(i, NULL));
    case 23: IS(0, 0); return CALL(fmi2GetInteger(i, r, 1, (int *)y), fmi3GetInt32(i, r, 1, (int *)y, 1));
    default: IS(0, 0); return FMI_ERROR;
  }
}
enum { N_CALLS = 24 };

/* The call that a right order would make in a phase. */
static int usual(int phase) {
  static const int at_event[] = {12, 12, 11, 5, 7}, continuous[] = {13, 14, 16, 17, 19, 10, 5}, stepping[] = {4, 4, 4, 5, 7};
  switch (phase) {
    case IDLE: return VERSION == 2 && draw(2) ? 2 : 1;
    case STARTING: return draw(3) ? 3 : 5;
    case EVENT: return at_event[draw(5)];
    case CONTINUOUS: return continuous[draw(7)];
    case STEPPING: return stepping[draw(5)];
    default: return 0;
  }
}

int main(int n, char **words) {
  const unsigned long first = strtoul(words[1], NULL, 10), count = strtoul(words[2], NULL, 10);
  unsigned long calls = 0, right = 0;
  for (unsigned long order = first; order < first + count; ++order) {
    state = order * 2654435761u + 12345;
    const int exchange = SCENE_HAS_RATES ? draw(2) : 0;
#if VERSION == 2
    Instance *i = fmi2Instantiate("run", !exchange, SCENE_TOKEN, "", NULL, 0, 0);
#else
    Instance *i = exchange ? fmi3InstantiateModelExchange("run", SCENE_TOKEN, "", 0, 0, NULL, NULL)
                           : fmi3InstantiateCoSimulation("run", SCENE_TOKEN, "", 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
#endif
    int phase = IDLE, failed = 0;
    nonsense = 0;
    setitimer(ITIMER_VIRTUAL, &(struct itimerval){.it_value = {60, 0}}, NULL); /* of the processor, not of the clock */
    for (int k = 0, length = 5 + draw(40); k < length; ++k) {
      int legal, next;
      const int call = draw(2) ? draw(N_CALLS) : usual(phase);
      const Status status = make(i, exchange, call, &legal, &next);
      ++calls, right += status == FMI_OK;
      if (status == FMI_OK ? !(legal & phase) : (legal & phase) && !nonsense && !failed) {
        fprintf(stderr, "%s; order %lu, call %d (%s) in phase %d: status %d\n", scene_fault(i->scene), order, call, name, phase, status);
        return 1;
      }
      if (status != FMI_OK && legal & phase) failed = 1;
      if (status == FMI_OK && next) phase = next;
      if (phase == IDLE) failed = 0;
    }
    CALL(fmi2FreeInstance(i), fmi3FreeInstance(i));
  }
  Boolean_ b[5];
  double y;
  int legal, next, bad = 0;
  for (int call = 0; call < N_CALLS; ++call) /* an instance that could not be made */
    if (call != 4 && call != 13) bad |= make(NULL, 0, call, &legal, &next) == FMI_OK;
  printf("%lu calls, %lu of them OK\n", calls, right);
  return bad;
}
"""


def compile_orders(scene, version, folder, compiler="gcc"):
    """The program for a scene: FIRST COUNT are its words. It ends with 0 if each call was answered as the standard says."""
    path = Path(folder) / f"orders{version}.fmu"
    mb.save_fmu(scene, path, version=version)
    sources = Path(folder) / f"sources{version}"
    with zipfile.ZipFile(path) as archive:
        archive.extractall(sources)
    driver = sources / "driver.c"
    driver.write_text(DRIVER.replace("Boolean_", "int" if version == 2 else "bool"))
    program = Path(folder) / f"program{version}"
    scene_c = sources / "sources" / "scene.c"
    # Steps of 1e300 s end soon.
    scene_c.write_text(re.sub("(#define STEPS_AT_MOST) .*", r"\1 3000", scene_c.read_text()))
    command = [compiler, *SANITIZED, f"-DVERSION={version}", f"-I{sources / 'sources'}"]
    subprocess.run([*command, driver, scene_c, "-o", program, "-lm"], check=True)
    return program
