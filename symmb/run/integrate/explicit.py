"""Explicit solvers on the ODE without multipliers.

The steps are made by compiled loops in `codegen/c/embedded_pair.h` and `codegen/c/fixed_step.h`.
"""

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, cast

import casadi as ca
import numpy as np

from symmb._limits import MOST_STEPS_KEPT, require_steps
from symmb._types import Array
from symmb.declare.symbolic import instructions
from symmb.equations.model import DAE, LAST_ENGINE
from symmb.equations.start import Start
from symmb.run import integrate
from symmb.run.codegen import Engine, Lanes, StepEnds, model_function
from symmb.run.integrate.compiled import CompiledSolver, Task
from symmb.run.integrate.initial_value_problem import PROJECTION_STEPS, InitialValueProblem, build_problem
from symmb.run.integrate.integration import Integration
from symmb.run.integrate.stabilization import AugmentedLagrangian, Projection, Stabilization
from symmb.run.integrate.step_ends import SwitchedProblem, stops_in_time, switched
from symmb.run.schemes import CLASSICAL

if TYPE_CHECKING:
    from symmb.run.codegen import Card


class Explicit(CompiledSolver):
    """A solver with explicit steps, compiled for many samples in parallel."""

    stabilization: Stabilization
    projection_steps: ClassVar[int] = PROJECTION_STEPS
    """Number of Newton steps of a projection."""

    @property
    def takes_any_coordinates(self) -> bool:
        return not isinstance(self.stabilization, AugmentedLagrangian)

    @abstractmethod
    def has_dense_output(self, dae: DAE) -> bool: ...

    def engine(self, task: Task, card: "Card | None" = None) -> Engine:
        if card is not None:
            return super().engine(task, card)
        # The last engine of a DAE is used at other tolerances too, because large models take seconds.
        dae, times, y, *others = task
        outputs = instructions(y).identity()
        key = type(self), self.stabilization, times.tobytes(), dae.p_nominal.tobytes(), outputs, *others
        if dae.memory.get(LAST_ENGINE, ((), None))[0] != key:
            dae.memory[LAST_ENGINE] = key, super().engine(task)
        engine = dae.memory[LAST_ENGINE][1].at(times)
        n_x = (dae.n_q + dae.n_v + dae.n_s) * (task.order + 1)
        engine.control = self.limited_control(dae, times, task.order, engine.n_x - n_x)
        return engine

    def lanes(self, task: Task) -> Lanes:
        dae, times, y, order, work, start, alone = task
        # One run integrates the power, and a study does not. Both have the same equations, which are compiled once.
        has_power = dae.power is not None and dae.impacts is None and not order and not alone
        problem = build_problem(
            dae,
            self.stabilization,
            algebraic=False,
            work=work or has_power,
            one_step=True,
            projections=self.projection_steps,
        ).jets(order)
        of_time = stops_in_time(dae, times) if alone else None
        linear = None if of_time is None else of_time.switches.linear
        frozen = self._switched(problem, task, of_time is not None and linear is None)
        contacts = None
        if dae.impacts is not None:
            # The engine receives the states at the start. Python has projected them onto closed contacts.
            contacts, start = integrate.contacts_of(dae, dae.impacts, work), start if alone else None
            frozen = integrate.with_gaps(frozen, dae, dae.impacts, work)
        own, problem = problem.p, frozen.problem
        # At the time of an event, outputs have their values after the event.
        outputs = y(problem.x if contacts is None else cast(ca.SX, problem.projected), own, problem.t)
        control = self.limited_control(dae, times, order, problem.quad.numel() if work else 0)
        n_x = problem.x.numel()
        x = ca.SX.sym("x", n_x + problem.quad.numel())  # an integral along the motion is a state like the others
        p = problem.p[: len(dae.p_names)]  # without the sides of switches

        def at(expression: ca.SX) -> ca.SX:
            return ca.substitute(expression, problem.x, x[:n_x, :])

        f = model_function(
            x,
            problem.p,
            problem.t,
            ca.vertcat(at(problem.ode), at(problem.quad)),
            ca.vertcat(at(outputs), x[n_x:, :]) if work else at(outputs),
            None if problem.projected is None else ca.vertcat(at(problem.projected), x[n_x:, :]),
            _compiled_start(start, dae, p, float(np.ptp(times)), alone),
            at(frozen.switches),
            None if dae.impacts is None else integrate.contact_functions(dae, dae.impacts, x, problem.p, problem.t),
            None if frozen.ranged is None else at(frozen.ranged),
            ca.vertcat(*linear[0](p)) if linear else None,
        )
        knots = tuple(linear[1]) if linear else ()
        return Lanes(f, control, None, frozen.ends, contacts, knots, power=work if has_power else None)

    def _switched(self, problem: InitialValueProblem, task: Task, of_time: bool) -> SwitchedProblem:
        """The problem with the switches at which steps end. Fixed steps do not end at switches. Steps of Taylor
        coefficients end at switches of time only."""
        if self.controls_step and not task.order:
            return switched(problem, task.dae, task.times, of_time)
        stops = stops_in_time(task.dae, task.times) if self.controls_step else None
        return SwitchedProblem(problem, ends=StepEnds(stops=stops))


