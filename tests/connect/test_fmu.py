"""FMUSimulator: FMUs of C for FMI 2 and 3, and of PythonFMU, against scenes; faults are told in one sentence each."""

import multiprocessing
import os
import pickle
import re
import shutil
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import casadi as ca
import fmus
import numpy as np
import pytest
from faults import refused, warned
from numpy.testing import assert_allclose

import symmb as mb
from symmb.bound.reductions import bounded

pytest.importorskip("fmpy")
if shutil.which("cc") is None and shutil.which("gcc") is None:
    pytest.skip("needs a C compiler", allow_module_level=True)

TIMES = np.concatenate([np.linspace(0.0, 0.7, 15), [0.9, 1.37, 2.0]])
NOMINAL = {"stiffness": 40.0, "force[1]": 5.0}
BOX = mb.Box(**{"stiffness": (36.0, 44.0), "force[1]": (0.0, 5.0)})
INTERFACES = [(version, kind) for version in (2, 3) for kind in ("CoSimulation", "ModelExchange")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture(scope="module")
def libraries(folder):
    return {version: fmus.library(version, folder) for version in (2, 3)}


@pytest.fixture(scope="module")
def springs(folder, libraries):
    return {version: fmus.spring(folder / f"spring{version}.fmu", libraries, version) for version in (2, 3)}


def simulator(path, **options):
    options = {"parameters": NOMINAL, "times": TIMES, "outputs": ["x", "v"]} | options
    return mb.FMUSimulator(path, **options)


def samples(count=8):
    return np.column_stack([np.linspace(36, 44, count), np.linspace(0, 5, count)])


@pytest.fixture(scope="module")
def scene():
    p = mb.Parameters(stiffness=40.0, force=5.0)
    mass = mb.Body("mass", mass=1.0, pose=mb.Particle())
    pull = ca.if_else(mb.t > 0.5, p.force, 0) - p.stiffness * mass.x - 0.5 * mass.vx
    system = mb.System(mass, mb.Force("pull", mass.point(0, 0, 0), (pull, 0, 0)), parameters=p)
    return mb.Scene(system, start={"mass.x": 1.0}, times=TIMES, outputs={"x": mass.x, "v": mass.vx})


@pytest.mark.parametrize(("version", "kind"), INTERFACES)
def test_runs_are_those_of_the_same_scene(version, kind, springs, scene):
    ensemble = simulator(springs[version], fmi_type=kind, outputs=["x", "v", "passes", "der(v)"]).run(samples())
    expected = mb.DAESimulator(scene, mb.DormandPrince(rtol=1e-11)).run(samples()).Y
    assert ensemble.ok.all()
    assert_allclose(ensemble.Y[:, :, :2], expected, atol=1e-6)
    pull = np.where(TIMES > 0.5 - 1e-9, samples()[:, 1:], 0.0)
    rates = pull - samples()[:, :1] * expected[:, :, 0] - 0.5 * expected[:, :, 1]
    assert_allclose(ensemble.Y[:, :, 3], rates, atol=1e-4)
    fine = mb.simulate(scene, times=np.linspace(0, 2, 20001), parameters={"stiffness": 36.0, "force": 0.0})
    passes = np.cumsum(np.diff(fine["x"] > 0.3, prepend=True))
    assert (ensemble.Y[0, :, 2] == passes[np.round(TIMES * 10000).astype(int)]).all()


@pytest.mark.parametrize(("version", "kind"), [(2, "CoSimulation"), (3, "ModelExchange")])
def test_compare_runs_all_methods(version, kind, springs, scene):
    methods, times = [mb.PolynomialChaos(), mb.MonteCarlo(20), mb.Scanning(3)], [0.0, 0.1, 0.25, 0.6]
    own = simulator(springs[version], fmi_type=kind, times=times, step=0.05)
    comparison = mb.compare(own, methods, BOX, mb.Scanning(4))
    box = mb.Box(stiffness=(36.0, 44.0), force=(0.0, 5.0))
    expected = mb.compare(scene, methods, box, mb.Scanning(4), mb.DormandPrince(rtol=1e-11), times=times)
    assert comparison.units == ("m", "m/s") and not comparison.doubts
    for own, other in zip(comparison.rows[1:], expected.rows[1:], strict=True):
        assert_allclose([own.lower, own.upper], [other.lower, other.upper], atol=1e-6)


def test_units_reach_bounds(springs, folder):
    own = simulator(springs[2], outputs=["x", "damper.c", "passes"])
    for one in (own, mb.StoredSimulator(own, folder / "units.db")):
        assert bounded(mb.Vertex(), one, BOX).units == ("m", "N.s/m", "")


def test_parameters_are_set_whatever_their_kind(springs):
    P = np.array([[0.5, 1.0, 2.0], [0.0, 0.5, 3.0]])
    own = simulator(springs[2], parameters={"damper.c": 0.5, "x": 1.0, "mode": 2.0}, outputs=["damper.c", "x", "mode"])
    assert own.run(P).Y[:, 0].tolist() == P.tolist()
    (message,) = own.run(P[:1] + [0, 0, 0.5]).messages
    assert message.startswith("'mode' cannot be 2.5: it is of the type Integer (")


def test_runs_begin_at_the_first_time_and_stop_at_each(springs):
    whole = simulator(springs[2], parameters={"stiffness": 40.0}, times=[0.0, 0.4, 1.0]).run([[40.0]]).Y[0]
    later = simulator(springs[2], parameters={"stiffness": 40.0}, times=[3.0, 3.4, 4.0]).run([[40.0]]).Y[0]
    assert_allclose(later, whole, atol=1e-9)
    assert simulator(springs[2], times=[2.0]).run([[40.0, 5.0]]).Y.tolist() == [[[1.0, 0.0]]]


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("stiffness", "text"),
    [
        (70.0, r"fmi\d(DoStep|Get\w+) failed at t = 0\.\d+ s: the spring is torn by 70 N/m \(stiffness=70 N/m\)"),
        (85.0, r"the FMU ended the run at t = 0.2\d* s \("),
        (92.0, r"timed out: the FMU had not returned after 1 s \("),
        (97.0, r"the FMU ended its process by SIGABRT \("),
    ],
)
def test_failed_runs_tell_why_and_others_go_on(version, stiffness, text, springs, capfd):
    for kind in ["CoSimulation", "ModelExchange"][: 1 if stiffness > 90 else 2]:
        own = simulator(springs[version], parameters={"stiffness": 40.0}, fmi_type=kind, timeout=1)
        ensemble = own.run([[40.0], [stiffness], [40.0]])
        assert ensemble.ok.tolist() == [True, False, True]
        assert (ensemble.Y[0] == ensemble.Y[2]).all()
        assert np.isnan(ensemble.Y[1]).all()
        assert re.match(text, ensemble.messages[0]), ensemble.messages
    assert capfd.readouterr() == ("", "")


