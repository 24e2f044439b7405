"""Polynomial chaos that chooses its own runs: the number of runs, and the kind of grid."""

from dataclasses import replace

import numpy as np

from symmb._errors import PropagationError
from symmb._types import Executor, Mask
from symmb.bounds.adaptive.constants import MOST_NUMBERS, MOST_RUNS, TENSOR_PARAMETERS
from symmb.bounds.adaptive.runs import Runs
from symmb.bounds.adaptive.sparse_grids import sparse_bounds
from symmb.bounds.adaptive.tensor_grids import tensor_bounds
from symmb.bounds.result import Bounds
from symmb.model import Box
from symmb.polynomials import Expansion
from symmb.simulation import Progress, Simulator


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

    The error is the root mean square over time over that of the width, of the output where this is largest. It is at
    least the distance of the interpolant's range from what runs attained. Where it exceeds the width that runs
    attained, and of outputs that are noise, the bounds are those attained by runs.
    """
    d, tensor = len(box), len(box) <= TENSOR_PARAMETERS
    first = max(5, 3**d) if tensor else 2 * d + 1
    numbers = max(len(simulator.times) * len(simulator.outputs), 1)
    most = max(min(MOST_RUNS, MOST_NUMBERS // numbers), 2 * first) if budget is None else budget
    if first > most:
        raise PropagationError(f"{text}: the first level takes {first} runs, more than the budget of {most}.")
    runs = Runs(simulator, box, most, executor, progress)
    estimated = tensor_bounds(runs, tolerance) if tensor else sparse_bounds(runs, tolerance, patient=budget is not None)
    lowest, highest = inner = runs.extremes
    evaluations, failed, noise, is_noise = len(runs), runs.failed, runs.noise, np.isinf(runs.rms_widths())
    beyond = runs.beyond(estimated.lower, estimated.upper)
    below, above = (False, False) if estimated.places is None else runs.is_near_lost(estimated.places)
    del runs
    estimate = np.where(is_noise, noise, np.maximum(estimated.estimate, beyond))
    unresolved = is_noise | (estimate > highest - lowest)
    return Bounds(
        t=simulator.times,
        names=simulator.outputs,
        lower=np.where(unresolved | below, lowest, np.minimum(estimated.lower, lowest)),
        upper=np.where(unresolved | above, highest, np.maximum(estimated.upper, highest)),
        kind="estimate",
        method=text,
        evaluations=evaluations,
        estimate=estimate,
        noise=noise,
        inner=inner,
        failed=failed,
        expansion=estimated.expansion and _without_noise(estimated.expansion(), is_noise),
    )


def _without_noise(expansion: Expansion | None, is_noise: Mask) -> Expansion | None:
    """An expansion in which outputs that are noise (n_y,) are constant."""
    if expansion is None or not is_noise.any():
        return expansion
    coefficients = expansion.coefficients.copy()
    coefficients[np.ix_(expansion.alpha.sum(axis=1) > 0, np.ones(coefficients.shape[1], dtype=bool), is_noise)] = 0.0
    return replace(expansion, coefficients=coefficients)
