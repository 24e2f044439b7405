"""Bounds over many parameters: a sparse grid that grows where the response varies, and check runs that correct it."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from symmb._limits import windows
from symmb._types import Array
from symmb.bounds.adaptive.check_runs import evenly_spread_points, inflated_error, quasi_random_points, select_dispersed
from symmb.bounds.adaptive.constants import (
    CHECKED_SHARE,
    CLOSE,
    CONTINUED_SHARE,
    CORNERS_SHARE,
    EARLY,
    FEWEST_BOXES,
    GROWTH,
    LEAST_GAIN,
    LEAST_PROGRESS,
    MOST_ROUNDS,
    MOST_SEARCHES,
    NOISE_RUNS,
    PATIENCE,
    RANGE_WORK,
    SAFETY,
    SLOW,
    SPARSE_PROBES,
    SPARSE_RANGE,
    STALLED_SHARE,
    SURFACE_RESPONSES,
    SURFACE_RUNS,
    SURPRISE,
    TRUST,
)
from symmb.bounds.adaptive.continuation import Continuation, extrapolated_sizes, largest
from symmb.bounds.adaptive.error_estimate import TruncationError
from symmb.bounds.adaptive.monotone import monotone_bounds
from symmb.bounds.adaptive.response_surface import surface_bounds
from symmb.bounds.adaptive.runs import EstimatedRange, Runs, relative_rms, rms
from symmb.bounds.adaptive.screening import may_hide, screen
from symmb.nodes import Grid, Index
from symmb.nodes import grid as corners
from symmb.polynomials import Expansion, MultiIndices, basis_values
from symmb.polynomials.ranges import Exact


def sparse_bounds(runs: Runs, tolerance: float, patient: bool) -> EstimatedRange:
    """Range of an interpolant on a grid that grows by the indices with the largest expected coefficients.

    Its error is estimated from its last coefficients. Runs at some of its extremes then check the estimate and correct
    the expansion. Growth ends when it does not help, as with kinks, or, unless `patient`, too slowly. Few responses are
    left to a response surface.
    """
    d = len(runs.box)
    grid, expansion, n_checks, n_probes = Grid(d), None, 2 * d, SPARSE_PROBES + runs.probes
    errors: dict[int, float] = {}
    few = runs.shape[0] * runs.shape[1] <= SURFACE_RESPONSES
    step = grid.missing([tuple(2 * (i == j) for j in range(d)) for i in range(d)])
    while True:
        expansion = _interpolant(runs, grid, step, expansion)
        sizes, estimate = _expected(runs, grid, expansion, n_probes)
        error = relative_rms(estimate, runs.rms_widths())
        if not errors and error > (tolerance / TRUST if few else EARLY * tolerance):
            attained = monotone_bounds(runs, tolerance, partial(_continued, runs, grid, expansion, sizes))
            if attained is not None:
                return attained
        if error > tolerance / TRUST and not (few or runs.noise_is_known) and NOISE_RUNS < runs.left - n_checks:
            runs.measure_noise()
            sizes, estimate = _expected(runs, grid, expansion, n_probes)
            error = relative_rms(estimate, runs.rms_widths())
        if error <= EARLY * tolerance and n_probes == SPARSE_PROBES + runs.probes and may_hide(runs):
            screen(runs, runs.left - n_checks)
            n_probes = len(runs.points)
            sizes, estimate = _expected(runs, grid, expansion, n_probes)
        widths = runs.rms_widths()
        step = largest(sizes, min(max(d, int(GROWTH * len(grid.row))), runs.left - n_checks))
        errors[len(grid.row)] = relative_rms(estimate, widths)
        runs.tell(errors[len(grid.row)])
        is_converging = not step or errors[len(grid.row)] <= tolerance / TRUST
        if not is_converging and few:
            most = runs.most if patient else SURFACE_RUNS[0] + SURFACE_RUNS[1] * d
            return surface_bounds(runs, grid.nodes, tolerance, most)
        if _is_stalled(errors, d, patient):
            number = runs.left if patient else len(runs) // 2
            return _attained(runs, grid, expansion, sizes, tolerance, estimate, number)
        is_last = not step or runs.clock.is_late
        if not is_last and errors[len(grid.row)] > EARLY * tolerance:  # check runs may show that much less
            continue
        corrected, (lower, upper, places), estimate = _correct(
            runs, grid, expansion, sizes, tolerance, estimate, widths
        )
        error = relative_rms(estimate, runs.rms_widths())
        if is_last or error <= tolerance:
            estimate = estimate + SPARSE_RANGE * tolerance * (upper - lower)
            return EstimatedRange(lower, upper, estimate, corrected.expansion, places, error <= tolerance)
        # An empty step would repeat this round for ever.
        step = largest({a: sizes[a] for a in step}, min(max(int(len(step) * (error / tolerance - 1)), 1), runs.left))


def _interpolant(runs: Runs, grid: Grid, step: set[Index], before: Expansion | None) -> Expansion:
    """The interpolant on the grid with more indices; that before predicts the nodes that fail."""
    n_known = len(grid.row)
    grid.add(step)
    runs.at(grid.nodes[n_known:], before and before.values)
    if not n_known:
        d = len(runs.box)
        probes = quasi_random_points(SPARSE_PROBES, d), evenly_spread_points(runs.probes, d)
        runs.check(np.concatenate(probes)[: runs.left])
    coefficients = grid.coefficients(runs.nodes.reshape(len(runs.nodes), -1)).reshape(runs.nodes.shape)
    return Expansion(grid.alpha, coefficients, runs.box.names)


def _continued(runs: Runs, grid: Grid, base: Expansion, sizes: dict[Index, float]) -> Expansion | None:
    """The expansion continued through all check runs; None if it would not be close to the first ones without them."""
    continuation = Continuation.of(grid, sizes)
    probes, others = slice(SPARSE_PROBES), slice(SPARSE_PROBES, None)
    without = _Corrected(base, continuation, runs.points[others], runs.checks[others])
    errors = np.abs(without.values(runs.points[probes]) - runs.checks[probes]).max(axis=0)
    if relative_rms(errors, runs.rms_widths()) > CLOSE:
        return None
    return _Corrected(base, continuation, runs.points, runs.checks).expansion()


def _expected(runs: Runs, grid: Grid, expansion: Expansion, n_probes: int) -> tuple[dict[Index, float], Array]:
    """Expected sizes of the coefficients ahead of the grid, and the estimated error (n_t, n_y).

    An error at the first check points, so many, far above the estimate may come from any index ahead of the grid.
    """
    widths, coefficients = runs.rms_widths(), expansion.coefficients
    sizes = extrapolated_sizes(grid, (rms(coefficients.swapaxes(0, 1)) / widths).max(axis=1))
    estimate = TruncationError.of(grid.alpha, coefficients, runs.noise).least
    probes, values = runs.points[:n_probes], runs.checks[:n_probes]
    observed = np.maximum(np.abs(values - expansion.values(probes)).max(axis=0, initial=0.0) - runs.noise, 0.0)
    if relative_rms(observed, widths) > SURPRISE * relative_rms(estimate, widths):
        estimate = np.maximum(estimate, inflated_error(np.square(observed)))
        least = relative_rms(observed, widths) / len(sizes) ** 0.5
        sizes = {index: max(size, least) for index, size in sizes.items()}
    return sizes, estimate


def _is_stalled(errors: dict[int, float], d: int, patient: bool) -> bool:
    """Whether errors, by the numbers of nodes, are as large as the response and do not fall, or fall too slowly."""
    nodes, error = list(errors.items())[-1]
    before = min((e for n, e in errors.items() if n <= nodes / 2), default=np.inf)
    if nodes >= SLOW[0] * d and error > SLOW[1] and not patient:
        return True
    return nodes >= PATIENCE * d and error > 1 and error > LEAST_PROGRESS * before


def _attained(
    runs: Runs, grid: Grid, base: Expansion, sizes: dict[Index, float], tolerance: float, estimate: Array, number: int
) -> EstimatedRange:
    """What runs attain, after more of them at corners or, if these are too many, at some and at points near others.

    An interpolant that does not converge tells where extremes may be: runs there follow until they attain no more. The
    estimated error is what the last two rounds of them still attained, and a share of what those at corners did.
    """
    d, before = len(runs.box), runs.extremes
    spread = quasi_random_points(SPARSE_PROBES + number // 2, d)[SPARSE_PROBES:]
    points = np.concatenate([spread, np.sign(spread)]) if 2**d > number else corners(np.array([-1.0, 1.0]), d)
    runs.check(points[: runs.left])
    error, gains = CORNERS_SHARE * runs.beyond(*before), list[Array]()
    for _ in range(MOST_SEARCHES):
        before = runs.extremes
        _correct(runs, grid, base, sizes, tolerance, estimate, runs.rms_widths())
        gains.append(runs.beyond(*before))
        is_done = max(relative_rms(gain, runs.rms_widths()) for gain in gains[-2:]) <= tolerance and len(gains) > 1
        if is_done or not runs.left or runs.clock.is_late:
            break
    lowest, highest = runs.extremes
    error = np.maximum(error + SAFETY * np.max(gains[-2:], axis=0), STALLED_SHARE * (highest - lowest))
    error = np.minimum(_spread_over_times(error, highest - lowest), highest - lowest)
    return EstimatedRange(lowest, highest, error, None, is_enough=relative_rms(error, runs.rms_widths()) <= tolerance)


@dataclass(frozen=True, eq=False)
class _Corrected:
    """An expansion that is continued through check runs. Its coefficients are computed for windows of responses.

    Attributes
    ----------
    base : expansion on the grid
    continuation : of the base; None without check runs
    points, checks : (C, d) and (C, n_t, n_y), the check runs
    """

    base: Expansion
    continuation: Continuation | None
    points: Array
    checks: Array

    @property
    def alpha(self) -> MultiIndices:
        """(n_b, d)."""
        further = [] if self.continuation is None else [self.continuation.alpha]
        return np.concatenate([self.base.alpha, *further])

    def parts(self) -> Iterator[tuple[slice, Array]]:
        """Windows of the n_t n_y responses, and their coefficients (n_b, m)."""
        cuts = [*windows(self.base.coefficients[0].size, len(self.alpha))]
        for window in cuts:
            yield window, self._whole if len(cuts) == 1 else self._part(window)

    @cached_property
    def _whole(self) -> Array:
        return self._part(slice(None))

    def _part(self, window: slice) -> Array:
        base = self.base.coefficients.reshape(len(self.base.alpha), -1)[:, window]
        if self.continuation is None:
            return base
        checks = self.checks.reshape(len(self.points), -1)[:, window]
        errors = checks - basis_values(self.base.alpha, self.points) @ base
        change, further = self.continuation.through(self.base.alpha, self.points, errors)
        return np.concatenate([base + change, further])

    def expansion(self) -> Expansion:
        """With all coefficients."""
        if self.continuation is None:
            return self.base
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

        The range is that of the best values of the search. A proof would take longer than the runs, and the response
        may exceed the range of the expansion anyway.
        """
        alpha, shape = self.alpha, self.base.coefficients.shape[1:]
        attained = Exact(tolerance, max(FEWEST_BOXES, RANGE_WORK // len(alpha))).attained
        ranges = [attained(alpha, part) for _, part in self.parts()]
        lower = np.concatenate([extremes.lower for extremes in ranges])
        upper = np.concatenate([extremes.upper for extremes in ranges])
        places = np.stack([np.concatenate([f.at_lower for f in ranges]), np.concatenate([f.at_upper for f in ranges])])
        return lower.reshape(shape), upper.reshape(shape), places.reshape(2, *shape, -1)


def _correct(
    runs: Runs, grid: Grid, base: Expansion, sizes: dict[Index, float], tolerance: float, estimate: Array, widths: Array
) -> tuple[_Corrected, tuple[Array, Array, Array], Array]:
    """The expansion continued through check runs at some of its extremes, its range, and its error.

    The runs of a round show the error of the expansion that those before have corrected. Rounds end when it is small
    enough or does not fall. An error at a place where the continuation leaves the share s(x) of the typical
    error suggests the error e / s(x) elsewhere. What the range has beyond all runs is an error by the share that runs
    have not confirmed of what was predicted beyond former ones.
    """
    continuation, n_round = Continuation.of(grid, sizes), len(runs.box)
    corrected = _Corrected(base, continuation if len(runs.points) else None, runs.points, runs.checks)
    lower, upper, extremes = corrected.range(SPARSE_RANGE * tolerance)
    typical = rms(continuation.expected_error(base.alpha, extremes, runs.points[:SPARSE_PROBES]).ravel())

    def remaining_share(places: Array, points: Array) -> Array:
        """Share of the error typical of extremes that runs at points (C, d) leave at places (..., d)."""
        error = continuation.expected_error(base.alpha, places, points)
        ratio = np.divide(error, typical, out=np.ones_like(error), where=error < typical)
        return CONTINUED_SHARE + (1 - CONTINUED_SHARE) * ratio

    remaining, before, doubted = estimate, np.inf, np.ones(runs.shape[1])
    unconfirmed, foreseen = np.zeros((2, runs.shape[1]))
    for _ in range(MOST_ROUNDS):
        known = runs.points
        unattained = doubted * _unattained(runs, lower, upper)
        weights = np.maximum(remaining_share(extremes, known) * estimate, unattained) / widths
        extremes_before = runs.extremes
        points, Y = runs.check(select_dispersed(extremes, weights, min(n_round, runs.left)))
        if not len(points):
            break
        predicted = corrected.values(points)
        errors = Y - predicted
        beyond = np.maximum(np.maximum(extremes_before[0] - predicted, predicted - extremes_before[1]), 0.0)
        foreseen += np.square(beyond).sum(axis=(0, 1))
        unconfirmed += np.where(beyond > 0, np.square(errors), 0.0).sum(axis=(0, 1))
        doubted = np.sqrt(np.divide(unconfirmed, foreseen, out=np.ones_like(foreseen), where=foreseen > 0))
        doubted = np.minimum(doubted, 1.0)
        errors /= remaining_share(points, known)[:, None, None]
        largest = (1 + 1 / len(points)) * inflated_error(np.mean(np.square(errors), axis=0))
        corrected = _Corrected(base, continuation, runs.points, runs.checks)
        lower, upper, extremes = corrected.range(SPARSE_RANGE * tolerance)
        share = remaining_share(extremes, runs.points).max(axis=0)
        remaining = share * np.maximum(largest, CHECKED_SHARE * estimate)
        widths = runs.rms_widths()
        error = relative_rms(np.maximum(remaining, doubted * _unattained(runs, lower, upper).max(axis=0)), widths)
        is_done = error <= tolerance or error > LEAST_GAIN * before
        if (len(known) >= n_round and is_done) or runs.clock.is_late:
            break
        before = error
    unattained = doubted * _unattained(runs, lower, upper).max(axis=0)
    return corrected, (lower, upper, extremes), np.maximum(_spread_over_times(remaining, upper - lower), unattained)


def _unattained(runs: Runs, lower: Array, upper: Array) -> Array:
    """How far a range exceeds what runs attain at its minima and maxima (2, n_t, n_y), beyond noise."""
    lowest, highest = runs.extremes
    return np.maximum(np.stack([lowest - lower, upper - highest]) - runs.noise, 0.0)


def _spread_over_times(error: Array, width: Array) -> Array:
    """Errors (n_t, n_y) of which half the square is that of one share of the width (n_t, n_y) at all times.

    Few check runs tell the size of errors, but not well at which times they are small.
    """
    share = np.divide(rms(error), rms(width), out=np.zeros(width.shape[1]), where=rms(width) > 0)
    return np.sqrt((np.square(error) + np.square(share * width)) / 2)
