"""The reference of a comparison: the best available bounds, their uncertainty and their cost."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from symmb._errors import PropagationError, SimulationError
from symmb._magnitudes import SAME
from symmb._types import Array, Executor
from symmb.bound.answers import Bounds
from symmb.bound.methods import Method, MonteCarlo, Optimization, Scanning, Vertex
from symmb.bound.nodes import Sobol
from symmb.bound.reductions import bounded
from symmb.bound.responses import gathered
from symmb.connect import Simulator
from symmb.equations.model import Box
from symmb.results.files import Record, entry
from symmb.study.metrics import Yardstick

RUNS = 2000
"""Approximate number of runs at the finer resolution, if runs are fast."""
_LEAST_RUNS = 9
"""Smallest number of runs, if runs are slow: a grid of three points for each of two parameters."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Reference:
    """Reference bounds with their uncertainty.

    In a comparison, the default reference includes the values that runs of all methods attained. Proved bounds limit
    each reference.

    Attributes
    ----------
    method : str                text of the method
    lower, upper : (n_t, n_y)
    uncertainty : (n_y,)        in the norm of `Score.error`; nan if not known
    evaluations, failed : int or None     number of runs, and of failed runs; None if not known
    seconds : float or None     run time [s]; None if bounds were given
    proved : (n_y,) or None     largest proved distance of attained values from the true bounds, in this norm
    proved_by : tuple of str    methods that prove this distance
    noise : (n_y,) or None      errors of runs, in the outputs' units; None if not known
    """

    method: str
    lower: Array = field(metadata=entry(Record.lower, "t", "names"))
    upper: Array = field(metadata=entry(Record.upper, "t", "names"))
    uncertainty: Array = field(metadata=entry(Record.with_nan, "names"))
    evaluations: int | None = None
    failed: int | None = None
    seconds: float | None = None
    proved: Array | None = field(default=None, metadata=entry(Record.with_nan, "names"))
    proved_by: tuple[str, ...] = ()
    noise: Array | None = field(default=None, metadata=entry(Record.size, "names"))

    @property
    def yardstick(self) -> Yardstick:
        """The yardstick that scores the bounds of methods."""
        return Yardstick(self.lower, self.upper, self.uncertainty, self.noise)

    def joined(self, attained: Sequence[tuple[Array, Array]]) -> "Reference":
        """The reference, extended by values that other runs attained. The uncertainty is at least the extension."""
        lower = np.min([self.lower, *(low for low, _ in attained)], axis=0)
        upper = np.max([self.upper, *(high for _, high in attained)], axis=0)
        missed = Yardstick(lower, upper, self.uncertainty).deviation(self.lower, self.upper)
        return replace(self, lower=lower, upper=upper, uncertainty=np.maximum(self.uncertainty, missed))


def require_same(what: str, bounds: Bounds, simulator: Simulator) -> None:
    """Raise PropagationError if bounds have other outputs or times than a simulator. `what` begins the sentence."""
    if tuple(bounds.names) != tuple(simulator.outputs):
        raise PropagationError(
            f"{what} has the outputs {', '.join(bounds.names)}, but the simulator has the outputs "
            f"{', '.join(simulator.outputs)}. Give bounds of the same outputs in the same order."
        )
    units = tuple(getattr(simulator, "units", ()))
    if bounds.units and units and tuple(bounds.units) != units:
        raise PropagationError(
            f"{what} has the units {', '.join(bounds.units)}, but the simulator has the units {', '.join(units)}. Give "
            "bounds in the same units."
        )
    t, times = bounds.t, simulator.times
    if len(t) != len(times) or not np.allclose(t, times, rtol=0.0, atol=SAME):
        raise PropagationError(
            f"{what} has {len(t)} times from {t[0]:g} to {t[-1]:g} s, but the simulator has {len(times)} "
            f"from {times[0]:g} to {times[-1]:g} s. Give bounds at the same times."
        )


