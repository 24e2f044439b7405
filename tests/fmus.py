"""FMUs that tests compile: a mass on a spring, by FMI 2 and 3, for co-simulation and model exchange."""

import platform
import shutil
import subprocess
import zipfile
from pathlib import Path

SPRING = r"""
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#define ON 0.5    /* the force begins [s] */
#define LEVEL 0.3 /* passes of this position are counted [m] */
enum { TIME, STIFFNESS, DAMPING, FORCE, POSITION, VELOCITY, ACCELERATION, PASSES, MODE, RATE, LAST };
typedef struct {
    double value[LAST], start, above, end;
    int ended, has_time;
    void *environment;
    const CALLBACK *callback;
} Model;

static void set_start(Model *m) {
    memset(m->value, 0, sizeof m->value);
    m->value[STIFFNESS] = 40; m->value[DAMPING] = 0.5; m->value[POSITION] = 1; m->value[MODE] = 1;
    m->ended = m->has_time = 0;
}
static Model *new_model(void) {
    printf("a spring is made\n");
    Model *m = calloc(1, sizeof *m);
    set_start(m);
    return m;
}
static double force(const Model *m, double t) { return m->has_time ? m->value[FORCE] : 0 * t; }
static void rates(const Model *m, double t, const double x[2], double dx[2]) {
    dx[0] = x[1];
    dx[1] = m->value[MODE] * (force(m, t) - m->value[STIFFNESS] * x[0] - m->value[DAMPING] * x[1]);
}
/* The corners of the space of parameters in which runs fail. */
static int status_of(Model *m) {
    double k = m->value[STIFFNESS];
    if (k > 95) abort();
    if (k > 90) sleep(1000);
    if (k > 80 && m->value[TIME] > 0.2) { m->ended = 1; return 2; }
    if (k > 60 && k < 80 && m->value[TIME] > 0.1) { say(m, 3, "the spring is torn by %d N/m", (int)k); return 3; }
    return 0;
}
static void update(Model *m) {
    if (m->value[TIME] >= ON - 1e-12) m->has_time = 1;
    double above = m->value[POSITION] > LEVEL;
    m->value[PASSES] += above != m->above;
    m->above = above;
}
static int begin(Model *m) {
    double dx[2];
    m->value[TIME] = m->start;
    m->above = m->value[POSITION] > LEVEL;
    update(m);
    rates(m, m->start, m->value + POSITION, dx);
    return 0;
}
static double value_of(const Model *m, unsigned vr) {
    double dx[2];
    rates(m, m->value[TIME], m->value + POSITION, dx);
    return vr == ACCELERATION ? dx[1] : vr == RATE ? dx[0] : vr < LAST ? m->value[vr] : NAN;
}
static void piece(Model *m, double h) {
    double a[2], b[2], c[2], d[2], y[2], *x = m->value + POSITION, t = m->value[TIME];
    rates(m, t, x, a);
    for (int i = 0; i < 2; i++) y[i] = x[i] + h / 2 * a[i];
    rates(m, t, y, b);
    for (int i = 0; i < 2; i++) y[i] = x[i] + h / 2 * b[i];
    rates(m, t, y, c);
    for (int i = 0; i < 2; i++) y[i] = x[i] + h * c[i];
    rates(m, t, y, d);
    for (int i = 0; i < 2; i++) x[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
    m->value[TIME] = t + h;
    update(m);
}
static int steps(Model *m, double t, double h) {
    m->value[TIME] = t;
    int status = status_of(m);
    double stops[] = {ON, t + h};
    for (int s = 0; s < 2 && !status; s++)
        if (stops[s] > m->value[TIME] + 1e-13 && stops[s] <= t + h) {
            double length = stops[s] - m->value[TIME];
            int n = (int)ceil(length / 1e-3);
            for (int i = 0; i < n; i++) piece(m, length / n);
            m->value[TIME] = stops[s];
            update(m);
        }
    return status;
}
"""

