"""Single outputs: what their small studies share, and how these studies advance together with the same runs."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from symmb._types import Array, Mask
from symmb.bound.adaptive.check_points import FEW_TIMES, SAFETY, inflated_error, screening_points, select_dispersed
from symmb.bound.adaptive.check_rounds import CheckRounds, Gain, is_among, separable_extremes, spread_over_times
from symmb.bound.adaptive.continuation import SPARSE_PROBES, SPARSE_RANGE, Continuation, Corrected, extrapolated_sizes
from symmb.bound.adaptive.error_estimate import TruncationError
from symmb.bound.adaptive.runs import OutputRuns, Runs, relative_rms
from symmb.bound.adaptive.small_study import (
    Checks,
    JointStudy,
    Nodes,
    Noise,
    OutputStudy,
    Places,
    Problem,
    Request,
    Steps,
)
from symmb.bound.adaptive.surrogate import EstimatedRange, Evidence
from symmb.bound.nodes import Grid, Index
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.responses import DOUBTFUL, rms

EXCESS, USUAL = (10.0, 3.0), 1e-2
"""Largest ratio of the error to the tolerance at which tensor grids do not follow, for tolerances from 1e-2 on and for
smaller ones, which only users ask for. With 10 for all, Ishigami's function with 1e-3 ends at 4e-3 after 112 runs."""
EARLY_CHECK = 5.0
"""Ratio of the estimated error to the tolerance at which check runs are made. Larger ratios take fewer nodes
and more check runs."""


