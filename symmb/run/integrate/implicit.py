"""Implicit schemes as solvers, compiled for many samples in parallel."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import casadi as ca

from symmb._errors import DeclarationError, PropagationError
from symmb._types import Array
from symmb.declare.symbolic import common, has_kinks
from symmb.equations.model import DAE
from symmb.run import integrate, schemes
from symmb.run.codegen import FixedStep, Lanes, Scheme, StepEnds, StepTolerances, scheme_function
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


class _SchemeSolver(CompiledSolver):
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
            return integrate.fixed_step_integration(integrate.implicit(step), times, control.longest, project)

        if self.runs_in_lanes(dae):
            return CompiledIntegration(self, dae, times, order, work, fixed_steps)
        return fixed_steps()


@dataclass(frozen=True, repr=False)
class Rosenbrock(_SchemeSolver):
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


class _PositionScheme(_SchemeSolver):
    """A scheme with a fixed step, after which positions satisfy their constraints."""

    keeps_positions: ClassVar[bool] = True
    step: float

    @abstractmethod
    def formula(self, dae: DAE, work: bool) -> "schemes.Step":
        """The symbolic step of the scheme."""

    def scheme(self, dae: DAE, order: int, work: bool) -> "schemes.Step":
        return self.formula(dae, work).jets(order)


@dataclass(frozen=True, repr=False)
class NSTIFFSI2(_PositionScheme):
    """Second-order BDF on the stabilised index-2 form (Wang and Yang 2021, see `schemes.nstiff_si2`).

    Parameters
    ----------
    step : float
        longest step [s]
    rtol : float
        relative tolerance of a step control with steps up to `step`; default: fixed steps
    tolerance : float
        tolerance of Newton's method: largest change of the state, divided by the size of the state

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> system = mb.System(bob, mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0))
    >>> mb.simulate(mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0]), mb.NSTIFFSI2(step=1e-3))["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])
    """

    step: float = 5e-3
    rtol: float | None = None
    tolerance: float = 1e-8

    def formula(self, dae: DAE, work: bool) -> "schemes.Step":
        return schemes.nstiff_si2(dae, work)

    def step_control(self, dae: DAE, times: Array, order: int = 0, n_quad: int = 0) -> StepTolerances | FixedStep:
        return replace(super().step_control(dae, times, order, n_quad), longest=self.step)


@dataclass(frozen=True, repr=False)
class BDFI3(_PositionScheme):
    """Second-order BDF on the index-3 form. Positions satisfy the constraints. Velocities have small violations.

    Parameters
    ----------
    step : float
        longest step [s]
    tolerance : float
        tolerance of Newton's method: largest displacement, divided by the size of the motion

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> system = mb.System(bob, mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0))
    >>> mb.simulate(mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0]), mb.BDFI3(step=1e-3))["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])
    """

    step: float = 1e-3
    tolerance: float = 1e-12

    def formula(self, dae: DAE, work: bool) -> "schemes.Step":
        return schemes.nstiff_si2(dae, work, stabilized=False)


class _AlphaScheme(_PositionScheme):
    """A method of the generalised-alpha family on the index-3 form. `coefficients` define the method."""

    @abstractmethod
    def coefficients(self) -> tuple[float, float, float]:
        """The coefficients alpha_m, alpha_f and gamma of `schemes.generalized_alpha`."""

    def formula(self, dae: DAE, work: bool) -> "schemes.Step":
        return schemes.generalized_alpha(dae, work, *self.coefficients())


@dataclass(frozen=True, repr=False)
class Newmark(_AlphaScheme):
    """Newmark's method on the index-3 form. A gamma above 1/2 damps high frequencies and gives order 1.

    Parameters
    ----------
    step, tolerance : float
        options of the same names in `BDFI3`
    gamma : float
        damping, from 1/2 (trapezoidal rule, no damping) to 1

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> system = mb.System(bob, mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0))
    >>> solver = mb.Newmark(step=1e-3, gamma=0.5)
    >>> mb.simulate(mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0]), solver)["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])
    """

    limits: ClassVar = {"gamma": (0.5, 1.0)}
    order: ClassVar[float] = 1

    step: float = 1e-3
    gamma: float = 0.6
    tolerance: float = 1e-13

    def coefficients(self) -> tuple[float, float, float]:
        return 0.0, 0.0, self.gamma


@dataclass(frozen=True, repr=False)
class GeneralizedAlpha(_AlphaScheme):
    """Generalised-alpha on the index-3 form (see `schemes.generalized_alpha`).

    Parameters
    ----------
    step, tolerance : float
        options of the same names in `BDFI3`
    rho : float
        spectral radius at infinite frequency, from 1 (no damping) to 0

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> system = mb.System(bob, mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0))
    >>> mb.simulate(mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0]), mb.GeneralizedAlpha(step=1e-3))["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])
    """

    limits: ClassVar = {"rho": (0.0, 1.0)}

    step: float = 1e-3
    rho: float = 0.8
    tolerance: float = 1e-13

    def coefficients(self) -> tuple[float, float, float]:
        alpha_m, alpha_f = (2 * self.rho - 1) / (self.rho + 1), self.rho / (self.rho + 1)
        return alpha_m, alpha_f, 0.5 + alpha_f - alpha_m


@dataclass(frozen=True, repr=False)
class HHT(_AlphaScheme):
    """Hilber-Hughes-Taylor (HHT-I3) on the index-3 form.

    Parameters
    ----------
    step, tolerance : float
        options of the same names in `BDFI3`
    alpha : float
        damping, from 0 (trapezoidal rule, no damping) to 1/3

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> system = mb.System(bob, mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0))
    >>> mb.simulate(mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0]), mb.HHT(step=1e-3))["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])
    """

    limits: ClassVar = {"alpha": (0.0, 1 / 3)}

    step: float = 1e-3
    alpha: float = 0.1
    tolerance: float = 1e-13

    def coefficients(self) -> tuple[float, float, float]:
        return 0.0, self.alpha, 0.5 + self.alpha
