"""Searches for extremes against samples, rigorous enclosures, closed forms and each other."""

import numpy as np
import pytest
from faults import refused
from numpy.testing import assert_allclose
from problems import read
from scipy.optimize import minimize

import symmb as mb
from symmb import Bernstein, ChebyshevInclusion, Exact, LegendreInclusion
from symmb.bound.nodes.fit import Fit
from symmb.bound.polynomials.chebyshev import LowerSet
from symmb.bound.polynomials.legendre import basis_values, tensor_degree, total_degree
from symmb.bound.polynomials.ranges import dense_extremes
from symmb.bound.reductions import bounded

CUBIC = np.arange(4)[:, None], np.array([[1 / 12], [-1 / 20], [-1 / 12], [1 / 20]])
SPARSE = np.array([[0, 0, 0, 0], [5, 0, 0, 0], [0, 3, 0, 1], [2, 0, 2, 0], [0, 0, 0, 8], [1, 1, 1, 1]])
BASES = [tensor_degree(1, 1), tensor_degree(1, 32), tensor_degree(2, 4), tensor_degree(2, 16), tensor_degree(3, 4),
         total_degree(6, 3), total_degree(10, 2), SPARSE]  # fmt: skip


def random(alpha, m, decay=0.4):
    rng = np.random.default_rng(len(alpha))
    return rng.normal(size=(len(alpha), m)) * decay ** alpha.sum(axis=1)[:, None]


def values(alpha, coefficients, points):
    """Of each polynomial at its own point (m, d)."""
    return np.einsum("mb,bm->m", basis_values(alpha, points), coefficients)


def local_minimum(alpha, a, start):
    """The least value that L-BFGS finds from the best of some samples."""
    f = lambda x: (basis_values(alpha, x[None]) @ a)[0]  # noqa: E731
    return minimize(f, start, bounds=[(-1, 1)] * alpha.shape[1], tol=1e-14).fun


@pytest.mark.parametrize("alpha", BASES, ids=lambda a: f"{a.shape[1]} of {a.max()}")
def test_bounds_lie_around_all_samples_and_near_their_points(alpha):
    coefficients = random(alpha, 20)
    found = Exact(1e-3).search(alpha, coefficients)
    width = found.upper - found.lower
    assert (width > 0).all() and (np.abs([found.at_lower, found.at_upper]) <= 1).all()
    at_lower, at_upper = (values(alpha, coefficients, x) for x in (found.at_lower, found.at_upper))
    rounding = 1e-12 * np.abs(coefficients).sum(axis=0)
    excess = np.maximum(1.01e-3 * width, found.gap) + rounding
    assert (found.lower <= at_lower + rounding).all() and (at_lower <= found.lower + excess).all()
    assert (found.upper >= at_upper - rounding).all() and (at_upper >= found.upper - excess).all()
    points = np.random.default_rng(1).uniform(-1, 1, (3000, alpha.shape[1]))
    points[:1000] = np.sign(points[:1000])
    Y = basis_values(alpha, points) @ coefficients
    assert (found.lower <= Y.min(axis=0) + rounding).all() and (found.upper >= Y.max(axis=0) - rounding).all()
    for k in range(5):
        a, rows = coefficients[:, k], Y[:, k]
        assert local_minimum(alpha, a, points[rows.argmin()]) >= found.lower[k] - rounding[k]
        assert -local_minimum(alpha, -a, points[rows.argmax()]) <= found.upper[k] + rounding[k]
    if alpha.shape[1] < 10:
        assert (found.gap == 0).all()


@pytest.mark.parametrize(("d", "order", "boxes"), [(1, 8, 64), (2, 4, 32), (2, 8, 32), (3, 2, 8)])
def test_within_bernstein_coefficients_of_many_boxes(d, order, boxes):
    alpha = tensor_degree(d, order)
    coefficients = random(alpha, 30)
    low, high = Bernstein(boxes).bounds(alpha, coefficients)
    lower, upper = Exact(1e-6).bounds(alpha, coefficients)
    width = upper - lower
    assert (lower >= low - 1.01e-6 * width).all() and (upper <= high + 1.01e-6 * width).all()
    assert (high - low <= 1.05 * width).all()


def test_the_cubic_to_twelve_digits():
    found = Exact(1e-12).search(*CUBIC)
    assert_allclose([found.lower[0], found.upper[0]], [0, 4 / 27], rtol=0, atol=1e-12)
    assert_allclose([found.at_lower[0, 0] ** 2, found.at_upper[0, 0]], [1, -1 / 3], rtol=0, atol=1e-5)
    assert found.gap[0] == 0


@pytest.mark.parametrize("matrix, least", [([[3, 1], [1, 2]], 0.0), ([[1, 2], [2, 1]], -2.0), ([[1, 1], [1, 1]], 0.0)])
def test_quadratic_forms(matrix, least):
    alpha = total_degree(2, 2)
    points = np.random.default_rng(0).uniform(-1, 1, (30, 2))
    values, exact = basis_values(alpha, points), np.einsum("ni,ij,nj->n", points, np.array(matrix), points)
    coefficients = np.linalg.solve(values.T @ values, values.T @ exact)
    found = Exact(1e-9).search(alpha, coefficients[:, None])
    assert_allclose([found.lower[0], found.upper[0]], [least, np.sum(matrix)], rtol=0, atol=1e-7)


