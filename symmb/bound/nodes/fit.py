"""Legendre coefficients from node values: projection, interpolation or least squares."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre

from symmb._errors import PropagationError
from symmb._limits import require_memory, require_runs
from symmb._types import Array, Mask
from symmb.bound.nodes.quadrature import MOST_ORDER, Nodes, Rule
from symmb.bound.nodes.tensor_fit import interpolants
from symmb.bound.polynomials import Basis, MultiIndices, TensorDegree, basis_values, mean_squares

SMALLEST_EIGENVALUE = 0.01
"""Smallest eigenvalue of the normalised Gram matrix of a fit. The eigenvalue is 1 for an exact quadrature. Below this
limit, the successful nodes determine some polynomial ten times less accurately than the other polynomials.
tests/nodes/test_fit.py"""

MOST_PRODUCTS = 10**6
"""Largest number of polynomials of a basis. Their multi-indices take a second to compute."""

LARGEST_INVERSE = 1e8
"""Largest entry of V^-1. With a larger entry, rounding leaves fewer than eight digits of the coefficients."""
LARGEST_GRAM_ERROR = 1e-8
"""Largest error of the Gram matrix of a projection. It covers rounding, so that inexact quadratures are refused."""


@dataclass(frozen=True, eq=False)
class Fit:
    """The linear map from node values to coefficients.

    Let V be the values of the basis at the nodes, and W the weights. Projection divides V^T W y by the mean squares,
    eqs. (30)-(34) of Wang and Yang (2021). Least squares solve (V^T W V) a = V^T W y. Projection and least squares give
    the same result if the quadrature is exact for products of basis polynomials. With as many nodes as polynomials, the
    fit interpolates. The fit then solves V a = y, because V^T W V loses twice as many digits.

    On a tensor grid with a tensor basis, V is the Kronecker product of one matrix for each parameter. The map is then
    applied parameter by parameter, and no matrix of all nodes is formed.

    Attributes
    ----------
    alpha : (n_b, d) multi-indices
    nodes : (N, d)
    weights : (N,)
    projects : whether the fit is a projection, provided that no node fails
    line : (n, n) matrix from values at the nodes of one parameter to coefficients, on a tensor grid with a tensor basis
    """

    alpha: MultiIndices
    nodes: Array
    weights: Array
    projects: bool
    line: Array | None = None

    @classmethod
    def of(cls, rule: Nodes, basis: Basis, d: int, order: int) -> "Fit":
        """The fit of an order with d parameters. The nodes must determine the polynomials of the basis."""
        request = f"{basis!r} of order {order} in {d} parameters"
        if order > MOST_ORDER:
            raise PropagationError(f"{request} is above the highest order, {MOST_ORDER}. Use a lower order.")
        sizes = [getattr(part, "size", None) for part in (rule, basis)]
        n_nodes, n_basis = (size(d, order) if size else 1 for size in sizes)
        if n_basis > MOST_PRODUCTS:
            raise PropagationError(f"{request} has {n_basis:.3g} products, more than the {MOST_PRODUCTS:.0e} allowed.")
        require_runs(rule, n_nodes, f"They are needed for {request}. Use a lower order, or SparseGrid(Leja()).")
        tensor = isinstance(rule, Rule) and isinstance(basis, TensorDegree)
        matrix = 0 if tensor else 3 * n_nodes * n_basis
        require_memory(rule, f"nodes and coefficients of {request}", 4 * d * (n_nodes + n_basis) + matrix)
        line = None
        if tensor:
            nodes = rule.points(1, order)[0][:, 0]
            line = np.asarray(np.linalg.inv(legendre.legvander(nodes, order)), dtype=float)
        fit = cls(basis.indices(d, order), *rule.points(d, order), rule.projects, line)
        if not fit._possible():
            raise PropagationError(
                f"{len(fit.nodes)} nodes of {rule!r} do not determine the {len(fit.alpha)} polynomials of "
                f"{basis!r} of order {order} in {d} parameters. Use TotalDegree() or more nodes."
            )
        return fit

    @property
    def interpolates(self) -> bool:
        """Whether the fit needs every node: it is not a projection, and there are as many nodes as polynomials."""
        return self.line is not None or (not self.projects and len(self.nodes) == len(self.alpha))

    @cached_property
    def values(self) -> Array:
        """V (N, n_b)."""
        return basis_values(self.alpha, self.nodes)

    @cached_property
    def functionals(self) -> Array:
        """(n_b, N) matrix from node values to coefficients. The columns of the matrix can be applied in any order."""
        if self.line is not None:
            return self.transform(np.eye(len(self.nodes)))
        if self.interpolates:
            return np.asarray(np.linalg.inv(self.values), dtype=float)
        sums = self._scaled.T * self.weights
        return (sums if self.projects else np.linalg.solve(self._gram(), sums)) / self._norms[:, None]

    def transform(self, *blocks: Array) -> Array:
        """Coefficients (n_b, m) from blocks of values (.., m) at all nodes in their order."""
        if self.line is None:
            return self.functionals @ np.concatenate(blocks)
        every = np.arange(len(self.nodes))
        return interpolants([(every, [self.line] * self.alpha.shape[1], 1)], blocks, every)

    def determined(self, ok: Mask) -> bool:
        """Whether the nodes marked in ok (N,) determine all coefficients."""
        return bool(ok.all()) or (not self.interpolates and bool(self.weights.min() > 0) and _regular(self._gram(ok)))

    def coefficients(self, sums: Array, ok: Mask) -> Array:
        """Coefficients (n_b, m) from ``functionals @ y`` (n_b, m) over the nodes marked in ok (N,)."""
        if ok.all():
            return sums
        # The sums are those of the fit with all nodes. They are multiplied by its Gram matrix. The Gram matrix of the
        # remaining nodes is then solved. Single values at nodes are thus not needed any more.
        norms = self._norms[:, None]
        return np.linalg.solve(self._gram(ok), self._gram() @ (sums * norms)) / norms

    def _possible(self) -> bool:
        """Whether all nodes together determine the polynomials."""
        if self.line is not None:
            return bool(np.abs(self.line).max() ** self.alpha.shape[1] < LARGEST_INVERSE)
        if self.interpolates:
            try:
                return bool(np.abs(self.functionals).max() < LARGEST_INVERSE)
            except np.linalg.LinAlgError:  # singular
                return False
        gram = self._gram()
        return bool(np.abs(gram - np.eye(len(gram))).max() < LARGEST_GRAM_ERROR) if self.projects else _regular(gram)

    @cached_property
    def _norms(self) -> Array:
        return np.sqrt(mean_squares(self.alpha))

    @cached_property
    def _scaled(self) -> Array:
        """V of polynomials with mean square 1 (N, n_b)."""
        return self.values / self._norms

    def _gram(self, ok: Mask | slice = slice(None)) -> Array:
        """V^T W V (n_b, n_b) over the nodes marked in ok, for polynomials with mean square 1."""
        return (self._scaled[ok].T * self.weights[ok]) @ self._scaled[ok]


def _regular(gram: Array) -> bool:
    try:
        # The factorization exists only if all eigenvalues are larger than the limit.
        np.linalg.cholesky(gram - SMALLEST_EIGENVALUE * np.eye(len(gram)))
    except np.linalg.LinAlgError:
        return False
    return True
