"""Bases of polynomials of several variables: monomials of a weighted degree, or products of Chebyshev polynomials."""

import math
from collections.abc import Callable
from functools import cache, cached_property, reduce
from itertools import count
from operator import matmul
from typing import Any

import numpy as np
from numpy.polynomial.chebyshev import cheb2poly

from symmb._types import Array, Indices

_DEGREES_BEYOND, MOST_TERMS_BEYOND = 3, 4000
"""Taylor models of defects, and of a start, have up to this many degrees more than the polynomials to which these
errors belong, as long as they have at most this number of terms. They have at least one degree more."""


class Basis:
    """Monomials of weighted degree up to `degree` in some variables, sorted by degree.

    The degree of a monomial is the sum of its exponents times the weights of the variables. The smallest weight is 1.
    A variable with a larger weight has terms of lower order, because its effect is nearly linear. The first monomials
    of a basis are those of the bases of lower degrees.

    Attributes
    ----------
    exponents : (T, variables) exponents of the monomials
    degrees : (T,) degrees of the monomials
    counts : number of the monomials up to each degree
    of_squares : (T,) middle of the range: 1/2 for products of squares, which are in [0, 1]; 0 for other monomials
    linear : (variables,) numbers of the variables as monomials; T if the weight of a variable exceeds the degree
    """

    def __init__(self, weights: tuple[int, ...], degree: int) -> None:
        self.weights, self.variables, self.degree = weights, len(weights), degree
        every = np.array(list(_compositions(weights, degree)), dtype=np.intp).reshape(-1, self.variables)
        totals = every @ np.array(weights, dtype=np.intp)
        order = np.argsort(totals, kind="stable")
        self.exponents, self.degrees = every[order], totals[order]
        self.counts = np.cumsum(np.bincount(totals, minlength=degree + 1)).tolist()
        self.of_squares = 0.5 * (self.exponents % 2 == 0).all(axis=1) * (self.degrees > 0)
        self._digits = (degree + 1) ** np.arange(self.variables)
        self._sorted = np.argsort(self.exponents @ self._digits)
        self._codes = (self.exponents @ self._digits)[self._sorted]
        self._pairs: dict[tuple[int, int, int], Pairs] = {}
        has = np.array(weights, dtype=np.intp) <= degree
        self.linear = np.full(self.variables, len(every))
        self.linear[has] = self.places(np.eye(self.variables, dtype=np.intp)[has])

    def places(self, exponents: Indices) -> Indices:
        """Numbers (m,) of the monomials with exponents (m, variables). The basis must contain them."""
        return self._sorted[np.searchsorted(self._codes, exponents @ self._digits)]

    def pairs(self, a: int, b: int, most: int) -> "Pairs":
        """Pairs of monomials up to the degrees a and b, with products up to the degree `most`."""
        if (a, b, most) not in self._pairs:
            totals = self.degrees
            left, right = [], []
            for i in range(self.counts[a]):
                count = self.counts[min(b, most - int(totals[i]))] if totals[i] <= most else 0
                left.append(np.full(count, i))
                right.append(np.arange(count))
            i, j = np.concatenate(left), np.concatenate(right)
            out = self.places(self.exponents[i] + self.exponents[j])
            order = np.argsort(out, kind="stable")
            starts = np.flatnonzero(np.diff(out[order], prepend=-1))
            size = self.counts[min(a + b, most)]
            self._pairs[a, b, most] = Pairs(i[order], j[order], starts, out[order][starts], size)
        return self._pairs[a, b, most]

    def along(self, variable: int, matrix: Array) -> Any:
        """The sparse (T, T) matrix that applies a triangular matrix (degree + 1, degree + 1) to one variable."""
        from scipy.sparse import csr_array

        size, entries = len(self.exponents), []
        for k in range(self.degree + 1):
            own = np.flatnonzero(self.exponents[:, variable] == k)
            for j in np.flatnonzero(matrix[: k + 1, k]):
                to = self.exponents[own].copy()
                to[:, variable] = j
                entries.append((np.full(len(own), matrix[j, k]), self.places(to), own))
        values, rows, columns = map(np.concatenate, zip(*entries, strict=True))
        return csr_array((values, (rows, columns)), shape=(size, size))

    @cached_property
    def to_chebyshev(self) -> Any:
        """Sparse (T, T) matrix from coefficients of monomials to those of Chebyshev products. Its entries are exact."""
        one = np.zeros((self.degree + 1, self.degree + 1))
        for k in range(self.degree + 1):
            for j in range(k % 2, k + 1, 2):
                one[j, k] = math.comb(k, (k - j) // 2) / 2.0 ** (k - (j > 0))
        return reduce(matmul, (self.along(variable, one) for variable in range(self.variables)))

    @cached_property
    def from_chebyshev(self) -> Any:
        """The inverse of `to_chebyshev`. Its entries are integers."""
        one = np.zeros((self.degree + 1, self.degree + 1))
        for k in range(self.degree + 1):
            one[: k + 1, k] = cheb2poly(np.eye(k + 1)[k])
        return reduce(matmul, (self.along(variable, one) for variable in range(self.variables)))


class Pairs:
    """Pairs of monomials with the indices i and j (m,), grouped by their products.

    Groups begin at `starts`, and belong to the monomials `out` of the first `size` ones of the basis.

    Attributes
    ----------
    largest : size of the largest group
    """

    def __init__(self, i: Indices, j: Indices, starts: Indices, out: Indices, size: int) -> None:
        self._i, self._j, self._starts, self._out, self._size = i, j, starts, out, size
        self._ends = np.append(starts[1:], len(i))
        self.largest = int((self._ends - starts).max())
        self._parts: dict[int, list[tuple[Indices, ...]]] = {}

    def _in_parts(self, most: int) -> list[tuple[Indices, ...]]:
        """Groups with about `most` pairs at once."""
        if most not in self._parts:
            self._parts[most], first, starts, ends = [], 0, self._starts, self._ends
            while first < len(starts):
                last = max(int(np.searchsorted(ends, starts[first] + most)), first + 1)
                part = slice(starts[first], ends[last - 1])
                own = self._out[first:last], self._i[part], self._j[part], starts[first:last] - starts[first]
                self._parts[most].append(own)
                first = last
        return self._parts[most]

    def product(self, a: Array, b: Array, multiply: Callable[[Array, Array], Array] = np.multiply) -> Array:
        """Coefficients (T, P, ...) of the product of polynomials (., P, ...)."""
        shape = multiply(a[:1], b[:1]).shape[1:]
        # with weights, some monomials are no products
        found = np.zeros((self._size, *shape), dtype=np.result_type(a, b))
        # the products of about 2000 pairs of numbers at 30 places stay in the cache
        most = 2000 if multiply is np.multiply else max(1, 60_000 // math.prod(shape))
        for terms, i, j, starts in self._in_parts(most):
            products = multiply(a.take(i, axis=0), b.take(j, axis=0))
            found[terms] = np.add.reduceat(products, starts, axis=0)
        return found


@cache
def basis_of(weights: tuple[int, ...], degree: int) -> Basis:
    """The basis for weights of variables and a degree. Each basis is made once."""
    return Basis(weights, degree)


def richer(basis: Basis, most: float = MOST_TERMS_BEYOND) -> Basis:
    """The basis of higher degree for the defects of polynomials. It has at most `most` terms, or one degree more."""
    degree = basis.degree + _DEGREES_BEYOND
    while degree > basis.degree + 1 and terms_of(basis.weights, degree) > most:
        degree -= 1
    return basis_of(basis.weights, degree)


def terms_of(weights: tuple[int, ...], degree: int) -> int:
    """Number of the monomials up to a degree."""
    ways = np.zeros(degree + 1)
    ways[0] = 1.0
    for weight in weights:
        for k in range(weight, degree + 1):
            ways[k] += ways[k - weight]
    return int(ways.sum())


@cache
def basis_with(weights: tuple[int, ...], terms: int) -> Basis:
    """The basis with a number of terms."""
    return basis_of(weights, next(k for k in count() if basis_of(weights, k).counts[-1] >= terms))


def _compositions(weights: tuple[int, ...], degree: int) -> Any:
    """All exponents of monomials up to a weighted degree, one tuple after the other."""
    if not weights:
        yield ()
        return
    for first in range(degree // weights[0] + 1):
        for others in _compositions(weights[1:], degree - weights[0] * first):
            yield (first, *others)
