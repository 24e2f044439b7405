"""Polynomial chaos: the paper's numbers, chaospy's coefficients, failed nodes, lockstep, levels."""

import chaospy
import numpy as np
import pytest
from oscillators import BOX, TIMES, Wave, wave, wave_bounds

from symmb import (
    Box,
    ClenshawCurtis,
    Exact,
    FunctionSimulator,
    Gauss,
    LegendreInclusion,
    PolynomialChaos,
    PropagationError,
    SparseGrid,
    SymmbWarning,
    TensorDegree,
    TotalDegree,
    propagate,
)
from symmb.nodes.fit import Fit
from symmb.polynomials.legendre import basis_ranges, basis_values, total_degree, univariate_minimum

CUBIC = FunctionSimulator(lambda x: [[x**3 - 2 * x**2 + x]], {"x": 0.5}, [0.0], ["f"])


def _coefficients(fit, f):
    return fit.coefficients(fit.functionals @ f(fit.nodes), np.ones(len(fit.nodes), bool))


# -- The paper ---------------------------------------------------------------------------------------------


def test_equation_24_ranges_of_the_basis():
    known = [1, -1, -1 / 2, -1, -3 / 7, -1, -0.414750, -1, -0.409690, -1, -0.407276, -1, -0.405937]
    np.testing.assert_allclose([univariate_minimum(n) for n in range(13)], known, atol=6e-7)
    assert abs(univariate_minimum(4) + 3 / 7) < 1e-14


@pytest.mark.parametrize("d", [1, 2, 3])
def test_ranges_of_products_are_attained_and_never_left(d):
    alpha = total_degree(d, 6)
    line = np.cos(np.linspace(0, np.pi, {1: 4001, 2: 201, 3: 41}[d]))
    values = basis_values(alpha, np.stack(np.meshgrid(*[line] * d), axis=-1).reshape(-1, d))
    low, high = basis_ranges(alpha)
    assert (values >= low - 1e-12).all() and (values <= high + 1e-12).all()
    np.testing.assert_allclose(values.min(axis=0), low, atol=0.02)
    np.testing.assert_allclose(values.max(axis=0), high, atol=1e-12)


def test_equation_21_number_of_terms():
    assert [len(total_degree(d, p)) for d, p in [(1, 3), (2, 2), (3, 2), (6, 4)]] == [4, 6, 10, 210]


@pytest.mark.parametrize("nodes", [Gauss(), ClenshawCurtis(), SparseGrid(), SparseGrid(ClenshawCurtis())], ids=repr)
def test_equation_25_coefficients(nodes):
    coefficients = _coefficients(Fit.of(nodes, TotalDegree(), 1, 3), lambda xi: CUBIC.run((xi + 1) / 2).Y[:, :, 0])
    np.testing.assert_allclose(coefficients[:, 0], [1 / 12, -1 / 20, -1 / 12, 1 / 20], atol=1e-14)


@pytest.mark.filterwarnings("ignore:.*A check finds errors:symmb.SymmbWarning")
@pytest.mark.parametrize(
    ("method", "lower", "upper"),
    [
        (PolynomialChaos.paper(order=3), -1 / 10, 9 / 40),
        (PolynomialChaos.paper(order=6), -1 / 10, 9 / 40),
        (PolynomialChaos(order=3, range=Exact(1e-9)), 0.0, 4 / 27),
    ],
    ids=repr,
)
def test_equation_27_ranges(method, lower, upper):
    result = propagate(CUBIC, method, Box(x=(0, 1)))
    tolerance = 1e-12 if method.range == LegendreInclusion() else 2e-10
    assert abs(result.lower[0, 0] - lower) < tolerance and abs(result.upper[0, 0] - upper) < tolerance


def test_paper_preset_is_what_it_says():
    assert PolynomialChaos.paper(order=2) == PolynomialChaos(
        order=2, nodes=Gauss(), basis=TotalDegree(), range=LegendreInclusion()
    )
    assert propagate(Wave(), PolynomialChaos.paper(order=2), BOX).evaluations == 9


