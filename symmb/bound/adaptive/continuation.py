"""The most likely further terms of an interpolant on a grid that has check runs, its range and its error."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from symmb._limits import windows
from symmb._types import Array, Indices
from symmb.bound.nodes import Grid, Index, below
from symmb.bound.polynomials import Expansion, MultiIndices, basis_values
from symmb.bound.polynomials.ranges import RANGE_WORK, Exact
from symmb.bound.searches import EXPECTED_NOISE

SPARSE_PROBES = 2
"""Number of quasi-random check points, because runs along axes do not show products of parameters. More points miss
fewer products and take more runs."""
REMAINING_SHARE = 0.1
"""Smallest ratio of the remaining to the expected error at check runs, because the continuation does not interpolate.
It also limits the estimated error after check runs. Smaller ratios miss more errors. Larger ratios take more runs."""
SPARSE_RANGE = 0.02
"""Ratio of the accuracy of a range to the tolerance. Smaller ratios take more time."""


@dataclass(frozen=True, eq=False)
class Continuation:
    """Estimates of the polynomial coefficients that a grid does not determine. Further runs correct these estimates.

    The coefficients beyond the grid are modelled as independent Gaussian variables with mean 0. The sizes of these
    coefficients are extrapolated from the grid. Given the interpolant's errors e at some points, the most likely
    coefficients are

        c = S F' (F F' + noise)^-1 e = S (F' F + noise)^-1 F' e,

    where S are the sizes. F (C, n_b) are the further polynomials at the points, minus their interpolants, times S. The
    form with the smaller matrix is computed. The values at nodes do not change.

    Attributes
    ----------
    alpha : (n_b, d)        multi-indices that may be added next
    sizes : (n_b,)          expected sizes
    interpolants : (N, n_b) coefficients of the interpolants of these polynomials
    """

    alpha: MultiIndices
    sizes: Array
    interpolants: Array

    @classmethod
    def of(cls, grid: Grid, sizes: dict[Index, float]) -> "Continuation":
        """The continuation with the indices next to a grid, and their expected sizes."""
        alpha = np.array(list(sizes), dtype=np.intp)
        return cls(alpha, np.array(list(sizes.values())), grid.coefficients(basis_values(alpha, grid.nodes)))

    def free(self, known: MultiIndices, points: Array) -> Array:
        """Values (C, n_b) of the further polynomials at points, minus their interpolants, times the expected sizes.

        `known` (N, d) are the multi-indices of the grid.
        """
        return (basis_values(self.alpha, points) - basis_values(known, points) @ self.interpolants) * self.sizes

    @property
    def noise(self) -> float:
        """Variance of the noise of check runs."""
        return EXPECTED_NOISE * float(np.square(self.sizes).sum()) or 1.0  # if all sizes are 0, any value is possible


def extrapolated_sizes(grid: Grid, sizes: Array) -> dict[Index, float]:
    """Expected sizes of the coefficients next to a grid, if they decay like the known coefficients with sizes (N,).

    The size at index a is the smallest of |c_b| and |c_b| |c_(a-b+z)| / |c_z|, for lower neighbours b of a, and z of b.
    """
    size = dict(zip(grid.row, sizes.tolist(), strict=True))
    return {index: _extrapolated(index, size) for index in sorted(grid.ahead())}


def largest(sizes: dict[Index, float], number: int) -> set[Index]:
    """The `number` indices with the largest expected sizes."""
    return set(sorted(sizes, key=lambda a: (-sizes[a], sum(a), a))[: max(number, 0)])


def _extrapolated(index: Index, size: dict[Index, float]) -> float:
    candidates = [size[b] for b in below(index)]
    for b in below(index):
        for z in below(b):
            c = tuple(i - j + k for i, j, k in zip(index, b, z, strict=True))
            if any(z) and size[z] > 0:
                candidates.append(size[b] * size[c] / size[z])
    return min(candidates)


@dataclass(frozen=True, eq=False)
class Corrected:
    """An expansion that is continued through check runs. Coefficients are computed for windows of responses.

    Attributes
    ----------
    base : expansion on the grid
    continuation : continuation of the base
    free : (C, n_b) further polynomials at the check runs, see `Continuation.free`
    errors : (C, n_t n_y) errors of the base at the check runs
    """

    base: Expansion
    continuation: Continuation
    free: Array
    errors: Array

    @classmethod
    def of(cls, base: Expansion, continuation: Continuation, points: Array, checks: Array) -> "Corrected":
        """The expansion that is continued through check runs at points (C, d) with responses (C, n_t, n_y)."""
        coefficients = base.coefficients.reshape(len(base.alpha), -1)
        errors = checks.reshape(len(points), coefficients.shape[1]) - basis_values(base.alpha, points) @ coefficients
        return cls(base, continuation, continuation.free(base.alpha, points), errors)

    def extended(self, points: Array, checks: Array) -> "Corrected":
        """The expansion that is continued through further check runs (C, d) and (C, n_t, n_y) as well."""
        more = Corrected.of(self.base, self.continuation, points, checks)
        free, errors = np.concatenate([self.free, more.free]), np.concatenate([self.errors, more.errors])
        return replace(self, free=free, errors=errors)

    @cached_property
    def _factor(self) -> Array:
        """Lower Cholesky factor of the smaller of the two matrices."""
        free = self.free if self._has_few else self.free.T
        products: Array = free @ free.T + self.continuation.noise * np.eye(len(free))
        return np.linalg.cholesky(products).astype(float)

    @property
    def _has_few(self) -> bool:
        """Whether there are fewer check runs than further polynomials."""
        return self.free.shape[0] <= self.free.shape[1]

    def expected_error(self, places: Array) -> Array:
        """Root mean square (...) of the remaining error at places (..., d), rounded to multiples of 0.1."""
        from scipy.linalg import solve_triangular  # this import takes longer than a study of a small scene

        # Neighbouring times have almost the same places. Rounded places are equal and need one solution.
        places = places.round(1)
        flat, errors = places.reshape(-1, places.shape[-1]), np.empty(places.shape[:-1])
        for window in windows(len(flat), places.shape[-1]):
            first, which = _equal_rows(flat[window])
            there = self.continuation.free(self.base.alpha, flat[window][first]).T
            half = self.free @ there if self._has_few else there
            squares = np.square(solve_triangular(self._factor, half, lower=True)).sum(axis=0)
            if self._has_few:
                squares = np.maximum(np.square(there).sum(axis=0) - squares, 0.0)
            else:
                squares *= self.continuation.noise
            errors.reshape(-1)[window] = np.sqrt(squares)[which]
        return errors

    @cached_property
    def alpha(self) -> MultiIndices:
        """Multi-indices (n_b, d) of the polynomials that may be added to the grid."""
        return np.concatenate([self.base.alpha, self.continuation.alpha])

    def parts(self) -> Iterator[tuple[slice, Array]]:
        """Windows of the n_t n_y responses, and their coefficients (n_b, m)."""
        cuts = [*windows(self.base.coefficients[0].size, len(self.alpha))]
        for window in cuts:
            yield window, self._whole if len(cuts) == 1 else self._part(window)

    @cached_property
    def _whole(self) -> Array:
        return self._part(slice(None))

    def _part(self, window: slice) -> Array:
        from scipy.linalg import cho_solve

        base = self.base.coefficients.reshape(len(self.base.alpha), -1)[:, window]
        factor, errors = (self._factor, True), self.errors[:, window]
        likely = self.free.T @ cho_solve(factor, errors) if self._has_few else cho_solve(factor, self.free.T @ errors)
        further = self.continuation.sizes[:, None] * likely
        return np.concatenate([base - self.continuation.interpolants @ further, further])

    def expansion(self) -> Expansion:
        """The continued expansion with all coefficients."""
        coefficients = np.empty((len(self.alpha), *self.base.coefficients.shape[1:]))
        for window, part in self.parts():
            coefficients.reshape(len(self.alpha), -1)[:, window] = part
        return Expansion(self.alpha, coefficients, self.base.parameters)

    def values(self, points: Array) -> Array:
        """Responses (N, n_t, n_y) at points (N, d)."""
        basis, shape = basis_values(self.alpha, points), self.base.coefficients.shape[1:]
        return np.concatenate([basis @ part for _, part in self.parts()], axis=1).reshape(-1, *shape)

    def range(self, tolerance: float) -> tuple[Array, Array, Array]:
        """Minima and maxima (n_t, n_y), and their places (2, n_t, n_y, d).

        The minima and maxima are the best values of a search. A proved range would take longer than the runs, and the
        response may still exceed it.
        """
        alpha, shape = self.alpha, self.base.coefficients.shape[1:]
        attained = Exact(tolerance, RANGE_WORK // len(alpha) + 1).attained
        found = [attained(alpha, part) for _, part in self.parts()]
        names = "lower", "upper", "at_lower", "at_upper"
        lower, upper, *places = (np.concatenate([getattr(each, name) for each in found]) for name in names)
        return lower.reshape(shape), upper.reshape(shape), np.stack(places).reshape(2, *shape, -1)


def _equal_rows(places: Array) -> tuple[Indices, Indices]:
    """Numbers (k,) of the first of equal places (n, d), which are multiples of 0.1, and for each place one of the k."""
    weights = 21.0 ** np.arange(places.shape[1])  # digits of a number: random digits for so many that rounding counts
    if places.shape[1] > 12:
        weights = np.random.default_rng(0).uniform(size=places.shape[1])
    _, first, which = np.unique((10 * places).round() @ weights, return_index=True, return_inverse=True)
    return first, which
