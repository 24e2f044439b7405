"""Gaussian processes of few directions, and bounds of few responses over many parameters."""

import numpy as np
import pytest
from black_boxes import unit_bounds
from conftest import but_long
from faults import warned
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

import symmb as mb
from symmb.bound.searches.covariances import Ridge, Smooth, Sum
from symmb.bound.searches.gaussian_process import GaussianProcess, Kernel

PATIENT = mb.PolynomialChaos(seconds=600.0)
"""These tests are of what surfaces find, not of how long that takes on a machine that does other work as well."""
RNG = np.random.default_rng(5)
X = RNG.uniform(-1, 1, (30, 4))
W, RATES, SUM_RATES = RNG.normal(size=(2, 4)), *np.exp(RNG.normal(size=(2, 4)))
KERNEL = Kernel((Smooth(0.5, RATES), Ridge(0.7, W[0]), Ridge(0.3, W[1]), Sum(0.4, SUM_RATES)), 1e-3)


def covariance(a, b):
    """The formula, pair by pair."""
    total = np.empty((len(a), len(b)))
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            ridges = sum(s * np.exp(-(((x - y) @ w) ** 2) / 2) for s, w in zip((0.7, 0.3), W, strict=True))
            z = SUM_RATES * np.abs(x - y)
            sums = 0.4 * np.mean((1 + z) * np.exp(-z))
            total[i, j] = ridges + sums + 0.5 * np.exp(-np.sum((RATES * (x - y)) ** 2) / 2)
    return total


def test_the_likelihood_is_that_of_a_normal_distribution():
    """Two kernels are compared: the difference holds no constant; the prior is taken off."""
    Y, vector = RNG.normal(size=(30, 2)), KERNEL.vector
    noisy = covariance(X, X) + (KERNEL.noise + 1e-10) * np.eye(30)
    normal = multivariate_normal(np.zeros(30), noisy)
    expected = -sum(normal.logpdf(y) for y in Y.T) - 30 * np.log(2 * np.pi)
    mean, deviation, rates = np.zeros_like(vector), np.full_like(vector, 4.0), [0, 1, 2, 3, 15, 16, 17, 18]
    mean[rates], mean[-1], deviation[rates] = np.log(0.3), np.log(1e-6), 1.5
    prior = np.sum(((vector - mean) / deviation) ** 2) / 2
    value, gradient = GaussianProcess(KERNEL, X, Y).unlikeliness()
    assert value == pytest.approx(expected + prior)
    for i, step in enumerate(1e-6 * np.eye(len(vector))):
        kernels = (KERNEL.with_vector(vector + sign * step) for sign in (1, -1))
        ends = [GaussianProcess(kernel, X, Y).unlikeliness()[0] for kernel in kernels]
        assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(gradient[i], rel=1e-5, abs=1e-5)


def test_mean_and_deviation_are_those_of_a_conditional_normal_distribution():
    Y, places = np.cos(2 * X @ np.ones((4, 1))), RNG.uniform(-1, 1, (6, 4))
    process = GaussianProcess(KERNEL, X, Y)
    between, inverse = covariance(places, X), np.linalg.inv(covariance(X, X) + (KERNEL.noise + 1e-10) * np.eye(30))
    assert_allclose(process.mean(places), between @ inverse @ Y, atol=1e-9)
    variance = np.diag(covariance(places, places) - between @ inverse @ between.T)
    assert_allclose(process.deviation(places), np.sqrt(variance), atol=1e-7)
    place, least = process.smallest(0, -1.0, 2.0, places)
    assert least == pytest.approx(-process.mean(place[None])[0, 0] - 2 * process.deviation(place[None])[0])
    assert least <= (-process.mean(places)[:, 0] - 2 * process.deviation(places)).min()


def test_errors_at_runs_that_are_left_out_are_those_of_the_other_runs():
    Y = np.stack([np.cos(2 * X @ np.ones(4)), X[:, 0] > 0.3], axis=1)
    errors = GaussianProcess(KERNEL, X, Y).left_out_errors()
    for k in range(len(X)):
        others = np.arange(len(X)) != k
        mean = GaussianProcess(KERNEL, X[others], Y[others]).mean(X[k : k + 1])
        assert_allclose(errors[k], Y[k] - mean[0], atol=1e-9)


