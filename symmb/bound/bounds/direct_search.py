"""Local searches for the largest value of a function over the unit box, without derivatives."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from symmb._types import Array

STARTS, LATE_STARTS = 4, 2
"""Starts from which a search goes on, and those with late steps: more take more runs, fewer miss hills."""
STEPS, LEAST_STEPS = (2.0, 0.5, 0.12, 0.03, 0.008), 3
"""The first ones lead from corners to their neighbours. So many are always taken, others where the gain of the last one
leaves it open whether more is enough."""
LINE_POINTS = 17
"""Points on a line along an axis of which the best is looked for: a sine of a period has its extremes within 0.06."""
SAFETY_OF_GAIN = 2.0
"""How many times the gain of a step may be what the search is short of the largest value."""
SAME_PLACE = 0.12
"""Distance in a parameter below which searches from two places are the same."""
SUFFICIENT_GAIN = 1e-4
"""Gain over the range of values at the starts above which a step is tried again: less takes more runs."""


class Found(NamedTuple):
    """The best place (d,) of a search, the value there, and how far it may be below the largest one, by the gain of the
    last steps; infinite if the search is not ended."""

    place: Array
    value: float
    error: float


def direct_search(f: Callable[[Array], Array], starts: Array, most: int, enough: float = np.inf) -> Found:
    """The best place that polls lead to from the best of some starts (n, d).

    A poll goes one step along each axis, or along each of some random orthogonal directions, to both sides, and along
    all of them at once by as much as parabolas tell. If both gain nothing the next step is shorter. (Audet and Dennis
    2006, Mesh adaptive direct search algorithms for constrained optimization)

    Parameters
    ----------
    f : values (N,) at points (N, d), minus infinity where there is none
    most : values that are asked for, but for the last poll
    enough : value above which the search ends; it also ends where none is to be expected
    """
    d, rng, known = starts.shape[1], np.random.default_rng(0), dict[bytes, float]()

    def values(points: Array) -> Array:
        """Values (...) at points (..., d)."""
        flat = np.ascontiguousarray(points.reshape(-1, d) + 0.0)
        keys = [row.tobytes() for row in flat]
        new = {key: row for key, row in zip(keys, flat, strict=True) if key not in known}
        if new:
            known.update(zip(new, f(np.stack([*new.values()])).tolist(), strict=True))
        return np.array([known[key] for key in keys]).reshape(points.shape[:-1])

    x, fx = _best(starts, values(starts), STARTS)
    sufficient = SUFFICIENT_GAIN * float(np.ptp([value for value in known.values() if value > -np.inf] or [0.0]))
    error = np.inf
    for i, step in enumerate(STEPS):
        if i >= LEAST_STEPS and fx[0] + error < enough:
            break
        number = STARTS if step == STEPS[0] else LATE_STARTS
        x, fx = x[:number], fx[:number]
        late, is_axial = fx[0], True
        while True:
            if len(known) >= most or not -np.inf < fx[0] <= enough:
                return Found(x[0], float(fx[0]), np.inf)
            basis = np.eye(d) if is_axial else np.linalg.qr(rng.normal(size=(d, d)))[0]
            points = _poll(values, x, fx, step, basis)
            reached = values(points)
            row, before, each = reached.argmax(axis=1), fx[0], np.arange(len(x))
            x, fx = _best(points[each, row], reached[each, row], len(x))
            has_gained = fx[0] > before + sufficient
            if not has_gained and (not is_axial or (np.abs(x) == 1).all()):  # inward of a corner, axes tell enough
                break
            is_axial = has_gained
        error = SAFETY_OF_GAIN * float(fx[0] - late)
    return Found(x[0], float(fx[0]), error)


def _poll(values: Callable[[Array], Array], x: Array, fx: Array, step: float, basis: Array) -> Array:
    """Points (k, 2 d + 2, d) of a poll about places x (k, d) with values fx (k,).

    They are the places, those a step ahead and behind along each vector of a basis (d, d), and where all steps together
    lead: each to its better end, or to the vertex of a parabola through both.
    """
    polled = np.clip(x[:, None] + step * np.concatenate([basis, -basis]), -1.0, 1.0)
    ahead, behind = np.split(values(polled) - fx[:, None], 2, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        vertex = np.nan_to_num((ahead - behind) / (-2 * (ahead + behind)), posinf=0.0, neginf=0.0)
    shift = np.where(np.maximum(ahead, behind) > 0, np.where(ahead >= behind, 1.0, -1.0), vertex)
    together = np.clip(x + step * shift @ basis, -1.0, 1.0)[:, None]
    return np.concatenate([x[:, None], polled, together], axis=1)


def _best(x: Array, fx: Array, number: int) -> tuple[Array, Array]:
    """So many of the best places (k, d) at most that are not close to better ones, and their values."""
    kept = list[int]()
    for i in np.argsort(-fx, kind="stable"):
        if not kept or (fx[i] > -np.inf and all(np.abs(x[i] - x[j]).max() >= SAME_PLACE for j in kept)):
            kept.append(int(i))
    return x[kept[:number]], fx[kept[:number]]
