"""Polynomial chaos that chooses its own runs: the number of runs, and the kind of grid."""

from dataclasses import replace

import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array, Executor, Indices, Mask
from symmb.bounds.adaptive.constants import MOST_NUMBERS, MOST_RUNS, TENSOR_PARAMETERS, UNKNOWN_SHARE
from symmb.bounds.adaptive.runs import EstimatedRange, Runs, rms
from symmb.bounds.adaptive.sparse_grids import sparse_bounds
from symmb.bounds.adaptive.tensor_grids import tensor_bounds
from symmb.bounds.failed_region import failed_region
from symmb.bounds.result import Bounds
from symmb.model import Box
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
    is_noise, power = np.isinf(runs.rms_widths()), runs.power
    lower, upper, estimate = _attained_or_estimated(runs, estimated, is_noise)
    remarks = _remarks(runs, estimate, tolerance, estimated.is_enough)
    lower, upper, estimate = (_scaled(each, power) for each in (lower, upper, estimate))
    bounds = Bounds(
        t=simulator.times,
        names=simulator.outputs,
        lower=lower,
        upper=upper,
        kind="estimate",
        method=text,
        evaluations=len(runs),
        estimate=estimate,
        noise=_scaled(runs.floor, power),
        inner=(_scaled(runs.extremes[0], power), _scaled(runs.extremes[1], power)),
        failed=runs.failed,
        failed_region=failed_region(box, runs.tried, ~runs.ok),
        remarks=remarks,
    )
    del runs  # the expansion is as large
    expansion = estimated.expansion and estimated.expansion()
    if expansion is None:
        return bounds
    expansion = expansion.without(box.lower == box.upper, is_noise)
    return replace(bounds, expansion=replace(expansion, coefficients=_scaled(expansion.coefficients, power)))


def _attained_or_estimated(runs: Runs, estimated: EstimatedRange, is_noise: Mask) -> tuple[Array, Array, Array]:
    """Bounds and their estimated error, each (n_t, n_y): those that runs attained where an estimate says no more."""
    lowest, highest = runs.extremes
    estimate = np.maximum(estimated.estimate, runs.beyond(estimated.lower, estimated.upper))
    below = above = False
    if estimated.places is not None:
        below, above = near_lost = runs.is_near_lost(estimated.places)
        predicted = np.stack([lowest - estimated.lower, estimated.upper - highest])
        unknown = estimate + np.maximum(predicted, UNKNOWN_SHARE * (highest - lowest))
        estimate = np.where(near_lost, unknown, estimate).max(axis=0)
    floor = np.where(highest > lowest, np.where(is_noise, runs.floor, runs.noise), 0.0)
    estimate = np.maximum(np.where(is_noise, 0.0, estimate), floor)
    unresolved = is_noise | (estimate > highest - lowest)
    lower = np.where(unresolved | below, lowest, np.minimum(estimated.lower, lowest))
    upper = np.where(unresolved | above, highest, np.maximum(estimated.upper, highest))
    return lower, upper, estimate


def _remarks(runs: Runs, estimate: Array, tolerance: float, is_enough: bool) -> tuple[str, ...]:
    """Whether the tolerance was reached, in a sentence if not: runs are too few, or noise and rounding too large."""
    widths = runs.rms_widths()
    if is_enough and (runs.noise <= tolerance * widths).all():
        return ()
    error = float(np.max(rms(estimate) / widths, initial=0.0))
    return (f"The tolerance {tolerance:g} was not reached: the estimated error is {error:.0e} of the width.",)


def _scaled(values: Array, power: Indices) -> Array:
    """Values (..., n_y) times 2^power. They overflow where bounds are beyond the largest number."""
    with np.errstate(over="ignore"):
        return np.ldexp(values, power) if power.any() else values
