"""Implicit schemes as solvers, compiled for many samples side by side."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import casadi as ca

from symmb._errors import PropagationError
from symmb._types import Array
from symmb.codegen import Engine, FixedStep, Scheme, Tolerances, has_compiler, scheme_function
from symmb.integrate.explicit import CompiledIntegration, CompiledSolver
from symmb.integrate.fixed_step import fixed_step_integration, implicit
from symmb.integrate.integration import Integration
from symmb.integrate.problem import build_problem
from symmb.integrate.rosenbrock_step import rosenbrock
from symmb.integrate.stabilization import AugmentedLagrangian, Stabilization
from symmb.model import DAE
from symmb.schemes import Step, generalized_alpha, nstiff_si2
from symmb.start import Start

_FULL = 12
"""Velocities up to which a full matrix costs no more than a sparse one."""


_LARGE = 300
"""Velocities beyond which compilers take minutes."""


class _Stepping(CompiledSolver):
    """Steps of a scheme given in symbols; each with Newton's method, to a share of the motion's size."""

    @property
    def newton(self) -> float:
        """Largest change of unknowns, over their sizes, at which Newton's method ends."""
        return 0.0

    def available(self, dae: DAE) -> bool:
        return has_compiler() and dae.n_v <= _LARGE

    @abstractmethod
    def formula(self, dae: DAE, order: int, work: bool) -> Step:
        """The scheme, of the Taylor coefficients up to `order`."""

    def engine(
        self,
        dae: DAE,
        times: Array,
        y: ca.Function,
        *,
        order: int = 0,
        work: bool = False,
        start: Start | None = None,
    ) -> Engine:
        step = self.formula(dae, order, work)
        w, n_x = step.w, step.n_x
        state, control = w[:n_x], self.limited(dae, times)
        change, counted = step.newton()
        of_state = [step.x, state]
        f = scheme_function(
            w,
            step.z,
            step.p,
            step.t,
            step.h,
            history=ca.substitute(step.begin, *of_state),
            guess=step.guess,
            correct=ca.vertcat(change, counted),
            follow=ca.vertcat(step.following, step.error) if isinstance(control, Tolerances) else step.following,
            outputs=ca.vertcat(y(state, step.p, step.t), w[n_x : n_x + step.n_quad]),
            projected=None if step.projected is None else ca.substitute(step.projected, *of_state),
            start=start.equations(state, step.p) if start is not None and start.compiles else None,
        )
        scheme = Scheme(w.numel(), step.z.numel(), step.order, step.growth, self.newton)
        return Engine(f, times, control, scheme)

    def integration(self, dae: DAE, times: Array, *, order: int = 0, work: bool = False) -> Integration:
        def stepwise() -> Integration:
            control = self.control(times, dae.scales.size)
            if isinstance(control, Tolerances):
                raise PropagationError(
                    f"{self!r} controls its step, which needs a C compiler, up to {_LARGE} velocities and no lockstep: "
                    "give it a step in the place of a tolerance."
                )
            step = self.formula(dae, order, work)
            project = None
            if step.projected is not None:
                project = ca.Function("project", [step.x, step.p, step.t], [step.projected], {"cse": True})
            return fixed_step_integration(implicit(step), times, control.longest, project)

        if self.available(dae) and dae.n_v:
            return CompiledIntegration(self, dae, times, order, work, stepwise)
        return stepwise()


@dataclass(frozen=True, repr=False)
class Rosenbrock(_Stepping):
    """RODAS, order 4, L-stable, on the index-1 DAE: stiff motion without iterations.

    Parameters
    ----------
    rtol : float             relative tolerance
    atol : float             absolute tolerance, rtol / 100 of the motion's size if left out [m, rad, m/s, rad/s]
    step : float             a fixed step in the place of tolerances, if given [s]
    stabilization            None, Baumgarte(...), Projection() or AugmentedLagrangian(...)

    References
    ----------
    Hairer, Wanner (1996), Solving Ordinary Differential Equations II, section IV.7 and code RODAS.
    """

    rtol: float = 1e-7
    atol: float | None = None
    step: float | None = None
    stabilization: Stabilization = None

    def formula(self, dae: DAE, order: int, work: bool) -> Step:
        # Without multipliers errors are smaller, but the matrix of all velocities is full.
        keeps = dae.n_v > _FULL and not isinstance(self.stabilization, AugmentedLagrangian)
        return rosenbrock(build_problem(dae, self.stabilization, algebraic=keeps, work=work, one_step=True).jets(order))

    def control(self, times: Array, size: float) -> Tolerances | FixedStep:
        if self.step is not None:
            return FixedStep(self.step)
        return Tolerances(self.rtol, size * self.rtol / 100 if self.atol is None else self.atol)

    def tighter(self, factor: float = 10.0) -> "Rosenbrock":
        if self.step is not None:
            return replace(self, step=self.step / factor**0.25)
        return replace(self, rtol=self.rtol / factor, atol=None if self.atol is None else self.atol / factor)


