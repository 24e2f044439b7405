"""Responses at the nodes of interpolants: at all times, and at some of many times, by which errors are estimated."""

import numpy as np

from symmb._types import Array, Indices
from symmb.bounds.adaptive.constants import MANY_TIMES
from symmb.nodes import Grid
from symmb.polynomials import Expansion

ALL_TIMES = slice(None)


class NodeResponses:
    """Responses at nodes, in blocks as they were run: interpolants need no copy of them.

    Attributes
    ----------
    some_times : at which errors are estimated; all, unless there are many
    """

    def __init__(self, n_t: int) -> None:
        step = n_t // MANY_TIMES
        self.some_times = slice(None, None, step) if step > 1 else ALL_TIMES
        self._all: list[Array] = []
        self._some = self._all if self.some_times == ALL_TIMES else []

    def append(self, Y: Array) -> None:
        """More responses (N, n_t, n_y)."""
        self._all.append(Y)
        if self._some is not self._all:
            self._some.append(np.ascontiguousarray(Y[:, self.some_times]))

    def at(self, times: slice) -> Array:
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

    def interpolant(self, grid: Grid, rows: Indices, times: slice, names: tuple[str, ...]) -> Expansion:
        """Through the responses at nodes of these rows (N,), at all or some times, in named parameters."""
        blocks = self._at(times)
        coefficients = grid.coefficients(*(Y.reshape(len(Y), -1) for Y in blocks), rows=rows)
        return Expansion(grid.alpha, coefficients.reshape(len(rows), *blocks[0].shape[1:]), names)

    def at_all_times(self, error: Array, n_t: int) -> Array:
        """An error (n_t, n_y) from that at some times: the larger of those at the nearest ones before and after."""
        if self.some_times == ALL_TIMES:
            return error
        larger = np.maximum(error, np.concatenate([error[1:], error[-1:]]))
        return np.repeat(larger, self.some_times.step, axis=0)[:n_t]

    def _at(self, times: slice) -> list[Array]:
        return self._all if times == ALL_TIMES else self._some
