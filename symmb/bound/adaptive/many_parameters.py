"""Studies of single outputs, which advance together. All studies use the same runs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from symmb._types import Array, Mask
from symmb.bound.adaptive.check_points import select_dispersed
from symmb.bound.adaptive.output_problem import OutputProblem
from symmb.bound.adaptive.requests import Checks, Nodes, Noise, Places, Request, Steps
from symmb.bound.adaptive.runs import OutputRuns, Runs
from symmb.bound.adaptive.small_study import JointStudy, OutputStudy, Problem
from symmb.bound.adaptive.surrogate import EstimatedRange
from symmb.bound.responses import DOUBTFUL


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
        for k, own in ranges.items():
            decided[k] = is_last or problem.error(k, own) <= DOUBTFUL
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
        if isinstance(each, Nodes) and runs.unknown(each.points) <= runs.left:
            runs.at(each.points, predict)
            each.are_run = True
    points = [each.points for each in requests if isinstance(each, Checks)]
    if points:
        runs.check(_distinct(points)[: runs.left])
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
