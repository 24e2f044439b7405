"""Bounds where runs cost little: one grid for all outputs, whose interpolant is confirmed by further runs."""

from dataclasses import dataclass
from functools import cache, cached_property
from math import comb

import numpy as np

from symmb._types import Mask
from symmb.bound import adaptive
from symmb.bound.adaptive.check_points import (
    SAFETY,
    corner_design,
    evenly_spread_points,
    inflated_error,
    quasi_random_points,
    screening_corners,
    screening_points,
)
from symmb.bound.adaptive.error_estimate import TruncationError
from symmb.bound.adaptive.piece import REFINED_SHARE, higher, tensor_grid
from symmb.bound.adaptive.runs import OutputRuns, Runs, relative_errors
from symmb.bound.adaptive.small_study import JointStudy, Problem
from symmb.bound.adaptive.surrogate import EstimatedRange, Evidence
from symmb.bound.nodes import Grid, corners
from symmb.bound.polynomials import Expansion, TotalDegree, basis_values
from symmb.bound.polynomials.ranges import MOST_PARAMETERS, RANGE_ERROR, Piecewise, attained_extremes
from symmb.bound.responses import is_doubtful, is_doubtful_in_window, rms

CONVERGING = 0.75
"""Largest ratio of the errors of two grids at which a third one follows. With larger ratios, outputs that are not
smooth take more runs."""
SLOW_ERROR = 5e-2
"""Largest error from slowly decreasing coefficients, over the width of the output. Larger errors may be from kinks, for
which other studies look."""
SHARE = 4
"""Ratio of the budget to the runs of a first grid. Other studies of a small budget need the rest."""
FAR = 10.0
"""Ratio of the error to the tolerance above which degrees increase by two steps. One step halves errors at least."""


