"""Fits of every nodes class and basis; coefficients against chaospy's."""

import chaospy
import numpoly
import numpy as np
import pytest
from conftest import ALL_BASES, ALL_NODES
from numpy.testing import assert_allclose

from symmb import ClenshawCurtis, Gauss, Leja, PropagationError, SparseGrid, TensorDegree, TotalDegree
from symmb.bound.nodes import Grid, group_squares
from symmb.bound.nodes.fit import Fit
from symmb.bound.polynomials.legendre import basis_values


def recovered(fit, coefficients, ok):
    values = basis_values(fit.alpha, fit.nodes) @ coefficients
    return fit.coefficients(fit.functionals[:, ok] @ values[ok], ok)


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("basis", ALL_BASES, ids=repr)
@pytest.mark.parametrize("nodes", ALL_NODES, ids=repr)
def test_polynomials_of_the_basis_are_their_own_fit(nodes, basis, d):
    for order in range(1, 7):
        if isinstance(nodes, SparseGrid) and basis == TensorDegree() and d > 1:
            with pytest.raises(PropagationError, match=r"nodes of SparseGrid\(.*do not determine the .* TensorDegree"):
                Fit.of(nodes, basis, d, order)
            continue
        fit = Fit.of(nodes, basis, d, order)
        coefficients = np.random.default_rng(order).uniform(-1, 1, (len(fit.alpha), 3))
        ok = np.ones(len(fit.nodes), dtype=bool)
        np.testing.assert_allclose(recovered(fit, coefficients, ok), coefficients, atol=1e-12)


@pytest.mark.parametrize("basis", ALL_BASES, ids=repr)
@pytest.mark.parametrize("nodes", [n for n in ALL_NODES if isinstance(n, SparseGrid)], ids=repr)
def test_sparse_grids_of_too_low_a_level_are_refused(nodes, basis):
    with pytest.raises(PropagationError, match=r"do not determine the .* of order 4 in 2 parameters\. Use TotalDegree"):
        Fit.of(SparseGrid(nodes.rule, level=2), basis, 2, 4)


@pytest.mark.parametrize("nodes", [n for n in ALL_NODES if not isinstance(n, SparseGrid)], ids=repr)
def test_a_fit_around_a_failed_node_or_none(nodes):
    fit = Fit.of(nodes, TotalDegree(), 2, 3)
    ok = np.arange(len(fit.nodes)) != 5
    assert fit.determined(ok)
    coefficients = np.arange(10.0)[:, None]
    np.testing.assert_allclose(recovered(fit, coefficients, ok), coefficients, atol=1e-12)
    assert not Fit.of(nodes, TensorDegree(), 2, 3).determined(ok)


def test_nodes_that_interpolation_cannot_tell_apart_are_refused():
    class Twice:
        projects = False

        def points(self, d, order):
            return np.array([[-1.0], [0.5], [0.5]]), np.full(3, 1 / 3)

    with pytest.raises(PropagationError, match=r"3 nodes of .* do not determine the 3 polynomials"):
        Fit.of(Twice(), TotalDegree(), 1, 2)


def test_six_parameters_take_no_matrix_of_all_nodes():
    order, d = 4, 6
    fit = Fit.of(ClenshawCurtis(), TensorDegree(), d, order)
    assert fit.line.shape == (order + 1, order + 1) and len(fit.nodes) == 15_625
    rng = np.random.default_rng(0)
    some = rng.choice(len(fit.alpha), 40, replace=False)
    a = rng.uniform(-1, 1, (len(some), 3))
    found = fit.transform(basis_values(fit.alpha[some], fit.nodes) @ a)
    np.testing.assert_allclose(found[some], a, atol=1e-13)
    assert np.abs(np.delete(found, some, axis=0)).max() < 1e-13


def responses(points):
    """Six smooth functions (N, 6) of points (N, d)."""
    d = points.shape[1]
    phase = points @ (1 + 0.5 * np.arange(d))
    parts = [np.exp(0.7 * phase), np.cos(3 * points).prod(axis=1), 1 / (2.5 + points.mean(axis=1))]
    parts += [np.sin(phase + 0.3) * np.exp(-(points[:, 0] ** 2)), np.arctan(phase), np.full(len(points), 2.0)]
    return np.stack(parts, axis=1)


def distribution(d):
    return chaospy.J(*(chaospy.Uniform(-1, 1) for _ in range(d)))


