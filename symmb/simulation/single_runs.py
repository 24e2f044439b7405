"""Studies of runs that do not depend on each other: they go out one by one, and are reduced in fixed blocks."""

import time
from collections.abc import Iterator
from functools import partial
from typing import TypeVar

import numpy as np

from symmb._types import Array, Executor
from symmb.simulation.executor_pool import Lost
from symmb.simulation.executors import finished
from symmb.simulation.simulator import (
    Ensemble,
    Merging,
    Progress,
    Reduction,
    Simulator,
    blocks,
    checked_samples,
    joined,
)

S = TypeVar("S")

_ENOUGH = 0.02
"""Time that a task should take, beside which that of sending it is small [s]."""


def stream_of_runs(
    simulator: Simulator, P: Array, reduction: Reduction[S], executor: Executor, progress: Progress | None, block: int
) -> S:
    """Run samples P (N, d) by an executor, and merge the states of blocks in their order.

    A task is one run where runs are slow, and several where they are fast, by what former tasks took. Blocks have
    `block` samples whatever the tasks are. So the result does not depend on the executor.
    """
    P = checked_samples(simulator, P, progress)
    tasks: list[Array] = []
    seconds = np.inf  # of a run

    def next_tasks() -> Iterator[Array]:
        begin = 0
        while begin < len(P):
            size = max(1, min(block, int(_ENOUGH / seconds))) if seconds else block
            tasks.append(P[begin : begin + size])
            begin += size
            yield tasks[-1]

    merging = Merging(reduction, progress, len(P))
    waiting = iter(blocks(len(P), block))
    indices = next(waiting, None)
    arrived: dict[int, Ensemble] = {}
    ready: list[Ensemble] = []
    following = 0
    for k, result in finished(partial(_timed, simulator), next_tasks(), executor):
        if isinstance(result, Lost):
            arrived[k] = lost_runs(simulator, tasks[k], result.reason)
        else:
            arrived[k], seconds = result
        while (some := arrived.pop(following, None)) is not None:
            following += 1
            ready.append(some)
        while indices is not None and sum(len(some.ok) for some in ready) >= len(indices):
            whole, ready = _split(joined(ready, len(simulator.times), len(simulator.outputs)), len(indices))
            merging.add(reduction.update(reduction.init(), whole, indices), len(indices))
            indices = next(waiting, None)
    return merging.state


def _timed(simulator: Simulator, P: Array) -> tuple[Ensemble, float]:
    """Runs, and the time of one of them [s]."""
    begin = time.perf_counter()
    runs = simulator.run(P)
    ensemble = Ensemble(runs.Y, runs.ok, runs.t_failed, runs.messages, runs.events)
    return ensemble, (time.perf_counter() - begin) / len(P)


def lost_runs(simulator: Simulator, P: Array, reason: str) -> Ensemble:
    """Failed runs P (n, d) of a worker that died."""
    Y = np.full((len(P), len(simulator.times), len(simulator.outputs)), np.nan)
    told = [", ".join(f"{name}={x:.6g}" for name, x in zip(simulator.parameters, p, strict=True)) for p in P.tolist()]
    messages = tuple(f"{reason} ({text})" for text in told)
    return Ensemble(Y, np.zeros(len(P), dtype=bool), np.full(len(P), simulator.times[0]), messages)


def _split(ensemble: Ensemble, count: int) -> tuple[Ensemble, list[Ensemble]]:
    """The first runs of an ensemble, and the others."""
    failed = int((~ensemble.ok[:count]).sum())
    first, others = slice(count), slice(count, None)
    parts = [
        Ensemble(
            ensemble.Y[some],
            ensemble.ok[some],
            ensemble.t_failed[some],
            messages,
            None if ensemble.events is None else ensemble.events[some],
        )
        for some, messages in ((first, ensemble.messages[:failed]), (others, ensemble.messages[failed:]))
    ]
    return parts[0], parts[1:] if len(parts[1].ok) else []