def find_reference(
    simulator: Simulator,
    box: Box,
    reference: Method | Bounds | None = None,
    *,
    runs: int = RUNS,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Reference:
    """Reference bounds of `simulator` over `box`.

    If `reference` is not given, the method is a scan of 2 m + 1 points in each dimension. The uncertainty is the
    difference from the bounds by only every second point. With more than five parameters, 2048 and 512 Sobol samples
    replace the grids. If the box has at most 2000 vertices, the vertices are added.

    With four or more parameters, extremes are also optimised, with derivatives from differences of runs. If the other
    runs stay within the estimated error of the optimisation, this error is the uncertainty. Otherwise the uncertainty
    is the larger of two values: the distance of these runs beyond the optimised bounds, and the difference of the two
    resolutions.

    Parameters
    ----------
    reference : Method or Bounds, optional      better bounds, with `estimate` as the uncertainty

    Raises
    ------
    PropagationError    if given bounds have other times or outputs than the simulator, or bounds are infinite
    """
    if isinstance(reference, Bounds):
        require_same("The reference", reference, simulator)
        return _of_bounds(reference, seconds=None)
    start = time.perf_counter()
    if reference is not None:
        bounds = bounded(reference, simulator, box, executor=executor, progress=progress)
        return _of_bounds(bounds, seconds=time.perf_counter() - start)
    coarse, fine, *shared = [
        bounded(method, simulator, box, executor=executor, progress=progress)
        for method in _resolutions(len(box.names), runs)
    ]
    optimized = _optimized(simulator, box, runs, executor, progress)
    parts = [coarse, fine, *shared, *optimized]
    lower, upper = _hull(parts)
    yardstick = Yardstick(lower, upper, np.full(lower.shape[1], np.nan))
    uncertainty = yardstick.deviation(*_hull([coarse, *shared]))
    for found in optimized:
        own, missed = yardstick.relative(np.asarray(found.estimate)), yardstick.deviation(found.lower, found.upper)
        uncertainty = np.where(missed <= own, own, np.maximum(missed, uncertainty))
    return Reference(
        method=" with ".join(bounds.method for bounds in [fine, *shared, *optimized]),
        lower=lower,
        upper=upper,
        uncertainty=uncertainty,
        evaluations=sum(bounds.evaluations for bounds in parts),
        failed=sum(len(bounds.failed) for bounds in parts),
        seconds=time.perf_counter() - start,
    )


def _optimized(
    simulator: Simulator, box: Box, runs: int, executor: Executor | None, progress: Progress | None
) -> list[Bounds]:
    """Bounds by optimisation; empty if there are few parameters, too few runs, or failed runs."""
    if not _is_optimized(len(box), runs):
        return []
    differences = _Differences(simulator, box, executor)
    try:
        return [bounded(Optimization(runs), differences, box, executor=executor, progress=progress)]
    except (PropagationError, SimulationError):
        return []


class _Differences:
    """A simulator with first derivatives from differences of runs. Differences exist at kinks and for black boxes."""

    def __init__(self, simulator: Simulator, box: Box, executor: Executor | None) -> None:
        self._simulator, self._box, self._executor = simulator, box, executor
        self.parameters, self.times, self.outputs = simulator.parameters, simulator.times, simulator.outputs
        self.run, self.stream = simulator.run, simulator.stream

    def jets(self, p0: Array, directions: Array, order: int) -> Array:
        """Values and slopes (2, m, n_t, n_y), at each point along one direction for each parameter of the box."""
        del order
        points = p0[:: len(self._box)]
        columns = [list(self.parameters).index(name) for name in self._box.names]
        at = self._box.to_unit(points[:, columns]).ravel()
        # Step relative to the half width. It is small compared with the box, and large compared with errors of runs.
        # Steps point to the centre.
        step = np.where(at > 0, -0.02, 0.02)[:, None]
        Y, _ = gathered(self._simulator, np.vstack([points, p0 + step * directions]), self._executor)
        values = Y[: len(points)].repeat(len(self._box), axis=0)
        return np.stack([values, (Y[len(points) :] - values) / step[:, None]])


def _is_optimized(n_p: int, runs: int) -> bool:
    """Whether extremes are also optimised. With four or more parameters, grids have too few points per parameter."""
    return n_p >= 4 and runs >= 4 * (1 + n_p)


def affordable_runs(seconds: float) -> int:
    """Number of runs at the finer resolution, from the duration of one run [s]."""
    # Longest estimated time of the reference [s]. If runs are slow, their number is reduced.
    return max(_LEAST_RUNS, min(RUNS, int(120.0 / max(seconds, SAME))))


def planned_runs(n_p: int, runs: int = RUNS) -> int:
    """Number of runs of the default reference for `n_p` parameters."""
    optimized = runs if _is_optimized(n_p, runs) else 0
    return optimized + sum(method.planned_runs(n_p) or 0 for method in _resolutions(n_p, runs))


def _resolutions(n_p: int, runs: int = RUNS) -> list[Method]:
    """The method at the coarser and at the finer resolution, and a method that combines both."""
    # Largest number of parameters for a grid. With more parameters, `RUNS` points are only two or three for each.
    if n_p <= 5 and 3**n_p <= max(runs, _LEAST_RUNS):
        m = max(round((runs ** (1 / n_p) - 1) / 2), 1)
        return [Scanning(m + 1), Scanning(2 * m + 1)]
    fewer = 2 ** max(0, round(math.log2(RUNS / runs)))
    # Sobol sequences are balanced for powers of two.
    samples: list[Method] = [MonteCarlo(max(2, n // fewer), sampler=Sobol()) for n in (512, 2048)]
    return [*samples, Vertex()] if 2**n_p <= runs else samples


def _hull(parts: list[Bounds]) -> tuple[Array, Array]:
    lower = np.min([bounds.lower for bounds in parts], axis=0)
    return lower, np.max([bounds.upper for bounds in parts], axis=0)


def _of_bounds(bounds: Bounds, seconds: float | None) -> Reference:
    infinite = np.isinf(bounds.lower) | np.isinf(bounds.upper)
    if infinite.any():
        first, output = np.argwhere(infinite)[0]
        raise PropagationError(
            f"The reference {bounds.method} has infinite bounds of {bounds.names[output]} at t = {bounds.t[first]:g} s."
            "  Errors are not known then. Give times that end earlier, or another reference, such as Scanning(21)."
        )
    unknown = np.full(len(bounds.names), np.nan)
    yardstick = Yardstick(bounds.lower, bounds.upper, unknown)
    return Reference(
        method=bounds.method,
        lower=bounds.lower,
        upper=bounds.upper,
        uncertainty=unknown if bounds.estimate is None else yardstick.relative(bounds.estimate),
        evaluations=bounds.evaluations,
        failed=len(bounds.failed),
        seconds=seconds,
    )
