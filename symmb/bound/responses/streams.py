"""Reductions of trajectories. Bounding methods compute reductions block by block."""

import operator
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array, Executor, Indices, Mask
from symmb.bound.responses.failures import Failure, failed_region, failure_text
from symmb.connect import Reduction, Samples, Simulator
from symmb.equations.model import Box

FailedRuns = tuple[tuple[int, float, str], ...]
"""The sample number, time and message of each failed run."""
MOST_NUMBERS = 2**25
"""Largest number of values of check runs, and of coefficients that a method stores for check runs: 256 MB."""


class Extremes(NamedTuple):
    """Smallest and largest values (n_t, n_y) of the runs that did not fail; inf and -inf if all failed.

    `at` (2, n_t, n_y) are the numbers of the samples that attain them; None if they are not known.
    """

    lower: Array
    upper: Array
    at: Indices | None


def extremes(simulator: Simulator) -> Reduction[Extremes]:
    """The extremes of the runs."""
    shape = len(simulator.times), len(simulator.outputs)
    none = partial(_no_extremes, shape)
    return Reduction(none, _update_extremes, _merge_extremes, trajectories=False, attained=_itself)


def failures() -> Reduction[FailedRuns]:
    """The failed runs."""
    return Reduction(tuple, _update_failures, operator.add, trajectories=False)


def projection(functionals: Array, simulator: Simulator) -> Reduction[Array]:
    """``functionals @ Y``, (n_b, N) times (N, n_t n_y), over successful runs. Y is not stored as a whole."""
    size = len(simulator.times) * len(simulator.outputs)
    init = partial(np.zeros, (len(functionals), size))
    return Reduction(init, partial(_update_projection, functionals), np.add)


def node_values() -> Reduction[tuple[tuple[Indices, Array], ...]]:
    """Numbers (n,) and values (n, n_t n_y) of the runs that did not fail, block by block."""
    return Reduction(tuple, _update_values, operator.add)


def gathered(simulator: Simulator, P: Array, executor: Executor | None) -> tuple[Array, FailedRuns]:
    """Values (N, n_t, n_y) at samples P (N, d), nan where a run failed, and the failed runs."""
    Y = np.full((len(P), len(simulator.times), len(simulator.outputs)), np.nan)
    blocks, failed = simulator.stream(P, together(node_values(), failures()), executor)
    for indices, values in blocks:
        Y[indices] = values.reshape(len(indices), *Y.shape[1:])
    return Y, failed


def together(*reductions: Reduction[Any]) -> Reduction[tuple[Any, ...]]:
    """One reduction that combines several reductions of the same runs. Its state is the tuple of all states."""
    return Reduction(
        partial(_init_together, reductions),
        partial(_update_together, reductions),
        partial(_merge_together, reductions),
        trajectories=any(reduction.trajectories for reduction in reductions),
        attained=next((partial(_of_part, k, r.attained) for k, r in enumerate(reductions) if r.attained), None),
    )


def failure_records(simulator: Simulator, box: Box, P: Array, runs: FailedRuns) -> tuple[Failure, ...]:
    """Failed runs with the values of the box's parameters."""
    order = list(simulator.parameters)
    return tuple(
        Failure({name: float(P[index, order.index(name)]) for name in box.names}, time, message)
        for index, time, message in runs
    )


def failure_details(simulator: Simulator, box: Box, points: Array, P: Array, runs: FailedRuns) -> dict[str, Any]:
    """Attributes of Bounds: the failed runs and the region of failures, for runs at points (N, d) with samples P."""
    region = failed_region(box, points, which_failed(runs, len(P)))
    return {"failed": failure_records(simulator, box, P, runs), "failed_region": region}


def which_failed(runs: FailedRuns, number: int) -> Mask:
    """Mask (number,) of the failed runs among all runs."""
    return np.isin(np.arange(number), [index for index, _, _ in runs])


def require_some(method: object, failed: tuple[Failure, ...], runs: int) -> None:
    """Raise PropagationError if every run failed."""
    if len(failed) == runs:
        raise PropagationError(f"{method!r}: all {runs} runs failed.\n{failure_text(failed)}")


def _itself(state: Extremes) -> Extremes:
    return state


def _of_part(k: int, attained: Callable[[Any], Any], state: tuple[Any, ...]) -> Any:
    return attained(state[k])


def _no_extremes(shape: tuple[int, int]) -> Extremes:
    return Extremes(np.full(shape, np.inf), np.full(shape, -np.inf), np.zeros((2, *shape), dtype=np.intp))


def _update_extremes(state: Extremes, block: Samples, indices: Indices) -> Extremes:
    at = block.attaining
    return _merge_extremes(state, Extremes(*block.extremes(), None if at is None else indices[at]))


def _merge_extremes(first: Extremes, second: Extremes) -> Extremes:
    at = None
    if first.at is not None and second.at is not None:
        at = np.where([second.lower < first.lower, second.upper > first.upper], second.at, first.at)
    return Extremes(np.minimum(first.lower, second.lower), np.maximum(first.upper, second.upper), at)


def _update_failures(state: FailedRuns, block: Samples, indices: Indices) -> FailedRuns:
    bad = ~block.ok
    if not bad.any():
        return state
    return state + tuple(zip(indices[bad].tolist(), block.t_failed[bad].tolist(), block.messages, strict=True))


def _update_values(state: tuple[Any, ...], block: Samples, indices: Indices) -> tuple[Any, ...]:
    return (*state, (indices[block.ok], block.Y.reshape(len(block.Y), -1)[block.ok]))


def _update_projection(functionals: Array, state: Array, block: Samples, indices: Indices) -> Array:
    Y = block.Y.reshape(len(block.Y), -1)
    return state + functionals[:, indices[block.ok]] @ (Y if block.ok.all() else Y[block.ok])


def _init_together(reductions: tuple[Reduction[Any], ...]) -> tuple[Any, ...]:
    return tuple(reduction.init() for reduction in reductions)


def _update_together(
    reductions: tuple[Reduction[Any], ...], state: tuple[Any, ...], block: Samples, indices: Indices
) -> tuple[Any, ...]:
    return tuple(r.update(part, block, indices) for r, part in zip(reductions, state, strict=True))


def _merge_together(
    reductions: tuple[Reduction[Any], ...], first: tuple[Any, ...], second: tuple[Any, ...]
) -> tuple[Any, ...]:
    return tuple(r.merge(a, b) for r, a, b in zip(reductions, first, second, strict=True))