def distance(bounds, lower, upper):
    """Error of the bounds over the width."""
    return max(abs(bounds.lower[0, 0] - lower), abs(bounds.upper[0, 0] - upper)) / (upper - lower)


@pytest.mark.parametrize("d", but_long([6, 10, 20], 20))
@pytest.mark.parametrize("second", [0.0, 0.05])
def test_ridges_take_few_runs(d, second):
    """Along b, which is orthogonal to a, the cosine is constant, so that both terms reach their extremes together.

    Rounding decides how soon a search finds the directions: functions that differ by 1e-15 took 97 to 278 runs, and
    processors differ as well. Grids take thousands.
    """
    a, b = 0.7 ** np.arange(d), np.zeros(d)
    b[[1, 0]] = 1.0, -0.7
    bounds = unit_bounds(lambda x: np.cos(1 + 3.5 * a @ x) + second * np.sin(2 * b @ x), d, PATIENT)
    assert bounds.evaluations <= 400
    assert distance(bounds, -1 - second, 1 + second) <= 1e-2


def test_sums_of_functions_of_single_combinations_take_few_runs():
    d = 8
    a, b = np.repeat([1.0, 0.0], d // 2), np.repeat([0.0, 1.0], d // 2)
    bounds = unit_bounds(lambda x: np.sin(a @ x) + np.exp(0.4 * b @ x), d, PATIENT)
    assert bounds.evaluations <= 150
    assert distance(bounds, -1 + np.exp(-1.6), 1 + np.exp(1.6)) <= 1e-2


def test_sums_of_kinks_are_bounded_where_all_kinks_meet():
    """No run is at the minimum, where the errors of all kinks have one sign."""
    c, w = np.array([0.31, -0.52, 0.11, 0.63, -0.27]), np.array([0.5, 0.9, 0.4, 0.7, 0.6])
    bounds = unit_bounds(lambda x: w @ np.abs(x - c), len(c), PATIENT)
    assert bounds.evaluations <= 150
    assert distance(bounds, 0.0, w @ (1 + np.abs(c))) <= 2e-2


@pytest.mark.parametrize(("d", "depth"), [(5, 1.1), (8, 1.4)])
def test_steps_between_constants_are_bounded_by_what_many_runs_share(d, depth):
    bounds = unit_bounds(lambda x: float((x > 1 - depth).all()), d, PATIENT)
    assert distance(bounds, 0.0, 1.0) == 0 and bounds.evaluations <= 200


def test_moments_of_a_surface_are_those_of_its_expansion():
    """The second output varies with other parameters, the third not at all."""
    f = lambda x: [np.exp(x[0] + 0.5 * x[1]), np.cosh(1.5 * x[3]) + x[4] ** 3, 1.0]  # noqa: E731
    bounds = unit_bounds(f, 5, mb.PolynomialChaos(tolerance=1e-3, seconds=600.0), outputs=["f", "g", "one"])
    expected = np.array([np.sinh(1) * 2 * np.sinh(0.5), np.sinh(1.5) / 1.5, 1.0])
    assert_allclose(bounds.moments().mean[0], expected, rtol=2e-2)
    assert_allclose(bounds.upper[0], [np.exp(1.5), np.cosh(1.5) + 1, 1.0], rtol=2e-3)
    assert_allclose(bounds.lower[0], [np.exp(-1.5), 0.0, 1.0], atol=1e-2)


@pytest.mark.parametrize(("steps", "rates"), [((0.26, 0.65), (0.6, 0.2, 0.6, 0.6)), ((0.5, 0.3), (1, 0.5, 0.3, 0.2))])
def test_a_surface_that_jumps_is_doubtful(steps, rates):
    """The latest runs lie at the extremes, on one side of the jump: they alone show no error."""

    def f(x):
        u = (x + 1) / 2
        return 0.0 if (u[:2] > steps).any() else np.exp(u @ rates)

    warned("estimated error is above 10 % of the width", unit_bounds, f, len(rates))
