"""Mean, variance and Sobol indices of expansions: closed forms and chaospy's."""

import itertools
import math

import chaospy
import numpoly
import numpy as np
import pytest
from black_boxes import black_box_bounds, unit_function
from conftest import ALL_BASES
from faults import refused
from oscillators import BOX, TIMES, Wave
from textbook_functions import ishigami

import symmb as mb
from symmb import HyperbolicCross, TotalDegree
from symmb.bound.reductions import bounded


@pytest.mark.parametrize("nodes, error", [(mb.Gauss(), 1e-6), (mb.ClenshawCurtis(), 1e-5), (mb.Leja(), 2e-5)], ids=repr)
def test_ishigami(nodes, error):
    """Sobol' and Levitan (1999): variances of the parts of sin x1 + a sin^2 x2 + b x3^4 sin x1 over [-pi, pi]^3.

    Ishigami and Homma (1990). The second output is -2 times this function plus 5.
    """
    a, b = 7.0, 0.1
    alone1, alone2, with3 = 0.5 * (1 + b * np.pi**4 / 5) ** 2, a**2 / 8, 8 * b**2 * np.pi**8 / 225
    variance = alone1 + alone2 + with3
    both = lambda **x: [ishigami(**x), 5 - 2 * ishigami(**x)]  # noqa: E731
    method, box = mb.PolynomialChaos(order=12, nodes=nodes), dict.fromkeys(("x1", "x2", "x3"), (-np.pi, np.pi))
    found = black_box_bounds(both, method, outputs="y z", **box).moments()
    np.testing.assert_allclose(found.mean[0], [a / 2, 5 - a], rtol=error)
    np.testing.assert_allclose(found.variance[0], [variance, 4 * variance], rtol=error)
    for k in range(2):
        np.testing.assert_allclose(found.first[:, 0, k], np.array([alone1, alone2, 0]) / variance, atol=error)
        expected = np.array([alone1 + with3, alone2, with3]) / variance
        np.testing.assert_allclose(found.total[:, 0, k], expected, atol=error)
    assert found.names == ("y", "z") and found.parameters == ("x1", "x2", "x3")


@pytest.mark.parametrize("lockstep", [False, True])
def test_an_oscillator_over_time(lockstep):
    found = mb.propagate(Wave(), mb.PolynomialChaos.paper(order=8, lockstep=lockstep), BOX).moments()
    (a_low, a_high), (w_low, w_high) = BOX.bounds
    t = TIMES[1:]
    cosine = (np.sin(w_high * t) - np.sin(w_low * t)) / (t * (w_high - w_low))
    square = 0.5 + (np.sin(2 * w_high * t) - np.sin(2 * w_low * t)) / (4 * t * (w_high - w_low))
    a, a_square = (a_low + a_high) / 2, (a_high**3 - a_low**3) / (3 * (a_high - a_low))
    variance = a_square * square - (a * cosine) ** 2
    first = np.array([(a_square - a**2) * cosine**2, a**2 * (square - cosine**2)]) / variance
    np.testing.assert_array_equal(found.t, TIMES)
    np.testing.assert_allclose(found.mean[1:, 0], a * cosine, atol=1e-12)
    np.testing.assert_allclose(found.variance[1:, 0], variance, atol=1e-12)
    np.testing.assert_allclose(found.first[:, 1:, 0], first, atol=1e-9)
    np.testing.assert_allclose(found.total[:, 1:, 0], 1 - first[::-1], atol=1e-9)
    # At rest only the amplitude counts.
    np.testing.assert_allclose(found.first[:, 0, 0], [1, 0], atol=1e-12)


@pytest.mark.parametrize(("d", "order"), [(1, 5), (2, 4), (3, 3)])
def test_moments_are_chaospy_s(d, order):
    def f(points):
        phase = points @ (1 + 0.5 * np.arange(d))
        return np.stack([np.exp(phase), np.cos(2 * points).prod(axis=1), 1 / (4 + phase)], axis=1)

    distribution = chaospy.J(*(chaospy.Uniform(-1, 1) for _ in range(d)))
    nodes, weights = chaospy.generate_quadrature(order, distribution, rule="gaussian")
    theirs = chaospy.fit_quadrature(chaospy.generate_expansion(order, distribution), nodes, weights, f(nodes.T))
    simulator, box = unit_function(lambda x: f(x[None]), d, outputs=["a", "b", "c"])
    found = bounded(mb.PolynomialChaos.paper(order), simulator, box).moments()
    np.testing.assert_allclose(found.mean[0], chaospy.E(theirs, distribution), atol=1e-10)
    np.testing.assert_allclose(found.variance[0], chaospy.Var(theirs, distribution), atol=1e-10)
    np.testing.assert_allclose(found.first[:, 0], chaospy.Sens_m(theirs, distribution), atol=1e-10)
    np.testing.assert_allclose(found.total[:, 0], chaospy.Sens_t(theirs, distribution), atol=1e-10)


