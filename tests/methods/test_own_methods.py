"""Methods of users, which are one function of runs over a box, and bounds of other programs in comparisons."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import pytest
from faults import refused, warned

import symmb as mb
from symmb.show.cli.main import main

T = np.linspace(0.0, 1.0, 5)
BOX = mb.Box(a=(1.0, 3.0), b=(-0.5, 0.5))


def straight(a, b):
    """Two outputs that are linear in a and b: their ranges and slopes are known."""
    return np.stack([a * T + 2 * b, -a + 0 * T], axis=1)


def simulator(f=straight):
    return mb.FunctionSimulator(lambda a, b, c: f(a, b), {"a": 2.0, "b": 0.0, "c": 7.0}, T, ["x", "y"])


@dataclass(frozen=True)
class Corners(mb.Method):
    """Exact for linear outputs."""

    estimated: float | None = None

    kind = "sampled"

    def bounds(self, runs):
        (a, b), (c, d) = runs.lower, runs.upper
        Y = runs([[a, b], [a, d], [c, b], [c, d]])
        low, high = Y.min(axis=0), Y.max(axis=0)
        return (low, high) if self.estimated is None else (low, high, np.full(low.shape, self.estimated))


class Returned(mb.Method):
    """Returns what it is given, after one run in the middle."""

    kind = "estimate"

    def __init__(self, returned, at=((2.0, 0.0),)):
        self.returned, self.at = returned, at

    def bounds(self, runs):
        runs(self.at)
        return self.returned


def test_arrays_become_bounds():
    bounds = mb.propagate(simulator(), Corners(0.1), BOX)
    np.testing.assert_allclose(bounds.lower, np.stack([T - 1, -3 + 0 * T], axis=1), atol=1e-12)
    np.testing.assert_allclose(bounds.upper, np.stack([3 * T + 1, -1 + 0 * T], axis=1), atol=1e-12)
    assert (bounds.method, bounds.kind, bounds.evaluations) == ("Corners(estimated=0.1)", "sampled", 4)
    assert (bounds.estimate == 0.1).all() and bounds.inner is not None
    np.testing.assert_array_equal(bounds.inner[1], bounds.upper)
    assert bounds.worst("x").upper.parameters["a"] == 3.0 and bounds.box == BOX


def test_a_method_without_estimate_is_checked():
    class Middle(mb.Method):
        kind = "sampled"

        def bounds(self, runs):
            Y = runs([(runs.lower + runs.upper) / 2])
            return Y[0], Y[0]

    result = warned("other points are outside of the bounds", mb.propagate, simulator(), Middle(), BOX)
    np.testing.assert_array_equal(result.lower, result.upper)


def test_runs_of_executors_and_stores_are_those_of_this_thread(tmp_path):
    calls = []

    def counted(a, b):
        calls.append(a)
        return straight(a, b)

    plain = mb.propagate(mb.FunctionSimulator(counted, {"a": 2.0, "b": 0.0}, T, ["x", "y"]), Corners(0.0), BOX)
    stored = mb.StoredSimulator(mb.FunctionSimulator(counted, {"a": 2.0, "b": 0.0}, T, ["x", "y"]), tmp_path / "r.db")
    for number in 4, 0:
        calls.clear()
        with ThreadPoolExecutor(2) as pool:
            bounds = mb.propagate(stored, Corners(0.0), BOX, executor=pool)
        assert len(calls) == number
        np.testing.assert_array_equal([bounds.lower, bounds.upper], [plain.lower, plain.upper])


def test_derivatives_are_in_the_units_of_the_box():
    seen = []

    class Slopes(mb.Method):
        kind = "estimate"

        def bounds(self, runs):
            seen.append((runs.derivatives([2.0, 0.25]), runs.evaluations, runs.parameters))
            return runs(runs.box.center[None])[0], runs(runs.box.center[None])[0]

    p = mb.Parameters(a=2.0, b=0.0)
    z = mb.States(["z"], lambda z: p.a**2 + p.b)
    scene = mb.Scene(mb.System(z, parameters=p), {"z": 0.0}, T, {"z": z.z.value}, BOX)
    mb.compare(scene, [Slopes()], reference=mb.Vertex())
    slopes, evaluations, names = seen[0]
    np.testing.assert_allclose(slopes[:, :, 0], [4 * T, T], atol=1e-7)  # z = (a^2 + b) t
    assert evaluations == 3 and names == ("a", "b")
    refused("gives values only", mb.propagate, simulator(), Slopes(), BOX, error=mb.PropagationError)


ZERO = np.zeros((5, 2))
RETURNED = {
    r"must return \(lower, upper\) or .* each an array \(5, 2\) of numbers, got None": None,
    r"each an array \(5, 2\) of numbers, got \(2,\), \(5, 2\)": (np.zeros(2), ZERO),
    r"of numbers, got no numbers, \(5, 2\)": ("low", ZERO),
    r"lower of x is nan at t = 0 s": (ZERO + np.nan, ZERO),
    r"lower is above upper for x at t = 0 s: 1 and 0": (ZERO + 1, ZERO),
    r"estimate must not be negative": (ZERO, ZERO, ZERO - 1),
}


@pytest.mark.parametrize("words", RETURNED)
def test_what_is_no_result_is_refused(words):
    refused(words, mb.propagate, simulator(), Returned(RETURNED[words]), BOX, error=mb.PropagationError)


POINTS = {
    r"finite samples \(N, 2\) of the parameters a, b, got shape \(2,\)": (2.0, 0.0),
    "got nan or inf": ((np.nan, 0.0),),
    "got 'middle'": "middle",
    r"a = 9 is outside of its interval \[1, 3\]": ((9.0, 0.0),),
}


@pytest.mark.parametrize("words", POINTS)
def test_runs_outside_of_the_box_are_refused(words):
    refused(words, mb.propagate, simulator(), Returned((ZERO, ZERO), POINTS[words]), BOX)


def test_failed_runs_are_nan_and_told():
    def fails(a, b):
        return 1 / 0 if b > 0 else straight(a, b)

    told = refused("lower of x is nan at t = 0 s. Values of failed runs are nan.", mb.propagate, simulator(fails),
        Corners(), BOX, error=mb.PropagationError)  # fmt: skip
    assert "division by zero (a=1, b=0.5, c=7)" in told


def test_faults_of_a_method_are_one_error():
    class Faulty(mb.Method):
        kind = "sampled"

        def bounds(self, runs):
            runs.lower[:] = 0.0

    told = r"Faulty\(\): `bounds` raised ValueError: assignment destination is read-only"
    refused(told, mb.propagate, simulator(), Faulty(), BOX, error=mb.PropagationError)
    found = mb.compare(simulator(), [mb.Vertex(), Faulty()], BOX, reference=mb.Vertex())
    assert [row.name for row in found.not_run] == ["Faulty()"]


def test_a_method_without_a_kind_is_refused():
    class Kindless(mb.Method):
        def bounds(self, runs):
            return ZERO, ZERO

    refused("Kindless: kind must be 'enclosure' or 'estimate' or 'sampled'", mb.propagate, simulator(), Kindless(), BOX)


def test_finished_bounds_are_a_row(tmp_path):
    own = simulator()
    made = mb.propagate(own, mb.Vertex(), BOX)
    made.save(tmp_path / "made.json")
    foreign = mb.Bounds(T, ("x", "y"), np.array(made.lower), np.array(made.upper) + 0.4, "sampled", "Other", 12)
    found = mb.compare(own, [mb.Vertex(), mb.Bounds.load(tmp_path / "made.json"), foreign], BOX)
    assert [row.name for row in found.rows] == ["Vertex()", "Vertex(), given", "Other, given"]
    np.testing.assert_allclose(found.rows[1].score.error, 0.0, atol=1e-12)
    assert found.rows[2].score.error[0] > 0.05 and np.isnan(found.rows[2].run_seconds)
    found.save(tmp_path / "found.json")
    assert str(mb.Comparison.load(tmp_path / "found.json")) == str(found)
    assert ["Other,", "given", "sampled", "12", "–", "–"] in [line.split()[:6] for line in str(found).splitlines()]
    found.plot(tmp_path / "found.png")
    found.report(tmp_path / "found.html")


def test_units_of_finished_bounds():
    p = mb.Parameters(l="1 m")
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    scene = mb.Scene(mb.System(ball, parameters=p), {"ball.x": p.l}, [0.0, 1.0], {"x": ball.x})
    box, in_mm = mb.Box(l=(0.95, 1.05)), mb.Box(l=(950.0, 1050.0, "mm"))
    given = mb.propagate(scene, mb.Vertex(), box)
    assert mb.compare(scene, [replace(given, box=in_mm)], box, reference=given).rows[0].score.error.max() < 1e-12
    told = "has the units mm, but the simulator has the units m"
    for call in (
        lambda own: mb.compare(scene, [own], box),
        lambda own: mb.compare(scene, [mb.Vertex()], box, reference=own),
    ):
        refused(told, call, replace(given, units=("mm",)), error=mb.PropagationError)


CHANGES = {
    "must have the shape \\(5, 2\\)": {"lower": ZERO.T, "upper": ZERO.T},
    "lower is above upper": {"lower": ZERO + 1},
    "or not a number": {"upper": ZERO + np.nan},
    "kind must be enclosure or estimate or sampled": {"kind": "nonsense"},
    "method a text on one line": {"method": "two\nlines"},
}


@pytest.mark.parametrize("words", CHANGES)
def test_finished_bounds_that_make_no_sense_are_refused(words):
    given = replace(mb.Bounds(T, ("x", "y"), ZERO, ZERO, "sampled", "Other", 1), **CHANGES[words])
    refused(words, mb.compare, simulator(), [given], BOX, error=mb.PropagationError)


def test_a_proof_that_runs_refute_does_not_limit_the_reference():
    class Wrong(mb.Method):
        kind = "enclosure"

        def bounds(self, runs):
            low, high = Corners().bounds(runs)
            return low + 0.3 * (high - low), high

    with pytest.warns(mb.SymmbWarning, match="outside of the proved bounds of Wrong"):
        found = mb.compare(simulator(), [mb.Vertex(), Wrong()], BOX, reference=mb.Scanning(3))
    np.testing.assert_allclose([row.score.error.mean() for row in found.rows], [0.0, 0.2], atol=0.03)
    assert found.reference.proved_by == ()
    with pytest.warns(mb.SymmbWarning, match="Runs of the method lie outside of its proved bounds"):
        mb.propagate(simulator(), Wrong(), BOX)


def test_finished_bounds_of_something_else_are_refused():
    own = simulator()
    made = mb.propagate(own, mb.Vertex(), BOX)
    refused("is of Box.*but the comparison is of Box", mb.compare, own, [made],
            mb.Box(a=(1.0, 2.0)), error=mb.PropagationError)  # fmt: skip
    other = mb.FunctionSimulator(lambda a, b: T, {"a": 2.0, "b": 0.0}, T, ["x"])
    refused("has the outputs x, y, but the simulator has the outputs x", mb.compare, other, [made], BOX,
            error=mb.PropagationError)  # fmt: skip


MINE = """
import numpy as np
import symmb as mb