KEEPS = """static double first; double k = m->value[STIFFNESS]; first = first ? first : k;
set_start(m); m->value[DAMPING] += k - first;"""


@pytest.mark.parametrize("reset", ["", KEEPS, "abort();", "return 3;"], ids=["none", "keeps", "aborts", "fails"])
def test_an_fmu_that_cannot_be_reset_gets_new_instances(reset, folder, springs):
    path = fmus.spring(folder / "kept.fmu", {2: fmus.library(2, folder, reset)})
    expected = simulator(springs[2]).run(samples()).Y
    assert (simulator(path).run(samples()).Y == expected).all()


def test_pythonfmu_with_state_beside_its_instances_gets_new_processes(folder):
    counting = SLAVE.replace("class Decay", "STEPS = []\n\nclass Counting").replace(
        "self.x /= 1 + step * self.k", "STEPS.append(t)\n        self.x = self.k * len(STEPS)"
    )
    own = mb.FMUSimulator(of_python(folder / "counting_of_tests.py", counting), {"k": 1.0}, [0.0, 0.1], ["x"])
    alone = own.run([[2.0]]).Y
    P = [[1.0], [2.0], [4.0], [2.0], [2.0]]
    assert (own.run(P).Y[[1, 3, 4]] == alone).all()
    with ThreadPoolExecutor(2) as pool:
        assert (pool.submit(own.run, P).result().Y[[1, 3, 4]] == alone).all()


