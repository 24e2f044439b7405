"""Check runs: methods without an estimate of their error say where runs, their polynomial and their bounds disagree."""

import numpy as np
import pytest
from black_boxes import quietly
from faults import refused, warned
from small_scenes import particle
from unit_functions import unit_function

import symmb as mb

FOUND = "Check runs show errors"
T = np.linspace(0.0, 5.0, 101)


def function(f, d=2, **named):
    return unit_function(lambda x: f(*x) * np.ones(len(T)), d, T, **named)


def study(f, method=None, d=2, **named):
    simulator, box = function(f, d, **named)
    return mb.propagate(simulator, method or mb.Vertex(), box)


def oscillator(periods, spread=0.05, number=501):
    """x = cos(sqrt(k) t)."""
    times = np.linspace(0.0, 2 * np.pi * periods, number)
    return particle(lambda p, mass: -p.k * mass.x, times, {"mass.x": 1.0}, k=(1 - spread, 1 + spread))


PAPER, ORDER_8 = mb.PolynomialChaos.paper(2), mb.PolynomialChaos(order=8)


@pytest.mark.parametrize("method", [mb.Taylor(2), mb.Taylor(4), mb.Vertex(), mb.Scanning(7), PAPER, ORDER_8], ids=repr)
@pytest.mark.parametrize("periods", [130, 200])
def test_long_horizons_are_doubted(method, periods):
    bounds = warned(FOUND, mb.propagate, oscillator(periods), method)
    assert len(bounds.doubts) == 1 and bounds.evaluations == method.planned_runs(1)


@pytest.mark.parametrize("method", [mb.Taylor(5), ORDER_8, mb.Scanning(21)], ids=repr)
def test_short_horizons_are_not(method):
    assert not mb.propagate(oscillator(2, number=41), method).doubts


@pytest.mark.parametrize("d", [1, 2, 3, 5])
def test_corners_are_right_where_responses_are_monotone(d):
    assert not study(lambda *x: np.exp(0.4 * sum(x) + 0.1 * T), d=d).doubts


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("at", [-0.4, 0.0, 0.3])
def test_extremes_inside_are_found_beyond_corners(d, at):
    warned("outside of the bounds", study, lambda *x: -((x[0] - at) ** 2) + 0.5 * sum(x[1:]), d=d)


@pytest.mark.parametrize("method", [mb.PolynomialChaos(order=4), mb.PolynomialChaos.paper(3), mb.Vertex()], ids=repr)
@pytest.mark.parametrize("frequency", [17.0, 29.0, 31.0])
def test_waves_between_the_nodes_are_doubted(method, frequency):
    warned(FOUND, study, lambda a, b: np.sin(frequency * a + T) + b, method)


@pytest.mark.parametrize("factor", [1e-200, 1e-20, 1.0, 1e20, 1e200])
def test_doubts_do_not_depend_on_units(factor):
    wide, other = (warned(FOUND, study, lambda a, b, s=s: s * np.cos(3 * a + T) * (2 + b)) for s in (factor, 1.0))
    assert other.doubts == wide.doubts


def test_noise_that_is_told_is_no_disagreement():
    rng = np.random.default_rng(1)
    f, told = lambda a, b: 1e-3 * a + rng.uniform(-1e-2, 1e-2), "noise of the runs is larger than the width"
    bounds = warned(told, study, f, noise={"y": 2e-2})
    assert len(bounds.doubts) == 1


def test_a_failed_check_run_is_told():
    def response(a, b):
        if abs(a) < 0.5:
            raise ValueError("no equilibrium")
        return a + b

    warned("A check run failed, although no run of the method failed: .*equilibri", study, response)


@pytest.mark.parametrize("d", [10, 13])
def test_many_parts_in_many_parameters_are_refused_with_their_number(d):
    simulator, box = function(lambda *x: 0.0, d)
    object.__setattr__(simulator, "jets", pytest.fail)
    told, method = f"takes {2**d} expansions in {d} parameters", mb.Taylor(3, subintervals=2)
    refused(told, mb.propagate, simulator, method, box, error=mb.PropagationError)


def test_a_comparison_has_the_doubts_of_its_studies(tmp_path):
    """What check runs find stands in the rows: the comparison measures it."""
    scene = oscillator(130)
    methods = [mb.Taylor(2), mb.Vertex(), mb.PolynomialChaos(seconds=600.0)]
    found = mb.compare(scene, methods)
    for method, row in zip(methods[:2], found.rows, strict=False):
        assert row.doubts == warned("", mb.propagate, scene, method).doubts
    assert not found.rows[2].doubts and not found.doubts
    found.save(tmp_path / "c.json")
    assert mb.Comparison.load(tmp_path / "c.json").rows[0].doubts == found.rows[0].doubts


@pytest.mark.parametrize("budget", [60, 90])
def test_a_comparison_doubts_what_its_studies_doubt(budget):
    scene, method = oscillator(200), mb.PolynomialChaos(budget=budget)
    told = "The estimated error is above 10 % of the width"
    own = warned(told, mb.propagate, scene, method).doubts
    found = warned(told, mb.compare, scene, [method, mb.Scanning(21)])
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

    # 50 samples end far before the corners of four parameters
    bounds = quietly(study, f, method, d)
    assert bounds.evaluations == method.planned_runs(d) < calls
    (told,) = [remark for remark in bounds.remarks if "checked these bounds" in remark]
    assert told.startswith(f"{calls - bounds.evaluations} further runs")


def test_methods_with_an_estimate_have_no_check_runs():
    bounds = study(lambda a, b: a + b**2, mb.PolynomialChaos())
    assert not any("checked these bounds" in remark for remark in bounds.remarks)


@pytest.mark.parametrize(("n", "told"), [(1, "1 further run checked"), (2, "2 further runs checked")])
def test_one_check_run_is_told_in_the_singular(monkeypatch, n, told):
    monkeypatch.setattr("symmb.bound.bounds.doubts.check_doubts", lambda *_: ((), n))
    bounds = study(lambda a: a, d=1)
    assert f"{told} these bounds. The number of evaluations does not include them." in bounds.remarks
