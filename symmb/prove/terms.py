"""Polynomials of the parameters as coefficients, and their values at nodes.

Coefficients of one or two parameters have one axis for each parameter (a tensor). Coefficients of more parameters have
one axis for the Chebyshev products of a `Basis`. Coefficients follow from values at nodes by least squares. This fit
needs no proof.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.prove import chebyshev as ch
from symmb.prove.basis import Basis, basis_of
from symmb.prove.problem import Problem
from symmb.prove.rounding import U, above, of_sum
from symmb.prove.taylor_models import Model


@dataclass(frozen=True, eq=False)
class Grid:
    """Nodes of the parameters.

    Attributes
    ----------
    nodes : d arrays of the variables. They are broadcast to the shape of the values
    fits : matrices from values at the nodes to coefficients, for each axis of the coefficients
    basis : the basis to which the nodes belong; None for a tensor
    """

    problem: Problem
    nodes: Sequence[Array]
    fits: Sequence[Array | None]
    basis: Basis | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of values at the nodes."""
        return np.broadcast_shapes(*(own.shape for own in self.nodes))

    def values(self, lengths: Sequence[int]) -> list[Array | None]:
        """Matrices from coefficients with `lengths` to values at the nodes, for each axis of the coefficients."""
        if self.basis is None:
            return [ch.values_at_nodes(m, n) for m, n in zip(self.shape, lengths, strict=True)]
        return [_values(self.problem.basis(lengths[0]), self.basis)]

    def at(self, c: Array) -> Array:
        """Values (..., *shape) of polynomials (..., *lengths)."""
        return ch.along(self.values(c.shape[c.ndim - self.problem.axes :]), c)

    def fit(self, values: Array) -> Array:
        """Coefficients (..., *lengths) from values (..., *shape)."""
        return ch.along(self.fits, values)

    def parameters(self, leading: int) -> list[Array | float]:
        """The parameters at the nodes. Arrays have `leading` axes before those of the nodes."""
        return parameters_at(self.problem, [own.reshape((1,) * leading + own.shape) for own in self.nodes])


def parameters_at(problem: Problem, nodes: Sequence[Array]) -> list[Array | float]:
    """The parameters at nodes of the variables."""
    places = zip(problem.middle, problem.radius, problem.variables, strict=True)
    return [float(middle) if j < 0 else middle + radius * nodes[j] for middle, radius, j in places]


def tensor_nodes(counts: Sequence[int], leading: int) -> list[Array]:
    """Nodes of each variable of a tensor grid. Arrays have `leading` axes before the axes of the variables."""
    d = len(counts)
    return [ch.nodes(m).reshape([-1 if i == leading + j else 1 for i in range(leading + d)])
            for j, m in enumerate(counts)]  # fmt: skip


def grid(problem: Problem, lengths: Sequence[int], more: int) -> Grid:
    """Nodes for polynomials with `lengths`. A tensor has `more` nodes than terms for each parameter."""
    if not problem.weights:
        counts = [n + more for n in lengths]
        fits = [ch.coefficients_from_nodes(m)[:n] for m, n in zip(counts, lengths, strict=True)]
        return Grid(problem, tensor_nodes(counts, 0), fits)
    basis = problem.basis(lengths[0])
    return Grid(problem, list(np.cos(_angles(basis)[0]).T), [_fit(basis)], basis)


