"""Simulators that are known only by their runs: functions, programs, FMUs."""

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np

from symmb._errors import DeclarationError, SimulationError
from symmb._names import ByName, name_faults, normal, normal_keys
from symmb._options import is_finite_number, require_name, shown
from symmb._table import is_timeless
from symmb._types import Array, Executor
from symmb._units import numbers_in, quantity, units_of_parameters, values_text
from symmb.connect.identity import ChangedFileError
from symmb.connect.limited_calls import fault_text
from symmb.connect.simulator import Ensemble, Merging, Progress, Reduction, Simulator, blocks, checked_samples, joined
from symmb.connect.tasks import LostTask, finished

S = TypeVar("S")


class BlackBox(ABC):
    """A simulator that makes one run after the other. A run fails if it raises an exception or a value is not finite.

    Attributes
    ----------
    parameters : nominal values by name
    times : (n_t,) increasing times of the rows [s]
    outputs : n_y names of the columns
    noise : (n_y,) errors of the output values; None if not known
    """

    parameters: Mapping[str, float]
    times: Array
    outputs: tuple[str, ...]
    noise: Array | None

    @abstractmethod
    def response(self, values: dict[str, float]) -> Any:
        """The outputs of a run with these parameters: (n_t, n_y), or (n_t,) if there is one output.

        Raises
        ------
        SimulationError
            If the run fails. The message of the run is the text of this error. For other exceptions, the message also
            contains the type
        """

    def _declare(
        self,
        parameters: Mapping[str, float],
        times: Array | Sequence[float],
        outputs: Sequence[str],
        noise: Mapping[str, float] | None,
    ) -> None:
        """Check and store the declaration."""
        owner, units = type(self).__name__, units_of_parameters(parameters)
        instants = numbers_in(f"{owner}: times", "a time", times, "s")
        if instants is None:
            raise DeclarationError(f"{owner}: times must be numbers, got {shown(times)}.")
        times = instants.copy()
        if times.ndim != 1 or not len(times) or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
            raise DeclarationError(f"{owner}: times must be finite and increase. Give one or more times.")
        if not isinstance(outputs, str | list | tuple):
            raise DeclarationError(f"{owner}: outputs must be a list of names, got {shown(outputs)}.")
        names = (outputs,) if isinstance(outputs, str) else tuple(outputs)
        if not isinstance(parameters, Mapping):
            raise DeclarationError(f"{owner}: parameters must map names to nominal values, got {shown(parameters)}.")
        faults = name_faults(names) + name_faults([*parameters])
        names, parameters = tuple(map(normal, names)), normal_keys(owner, parameters)
        if not names or faults:
            raise DeclarationError(f"{owner}: outputs must be one or more different names. {' '.join(faults)}".strip())
        given = {name: quantity(f"{owner}: parameter {name!r}:", value) for name, value in parameters.items()}
        units = {**units, **{name: unit for name, (_, unit) in given.items() if unit}}
        times.flags.writeable = False
        vars(self).update(
            parameters=ByName(((name, value) for name, (value, _) in given.items()), units),
            times=times,
            outputs=names,
            noise=None if noise is None else _noise(owner, noise, names),
        )

    def run(self, P: Array) -> Ensemble:
        """Run each row of P (N, d)."""
        P = checked_samples(self, P, None)
        Y = np.full((len(P), len(self.times), len(self.outputs)), np.nan)
        t_failed = np.full(len(P), np.nan)
        messages = []
        for i, row in enumerate(P):
            values = dict(zip(self.parameters, row.tolist(), strict=True))
            try:
                Y[i] = self._shaped(self.response(values))
            except (KeyboardInterrupt, ChangedFileError):
                raise
            except BaseException as error:  # any exception of the user's code fails the run, also sys.exit
                t_failed[i] = self.times[0]
                messages.append(f"{fault_text(error)} ({_text(self, row)})")
                continue
            bad = ~np.isfinite(Y[i]).all(axis=1)
            if bad.any():
                first = int(bad.argmax())
                t_failed[i] = self.times[first]
                messages.append(f"{self._irregular(Y[i])} ({_text(self, row)})")
                Y[i, first:] = np.nan
        return Ensemble(Y, np.isnan(t_failed), t_failed, tuple(messages))

    def stream(
        self, P: Array, reduction: Reduction[S], executor: Executor | None = None, progress: Progress | None = None
    ) -> S:
        """Run samples P (N, d), reduce them in blocks, and merge the states in the order of the blocks.

        A task contains one run if runs are slow, and several runs of a block if runs are fast. The durations of earlier
        tasks determine this number. Blocks and results depend neither on the tasks nor on the executor.
        """
        P = checked_samples(self, P, progress)
        all_blocks, tasks = blocks(len(P), samples_of_block(len(P))), list[Array]()
        seconds = np.inf  # duration of a run

        def next_tasks() -> Iterator[Array]:
            for indices in all_blocks:
                begin, end = int(indices[0]), int(indices[-1]) + 1
                while begin < end:
                    # A task of fast runs takes 0.02 s. The time to send the task is small compared with this.
                    size = max(1, min(end - begin, int(0.02 / seconds))) if seconds else end - begin
                    tasks.append(P[begin : begin + size])
                    begin += size
                    yield tasks[-1]

        merging, arrived, following = Merging(reduction, progress, P), dict[int, Ensemble](), 0
        parts: list[Ensemble] = []  # parts of the next block
        for k, result in finished(partial(timed_runs, self), next_tasks(), executor):
            if isinstance(result, LostTask):
                arrived[k] = lost_runs(self, tasks[k], result.reason)
            else:
                arrived[k], seconds = result
            while (part := arrived.pop(following, None)) is not None:
                following += 1
                parts.append(part)
                indices = all_blocks[merging.count]
                if sum(len(some.ok) for some in parts) == len(indices):
                    merging.reduce(joined(parts, len(self.times), len(self.outputs)), indices)
        return merging.state

    def _irregular(self, values: Array) -> str:
        """A sentence that names the first of the values (n_t, n_y) that is not finite."""
        k, i = np.argwhere(~np.isfinite(values))[0]
        at = "" if is_timeless(self.times) else f" at t = {self.times[k]:g}"
        return f"{self.outputs[i]} is not finite{at}"

    def _shaped(self, result: Any) -> Array:
        if hasattr(result, "columns") and hasattr(result, "to_numpy"):
            result = self._columns(result)
        shape = (len(self.times), len(self.outputs))
        expected = f"expected numbers of the shape {shape} (n_t, n_y)"
        try:
            has_masked = isinstance(result, list | tuple) and any(isinstance(row, np.ma.MaskedArray) for row in result)
            values = np.asanyarray(np.ma.stack(result) if has_masked else result)
            values = values.astype(float) if values.dtype.kind in "biuf" else np.array(None)
            values = np.asarray(np.ma.filled(values, np.nan))
        except (TypeError, ValueError):  # lists of different lengths
            values = np.array(None)
        if values.dtype.kind == "O":
            raise SimulationError(f"the function returned {_short(result)}, {expected}")
        if values.shape == shape[:1] and shape[1] == 1:
            values = values[:, None]
        if shape[0] == 1 and values.shape in ((), shape[1:]):  # one time: a number, or one number for each output
            values = values.reshape(1, -1)
        if values.shape != shape:
            raise SimulationError(f"the function returned the shape {values.shape}, {expected}")
        return values

    def _columns(self, frame: Any) -> Any:
        """The outputs in a DataFrame, by their names."""
        names = list(frame.columns)
        if sorted(map(str, names)) != sorted(self.outputs):
            raise SimulationError(f"the function returned the columns {_short(names)}, expected {list(self.outputs)}")
        return frame[list(self.outputs)].to_numpy()


