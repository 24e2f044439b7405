"""Solvers whose steps are compiled for many samples side by side, explicit ones among them."""

from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import ClassVar

import casadi as ca
import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array
from symmb.codegen import ArrayEngine, Engine, FixedStep, Tolerances, has_compiler, model_function
from symmb.events import longest_step
from symmb.integrate.fixed_step import explicit
from symmb.integrate.integration import Integration, Run
from symmb.integrate.marching import Advance
from symmb.integrate.problem import Problem, build_problem
from symmb.integrate.solver import CVODES, OneStep, Solver
from symmb.integrate.stabilization import Projection, Stabilization
from symmb.model import DAE
from symmb.start import Start

AnyEngine = Engine | ArrayEngine


class CompiledSolver(Solver):
    """Steps that the engine takes for many samples side by side."""

    @abstractmethod
    def control(self, times: Array, size: float) -> Tolerances | FixedStep:
        """What the engine is told about steps."""

    @abstractmethod
    def engine(
        self,
        dae: DAE,
        times: Array,
        y: ca.Function,
        *,
        order: int = 0,
        work: bool = False,
        start: Start | None = None,
    ) -> AnyEngine:
        """The runs, compiled if possible; y (x, p, t) are the outputs, followed by the work done if asked for.

        With an order, x and p are those of the Taylor coefficients, see `Problem.jets`. With a start, compiled runs of
        scenes that are not large begin there by themselves; without, all are given their states.
        """

    def available(self, dae: DAE) -> bool:
        """Whether the engine takes these steps here."""
        return has_compiler()

    def limited(self, dae: DAE, times: Array) -> Tolerances | FixedStep:
        """What the engine is told about steps, those with control so short that none passes over a pulse."""
        control = self.control(times, dae.scales.size)
        if isinstance(control, FixedStep):
            return control
        longest = min(longest_step(dae, times), control.longest or np.inf)
        return replace(control, longest=longest if np.isfinite(longest) else 0.0)


class _Explicit(CompiledSolver):
    stabilization: Stabilization
    projections: ClassVar[int] = 3
    """Newton steps of a projection."""

    def engine(
        self,
        dae: DAE,
        times: Array,
        y: ca.Function,
        *,
        order: int = 0,
        work: bool = False,
        start: Start | None = None,
    ) -> AnyEngine:
        problem = build_problem(
            dae, self.stabilization, algebraic=False, work=work, one_step=True, projections=self.projections
        ).jets(order)
        outputs = y(problem.x, problem.p, problem.t)
        n_x = problem.x.numel()
        x = ca.SX.sym("x", n_x + problem.quad.numel())  # what is integrated along is a state like others
        projected = problem.projected

        def at(expression: ca.SX) -> ca.SX:
            return ca.substitute(expression, problem.x, x[:n_x])

        compiled = has_compiler()
        f = model_function(
            x,
            problem.p,
            problem.t,
            ca.vertcat(at(problem.ode), at(problem.quad)),
            ca.vertcat(at(outputs), x[n_x:]),
            None if projected is None else ca.vertcat(at(projected), x[n_x:]),
            start.equations(x, problem.p) if start is not None and compiled and start.compiles else None,
        )
        control = self.limited(dae, times)
        if isinstance(control, Tolerances) and not compiled:
            return ArrayEngine(f, times, control)
        return Engine(f, times, control)


