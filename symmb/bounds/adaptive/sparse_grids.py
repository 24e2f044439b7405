"""Bounds over many parameters: a sparse grid that grows where the response varies, and check runs that correct it."""

import numpy as np

from symmb._types import Array
from symmb.bounds.adaptive.check_runs import (
    PATIENCE,
    SAFETY,
    evenly_spread_points,
    inflated_error,
    quasi_random_points,
    screening_points,
)
from symmb.bounds.adaptive.continuation import (
    SPARSE_PROBES,
    SPARSE_RANGE,
    Continuation,
    Corrected,
    corrected_bounds,
    extrapolated_sizes,
    largest,
    spread_over_times,
)
from symmb.bounds.adaptive.error_estimate import TruncationError
from symmb.bounds.adaptive.monotone import corner_range
from symmb.bounds.adaptive.response_surface import ResponseSurface
from symmb.bounds.adaptive.runs import NOISE_RUNS, UNKNOWN_SHARE, Runs, relative_rms, rms
from symmb.bounds.adaptive.surrogate import EstimatedRange, Surrogate
from symmb.bounds.time_windows import DOUBTFUL
from symmb.nodes import Grid, Index, corners
from symmb.polynomials.ranges import Piecewise

SURFACE_RESPONSES = 8
"""Most outputs times times that are left to a response surface: each extreme of each takes a search."""
GROWTH = 0.25
"""Share by which the grid grows at a time: less takes more searches, more takes more runs."""
EARLY = 5.0
"""Estimated error over the tolerance at which check runs may show that it is enough: more takes fewer nodes, and more
check runs for nothing."""
SLOW, SLOW_ERROR = 60, 0.25
"""Nodes for each parameter at which an error above this share of the width takes more runs than it is worth:
less gives up responses that would converge."""


class SparseGrids:
    """An interpolant on a grid that grows by the indices with the largest expected coefficients.

    Its error is estimated from its last coefficients. Runs at some of its extremes then check the estimate and correct
    the expansion. Corners are tried before it grows. Few responses are left to a response surface, and growth ends when
    it does not help, as with kinks, or, unless the study is patient, too slowly.
    """

    def __init__(self, runs: Runs, tolerance: float, is_patient: bool) -> None:
        d = len(runs.box)
        self.runs, self.tolerance, self.is_patient, self.grid = runs, tolerance, is_patient, Grid(d)
        self._grow(self.grid.missing([tuple(2 * (i == j) for j in range(d)) for i in range(d)]))
        runs.check(
            np.concatenate([quasi_random_points(SPARSE_PROBES, d), evenly_spread_points(runs.probes, d)])[: runs.left]
        )
        self._n_probes, self._needs_corners = SPARSE_PROBES + runs.probes, True
        self._errors = dict[int, float]()

    def bounded(self) -> EstimatedRange | None:
        """The range of the interpolant, or, if it is not accurate enough at first, of corners."""
        found = self._interpolated()
        if found is None and self._needs_corners:
            self._needs_corners = False
            return corner_range(self.runs, self.tolerance, self._continued)
        return found

    def _interpolated(self) -> EstimatedRange | None:
        """The range with check runs, where the estimate is small enough for them or the grid cannot grow."""
        runs, tolerance = self.runs, self.tolerance
        self._estimate_error()
        if self._error <= EARLY * tolerance and self._n_probes == SPARSE_PROBES + runs.probes and runs.may_hide():
            runs.check(screening_points(len(runs.box))[: max(self._left, 0)])
            self._n_probes = len(runs.points)
            self._estimate_error()
        self._step = largest(self.sizes, min(max(len(runs.box), int(GROWTH * len(self.grid.row))), self._left))
        runs.tell(self._error)
        is_last = not self._step or runs.clock.is_late
        if self._error > EARLY * tolerance and not is_last:
            return None
        found = corrected_bounds(runs, self.grid, self.expansion, self.sizes, tolerance, self.estimate)
        error = relative_rms(found.estimate, runs.rms_widths())
        if not is_last and error > tolerance:
            needed = int(len(self._step) * (error / tolerance - 1))
            self._step = largest({a: self.sizes[a] for a in self._step}, min(max(needed, 1), runs.left))
            return None
        estimate = found.estimate + SPARSE_RANGE * tolerance * (found.upper - found.lower)
        return found._replace(estimate=estimate, is_enough=error <= tolerance)

    def refined(self) -> Surrogate:
        """With a larger grid, or what serves better."""
        runs = self.runs
        if runs.shape[0] * runs.shape[1] <= SURFACE_RESPONSES:
            return ResponseSurface(runs, self.grid.nodes, self.tolerance, self.is_patient)
        if self._is_stalled():
            return ExtremeSearch(self)
        if not runs.noise_is_known and NOISE_RUNS < self._left:
            runs.measure_noise()
        else:
            self._errors[len(self.grid.row)] = self._error
            self._grow(self._step)
        return self

    def _continued(self) -> Piecewise | None:
        """The expansion continued through all check runs; None if it would not be close to the first without them."""
        runs, continuation = self.runs, Continuation.of(self.grid, self.sizes)
        without = Corrected(self.expansion, continuation, runs.points[SPARSE_PROBES:], runs.checks[SPARSE_PROBES:])
        errors = np.abs(without.values(runs.points[:SPARSE_PROBES]) - runs.checks[:SPARSE_PROBES]).max(axis=0)
        if relative_rms(errors, runs.rms_widths()) > DOUBTFUL:
            return None
        expansion = Corrected(self.expansion, continuation, runs.points, runs.checks).expansion()
        for half in (0, 1):  # most check runs are at corners, where polynomials err most
            kept = np.arange(len(runs.points)) % 2 == half
            part = Corrected(self.expansion, continuation, runs.points[kept], runs.checks[kept])
            left_out = np.abs(part.values(runs.points[~kept]) - runs.checks[~kept])
            errors = np.maximum(errors, left_out.max(axis=0, initial=0.0))
        lowest, highest = runs.extremes
        return Piecewise.whole(expansion, spread_over_times(SAFETY * errors, highest - lowest))

    @property
    def _left(self) -> int:
        """Runs that are left for nodes."""
        return self.runs.left - 2 * len(self.runs.box)

    def _grow(self, step: set[Index]) -> None:
        """The interpolant on the grid with more indices; that before predicts the nodes that fail."""
        n_known = len(self.grid.row)
        self.grid.add(step)
        rows = self.runs.at(self.grid.nodes[n_known:], self.expansion.values if n_known else None)
        self.expansion = self.runs.interpolant(self.grid, np.arange(n_known + len(rows)))

    def _estimate_error(self) -> None:
        """Expected sizes of the coefficients ahead of the grid, and the estimated error (n_t, n_y).

        An error at the first check points far above the estimate may come from any index ahead of the grid.
        """
        runs, expansion, widths = self.runs, self.expansion, self.runs.rms_widths()
        sizes = extrapolated_sizes(self.grid, (rms(expansion.coefficients.swapaxes(0, 1)) / widths).max(axis=1))
        estimate = TruncationError.of(self.grid.alpha, expansion.coefficients, runs.noise).least
        probes, values = runs.points[: self._n_probes], runs.checks[: self._n_probes]
        observed = np.maximum(np.abs(values - expansion.values(probes)).max(axis=0, initial=0.0) - runs.noise, 0.0)
        if relative_rms(observed, widths) > SAFETY * relative_rms(estimate, widths):
            estimate = np.maximum(estimate, inflated_error(np.square(observed)))
            least = relative_rms(observed, widths) / len(sizes) ** 0.5
            sizes = {index: max(size, least) for index, size in sizes.items()}
        self.sizes, self.estimate, self._error = sizes, estimate, relative_rms(estimate, widths)

    def _is_stalled(self) -> bool:
        """Whether the error is as large as the response and does not fall, or falls too slowly."""
        nodes, d = len(self.grid.row), len(self.runs.box)
        if nodes >= SLOW * d and self._error > SLOW_ERROR and not self.is_patient:
            return True
        before = min((e for n, e in self._errors.items() if n <= nodes / 2), default=np.inf)
        return nodes >= PATIENCE * d and self._error >= max(1.0, before)