def _compiled_start(
    start: Start | None, dae: DAE, p: ca.SX, span: float, alone: bool
) -> tuple[ca.SX, ca.SX, ca.SX] | None:
    """The equations of a start that the engine computes; None if the states are given."""
    if start is None or not (alone or start.compiles):
        return None
    u, newton, state = start.equations(p)
    if dae.impacts is not None:
        state = integrate.started(dae, dae.impacts, state, p, start.t0, span)
    return u, newton, state


@dataclass(frozen=True, repr=False)
class DormandPrince(Explicit):
    """Embedded pair of order 8 with step control and dense output, compiled for many samples in parallel.

    Blocks of 8 successive samples have the same steps. With `Projection()`, positions and velocities are projected onto
    the constraints after every step. Steps end at switches of forces or of functions of time, such as `if_else`, `fabs`
    and `fmax`, even if the motion passes a switch twice within a step. Steps also end where `exp`, `tanh`, `erf` or
    `cosh` of positions or of time is steep, so that smooth pulses of these functions are not missed.

    Parameters
    ----------
    rtol, atol, stabilization
        options of the same names in `CVODES`

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> system = mb.System(bob, mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0))
    >>> mb.simulate(mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0]), mb.DormandPrince())["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])

    References
    ----------
    Hairer, Norsett, Wanner (1993), Solving Ordinary Differential Equations I, section II.5 and code DOP853.
    """

    meets_switches: ClassVar[bool] = True
    projection_steps: ClassVar[int] = 1  # the drift of one step is small

    rtol: float = 1e-8
    atol: float | None = None
    stabilization: Stabilization = field(default_factory=Projection)

    def has_dense_output(self, dae: DAE) -> bool:
        return True


@dataclass(frozen=True, repr=False)
class RungeKutta(Explicit):
    """Classical Runge-Kutta method of order 4 with a fixed step, compiled for many samples in parallel.

    Parameters
    ----------
    steps : int
        number of steps over the whole horizon; each output interval has at least one step
    stabilization
        None, Baumgarte(...), Projection() or AugmentedLagrangian(...) at the output times

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> system = mb.System(bob, mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0))
    >>> mb.simulate(mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0]), mb.RungeKutta(steps=200))["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])
    """

    order: ClassVar[float] = 4
    needs_compiler: ClassVar[bool] = False
    begins_anew: ClassVar[bool] = True

    steps: int = 2500
    stabilization: Stabilization = None

    def has_dense_output(self, dae: DAE) -> bool:
        return False

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        problem = build_problem(dae, self.stabilization, algebraic=False, work=work, one_step=True).jets(order)
        require_steps(self, self.steps, MOST_STEPS_KEPT)
        return integrate.fixed_step_integration(
            integrate.explicit_steps(problem, CLASSICAL), times, self.fixed_step(times), problem.projection()
        )
