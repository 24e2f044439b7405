"""Runs of an FMU in a separate process, by communication steps. Model exchange uses FMPy's CVODE."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from symmb._errors import SimulationError, text_of
from symmb._magnitudes import ROUNDING, SLIGHT
from symmb._types import Array
from symmb.connect.fmu_description import CO_SIMULATION, FMU, Variable, fmpy
from symmb.connect.fmu_instance import ENDED, Instance, Status, has_error, is_fatal, last_line, listen, logged

RTOL = 1e-9
"""Relative tolerance of CVODE. It is small, because bounds follow from small differences of runs. The error of an
oscillator is then 1e-7 after ten periods (tests/connect/test_fmu.py)."""


@dataclass
class FMURunner:
    """A callable object that makes runs of an FMU, and keeps the instance of the last run.

    Attributes
    ----------
    fmu : the FMU, with its file and interface
    parameters, outputs : variables of the FMU
    times : (n_t,) output times [s]
    step : longest communication step [s]; all steps have this length if the FMU needs equal steps
    patience : if a run fails within this time [s] without a reason, it is made again with full logging. Many FMUs
        report reasons only with full logging
    """

    fmu: FMU
    parameters: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    times: Array
    step: float
    patience: float
    _instance: Instance | None = field(default=None, init=False)
    _solver: Any = field(default=None, init=False)
    _t: float = field(default=0.0, init=False)

    def __call__(self, values: Mapping[str, float], folder: Path, again: bool) -> Array:
        """Outputs (n_t, n_y) of a run with these parameters. The files of the FMU are in `folder`.

        If `again` is True and the previous run succeeded, its instance is reset. Otherwise a new instance is made.
        SimulationError is raised if the run fails.
        """
        listen()
        begin = time.perf_counter()
        try:
            return self._run(values, folder, again)
        except Exception as error:
            fault, t = error, self._t
        is_open = not isinstance(fault, SimulationError) and not has_error()
        if is_open and time.perf_counter() - begin < self.patience:
            with suppress(Exception):
                self._run(values, folder, again=False, logs=True)
        if isinstance(fault, SimulationError):  # its text is the reason
            text, reason = str(fault).rstrip("."), logged()
        else:
            name = getattr(fault, "function", None)
            text, reason = f"{name} failed" if name else text_of(fault), logged() or last_line()
        raise SimulationError(f"{text} at t = {t:g} s{': ' if reason else ''}{reason}")

    def _run(self, values: Mapping[str, float], folder: Path, again: bool, logs: bool = False) -> Array:
        instance, self._instance, self._t = self._instance, None, float(self.times[0])
        try:
            if instance is not None and not again:
                instance = instance.free()
            if instance is None:
                instance = Instance(self.fmu, folder, logs)
            else:
                instance.model.reset()
            instance.initialize(self.parameters, values, self.times)
            rows = self._outputs(instance)
        except Exception as error:
            if instance is not None and not is_fatal(error):
                instance.free()
            raise
        try:
            instance.model.terminate()
            self._instance = instance
        except Exception as error:  # the run is complete
            if not is_fatal(error):
                instance.free()
        return rows

    def _outputs(self, instance: Instance) -> Array:
        """Outputs (n_t, n_y) of an initialized instance. Communication steps lead from each output time to the next."""
        rows, read = np.empty((len(self.times), len(self.outputs))), instance.reader(self.outputs)
        step = self._cosimulate if self.fmu.fmi_type == CO_SIMULATION else self._integration(instance)
        read(rows[0])
        for k, row in enumerate(rows[1:]):
            for begin, length in self._steps(k):
                step(instance, begin, length)
            read(row)
        return rows

    def _cosimulate(self, instance: Instance, begin: float, length: float) -> None:
        self._t = begin
        instance.advance(begin, length)
        self._t = begin + length

    def _integration(self, instance: Instance) -> Callable[[Instance, float, float], None]:
        """A function that advances an instance by one communication step. Several instances use the same solver."""
        events = _EventMode(instance)
        if self._solver is None:
            self._solver = _new_solver(self.fmu, instance, self.times[0], self.step)
        else:
            self._solver.restart(instance, self.times[0])
        solver = self._solver
        return lambda instance, begin, length: self._integrate(instance, solver, events, begin + length)

    def _integrate(self, instance: Instance, solver: Any, events: "_EventMode", end: float) -> None:
        """Advance the solver and the FMU from the present time to the time `end`."""
        near, count = ROUNDING * float(np.abs(self.times).max()), 0
        while end - self._t > near or events.next - self._t <= near:
            begin = self._t
            is_event = events.next - self._t <= near
            if not is_event:
                is_event, self._t = solver.advance(self._t, min(end, events.next))
                instance.model.setTime(self._t)
                if self.fmu.tells_steps:
                    wanted, ends = instance.model.completedIntegratorStep()
                    is_event = is_event or wanted
                    if ends:
                        raise SimulationError(ENDED)
            # The solver starts again after an event, because the event makes its history of derivatives invalid.
            if is_event or events.next - self._t <= near:
                instance.model.enterEventMode()
                events.update()
                instance.model.enterContinuousTimeMode()
                solver.restart(instance, self._t)
            count = count + 1 if self._t - begin <= near else 0
            # Maximum number of events at one time. More events count as an endless sequence.
            if count > 1000:
                raise SimulationError("there are too many events at the same time")

    def _steps(self, k: int) -> Iterator[tuple[float, float]]:
        """Start times and lengths of communication steps between the times k and k + 1."""
        begin, end = self.times[k : k + 2].tolist()
        count = steps_between(begin, end, self.step)
        if self.fmu.is_uniform:
            first = round((begin - self.times[0]) / self.step)
            yield from ((float(self.times[0]) + i * self.step, self.step) for i in range(first, first + count))
        else:
            points = np.linspace(begin, end, 1 + count).tolist()
            yield from ((a, b - a) for a, b in pairwise(points))


def steps_between(begin: float, end: float, step: float) -> int:
    """Number of communication steps between two times."""
    return max(1, ceil((end - begin) / step - SLIGHT))


class _EventMode:
    """The discrete states of an FMU in event mode, and the time of its next time event."""

    def __init__(self, instance: Instance) -> None:
        self._update = (
            instance.model.newDiscreteStates if instance.version == 2 else instance.model.updateDiscreteStates
        )
        self.next = np.inf
        self.update()
        instance.model.enterContinuousTimeMode()

    def update(self) -> None:
        """Update the discrete states until they no longer change."""
        wanted = True
        while wanted:
            wanted, ends, _, _, is_planned, time = self._update()
            self.next = time if is_planned else np.inf
            if ends:
                raise SimulationError(ENDED)


def _new_solver(fmu: FMU, instance: Instance, t: float, step: float) -> Any:
    """A solver that starts at the states of an instance, and makes steps up to `step` [s].

    Several instances use the same solver, because FMPy does not free all memory of a solver.
    """

    class CVODE(fmpy("sundials").CVodeSolver):
        """CVODE that stores exceptions of its callbacks, because Python ignores them. `advance` raises them."""

        fault: Exception | None = None

        def restart(self, instance: Instance, t: float) -> None:
            """Start the solver at the time t, at the states of an instance."""
            for name, call in _callbacks(instance).items():
                setattr(self, name, call)
            self.reset(t)

        def advance(self, t: float, end: float) -> tuple[bool, float]:
            """Advance to the time `end`. Return whether an event indicator changed its sign, and the time reached."""
            self.fault = self.error_info = None
            try:
                is_event, _, reached = self.step(t, end)
            except Exception as error:
                reason = self.error_info[3] if self.error_info else str(error)
                raise self.fault or SimulationError(f"CVODE stops: {reason}") from None
            return is_event, reached

        def f(self, *arguments: Any) -> int:
            return self._tried(super().f, arguments)

        def g(self, *arguments: Any) -> int:
            return self._tried(super().g, arguments)

        def _tried(self, call: Any, arguments: tuple[Any, ...]) -> int:
            try:
                return call(*arguments)
            except Exception as error:
                self.fault = error
                return (
                    1 if getattr(error, "status", None) == Status.DISCARD else -1
                )  # 1: tried again with a smaller step

    return CVODE(
        nx=fmu.n_states,
        nz=fmu.n_indicators,
        **_callbacks(instance),
        input=SimpleNamespace(apply=lambda *_: None),  # inputs keep their values
        startTime=t,
        maxStep=step,
        relativeTolerance=RTOL,
        maxNumSteps=1_000_000,  # FMPy's default of 500 is too small for this tolerance
    )


def _callbacks(instance: Instance) -> dict[str, Any]:
    model = instance.model
    return {
        "get_x": model.getContinuousStates,
        "set_x": model.setContinuousStates,
        "get_dx": model.getDerivatives if instance.version == 2 else model.getContinuousStateDerivatives,
        "get_z": model.getEventIndicators,
        "get_nominals": model.getNominalsOfContinuousStates,
        "set_time": model.setTime,
    }