def as_ours(fit, expansion, coefficients):
    """Coefficients (n_b, m) of chaospy's polynomials, whose leading coefficient is 1, for ours, which are 1 at
    1."""
    exponents = numpoly.lead_exponent(expansion, graded=True, reverse=True)
    scaled = coefficients * np.array([float(p(*np.ones(fit.alpha.shape[1]))) for p in expansion])[:, None]
    theirs = dict(zip(map(tuple, exponents.tolist()), scaled, strict=True))
    assert len(theirs) == len(fit.alpha)
    return np.array([theirs[tuple(row)] for row in fit.alpha.tolist()])


def coefficients(fit):
    return fit.coefficients(fit.functionals @ responses(fit.nodes), np.ones(len(fit.nodes), dtype=bool))


CASES = pytest.mark.parametrize("order", [2, 3, 4, 5])
PARAMETERS = pytest.mark.parametrize("d", [1, 2, 3])


@PARAMETERS
@CASES
@pytest.mark.parametrize(
    ("nodes", "degree", "rule", "sparse"),
    [
        (Gauss(), 1, "gaussian", False), (SparseGrid(), 1, "gaussian", True),
        (SparseGrid(ClenshawCurtis()), 1, "clenshaw_curtis", True),
        (ClenshawCurtis(), 2, "clenshaw_curtis", False),  # exact for products, so that least squares is projection
    ],
)  # fmt: skip
def test_coefficients_are_those_of_a_quadrature_of_chaospy(nodes, degree, rule, sparse, d, order):
    """Its degree is `degree` times the order."""
    basis, law = TotalDegree(), distribution(d)
    projection = Fit(basis.indices(d, order), *nodes.points(d, degree * order), projects=False)
    fit = projection if degree == 2 else Fit.of(nodes, basis, d, order)
    expansion = chaospy.generate_expansion(order, law)
    places, weights = chaospy.generate_quadrature(degree * order, law, rule=rule, sparse=sparse)
    _, theirs = chaospy.fit_quadrature(expansion, places, weights, responses(places.T), retall=1)
    np.testing.assert_allclose(coefficients(fit), as_ours(fit, expansion, theirs), atol=1e-10)
    assert len(weights) == len(fit.nodes) or rule == "gaussian"


@PARAMETERS
@CASES
@pytest.mark.parametrize("nodes", [ClenshawCurtis(), Leja()], ids=repr)
def test_interpolants_have_the_values_of_chaospy_s(nodes, d, order):
    fit = Fit.of(nodes, TensorDegree(), d, order)
    expansion = chaospy.generate_expansion(order, distribution(d), cross_truncation=np.inf)
    theirs = chaospy.fit_regression(expansion, fit.nodes.T, responses(fit.nodes))
    points = np.random.default_rng(3).uniform(-1, 1, (50, d))
    np.testing.assert_allclose(basis_values(fit.alpha, points) @ coefficients(fit), theirs(*points.T).T, atol=1e-10)


# Fits on sums of tensor grids, compiled and in arrays, against polynomials with known coefficients.


GRIDS = {
    "one parameter": [(9,)],
    "two": [(4, 6)],
    "three": [(4, 3, 5)],
    "sparse": [(4, 0, 0, 0, 0), (0, 4, 0, 0, 0), (0, 0, 0, 0, 5), (1, 1, 1, 1, 1), (2, 2, 1, 0, 0)],
}


@pytest.fixture(params=["compiled", "arrays"])
def ways(request, monkeypatch):
    """With and without a compiler."""
    if request.param == "arrays":
        monkeypatch.setattr("symmb.run.codegen.build.has_compiler", lambda: False)


@pytest.mark.usefixtures("ways")
@pytest.mark.parametrize("responses", [1, 3, 8191], ids=lambda m: f"{m} responses")
@pytest.mark.parametrize("indices", GRIDS.values(), ids=GRIDS)
def test_coefficients_are_those_of_the_polynomials(indices, responses):
    rng = np.random.default_rng(0)
    grid = Grid(len(indices[0]))
    grid.add(grid.missing(indices))
    n = len(grid.row)
    expected = rng.normal(size=(n, responses))
    rows = rng.permutation(n + 5)[:n]
    Y = np.full((n + 5, responses), np.nan)
    Y[rows] = basis_values(grid.alpha, grid.nodes) @ expected
    assert_allclose(grid.coefficients(Y[:3], Y[3:], rows=rows), expected, atol=1e-11)


@pytest.mark.usefixtures("ways")
@pytest.mark.parametrize("shape", [(7, 2), (1023, 11)], ids=str)
def test_squares_are_summed_over_groups_of_rows(shape):
    rng = np.random.default_rng(1)
    c = rng.normal(size=(12, *shape))
    groups = [rng.permutation(12)[:k] for k in (1, 5, 12)]
    assert_allclose(group_squares(c, groups), [np.square(c[rows]).sum(axis=0) for rows in groups], rtol=1e-13)
