"""Limits and tolerances at the lowest peak of two hills, which is in the crease between them, against a linear
program."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import linprog
from small_scenes import formulas

import symmb as mb

pytestmark = pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")  # the estimate is large, the limit is decided
HEIGHT = 5.0
CLOSE = 3e-3
"""Distance of limits from the lowest peak, divided by the width of the peak."""


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

    rows, sides = np.column_stack([slopes, -np.ones(2)]), [(-1, 1)] * d + [(None, None)]
    lowest = linprog(np.eye(d + 1)[d], rows, [-HEIGHT, -HEIGHT], bounds=sides).fun
    return formulas(outputs, np.linspace(0, 1, 11), **dict.fromkeys(names, (-1.0, 1.0))), float(lowest)


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
