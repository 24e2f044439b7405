"""Chebyshev polynomials on [-1, 1]^d: sets of products that contain all lower degrees, and changes of basis."""

from dataclasses import dataclass
from functools import cache, cached_property, lru_cache

import numpy as np

from symmb._types import Array, Indices
from symmb.bound.polynomials.legendre import MultiIndices, with_lower


@dataclass(frozen=True, eq=False)
class LowerSet:
    """A set of multi-indices that contains all multi-indices below its members, in the order of increasing sums.

    If the range of a parameter is halved, or a parameter is fixed, the expansion has no products outside of the set.
    This property is valid for Legendre and Chebyshev polynomials.

    Attributes
    ----------
    alpha : (n, d) multi-indices, the constant first
    given : (n_b,) indices of the multi-indices that were given; the others complete the set
    """

    alpha: MultiIndices
    given: Indices

    @classmethod
    def of(cls, alpha: MultiIndices) -> "LowerSet":
        """The smallest lower set that contains alpha (n_b, d).

        Examples
        --------
        >>> LowerSet.of(np.array([[1, 2]])).alpha.tolist()
        [[0, 0], [0, 1], [1, 0], [0, 2], [1, 1], [1, 2]]
        """
        return _lower_set(alpha.shape, np.ascontiguousarray(alpha, dtype=np.intp).tobytes())

    @cached_property
    def number(self) -> dict[tuple[int, ...], int]:
        """Row of each multi-index."""
        return {tuple(row): i for i, row in enumerate(self.alpha.tolist())}

    @cached_property
    def fibres(self) -> list[Indices]:
        """For each axis (n_f, degree + 1): rows of products that differ only in their degree along this axis.

        A row is n if the set has no product of this degree.
        """
        n, d = self.alpha.shape
        fibres = []
        for k in range(d):
            bases = [tuple(row) for row in self.alpha[self.alpha[:, k] == 0].tolist()]
            degrees = range(self.alpha[:, k].max() + 1)
            fibres.append(np.array([[self.number.get((*a[:k], j, *a[k + 1 :]), n) for j in degrees] for a in bases]))
        return fibres

    def from_legendre(self, coefficients: Array) -> Array:
        """Chebyshev coefficients (n, m) of polynomials with Legendre coefficients (n_b, m)."""
        n = len(self.alpha)
        C = np.zeros((n, coefficients.shape[1]))
        C[self.given] = coefficients
        for fibres in self.fibres:
            change = legendre_to_chebyshev(fibres.shape[1] - 1)
            for i in range(len(change)):
                rows = fibres[fibres[:, i] < n]
                if i > 1:  # both bases have the same polynomials of degrees 0 and 1
                    C[rows[:, i]] *= change[i, i]
                for j in range(i + 2, len(change), 2):
                    higher = rows[rows[:, j] < n]
                    C[higher[:, i]] += change[i, j] * C[higher[:, j]]
        return C


@lru_cache(maxsize=64)
def _lower_set(shape: tuple[int, int], alpha: bytes) -> LowerSet:
    given = np.frombuffer(alpha, dtype=np.intp).reshape(shape)
    rows = sorted(with_lower([*map(tuple, given.tolist()), (0,) * shape[1]]), key=lambda a: (sum(a), a))
    place = {a: i for i, a in enumerate(rows)}
    return LowerSet(np.array(rows, dtype=np.intp), np.array([place[tuple(a)] for a in given.tolist()]))


@cache
def legendre_to_chebyshev(n: int) -> Array:
    """(n + 1, n + 1) matrix from Legendre to Chebyshev coefficients. No entry is negative, so no digits are lost.

    Examples
    --------
    >>> legendre_to_chebyshev(2)[:, 2]
    array([0.25, 0.  , 0.75])
    """
    columns = np.eye(n + 1)
    for k in range(1, n):
        columns[k + 1] = ((2 * k + 1) * _times_x(columns[k]) - k * columns[k - 1]) / (k + 1)
    return columns.T


@cache
def halving(n: int) -> Array:
    """(n + 1, n + 1) matrix from coefficients on [-1, 1] to coefficients on [0, 1]. Column j is T_j((z + 1) / 2).

    Examples
    --------
    >>> halving(2)[:, 2]
    array([-0.25,  1.  ,  0.25])
    """
    columns = np.eye(n + 1)
    if n:
        columns[1, :2] = 0.5
    for k in range(1, n):
        columns[k + 1] = _times_x(columns[k]) + columns[k] - columns[k - 1]
    return columns.T


def _times_x(coefficients: Array) -> Array:
    """x times a Chebyshev series whose highest coefficient is 0. x T_i is the mean of T_(i - 1) and T_(i + 1)."""
    product = np.zeros_like(coefficients)
    product[1:] += 0.5 * coefficients[:-1]
    product[:-1] += 0.5 * coefficients[1:]
    product[1] += 0.5 * coefficients[0]
    return product
