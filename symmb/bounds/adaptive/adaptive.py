"""Polynomial chaos that chooses its nodes: the runs it may make, and the method for the number of parameters."""

import numpy as np

from symmb._errors import PropagationError
from symmb._types import Executor
from symmb.bounds.adaptive.runs import Runs
from symmb.bounds.adaptive.sparse import sparse_bounds
from symmb.bounds.adaptive.tensor import tensor_bounds
from symmb.bounds.result import Bounds
from symmb.model import Box
from symmb.simulation import Progress, Simulator

MOST_RUNS, MOST_NUMBERS = 5000, 40_000_000
"""Without a budget: where to stop although the tolerance is not met, since ``estimate`` tells how far off; and how many
responses are kept, 0.3 GB, as many coefficients beside them."""
TENSOR_PARAMETERS = 3
"""Up to so many parameters grids are tensors: extremes lie at corners and edges, where sparse grids are weakest."""


def adaptive_bounds(
    text: str,
    tolerance: float,
    budget: int | None,
    simulator: Simulator,
    box: Box,
    executor: Executor | None,
    progress: Progress | None,
) -> Bounds:
    """Bounds by interpolants that are refined until their estimated error is below ``tolerance`` of the width.

    The error is the root mean square over time, over that of the width, of the output where it is largest. Where it is
    more than the width that runs attained, what they attained tells more than the interpolant does.
    """
    d, tensor = len(box), len(box) <= TENSOR_PARAMETERS
    first = max(5, 3**d) if tensor else 2 * d + 1
    numbers = max(len(simulator.times) * len(simulator.outputs), 1)
    most = max(min(MOST_RUNS, MOST_NUMBERS // numbers), 2 * first) if budget is None else budget
    if first > most:
        raise PropagationError(f"{text}: the first level takes {first} runs, more than the budget of {most}.")
    runs = Runs(simulator, box, most, executor, progress)
    found = tensor_bounds(runs, tolerance) if tensor else sparse_bounds(runs, tolerance, patient=budget is not None)
    lowest, highest = runs.extremes
    lost = found.estimate > highest - lowest
    return Bounds(
        t=simulator.times,
        names=simulator.outputs,
        lower=np.where(lost, lowest, np.minimum(found.lower, lowest)),
        upper=np.where(lost, highest, np.maximum(found.upper, highest)),
        kind="estimate",
        method=text,
        evaluations=len(runs),
        estimate=found.estimate,
        inner=runs.extremes,
        failed=runs.failed,
        expansion=found.expansion,
    )