# -- Coefficients against another program ------------------------------------------------------------------


@pytest.mark.parametrize(("d", "order"), [(1, 5), (2, 4), (3, 3)])
def test_projection_gives_chaospy_s_expansion(d, order):
    def f(points):
        return np.stack([np.exp(points @ np.arange(1, d + 1)), np.cos(3 * points).prod(axis=1)], axis=1)

    distribution = chaospy.J(*(chaospy.Uniform(-1, 1) for _ in range(d)))
    nodes, weights = chaospy.generate_quadrature(order, distribution, rule="gaussian")
    expansion = chaospy.generate_expansion(order, distribution)
    theirs = chaospy.fit_quadrature(expansion, nodes, weights, f(nodes.T))
    fit = Fit.of(Gauss(), TotalDegree(), d, order)
    points = np.random.default_rng(3).uniform(-1, 1, (50, d))
    ours = basis_values(fit.alpha, points) @ _coefficients(fit, f)
    np.testing.assert_allclose(ours.T, theirs(*points.T), atol=1e-10)


# -- Nodes -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rule", "total"), [(Gauss(), 681), (ClenshawCurtis(), 34)])
def test_sparse_grid_weights_of_six_parameters(rule, total):
    nodes, weights = SparseGrid(rule).points(6, 4)
    assert round(np.abs(weights).sum()) == total and weights.sum() == pytest.approx(1)
    assert len(np.unique(nodes.round(12), axis=0)) == len(nodes)


def test_sparse_grid_sums_as_chaospy_s():
    distribution = chaospy.J(*(chaospy.Uniform(-1, 1) for _ in range(3)))
    theirs, their_weights = chaospy.generate_quadrature(2, distribution, rule="gaussian", sparse=True)
    nodes, weights = SparseGrid(Gauss()).points(3, 2)
    for powers in np.ndindex(7, 7, 7):  # most of them beyond the rule's exactness, so that only the same grid agrees
        ours, other = (weights @ np.prod(nodes**powers, axis=1), their_weights @ np.prod(theirs.T**powers, axis=1))
        assert ours == pytest.approx(other, abs=1e-13)


@pytest.mark.parametrize("degree", [1, 2, 5, 8, 32])
def test_clenshaw_curtis_integrates_its_degree(degree):
    x, w = ClenshawCurtis().line(degree)
    powers = np.arange(degree + 1)
    np.testing.assert_allclose(w @ x[:, None] ** powers, (powers % 2 == 0) / (powers + 1), atol=1e-13)
    assert x[0] == -1 and x[-1] == 1 and (w > 0).all()


def test_basis_beyond_the_nodes_is_refused():
    with pytest.raises(PropagationError, match="do not determine the 16 polynomials of TensorDegree"):
        propagate(Wave(), PolynomialChaos(order=3, nodes=SparseGrid()), BOX)


# -- Procedures --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [2, 3])
def test_lockstep_gives_the_bounds_of_single_runs(order):
    together = propagate(Wave(), PolynomialChaos.paper(order, lockstep=True), BOX)
    single = propagate(Wave(), PolynomialChaos.paper(order), BOX)
    np.testing.assert_allclose(together.lower, single.lower, atol=1e-14)
    np.testing.assert_allclose(together.upper, single.upper, atol=1e-14)
    np.testing.assert_array_equal(together.inner, single.inner)


def _breaks(amplitude, w):
    if amplitude > 1.05 and w > 1.03:
        raise RuntimeError("no convergence")
    return wave(amplitude, w)


def _breaks_at_three(amplitude, w):
    x = wave(amplitude, w)
    return np.where((TIMES >= 3) & (amplitude > 1.05) & (w > 1.03), np.nan, x)


