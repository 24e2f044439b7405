"""Check runs: methods without an estimate of their error say where runs, their polynomial and their bounds disagree."""

import warnings

import numpy as np
import pytest
from faults import warned
from small_scenes import particle
from unit_functions import unit_function

import symmb as mb

FOUND = "Check runs show errors"
T = np.linspace(0.0, 5.0, 101)


def function(f, d=2, t=T, **named):
    return unit_function(lambda x: f(*x) * np.ones(len(t)), d, t, **named)


def oscillator(periods, spread=0.05, number=501):
    """x = cos(sqrt(k) t)."""
    times = np.linspace(0.0, 2 * np.pi * periods, number)
    return particle(lambda p, mass: -p.k * mass.x, times, {"mass.x": 1.0}, k=(1 - spread, 1 + spread))


LONG = [mb.Taylor(2), mb.Taylor(4), mb.Vertex(), mb.Scanning(7)]
POLYNOMIALS = [mb.PolynomialChaos.paper(2), mb.PolynomialChaos(order=8)]


@pytest.mark.parametrize("method", LONG + POLYNOMIALS, ids=repr)
@pytest.mark.parametrize("periods", [130, 200])
def test_long_horizons_are_doubted(method, periods):
    bounds = warned(FOUND, mb.propagate, oscillator(periods), method)
    assert len(bounds.doubts) == 1 and bounds.evaluations == method.planned_runs(1)


@pytest.mark.parametrize("method", [mb.Taylor(5), mb.PolynomialChaos(order=8), mb.Scanning(21)], ids=repr)
def test_short_horizons_are_not(method):
    assert not mb.propagate(oscillator(2, number=41), method).doubts


@pytest.mark.parametrize("d", [1, 2, 3, 5])
def test_corners_are_right_where_responses_are_monotone(d):
    simulator, box = function(lambda *x: np.exp(0.4 * sum(x) + 0.1 * T), d)
    assert not mb.propagate(simulator, mb.Vertex(), box).doubts


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("at", [-0.4, 0.0, 0.3])
def test_extremes_inside_are_found_beyond_corners(d, at):
    simulator, box = function(lambda *x: -((x[0] - at) ** 2) + 0.5 * sum(x[1:]), d)
    warned("outside of the bounds", mb.propagate, simulator, mb.Vertex(), box)


@pytest.mark.parametrize("method", [mb.PolynomialChaos(order=4), mb.PolynomialChaos.paper(3), mb.Vertex()], ids=repr)
@pytest.mark.parametrize("frequency", [17.0, 29.0, 31.0])
def test_waves_between_the_nodes_are_doubted(method, frequency):
    simulator, box = function(lambda a, b: np.sin(frequency * a + T) + b)
    warned(FOUND, mb.propagate, simulator, method, box)


@pytest.mark.parametrize("factor", [1e-200, 1e-20, 1.0, 1e20, 1e200])
def test_doubts_do_not_depend_on_units(factor):
    simulator, box = function(lambda a, b: factor * np.cos(3 * a + T) * (2 + b))
    wide = warned(FOUND, mb.propagate, simulator, mb.Vertex(), box)
    other, box = function(lambda a, b: np.cos(3 * a + T) * (2 + b))
    with pytest.warns(mb.SymmbWarning, match=FOUND):
        assert mb.propagate(other, mb.Vertex(), box).doubts == wide.doubts


def test_noise_that_is_told_is_no_disagreement():
    rng = np.random.default_rng(1)
    simulator, box = function(lambda a, b: 1e-3 * a + rng.uniform(-1e-2, 1e-2), noise={"y": 2e-2})
    bounds = warned("noise of the runs is larger than the width", mb.propagate, simulator, mb.Vertex(), box)
    assert len(bounds.doubts) == 1


def test_a_failed_check_run_is_told():
    def response(a, b):
        if abs(a) < 0.5:
            raise ValueError("no equilibrium")
        return a + b

    simulator, box = function(response)
    with pytest.warns(mb.SymmbWarning, match="A check run failed, although no run of the method failed: .*equilibri"):
        mb.propagate(simulator, mb.Vertex(), box)


@pytest.mark.parametrize("d", [10, 13])
def test_many_parts_in_many_parameters_are_refused_with_their_number(d):
    class Jets(mb.FunctionSimulator):
        def jets(self, p0, directions, order):
            raise AssertionError

    names = [f"x{i}" for i in range(d)]
    simulator = Jets(lambda **p: T, dict.fromkeys(names, 0.0), T, ["y"])
    with pytest.raises(mb.PropagationError, match=f"takes {2**d} expansions in {d} parameters"):
        mb.propagate(simulator, mb.Taylor(3, subintervals=2), mb.Box(**dict.fromkeys(names, (-1.0, 1.0))))


def test_a_comparison_has_the_doubts_of_its_studies(tmp_path):
    """What check runs find stands in the rows: the comparison measures it."""
    scene = oscillator(130)
    methods = [mb.Taylor(2), mb.Vertex(), mb.PolynomialChaos(seconds=600.0)]
    found = mb.compare(scene, methods)
    for method, row in zip(methods[:2], found.rows, strict=False):
        with pytest.warns(mb.SymmbWarning):
            assert row.doubts == mb.propagate(scene, method).doubts
    assert not found.rows[2].doubts and not found.doubts
    found.save(tmp_path / "c.json")
    assert mb.Comparison.load(tmp_path / "c.json").rows[0].doubts == found.rows[0].doubts


@pytest.mark.parametrize("budget", [60, 90])
def test_a_comparison_doubts_what_its_studies_doubt(budget):
    scene, method = oscillator(200), mb.PolynomialChaos(budget=budget)
    with pytest.warns(mb.SymmbWarning, match="The estimated error is above 10 % of the width"):
        own = mb.propagate(scene, method).doubts
    found = warned("The estimated error is above 10 % of the width", mb.compare, scene, [method, mb.Scanning(21)])
    assert found.doubts == tuple(f"{method!r}: {doubt}" for doubt in own)


@pytest.mark.parametrize("d", [1, 2, 4])
@pytest.mark.parametrize(
    "method", [mb.MonteCarlo(50), mb.Vertex(), mb.PolynomialChaos(order=2), mb.Scanning(3)], ids=repr
)
def test_the_number_of_check_runs_is_told(method, d):
    calls = 0

    def f(*x):
        nonlocal calls
        calls += 1
        return sum(x) + 0.1 * x[0] ** 2

    simulator, box = function(f, d)
    # 50 samples end far before the corners of four parameters
    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        bounds = mb.propagate(simulator, method, box)
    assert bounds.evaluations == method.planned_runs(d) < calls
    (told,) = [remark for remark in bounds.remarks if "checked these bounds" in remark]
    assert told.startswith(f"{calls - bounds.evaluations} further runs")


def test_methods_with_an_estimate_have_no_check_runs():
    bounds = mb.propagate(*function(lambda a, b: a + b**2)[:1], mb.PolynomialChaos(), function(lambda a, b: a)[1])
    assert not any("checked these bounds" in remark for remark in bounds.remarks)


@pytest.mark.parametrize(("n", "told"), [(1, "1 further run checked"), (2, "2 further runs checked")])
def test_one_check_run_is_told_in_the_singular(monkeypatch, n, told):
    monkeypatch.setattr("symmb.bound.bounds.doubts.check_doubts", lambda *_: ((), n))
    simulator, box = function(lambda a: a, 1)
    bounds = mb.propagate(simulator, mb.Vertex(), box)
    assert f"{told} these bounds. The number of evaluations does not include them." in bounds.remarks
