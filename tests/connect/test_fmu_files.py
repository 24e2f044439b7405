"""FMUs that cannot be read, and wrong declarations: each is told in one sentence."""

import re
import shutil
import sys

import fmus
import pytest
from faults import refused

import symmb as mb

pytest.importorskip("fmpy")
if shutil.which("cc") is None and shutil.which("gcc") is None:
    pytest.skip("needs a C compiler", allow_module_level=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture(scope="module")
def libraries(folder):
    return {version: fmus.library(version, folder) for version in (2, 3)}


def simulator(path, **options):
    options = {"parameters": {"stiffness": 40.0}, "times": [0.0, 0.1], "outputs": ["x", "v"]} | options
    return mb.FMUSimulator(path, **options)


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
        (
            {"modelDescription.xml": fmus.description(2, token="another")},
            "Failed to instantiate model at t = 0 s: the token is another",
        ),
        ({"library": b"no library"}, "Failed to load shared library"),
    ],
)
def test_libraries_that_do_not_start(change, text, folder, libraries):
    files = {"modelDescription.xml": GOOD, "library": libraries[2]} | change
    files[fmus.library_name(2)] = files.pop("library")
    (message,) = simulator(fmus.write_fmu(folder / "broken.fmu", files)).run([[40.0]]).messages
    assert text in message


def test_without_fmpy(monkeypatch, folder, libraries):
    path = fmus.spring(folder / "whole.fmu", libraries)
    monkeypatch.setitem(sys.modules, "fmpy", None)
    refused(r"FMUSimulator needs fmpy, which is not installed.*'symmb\[fmu\]'", simulator, path, error=ImportError)
