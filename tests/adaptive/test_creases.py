"""Limits and tolerances at the lowest peak of two hills, which is in the crease between them, against a linear
program."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import linprog
from small_scenes import formulas

import symmb as mb
from symmb.bound.searches.direct_search import direct_search
from symmb.bound.searches.gradient_sampling import gradient_sampling

pytestmark = pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")  # the estimate is large, the limit is decided
HEIGHT = 5.0
CLOSE = 3e-3
"""Distance of limits from the lowest peak, divided by the width of the peak."""


def least_of_slopes(slopes, heights) -> float:
    """The largest value over the box of the least of two functions that are linear in d parameters."""
    d, rows = slopes.shape[1], np.column_stack([-slopes, np.ones(2)])
    return float(-linprog(-np.eye(d + 1)[d], rows, heights, bounds=[(-1, 1)] * d + [(None, None)]).fun)


def two_hills(seed: int) -> tuple[mb.Scene, float]:
    """A curve that goes from a to b, both linear in the parameters, and its lowest peak, max(a, b), over the box."""
    rng = np.random.default_rng(seed)
    d = int(rng.integers(4, 9))
    names, opposed, common = [f"p{k}" for k in range(d)], rng.normal(size=d), 0.2 * rng.normal(size=d)
    slopes = 0.1 * np.stack([common + opposed, common - opposed])

    def outputs(p):
        a, b = (
            HEIGHT + sum(g * getattr(p, name) for name, g in zip(names, own, strict=True)) for own in slopes.tolist()
        )
        curve = (a + b) / 2 + (a - b) / 2 * ca.cos(np.pi * mb.t)
        return {"peak": mb.maximum(curve), "curve": curve}

    lowest = -least_of_slopes(-slopes, [-HEIGHT, -HEIGHT])
    return formulas(outputs, np.linspace(0, 1, 11), **dict.fromkeys(names, (-1.0, 1.0))), lowest


@pytest.mark.parametrize("seed", [10, 22])
def test_limits_beside_the_lowest_peak_are_decided(seed):
    scene, lowest = two_hills(seed)
    bounds = mb.propagate(scene)
    k = bounds.names.index("peak")
    distance = CLOSE * float((bounds.upper - bounds.lower)[:, k].max())
    assert [bounds.check({"peak": (lowest + sign * distance, None)}).kept for sign in (-1, 1)] == [True, False]


@pytest.mark.long
def test_tolerances_end_at_the_lowest_peak():
    scene, lowest = two_hills(10)
    found = mb.tolerances(scene, {"peak": ((HEIGHT + lowest) / 2, None)})
    assert found.check.kept and 0.49 < found.factor <= 0.5


def test_polls_end_beside_the_lowest_peak():
    """The last poll is 0.05 of the width beside this lowest peak."""
    scene, lowest = two_hills(10)
    factor = 0.5425
    box = mb.Box(**dict.fromkeys(scene.box.names, (-factor, factor)))
    check = mb.propagate(scene, box=box).check({"peak": ((HEIGHT + lowest) / 2, None)})
    assert check.kept is False and check["peak"].margin.min() > (0.5 - factor) * (HEIGHT - lowest) * 1.001


# Local searches without derivatives, against places that are known


def ridge(x):
    """Largest, 0, at (0.2, 0.2): along the axes every other point of the ridge is a summit."""
    return -np.maximum(np.abs(x[:, 0] + x[:, 1] - 0.4), 3 * np.abs(x[:, 0] - x[:, 1]))


def bowl(x):
    """Largest, 2, at the corner (1, -1, 1)."""
    return x @ [1.0, -0.5, 0.5] * (1 + 0.1 * x[:, 1]) + 0.2


def hill(x):
    return 1 - np.square(x - [0.3, -0.1, 0.7, 0.0]).sum(axis=1)


@pytest.mark.parametrize(("f", "place", "value", "tolerance"), [
    (ridge, (0.2, 0.2), 0.0, 0.05), (bowl, (1, -1, 1), 2.0, 1e-12), (hill, (0.3, -0.1, 0.7, 0.0), 1.0, 1e-9),
    (lambda x: x[:, 0] / 8 - np.abs(np.abs(x[:, 0]) - 0.5), (0.5,), 1 / 16, 0.01),  # beside a lower summit at -0.5
])  # fmt: skip
def test_it_finds_the_largest_value(f, place, value, tolerance):
    found = direct_search(f, np.outer([-0.6, 0.8], np.ones(len(place))), most=1000)
    assert found.value == pytest.approx(value, abs=tolerance) and found.value == f(found.place[None])[0]
    assert 0 <= found.error < 0.4 and np.abs(found.place - place).max() < 5 * tolerance**0.5


def test_it_ends_early_and_says_so():
    calls = []

    def f(x):
        calls.append(len(x))
        return hill(x)

    starts = -np.ones((1, 4))
    assert direct_search(f, starts, most=20).error == np.inf and sum(calls) < 20 + 9
    assert direct_search(f, starts, most=1000, enough=-4.0).value > -4.0


def test_places_without_a_value_are_left_out():
    found = direct_search(lambda x: np.where(x[:, 0] > 0.5, -np.inf, bowl(x)), np.zeros((1, 3)), most=1000)
    assert found.value == pytest.approx(1.55, abs=0.2) and found.place[0] <= 0.5
    assert direct_search(lambda x: np.full(len(x), -np.inf), np.zeros((1, 3)), most=1000).error == np.inf


@pytest.mark.parametrize("seed", range(5))
def test_a_crease_is_followed_to_its_largest_value(seed):
    # The least of two slopes whose normals are opposed in all but one direction: the crease leads to a vertex of a
    # linear program, which SciPy knows.
    rng = np.random.default_rng(seed)
    d = int(rng.integers(4, 11))
    slope, drift = rng.normal(size=d), 0.1 * rng.normal(size=d)
    slopes, heights = np.stack([slope + drift, drift - slope]), rng.normal(size=2) * 0.3

    def f(x):
        return (x @ slopes.T + heights).min(axis=1)

    starts = np.random.default_rng(seed).uniform(-1, 1, (16, d))
    polled = direct_search(f, starts, most=600)
    found = gradient_sampling(f, polled.place, polled.value, 1e-4, np.inf)
    assert found.value == pytest.approx(least_of_slopes(slopes, heights), abs=1e-6)