class OutputProblem:
    """One output, its interpolant on a sparse grid, and the estimated error of the interpolant.

    Attributes
    ----------
    runs : runs of the output
    tolerance : largest accepted error of the output, divided by its width
    is_patient : whether runs continue until the budget is used up
    grid, expansion : the sparse grid and its interpolant
    sizes : expected sizes of the next coefficients of the grid
    estimate, error : (n_t, 1) estimated error of the interpolant, and its root mean square over the width
    shown : error that the last check runs have shown, over the width, if it is uncertain; 0 otherwise
    errors : errors of smaller grids, by their number of nodes
    is_brief : whether the output has few times
    has_corners : whether corners have been run
    is_stalled : whether the error decreases so slowly that the tolerance would take too many nodes
    next : indices that the grid gets next
    found : the last range, with an error above the tolerance; None if there is none
    """

    def __init__(self, runs: OutputRuns, tolerance: float, is_patient: bool) -> None:
        self.runs, self.tolerance, self.is_patient, self.grid = runs, tolerance, is_patient, Grid(len(runs.box))
        self.errors, self.next, self.probes = dict[int, float](), set[Index](), np.empty((0, len(runs.box)))
        self.is_brief, self.has_corners, self.is_stalled = runs.shape[0] <= FEW_TIMES, False, False
        self._is_screened, self._gain, self.shown = False, Gain(), 0.0
        self._checked: tuple[int, Evidence | None] = 0, None
        self.found: EstimatedRange | None = None

    def corners_of(self, found: EstimatedRange) -> Array:
        """The corners (N, d) next to the extremes of a range, unless corners have been run."""
        d = len(self.runs.box)
        if found.places is None or self.has_corners:
            return np.empty((0, d))
        return np.unique(np.where(found.places < 0, -1.0, 1.0).reshape(-1, d), axis=0)

    def with_corners(self, found: EstimatedRange) -> EstimatedRange:
        """A range extended to the extremes of all runs. Runs beyond the estimated error increase this error."""
        beyond = self.runs.beyond(found.lower - found.estimate, found.upper + found.estimate)
        return self.extended(found, found.evidence.at_least("beyond", inflated_error(np.square(beyond))))

    def extended(self, found: EstimatedRange, evidence: Evidence) -> EstimatedRange:
        """A range extended to the extremes of all runs, with other evidence of its error."""
        lowest, highest = self.runs.extremes
        lower, upper = np.minimum(found.lower, lowest), np.maximum(found.upper, highest)
        return found._replace(lower=lower, upper=upper, evidence=evidence)

    def continues(self, found: EstimatedRange) -> bool:
        """Whether the study continues with runs at all corners, because its error has grown above the tolerance."""
        is_large = relative_rms(found.estimate, self.runs.rms_widths()) > self.tolerance
        is_continued = found.is_enough and is_large and not self.has_corners
        if is_continued:
            self.has_corners, self.found = True, None
        return is_continued

    def looked(self) -> Iterator[Request]:
        """Estimate the error of the interpolant, and verify a small error by further runs."""
        self._estimate_error()
        if self.error <= EARLY_CHECK * self.tolerance and not self._is_screened and self.runs.may_hide():
            self._is_screened, points = True, screening_points(len(self.runs.box))
            yield Checks(points)
            self.probes = np.concatenate([self.probes, points])
            self._estimate_error()

    def corrected(self, has_corners: bool) -> Steps:
        """The range after check runs at the extremes of the interpolant."""
        study = self.runs, self.expansion, self.grid, self.sizes, self.estimate, self.tolerance
        found = yield from CheckRounds(*study, has_corners, self._gain).steps()
        number, former = self._checked
        if number == len(self.runs) and former is not None:  # without further runs, errors stay as large as they were
            found = found._replace(evidence=found.evidence.at_least("check runs", former.error))
        self._checked = len(self.runs), found.evidence
        of_range = SPARSE_RANGE * self.tolerance * (found.upper - found.lower)
        return found._replace(evidence=found.evidence.plus("range", of_range))

    def continued(self) -> Piecewise:
        """The expansion continued through all check runs."""
        runs, continuation = self.runs, Continuation.of(self.grid, self.sizes)
        without = Corrected.of(self.expansion, continuation, runs.points[SPARSE_PROBES:], runs.checks[SPARSE_PROBES:])
        errors = np.abs(without.values(runs.points[:SPARSE_PROBES]) - runs.checks[:SPARSE_PROBES]).max(axis=0)
        expansion = Corrected.of(self.expansion, continuation, runs.points, runs.checks).expansion()
        for half in (0, 1):  # most check runs are at corners, where polynomials have the largest errors
            kept = np.arange(len(runs.points)) % 2 == half
            part = Corrected.of(self.expansion, continuation, runs.points[kept], runs.checks[kept])
            left_out = np.abs(part.values(runs.points[~kept]) - runs.checks[~kept])
            errors = np.maximum(errors, left_out.max(axis=0, initial=0.0))
        lowest, highest = runs.extremes
        return Piecewise.whole(expansion, spread_over_times(SAFETY * errors, highest - lowest))

    def deviation(self, points: Array) -> float:
        """The largest deviation of runs at points (C, d) from the expansion continued through the other check runs."""
        runs, is_new = self.runs, is_among(self.runs.points, points)
        others = runs.points[~is_new], runs.checks[~is_new]
        values = Corrected.of(self.expansion, Continuation.of(self.grid, self.sizes), *others).values(
            runs.points[is_new]
        )
        errors = np.maximum(np.abs(values - runs.checks[is_new]) - runs.noise, 0.0)
        return max((relative_rms(each, runs.rms_widths()) for each in errors), default=0.0)

    @property
    def left(self) -> int:
        """Number of runs left for nodes."""
        return self.runs.left - 2 * len(self.runs.box)

    def grown(self, step: set[Index]) -> Iterator[Request]:
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
        probes, values = runs.known(self.probes)
        observed = np.maximum(np.abs(values - expansion.values(probes)).max(axis=0, initial=0.0) - runs.noise, 0.0)
        if relative_rms(observed, widths) > SAFETY * relative_rms(estimate, widths):
            estimate = np.maximum(estimate, inflated_error(np.square(observed)))
            least = relative_rms(observed, widths) / len(sizes) ** 0.5
            sizes = {index: max(size, least) for index, size in sizes.items()}
        self.sizes, self.estimate, self.error = sizes, estimate, relative_rms(estimate, widths)

    def polled(self, found: EstimatedRange) -> Steps:
        """The range, widened by rounds of runs at the extremes of separable quadratics. The rounds end if the range
        widens little. The error is never smaller than the last increase of the range."""
        runs, evidence, size = self.runs, found.evidence, np.inf
        while runs.left and not runs.clock.is_late and size > self.tolerance / 2:
            yield Checks(separable_extremes(*runs.attained()))
            gained = runs.beyond(found.lower, found.upper)
            size = relative_rms(gained, runs.rms_widths())
            found = self.extended(found, evidence.at_least("gains", SAFETY * gained))
        error = relative_rms(found.estimate, runs.rms_widths())
        return found._replace(is_enough=found.is_enough and error <= self.tolerance)


