"""Multi-indices of the bases: which, how many, in which order."""

import itertools
import math

import chaospy
import numpoly
import numpy as np
import pytest
from conftest import ALL_BASES

from symmb import HyperbolicCross, TotalDegree


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
