"""A solver for impacts: steps of the Dormand-Prince pair from event to event."""

from dataclasses import dataclass, replace
from typing import ClassVar, cast

import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array
from symmb.equations.model import DAE
from symmb.run.codegen import Engine, Lanes, StepTolerances, require_compiler
from symmb.run.integrate.compiled import Task, impacts_text
from symmb.run.integrate.explicit import DormandPrince, Explicit
from symmb.run.integrate.integration import Integration
from symmb.run.integrate.stabilization import Projection, Stabilization


@dataclass(frozen=True, repr=False)
class EventDriven(Explicit):
    """Explicit pair of order 8 with steps that end at events of an `Impact`, `Release`, `Latch` or `Clutch`.

    The interpolant of a step gives the time of an event, exact up to rounding. The steps of each sample are
    independent. After every step, positions and velocities are projected onto the constraints and onto closed contacts.
    At the time of an event, outputs have their values after the event.

    Parameters
    ----------
    rtol, atol : float
        relative and absolute tolerance, see `CVODES`

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", 1.0, pose=mb.Particle())
    >>> floor = mb.Impact("floor", gap=ball.y, restitution=0.8)
    >>> scene = mb.Scene(mb.System(ball, floor, mb.Gravity(0, -10.0)), {"ball.y": 1.25}, [0.0, 1.0])
    >>> mb.simulate(scene, mb.EventDriven())["ball.y"].round(6)
    array([1.25, 0.75])

    References
    ----------
    Hairer, Norsett, Wanner (1993), Solving Ordinary Differential Equations I, section II.6. Acary, Brogliato (2008),
    Numerical Methods for Nonsmooth Dynamical Systems, chapter 8.
    """

    meets_switches: ClassVar[bool] = True
    locates_events: ClassVar[bool] = True
    takes_any_coordinates: ClassVar[bool] = False
    stabilization: ClassVar[Stabilization] = Projection()
    projection_steps: ClassVar[int] = 1

    rtol: float = 1e-10
    atol: float | None = None

    def runs_in_lanes(self, dae: DAE) -> bool:
        return dae.impacts is not None

    def has_dense_output(self, dae: DAE) -> bool:
        return True

    def step_control(self, dae: DAE, times: Array, order: int = 0, n_quad: int = 0) -> StepTolerances:
        return replace(self.tolerances(dae, order, n_quad), growth=0.0, least=1.0, ahead=0.0)

    def lanes(self, task: Task) -> Lanes:
        if task.order and task.dae.impacts is not None:
            raise PropagationError(
                f"Derivatives with respect to parameters cannot be integrated across the events of "
                f"{impacts_text(task.dae.impacts)}. Use Taylor() of order 1 to 3, PolynomialChaos(), Scanning(...) or "
                "MonteCarlo(...)."
            )
        return super().lanes(task)

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        if dae.impacts is None:
            require_compiler(repr(self))
            return DormandPrince(self.rtol, self.atol).integration(dae, times, order=order, work=work)
        return super()._integration(dae, times, order, work)


def round_otherwise(engine: Engine, other: Engine) -> None:
    """Limit the steps of an engine to less than the mean step of the last run of another engine."""
    control, span = cast(StepTolerances, engine.control), float(np.ptp(engine.times))
    # Longest step of a check run, divided by the mean step of the checked run. It is not a simple fraction, so that
    # rounding errors differ.
    longest = min(control.longest or np.inf, 0.37 * span / max(other.counts.steps, 1))
    engine.control = replace(control, longest=longest)