@dataclass(frozen=True, repr=False)
class DormandPrince(_Explicit):
    """Pair of order 8 with step control and dense output, compiled for many samples side by side.

    Without a C compiler the same steps are taken with NumPy, some 30 times slower. Samples share a step in blocks of 8,
    fixed by sample index. With `Projection()` positions and velocities are moved onto the constraints after every step.

    Parameters
    ----------
    rtol : float             relative tolerance
    atol : float             absolute tolerance, rtol / 100 of the motion's size if left out [m, rad, m/s, rad/s]
    stabilization            None, Baumgarte(...), Projection() or AugmentedLagrangian(...)

    References
    ----------
    Hairer, Norsett, Wanner (1993), Solving Ordinary Differential Equations I, section II.5 and code DOP853.
    """

    projections: ClassVar[int] = 1  # after every step the drift is small

    rtol: float = 1e-8
    atol: float | None = None
    stabilization: Stabilization = field(default_factory=Projection)

    def available(self, dae: DAE) -> bool:
        return True

    def control(self, times: Array, size: float) -> Tolerances:
        return Tolerances(self.rtol, size * self.rtol / 100 if self.atol is None else self.atol)

    def integration(self, dae: DAE, times: Array, *, order: int = 0, work: bool = False) -> Integration:
        n_x = (dae.n_q + dae.n_v + dae.n_s) * (order + 1)
        if not n_x:
            return CVODES().integration(dae, times, order=order, work=work)
        return CompiledIntegration(self, dae, times, order, work)

    def tighter(self, factor: float = 10.0) -> "DormandPrince":
        return replace(self, rtol=self.rtol / factor, atol=None if self.atol is None else self.atol / factor)


@dataclass(frozen=True, repr=False)
class RungeKutta(OneStep, _Explicit):
    """Classical fourth-order Runge-Kutta with a fixed step on the ODE with multipliers eliminated.

    Compiled for many samples side by side where there is a C compiler.

    Parameters
    ----------
    steps : int              over the whole horizon; at least one for each output time
    stabilization            None, Baumgarte(...), Projection() or AugmentedLagrangian(...) at the output times
    """

    steps: int = 2500
    stabilization: Stabilization = None

    def control(self, times: Array, size: float) -> FixedStep:
        return FixedStep(float(times[-1] - times[0]) / self.steps)

    def advance(self, problem: Problem) -> Advance:
        return explicit(problem)

    def tighter(self, factor: float = 10.0) -> "RungeKutta":
        return replace(self, steps=int(np.ceil(self.steps * factor**0.25)))


class CompiledIntegration(Integration):
    """States of runs by the engine; `stepwise` gives the single steps of a scheme with a fixed step, if it is one."""

    def __init__(
        self,
        solver: CompiledSolver,
        dae: DAE,
        times: Array,
        order: int,
        work: bool,
        stepwise: Callable[[], Integration] | None = None,
    ) -> None:
        n_x, n_p = (dae.n_q + dae.n_v + dae.n_s) * (order + 1), len(dae.p_names) * (2 if order else 1)
        x, p, t = ca.SX.sym("x", n_x), ca.SX.sym("p", n_p), ca.SX.sym("t")
        self._engine = solver.engine(dae, times, ca.Function("states", [x, p, t], [x]), order=order, work=work)
        self.times, self.n_x, self.n_quad = times, n_x, self._engine.n_y - n_x
        self._stepwise = stepwise

    def run(self, x0: Array, p: Array, threads: int = 1) -> list[Run]:
        x0 = np.hstack([x0, np.zeros((len(x0), self.n_quad))])
        Y, failed_samples = self._engine.values(x0, p, threads)
        return [
            Run(y[:, : self.n_x], y[:, self.n_x :], t, "" if np.isnan(t) else why)
            for y, t, why in zip(Y, failed_samples.t_failed.tolist(), failed_samples.reasons, strict=True)
        ]

    def march(self, x0: Array, p: Array) -> Iterator[tuple[int, Array]]:
        if self._stepwise is None:
            raise PropagationError("Lockstep needs a solver with a fixed step, such as RungeKutta().")
        yield from self._stepwise().march(x0, p)

    def statistics(self) -> dict[str, int]:
        counts = self._engine.counts
        counted = {"steps": counts.steps, "nonlinear iterations": counts.iterations, "most in a step": counts.most}
        return {name: count for name, count in counted.items() if count}
