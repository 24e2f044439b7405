"""The most likely continuation of an interpolant on a grid through runs at other points."""

from dataclasses import dataclass

import numpy as np

from symmb._types import Array
from symmb.nodes import Grid, Index, below
from symmb.polynomials import MultiIndices, basis_values

_NOISE = 1e-6
"""Share of the expected squares that keeps points close to each other apart, and those at nodes from any influence."""


@dataclass(frozen=True, eq=False)
class Continuation:
    """What coefficients beyond those of a grid are likely, and what they are once further runs are known.

    The coefficients that may come next are taken as independent with mean 0 and the sizes that follow from those below.
    Given the interpolant's errors at some points, their most likely values are those of smallest weighted squares that
    explain the errors; nodes keep their values.

    Attributes
    ----------
    alpha : (n_b, d)        multi-indices that may come next
    sizes : (n_b,)          expected sizes
    undone : (N, n_b)       coefficients of the interpolants of these polynomials
    """

    alpha: MultiIndices
    sizes: Array
    undone: Array

    @classmethod
    def of(cls, grid: Grid, likely: dict[Index, float]) -> "Continuation":
        """From the indices ahead of a grid, with their likely sizes."""
        alpha = np.array(list(likely), dtype=np.intp)
        return cls(alpha, np.array(list(likely.values())), grid.coefficients(basis_values(alpha, grid.nodes)))

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
        return -self.undone @ further, further

    def expected(self, known: MultiIndices, places: Array, points: Array) -> Array:
        """Root mean square (...) of the error that runs at points (C, d) leave at places (..., d), rounded to 0.1."""
        different, which = np.unique(places.reshape(-1, places.shape[-1]).round(1), axis=0, return_inverse=True)
        there, free = self._free(known, different), self._free(known, points)
        shared = free @ there.T
        told = (shared * np.linalg.solve(self._products(free), shared)).sum(axis=0)
        left = np.sqrt(np.maximum(np.square(there).sum(axis=1) - told, 0.0))
        return np.asarray(left[which.ravel()].reshape(places.shape[:-1]))

    def _free(self, known: MultiIndices, points: Array) -> Array:
        """(C, n_b) values of the further polynomials at points, less their interpolants, times the expected sizes."""
        return (basis_values(self.alpha, points) - basis_values(known, points) @ self.undone) * self.sizes

    def _products(self, free: Array) -> Array:
        """(C, C) expected products of the errors at points."""
        noise = _NOISE * np.square(self.sizes).sum() or 1.0  # any, if none is expected
        return free @ free.T + noise * np.eye(len(free))


def likely_ahead(grid: Grid, sizes: Array) -> dict[Index, float]:
    """Sizes that coefficients next to those of a grid would have if they fell off as these, (N,), do."""
    size = dict(zip(grid.row, sizes.tolist(), strict=True))
    return {index: _extrapolated(index, size) for index in sorted(grid.ahead())}


def _extrapolated(index: Index, size: dict[Index, float]) -> float:
    found = [size[b] for b in below(index)]
    for b in below(index):
        for z in below(b):
            c = tuple(i - j + k for i, j, k in zip(index, b, z, strict=True))
            if any(z) and size[z] > 0:
                found.append(size[b] * size[c] / size[z])
    return min(found)