FMI2 = r"""
#include "fmi2FunctionTypes.h"
#define CALLBACK fmi2CallbackFunctions
#define say(m, status, ...) (m)->callback->logger((m)->environment, "spring", status, "logStatusError", __VA_ARGS__)
%(spring)s
#define F(name) int fmi2##name
#define STUB(name) int fmi2##name(void) { return 3; }
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
void *fmi2Instantiate(const char *n, int kind, const char *guid, const char *r, const CALLBACK *c, int v, int l) {
    Model *m = new_model();
    m->callback = c; m->environment = c->componentEnvironment;
    if (strcmp(guid, "a token")) { say(m, 3, "the token is %%s", guid); return NULL; }
    return m;
}
void fmi2FreeInstance(Model *m) { free(m); }
F(SetupExperiment)(Model *m, int d, double tolerance, double start, int e, double stop) { m->start = start; return 0; }
F(EnterInitializationMode)(Model *m) { return 0; }
F(GetReal)(Model *m, const unsigned *vr, size_t n, double *y) { while (n--) *y++ = value_of(m, *vr++); return 0; }
F(GetInteger)(Model *m, const unsigned *vr, size_t n, int *y) { while (n--) *y++ = value_of(m, *vr++); return 0; }
F(SetReal)(Model *m, const unsigned *vr, size_t n, const double *y) { while (n--) m->value[*vr++] = *y++; return 0; }
F(SetInteger)(Model *m, const unsigned *vr, size_t n, const int *y) { while (n--) m->value[*vr++] = *y++; return 0; }
F(DoStep)(Model *m, double t, double h, int b) { return steps(m, t, h); }
F(GetBooleanStatus)(Model *m, int kind, int *value) { *value = m->ended; return 0; }
F(NewDiscreteStates)(Model *m, fmi2EventInfo *info) {
    update(m);
    memset(info, 0, sizeof *info);
    info->nextEventTimeDefined = !m->has_time; info->nextEventTime = ON;
    return 0;
}
F(CompletedIntegratorStep)(Model *m, int a, int *event, int *ends) { *event = 0; *ends = m->ended; return 0; }
"""

FMI3 = r"""
#include "fmi3FunctionTypes.h"
#define CALLBACK void
#define say(m, status, ...) \
    (snprintf(text, sizeof text, __VA_ARGS__), (m)->log((m)->environment, status, "error", text))
static char text[200];
#define callback callback; fmi3LogMessageCallback log
%(spring)s
#undef callback
#define F(name) int fmi3##name
#define STUB(name) int fmi3##name(void) { return 3; }
const char *fmi3GetVersion(void) { return "3.0"; }
static void *made(const char *token, void *environment, fmi3LogMessageCallback log) {
    Model *m = new_model();
    m->log = log; m->environment = environment;
    if (strcmp(token, "a token")) { say(m, 3, "the token is %%s", token); return NULL; }
    return m;
}
void *fmi3InstantiateCoSimulation(const char *n, const char *token, const char *r, bool v, bool l, bool e, bool early,
    const unsigned *vr, size_t nvr, void *environment, fmi3LogMessageCallback log, void *intermediate) {
    return made(token, environment, log);
}
void *fmi3InstantiateModelExchange(const char *n, const char *token, const char *r, bool v, bool l, void *environment,
    fmi3LogMessageCallback log) { return made(token, environment, log); }
void fmi3FreeInstance(Model *m) { free(m); }
F(EnterInitializationMode)(Model *m, bool d, double tolerance, double start, bool e, double stop) {
    m->start = start; return 0;
}
#define GET(name, type) F(Get##name)(Model *m, const unsigned *vr, size_t nvr, type *y, size_t n) \
    { while (n--) *y++ = value_of(m, *vr++); return 0; }
#define SET(name, type) F(Set##name)(Model *m, const unsigned *vr, size_t nvr, const type *y, size_t n) \
    { while (n--) m->value[*vr++] = *y++; return 0; }
GET(Float64, double) GET(Int32, int) SET(Float64, double) SET(Int32, int)
F(DoStep)(Model *m, double t, double h, bool b, bool *event, bool *ends, bool *early, double *last) {
    int status = steps(m, t, h);
    *event = *early = 0; *ends = m->ended; *last = m->value[TIME];
    return status == 2 ? 0 : status;
}
F(UpdateDiscreteStates)(Model *m, bool *more, bool *ends, bool *a, bool *b, bool *planned, double *time) {
    update(m);
    *more = *ends = *a = *b = 0; *planned = !m->has_time; *time = ON;
    return 0;
}
F(CompletedIntegratorStep)(Model *m, bool a, bool *event, bool *ends) { *event = 0; *ends = m->ended; return 0; }
"""