class Middle(mb.Method):
    kind = "sampled"

    def bounds(self, runs):
        Y = runs([(runs.lower + runs.upper) / 2])
        return Y[0], Y[0]

class Many(Middle):
    def __init__(self, number):
        self.number = number

class Empty(mb.Method):
    kind = "sampled"

many = Many(3)
"""


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mine:Middle", "Middle()  sampled     1"),
        ("mine:many", "Many()    sampled     1"),
        ("mine:Many", "mine:Many: the class cannot be called without arguments"),
        ("mine:Midle", "mine:Midle: the module has no 'Midle'. Did you mean 'Middle'?"),
        ("mime:Middle", "there is no method 'mime', no file mime.py in this folder, and no module mime"),
        ("mine:np", "expected a method such as"),
        (":Middle", "A method of your own is MODULE:NAME"),
        ("mine:", "A method of your own is MODULE:NAME"),
        ("mine:Empty", "mine:Empty: the class must define the function bounds(self, runs)"),
    ],
)
def test_the_command_line_names_methods_in_files(name, words, tmp_path, monkeypatch, capsys):
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "scene.py").write_text(
        "import symmb as mb\np = mb.Parameters(a=1.0)\nz = mb.States(['z'], lambda z: p.a)\n"
        "scene = mb.Scene(mb.System(z, parameters=p), {'z': 0.0}, [0.0, 1.0], {'z': z.z.value}, mb.Box(a=(0.9, 1.1)))\n"
    )
    monkeypatch.chdir(tmp_path)
    status = main(["compare", "scene.py", "--methods", name, "vertex"])
    told = capsys.readouterr()
    assert words in told.out + told.err and (status == 0) == ("sampled" in words)