def test_no_variance_no_indices():
    f = lambda x, y: [[2.0, 0.0, x / 3 * 3 - x + 5, x + 1e3, y], [2.0, 1.0, 5.0, 1e-9 * x, 0.0]]  # noqa: E731
    for method in (mb.PolynomialChaos(order=4), mb.PolynomialChaos.paper(order=3, nodes=mb.SparseGrid())):
        found = black_box_bounds(f, method, [0.0, 1.0], "two step five falls y", x=(0.1, 0.7), y=(0, 1)).moments()
        assert np.isnan(found.first[:, :, :3]).all() and np.isnan(found.total[:, :, :3]).all()
        np.testing.assert_allclose(found.first[:, :, 3], [[1, np.nan], [0, np.nan]], atol=1e-9)
        np.testing.assert_allclose(found.total[:, :, 4], [[0, np.nan], [1, np.nan]], atol=1e-9)
        np.testing.assert_allclose(found.mean[:, 2], 5, rtol=1e-14)


@pytest.mark.parametrize("method", [mb.MonteCarlo(20), mb.Vertex()], ids=repr)
def test_bounds_without_an_expansion_have_no_moments(method):
    told = r"have no polynomial for the whole box.* Use PolynomialChaos\(order=4\)"
    refused(told, mb.propagate(Wave(), method, BOX).moments, error=mb.PropagationError)


def test_moments_print_as_a_table_of_shares():
    """2 + 3 a + 4 a b over [-1, 1]: a alone explains 3, the product 16 / 9 of the variance; nothing of a constant."""
    f, box = lambda a, b: [[2 + 3 * a + 4 * a * b, 1.0]] * 2, dict.fromkeys("ab", (-1.0, 1.0))
    found = black_box_bounds(f, mb.PolynomialChaos(order=2), [0.0, 1.0], "f one", **box).moments()
    assert repr(found) == "Moments(2 outputs x 2 times, 2 parameters)"
    rows = ["                 a              b", "f    0.628 / 1.000  0.000 / 0.372", "one    no variance"]
    assert str(found).split("\n")[1:] == rows


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")  # the error of a jump depends on the machine's rounding
def test_boxes_cut_into_pieces_leave_no_moments():
    bounds = black_box_bounds(lambda x, y: float(x + y / 2 > 0.3), x=(-1.0, 1.0), y=(-1.0, 1.0))
    refused("kinks or jumps", bounds.moments, error=mb.PropagationError)


# Multi-indices of the bases: which, how many, in which order.


def rows(alpha):
    return {tuple(row) for row in alpha.tolist()}


@pytest.mark.parametrize("basis", ALL_BASES, ids=repr)
@pytest.mark.parametrize(("d", "order"), [(1, 5), (2, 4), (3, 3)])
def test_a_basis_starts_with_the_constant_and_has_what_divides_its_polynomials(basis, d, order):
    alpha = basis.indices(d, order)
    assert alpha[0].tolist() == [0] * d and len(rows(alpha)) == len(alpha)
    for row in alpha[1:]:
        assert rows(np.maximum(row - np.eye(d, dtype=int), 0)) <= rows(alpha)
    assert {tuple(order * unit) for unit in np.eye(d, dtype=int)} <= rows(alpha)


@pytest.mark.parametrize(("d", "order"), [(1, 4), (2, 6), (3, 5), (4, 4)])
@pytest.mark.parametrize("q", [0.4, 0.5, 0.75, 1.0])
def test_hyperbolic_cross_is_chaospy_s(d, order, q):
    distribution = chaospy.J(*(chaospy.Uniform(-1, 1) for _ in range(d)))
    expansion = chaospy.generate_expansion(order, distribution, cross_truncation=q)
    theirs = rows(numpoly.lead_exponent(expansion, graded=True, reverse=True))
    assert rows(HyperbolicCross(q).indices(d, order)) == theirs
    assert HyperbolicCross(q).size(d, order) == len(theirs)


def test_hyperbolic_cross_keeps_what_lies_on_its_border():
    # 2 sqrt(2) = sqrt(8), so that (2, 2) has the quasi-norm 8.
    assert (2, 2) in rows(HyperbolicCross(0.5).indices(2, 8))
    assert (2, 2) not in rows(HyperbolicCross(0.5).indices(2, 7))
    known = {row for row in itertools.product(range(5), repeat=3) if sum(a**0.5 for a in row) <= 2 + 1e-9}
    assert rows(HyperbolicCross(0.5).indices(3, 4)) == known


def test_sizes_of_many_parameters_are_counted_without_indices():
    assert HyperbolicCross(1.0).size(500, 16) == math.comb(516, 16)


def test_hyperbolic_cross_of_one_is_the_total_degree():
    np.testing.assert_array_equal(HyperbolicCross(1.0).indices(4, 3), TotalDegree().indices(4, 3))
