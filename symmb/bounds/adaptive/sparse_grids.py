"""Bounds over many parameters: a sparse grid that grows where the response varies, and check runs that correct it."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from symmb._limits import windows
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
from symmb.polynomials import Expansion, MultiIndices, basis_values
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
        corrected, (lower, upper), estimate = _correct(
            runs, grid, expansion, sizes, SPARSE_RANGE * tolerance, estimate, widths, n_checks
        )
        if is_last or relative_rms(estimate, widths) <= tolerance:
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
        search = Exact(tolerance, max(FEWEST_BOXES, RANGE_WORK // len(alpha))).search
        ranges = [search(alpha, part) for _, part in self.parts()]
        lower = np.concatenate([extremes.lower + extremes.below for extremes in ranges])
        upper = np.concatenate([extremes.upper - extremes.above for extremes in ranges])
        places = np.stack([np.concatenate([f.at_lower for f in ranges]), np.concatenate([f.at_upper for f in ranges])])
        return lower.reshape(shape), upper.reshape(shape), places.reshape(2, *shape, -1)


def _correct(
    runs: Runs,
    grid: Grid,
    base: Expansion,
    sizes: dict[Index, float],
    tolerance: float,
    estimate: Array,
    widths: Array,
    number: int,
) -> tuple[_Corrected, tuple[Array, Array], Array]:
    """The expansion continued through check runs at some of its extremes, in two rounds, its range, and its error.

    The runs of the second round show the error of the expansion that the first round has corrected. An error at a place
    where the continuation leaves the share s(x) of the typical error suggests the error e / s(x) elsewhere.
    """
    corrected, largest = _Corrected(base, None, runs.points[:0], runs.checks[:0]), estimate
    lower, upper, extremes = corrected.range(tolerance)
    continuation = Continuation.of(grid, sizes)
    typical = rms(continuation.expected_error(base.alpha, extremes, runs.points).ravel())

    def remaining_share(places: Array, points: Array) -> Array:
        """Share of the error typical of extremes that runs at points (C, d) leave at places (..., d)."""
        error = continuation.expected_error(base.alpha, places, points)
        ratio = np.divide(error, typical, out=np.ones_like(error), where=error < typical)
        return CONTINUED_SHARE + (1 - CONTINUED_SHARE) * ratio

    for n_round in (number // 2, number - number // 2):
        before = runs.points
        weights = remaining_share(extremes, before) * estimate / widths
        points, Y = runs.check(select_dispersed(extremes, weights, min(n_round, runs.left)))
        if not len(points):
            continue
        errors = (Y - corrected.values(points)) / remaining_share(points, before)[:, None, None]
        largest = inflated_error(np.square(errors).max(axis=0))
        corrected = _Corrected(base, continuation, runs.points, runs.checks)
        lower, upper, extremes = corrected.range(tolerance)
    share = remaining_share(extremes, runs.points).max(axis=0)
    return corrected, (lower, upper), share * np.maximum(largest, TRUST * estimate)
