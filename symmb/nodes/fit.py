"""Legendre coefficients from node values, by one running matrix product."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array, Mask
from symmb.nodes.quadrature import Nodes
from symmb.polynomials import Basis, MultiIndices, basis_values, mean_squares

SMALLEST_EIGENVALUE = 0.01
"""Of the normalised Gram matrix, 1 for an undisturbed quadrature. Below it the remaining nodes leave some
polynomial ten times less certain than the others, and a fit around failed nodes is refused."""

LARGEST_INVERSE = 1e8
"""Largest entry of V^-1. Beyond it interpolation has no solution but for rounding."""


@dataclass(frozen=True, eq=False)
class Fit:
    """The linear map from node values to coefficients.

    With V the basis at the nodes and W the weights, projection divides V^T W y by the mean squares, eqs.
    (30)-(34); least squares solves (V^T W V) a = V^T W y. Both are the same where the quadrature is exact
    for products of basis polynomials. With as many nodes as polynomials least squares is interpolation,
    whatever the weights, and V a = y is solved: the product V^T W V would lose twice as many digits.

    Each is one matrix, whose product with the node values is accumulated. Where nodes failed, the sums over
    the others are turned into their least squares fit.

    Attributes
    ----------
    alpha : (n_b, d) multi-indices
    nodes : (N, d)
    weights : (N,)
    projects : by projection as long as no node failed
    """

    alpha: MultiIndices
    nodes: Array
    weights: Array
    projects: bool

    @classmethod
    def of(cls, rule: Nodes, basis: Basis, d: int, order: int) -> "Fit":
        """The fit of an order with d parameters.

        Raises
        ------
        PropagationError
            If the nodes cannot tell the polynomials of the basis apart.
        """
        fit = cls(basis.indices(d, order), *rule.points(d, order), rule.projects)
        if not fit._possible():
            raise PropagationError(
                f"{len(fit.nodes)} nodes of {rule!r} do not determine the {len(fit.alpha)} polynomials of "
                f"{basis!r} of order {order} in {d} parameters. Use TotalDegree() or more nodes."
            )
        return fit

    @property
    def interpolates(self) -> bool:
        """As many nodes as polynomials, and no projection."""
        return not self.projects and len(self.nodes) == len(self.alpha)

    @cached_property
    def values(self) -> Array:
        """V (N, n_b)."""
        return basis_values(self.alpha, self.nodes)

    @cached_property
    def functionals(self) -> Array:
        """(n_b, N) matrix that makes coefficients of node values, in any order and in parts."""
        if self.interpolates:
            return np.asarray(np.linalg.inv(self.values), dtype=float)
        sums = self._scaled.T * self.weights
        return (sums if self.projects else np.linalg.solve(self._gram(), sums)) / self._norms[:, None]

    def determined(self, ok: Mask) -> bool:
        """Whether the nodes marked in ok (N,) are enough to fit all coefficients."""
        return bool(ok.all()) or (not self.interpolates and self.weights.min() > 0 and _regular(self._gram(ok)))

    def coefficients(self, sums: Array, ok: Mask) -> Array:
        """Coefficients (n_b, m) from ``functionals @ y`` (n_b, m) over the nodes marked in ok (N,)."""
        if ok.all():
            return sums
        norms = self._norms[:, None]
        return np.linalg.solve(self._gram(ok), self._gram() @ (sums * norms)) / norms

    def _possible(self) -> bool:
        """Whether all nodes together tell the polynomials apart."""
        if self.interpolates:
            try:
                return bool(np.abs(self.functionals).max() < LARGEST_INVERSE)
            except np.linalg.LinAlgError:  # singular
                return False
        gram = self._gram()
        return bool(np.abs(gram - np.eye(len(gram))).max() < 1e-8) if self.projects else _regular(gram)

    @cached_property
    def _norms(self) -> Array:
        return np.sqrt(mean_squares(self.alpha))

    @cached_property
    def _scaled(self) -> Array:
        """V of polynomials with mean square 1 (N, n_b)."""
        return self.values / self._norms

    def _gram(self, ok: Mask | slice = slice(None)) -> Array:
        """V^T W V over nodes marked in ok, for polynomials of mean square 1."""
        return (self._scaled[ok].T * self.weights[ok]) @ self._scaled[ok]


def _regular(gram: Array) -> bool:
    try:
        np.linalg.cholesky(gram - SMALLEST_EIGENVALUE * np.eye(len(gram)))
    except np.linalg.LinAlgError:  # not positive definite
        return False
    return True
