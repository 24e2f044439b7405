"""Ranges of expressions over boxes, against samples."""

import casadi as ca
import numpy as np
import pytest

from symmb import Table
from symmb.declare.symbolic import SOFT, ranges_along

X, P, T = ca.SX.sym("x", 3), ca.SX.sym("p", 1), ca.SX.sym("t")
_A, _B, _C = ca.vertsplit(X)
FORMULAS = {
    "polynomial": _A * _B - 2 * _C**3 + _A**2,
    "wheel": ca.cos(7 * _A) + 0.9 * ca.sin(_B + P * T),
    "bump": 0.1 / (1 + ((_A - 0.3) / 0.01) ** 2) - _B,
    "roots and powers": ca.sqrt(ca.fabs(_A)) + ca.fabs(_B) ** 1.5 - (1 + _C**2) ** -1.5,
    "angles": ca.atan2(_A, _B) + ca.tan(_C / 9) + ca.acos(ca.tanh(_A)),
    "fronts": ca.tanh(30 * _A) * ca.exp(-(_B**2)) + 1 / ca.cosh(_C) ** 2,
    "branches": ca.if_else(_A < _B, _C, -2 * _C) + ca.fmin(_A, _B) * ca.fmax(_B, 0.1) + ca.copysign(_B, _C),
    "table": Table([-1.0, -0.2, 0.1, 0.5, 1.3], [0.3, 0.1, 0.6, 0.5, -0.2])(_A) + ca.if_else(_B < P, 5 + _C, 6.0),
    "whole numbers": ca.floor(_A) + ca.ceil(2 * _B) + ca.fmod(_C, 0.7) + ca.remainder(_A, 0.9),
}


@pytest.mark.parametrize("formula", FORMULAS.values(), ids=FORMULAS)
def test_ranges_contain_values_and_changes_along_a_path(formula):
    """A straight path from x to x + dx: changes of the value from one time to the next are between the bounds."""
    box, bounds = ranges_along(formula, X, P, T)
    f, of_box = ca.Function("f", [X, P, T], [formula]), ca.Function("bounds", [box, P], [bounds])
    rng = np.random.default_rng(3)
    for size in 10.0 ** rng.uniform(-3, 0.7, 60):
        x, dx, p, t, h = rng.normal(size=3), size * rng.normal(size=3), rng.normal(), rng.normal(), size * rng.random()
        share = np.linspace(0, 1, 301)
        values = np.array(f(x[:, None] + dx[:, None] * share, p, t + h * share[None])).ravel()
        ends = np.sort([x, x + dx], axis=0)
        least, largest, fall, rise = np.array(of_box(np.concatenate([*ends, dx, dx, [t, t + h, h]]), p)).ravel()
        rounding = 1e-9 * (1 + np.abs(values).max())
        assert least - rounding <= values.min() and values.max() <= largest + rounding
        slopes = 300 * np.diff(values)
        assert np.isnan(fall) or fall - 300 * rounding <= slopes.min()
        assert np.isnan(rise) or slopes.max() <= rise + 300 * rounding


def test_ranges_of_short_parts_are_narrow():
    """Their width falls with that of the box, so that halving a part tells its roots."""
    box, bounds = ranges_along(ca.vertcat(*list(FORMULAS.values())[:6]), X, P, T)
    of_box = ca.Function("bounds", [box, P], [bounds])
    x = np.array([0.31, 0.4, -0.7])
    widths = []
    for size in (1e-3, 1e-5):
        ends = np.concatenate([x, x + size, [size] * 6, [0.2, 0.2 + size, size]])
        least, largest, fall, rise = np.split(np.array(of_box(ends, 1.3)).ravel(), 4)
        widths.append([largest - least, rise - fall])
    assert np.all(np.array(widths[1]) < 0.02 * np.array(widths[0]))


@pytest.mark.parametrize("ends", [(-2.0, 0.5), (0.5, 1.5), (0.99, 1.01), (1.5, 3.0)])
def test_a_choice_has_the_values_of_what_may_be_chosen(ends):
    """Not those of a sum, one part of which is 0; and a comparison that marks no jump has none."""
    low, high = ends
    for condition, jumps in ((_A < 1, True), (_A - 1 < -SOFT, False)):
        box, bounds = ranges_along(ca.if_else(condition, _A + 5, 6.0), X, P, T)
        x = [low, 0, 0, high, 0, 0]
        found = np.array(ca.Function("bounds", [box, P], [bounds])([*x, *[high - low, 0, 0] * 2, 0, 1, 1], 0)).ravel()
        is_open, least = low < 1 < high, min(low + 5, 6)
        assert found[0] == pytest.approx(least) and found[1] <= 5 + high + 1e-12
        assert np.isfinite(found[2:]).all() == (not jumps or not is_open)
