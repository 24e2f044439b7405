"""Bounds of one output over many parameters, from a sparse grid that grows, and from runs that correct it."""

from collections.abc import Generator, Iterator

import numpy as np

from symmb._types import Array
from symmb.bound.adaptive.check_points import (
    FEW_TIMES,
    PATIENCE,
    SAFETY,
    corner_design,
    evenly_spread_points,
    inflated_error,
    quasi_random_points,
    screening_points,
)
from symmb.bound.adaptive.check_rounds import CheckRounds, separable_extremes, spread_over_times
from symmb.bound.adaptive.continuation import (
    SPARSE_PROBES,
    SPARSE_RANGE,
    Continuation,
    Corrected,
    extrapolated_sizes,
    largest,
)
from symmb.bound.adaptive.error_estimate import TruncationError
from symmb.bound.adaptive.evidence import Evidence
from symmb.bound.adaptive.monotone import corner_range
from symmb.bound.adaptive.requests import Checks, Nodes, Noise, Request, Steps
from symmb.bound.adaptive.response_surface import surface_range
from symmb.bound.adaptive.runs import NOISE_RUNS, OutputRuns, relative_rms
from symmb.bound.adaptive.surrogate import EstimatedRange
from symmb.bound.nodes import Grid, Index, along_axes, corners
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.responses import rms

GROWTH = 0.25
"""Fraction by which the grid grows in one round. Smaller fractions take more searches, larger ones more runs."""
EARLY_CHECK = 5.0
"""Ratio of the estimated error to the tolerance at which check runs are made. Larger ratios take fewer nodes
and more check runs."""
FEW_NODES = 7
"""Number of nodes per parameter after which a slow decay of the error stops the growth of the grid. With smaller
numbers, growth stops for more responses."""
SEARCH_GAIN = 0.9
"""Fraction of the error that may remain after further check runs near extremes. Larger fractions take more runs."""


