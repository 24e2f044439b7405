"""The paper's double pendulum: its bounds by each method and the true ones, against independent computations."""

from functools import cache

import numpy as np
import pytest
from black_boxes import errors_of
from faults import warned
from problems import read

import symmb as mb
from models.double_pendulum import scene
from symmb.study.metrics import Yardstick

DATA = read("double_pendulum_bounds")
TIMES = np.array(DATA["times"])
PAPER, TAYLOR = mb.PolynomialChaos.paper(order=2), mb.Taylor(order=2)

pytestmark = pytest.mark.filterwarnings("ignore:.*Check runs show errors:symmb.SymmbWarning")
"""These methods are known to be off: tests/propagation/test_check_runs.py has what is said about it."""

# Mean error of all states, and over / under in % of the width in the first and in the last five seconds.
KNOWN = [
    (PAPER, 0.05, 9, 0.23, (16.4, 0.28), (36.8, 0.72)),
    (PAPER, 0.20, 9, 0.37, (46.8, 1.5), (67.3, 1.9)),
    (TAYLOR, 0.05, 6, 0.32, (18.9, 0.47), (52.3, 1.3)),
    (TAYLOR, 0.20, 6, 2.0, (96.0, 2.3), (337.0, 1.3)),
]


@pytest.fixture(scope="module")
def simulator():
    return mb.DAESimulator(scene().with_times(TIMES), mb.CVODES(rtol=1e-10))


@pytest.fixture(scope="module")
def bounds(simulator):
    """Bounds of a method, run once for each spread."""
    return cache(lambda method, own: mb.propagate(simulator, method, mb.Box.around(simulator.parameters, own)))


def digits(spread, method):
    case = DATA["cases"][f"{100 * spread:.0f}%"][method]
    return np.array(case["lower"]).T, np.array(case["upper"]).T


def yardstick(lower, upper):
    return Yardstick(lower, upper, np.zeros(12))


@pytest.mark.parametrize("spread", [0.05, 0.2])
@pytest.mark.parametrize(("method", "name"), [(PAPER, "paper2"), (TAYLOR, "taylor2")], ids=["paper", "taylor"])
def test_bounds_agree_with_an_independent_implementation(bounds, method, name, spread):
    result = bounds(method, spread)
    lower, upper = digits(spread, name)
    true = digits(spread, "true")
    largest = (true[1] - true[0]).max(axis=0)
    assert (errors_of(result, lower, upper).max(axis=0) < 1e-4 * largest).all()


@pytest.mark.parametrize(
    ("row", "solver"), [*((row, None) for row in KNOWN), *((row, mb.NSTIFFSI2(step=5e-3)) for row in KNOWN[:2])]
)
def test_metrics_of_the_baselines_and_of_the_paper_with_its_solver(bounds, row, solver):
    """In the paper, it takes steps of 5 ms."""
    method, spread, runs, error, early, late = row
    if solver is None:
        result = bounds(method, spread)
    else:
        own = scene().with_times(TIMES), method, mb.Box.around(scene().system.parameters, spread), solver
        result = warned("exceed a thousandth of their range", mb.propagate, *own)
    assert result.evaluations == runs and result.kind == "estimate"
    true = digits(spread, "true")
    assert yardstick(*true).score(result.lower, result.upper).error.mean() == pytest.approx(error, rel=0.03)
    for half, (over, under) in ((TIMES < 5, early), (TIMES >= 5, late)):
        part = yardstick(true[0][half], true[1][half]).score(result.lower[half], result.upper[half])
        assert 100 * part.over.mean() == pytest.approx(over, rel=0.05)
        assert 100 * part.under.mean() == pytest.approx(under, rel=0.15, abs=0.05)


@pytest.mark.parametrize(("order", "runs", "error"), [(2, 9, 0.0055), (4, 25, 0.0007), (8, 81, 0.0001)])
def test_better_nodes_and_exact_ranges_converge_to_the_true_bounds(bounds, order, runs, error):
    result = bounds(mb.PolynomialChaos(order=order), 0.05)
    assert result.evaluations == runs
    assert yardstick(*digits(0.05, "true")).score(result.lower, result.upper).error.mean() < error


def test_lockstep_and_separate_runs_agree_at_a_fixed_step():
    simulator = mb.DAESimulator(scene().with_times(TIMES), mb.RungeKutta(steps=1000))
    box = mb.Box.around(simulator.parameters, 0.05)
    each = mb.propagate(simulator, PAPER, box)
    lockstep = mb.propagate(simulator, mb.PolynomialChaos.paper(order=2, lockstep=True), box)
    # One time after the other or all times of a node: the same steps, summed in another order.
    np.testing.assert_allclose([lockstep.lower, lockstep.upper], [each.lower, each.upper], atol=1e-9)


@pytest.mark.parametrize(
    ("spread", "tolerance", "most", "mean", "worst", "outer"),
    [
        (5, 1e-2, 61, 1e-2, 4e-2, 5e-2),
        (5, 1e-3, 93, 1e-3, 4e-3, 5e-3),
        (20, 1e-1, 310, 1e-1, 3e-1, 5e-1),
        (20, 1e-2, 650, 1e-2, 2e-2, 5e-2),
    ],
)
def test_the_paper_s_pendulum(spread, tolerance, most, mean, worst, outer):
    """Against bounds from 641,601 runs, all 12 states: runs, errors, and what the estimates cover."""
    own = scene().with_times(TIMES)
    box = mb.Box.around(own.system.parameters, spread / 100)
    bounds = mb.propagate(own, mb.PolynomialChaos(tolerance=tolerance), box)
    lower, upper = digits(spread / 100, "true")
    doubt = np.full(12, 1e-5) / np.sqrt(np.mean((upper - lower) ** 2, axis=0))
    score = Yardstick(lower, upper, doubt).score(bounds.lower, bounds.upper, bounds.estimate)
    assert bounds.evaluations <= most
    assert score.error.mean() <= mean and score.error.max() <= worst and score.outer_error.mean() <= outer
    assert score.coverage.mean() >= 0.99
    assert (bounds.inner[0] >= lower - 2e-5).all() and (bounds.inner[1] <= upper + 2e-5).all()


def test_bounds_of_the_double_pendulum_by_optimization():
    lower, upper = digits(0.05, "true")
    simulator = mb.DAESimulator(scene().with_times(TIMES), mb.CVODES(rtol=1e-8))
    result = mb.propagate(simulator, mb.Optimization(), mb.Box.around(simulator.parameters, 0.05))
    width = np.maximum(upper - lower, 1e-2 * (upper - lower).max(axis=0))
    missed = np.stack([result.lower - lower, upper - result.upper])
    assert missed.min() > -2e-5  # the digits of the stored bounds
    assert (missed < 1e-4 * width + 1e-5).mean() > 0.98
    assert (missed < result.estimate + 1e-5).mean() > 0.98
    assert result.evaluations <= 300
