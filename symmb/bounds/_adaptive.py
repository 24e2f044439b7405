"""Polynomial chaos whose order rises until the bounds settle: nested levels, no run made twice."""

import itertools
from collections.abc import Iterator

import numpy as np

from symmb._box import Box
from symmb._errors import PropagationError
from symmb._types import Array, Executor
from symmb.bounds._basis import TensorDegree, TotalDegree
from symmb.bounds._describe import failure_text
from symmb.bounds._fit import Fit
from symmb.bounds._inclusion import Range
from symmb.bounds._method import parameter_samples
from symmb.bounds._nodes import ClenshawCurtis, SparseGrid, node_keys
from symmb.bounds._reductions import failure_records
from symmb.bounds._result import Bounds
from symmb.simulate import Indices, Progress, Simulator, run_blocks

MOST_RUNS = 5000
"""Without a budget: where to stop although the bounds have not settled; ``estimate`` tells how far off."""
TENSOR_PARAMETERS = 3
"""Up to so many parameters the levels are tensor grids, beyond it sparse grids."""

ROUNDING = 1e-9
"""Share of an output's scale below which its width counts as none."""


class _Runs:
    """All runs made so far, by node."""

    def __init__(self, simulator: Simulator, box: Box, executor: Executor | None, progress: Progress | None):
        self._simulator, self._box = simulator, box
        self._executor, self._progress = executor, progress
        self._rows: dict[bytes, Array] = {}

    def __len__(self) -> int:
        return len(self._rows)

    def new(self, nodes: Array) -> Indices:
        """Numbers of the nodes (N, d) that have not been run."""
        return np.array([i for i, key in enumerate(_keys(nodes)) if key not in self._rows], dtype=np.intp)

    def at(self, nodes: Array) -> Array:
        """Responses (N, n_t n_y) at nodes (N, d), from earlier runs where there are."""
        new = self.new(nodes)
        P = parameter_samples(self._simulator, self._box, nodes[new])
        ensemble = run_blocks(self._simulator, P, self._executor, self._progress)
        if not ensemble.ok.all():
            bad = np.flatnonzero(~ensemble.ok)
            runs = tuple(zip(bad.tolist(), ensemble.t_failed[bad].tolist(), ensemble.messages, strict=True))
            failed = failure_records(self._simulator, self._box, P, runs)
            raise PropagationError(
                f"Interpolation at {len(nodes)} nodes needs them all, but {len(failed)} runs failed. "
                "PolynomialChaos(order=..., basis=TotalDegree()) can fit around them.\n" + failure_text(failed)
            )
        keys = _keys(nodes)
        for i, y in zip(new, ensemble.Y, strict=True):
            self._rows[keys[i]] = y.ravel()
        return np.stack([self._rows[key] for key in keys])

    def extremes(self, shape: tuple[int, int]) -> tuple[Array, Array]:
        """Smallest and largest responses of all runs, each in the given shape."""
        rows = list(self._rows.values())
        return np.minimum.reduce(rows).reshape(shape), np.maximum.reduce(rows).reshape(shape)


def adaptive_bounds(
    text: str,
    range_: Range,
    tolerance: float,
    budget: int | None,
    simulator: Simulator,
    box: Box,
    executor: Executor | None,
    progress: Progress | None,
) -> Bounds:
    """Bounds of the first level that differs from the one before by less than ``tolerance`` of the response
    width.

    The change is the root mean square over time, over that of the width, of the output where it is largest.
    Its value at each time and output, the larger of both bounds', is the result's ``estimate``.
    """
    most = MOST_RUNS if budget is None else budget
    shape = len(simulator.times), len(simulator.outputs)
    runs = _Runs(simulator, box, executor, progress)
    bounds: tuple[Array, Array] | None = None
    estimate: Array | None = None
    for fit in _levels(len(box)):
        cost = len(runs) + len(runs.new(fit.nodes))
        if bounds is None and cost > most:
            raise PropagationError(f"{text}: the first level takes {cost} runs, more than the budget of {most}.")
        if cost > most:
            break
        Y = runs.at(fit.nodes)
        lower, upper = range_.bounds(fit.alpha, fit.coefficients(fit.functionals @ Y, np.ones(len(Y), dtype=bool)))
        if bounds is not None:
            estimate = np.maximum(np.abs(lower - bounds[0]), np.abs(upper - bounds[1]))
        bounds = lower, upper
        if estimate is not None and _share(*(a.reshape(shape) for a in (estimate, lower, upper))) <= tolerance:
            break
    if bounds is None:
        raise PropagationError(f"{text}: no level for {len(box)} parameters.")
    return Bounds(
        t=simulator.times,
        names=simulator.outputs,
        lower=bounds[0].reshape(shape),
        upper=bounds[1].reshape(shape),
        kind="estimate",
        method=text,
        evaluations=len(runs),
        estimate=None if estimate is None else estimate.reshape(shape),
        inner=runs.extremes(shape),
    )


def _levels(d: int) -> Iterator[Fit]:
    """Fits whose nodes contain those of the fit before."""
    if d <= TENSOR_PARAMETERS:
        for order in (2, 4, 8, 16, 32):
            yield Fit.of(ClenshawCurtis(), TensorDegree(), d, order)
    else:
        for level in itertools.count(1):
            yield Fit.of(SparseGrid(ClenshawCurtis()), TotalDegree(), d, level)


def _share(change: Array, lower: Array, upper: Array) -> float:
    """Largest over outputs of rms change over rms width; an output constant but for rounding has none."""
    width = np.sqrt(np.mean((upper - lower) ** 2, axis=0))
    scale = np.sqrt(np.mean(np.maximum(lower**2, upper**2), axis=0))
    rms = np.sqrt(np.mean(change**2, axis=0))
    return float(np.max(np.divide(rms, width, where=width > ROUNDING * scale, out=np.zeros_like(width))))


def _keys(nodes: Array) -> list[bytes]:
    return [row.tobytes() for row in node_keys(nodes)]
