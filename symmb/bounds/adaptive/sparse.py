"""Bounds over many parameters: a sparse grid that grows where the response varies, and check runs that correct it."""

from dataclasses import dataclass

import numpy as np

from symmb._types import Array
from symmb.bounds.adaptive.check_runs import TRUST, generic, seen, spread
from symmb.bounds.adaptive.continuation import Continuation, likely_ahead
from symmb.bounds.adaptive.runs import Found, Runs, rms, share
from symmb.bounds.adaptive.truncation_error import Tails
from symmb.nodes import Grid, Index
from symmb.nodes import grid as corners
from symmb.polynomials import Expansion
from symmb.polynomials.ranges import Exact

_GROWTH = 0.25
"""The grid grows by about this share at a time."""
_PROBES, _SURPRISE = 2, 3.0
"""Runs at points that nothing singles out, which see products that runs along the axes do not; and how many times as
large as expected an error is there that they alone have seen: it may come from any index ahead of the grid."""
_PATIENCE, _HELPS = 30, 0.7
"""Nodes for each parameter before growth is given up, and what it has to leave of the error when the grid doubles."""
_REACHED = 0.2
"""Share of the expected error that remains even at places of check runs: the continuation is no interpolant of all."""
_RANGE = 0.02
"""Share of the tolerance to which ranges are found."""
_WORK, _FEWEST_BOXES = 200_000, 20
"""Coefficients in all boxes that a range may take, where many parameters leave it unproved anyway; boxes at least."""


def sparse_bounds(runs: Runs, tolerance: float, patient: bool) -> Found:
    """Range of an interpolant on a grid that grows by the indices whose coefficients are likely to be the largest.

    Its error is estimated from its last coefficients. Runs at some of its extremes then check the estimate and correct
    the expansion. Unless patient it does not go on where growth does not help, as with kinks.
    """
    d = len(runs.box)
    grid, expansion, checks = Grid(d), None, 2 * d
    probes, errors = generic(_PROBES, d), dict[int, float]()
    step = grid.missing([tuple(2 * (i == j) for j in range(d)) for i in range(d)])
    while True:
        known = len(grid.row)
        grid.add(step)
        runs.at(grid.nodes[known:], expansion and expansion.values)
        coefficients = grid.coefficients(runs.nodes.reshape(len(runs.nodes), -1)).reshape(runs.nodes.shape)
        expansion = Expansion(grid.alpha, coefficients, runs.box.names)
        if not known:
            runs.check(probes[: runs.left])
        unit = runs.unit()
        likely = likely_ahead(grid, (rms(coefficients.swapaxes(0, 1)) / unit).max(axis=1))
        estimate = Tails.of(grid.alpha, coefficients).least
        probed = np.abs(runs.checks[:_PROBES] - expansion.values(runs.points[:_PROBES])).max(axis=0, initial=0.0)
        if share(probed, unit) > _SURPRISE * share(estimate, unit):
            estimate = np.maximum(estimate, seen(probed[None]))
            least = share(probed, unit) / len(likely) ** 0.5
            likely = {index: max(size, least) for index, size in likely.items()}
        step = _largest(likely, min(max(d, int(_GROWTH * len(grid.row))), runs.left - checks))
        errors[len(grid.row)] = share(estimate, unit)
        hopeless = not patient and _hopeless(errors, d)
        if hopeless and 2**d <= min(len(runs), runs.left - checks):
            runs.check(corners(np.array([-1.0, 1.0]), d))
        last = not step or hopeless
        if not last and share(estimate, unit) > tolerance / TRUST:  # checks may show that much less
            continue
        fitted, estimate = _corrected(runs, grid, expansion, likely, _RANGE * tolerance, estimate, unit, checks)
        if last or share(estimate, unit) <= tolerance:
            width = fitted.upper - fitted.lower
            return Found(fitted.lower, fitted.upper, estimate + _RANGE * tolerance * width, fitted.expansion)


def _hopeless(errors: dict[int, float], d: int) -> bool:
    """Whether errors, by the numbers of nodes, are as large as the response and do not fall."""
    nodes, error = list(errors.items())[-1]
    before = min((e for n, e in errors.items() if n <= nodes / 2), default=np.inf)
    return nodes >= _PATIENCE * d and error > 1 and error > _HELPS * before


def _largest(likely: dict[Index, float], number: int) -> set[Index]:
    return set(sorted(likely, key=lambda a: (-likely[a], sum(a), a))[: max(number, 0)])


@dataclass(frozen=True, eq=False)
class _Fitted:
    """An expansion and its range (n_t, n_y), with the places (2, n_t, n_y, d) of its minima and maxima.

    The range is the widest that was found: proofs take longer than the runs, and prove nothing of the responses.
    """

    expansion: Expansion
    lower: Array
    upper: Array
    places: Array

    @classmethod
    def of(cls, expansion: Expansion, tolerance: float) -> "_Fitted":
        alpha, shape = expansion.alpha, expansion.coefficients.shape[1:]
        search = Exact(tolerance, max(_FEWEST_BOXES, _WORK // len(alpha))).search
        found = search(alpha, expansion.coefficients.reshape(len(alpha), -1))
        lower, upper = found.lower + found.below, found.upper - found.above
        places = np.stack([found.at_lower, found.at_upper]).reshape(2, *shape, alpha.shape[1])
        return cls(expansion, lower.reshape(shape), upper.reshape(shape), places)


def _corrected(
    runs: Runs,
    grid: Grid,
    base: Expansion,
    likely: dict[Index, float],
    tolerance: float,
    estimate: Array,
    unit: Array,
    number: int,
) -> tuple[_Fitted, Array]:
    """The expansion continued through runs at some of its extremes, twice; and its error as the second ones see it."""
    fitted, largest = _Fitted.of(base, tolerance), estimate
    continuation = Continuation.of(grid, likely)
    typical = rms(continuation.expected(base.alpha, fitted.places, runs.points).ravel())

    def left(places: Array, points: Array) -> Array:
        """Share of the error typical of extremes that nodes and points leave at places (..., d)."""
        error = continuation.expected(base.alpha, places, points)
        return _REACHED + (1 - _REACHED) * np.divide(error, typical, out=np.ones_like(error), where=error < typical)

    for some in (number // 2, number - number // 2):
        before = runs.points
        weights = left(fitted.places, before) * estimate / unit
        points, Y = runs.check(spread(fitted.places, weights, min(some, runs.left)))
        if not len(points):
            continue
        largest = seen((Y - fitted.expansion.values(points)) / left(points, before)[:, None, None])
        known = (runs.checks - base.values(runs.points)).reshape(len(runs.points), -1)
        change, further = continuation.through(base.alpha, runs.points, known)
        coefficients = np.concatenate([base.coefficients.reshape(len(change), -1) + change, further])
        alpha = np.concatenate([base.alpha, continuation.alpha])
        fitted = _Fitted.of(Expansion(alpha, coefficients.reshape(len(alpha), *runs.shape), base.parameters), tolerance)
    return fitted, left(fitted.places, runs.points).max(axis=0) * np.maximum(largest, TRUST * estimate)