class ExtremeSearch:
    """What runs attain, after more of them at corners or, if these are too many, at some and at points near others.

    An interpolant that does not converge tells where extremes may be: runs there follow until they attain no more. The
    estimated error is what the last two rounds of them still attained.
    """

    def __init__(self, base: SparseGrids) -> None:
        self._base, runs, d = base, base.runs, len(base.runs.box)
        number = runs.left if base.is_patient else len(runs) // 2
        spread = quasi_random_points(SPARSE_PROBES + number // 2, d)[SPARSE_PROBES:]
        points = np.concatenate([spread, np.sign(spread)]) if 2**d > number else corners(d)
        runs.check(points[: runs.left])
        self._gains = list[Array]()

    def bounded(self) -> EstimatedRange | None:
        """The range that runs attain, unless a search may attain more."""
        runs, tolerance = self._base.runs, self._base.tolerance
        gain = max((relative_rms(gain, runs.rms_widths()) for gain in self._gains[-2:]), default=np.inf)
        is_done = gain <= tolerance and len(self._gains) > 1
        if not (is_done or not runs.left or runs.clock.is_late):
            return None
        lowest, highest = runs.extremes
        error = UNKNOWN_SHARE * (highest - lowest)
        error = np.maximum(SAFETY * np.max([0 * error, *self._gains[-2:]], axis=0), error)
        error = np.minimum(spread_over_times(error, highest - lowest), highest - lowest)
        is_enough = relative_rms(error, runs.rms_widths()) <= tolerance
        return EstimatedRange(lowest, highest, error, None, "runs near extremes", is_enough=is_enough)

    def refined(self) -> "ExtremeSearch":
        """After one more search."""
        base, before = self._base, self._base.runs.extremes
        corrected_bounds(base.runs, base.grid, base.expansion, base.sizes, base.tolerance, base.estimate)
        self._gains.append(base.runs.beyond(*before))
        return self