def test_an_instance_is_used_again(folder):
    text = 'FILE *f = fopen("%s", "a"); fputc(\'r\', f); fclose(f); set_start(m);' % (folder / "resets.txt")
    path = fmus.spring(folder / "reset.fmu", {2: fmus.library(2, folder, text.replace("%", "%%"))})
    assert simulator(path).run(samples(8)).ok.all()
    assert len((folder / "resets.txt").read_text()) == 9  # 7, and two by which it is tried whether resets work


@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")  # of Python 3.12
@pytest.mark.parametrize("kind", ["threads", "fork", "spawn"])
def test_pools_change_nothing(kind, springs):
    own = simulator(springs[3], outputs=["x", "passes"])
    box = mb.Box(**{"stiffness": (36.0, 75.0), "force[1]": (0.0, 5.0)})
    alone = warned("", mb.propagate, own, mb.MonteCarlo(40), box)
    assert 5 < len(alone.failed) < 35
    context = None if kind == "threads" else multiprocessing.get_context(kind)
    with ThreadPoolExecutor(2) if context is None else ProcessPoolExecutor(2, mp_context=context) as pool:
        pooled = warned("", mb.propagate, own, mb.MonteCarlo(40), box, executor=pool)
    assert (pooled.lower == alone.lower).all() and (pooled.upper == alone.upper).all()
    assert [f.parameters for f in pooled.failed] == [f.parameters for f in alone.failed]


def test_stored_runs_belong_to_the_file_and_the_interface(springs, folder, libraries):
    def count(**options):
        stored = mb.StoredSimulator(simulator(options.pop("path", springs[2]), **options), folder / "runs.db")
        stored.run(samples(3))
        return stored.identity

    copy = folder / "copy.fmu"
    shutil.copy(springs[2], copy)
    other = fmus.spring(folder / "other.fmu", libraries, experiment="<!-- changed -->")
    same = {count(), count(path=copy), count(timeout=5)}
    assert len(same) == 1
    assert len({*same, count(fmi_type="ModelExchange"), count(step=0.01), count(path=other)}) == 4


def test_a_file_that_changes_is_not_run(springs, folder, libraries, monkeypatch):
    path = folder / "changing.fmu"
    shutil.copy(springs[2], path)
    own = simulator(path)
    fmus.spring(path, libraries, experiment="<!-- changed -->")
    assert own.run(samples(1)).ok.all()  # it was extracted when it was declared
    monkeypatch.setattr("symmb.connect.fmu_description._EXTRACTED", {})  # as in another process
    (message,) = pickle.loads(pickle.dumps(own)).run(samples(1)).messages
    assert message.startswith("changing.fmu has changed since it was declared (")


def test_communication_steps(springs, folder, libraries):
    fixed = 'canHandleVariableCommunicationStepSize="true" fixedInternalStepSize="0.01"'
    own = fmus.spring(folder / "fixed.fmu", libraries, 3, co_simulation=fixed)
    uniform = fmus.spring(folder / "uniform.fmu", libraries, co_simulation='canInterpolateInputs="false"')
    told = fmus.spring(folder / "told.fmu", libraries, experiment='<DefaultExperiment stepSize="0.02"/>')
    assert [simulator(springs[2]).step, simulator(told).step, simulator(told, step=0.5).step] == [2 / 500, 0.02, 0.5]
    assert simulator(own, times=[0.0, 0.1, 0.3]).step == pytest.approx(0.2)
    assert simulator(uniform, times=[0.0, 0.2, 0.6]).step == 0.2 / 167
    Y = [simulator(path, times=[0.0, 0.2, 0.6]).run(samples()).Y for path in (uniform, springs[2])]
    assert_allclose(*Y, atol=1e-9)
    refused("its solver has steps of 0.01 s", simulator, own, times=[0.0, 0.105])
    refused("its steps are of 0", simulator, uniform, times=[0, 0.2, 0.5001])


SLAVE = """
from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

class Decay(Fmi2Slave):
    default_experiment = DefaultExperiment(step_size=1e-3)

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.k, self.x = 1.0, 1.0
        self.register_variable(Real("k", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        self.register_variable(Real("x", causality=Fmi2Causality.output))
        print("a slave is made")

    def do_step(self, t, step):
        if self.k > 3:
            raise ValueError("k is too large")
        self.x /= 1 + step * self.k
        return True
"""