@pytest.mark.parametrize(("f", "time"), [(_breaks, 0.0), (_breaks_at_three, 3.0)])
def test_fit_around_a_failed_node(f, time):
    simulator = FunctionSimulator(f, {"amplitude": 1.0, "w": 1.0}, TIMES, ["x"])
    with pytest.warns(SymmbWarning, match="1 of 9 runs failed"):
        result = propagate(simulator, PolynomialChaos(order=2, nodes=Gauss(), basis=TotalDegree()), BOX)
    (failure,) = result.failed
    assert failure.parameters == pytest.approx({"amplitude": 1 + 0.1 * 0.6**0.5, "w": 1 + 0.05 * 0.6**0.5})
    assert failure.time == time
    exact = wave_bounds()
    assert np.abs(result.upper - exact[1]).max() < 0.02 and np.abs(result.lower - exact[0]).max() < 0.02


@pytest.mark.parametrize(
    "method", [PolynomialChaos(order=2), PolynomialChaos.paper(order=2, nodes=SparseGrid())], ids=repr
)
def test_too_few_nodes_left_is_an_error_that_lists_them(method):
    simulator = FunctionSimulator(_breaks, {"amplitude": 1.0, "w": 1.0}, TIMES, ["x"])
    box = Box(amplitude=(0.8, 1.2), w=(0.8, 1.2))
    with pytest.raises(
        PropagationError, match=r"failed(.|\n)*  RuntimeError: no convergence \(amplitude=1\.\d+, w=1\.\d+\)"
    ):
        propagate(simulator, method, box)


def test_all_nodes_failed():
    simulator = FunctionSimulator(lambda x: 1 / 0, {"x": 1.0}, [0.0], ["f"])
    with pytest.raises(PropagationError, match="3 of 3 nodes failed"):
        propagate(simulator, PolynomialChaos.paper(order=2), Box(x=(0, 1)))


# -- Levels ------------------------------------------------------------------------------------------------


class _Counted:
    def __init__(self):
        self.calls = []

    def __call__(self, a, b):
        self.calls.append((round(a, 12), round(b, 12)))
        return [[np.exp(a) * np.cos(3 * b)]]


def test_levels_repeat_no_run_and_stop_at_the_tolerance():
    f = _Counted()
    simulator = FunctionSimulator(f, {"a": 0.0, "b": 0.0}, [0.0], ["f"])
    result = propagate(simulator, PolynomialChaos(tolerance=1e-4), Box(a=(-1, 1), b=(-1, 1)))
    assert len(f.calls) == result.evaluations
    assert len(set(f.calls[:-4])) == len(f.calls) - 4 < 300  # the last four check extremes, which may be nodes
    # exp(a) cos(3b): the maximum e at (1, 0), the minimum e cos 3 at (1, ±1).
    error = max(abs(result.upper[0, 0] - np.e), abs(result.lower[0, 0] - np.e * np.cos(3)))
    assert error < 1e-4 * (result.upper - result.lower)[0, 0]
    assert result.inner[1][0, 0] == pytest.approx(np.e) and result.estimate[0, 0] > 0


def test_budget_is_kept():
    result = propagate(Wave(), PolynomialChaos(budget=11), BOX)
    assert result.evaluations == 11 and (result.estimate > 0).any()  # 9 nodes, 2 checks
    with pytest.raises(PropagationError, match="the first level takes 9 runs, more than the budget of 8"):
        propagate(Wave(), PolynomialChaos(budget=8), BOX)


def test_many_parameters_take_sparse_grids():
    names = "abcde"
    simulator = FunctionSimulator(lambda **p: [[np.exp(sum(p.values()) / 5)]], dict.fromkeys(names, 0.0), [0.0], ["f"])
    result = propagate(simulator, PolynomialChaos(budget=1000), Box(**dict.fromkeys(names, (-1.0, 1.0))))
    width = np.e - 1 / np.e
    assert abs(result.upper[0, 0] - np.e) < 0.01 * width and abs(result.lower[0, 0] - 1 / np.e) < 0.01 * width
    assert result.evaluations < 120  # a Smolyak grid of total level 3 takes 241
    truth = np.array([[1 / np.e], [np.e]])
    assert (np.abs(np.array([result.lower[0], result.upper[0]]) - truth) <= result.estimate[0]).all()


def test_tensor_basis_keeps_the_constant_first():
    assert TensorDegree().indices(3, 2)[0].tolist() == [0, 0, 0]
