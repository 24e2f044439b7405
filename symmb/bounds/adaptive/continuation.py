"""The most likely continuation of an interpolant on a grid through runs at other points."""

from dataclasses import dataclass

import numpy as np

from symmb._limits import windows
from symmb._types import Array
from symmb.nodes import Grid, Index, below
from symmb.polynomials import MultiIndices, basis_values

_NOISE = 1e-6
"""Noise over the expected squares: it keeps the matrix regular for points that are close to each other or to nodes."""


@dataclass(frozen=True, eq=False)
class Continuation:
    """Expected coefficients beyond those of a grid, before and after further runs are known.

    The further coefficients are independent Gaussian variables with mean 0 and sizes that are extrapolated from the
    grid. Given the interpolant's errors e at some points, their most likely values are

        c = S F' (F F' + noise)^-1 e,

    where S are the sizes, and F (C, n_b) are the further polynomials at the points, less their interpolants, times S.
    Nodes keep their values.

    Attributes
    ----------
    alpha : (n_b, d)        multi-indices that may come next
    sizes : (n_b,)          expected sizes
    interpolants : (N, n_b) coefficients of the interpolants of these polynomials
    """

    alpha: MultiIndices
    sizes: Array
    interpolants: Array

    @classmethod
    def of(cls, grid: Grid, sizes: dict[Index, float]) -> "Continuation":
        """From the indices ahead of a grid, with their expected sizes."""
        alpha = np.array(list(sizes), dtype=np.intp)
        return cls(alpha, np.array(list(sizes.values())), grid.coefficients(basis_values(alpha, grid.nodes)))

    def through(self, known: MultiIndices, points: Array, errors: Array) -> tuple[Array, Array]:
        """Changes of the known coefficients (N, m), and further coefficients (n_b, m).

        Parameters
        ----------
        known : (N, d)          multi-indices of the grid
        points : (C, d)
        errors : (C, m)         of the interpolant
        """
        free = self._free(known, points)
        further = self.sizes[:, None] * (free.T @ np.linalg.solve(self._products(free), errors))
        return -self.interpolants @ further, further

    def expected_error(self, known: MultiIndices, places: Array, points: Array) -> Array:
        """Root mean square (...) of the error that runs at points (C, d) leave at places (..., d), rounded to 0.1."""
        free, places = self._free(known, points), places.round(1)
        flat, errors = places.reshape(-1, places.shape[-1]), np.empty(places.shape[:-1])
        for window in windows(len(flat), places.shape[-1]):
            different, which = np.unique(flat[window], axis=0, return_inverse=True)
            there = self._free(known, different)
            covariance = free @ there.T
            explained = (covariance * np.linalg.solve(self._products(free), covariance)).sum(axis=0)
            remaining = np.sqrt(np.maximum(np.square(there).sum(axis=1) - explained, 0.0))
            errors.reshape(-1)[window] = remaining[which.ravel()]
        return errors

    def _free(self, known: MultiIndices, points: Array) -> Array:
        """(C, n_b) values of the further polynomials at points, less their interpolants, times the expected sizes."""
        return (basis_values(self.alpha, points) - basis_values(known, points) @ self.interpolants) * self.sizes

    def _products(self, free: Array) -> Array:
        """(C, C) expected products of the errors at points."""
        noise = _NOISE * np.square(self.sizes).sum() or 1.0  # any, if none is expected
        return free @ free.T + noise * np.eye(len(free))


def extrapolated_sizes(grid: Grid, sizes: Array) -> dict[Index, float]:
    """Expected sizes of the coefficients next to those of a grid, if they decay as these (N,) do.

    The size at index a is the least of |c_b| and |c_b| |c_(a-b+z)| / |c_z| over its lower neighbours b and theirs z.
    """
    size = dict(zip(grid.row, sizes.tolist(), strict=True))
    return {index: _extrapolated(index, size) for index in sorted(grid.ahead())}


def largest(sizes: dict[Index, float], number: int) -> set[Index]:
    """So many indices with the largest sizes."""
    return set(sorted(sizes, key=lambda a: (-sizes[a], sum(a), a))[: max(number, 0)])


def _extrapolated(index: Index, size: dict[Index, float]) -> float:
    candidates = [size[b] for b in below(index)]
    for b in below(index):
        for z in below(b):
            c = tuple(i - j + k for i, j, k in zip(index, b, z, strict=True))
            if any(z) and size[z] > 0:
                candidates.append(size[b] * size[c] / size[z])
    return min(candidates)
