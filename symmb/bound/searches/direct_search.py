"""Local searches for the largest value of a function over the unit box, without derivatives."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from symmb._types import Array

STARTS, LATE_STARTS = 4, 2
"""Number of places for the first step, and for later steps. More places require more runs. Fewer places miss maxima."""
STEPS, LEAST_STEPS = (2.0, 0.5, 0.12, 0.03, 0.008), 3
"""Lengths of the steps, and number of first steps that are always made. The first steps lead from a corner to its
neighbours. Shorter steps follow only if their gain may be relevant."""
EDGE_STEPS = tuple(0.008 * 0.1**k for k in range(1, 8))
"""Further steps if there are no values beside the best place. Values often change like a square root at such an edge,
so that the gain of longer steps does not show how much shorter ones gain."""
LINE_POINTS = 17
"""Number of points of a line search along an axis. For one period of a sine, these points find extremes within 0.06."""


class Found(NamedTuple):
    """The best place (d,) of a search, the value at this place, and its expected distance from the largest value.

    This distance, `error`, follows from the gain of the last steps. The distance is infinite if the search was not
    completed.
    """

    place: Array
    value: float
    error: float


def direct_search(f: Callable[[Array], Array], starts: Array, most: int, enough: float = np.inf) -> Found:
    """Search for the largest value of f by polls, from the best of some starts (n, d).

    A poll evaluates points one step away in both directions along each axis, or along random orthogonal directions. A
    poll also evaluates the point that parabolas through these values predict. If neither axes nor random directions
    give a gain, the step becomes shorter. Steps become shorter than usual beside a region without values. (Audet and
    Dennis 2006, Mesh adaptive direct search algorithms for constrained optimization)

    Parameters
    ----------
    f : values (N,) at points (N, d), minus infinity if there is no value
    most : number of evaluations after which no poll starts
    enough : value above which the search ends. The search also ends if no such value is expected
    """
    d, rng, values = starts.shape[1], np.random.default_rng(0), _Values(f)
    x, fx = _best(starts, values(starts), STARTS)
    # A step is repeated if its gain exceeds this fraction of the range of values at the starts. Smaller fractions
    # require more runs.
    sufficient = 1e-4 * float(np.ptp([value for value in values.known.values() if value > -np.inf] or [0.0]))
    error, is_at_edge = np.inf, False
    for i, step in enumerate((*STEPS, *EDGE_STEPS)):
        if not is_at_edge and (i >= len(STEPS) or (i >= LEAST_STEPS and fx[0] + error < enough)):
            break
        number = STARTS if step == STEPS[0] else LATE_STARTS
        x, fx = x[:number], fx[:number]
        late, is_axial = fx[0], True
        while True:
            # A value above `enough` suffices for the caller. Its distance from the maximum is not computed.
            if len(values.known) >= most or not -np.inf < fx[0] <= enough:
                return Found(x[0], float(fx[0]), np.inf)
            # Polls along the axes alone stop on ridges that are oblique to the axes. Random directions leave them.
            basis = np.eye(d) if is_axial else np.linalg.qr(rng.normal(size=(d, d)))[0]
            points = _poll(values, x, fx, step, basis)
            reached = values(points)
            is_at_edge = bool(np.isinf(reached[0]).any())
            row, before, each = reached.argmax(axis=1), fx[0], np.arange(len(x))
            x, fx = _best(points[each, row], reached[each, row], len(x))
            has_gained = fx[0] > before + sufficient
            if not has_gained and (not is_axial or (np.abs(x) == 1).all()):  # from a corner into the box, axes suffice
                break
            is_axial = has_gained
        # The gain of the last step, times this factor, is the expected distance from the largest value.
        error = 2.0 * float(fx[0] - late)
    return Found(x[0], float(fx[0]), error)


class _Values:
    """Values of a function. Each point is evaluated once, because polls of later steps contain earlier points again."""

    def __init__(self, f: Callable[[Array], Array]) -> None:
        self._f, self.known = f, dict[bytes, float]()

    def __call__(self, points: Array) -> Array:
        """Values (...) at points (..., d)."""
        flat = np.ascontiguousarray(points.reshape(-1, points.shape[-1]) + 0.0)  # 0 and -0 are one point
        keys = [row.tobytes() for row in flat]
        new = {key: row for key, row in zip(keys, flat, strict=True) if key not in self.known}
        if new:
            self.known.update(zip(new, self._f(np.stack([*new.values()])).tolist(), strict=True))
        return np.array([self.known[key] for key in keys]).reshape(points.shape[:-1])


def _poll(values: Callable[[Array], Array], x: Array, fx: Array, step: float, basis: Array) -> Array:
    """Points (k, 2 d + 2, d) of a poll about places x (k, d) with values fx (k,).

    The points are the place itself, points one step ahead and behind along each vector of a basis (d, d), and a
    combined step. Its parts are the best steps along each vector: to the better end, or to a parabola's vertex.
    """
    polled = np.clip(x[:, None] + step * np.concatenate([basis, -basis]), -1.0, 1.0)
    ahead, behind = np.split(values(polled) - fx[:, None], 2, axis=1)
    # If both ends are lower, the vertex is at most half a step away. Two ends of minus infinity give no vertex.
    with np.errstate(invalid="ignore", divide="ignore"):
        vertex = np.nan_to_num((ahead - behind) / (-2 * (ahead + behind)), posinf=0.0, neginf=0.0)
    shift = np.where(np.maximum(ahead, behind) > 0, np.where(ahead >= behind, 1.0, -1.0), vertex)
    together = np.clip(x + step * shift @ basis, -1.0, 1.0)[:, None]
    return np.concatenate([x[:, None], polled, together], axis=1)


def _best(x: Array, fx: Array, number: int) -> tuple[Array, Array]:
    """At most `number` of the best places (k, d) that are not close to better places, and their values."""
    kept = list[int]()
    for i in np.argsort(-fx, kind="stable"):
        # Places that are closer than this in each parameter are searched only once.
        if not kept or (fx[i] > -np.inf and all(np.abs(x[i] - x[j]).max() >= 0.12 for j in kept)):
            kept.append(int(i))
    return x[kept[:number]], fx[kept[:number]]
