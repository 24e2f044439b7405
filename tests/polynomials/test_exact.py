"""Exact ranges against dense grids, closed forms and each other."""

import numpy as np
import pytest
from problems import read

import symmb as mb
from symmb.bound.nodes.fit import Fit
from symmb.bound.polynomials.legendre import basis_values, tensor_degree, total_degree

CASES = read("interval_functions")["cases"]


def _range_of(f, d, order, tolerance=1e-6):
    fit = Fit.of(mb.ClenshawCurtis(), mb.TensorDegree(), d, order)
    y = f(*fit.nodes.T)[:, None]
    coefficients = fit.coefficients(fit.functionals @ y, np.ones(len(y), bool))
    low, high = mb.Exact(tolerance).bounds(fit.alpha, coefficients)
    return low[0], high[0]


@pytest.mark.parametrize(("d", "order", "grid"), [(1, 7, 4001), (2, 4, 201), (2, 7, 201), (3, 3, 41), (4, 2, 17)])
def test_contains_dense_grids_and_is_hardly_wider(d, order, grid):
    rng = np.random.default_rng(d)
    alpha = tensor_degree(d, order)
    coefficients = rng.normal(size=(len(alpha), 20)) * 0.7 ** alpha.sum(axis=1)[:, None]
    line = np.cos(np.linspace(0, np.pi, grid))
    values = basis_values(alpha, np.stack(np.meshgrid(*[line] * d), axis=-1).reshape(-1, d)) @ coefficients
    low, high = values.min(axis=0), values.max(axis=0)
    lower, upper = mb.Exact(1e-3).bounds(alpha, coefficients)
    width = high - low
    assert (lower <= low + 1e-12).all() and (upper >= high - 1e-12).all()
    # The tolerance, and what the grid misses: (order pi / grid)^2 / 2 of the half width for each parameter.
    slack = (1.001e-3 + 0.25 * d * (order * np.pi / grid) ** 2) * width
    assert (lower >= low - slack).all() and (upper <= high + slack).all()


@pytest.mark.parametrize("tolerance", [1e-1, 1e-3, 1e-6])
def test_finer_tolerance_stays_within_the_coarser(tolerance):
    alpha = total_degree(3, 4)
    coefficients = np.random.default_rng(0).normal(size=(len(alpha), 30))
    fine = mb.Exact(1e-8).bounds(alpha, coefficients)
    coarse = mb.Exact(tolerance).bounds(alpha, coefficients)
    width = fine[1] - fine[0]
    for excess in (fine[0] - coarse[0], coarse[1] - fine[1]):
        assert (excess >= -1e-8 * width).all() and (excess <= 1.01 * tolerance * width).all()


@pytest.mark.parametrize(
    ("f", "expected"),
    [
        (lambda x, y: x * y, (-1, 1)),
        (lambda x, y: x**2 + 0 * y, (0, 1)),
        (lambda x, y: (x - y) ** 2, (0, 4)),
        (lambda x, y: x**2 - y**2, (-1, 1)),
        (lambda x, y: (x**2 + y**2 - 0.5) ** 2, (0, 2.25)),  # the minimum is a circle
        (lambda x, y: 3 + 0 * x * y, (3, 3)),
        (lambda x, y: 1e9 + 1e-3 * x + 0 * y, (1e9 - 1e-3, 1e9 + 1e-3)),
    ],
)
def test_flat_and_degenerate_polynomials(f, expected):
    low, high = _range_of(f, 2, 4, 1e-3)
    slack = 1.01e-3 * (expected[1] - expected[0]) + 1e-12 * abs(expected[1])
    assert expected[0] - slack <= low <= expected[0] + 1e-12 * abs(expected[1]) + 1e-13
    assert expected[1] - 1e-12 * abs(expected[1]) - 1e-13 <= high <= expected[1] + slack


@pytest.mark.parametrize(
    ("name", "f", "order", "share"),
    [
        ("cubic", lambda x: x**3 - 2 * x**2 + x, 3, 1e-6),
        ("runge", lambda x: 1 / (1 + 25 * x**2), 32, 2e-2),
        ("x_over_1px", lambda x: x / (1 + x), 12, 1e-6),
        ("rosenbrock", lambda x, y: 100 * (y - x**2) ** 2 + (1 - x) ** 2, 4, 1e-6),
        ("ishigami", lambda a, b, c: np.sin(a) + 7 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a), 8, 0.05),
    ],
)
def test_closed_form_ranges(name, f, order, share):
    case = CASES[name]
    box = mb.Box(**{"xyz"[k]: ends for k, ends in enumerate(case["box"])})
    low, high = case["range"]
    lower, upper = _range_of(lambda *xi: f(*box.from_unit(np.stack(xi, axis=1)).T), len(box), order)
    assert abs(lower - low) < share * (high - low) and abs(upper - high) < share * (high - low)


def test_closed_form_of_the_oscillator_over_ten_seconds():
    case = CASES["oscillator"]
    t = np.array(case["t"])
    simulator = mb.FunctionSimulator(lambda w: np.cos(w * t), {"w": 1.0}, t, ["x"])
    box = mb.Box(w=(0.9, 1.1))
    chaos = mb.PolynomialChaos(order=8), mb.PolynomialChaos(tolerance=1e-3)
    for method, error in zip((*chaos, mb.Scanning(201)), (1e-3, 1e-3, 2e-4), strict=True):
        result = mb.propagate(simulator, method, box)
        assert np.abs(np.subtract(result["x"], [case["lower"], case["upper"]])).max() < error


def test_many_polynomials_at_once_equal_single_ones():
    alpha = tensor_degree(2, 3)
    coefficients = np.random.default_rng(5).normal(size=(len(alpha), 3000)) ** 3
    low, high = mb.Exact().bounds(alpha, coefficients)
    picked = [0, 1234, 2999]
    single = [mb.Exact().bounds(alpha, coefficients[:, [k]]) for k in picked]
    np.testing.assert_allclose(low[picked], [pair[0][0] for pair in single], rtol=1e-12)
    np.testing.assert_allclose(high[picked], [pair[1][0] for pair in single], rtol=1e-12)
