"""Fits on sums of tensor grids, compiled and in arrays, against polynomials with known coefficients."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from symmb.bound.nodes import Grid, group_squares
from symmb.bound.polynomials import basis_values

GRIDS = {
    "one parameter": [(9,)],
    "two": [(4, 6)],
    "three": [(4, 3, 5)],
    "sparse": [(4, 0, 0, 0, 0), (0, 4, 0, 0, 0), (0, 0, 0, 0, 5), (1, 1, 1, 1, 1), (2, 2, 1, 0, 0)],
}


@pytest.fixture(params=["compiled", "arrays"], autouse=True)
def _ways(request, monkeypatch):
    """With and without a compiler."""
    if request.param == "arrays":
        monkeypatch.setattr("symmb.run.codegen.build.has_compiler", lambda: False)


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


@pytest.mark.parametrize("shape", [(7, 2), (1023, 11)], ids=str)
def test_squares_are_summed_over_groups_of_rows(shape):
    rng = np.random.default_rng(1)
    c = rng.normal(size=(12, *shape))
    groups = [rng.permutation(12)[:k] for k in (1, 5, 12)]
    assert_allclose(group_squares(c, groups), [np.square(c[rows]).sum(axis=0) for rows in groups], rtol=1e-13)