def samples_of_block(n: int) -> int:
    """Number of samples in a block, if n samples make at most 64 blocks. The last digits of sums depend on it."""
    return 1 + n // 64


def _noise(owner: str, noise: Mapping[str, float], names: tuple[str, ...]) -> Array:
    """Noise (n_y,) of all outputs, from the noise of some outputs by name."""
    if not isinstance(noise, Mapping):
        raise DeclarationError(f"{owner}: noise must map names of outputs to numbers, got {shown(noise)}.")
    for name, value in noise.items():
        require_name(f"{owner}: noise", "output", name, names)
        if not is_finite_number(value) or value < 0:
            raise DeclarationError(f"{owner}: noise of {name!r} must be at least 0, got {shown(value)}.")
    return np.array([float(noise.get(name, 0.0)) for name in names])


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else f"{text[:77]}..."


def _text(simulator: Simulator, p: Array) -> str:
    return values_text(simulator.parameters, p, units_of_parameters(simulator.parameters), "=")


def timed_runs(simulator: Simulator, P: Array) -> tuple[Ensemble, float]:
    """Runs of samples P (n, d), and the duration of one run [s]."""
    begin = time.perf_counter()
    ensemble = Ensemble.of(simulator.run(P))
    return ensemble, (time.perf_counter() - begin) / len(P)


def lost_runs(simulator: Simulator, P: Array, reason: str) -> Ensemble:
    """Failed runs of samples P (n, d) whose worker died."""
    Y = np.full((len(P), len(simulator.times), len(simulator.outputs)), np.nan)
    messages = tuple(f"{reason} ({_text(simulator, p)})" for p in P)
    return Ensemble(Y, np.zeros(len(P), dtype=bool), np.full(len(P), simulator.times[0]), messages)