def of_python(path, code):
    """An FMU of PythonFMU."""
    path.write_text(code)
    return pytest.importorskip("pythonfmu").FmuBuilder.build_FMU(path, dest=path.parent)


def test_pythonfmu(folder, capfd):
    path = of_python(folder / "decay_of_tests.py", SLAVE)
    capfd.readouterr()
    own = mb.FMUSimulator(path, {"k": 1.0}, np.linspace(0, 1, 6), ["x"])
    ensemble = own.run([[1.0], [2.0], [4.0], [2.0]])
    expected = [(1 + 1e-3 * k) ** (-1000 * own.times) for k in (1.0, 2.0)]
    assert_allclose(ensemble.Y[:2, :, 0], expected, rtol=1e-12)
    assert (ensemble.Y[3] == ensemble.Y[1]).all()
    assert "k is too large" in ensemble.messages[0]
    bounds = mb.propagate(own, mb.PolynomialChaos(), mb.Box(k=(1.0, 2.0)))
    assert_allclose(bounds["x"][1][-1], expected[0][-1], rtol=1e-6)
    assert capfd.readouterr() == ("", "")


def test_repr_and_processes(springs):
    own = simulator(springs[2])
    assert repr(own) == repr(pickle.loads(pickle.dumps(own))) == "FMUSimulator(spring2.fmu)"
    assert own.path == springs[2].resolve() and own.fmi_type == "CoSimulation"
    assert os.getcwd() and own.run(samples(1)).ok.all()


# Faults

FIXED = 'causality="parameter" variability="fixed"'
MORE = f"""<ScalarVariable name="text" valueReference="90" {FIXED}><String start="a"/></ScalarVariable>
<ScalarVariable name="on" valueReference="91" {FIXED}><Boolean start="true"/></ScalarVariable>
<ScalarVariable name="pi" valueReference="92" variability="constant"><Real start="3.14"/></ScalarVariable>
<ScalarVariable name="guess" valueReference="93" initial="approx"><Real start="3.14"/></ScalarVariable>"""
ARRAY = f"""<Float64 name="gains" valueReference="90" {FIXED} start="1 2 3"><Dimension start="3"/></Float64>
<UInt64 name="size" valueReference="91" causality="structuralParameter" start="3"/>"""


@pytest.mark.parametrize(
    ("version", "change", "text"),
    [
        (2, {"parameters": {"stifness": 1.0}}, "has no variable 'stifness'. Did you mean 'stiffness'?"),
        (2, {"outputs": ["X"]}, "has no variable 'X'"),
        (2, {"outputs": ["text"]}, "output 'text' is of the type String"),
        (2, {"parameters": {"on": 1.0}}, "parameter 'on' is of the type Boolean"),
        (2, {"parameters": {"pi": 1.0}}, "'pi' cannot be set: it is a constant"),
        (2, {"parameters": {"guess": 1.0}}, "'guess' cannot be set: its start value is only a first guess"),
        (2, {"parameters": {"der(v)": 1.0}}, "'der(v)' cannot be set: it is calculated by the FMU"),
        (2, {"parameters": {"mode": 1.5}}, "'mode' cannot be 1.5: it is of the type Integer"),
        (2, {"parameters": {"mode": 1e12}}, "'mode' cannot be 1e+12: it is of the type Integer"),
        (3, {"parameters": {"gains": 1.0}}, "parameter 'gains' is an array (3). Only single numbers are supported"),
        (3, {"parameters": {"size": 3.0}}, "'size' cannot be set: it is a structural parameter"),
        (2, {"fmi_type": "cs"}, "fmi_type must be one of 'CoSimulation', 'ModelExchange', got 'cs'"),
        (2, {"step": -1}, "step must be a number of seconds above 0"),
        (2, {"timeout": 0}, "timeout must be a number of seconds above 0"),
        (2, {"times": [1, 0]}, "times must be finite and increase"),
        (2, {"noise": {"y": 1}}, "noise: no output 'y'"),
    ],
)
def test_faults_of_a_declaration(version, change, text, folder, libraries):
    path = fmus.spring(folder / "more.fmu", libraries, version, extra=MORE if version == 2 else ARRAY)
    error = refused(None, simulator, path, **change)
    assert text in error and "\n" not in error


