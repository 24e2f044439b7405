"""One-dimensional rules and sparse grids of them: exactness, nesting, distances, chaospy's nodes."""

import math

import chaospy
import numpy as np
import pytest
from conftest import ALL_RULES
from faults import refused
from numpy.polynomial.legendre import legvander

import symmb as mb
from symmb import ChebyshevGauss, ClenshawCurtis, Gauss, Leja, SparseGrid


@pytest.mark.parametrize("rule", ALL_RULES, ids=repr)
@pytest.mark.parametrize("number", [0, 1, 2, 3, 4, 5, 6, 12, 21])
def test_lines_integrate_their_degree_and_levels_twice_their_number_and_one(rule, number):
    for degree, most in ((number, number), *([(rule.degree(number), 2 * number + 1)] if number < 6 else [])):
        x, w = rule.line(degree)
        powers = np.arange(most + 1)
        assert len(x) == degree + 1 and np.abs(x).max() <= 1
        np.testing.assert_allclose(w @ x[:, None] ** powers, (powers % 2 == 0) / (powers + 1), atol=1e-13)


@pytest.mark.parametrize("rule", ALL_RULES, ids=repr)
@pytest.mark.parametrize(("d", "level"), [(2, 4), (3, 3), (6, 2)])
def test_sparse_grids_integrate_total_degree_twice_their_level_and_one(rule, d, level):
    nodes, weights = SparseGrid(rule).points(d, level)
    direction = np.random.default_rng(1).normal(size=d)
    # The even moments of a sum of independent uniform variables, by the moments of one after the other.
    moments = np.eye(2 * level + 2)[0]
    for scale in direction:
        own = [scale**k * (k % 2 == 0) / (k + 1) for k in range(len(moments))]
        moments = np.array(
            [sum(math.comb(n, k) * own[k] * moments[n - k] for k in range(n + 1)) for n in range(len(moments))]
        )
    found = weights @ (nodes @ direction)[:, None] ** np.arange(len(moments))
    np.testing.assert_allclose(found, moments, rtol=1e-11, atol=1e-11 * np.abs(moments).max())


@pytest.mark.parametrize(("rule", "name"), [(ChebyshevGauss(), "fejer_1"), (ClenshawCurtis(), "clenshaw_curtis")])
@pytest.mark.parametrize("order", [1, 2, 5, 8])
def test_nodes_and_weights_are_chaospy_s(rule, name, order):
    theirs, their_weights = chaospy.generate_quadrature(order, chaospy.Uniform(-1, 1), rule=name)
    x, w = rule.line(order)
    np.testing.assert_allclose(x, theirs[0], atol=1e-14)
    np.testing.assert_allclose(w, their_weights, atol=1e-14)


def test_leja_pairs_are_as_far_from_all_others_as_they_can_be():
    nodes = Leja().line(30)[0]
    grid = np.linspace(1e-4, 1, 20001)

    def product(x, before):  # of 2x and the distances of x and -x
        return 2 * x * np.prod(np.subtract.outer(x, before) ** 2, axis=-1)

    assert nodes[:3].tolist() == [0, 1, -1]
    for k in range(3, 31, 2):
        assert nodes[k] > 0 and nodes[k + 1] == -nodes[k]
        best = product(grid, nodes[:k]).max()
        assert best <= product(nodes[k], nodes[:k]) * (1 + 1e-12) <= best * (1 + 1e-3)


def test_the_first_five_leja_nodes_are_those_of_lobatto():
    np.testing.assert_allclose(Leja().line(4)[0], [0, 1, -1, (3 / 7) ** 0.5, -((3 / 7) ** 0.5)], atol=1e-15)


def test_leja_orders_are_nested():
    nodes = Leja().line(20)[0]
    for degree in range(20):
        np.testing.assert_array_equal(Leja().line(degree)[0], nodes[: degree + 1])


def lebesgue_constant(x):
    """Largest sum of magnitudes of the Lagrange polynomials, on 5001 points."""
    grid = np.cos(np.linspace(0, np.pi, 5001))
    n = len(x) - 1
    return np.abs(np.linalg.solve(legvander(x, n).T, legvander(grid, n).T)).sum(axis=0).max()


def test_lebesgue_constants_of_leja_nodes():
    constants = np.array([lebesgue_constant(Leja().line(n)[0]) for n in range(1, 21)])
    assert constants[1::2].max() == pytest.approx(8.87, abs=0.01)
    assert constants[::2].max() == pytest.approx(18.4, abs=0.05)


@pytest.mark.parametrize("n", [4, 9, 20])
def test_lebesgue_constant_of_chebyshev_roots_is_that_of_the_books(n):
    # Rivlin: sum of cot((2k - 1) pi / (4 (n + 1))) / (n + 1), attained at the ends.
    k = np.arange(1, n + 2)
    known = np.sum(1 / np.tan((2 * k - 1) * np.pi / (4 * (n + 1)))) / (n + 1)
    assert lebesgue_constant(ChebyshevGauss().line(n)[0]) == pytest.approx(known, rel=1e-10)


def test_sparse_grids_of_leja_nodes_take_the_fewest_runs():
    runs = {rule: len(SparseGrid(rule).points(2, 4)[0]) for rule in ALL_RULES}
    assert runs == {Gauss(): 53, ClenshawCurtis(): 65, ChebyshevGauss(): 93, Leja(): 33}


@pytest.mark.parametrize("wrong", [(-1, 2), (0, 2), (2, 2.5), ("x", 2), (2, -1), (2, np.nan), (True, 2)])
@pytest.mark.parametrize(
    "choice", [mb.Gauss(), mb.ClenshawCurtis(), mb.Leja(), mb.SparseGrid(), mb.TotalDegree(), mb.HyperbolicCross()]
)
def test_sizes_that_are_no_whole_numbers_are_refused(choice, wrong):
    refused("must be an integer", getattr(choice, "points", None) or choice.indices, *wrong)


@pytest.mark.parametrize("sampler", [mb.Random(), mb.Sobol(), mb.LatinHypercube()])
def test_samplers_refuse_no_parameters(sampler):
    refused("d must be an integer of at least 1", sampler.points, 3, 0, seed=0)