def test_constants_and_what_is_not_finite():
    alpha = tensor_degree(2, 3)
    coefficients = np.zeros((len(alpha), 4))
    coefficients[0] = [0.0, 3.0, 1e9, np.nan]
    coefficients[:, 2] += 1e-9 * np.random.default_rng(0).normal(size=len(alpha))
    found = Exact().search(alpha, coefficients)
    assert_allclose([found.lower[:3], found.upper[:3]], [[0, 3, 1e9]] * 2, rtol=1e-12)
    assert np.isnan([found.lower[3], found.upper[3]]).all()
    assert_allclose(found.gap[:3], 0)


def test_what_the_budget_leaves_open_is_told():
    alpha = total_degree(8, 3)
    coefficients = random(alpha, 10, 0.7)
    small, large = (Exact(1e-3, budget).search(alpha, coefficients) for budget in (30, 20_000))
    assert (large.gap == 0).all() and (small.gap > 0).all()
    width = large.upper - large.lower
    assert (small.lower <= large.lower + 1e-3 * width).all() and (small.upper >= large.upper - 1e-3 * width).all()
    for x, bound, sign in ((small.at_lower, small.lower, 1), (small.at_upper, small.upper, -1)):
        assert (sign * (values(alpha, coefficients, x) - bound) <= small.gap + 1e-3 * width + 1e-12).all()


@pytest.mark.parametrize(
    ("inclusion", "low", "high"),
    [
        (LegendreInclusion(), -1 / 10, 9 / 40), (ChebyshevInclusion(), -1 / 16, 3 / 16), (Bernstein(), 0, 1 / 3),
        (Bernstein(2), 0, 1 / 6), (Bernstein(200), 0, 4 / 27),
    ],
)  # fmt: skip
def test_the_cubic_by_every_inclusion(inclusion, low, high):
    lower, upper = inclusion.bounds(*CUBIC)
    assert_allclose([lower[0], upper[0]], [low, high], rtol=0, atol=1e-12 if inclusion != Bernstein(200) else 1e-5)
    chaos = mb.PolynomialChaos(order=3, range=inclusion)
    simulator = mb.FunctionSimulator(lambda x: [x**3 - 2 * x**2 + x], {"x": 0.5}, [0.0], ["f"])
    bounds = bounded(chaos, simulator, mb.Box(x=(0, 1)))
    assert_allclose([bounds.lower[0, 0], bounds.upper[0, 0]], [lower[0], upper[0]], rtol=0, atol=1e-12)


@pytest.mark.parametrize("alpha", BASES[:6], ids=lambda a: f"{a.shape[1]} of {a.max()}")
def test_inclusions_contain_exact_ranges(alpha):
    coefficients = random(alpha, 50)
    lower, upper = Exact(1e-6).bounds(alpha, coefficients)
    for inclusion in (LegendreInclusion(), ChebyshevInclusion(), Bernstein()):
        low, high = inclusion.bounds(alpha, coefficients)
        slack = 1e-5 * (upper - lower)  # orders of 32 lose digits on the way to Bernstein coefficients
        assert (low <= lower + slack).all() and (high >= upper - slack).all()


def test_chebyshev_coefficients_are_those_of_numpy():
    coefficients = random(SPARSE, 7)
    products = LowerSet.of(SPARSE)
    C = products.from_legendre(coefficients)
    points = np.random.default_rng(0).uniform(-1, 1, (9, 4))
    T = np.prod(
        [np.polynomial.chebyshev.chebvander(points[:, k], 8)[:, products.alpha[:, k]] for k in range(4)], axis=0
    )
    assert_allclose(T @ C, basis_values(SPARSE, points) @ coefficients, rtol=0, atol=1e-13)


def test_too_many_bernstein_coefficients():
    alpha = total_degree(20, 2)
    refused(r"20 parameters.*Use Exact\(\)", Bernstein().bounds, alpha, np.ones((len(alpha), 1)))


@pytest.mark.parametrize("scale", [1e-200, 1e-30, 1.0, 1e150], ids=str)
@pytest.mark.parametrize("order", [4, 12])
def test_dense_search_in_single_precision_sees_small_ranges_on_large_constants(order, scale):
    alpha = tensor_degree(2, order)
    rng = np.random.default_rng(0)
    c = rng.normal(size=(len(alpha), 37)) * 0.5 ** alpha.sum(axis=1)[:, None]
    expected = dense_extremes(alpha, c)
    c[0] += 1e4
    low, high, *_ = dense_extremes(alpha, scale * c)
    width = expected[1] - expected[0]
    assert_allclose((low / scale - 1e4 - expected[0]) / width, 0, atol=1e-6)
    assert_allclose((high / scale - 1e4 - expected[1]) / width, 0, atol=1e-6)


# Exact ranges against dense grids, closed forms and each other.


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
