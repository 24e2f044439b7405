"""A search near the extremes of one output whose error remains large."""

from dataclasses import dataclass

import numpy as np

from symmb.bound.adaptive.check_points import quasi_random_points
from symmb.bound.adaptive.continuation import SPARSE_PROBES
from symmb.bound.adaptive.output_problem import OutputProblem
from symmb.bound.adaptive.requests import Attempt, Checks
from symmb.bound.adaptive.runs import relative_rms
from symmb.bound.adaptive.small_study import OutputStudy
from symmb.bound.nodes import corners


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
