"""The instruction walk against CasADi's own evaluation."""

import math

import casadi as ca
import numpy as np
import pytest
from faults import refused

from symmb import Table
from symmb.declare.symbolic import SOFT, ranges_along
from symmb.declare.symbolic.instructions import interpret, operation_name
from symmb.declare.symbolic.switching import On, laws, switching

FLOATS = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_SIN: math.sin,
    ca.OP_TWICE: lambda a: 2 * a,
    ca.OP_ATAN2: math.atan2,
}


def _floats(code, arguments):
    return FLOATS[code](*arguments)


def test_same_numbers_as_casadi_on_sparse_outputs():
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    matrix = ca.SX(3, 2)
    matrix[0, 0], matrix[2, 1] = ca.sin(x[0]) * y - 4, ca.atan2(x[1], y)
    f = ca.Function("f", [x, y], [matrix, x**2 + 2 * y, ca.SX(2, 2), ca.SX.zeros(2, 1), x])
    values = interpret(f, [[0.3, -1.2], [0.7]], _floats, float)
    for got, expected in zip(values, f([0.3, -1.2], 0.7), strict=True):
        np.testing.assert_allclose(got, expected.nonzeros(), rtol=1e-15)


def test_operands_have_an_order_and_operations_have_names():
    x = ca.SX.sym("x", 2)
    assert interpret(ca.Function("f", [x], [x[0] - x[1]]), [[5.0, 3.0]], _floats, float) == [[2.0]]
    assert operation_name(ca.OP_IF_ELSE_ZERO) == "if_else_zero"
    assert operation_name(12345) == "operation 12345"


def test_wrong_inputs_and_functions_are_told():
    x, m = ca.SX.sym("x", 2), ca.MX.sym("m")
    f = ca.Function("f", [x], [x])
    refused(r"\[2\] structural nonzeros, got \[3\]", interpret, f, [[1.0, 2.0, 3.0]], _floats, float)
    refused("'g' is not an SX Function", interpret, ca.Function("g", [m], [m]), [[1.0]], _floats, float)
    kept = ca.Function("inner", [x], [ca.sin(x)], {"never_inline": True})
    outer = ca.Function("outer", [x], [kept(x)])
    refused("'outer' calls another Function", interpret, outer, [[1.0, 2.0]], _floats, float)


# What depends on time alone, and where expressions have kinks: against functions written by hand.

x, p, t = ca.SX.sym("x"), ca.SX.sym("p"), ca.SX.sym("t")
INPUTS = [(x, On.STATE), (p, On.PARAMETERS), (t, On.TIME)]


def found(expression):
    return switching(ca.Function("f", [x, p, t], [ca.densify(ca.SX(expression))]), INPUTS)


KINKS = [
    (ca.fabs(x - 1), ("fabs",), 1.0), (ca.sign(p * x - 2), ("sign",), 1.0), (ca.fmin(x, 2 - x), ("fmin",), 1.0),
    (ca.fmax(x, p), ("fmax",), 2.0), (ca.if_else(x < 3, x, 2.0), ("comparison",), 3.0),
    (x * ca.floor(t + x), ("floor",), 1.0), (ca.fmod(x, 3.0), ("fmod",), 3.0),
    (ca.fabs(p) + x / ca.fmax(x**2, 1e-24), (), None), (ca.tanh(x) * ca.sqrt(p), (), None),
]  # fmt: skip


@pytest.mark.parametrize(("expression", "names", "where"), KINKS, ids=lambda value: str(value)[:40])
def test_kinks_are_found_with_what_changes_sign_there(expression, names, where):
    """At p = 2 and t = 0."""
    result = found(expression)
    assert result.kinks == names
    if where is not None:
        g = ca.Function("g", [x, p, t], [result.switches])
        below, above = (np.sign(g(where + d, 2.0, 0.0).full().ravel()) for d in (-1e-6, 1e-6))
        assert (below * above == -1).any()


def test_laws_are_the_largest_parts_that_depend_on_time_but_not_on_the_state():
    expression = x * ca.exp(-p * t) + ca.if_else(t > 1, x**2, 0) + p * ca.sin(t) * ca.cos(t)
    values = ca.Function("signals", [p, t], [laws(expression, p, t)])(2.0, 1.5).full().ravel()
    np.testing.assert_allclose(sorted(values), sorted([np.exp(-3.0), 1.0, 2 * np.sin(1.5) * np.cos(1.5)]))
    assert laws(x * p, p, t).numel() == 0


# Ranges of expressions over boxes, against samples.

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