@dataclass(frozen=True)
class PerOutput(JointStudy):
    """A row of small studies for each output that is not decided. Each round makes the runs of all outputs.

    A kink may change the response at a few corners only. If runs cost little, the corners next to all extremes are run
    at the end. Outputs with larger errors at these corners continue with runs at all corners.

    Attributes
    ----------
    studies : in the order in which they are tried
    """

    studies: tuple[OutputStudy, ...]

    name = "each output"
    when = "outputs are not decided"

    def accepts(self, problem: Problem) -> bool:
        return True

    def ranges(self, problem: Problem) -> tuple[dict[int, EstimatedRange], Mask]:
        runs, is_last = problem.runs, problem.refinement is None
        columns = np.flatnonzero(problem.open).tolist()
        patient = problem.is_patient and is_last
        outputs = [OutputProblem(OutputRuns(runs, k), problem.tolerance, patient) for k in columns]
        found = self._found(runs, outputs, outputs)
        if runs.has_lanes and not runs.clock.is_late:
            runs.check(_distinct([output.corners_of(own) for output, own in found.items()])[: runs.left])
            found = {output: output.with_corners(own) for output, own in found.items()}
            found |= self._found(runs, outputs, [output for output in outputs if output.continues(found[output])])
        ranges = {output.runs.column: own for output, own in found.items()}
        decided = np.zeros(runs.shape[1], dtype=bool)
        for k, own in ranges.items():  # with smaller errors than these, tensor grids take too many runs
            excess = EXCESS[problem.tolerance < USUAL]
            decided[k] = is_last or problem.error(k, own) <= min(DOUBTFUL, excess * problem.tolerance)
        return ranges, decided

    def _steps(self, output: OutputProblem) -> Steps:
        """Request runs until the range of an output is known, and return the range."""
        for study in self.studies:
            if study.accepts(output) and (found := (yield from study.steps(output))):
                return found
        raise AssertionError("the last study decides each output")

    def _found(
        self, runs: Runs, outputs: list[OutputProblem], some: list[OutputProblem]
    ) -> dict[OutputProblem, EstimatedRange]:
        """The ranges of `some` of all outputs. Their studies advance together and use the same runs."""
        steps, found = {output: self._steps(output) for output in some}, dict[OutputProblem, EstimatedRange]()

        def predict(points: Array) -> Array:
            values = np.zeros((len(points), *runs.shape))
            for output in outputs:
                values[..., output.runs.column : output.runs.column + 1] = output.expansion.values(points)
            return values

        known = None if some is outputs else predict  # at first, no interpolant can predict values
        while True:
            requests = list[Request]()
            for output, own in list(steps.items()):
                try:
                    requests.append(next(own))
                except StopIteration as end:
                    found[output] = end.value
                    del steps[output]
            if not requests:
                return found
            _answer(runs, requests, known)
            known = predict


def _answer(runs: Runs, requests: list[Request], predict: Callable[[Array], Array] | None) -> None:
    """Make all requested runs together. Failed nodes get the predicted values (N, n_t, n_y)."""
    if any(isinstance(each, Noise) for each in requests) and not runs.noise_is_known:
        runs.measure_noise()
    for each in requests:
        if isinstance(each, Nodes) and runs.suffice(runs.unknown(each.points)):
            runs.at(each.points, predict)
            each.are_run = True
    points = [each.points for each in requests if isinstance(each, Checks)]
    if points:
        checks = _distinct(points)
        runs.suffice(len(checks))
        runs.check(checks[: runs.left])
    chosen = np.empty((0, len(runs.box)))
    for each in sorted((each for each in requests if isinstance(each, Places)), key=lambda each: -each.weights.max()):
        own = select_dispersed(each.places, each.weights, len(runs.box), chosen)
        chosen = np.concatenate([chosen, own])
    if len(chosen):
        runs.check(_distinct([chosen])[: runs.left])


def _distinct(points: Sequence[Array]) -> Array:
    """Points (N, d) without repetitions, in the given order."""
    every = np.concatenate(points)
    _, first = np.unique(every.round(12), axis=0, return_index=True)
    return every[np.sort(first)]
