"""Tables of the products of an expansion for branch and bound, the same for all polynomials."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from symmb._types import Array, Indices
from symmb.bound.polynomials.chebyshev import LowerSet
from symmb.run.codegen import c_number

LANES = int(c_number("polynomial_ranges", "W"))
"""Coefficients are padded to a multiple of this number, with at least one zero for all products outside the set."""
FEW_TERMS = 64
"""Coefficients up to which one full matrix is the fastest change of basis."""


@dataclass(frozen=True, eq=False)
class Terms:
    """Numbers of the terms of low degree, and weights of all terms in bounds.

    Attributes
    ----------
    products : of the expansion
    linear, square : (d,) numbers of T_1 and T_2 of each parameter
    pairs : (d (d - 1) / 2, 3) each parameter and each before it, and the number of the product of both
    weights : (d + 1, n_padded) of terms of degree 3 and more, as |T_j| <= 1; then along each parameter of all but
        those of degree 1, as |T_j'| <= j^2
    """

    products: LowerSet
    linear: Indices
    square: Indices
    pairs: Indices
    weights: Array

    @property
    def padded(self) -> int:
        """Length of padded coefficients."""
        return self.weights.shape[1]

    def coefficients(self, legendre: Array) -> Array:
        """Padded Chebyshev coefficients (m, n_padded) of polynomials with Legendre coefficients (n_b, m)."""
        if len(legendre) <= FEW_TERMS:
            return legendre.T @ self.change
        C = np.zeros((legendre.shape[1], self.padded))
        C[:, : len(self.products.alpha)] = self.products.from_legendre(legendre).T
        return C

    @cached_property
    def change(self) -> Array:
        """(n_b, n_padded) from Legendre to padded Chebyshev coefficients."""
        change = self.products.from_legendre(np.eye(len(self.products.given)))
        return np.ascontiguousarray(np.pad(change.T, ((0, 0), (0, self.padded - len(change)))))


@lru_cache(maxsize=64)
def terms_of(products: LowerSet) -> Terms:
    """The table of a lower set."""
    alpha, number = products.alpha, products.number
    n, d = alpha.shape
    unit = np.eye(d, dtype=np.intp)
    linear, square = (np.array([number.get(tuple(row), n) for row in j * unit]) for j in (1, 2))
    pairs = [(i, j, number.get(tuple(unit[i] + unit[j]), n)) for i in range(d) for j in range(i)]
    weights = np.zeros((d + 1, LANES * (n // LANES + 1)))
    weights[0, :n] = alpha.sum(axis=1) > 2
    weights[1:, :n] = alpha.T**2
    weights[1:, :n][:, alpha.sum(axis=1) == 1] = 0
    return Terms(products, linear, square, np.array(pairs, dtype=np.intp).reshape(-1, 3), weights)