class _Implicit(_Stepping):
    step: float
    tolerance: float

    @property
    def newton(self) -> float:
        return self.tolerance

    @abstractmethod
    def scheme(self, dae: DAE, work: bool) -> Step:
        """The scheme as a symbolic step."""

    def formula(self, dae: DAE, order: int, work: bool) -> Step:
        return self.scheme(dae, work).jets(order)

    def control(self, times: Array, size: float) -> Tolerances | FixedStep:
        return FixedStep(self.step)

    def tighter(self, factor: float = 10.0) -> Self:
        return replace(self, step=self.step / factor**0.5)  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True, repr=False)
class NSTIFFSI2(_Implicit):
    """Second-order BDF on the stabilised index-2 form, the paper's solver (see `schemes.nstiff_si2`).

    Parameters
    ----------
    step : float             longest step [s]
    rtol : float             relative tolerance of steps that are shorter where errors ask for it; fixed if left out
    tolerance : float        of Newton's method, largest change of the state over its size
    """

    step: float = 5e-3
    rtol: float | None = None
    tolerance: float = 1e-8

    def scheme(self, dae: DAE, work: bool) -> Step:
        return nstiff_si2(dae, work)

    def control(self, times: Array, size: float) -> Tolerances | FixedStep:
        return FixedStep(self.step) if self.rtol is None else Tolerances(self.rtol, size * self.rtol / 100, self.step)

    def tighter(self, factor: float = 10.0) -> "NSTIFFSI2":
        if self.rtol is not None:
            return replace(self, rtol=self.rtol / factor)
        return replace(self, step=self.step / factor**0.5)


@dataclass(frozen=True, repr=False)
class BDFI3(_Implicit):
    """Second-order BDF on the index-3 form: positions alone are kept, velocities follow to the error of the step.

    Parameters
    ----------
    step : float             longest step [s]
    tolerance : float        of Newton's method, largest displacement over the motion's size
    """

    step: float = 1e-3
    tolerance: float = 1e-12

    def scheme(self, dae: DAE, work: bool) -> Step:
        return nstiff_si2(dae, work, stabilized=False)


@dataclass(frozen=True, repr=False)
class Newmark(_Implicit):
    """Newmark's method on the index-3 form, of first order: gamma above 1/2 damps what the constraints excite.

    Parameters
    ----------
    step : float             longest step [s]
    gamma : float            damping, 1/2 (trapezoidal rule, none) to 1
    tolerance : float        of Newton's method, largest displacement over the motion's size
    """

    limits: ClassVar = {"gamma": (0.5, 1.0)}

    step: float = 1e-3
    gamma: float = 0.6
    tolerance: float = 1e-13

    def scheme(self, dae: DAE, work: bool) -> Step:
        return generalized_alpha(dae, work, alpha_m=0.0, alpha_f=0.0, gamma=self.gamma)

    def tighter(self, factor: float = 10.0) -> "Newmark":
        return replace(self, step=self.step / factor)


@dataclass(frozen=True, repr=False)
class GeneralizedAlpha(_Implicit):
    """Generalised-alpha on the index-3 form (see `schemes.generalized_alpha`).

    Parameters
    ----------
    step : float             longest step [s]
    rho : float              spectral radius at infinite frequency, 1 (no damping) to 0
    tolerance : float        of Newton's method, largest displacement over the motion's size
    """

    limits: ClassVar = {"rho": (0.0, 1.0)}

    step: float = 1e-3
    rho: float = 0.8
    tolerance: float = 1e-13

    def scheme(self, dae: DAE, work: bool) -> Step:
        return generalized_alpha(
            dae, work, alpha_m=(2 * self.rho - 1) / (self.rho + 1), alpha_f=self.rho / (self.rho + 1)
        )


@dataclass(frozen=True, repr=False)
class HHT(_Implicit):
    """Hilber-Hughes-Taylor (HHT-I3) on the index-3 form.

    Parameters
    ----------
    step : float             longest step [s]
    alpha : float            damping, 0 (trapezoidal rule) to 1/3
    tolerance : float        of Newton's method, largest displacement over the motion's size
    """

    limits: ClassVar = {"alpha": (0.0, 1 / 3)}

    step: float = 1e-3
    alpha: float = 0.1
    tolerance: float = 1e-13

    def scheme(self, dae: DAE, work: bool) -> Step:
        return generalized_alpha(dae, work, alpha_m=0.0, alpha_f=self.alpha)