class OutputStudy:
    """An interpolant on a grid that grows by the indices with the largest expected coefficients.

    The error of the interpolant is estimated from its last coefficients. Runs at some extremes of the interpolant then
    check the estimate and correct the expansion. Growth ends when the tolerance would take too many nodes, for example
    near kinks. A response surface is then used for outputs with few times. For other outputs, corners and rounds of
    check runs follow. If runs of a simulator are not computed side by side, corners are tried before the grid grows.
    """

    def __init__(self, runs: OutputRuns, tolerance: float, is_patient: bool) -> None:
        self.runs, self.tolerance, self.is_patient, self.grid = runs, tolerance, is_patient, Grid(len(runs.box))
        self._errors = dict[int, float]()
        self._is_brief, self._has_corners, self._is_screened = runs.shape[0] <= FEW_TIMES, False, False

    def steps(self) -> Steps:
        """Request runs until the range is known, and return the range."""
        runs, tolerance, d = self.runs, self.tolerance, len(self.runs.box)
        yield from self._grown(self.grid.missing(along_axes(d, 2)))
        self._probes = np.concatenate([quasi_random_points(SPARSE_PROBES, d), evenly_spread_points(runs.probes, d)])
        yield Checks(self._probes)
        if self._has_corners:  # a continued study
            yield Checks(corner_design(d))
        while True:
            yield from self._screened()
            step = largest(self.sizes, min(max(d, int(GROWTH * len(self.grid.row))), self._left))
            is_stalled = self._is_stalled()
            is_last = not step or runs.clock.is_late or (self._has_corners and is_stalled)
            runs.tell("sparse grid", "decay", self._error)
            if self._error <= EARLY_CHECK * tolerance or is_last:
                found = yield from self._corrected(self._has_corners)
                error = relative_rms(found.estimate, runs.rms_widths())
                runs.tell(found.surrogate, found.evidence.decisive(), error)
                if error <= tolerance:
                    return found._replace(is_enough=True)
                if is_last:
                    return found if runs.has_lanes else (yield from self._searched(found))
                needed = int(len(step) * (error / tolerance - 1))
                step = largest({a: self.sizes[a] for a in step}, min(max(needed, 1), runs.left))
            if found := (yield from self._without_grid(is_stalled)):
                return found
            if is_stalled and not self._has_corners:  # then the error is estimated again before the grid grows
                self._has_corners = True
                yield Checks(corner_design(d))
            elif not runs.noise_is_known and NOISE_RUNS < self._left:
                yield Noise()
            else:
                self._errors[len(self.grid.row)] = self._error
                yield from self._grown(step)

    def corners_of(self, found: EstimatedRange) -> Array:
        """The corners (N, d) next to the extremes of a range, unless corners have been run."""
        d = len(self.runs.box)
        if found.places is None or self._has_corners:
            return np.empty((0, d))
        return np.unique(np.where(found.places < 0, -1.0, 1.0).reshape(-1, d), axis=0)

    def with_corners(self, found: EstimatedRange) -> EstimatedRange:
        """A range extended to the extremes of all runs. Runs beyond the estimated error increase this error."""
        beyond = self.runs.beyond(found.lower - found.estimate, found.upper + found.estimate)
        return self._extended(found, found.evidence.at_least("beyond", inflated_error(np.square(beyond))))

    def _extended(self, found: EstimatedRange, evidence: Evidence) -> EstimatedRange:
        """A range extended to the extremes of all runs, with other evidence of its error."""
        lowest, highest = self.runs.extremes
        lower, upper = np.minimum(found.lower, lowest), np.maximum(found.upper, highest)
        return found._replace(lower=lower, upper=upper, evidence=evidence)

    def continues(self, found: EstimatedRange) -> bool:
        """Whether the study continues with runs at all corners, because its error has grown above the tolerance."""
        is_large = relative_rms(found.estimate, self.runs.rms_widths()) > self.tolerance
        is_continued = found.is_enough and is_large and not self._has_corners
        self._has_corners |= is_continued
        return is_continued

    def _screened(self) -> Iterator[Request]:
        """Estimate the error of the interpolant, and verify a small error by further runs."""
        self._estimate_error()
        if self._error <= EARLY_CHECK * self.tolerance and not self._is_screened and self.runs.may_hide():
            self._is_screened, points = True, screening_points(len(self.runs.box))
            yield Checks(points)
            self._probes = np.concatenate([self._probes, points])
            self._estimate_error()

    def _without_grid(self, is_stalled: bool) -> Generator[Request, None, EstimatedRange | None]:
        """The range from runs at corners or from a response surface instead of a larger grid; None if neither applies.

        Corners are tried first if runs are not computed side by side. Response surfaces are for outputs with few times.
        """
        runs, tolerance = self.runs, self.tolerance
        if not self._has_corners and not runs.has_lanes:
            self._has_corners = True
            if found := (yield from corner_range(runs, tolerance, self._continued)):
                return found
        if not self._is_brief or (runs.has_lanes and not is_stalled):
            return None
        known = np.concatenate([self.grid.nodes, self._probes if runs.has_lanes else runs.points])
        found = yield from surface_range(runs, known, tolerance, self.is_patient)
        return (yield from self._polled(found))

    def _corrected(self, has_corners: bool) -> Steps:
        """The range after check runs at the extremes of the interpolant."""
        study = self.runs, self.expansion, self.grid, self.sizes, self.estimate, self.tolerance
        found = yield from CheckRounds(*study, has_corners).steps()
        of_range = SPARSE_RANGE * self.tolerance * (found.upper - found.lower)
        return found._replace(evidence=found.evidence.plus("range", of_range))

    def _continued(self) -> Piecewise:
        """The expansion continued through all check runs."""
        runs, continuation = self.runs, Continuation.of(self.grid, self.sizes)
        without = Corrected(self.expansion, continuation, runs.points[SPARSE_PROBES:], runs.checks[SPARSE_PROBES:])
        errors = np.abs(without.values(runs.points[:SPARSE_PROBES]) - runs.checks[:SPARSE_PROBES]).max(axis=0)
        expansion = Corrected(self.expansion, continuation, runs.points, runs.checks).expansion()
        for half in (0, 1):  # most check runs are at corners, where polynomials have the largest errors
            kept = np.arange(len(runs.points)) % 2 == half
            part = Corrected(self.expansion, continuation, runs.points[kept], runs.checks[kept])
            left_out = np.abs(part.values(runs.points[~kept]) - runs.checks[~kept])
            errors = np.maximum(errors, left_out.max(axis=0, initial=0.0))
        lowest, highest = runs.extremes
        return Piecewise.whole(expansion, spread_over_times(SAFETY * errors, highest - lowest))

    @property
    def _left(self) -> int:
        """Number of runs left for nodes."""
        return self.runs.left - 2 * len(self.runs.box)

    def _grown(self, step: set[Index]) -> Iterator[Request]:
        """The interpolant on the larger grid; the same interpolant if too few runs are left."""
        n_known, grid = len(self.grid.row), self.grid.grown(step)
        request = Nodes(grid.nodes[n_known:])
        yield request
        if request.are_run:
            self.grid, self.expansion = grid, self.runs.interpolant(grid)

    def _estimate_error(self) -> None:
        """Set the expected sizes of the next coefficients of the grid, and the estimated error (n_t, n_y).

        If the error at the first check points is far above the estimate, all next indices may be the cause.
        """
        runs, expansion, widths = self.runs, self.expansion, self.runs.rms_widths()
        sizes = extrapolated_sizes(self.grid, (rms(expansion.coefficients.swapaxes(0, 1)) / widths).max(axis=1))
        estimate = TruncationError.of(self.grid.alpha, expansion.coefficients, runs.noise).least
        probes, values = runs.known(self._probes)
        observed = np.maximum(np.abs(values - expansion.values(probes)).max(axis=0, initial=0.0) - runs.noise, 0.0)
        if relative_rms(observed, widths) > SAFETY * relative_rms(estimate, widths):
            estimate = np.maximum(estimate, inflated_error(np.square(observed)))
            least = relative_rms(observed, widths) / len(sizes) ** 0.5
            sizes = {index: max(size, least) for index, size in sizes.items()}
        self.sizes, self.estimate, self._error = sizes, estimate, relative_rms(estimate, widths)

    def _is_stalled(self) -> bool:
        """Whether the error decreases so slowly that the tolerance would take too many nodes, as near kinks.

        If the error is larger than the width, the response is not resolved yet, and more nodes are needed to decide.
        """
        nodes, d = len(self.grid.row), len(self.runs.box)
        few = FEW_NODES if self._is_brief else 2 * FEW_NODES
        if nodes < (few if self._error < 1 else PATIENCE) * d or self._error <= self.tolerance:
            return False
        factor = self._error / min((error for n, error in self._errors.items() if 2 * n <= nodes), default=np.inf)
        most = self.runs.left + nodes if self.is_patient else 2 * PATIENCE * d
        return factor >= 1 or np.log(self.tolerance / self._error) / np.log(factor) > np.log2(most / nodes)

    def _searched(self, found: EstimatedRange) -> Steps:
        """The range of the outputs after rounds of check runs near the extremes. The rounds end if the error is within
        the tolerance, or if one round decreases the error by less than 10 %.

        Even without convergence, the interpolant shows where extremes may be.
        """
        runs, tolerance, d = self.runs, self.tolerance, len(self.runs.box)
        number = runs.left if self.is_patient else len(runs) // 2
        spread = quasi_random_points(SPARSE_PROBES + number // 2, d)[SPARSE_PROBES:]
        yield Checks(np.concatenate([spread, np.sign(spread)]) if 2**d > number else corners(d))
        error = relative_rms(found.estimate, runs.rms_widths())
        while runs.left and not runs.clock.is_late:
            before = error
            found = yield from self._corrected(True)
            error = relative_rms(found.estimate, runs.rms_widths())
            if error <= tolerance or error >= SEARCH_GAIN * before:
                break
        return (yield from self._polled(found._replace(is_enough=error <= tolerance)))

    def _polled(self, found: EstimatedRange) -> Steps:
        """The range, widened by rounds of runs at the extremes of separable quadratics. The rounds end if the range
        widens little. The error is never smaller than the last increase of the range."""
        runs, evidence, size = self.runs, found.evidence, np.inf
        while runs.left and not runs.clock.is_late and size > self.tolerance / 2:
            yield Checks(separable_extremes(*runs.attained()))
            gained = runs.beyond(found.lower, found.upper)
            size = relative_rms(gained, runs.rms_widths())
            found = self._extended(found, evidence.at_least("gains", SAFETY * gained))
        error = relative_rms(found.estimate, runs.rms_widths())
        return found._replace(is_enough=found.is_enough and error <= self.tolerance)
