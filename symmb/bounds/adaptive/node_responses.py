"""Responses at the nodes of interpolants: at all times, and at some of many times, by which errors are estimated."""

import numpy as np

from symmb._types import Array, Indices
from symmb.bounds.adaptive.constants import MANY_TIMES
from symmb.nodes import Grid
from symmb.polynomials import Expansion

Times = slice | Indices
ALL_TIMES = slice(None)
_GOLDEN = 0.6180339887498949
"""Its multiples are dispersed modulo 1."""


class NodeResponses:
    """Responses at nodes, in blocks as they were run: interpolants need no copy of them.

    Attributes
    ----------
    some_times : at which errors are estimated; all, unless there are many. They are not equally spaced: a motion whose
        period is a few output times would show them the same phase.
    """

    def __init__(self, n_t: int) -> None:
        step = n_t // MANY_TIMES
        blocks = np.arange(n_t // max(step, 1))
        within = (step * np.modf(_GOLDEN * blocks)[0]).astype(np.intp)
        self.some_times: Times = step * blocks + within if step > 1 else ALL_TIMES
        self._all: list[Array] = []
        self._some = self._all if self.some_times is ALL_TIMES else []

    def append(self, Y: Array) -> None:
        """More responses (N, n_t, n_y)."""
        self._all.append(Y)
        if self._some is not self._all:
            self._some.append(Y[:, self.some_times])

    def at(self, times: Times) -> Array:
        """Responses of all nodes (N, .., n_y) at all or some times."""
        blocks = self._at(times)
        if len(blocks) > 1:
            blocks[:] = [np.concatenate(blocks)]
        return blocks[0]

    def change(self, rows: Indices, change: Array) -> None:
        """Add (k, n_t, n_y) to the responses of k nodes."""
        self.at(ALL_TIMES)[rows] += change
        if self._some is not self._all:
            self.at(self.some_times)[rows] += change[:, self.some_times]

    def interpolant(self, grid: Grid, rows: Indices, times: Times, names: tuple[str, ...]) -> Expansion:
        """Through the responses at nodes of these rows (N,), at all or some times, in named parameters."""
        blocks = self._at(times)
        coefficients = grid.coefficients(*(Y.reshape(len(Y), -1) for Y in blocks), rows=rows)
        return Expansion(grid.alpha, coefficients.reshape(len(rows), *blocks[0].shape[1:]), names)

    def at_all_times(self, error: Array, n_t: int) -> Array:
        """An error (n_t, n_y) from that at some times: the larger of those at the nearest ones before and after."""
        if isinstance(self.some_times, slice):
            return error
        behind = np.searchsorted(self.some_times, np.arange(n_t), side="right")
        before = np.maximum(behind - 1, 0)
        return np.maximum(error[before], error[np.minimum(behind, len(error) - 1)])

    def _at(self, times: Times) -> list[Array]:
        return self._all if times is ALL_TIMES else self._some
