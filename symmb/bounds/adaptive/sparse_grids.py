"""Bounds over many parameters: a sparse grid that grows where the response varies, and check runs that correct it."""

from dataclasses import dataclass

import numpy as np

from symmb._types import Array
from symmb.bounds.adaptive.check_runs import inflated_error, quasi_random_points, select_dispersed
from symmb.bounds.adaptive.constants import (
    CONTINUED_SHARE,
    FEWEST_BOXES,
    GROWTH,
    LEAST_PROGRESS,
    PATIENCE,
    RANGE_WORK,
    SPARSE_PROBES,
    SPARSE_RANGE,
    SURPRISE,
    TRUST,
)
from symmb.bounds.adaptive.continuation import Continuation, extrapolated_sizes
from symmb.bounds.adaptive.error_estimate import TruncationError
from symmb.bounds.adaptive.runs import EstimatedRange, Runs, relative_rms, rms
from symmb.nodes import Grid, Index
from symmb.nodes import grid as corners
from symmb.polynomials import Expansion
from symmb.polynomials.ranges import Exact


def sparse_bounds(runs: Runs, tolerance: float, patient: bool) -> EstimatedRange:
    """Range of an interpolant on a grid that grows by the indices with the largest expected coefficients.

    Its error is estimated from its last coefficients. Runs at some of its extremes then check the estimate and correct
    the expansion. Unless `patient`, growth ends when it does not help, as with kinks.
    """
    d = len(runs.box)
    grid, expansion, n_checks = Grid(d), None, 2 * d
    errors: dict[int, float] = {}
    step = grid.missing([tuple(2 * (i == j) for j in range(d)) for i in range(d)])
    while True:
        expansion = _interpolant(runs, grid, step, expansion)
        sizes, estimate = _expected(runs, grid, expansion)
        widths = runs.rms_widths()
        step = _largest(sizes, min(max(d, int(GROWTH * len(grid.row))), runs.left - n_checks))
        errors[len(grid.row)] = relative_rms(estimate, widths)
        is_stalled = not patient and _is_stalled(errors, d)
        if is_stalled and 2**d <= min(len(runs), runs.left - n_checks):
            runs.check(corners(np.array([-1.0, 1.0]), d))
        is_last = not step or is_stalled
        if not is_last and relative_rms(estimate, widths) > tolerance / TRUST:  # check runs may show that much less
            continue
        corrected, estimate = _correct(
            runs, grid, expansion, sizes, SPARSE_RANGE * tolerance, estimate, widths, n_checks
        )
        if is_last or relative_rms(estimate, widths) <= tolerance:
            lower, upper = corrected.lower, corrected.upper
            estimate = estimate + SPARSE_RANGE * tolerance * (upper - lower)
            return EstimatedRange(lower, upper, estimate, corrected.expansion)


def _interpolant(runs: Runs, grid: Grid, step: set[Index], before: Expansion | None) -> Expansion:
    """The interpolant on the grid with more indices; that before predicts the nodes that fail."""
    n_known = len(grid.row)
    grid.add(step)
    runs.at(grid.nodes[n_known:], before and before.values)
    if not n_known:
        runs.check(quasi_random_points(SPARSE_PROBES, len(runs.box))[: runs.left])
    coefficients = grid.coefficients(runs.nodes.reshape(len(runs.nodes), -1)).reshape(runs.nodes.shape)
    return Expansion(grid.alpha, coefficients, runs.box.names)


def _expected(runs: Runs, grid: Grid, expansion: Expansion) -> tuple[dict[Index, float], Array]:
    """Expected sizes of the coefficients ahead of the grid, and the estimated error (n_t, n_y).

    An error at the quasi-random points far above the estimate may come from any index ahead of the grid.
    """
    widths, coefficients = runs.rms_widths(), expansion.coefficients
    sizes = extrapolated_sizes(grid, (rms(coefficients.swapaxes(0, 1)) / widths).max(axis=1))
    estimate = TruncationError.of(grid.alpha, coefficients).least
    probes, values = runs.points[:SPARSE_PROBES], runs.checks[:SPARSE_PROBES]
    observed = np.abs(values - expansion.values(probes)).max(axis=0, initial=0.0)
    if relative_rms(observed, widths) > SURPRISE * relative_rms(estimate, widths):
        estimate = np.maximum(estimate, inflated_error(np.square(observed)))
        least = relative_rms(observed, widths) / len(sizes) ** 0.5
        sizes = {index: max(size, least) for index, size in sizes.items()}
    return sizes, estimate


