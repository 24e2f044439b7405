"""Bounds where runs cost little: one grid for all outputs, whose interpolant is confirmed by further runs."""

from dataclasses import dataclass
from functools import cache
from math import comb

import numpy as np

from symmb._types import Mask
from symmb.bound.adaptive.check_points import (
    SAFETY,
    evenly_spread_points,
    inflated_error,
    quasi_random_points,
    screening_points,
)
from symmb.bound.adaptive.error_estimate import TruncationError
from symmb.bound.adaptive.evidence import Evidence
from symmb.bound.adaptive.runs import TRUST, OutputRuns, Runs, relative_errors
from symmb.bound.adaptive.small_study import JointStudy, Problem
from symmb.bound.adaptive.surrogate import EstimatedRange
from symmb.bound.nodes import Grid
from symmb.bound.polynomials import Expansion, TensorDegree, TotalDegree, basis_values
from symmb.bound.polynomials.ranges import MOST_PARAMETERS, RANGE_ERROR, Piecewise, attained_extremes
from symmb.bound.responses import is_doubtful, is_doubtful_in_window


@dataclass(frozen=True)
class FirstGrid(JointStudy):
    """One grid for all outputs. A decision takes as long as some runs of a scene, so more runs save time.

    Up to three parameters have a tensor grid, and larger ones if it is not good enough. More parameters have a
    grid of a total degree.

    Attributes
    ----------
    degrees : degrees along one, two and three parameters, in the order of the grids
    most_nodes : largest number of nodes for more parameters
    checks : number of further runs, evenly spread over the box
    """

    degrees: tuple[tuple[int, ...], ...] = ((16, 32), (6, 8, 12), (4, 6))
    most_nodes: int = 90
    checks: int = 12

    name = "first grid"
    when = "runs of a scene cost less than decisions, and have no events"

    def accepts(self, problem: Problem) -> bool:
        runs = problem.runs
        n = max((len(grid.alpha) for grid in self.grids(len(runs.box))[:1]), default=runs.most)
        return runs.has_lanes and n + self.checks + runs.probes + 2 * len(runs.box) <= runs.most

    def grids(self, d: int) -> list[Grid]:
        """The grids in the order of their size; empty for too many parameters."""
        if d <= MOST_PARAMETERS:
            return [_grid(d, degree) for degree in self.degrees[d - 1]]
        degree = max(k for k in range(1, 5) if k == 1 or comb(d + k, d) <= self.most_nodes)
        return [_grid(d, degree)] if degree > 1 else []

    def ranges(self, problem: Problem) -> tuple[dict[int, EstimatedRange], Mask]:
        runs, tolerance, nothing = problem.runs, problem.tolerance, ({}, np.zeros(problem.runs.shape[1], dtype=bool))
        d = len(runs.box)
        points = evenly_spread_points(self.checks + runs.probes, d)
        if d > MOST_PARAMETERS:  # most of the box is near corners, where sparse grids have their largest errors
            points[1 : self.checks : 2] = quasi_random_points(self.checks // 2, d)
        for grid in self.grids(d):
            if len(grid.alpha) + len(points) + 2 * d > runs.most:
                break
            rows = runs.at(grid.nodes) if len(runs) else runs.begin(grid.nodes, points)
            if runs.events is not None or not runs.ok.all():
                break
            runs.first = grid
            expansion = runs.interpolant(grid, rows)
            found = _Confirmed(runs, expansion, tolerance)
            if found.is_good.all() or (grid is self.grids(d)[-1] and found.is_good.any()):
                every, is_good = found.range()
                return every.columns(is_good), is_good
        return nothing


class _Confirmed:
    """An interpolant, and the errors that check runs show.

    Attributes
    ----------
    evidence : errors (n_t, n_y)
    is_good : mask (n_y,) of the outputs with errors within the tolerance
    """

    def __init__(self, runs: Runs, expansion: Expansion, tolerance: float) -> None:
        self._runs, self._expansion, self._tolerance = runs, expansion, tolerance
        self._truncation = TRUST * TruncationError.of(expansion.alpha, expansion.coefficients, runs.noise).least
        self._look()

    def _look(self) -> None:
        """Compare the interpolant with all check runs."""
        runs, own = self._runs, self._expansion
        C = own.coefficients.reshape(len(own.alpha), -1)
        residuals = runs.checks.reshape(len(runs.checks), -1) - basis_values(own.alpha, runs.points) @ C
        squares = np.square(residuals, out=residuals).max(axis=0).reshape(runs.shape)
        self._squares = np.maximum(squares - np.square(runs.noise), 0.0)
        self.evidence = Evidence.of("check runs", inflated_error(self._squares)).at_least("decay", self._truncation)
        low, high = runs.extremes
        doubtful = [of(self.evidence.error, high - low, runs.noise) for of in (is_doubtful, is_doubtful_in_window)]
        errors = relative_errors(self.evidence.error, runs.rms_widths())
        runs.tell("first grid", self.evidence.decisive(int(np.argmax(errors))), errors)
        self.is_good: Mask = (errors + RANGE_ERROR <= self._tolerance) & ~np.any(doubtful, axis=(0, 1))

    def range(self) -> tuple[EstimatedRange, Mask]:
        """The range, and the mask of good outputs.

        Grids that are no tensor grids have no runs at corners. Kinks may change a response at one corner only.
        """
        runs, own, d = self._runs, self._expansion, len(self._runs.box)
        lower, upper, *at = attained_extremes(own.alpha, own.coefficients.reshape(len(own.alpha), -1))
        lower, upper = lower.reshape(runs.shape), upper.reshape(runs.shape)
        places = np.stack(at).reshape(2, *runs.shape, d)
        if d > MOST_PARAMETERS:
            corners = np.where(places[:, :, self.is_good] < 0, -1.0, 1.0).reshape(-1, d)
            hides = any(OutputRuns(runs, k).may_hide() for k in np.flatnonzero(self.is_good))
            more = screening_points(d) if hides else np.empty((0, d))
            runs.check(np.unique(np.concatenate([corners, more]), axis=0)[: runs.left])
            self._look()
        name = "an interpolant on a tensor grid" if d <= MOST_PARAMETERS else "an interpolant on a sparse grid"
        evidence = self.evidence.plus("range", RANGE_ERROR * (upper - lower))

        def polynomials() -> Piecewise:
            return Piecewise.whole(own, np.maximum(evidence.error, SAFETY * np.sqrt(self._squares)))

        return EstimatedRange(lower, upper, evidence, polynomials, name, places, is_enough=True), self.is_good


@cache
def _grid(d: int, degree: int) -> Grid:
    """The grid of a degree along each of few parameters, or of a total degree of more parameters."""
    basis = TensorDegree() if d <= MOST_PARAMETERS else TotalDegree()
    grid = Grid(d)
    grid.add(grid.missing(map(tuple, basis.indices(d, degree).tolist())))
    return grid