@dataclass(frozen=True)
class FirstGrid(JointStudy):
    """One grid for all outputs. A decision takes as long as some runs of a scene, so more runs save time.

    Two and three parameters have a tensor grid, whose degrees increase in the directions with large errors. More
    parameters have a grid of a total degree, which grows by the indices with the largest expected coefficients.

    Attributes
    ----------
    degrees : first degrees along two and three parameters
    most_nodes : largest number of first nodes for more parameters
    checks : number of further runs, evenly spread over the box
    operations : largest number of operations of a step's stage at which a run takes less time than a decision: 0.2 ms
        (971 operations in 462 steps)
    small_degrees : `degrees` if runs take longer than a decision. First nodes and check runs are then halved, and the
        largest number of nodes is an eighth
    rounds, largest : largest number of grids, and of nodes of a grid. With larger numbers, outputs that are not smooth
        take more runs
    resumes : whether a grid that was not good enough grows
    """

    degrees: tuple[int, ...] = (6, 4)
    most_nodes: int = 70
    checks: int = 12
    operations: int = 1000
    small_degrees: tuple[int, ...] = (4, 2)
    rounds: int = 6
    largest: int = 1000
    resumes: bool = False

    name = "first grid"

    @property
    def when(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The outputs that the study takes, in words."""
        if self.resumes:
            return "outputs are left open, as long as larger first grids reduce their errors"
        return "runs of a scene of two or more parameters cost less than decisions, and have no events"

    def accepts(self, problem: Problem) -> bool:
        runs = problem.runs
        if problem.is_patient and len(runs.box) > MOST_PARAMETERS:
            return False  # sparse grids of single outputs take fewer of the runs that a user counts
        if self.resumes:
            return runs.first is not None and runs.events is None and bool(runs.ok.all())
        return runs.has_lanes and (grid := self._first(runs)) is not None and self._fits(runs, grid)

    def ranges(self, problem: Problem) -> tuple[dict[int, EstimatedRange], Mask]:
        runs, tolerance, d = problem.runs, problem.tolerance, len(problem.runs.box)
        checks = self.checks if runs.cost_little(self.operations) else self.checks // 2
        points = evenly_spread_points(checks + runs.probes, d)
        if d > MOST_PARAMETERS:  # most of the box is near corners, where sparse grids have their largest errors
            points[1:checks:2] = quasi_random_points(checks // 2, d)
            points = np.concatenate([points, corners(d)[:16] if d < 5 else screening_corners(d)[:12]])
        grid, found, nothing = runs.first or self._first(runs), None, ({}, np.zeros(runs.shape[1], dtype=bool))
        for _ in range(self.rounds if self.resumes else 1):
            assert grid is not None
            rows = runs.at(grid.nodes) if len(runs) else runs.begin(grid.nodes, points)
            if runs.events is not None or not runs.ok.all():
                return nothing
            runs.first, before = grid, np.inf if found is None else found.open_error
            found = _Confirmed(runs, grid, runs.interpolant(grid, rows), tolerance, problem.open)
            has_open = found.open_error > 0 or d <= MOST_PARAMETERS
            if found.is_good[problem.open].all() or not has_open or found.open_error > CONVERGING * before:
                break
            if not self._fits(runs, grid := found.refined()):
                break
        if found is None or not found.is_good.any():
            return nothing
        every, is_good = found.range()
        is_good &= problem.open
        return every.columns(is_good), is_good

    def _first(self, runs: Runs) -> Grid | None:
        """The first grid; None for too many parameters, and for one, whose kinks only secants find."""
        d, is_cheap = len(runs.box), runs.cost_little(self.operations)
        if d == 1:
            return None
        if d <= MOST_PARAMETERS:
            return tensor_grid(*d * [(self.degrees if is_cheap else self.small_degrees)[d - 2]])
        most = self.most_nodes if is_cheap else self.most_nodes // 2
        degree = max(k for k in range(1, 5) if k == 1 or comb(d + k, d) <= most)
        return _total_grid(d, degree) if degree > 1 else None

    def _fits(self, runs: Runs, grid: Grid) -> bool:
        """Whether the budget suffices for a grid and its check runs."""
        n, largest = len(grid.alpha), self.largest if runs.cost_little(self.operations) else self.largest // 8
        return n <= largest and SHARE * (n + self.checks + runs.probes) <= runs.most


class _Confirmed:
    """An interpolant, and the errors that check runs show.

    Attributes
    ----------
    evidence : errors (n_t, n_y)
    open_error : sum of the relative errors above the tolerance; large errors count as 1
    is_good : mask (n_y,) of the outputs with errors within the tolerance
    """

    def __init__(self, runs: Runs, grid: Grid, expansion: Expansion, tolerance: float, is_open: Mask) -> None:
        self._runs, self._grid, self._expansion, self._tolerance = runs, grid, expansion, tolerance
        self._is_open = is_open
        self._look()

    def _look(self) -> None:
        """Compare the interpolant with all check runs."""
        runs, own = self._runs, self._expansion
        C = own.coefficients.reshape(len(own.alpha), -1)
        residuals = runs.checks.reshape(len(runs.checks), -1) - basis_values(own.alpha, runs.points) @ C
        squares = np.square(residuals, out=residuals).max(axis=0).reshape(runs.shape)
        self._squares = np.maximum(squares - np.square(runs.noise), 0.0)
        self.evidence = Evidence.of("check runs", inflated_error(self._squares))
        low, high = runs.extremes
        doubtful = [of(self.evidence.error, high - low, runs.noise) for of in (is_doubtful, is_doubtful_in_window)]
        errors = relative_errors(self.evidence.error, runs.rms_widths())
        runs.tell("first grid", self.evidence.decisive(int(np.argmax(errors))), errors)
        self.open_error = float(np.minimum(errors, 1.0)[self._is_open & (errors > self._tolerance)].sum())
        self.is_good: Mask = (errors + RANGE_ERROR <= self._tolerance) & ~np.any(doubtful, axis=(0, 1))
        if len(runs.box) <= MOST_PARAMETERS:
            self.is_good &= ~self._may_have_kinks()

    def _may_have_kinks(self) -> Mask:
        """Mask (n_y,) of the outputs whose coefficients decrease slowly at some times. Few runs are near a kink."""
        allowed = max(SLOW_ERROR, self._tolerance) * self._runs.rms_widths()
        return np.asarray((self._truncation.slow & (self._truncation.directions > allowed)).any(axis=(0, 1)))

    @cached_property
    def _truncation(self) -> TruncationError:
        own = self._expansion
        return TruncationError.of(own.alpha, own.coefficients, self._runs.noise)

    def refined(self) -> Grid:
        """The tensor grid with higher degrees in the directions of large errors. Far from the tolerance, by two steps.

        For more parameters, the grid with half as many further nodes.
        """
        widths = np.where(self.is_good | ~self._is_open, np.inf, self._runs.rms_widths())
        own = self._expansion
        if len(self._runs.box) > MOST_PARAMETERS:
            sizes = (rms(own.coefficients.swapaxes(0, 1)) / widths).max(axis=1)
            ahead = adaptive.extrapolated_sizes(self._grid, sizes)
            return self._grid.grown(adaptive.largest(ahead, len(self._grid.row) // 2))
        errors, degrees = relative_errors(self._truncation.directions, widths).max(axis=1), own.alpha.max(axis=0)
        is_far = relative_errors(self.evidence.error, widths).max() > FAR * self._tolerance
        new = higher(higher(degrees)) if is_far else higher(degrees)
        return tensor_grid(*np.where(errors >= REFINED_SHARE * errors.max(), new, degrees).tolist())

    def range(self) -> tuple[EstimatedRange, Mask]:
        """The range, and the mask of good outputs.

        Grids that are no tensor grids have no runs at corners. Kinks may change a response at one corner only.
        """
        runs, own, d = self._runs, self._expansion, len(self._runs.box)
        lower, upper, *at = attained_extremes(own.alpha, own.coefficients.reshape(len(own.alpha), -1))
        lower, upper = lower.reshape(runs.shape), upper.reshape(runs.shape)
        places = np.stack(at).reshape(2, *runs.shape, d)
        if d > MOST_PARAMETERS:
            near = np.where(places[:, :, self.is_good] < 0, -1.0, 1.0).reshape(-1, d)
            hides = any(OutputRuns(runs, k).may_hide() for k in np.flatnonzero(self.is_good).tolist())
            more = screening_points(d) if hides else np.empty((0, d))
            low, high = runs.extremes
            if (self.is_good & (high == low).all(axis=0)).any():  # an element may act in a corner only
                more = corner_design(d)
            runs.check(np.unique(np.concatenate([near, more]), axis=0)[: runs.left])
            self._look()
        name = "an interpolant on a tensor grid" if d <= MOST_PARAMETERS else "an interpolant on a sparse grid"
        evidence = self.evidence.plus("range", RANGE_ERROR * (upper - lower))

        def polynomials() -> Piecewise:
            return Piecewise.whole(own, np.maximum(evidence.error, SAFETY * np.sqrt(self._squares)))

        return EstimatedRange(lower, upper, evidence, polynomials, name, places, is_enough=True), self.is_good


@cache
def _total_grid(d: int, degree: int) -> Grid:
    """The grid of a total degree."""
    grid = Grid(d)
    grid.add(grid.missing(map(tuple, TotalDegree().indices(d, degree).tolist())))
    return grid
