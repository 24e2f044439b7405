"""Tables against SciPy's interpolants, outside their points, in every derivative and in both engines."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import PchipInterpolator

import symmb as mb
from symmb.codegen import Engine, Tolerances, model_function
from symmb.codegen.fallback import ArrayEngine

RNG = np.random.default_rng(11)
CURVES = {
    "two points": ([0.0, 2.0], [1.0, -3.0]),
    "three points": ([0.0, 0.5, 2.0], [1.0, 1.0, 4.0]),
    "a peak": ([0.0, 1e-3, 4e-3, 9e-3], [0.0, 300e6, 120e6, 0.0]),
    "a step": ([-1.0, 0.0, 1e-6, 1.0], [0.0, 0.0, 1.0, 1.0]),
    "ups and downs": (np.cumsum(RNG.uniform(0.01, 1, 30)), RNG.normal(size=30)),
    "turning at the ends": ([0.0, 1.0, 1.1, 3.0, 3.1], [0.0, 1.0, -2.0, -2.1, 5.0]),
}
X = ca.SX.sym("x")


@pytest.mark.parametrize("curve", CURVES)
def test_a_table_is_scipy_s_monotone_interpolant(curve):
    x, y = (np.array(values) for values in CURVES[curve])
    at = np.sort(np.concatenate([x, RNG.uniform(x[0], x[-1], 300)]))
    f, pchip, expression = mb.Table(x, y), PchipInterpolator(x, y), None
    inside = ~np.isin(at, x)  # second derivatives jump at the points
    for order in range(4):
        expression = f(X) if expression is None else ca.jacobian(expression, X)
        values = ca.Function("f", [X], [expression])(at[None]).full()[0]
        known = pchip.derivative(order)(at) if order else pchip(at)
        where = np.ones(len(at), bool) if order == 0 else inside
        assert_allclose(values[where], known[where], rtol=1e-9, atol=1e-11 * max(1.0, np.abs(known).max()))


@pytest.mark.parametrize("curve", CURVES)
def test_a_table_keeps_to_its_points_and_beyond_them_to_its_ends(curve):
    x, y = (np.array(values) for values in CURVES[curve])
    f = ca.Function("f", [X], [mb.Table(x, y)(X), ca.jacobian(mb.Table(x, y)(X), X)])
    values, slopes = (a.full()[0] for a in f(np.array([[x[0] - 1e9, x[0] - 1e-3, x[-1] + 1e-3, x[-1] + 1e9]])))
    assert_array_equal(values, [y[0], y[0], y[-1], y[-1]])
    assert_array_equal(slopes, 0)
    fine = f(np.linspace(x[0], x[-1], 4001)[None])[0].full()[0]
    assert fine.min() >= y.min() - 1e-12 * np.ptp(y) and fine.max() <= y.max() + 1e-12 * np.ptp(y)
    assert_allclose(f(x[None])[0].full()[0], y, rtol=1e-14, atol=1e-14 * np.ptp(y))


@pytest.mark.parametrize("kind", [Engine, ArrayEngine])
def test_lanes_read_a_table_each_at_its_own_place(kind):
    x, y = CURVES["ups and downs"]
    table, state, p, t = mb.Table(x, y), ca.SX.sym("x"), ca.SX.sym("p"), ca.SX.sym("t")
    outputs = ca.vertcat(table(state), ca.jacobian(table(state), state), table(t))
    engine = kind(model_function(state, p, t, ca.SX(0.0), outputs, None), np.array([2.5]), Tolerances(1e-8, 1e-8))
    at = np.linspace(x[0] - 1, x[-1] + 1, 101)
    Y, _ = engine.values(at[:, None], np.ones((101, 1)))
    expected = ca.Function("f", [state, t], [outputs])(at[None], 2.5).full().T
    assert_allclose(Y[:, 0], expected, rtol=1e-12, atol=1e-12)


def test_ten_tables_of_thirty_points_are_cheap():
    """Some 15 instructions a point; with slope and curvature less than twice as many."""
    table = mb.Table(*CURVES["ups and downs"])
    value = table(X)
    slope = ca.jacobian(value, X)
    f, g = (
        ca.Function("f", [X], outputs, {"cse": True}) for outputs in ([value], [value, slope, ca.jacobian(slope, X)])
    )
    assert f.n_instructions() < 16 * 30
    assert g.n_instructions() < 2 * f.n_instructions()


@pytest.mark.parametrize(
    ("x", "y", "text"),
    [
        ([0.0, 1.0, 1.0], [1, 2, 3], r"Table: x must increase, but x\[2\] = 1 follows 1"),
        ([0.0, 1.0], [1, 2, 3], r"Table: x \(2,\) and y \(3,\) must be lists of one length"),
        ([0.0], [1.0], "at least 2"),
        ([0.0, np.nan], [1.0, 2.0], "Table: x and y must be finite"),
        ([0.0, "one"], [1.0, 2.0], "Table: x and y must be lists of numbers"),
        (np.arange(100_000.0), np.zeros(100_000), "Table: 100000 points, at most 10000: each adds terms"),
        ([0.0, 1.0], [1.0, X], "must be finite numbers; multiply the table itself"),
    ],
)
def test_points_that_make_no_curve_are_refused(x, y, text):
    with pytest.raises(mb.DeclarationError, match=text):
        mb.Table(x, y)


def test_a_table_of_what_is_no_expression_is_refused():
    with pytest.raises(mb.DeclarationError, match="Table: 'x' is no number and no CasADi SX expression"):
        mb.Table([0, 1], [0, 1])("x")