GOOD = fmus.description(2)
OTHER = fmus.description(2, token="another")
SCHEDULED = fmus.description(3).replace("<ModelExchange", "<ScheduledExecution")
SCHEDULED = re.sub('<CoSimulation.*?/>|needsCompletedIntegratorStep="true"', "", SCHEDULED)
FMI1 = """<fmiModelDescription fmiVersion="1.0" modelName="a" modelIdentifier="a" guid="{1}"
    numberOfContinuousStates="0" numberOfEventIndicators="0"><ModelVariables/></fmiModelDescription>"""


@pytest.mark.parametrize(
    ("description", "text"),
    [
        (None, "it contains no modelDescription.xml"),
        ("", "modelDescription.xml of wrong.fmu cannot be read: XMLSyntaxError"),
        (GOOD[:500], "cannot be read: XMLSyntaxError"),
        ("<a/>", "cannot be read"),
        ('<fmiModelDescription fmiVersion="2.0"/>', "cannot be read: ERROR (line 1"),
        (GOOD.replace("</ModelVariables>", "</ModelVariable>"), "cannot be read: XMLSyntaxError"),
        (GOOD.replace('valueReference="3"', 'valueReference="c"'), "cannot be read: ERROR (line"),
        (GOOD.replace('declaredType="Damping"', 'declaredType="Lost"'), "cannot be read: "),
        (GOOD.replace('index="8"', 'index="80"'), "cannot be read: "),
        (FMI1, "uses FMI 1.0. Only 2 and 3 are supported"),
        (GOOD.replace('fmiVersion="2.0"', 'fmiVersion="7.1"'), "Unsupported FMI version: 7.1"),
        (GOOD.replace("<ModelExchange", "<A").replace("<CoSimulation", "<B"), "cannot be read: ERROR (line 3"),
        (GOOD.replace("Derivatives>", "Rates>"), "cannot be read: ERROR (line"),
        (SCHEDULED, "wrong.fmu supports neither co-simulation nor model exchange"),
        (GOOD.replace('"spring"', '"other"'), "its folder lacks other.so"),
    ],
)
def test_malformed_descriptions(description, text, folder, libraries):
    own = {} if description is None else {"modelDescription.xml": description}
    check_fault(fmus.write_fmu(folder / "wrong.fmu", {fmus.library_name(2): libraries[2]} | own), text)


def check_fault(path, text):
    error = refused(None, simulator, path)
    assert text in error and "\n" not in error and len(error) < 500


def test_malformed_files(folder, libraries):
    whole = fmus.spring(folder / "whole.fmu", libraries).read_bytes()
    path = folder / "damaged.fmu"
    check_fault(folder / "none.fmu", "there is no file")
    check_fault(folder, "there is no file")
    for content in (b"", b"nonsense" * 100, whole[: len(whole) // 2], whole[:-10]):
        path.write_bytes(content)
        check_fault(path, "damaged.fmu is not an FMU, or is damaged: BadZipFile: File is not a zip file.")
    place = len(whole) // 2
    path.write_bytes(whole[:place] + bytes(b ^ 255 for b in whole[place : place + 50]) + whole[place + 50 :])
    check_fault(path, "damaged.fmu cannot be extracted: ")
    others = {"binaries/win64/spring.dll": "only for win64", "sources/a.c": "Try to compile the sources"}
    for name, told in others.items():
        check_fault(fmus.write_fmu(path, {"modelDescription.xml": GOOD, name: b""}), told)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"modelDescription.xml": OTHER}, "Failed to instantiate model at t = 0 s: the token is another"),
        ({fmus.library_name(2): b"no library"}, "Failed to load shared library"),
    ],
)
def test_libraries_that_do_not_start(change, text, folder, libraries):
    files = {"modelDescription.xml": GOOD, fmus.library_name(2): libraries[2]} | change
    (message,) = simulator(fmus.write_fmu(folder / "broken.fmu", files)).run([[40.0, 5.0]]).messages
    assert text in message


def test_without_fmpy(monkeypatch, folder, libraries):
    path = fmus.spring(folder / "whole.fmu", libraries)
    monkeypatch.setitem(sys.modules, "fmpy", None)
    refused(r"FMUSimulator needs fmpy, which is not installed.*'symmb\[fmu\]'", simulator, path, error=ImportError)
