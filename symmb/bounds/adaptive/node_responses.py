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
_RESOLVED = 0.05
"""Deviation from a straight line between two times, over the width, up to which motions between them are resolved."""


class NodeResponses:
    """Responses at nodes, in blocks as they were run: interpolants need no copy of them.

    Attributes
    ----------
    some_times : at which errors are estimated; all, unless there are many. The first responses choose them.
    selects : whether some times are selected; sparse grids and response surfaces take all
    """

    def __init__(self, selects: bool) -> None:
        self.selects = selects
        self.some_times: Times = ALL_TIMES
        self._all: list[Array] = []
        self._some = self._all

    def append(self, Y: Array) -> None:
        """More responses (N, n_t, n_y)."""
        if self.selects and not self._all and Y.shape[1] >= 2 * MANY_TIMES:
            self.some_times, self._some = _some_times(Y), []
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
        behind = np.searchsorted(self.some_times, np.arange(n_t))
        before = np.searchsorted(self.some_times, np.arange(n_t), side="right") - 1
        return np.maximum(error[before], error[behind])

    def _at(self, times: Times) -> list[Array]:
        return self._all if times is ALL_TIMES else self._some


def _some_times(Y: Array) -> Indices:
    """Some of many times, by responses (N, n_t, n_y): the first, the last, and one in each short block.

    They are not equally spaced, because a motion whose period is a few output times would show them the same phase.
    Between two of them, the time at which responses differ most from straight lines is one of them as well if they
    differ by more than a share of the width: pulses may be short.
    """
    n_t, step = Y.shape[1], Y.shape[1] // MANY_TIMES
    blocks = np.arange(1 + (n_t - 1) // step)
    within = (step * np.modf(_GOLDEN * blocks)[0]).astype(np.intp)
    times = np.unique(np.minimum(np.concatenate([[0], step * blocks + within, [n_t - 1]]), n_t - 1))
    before = np.clip(np.searchsorted(times, np.arange(n_t), side="right") - 1, 0, len(times) - 2)
    share = (np.arange(n_t) - times[before]) / (times[before + 1] - times[before])
    mean, away = Y.mean(axis=0), np.zeros(Y.shape[1:])
    for y in Y:  # one at a time: memory
        moved = y - mean
        rise = np.diff(moved[times], axis=0)[before]
        np.maximum(away, np.abs(moved - moved[times[before]] - share[:, None] * rise), out=away)
    is_pulse = np.maximum.reduceat(away, times, axis=0)[:-1] > _RESOLVED * rms(np.ptp(Y, axis=0))
    between = [times[k] + int(np.argmax(away[times[k] : times[k + 1], i])) for k, i in np.argwhere(is_pulse)]
    return np.unique(np.concatenate([times, np.array(between, dtype=np.intp)]))


def rms(a: Array) -> Array:
    """Root mean square over the first axis."""
    return np.sqrt(np.mean(np.square(a), axis=0))
