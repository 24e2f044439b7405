"""CVODE of FMPy for FMUs for model exchange, and the events of these."""

from typing import Any, Protocol

import numpy as np

from symmb._errors import SimulationError
from symmb.simulation.fmu_description import FMU, fmpy
from symmb.simulation.fmu_instance import DISCARD, ENDED, Instance

RTOL = 1e-9
"""Relative tolerance: bounds subtract runs that differ little. An oscillator is then exact to 1e-7 after ten periods
(tests/simulation/test_fmu.py)."""
_MOST_STEPS = 1_000_000
"""Steps between two communication points. FMPy's 500 are too few for this tolerance."""


class Solver(Protocol):
    """FMPy's solver, which outlives instances, for FMPy does not free all that it takes."""

    def restart(self, instance: Instance, t: float) -> None:
        """Begin at the states of an instance."""
        ...

    def advance(self, t: float, end: float) -> tuple[bool, float]:
        """Go on to a time. Returns whether an event indicator changed its sign, and the time then."""
        ...


class Events:
    """The discrete states of an FMU in event mode, and the time at which the FMU wants to be there again."""

    def __init__(self, instance: Instance) -> None:
        self._update = (
            instance.model.newDiscreteStates if instance.version == 2 else instance.model.updateDiscreteStates
        )
        self.next = np.inf
        self.update()
        instance.model.enterContinuousTimeMode()

    def update(self) -> None:
        """Update the discrete states until they stay."""
        wanted = True
        while wanted:
            wanted, ends, _, _, is_planned, time = self._update()
            self.next = time if is_planned else np.inf
            if ends:
                raise SimulationError(ENDED)


class _NoInputs:
    """The FMU's inputs over time: they stay what they were set to."""

    def apply(self, *_: Any) -> None:
        pass


def new_solver(fmu: FMU, instance: Instance, t: float, step: float) -> Solver:
    """A solver at the states of an instance, whose steps are not longer than `step` [s]."""

    class CVODE(fmpy("sundials").CVodeSolver):
        """Python drops what callbacks of C raise: it is kept, and raised by `advance`."""

        fault: Exception | None = None

        def restart(self, instance: Instance, t: float) -> None:
            for name, call in _callbacks(instance).items():
                setattr(self, name, call)
            self.reset(t)

        def advance(self, t: float, end: float) -> tuple[bool, float]:
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
                return 1 if getattr(error, "status", None) == DISCARD else -1  # 1: tried again with a smaller step

    return CVODE(
        nx=fmu.n_states,
        nz=fmu.n_indicators,
        **_callbacks(instance),
        input=_NoInputs(),
        startTime=t,
        maxStep=step,
        relativeTolerance=RTOL,
        maxNumSteps=_MOST_STEPS,
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