def _is_stalled(errors: dict[int, float], d: int) -> bool:
    """Whether errors, by the numbers of nodes, are as large as the response and do not fall."""
    nodes, error = list(errors.items())[-1]
    before = min((e for n, e in errors.items() if n <= nodes / 2), default=np.inf)
    return nodes >= PATIENCE * d and error > 1 and error > LEAST_PROGRESS * before


def _largest(sizes: dict[Index, float], number: int) -> set[Index]:
    return set(sorted(sizes, key=lambda a: (-sizes[a], sum(a), a))[: max(number, 0)])


@dataclass(frozen=True, eq=False)
class _RangedExpansion:
    """An expansion and its range (n_t, n_y), with the places (2, n_t, n_y, d) of its minima and maxima.

    The range is that of the best values of the search. A proof would take longer than the runs, and the response may
    exceed the range of the expansion anyway.
    """

    expansion: Expansion
    lower: Array
    upper: Array
    places: Array

    @classmethod
    def of(cls, expansion: Expansion, tolerance: float) -> "_RangedExpansion":
        alpha, shape = expansion.alpha, expansion.coefficients.shape[1:]
        search = Exact(tolerance, max(FEWEST_BOXES, RANGE_WORK // len(alpha))).search
        extremes = search(alpha, expansion.coefficients.reshape(len(alpha), -1))
        lower, upper = extremes.lower + extremes.below, extremes.upper - extremes.above
        places = np.stack([extremes.at_lower, extremes.at_upper]).reshape(2, *shape, alpha.shape[1])
        return cls(expansion, lower.reshape(shape), upper.reshape(shape), places)


def _correct(
    runs: Runs,
    grid: Grid,
    base: Expansion,
    sizes: dict[Index, float],
    tolerance: float,
    estimate: Array,
    widths: Array,
    number: int,
) -> tuple[_RangedExpansion, Array]:
    """The expansion continued through check runs at some of its extremes, in two rounds, and its estimated error.

    The runs of the second round show the error of the expansion that the first round has corrected. An error at a place
    where the continuation leaves the share s(x) of the typical error suggests the error e / s(x) elsewhere.
    """
    corrected, largest = _RangedExpansion.of(base, tolerance), estimate
    continuation = Continuation.of(grid, sizes)
    typical = rms(continuation.expected_error(base.alpha, corrected.places, runs.points).ravel())

    def remaining_share(places: Array, points: Array) -> Array:
        """Share of the error typical of extremes that runs at points (C, d) leave at places (..., d)."""
        error = continuation.expected_error(base.alpha, places, points)
        ratio = np.divide(error, typical, out=np.ones_like(error), where=error < typical)
        return CONTINUED_SHARE + (1 - CONTINUED_SHARE) * ratio

    for n_round in (number // 2, number - number // 2):
        before = runs.points
        weights = remaining_share(corrected.places, before) * estimate / widths
        points, Y = runs.check(select_dispersed(corrected.places, weights, min(n_round, runs.left)))
        if not len(points):
            continue
        errors = (Y - corrected.expansion.values(points)) / remaining_share(points, before)[:, None, None]
        largest = inflated_error(np.square(errors).max(axis=0))
        base_errors = (runs.checks - base.values(runs.points)).reshape(len(runs.points), -1)
        change, further = continuation.through(base.alpha, runs.points, base_errors)
        coefficients = np.concatenate([base.coefficients.reshape(len(change), -1) + change, further])
        alpha = np.concatenate([base.alpha, continuation.alpha])
        expansion = Expansion(alpha, coefficients.reshape(len(alpha), *runs.shape), base.parameters)
        corrected = _RangedExpansion.of(expansion, tolerance)
    share = remaining_share(corrected.places, runs.points).max(axis=0)
    return corrected, share * np.maximum(largest, TRUST * estimate)