BOTH = r"""
F(ExitInitializationMode)(Model *m) { return begin(m); }
F(Terminate)(Model *m) { return 0; }
F(Reset)(Model *m) { %(reset)s return 0; }
F(EnterEventMode)(Model *m) { return 0; }
F(EnterContinuousTimeMode)(Model *m) { return 0; }
F(SetTime)(Model *m, double t) { m->value[TIME] = t; return 0; }
F(SetContinuousStates)(Model *m, const double *x, size_t n) { memcpy(m->value + POSITION, x, 16); return 0; }
F(GetContinuousStates)(Model *m, double *x, size_t n) { memcpy(x, m->value + POSITION, 16); return 0; }
F(GetNominalsOfContinuousStates)(Model *m, double *x, size_t n) { x[0] = x[1] = 1; return 0; }
F(GetContinuousStateDerivatives)(Model *m, double *dx, size_t n) {
    int status = status_of(m);
    rates(m, m->value[TIME], m->value + POSITION, dx);
    return status == 2 ? 0 : status;
}
F(GetEventIndicators)(Model *m, double *z, size_t n) { z[0] = m->value[POSITION] - LEVEL; return 0; }
%(stubs)s
"""

VARIABLES = (
    ("time", "independent", "continuous", ""),
    ("stiffness", "parameter", "fixed", 'unit="N/m" start="40"'),
    ("damper.c", "parameter", "tunable", 'declaredType="Damping" start="0.5"'),
    ("force[1]", "parameter", "fixed", 'start="0"'),
    ("x", "output", "continuous", 'unit="m" initial="exact" start="1"'),
    ("v", "output", "continuous", 'unit="m/s" initial="exact" start="0" derivative="{x}"'),
    ("der(v)", "local", "continuous", 'derivative="{v}"'),
    ("passes", "output", "discrete", ""),
    ("mode", "parameter", "fixed", 'start="1"'),
    ("der(x)", "local", "continuous", 'derivative="{x}"'),
)
WHOLE = "passes", "mode"


