"""The data from which bounds were computed, which are stored with the bounds for further runs."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

import symmb.connect as connect
from symmb._errors import DeclarationError, PropagationError
from symmb._progress import shown_runs
from symmb._types import Array, Executor
from symmb.bound.adaptive import MOST_RUNS
from symmb.bound.answers import Bounds
from symmb.bound.methods import PolynomialChaos
from symmb.bound.nodes import Sobol
from symmb.bound.reductions import bounded
from symmb.bound.responses import FailedRuns, RunsUsedUpError, gathered, parameter_samples
from symmb.connect import Simulator, noise_from_runs
from symmb.equations.model import Box, Scene
from symmb.run.formulations import CardEnsemble
from symmb.run.integrate import Solver
from symmb.run.simulation import DAESimulator, FigureSimulator, SceneSimulator, Subject, motion_of, never_holds

_FAILED = (
    "{} of {} runs failed: {}. Use a box without failures, or MonteCarlo(n, distributions=...). It omits failed runs."
)
_FEWEST_RUNS = 16
"""Fewest runs of a further study for each of its parameters. With fewer, estimated errors were up to seven times too
small for narrow peaks and jumps."""
_MANY, _LEAST_PARTS = 1000, 4
"""Smallest number of times at which a run is compared with a limit, and of parts between two output times."""


class Extremes:
    """A function: samples P (N, d) -> lowest and highest values over time (2, N, n) of n outputs, nan in failed runs.

    For scenes, the values between output times count as well. Other simulators have values at output times only. If a
    condition never holds, `first_time` is infinite, and the lowest value of `value_at` is inf, the highest one -inf.
    """

    def __init__(self, simulator: Simulator, names: Sequence[str], executor: Executor | None = None) -> None:
        self._executor, self._columns = executor, [tuple(simulator.outputs).index(name) for name in names]
        self._simulator, self._peaks = simulator, None
        if isinstance(simulator, SceneSimulator) and len(simulator.times) > 1:
            self._peaks = FigureSimulator.of_peaks(simulator, names)

    def __call__(self, P: Array) -> Array:
        if self._peaks is not None:
            return _lowest_and_highest(self._peaks, P, self._executor)
        lowest, highest = _with_absences(self._simulator, P, self._executor)
        return np.stack([lowest.min(axis=1), highest.max(axis=1)])[..., self._columns]


def _lowest_and_highest(peaks: FigureSimulator, P: Array, executor: Executor | None) -> Array:
    """Lowest and highest values (2, N, n) of samples P (N, d), from the outputs of `FigureSimulator.of_peaks`."""
    lowest, highest = _with_absences(peaks, P, executor)
    return np.stack([lowest[:, 0, ::2], highest[:, 0, 1::2]])


def _with_absences(simulator: Simulator, P: Array, executor: Executor | None) -> Array:
    """Lowest and highest values (2, N, n_t, n_y) of samples P (N, d), which differ only where conditions never hold."""
    if not isinstance(simulator, FigureSimulator) or not simulator.ends:
        return np.stack(2 * [gathered(simulator, P, executor)[0]])
    Y, bad = gathered(simulator.continued(()), P, executor)
    never = np.zeros((len(P), len(simulator.outputs)), dtype=bool)
    for i, _, message in bad:
        never[i] = [never_holds(name) in message for name in simulator.outputs]
    if (rows := never.any(axis=1)).any():
        Y[rows] = gathered(simulator.continued(), P[rows], executor)[0]
    is_value = [simulator.ends.get(name, 0.0) is None for name in simulator.outputs]
    low, high = (np.where(never[:, None], end, Y) for end in (np.inf, np.where(is_value, -np.inf, np.inf)))
    return np.stack([low, high])


@dataclass(frozen=True, eq=False)
class Study:
    """The simulator and the box of bounds, and the executor of their runs, which is used as long as it works."""

    simulator: Simulator
    box: Box
    executor: Executor | None = None

    @contextmanager
    def allowing(self, runs: float) -> Iterator[None]:
        """A context in which at most this number of runs are made. RunsUsedUpError is raised before further runs."""
        self._budget[:] = [runs]
        try:
            yield
        finally:
            self._budget[:] = [np.inf]

    @property
    def left(self) -> float:
        """The number of runs that are left in this context."""
        return self._budget[0]

    @cached_property
    def _budget(self) -> list[float]:
        return [np.inf]

    def _take(self, n: int) -> None:
        if n > self.left:
            raise RunsUsedUpError(f"{n} runs are needed, and {self.left:g} are left.")
        self._budget[0] -= n

    def _gathered(self, simulator: Simulator, points: Array) -> tuple[Array, FailedRuns]:
        """Values (N, n_t, n_y) at points (N, d) of the unit box, nan where a run failed, and the failed runs."""
        self._take(len(points))
        return gathered(simulator, parameter_samples(simulator, self.box, points), self._working)

    @property
    def _working(self) -> Executor | None:
        return None if connect.is_shut_down(self.executor) else self.executor

    @property
    def scene(self) -> Scene:
        """The scene; None for other simulators."""
        return self.prepared.scene

    @property
    def solver(self) -> Solver:
        """The solver of the scene."""
        return self.prepared.solver

    @property
    def prepared(self) -> DAESimulator:
        """The scene, prepared for runs."""
        simulator = self.simulator
        if isinstance(simulator, SceneSimulator) and simulator.scene is not None:
            is_whole = isinstance(simulator, DAESimulator)
            return simulator if is_whole else Subject(simulator.scene, simulator.solver).motion
        raise DeclarationError(f"These bounds have no scene, because they are bounds of {self.simulator!r}.")

    def extremes(self, names: tuple[str, ...], points: Array) -> Array:
        """Lowest and highest values over time (2, N, n) of curves of a scene at points (N, d); nan for failed runs."""
        if names not in self._peaks:
            base = next(iter(self._peaks.values()), self.simulator)  # its equations are compiled already
            assert isinstance(base, SceneSimulator)
            self._peaks[names] = FigureSimulator.of_peaks(base, names)
        self._take(len(points))
        return _lowest_and_highest(self._peaks[names], parameter_samples(self.simulator, self.box, points), None)

    @cached_property
    def _peaks(self) -> dict[tuple[str, ...], FigureSimulator]:
        return {}

    def at_many_times(self, place: Array) -> tuple[Array, Array]:
        """Times (n,), and the curves (n, n_c) of the run at a place (d,) of the unit box, in the order of the outputs.

        The intervals between output times are divided into the same number of parts.
        """
        motion = motion_of(self.simulator)
        assert motion is not None
        parts, n = max(-(-_MANY // (len(motion.times) - 1)), _LEAST_PARTS), len(motion.times)
        times = np.interp(np.arange(parts * (n - 1) + 1) / parts, np.arange(n), motion.times)
        return times, motion.program.at(times).runs(parameter_samples(motion, self.box, place[None])).Y[0]

    @cached_property
    def adaptive(self) -> Bounds:
        """Bounds over the box by PolynomialChaos()."""
        return self._bounds(self.box, "a study with PolynomialChaos()", 1)

    def _bounds(self, box: Box, label: str, studies: int) -> Bounds:
        """Bounds over another box. They use equal parts of the runs that are left."""
        budget = None if self.left >= studies * MOST_RUNS else int(self.left) // studies
        if budget is not None and budget < _FEWEST_RUNS * int((box.radius > 0).sum()):
            raise RunsUsedUpError(f"{self.left:g} runs are too few for {studies} studies.")
        with shown_runs(None, label) as progress:
            try:
                method = PolynomialChaos(budget=budget)
                bounds = bounded(method, self.simulator, box, executor=self._working, progress=progress)
            except PropagationError as error:
                raise error if budget is None else RunsUsedUpError(str(error)) from error
        self._budget[0] -= bounds.evaluations
        return bounds

    @cached_property
    def nominal(self) -> tuple[Array | None, Array | None]:
        """Outputs (n_t, n_y) of the nominal run, None if the run fails, and the error of the outputs."""
        Y, bad = gathered(self.simulator, np.array([[*map(float, self.simulator.parameters.values())]]), None)
        return (None, None) if bad else (Y[0], noise_from_runs(self.simulator))

    def range(self, box: Box, label: str, studies: int) -> tuple[Array, Array, Array, int]:
        """Bounds (n_t, n_y) over another box by PolynomialChaos(), their estimated error, and the number of runs.

        Parameters outside of the box have their nominal values. The progress bar shows `label`. The study is the first
        of several `studies`, which use equal parts of the runs that are left.
        """
        bounds = self._bounds(box, f"{label}, {', '.join(box.names)}", studies)
        assert bounds.estimate is not None
        return bounds.lower, bounds.upper, bounds.estimate, bounds.evaluations

    def sample(self, n: int) -> tuple[Array, Array]:
        """Points (n, d) spread over the unit box, and the responses (n, n_t, n_y) of these runs, for all answers.

        Points with failed runs are left out. PropagationError is raised if most runs fail.
        """
        known, new = self._sampled, Sobol().points(n, len(self.box), seed=1)
        if len(new) > (before := len(known[0])):
            Y, bad = self.attempted(new[before:])
            if len(bad) > len(Y) // 2:
                raise PropagationError(_FAILED.format(len(bad), len(Y), bad[0][2]))
            known[:] = new, np.concatenate([known[1], Y])
        points, Y = known[0][:n], known[1][:n]
        ok = np.isfinite(Y).all(axis=(1, 2))
        return points[ok], Y[ok]

    @cached_property
    def _sampled(self) -> list[Array]:
        """Points and responses of the runs so far. Responses of failed runs are nan."""
        shape = len(self.simulator.times), len(self.simulator.outputs)
        return [np.zeros((0, len(self.box))), np.zeros((0, *shape))]

    @property
    def has_lanes(self) -> bool:
        """Whether runs are computed together, so that many runs take little time."""
        return isinstance(self.simulator, SceneSimulator)

    def attempted(self, points: Array) -> tuple[Array, FailedRuns]:
        """Responses (N, n_t, n_y) at points (N, d) of the unit box, with nan for failed runs, and the failed runs."""
        return self._gathered(self.simulator, points)

    def of_output(self, k: int, points: Array) -> tuple[Array, int]:
        """Values (N, n_t) of output k at points (N, d) of the unit box, and the number of failed runs.

        The values are nan for failed runs, and for runs in which the condition of `value_at` never holds.
        """
        simulator, name = self.simulator, self.simulator.outputs[k]
        if isinstance(simulator, FigureSimulator) and simulator.ends.get(name, 0.0) is None:
            simulator = simulator.continued(simulator.ends.keys() - {name})
        Y, bad = self._gathered(simulator, points)
        return Y[:, :, k], sum(never_holds(name) not in message for _, _, message in bad)

    def values(self, points: Array) -> Array:
        """Responses (N, n_t, n_y) at points (N, d) of the unit box. No run may fail."""
        Y, bad = self.attempted(points)
        if bad:
            raise PropagationError(_FAILED.format(len(bad), len(points), bad[0][2]))
        return Y

    @property
    def on_card(self) -> bool:
        """Whether runs are made on a graphics card, so that a million runs take little time if they are reduced."""
        return isinstance(self.simulator, DAESimulator) and self.simulator.program.card is not None

    def reduced(self, points: Array, reduce: Callable[[CardEnsemble], Any]) -> Any:
        """A reduction of runs on a graphics card at points (N, d) of the unit box. No run may fail."""
        runs = self.simulator.run(parameter_samples(self.simulator, self.box, points))
        result = reduce(cast(CardEnsemble, runs))
        if not runs.ok.all():
            raise PropagationError(_FAILED.format(len(runs.messages), len(points), runs.messages[0]))
        return result