@cache
def _angles(basis: Basis) -> tuple[Array, Array]:
    """(count, variables) angles of the nodes for the polynomials of a basis, and their weights (count,) in the fit.

    Tensor nodes pi j / n with n = 1 + the highest degree of each variable are used if their indices j are all even or
    all odd. At these nodes, a product of a degree up to k above that of the basis equals one of a degree from 2 - k
    above it. Products of one degree more thus do not change the fit, and others change one coefficient at most. If this
    needs more than six times as many nodes as terms, two to six times as many random nodes are used. They are denser
    near the ends of the intervals.

    Source: Dencker and Erb, Applied and Computational Harmonic Analysis 50 (2021), Lissajous-Chebyshev nodes.
    """
    terms, n = len(basis.exponents), basis.degree // np.array(basis.weights) + 1
    if np.prod(n // 2 + 1.0) + np.prod((n + 1.0) // 2) > 6 * terms:
        count = max(2 * terms, min(6 * terms, 3000)) + 1
        return np.random.default_rng(0).uniform(0.0, np.pi, (count, basis.variables)), np.ones(count)
    parts = (np.meshgrid(*(np.arange(first, most + 1, 2) for most in n), indexing="ij") for first in (0, 1))
    j = np.concatenate([np.stack([own.ravel() for own in part], axis=1) for part in parts])
    return np.pi * j / n, np.where((j == 0) | (j == n), 0.5, 1.0).prod(axis=1)


@cache
def _values(basis: Basis, of_nodes: Basis) -> Array:
    """(count, T) values of the Chebyshev products of a basis at the nodes that belong to another one."""
    angles = _angles(of_nodes)[0]
    values = np.ones((len(angles), len(basis.exponents)))
    for own, degrees in zip(angles.T, basis.exponents.T, strict=True):
        values *= np.cos(np.outer(own, np.arange(basis.degree + 1)))[:, degrees]
    return values


@cache
def _fit(basis: Basis) -> Array:
    """(T, count) matrix from values at the nodes of a basis to coefficients, by weighted least squares."""
    weights = np.sqrt(_angles(basis)[1])
    Q, R = np.linalg.qr(weights[:, None] * _values(basis, basis))
    return np.asarray(np.linalg.solve(R, Q.T * weights), dtype=float)


def exponents(problem: Problem, lengths: Sequence[int]) -> Indices:
    """(T, d) degrees of the coefficients in each parameter, in the order of the coefficients."""
    if not problem.weights:
        return np.indices(lengths).reshape(problem.d, math.prod(lengths)).T
    return problem.basis(lengths[0]).exponents


def sums_of_orders(problem: Problem, c: Array) -> list[Array]:
    """For each parameter, the sums of the moduli of coefficients (m, *lengths) with each degree in this parameter."""
    sizes, own = np.abs(c).reshape(len(c), -1).sum(axis=0), exponents(problem, c.shape[1:])
    return [np.asarray(np.bincount(own[:, j], sizes), dtype=float) for j in range(problem.d)]


def restricted(problem: Problem, c: Array, leading: int, variable: int, side: int) -> tuple[Array, Array]:
    """Coefficients over half of the range of a variable, and bounds of the errors of the polynomials.

    T_k((z + side) / 2) is interpolated. Its values have the error k^2 times the rounding error of the argument.
    """
    lengths = c.shape[leading:]
    is_tensor = not problem.weights
    n = lengths[variable] if is_tensor else problem.basis(lengths[0]).degree + 1
    k = np.arange(n)
    z = 0.5 * (ch.nodes(n) + side)
    matrix = ch.coefficients_from_nodes(n) @ np.cos(np.outer(np.arccos(z), k))
    entries = above(k * k * (ch.ENTRY_ERROR + 8 * U) + 16 * U * (k + 1) + 2 * ch.ENTRY_ERROR + 2 * of_sum(n + 2))
    weights = (2.0 * n * entries)[exponents(problem, lengths)[:, variable]]
    lost = above((np.abs(c).reshape(*c.shape[:leading], -1) * weights).sum(axis=-1))
    if is_tensor:
        axis = leading + variable
        return np.moveaxis(np.tensordot(matrix, c, (1, axis)), 0, axis), lost
    matrix = problem.basis(lengths[0]).along(variable, np.triu(matrix))
    return (matrix @ c.reshape(-1, *lengths).T).T.reshape(c.shape), lost


def monomials(c: Array, source: Basis, basis: Basis) -> tuple[Array, Array]:
    """Coefficients (..., T) of the monomials of a basis, from those of Chebyshev products (..., S) of another basis.

    Also return bounds (...) of the missing terms.
    """
    matrix = source.from_chebyshev
    own, sizes = (matrix @ c.reshape(-1, c.shape[-1]).T).T, (abs(matrix) @ np.abs(c).reshape(-1, c.shape[-1]).T).T
    lost = sizes.sum(axis=-1) * of_sum(int(np.diff(matrix.indptr).max()) + 2)
    places, has = _places(source, basis)
    found = np.zeros((len(own), len(basis.exponents)))
    found[:, places[has]] = own[:, has]
    lost = above(lost + np.abs(own[:, ~has]).sum(axis=-1))
    return found.reshape(*c.shape[:-1], found.shape[-1]), lost.reshape(c.shape[:-1])


@cache
def _places(source: Basis, basis: Basis) -> tuple[Indices, Mask]:
    """Places (S,) of the monomials of a basis in another basis, and a mask (S,) of those that it has."""
    has = source.exponents @ np.array(basis.weights) <= basis.degree
    places = np.zeros(len(has), dtype=np.intp)
    places[has] = basis.places(source.exponents[has])
    return places, has


@dataclass(frozen=True, eq=False)
class Matrix:
    """Matrices (n, k) of Taylor models at P nodes of time: coefficients c (T, P, n, k) and radii (P, n, k)."""

    c: Array
    radius: Array
    basis: Basis

    @classmethod
    def of(cls, entries: Sequence[Model], n: int) -> "Matrix":
        """The matrix with n rows from its entries, in rows."""
        basis, size = entries[0].basis, max(len(a.c) for a in entries)
        places = np.broadcast_shapes(*(a.c.shape[1:] for a in entries))
        c = np.zeros((size, *places, len(entries)))
        for k, a in enumerate(entries):
            c[: len(a.c), :, k] = a.c
        radius = np.stack([np.broadcast_to(a.radius, places) for a in entries], axis=-1)
        return cls(c.reshape(*c.shape[:2], n, -1), radius.reshape(*places, n, -1), basis)

    @property
    def norms(self) -> Array:
        """(degree + 1, P, n, k) sums of the moduli of the coefficients of each degree."""
        degree = self.basis.counts.index(len(self.c))
        return np.add.reduceat(np.abs(self.c), [0, *self.basis.counts[:degree]], axis=0)

    def minus(self, other: "Matrix") -> "Matrix":
        """The difference."""
        c = np.zeros((max(len(self.c), len(other.c)), *np.maximum(self.c.shape[1:], other.c.shape[1:])))
        c[: len(self.c)] = self.c
        c[: len(other.c)] -= other.c
        return Matrix(c, above(self.radius + other.radius + 4 * U * np.abs(c).sum(axis=0)), self.basis)

    def times(self, other: "Matrix") -> "Matrix":
        """The matrix product. Terms above the degree of the basis are bounded by their moduli."""
        own, others, most = self.norms, other.norms, self.basis.degree
        pairs = self.basis.pairs(len(own) - 1, len(others) - 1, most)
        c = pairs.product(self.c, other.c, np.matmul)
        tails = np.cumsum(others[::-1], axis=0)[::-1]
        lost = sum((a @ tails[most - k + 1] for k, a in enumerate(own) if most - k + 1 < len(tails)), np.zeros(1))
        whole = tails[0] + other.radius
        rounded = of_sum(pairs.largest * self.c.shape[-1] + 2) * (own.sum(axis=0) @ tails[0])
        return Matrix(c, above(own.sum(axis=0) @ other.radius + self.radius @ whole + lost + rounded), self.basis)

    def bounds(self) -> Array:
        """Bounds (3, n, k) of the interpolation in time at the nodes, for all parameters.

        They hold for its values, for its integrals from the begin of the step over the length of the step, and for its
        mean over the step. Each coefficient of the Chebyshev polynomials of the parameters is interpolated separately.
        The mean has positive weights of the values at nodes (Fejer).
        """
        size, places, *shape = self.c.shape
        matrix = self.basis.to_chebyshev[: self.basis.counts[-1], :size]
        c = (matrix @ self.c.reshape(size, -1)).reshape(-1, places, *shape)
        lebesgue = above(2.0 / np.pi * np.log(places) + 1.0)
        radius = above(self.radius + of_sum(size + 2) * np.abs(self.c).sum(axis=0)).max(axis=0)
        c, none = np.moveaxis(c, 1, -1), np.zeros(c.shape[:1] + c.shape[2:])
        most = np.stack([ch.bound_of_samples(c, none, 1), *ch.integrals_of_samples(c, none, 1)]).sum(axis=1)
        most += np.stack([lebesgue * radius, lebesgue * radius, radius])
        return np.where(np.isnan(most), np.inf, above(most))


def at_nodes(c: Array, error: Array, count: int, source: Basis, basis: Basis) -> list[Model]:
    """Taylor models, in the parameters, of polynomials (q, K, S) with errors (q,) at nodes of time.

    Constant terms are added last, so that they have the rounding error of only one sum.
    """
    found, lost = monomials(c, source, basis)
    constant = found[:, 0, 0].copy()
    found[:, 0, 0] = 0.0
    matrix = ch.values_at_nodes(count, c.shape[1])
    rest = np.abs(found).sum(axis=(1, 2))
    values = np.einsum("mk,qkt->qtm", matrix, found, optimize=True)
    values[:, 0] += constant[:, None]
    radius = above(lost.sum(axis=1) + rest * ch.rounding_of([c.shape[1]]) + U * (np.abs(constant) + rest) + error)
    size = _size_in(source, basis)
    return [Model(own[:size], np.full(1, r), basis) for own, r in zip(values, radius, strict=True)]


def matrix_at_nodes(c: Array, error: Array, n: int, count: int, source: Basis, basis: Basis) -> Matrix:
    """Taylor models of n k polynomials of time and the parameters (..., K, S) at nodes of time, in n rows."""
    return Matrix.of(at_nodes(c.reshape(-1, *c.shape[-2:]), error.ravel(), count, source, basis), n)


def product_bound(problem: Problem, C: Array, B: Array, B_error: Array, minus: Array) -> Array:
    """Bounds (n, k) of C B - minus for matrices (n, n, ...) and (n, k, ...) of polynomials.

    B has errors up to B_error (n, k).

    The polynomials have the axes of the parameters, and perhaps an axis of time before them.
    """
    if not problem.weights:
        return ch.product_bound(C, B, B_error, minus)
    if C.ndim == 3:
        C, B = C[:, :, None], B[:, :, None]
    count, sources = C.shape[2] + B.shape[2] - 1, (problem.basis(C.shape[-1]), problem.basis(B.shape[-1]))
    basis = basis_of(sources[0].weights, max(source.degree for source in sources) + 1)
    n = len(C)
    own = matrix_at_nodes(C, np.zeros(n * n), n, count, sources[0], basis)
    other = matrix_at_nodes(B, B_error, n, count, sources[1], basis)
    return own.times(other).minus(Matrix(minus[None, None], np.zeros((1, *minus.shape)), basis)).bounds()[0]


@cache
def _size_in(source: Basis, basis: Basis) -> int:
    """Number of the first monomials of a basis that contain all monomials of another basis which it has."""
    places, has = _places(source, basis)
    return basis.counts[int(basis.degrees[places[has]].max())]
