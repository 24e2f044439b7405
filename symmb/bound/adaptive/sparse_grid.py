"""A sparse grid of one output, which grows by the largest expected coefficients, and runs near extremes after it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from symmb.bound.adaptive.check_points import PATIENCE, corner_design, evenly_spread_points, quasi_random_points
from symmb.bound.adaptive.continuation import SPARSE_PROBES, largest
from symmb.bound.adaptive.outputs import EARLY_CHECK, OutputProblem
from symmb.bound.adaptive.runs import NOISE_RUNS, relative_rms
from symmb.bound.adaptive.small_study import Attempt, Checks, Noise, OutputStudy, Request
from symmb.bound.nodes import along_axes, corners
from symmb.bound.responses import DOUBTFUL


@dataclass(frozen=True)
class SparseGrid(OutputStudy):
    """An interpolant on a grid that grows. Runs at some of its extremes check the estimated error, and correct it.

    Growth ends when the tolerance would take too many nodes, for example near kinks. Growth with corners follows.

    Attributes
    ----------
    resumes : whether the grid of an earlier study grows further
    growth : fraction by which the grid grows in a round. Smaller fractions take more searches, larger ones more runs
    few_nodes : number of nodes per parameter after which a slow decay of the error stops the growth of the grid. With
        smaller numbers, growth stops for more responses
    """

    resumes: bool = False
    growth: float = 0.25
    few_nodes: int = 7

    name = "sparse grid"

    @property
    def when(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The outputs that the study takes, in words."""
        return "the other studies leave the output open" if self.resumes else "other studies leave outputs open"

    def accepts(self, problem: OutputProblem) -> bool:
        return problem.found is None

    def steps(self, problem: OutputProblem) -> Attempt:
        runs, tolerance, d = problem.runs, problem.tolerance, len(problem.runs.box)
        if self.resumes:
            yield from self._enlarged(problem)
        else:
            yield from problem.grown(problem.grid.missing(along_axes(d, 2)))
            problem.probes = np.concatenate(
                [quasi_random_points(SPARSE_PROBES, d), evenly_spread_points(runs.probes, d)]
            )
            yield Checks(problem.probes)
            if problem.has_corners:  # a continued study
                yield Checks(corner_design(d))
        while True:
            yield from problem.looked()
            step = largest(problem.sizes, min(max(d, int(self.growth * len(problem.grid.row))), problem.left))
            problem.is_stalled = self._is_stalled(problem)
            is_last = not step or runs.clock.is_late or (problem.has_corners and problem.is_stalled)
            runs.tell(self.name, "decay", problem.error)
            if problem.error <= EARLY_CHECK * tolerance or is_last:
                found = yield from problem.corrected(problem.has_corners)
                error = relative_rms(found.estimate, runs.rms_widths())
                problem.shown = error if error > DOUBTFUL else 0.0
                runs.tell(found.surrogate, found.evidence.decisive(), error)
                if error <= tolerance:
                    return found._replace(is_enough=True)
                if is_last:
                    problem.found = found
                    return None
                needed = int(len(step) * (error / tolerance - 1))
                step = largest({a: problem.sizes[a] for a in step}, min(max(needed, 1), runs.left))
            problem.next = step
            is_for_others = (not problem.has_corners and not runs.has_lanes) or (
                problem.is_brief and (not runs.has_lanes or problem.is_stalled)
            )
            if is_for_others and not self.resumes:
                return None
            yield from self._enlarged(problem)

    def _enlarged(self, problem: OutputProblem) -> Iterator[Request]:
        """The next step: corners, the noise or more nodes."""
        runs = problem.runs
        if problem.is_stalled and not problem.has_corners:  # then the error is estimated again before the grid grows
            problem.has_corners = True
            yield Checks(corner_design(len(runs.box)))
        elif not runs.noise_is_known and NOISE_RUNS < problem.left:
            yield Noise()
        else:
            problem.errors[len(problem.grid.row)] = max(problem.error, problem.shown)
            yield from problem.grown(problem.next)

    def _is_stalled(self, problem: OutputProblem) -> bool:
        """Whether the error decreases so slowly that the tolerance would take too many nodes, as near kinks.

        If the error is larger than the width, the response is not resolved yet, and more nodes are needed to decide.
        """
        nodes, d, error = len(problem.grid.row), len(problem.runs.box), max(problem.error, problem.shown)
        few = self.few_nodes if problem.is_brief else 2 * self.few_nodes
        if nodes < (few if error < 1 else PATIENCE) * d or error <= problem.tolerance:
            return False
        before = min((former for n, former in problem.errors.items() if 2 * n <= nodes), default=np.inf)
        if not before:  # an output that was constant until now
            return True
        factor = error / before
        most = problem.runs.left + nodes if problem.is_patient else 2 * PATIENCE * d
        return factor >= 1 or np.log(problem.tolerance / error) / np.log(factor) > np.log2(most / nodes)


@dataclass(frozen=True)
class NearExtremes(OutputStudy):
    """Rounds of check runs near the extremes. They end if the error is within the tolerance, or decreases slowly.

    Even without convergence, the interpolant shows where extremes may be. If runs are computed side by side, earlier
    studies have made these runs.

    Attributes
    ----------
    gain : fraction of the error that may remain after a round. Larger fractions take more runs
    """

    gain: float = 0.9

    name = "runs near extremes"
    when = "no other study has decided the output"

    def accepts(self, problem: OutputProblem) -> bool:
        return problem.found is not None

    def steps(self, problem: OutputProblem) -> Attempt:
        found = problem.found
        assert found is not None
        if problem.runs.has_lanes:
            return found
        runs, tolerance, d = problem.runs, problem.tolerance, len(problem.runs.box)
        number = runs.left if problem.is_patient else len(runs) // 2
        spread = quasi_random_points(SPARSE_PROBES + number // 2, d)[SPARSE_PROBES:]
        yield Checks(np.concatenate([spread, np.sign(spread)]) if 2**d > number else corners(d))
        error = relative_rms(found.estimate, runs.rms_widths())
        while runs.left and not runs.clock.is_late:
            before = error
            found = yield from problem.corrected(True)
            error = relative_rms(found.estimate, runs.rms_widths())
            if error <= tolerance or error >= self.gain * before:
                break
        return (yield from problem.polled(found._replace(is_enough=error <= tolerance)))
