"""Rosenbrock, and the base of implicit schemes as solvers, compiled for many samples in parallel."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from symmb._errors import DeclarationError, PropagationError
from symmb._types import Array
from symmb.declare.symbolic import common, has_kinks
from symmb.equations.model import DAE
from symmb.run import integrate, schemes
from symmb.run.codegen import Lanes, Scheme, StepEnds, StepTolerances, scheme_function
from symmb.run.integrate.compiled import CompiledIntegration, CompiledSolver, Task
from symmb.run.integrate.initial_value_problem import build_problem
from symmb.run.integrate.integration import Integration
from symmb.run.integrate.projection import sampled_jets
from symmb.run.integrate.stabilization import AugmentedLagrangian, Stabilization
from symmb.run.integrate.step_ends import StopsInTime, stops_in_time
from symmb.run.integrate.switch_passes import SwitchPasses

MOST_VELOCITIES = 300
"""Maximum number of velocities. For more velocities, a C compiler needs minutes to compile a Newton matrix.
tests/benchmarks/scaling.py"""


class SchemeSolver(CompiledSolver):
    """A solver with symbolic steps of a scheme, which Newton's method solves."""

    tolerance: float = 0.0  # tolerance of Newton's method; 0 for schemes without iterations

    def runs_in_lanes(self, dae: DAE) -> bool:
        return dae.n_v <= MOST_VELOCITIES

    @abstractmethod
    def scheme(self, dae: DAE, order: int, work: bool) -> "schemes.Step":
        """The symbolic step for Taylor coefficients up to `order`."""

    def lanes(self, task: Task) -> Lanes:
        dae, times, y, order, work, start, alone = task
        if alone and has_kinks(dae.rhs):
            raise DeclarationError(
                f"{self!r} cannot end its steps at the kinks and jumps of this scene without Python. Prepare the scene "
                "with DormandPrince()."
            )
        compiled = start if start is not None and (alone or start.compiles) else None
        step = self.scheme(dae, order, work)
        w, n_x = step.w, step.n_x
        state, control = w[:n_x], self.limited_control(dae, times, order, 0)
        change, tested_change = step.newton()
        at_state = [step.x, state]
        fresh = sampled_jets(dae, state, step.p, step.t, order)  # steps start again at switches and instants
        begin, past_work = ca.substitute(step.begin, step.x, fresh), slice(n_x, n_x + step.n_quad)
        begin[past_work, :] = w[past_work, :]
        f = scheme_function(
            w,
            step.z,
            step.p,
            step.t,
            step.h,
            history=begin,
            guess=step.guess,
            correct=ca.vertcat(change, tested_change),
            follow=ca.vertcat(step.following, step.error) if isinstance(control, StepTolerances) else step.following,
            outputs=ca.vertcat(y(state, step.p, step.t), w[past_work, :]),
            projected=None if step.projected is None else ca.substitute(step.projected, *at_state),
            start=None if compiled is None else compiled.equations(step.p),
        )
        scheme = Scheme(w.numel(), step.z.numel(), step.order, step.growth, self.tolerance)
        stops: StopsInTime | SwitchPasses | None = None
        if alone:
            stops = stops_in_time(dae, times)
        elif isinstance(control, StepTolerances):
            stops = SwitchPasses(dae, times, control.rtol, compiled)
        return Lanes(f, control, scheme, StepEnds(stops=stops))

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        def fixed_steps() -> Integration:
            control = self.step_control(dae, times)
            if isinstance(control, StepTolerances):
                raise PropagationError(
                    f"{self!r} controls its step. This is possible for at most {MOST_VELOCITIES} velocities, and not "
                    "in lockstep. Give a fixed step instead of a tolerance."
                )
            step = self.scheme(dae, order, work)
            project = None
            if step.projected is not None:
                project = common("project", [step.x, step.p, step.t], [step.projected])
            return integrate.fixed_step_integration(integrate.implicit_steps(step), times, control.longest, project)

        if self.runs_in_lanes(dae):
            return CompiledIntegration(self, dae, times, order, work, fixed_steps)
        return fixed_steps()


@dataclass(frozen=True, repr=False)
class Rosenbrock(SchemeSolver):
    """RODAS, an L-stable method of order 4 without iterations on the index-1 DAE, for stiff motion.

    Parameters
    ----------
    rtol, atol, stabilization
        options of the same names in `CVODES`
    step : float
        fixed step [s], used instead of tolerances if given

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> system = mb.System(bob, mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0))
    >>> mb.simulate(mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0]), mb.Rosenbrock())["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])

    References
    ----------
    Hairer, Wanner (1996), Solving Ordinary Differential Equations II, section IV.7 and code RODAS.
    """

    order: ClassVar[float] = 4

    rtol: float = 1e-7
    atol: float | None = None
    step: float | None = None
    stabilization: Stabilization = None

    @property
    def controls_step(self) -> bool:
        return self.step is None

    def scheme(self, dae: DAE, order: int, work: bool) -> "schemes.Step":
        # Without multipliers, errors are smaller, but the matrix of all velocities is full.
        # Largest number of velocities for which a full Newton matrix takes no more time than a sparse one.
        # tests/benchmarks/latency.py
        algebraic = dae.n_v > 12 and not isinstance(self.stabilization, AugmentedLagrangian)
        problem = build_problem(dae, self.stabilization, algebraic=algebraic, work=work, one_step=True)
        return integrate.rosenbrock(problem.jets(order))