def description(version, token="a token", extra="", co_simulation="", experiment=""):
    """The model description of the spring. `extra` are more variables."""
    index = {name: k + (version == 2) for k, (name, *_) in enumerate(VARIABLES)}
    kinds, rows = ("Real", "Integer") if version == 2 else ("Float64", "Int32"), []
    for k, (name, causality, variability, rest) in enumerate(VARIABLES):
        rest = rest.format(**{name: index[name] for name in ("x", "v")})
        if name == "v":
            rest = rest.partition("derivative")[0]  # der(x) says so
        kind = kinds[name in WHOLE]
        head = f'name="{name}" valueReference="{k}" causality="{causality}" variability="{variability}"'
        if version == 2:
            head, rest = head + ' initial="exact"' * ("initial" in rest), rest.replace('initial="exact"', "")
        row = f"<{kind} {rest}/>" if version == 2 else f"<{kind} {head} {rest}/>"
        rows.append(f"<ScalarVariable {head}>{row}</ScalarVariable>" if version == 2 else row)
    units = "".join(f'<Unit name="{unit}"/>' for unit in ("N/m", "m", "m/s", "N.s/m"))
    each = lambda tag, *names: "".join(tag.format(index[name]) for name in names)  # noqa: E731
    if version == 2:
        head = f'fmiVersion="2.0" guid="{token}" numberOfEventIndicators="1"'
        types = '<SimpleType name="Damping"><Real unit="N.s/m"/></SimpleType>'
        unknown = '<Unknown index="{}"/>'
        structure = f"<Outputs>{each(unknown, 'x', 'v', 'passes')}</Outputs>"
        structure += f"<Derivatives>{each(unknown, 'der(x)', 'der(v)')}</Derivatives>"
    else:
        head = f'fmiVersion="3.0" instantiationToken="{token}"'
        types = '<Float64Type name="Damping" unit="N.s/m"/>'
        structure = each('<Output valueReference="{}"/>', "x", "v", "passes")
        structure += each('<ContinuousStateDerivative valueReference="{}"/>', "der(x)", "der(v)")
        structure += each('<EventIndicator valueReference="{}"/>', "x")
    steps = "" if version == 2 else 'needsCompletedIntegratorStep="true"'
    co_simulation = co_simulation or 'canHandleVariableCommunicationStepSize="true"'
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription modelName="spring" {head}>
<ModelExchange modelIdentifier="spring" {steps}/><CoSimulation modelIdentifier="spring" {co_simulation}/>
<UnitDefinitions>{units}</UnitDefinitions><TypeDefinitions>{types}</TypeDefinitions>{experiment}
<ModelVariables>{"".join(rows)}{extra}</ModelVariables><ModelStructure>{structure}</ModelStructure>
</fmiModelDescription>"""


def library_name(version):
    """The path of the library in an FMU for this computer."""
    import fmpy

    folder = fmpy.platform if version == 2 else fmpy.platform_tuple
    return f"binaries/{folder}/spring{fmpy.sharedLibraryExtension}"


def library(version, folder, reset="set_start(m);"):
    """Compile the spring. `reset` is the body of the function that resets an instance."""
    import inspect

    import fmpy
    from fmpy import fmi2, fmi3

    compiler = shutil.which("cc") or shutil.which("gcc")
    code = {2: FMI2, 3: FMI3}[version] + BOTH
    if version == 2:
        code = code.replace("GetContinuousStateDerivatives", "GetDerivatives")
    classes = (fmi2.FMU2Model, fmi2.FMU2Slave) if version == 2 else (fmi3.FMU3Model, fmi3.FMU3Slave)
    names = {name for kind in classes for name, _ in inspect.getmembers(kind) if name.startswith(f"fmi{version}")}
    own = [name.removeprefix(f"fmi{version}") for name in sorted(names)]
    stubs = " ".join(f"STUB({name})" for name in own if f"{name})(" not in code and f"fmi{version}{name}(" not in code)
    if version == 3:
        for name in ("GetFloat64", "SetFloat64", "GetInt32", "SetInt32"):
            stubs = stubs.replace(f"STUB({name})", "")
    source = Path(folder) / f"spring{version}.c"
    source.write_text(code % {"spring": SPRING, "stubs": stubs, "reset": reset})
    target = source.with_suffix(".so")
    headers = Path(fmpy.__file__).parent / "c-code"
    flags = ["-w", "-O1", "-shared", *([] if platform.system() == "Windows" else ["-fPIC"])]
    subprocess.run([compiler, *flags, f"-I{headers}", "-o", target, source, "-lm"], check=True)
    return target.read_bytes()


def write_fmu(path, files):
    """An FMU of files by name, texts or bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def spring(path, libraries, version=2, **options):
    """The FMU of the spring."""
    files = {"modelDescription.xml": description(version, **options), library_name(version): libraries[version]}
    return write_fmu(path, files)
