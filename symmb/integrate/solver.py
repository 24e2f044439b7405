"""Solvers of the index-reduced DAE, on CasADi's integrators and compiled step loops."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array
from symmb.events import longest_step
from symmb.integrate.fixed_step import collocation, fixed_step_integration
from symmb.integrate.integration import Integration, multistep_integration, projection
from symmb.integrate.marching import Advance
from symmb.integrate.problem import Problem, build_problem, stabilized_problem
from symmb.integrate.stabilization import Stabilization
from symmb.model import DAE


class Solver(ABC):
    """What integrates a DAE; a frozen value whose fields are its options."""

    limits: ClassVar[dict[str, tuple[float, float]]] = {}
    """Where an option may lie, ends included; the others are above 0."""

    @abstractmethod
    def integration(self, dae: DAE, times: Array, *, order: int = 0, work: bool = False) -> Integration:
        """The compiled integration over the given times, of the Taylor coefficients up to `order`."""

    @abstractmethod
    def tighter(self, factor: float = 10.0) -> "Solver":
        """The same solver with tolerances `factor` times smaller, or steps as much smaller as that takes."""

    def __post_init__(self) -> None:
        faults = []
        for f in fields(self):  # pyright: ignore[reportArgumentType]
            value = getattr(self, f.name)
            low, high = self.limits.get(f.name, (0.0, np.inf))
            if f.name == "stabilization":
                if not isinstance(value, Stabilization):
                    known = "Baumgarte(...), Projection(), AugmentedLagrangian(...) or None"
                    faults.append(f"stabilization={value!r} is none: use {known}")
            elif isinstance(value, bool) or (value is None and f.default is None):
                continue
            elif not isinstance(value, int | float | np.number) or not (
                low < value < high or value in self.limits.get(f.name, ())
            ):
                within = f"from {low:g} to {high:g}" if f.name in self.limits else "above 0"
                faults.append(f"{f.name}={value!r} must be a number {within}")
        if faults:
            raise DeclarationError("\n".join(f"{type(self).__name__}: {fault}." for fault in faults))

    def __repr__(self) -> str:
        plain = type(self)()
        shown = [f.name for f in fields(self) if getattr(self, f.name) != getattr(plain, f.name)]  # pyright: ignore[reportArgumentType]
        return f"{type(self).__name__}({', '.join(f'{name}={getattr(self, name)!r}' for name in shown)})"


class _Multistep(Solver):
    plugin: ClassVar[str]
    algebraic: ClassVar[bool] = False
    stabilization: Stabilization

    @abstractmethod
    def options(self, length: float, size: float) -> dict[str, Any]:
        """CasADi's options for an integration over a time of this length, of a motion of this size."""

    def integration(self, dae: DAE, times: Array, *, order: int = 0, work: bool = False) -> Integration:
        problem = build_problem(dae, self.stabilization, algebraic=self.algebraic, work=work).jets(order)
        size, longest = dae.scales.size, longest_step(dae, times)
        return multistep_integration(problem, self.plugin, lambda length: self.options(length, size), times, longest)


@dataclass(frozen=True, repr=False)
class IDAS(_Multistep):
    """Variable-order BDF on the index-1 DAE, multipliers as algebraic variables (SUNDIALS).

    Parameters
    ----------
    rtol : float             relative tolerance
    atol : float             absolute tolerance, rtol / 100 of the motion's size if left out [m, rad, m/s, rad/s]
    stabilization            None, Baumgarte(...), Projection() or AugmentedLagrangian(...)
    """

    plugin: ClassVar[str] = "idas"
    algebraic: ClassVar[bool] = True

    rtol: float = 1e-11
    atol: float | None = None
    stabilization: Stabilization = None

    def options(self, length: float, size: float) -> dict[str, Any]:
        return _tolerances(self.rtol, self.atol, size)

    def tighter(self, factor: float = 10.0) -> "IDAS":
        return replace(self, rtol=self.rtol / factor, atol=None if self.atol is None else self.atol / factor)


@dataclass(frozen=True, repr=False)
class StabilizedIndex2(Solver):
    """Variable-order BDF on the stabilised index-2 form (SUNDIALS): positions and velocities are kept to the tolerance.

    Parameters
    ----------
    rtol : float             relative tolerance
    atol : float             absolute tolerance, rtol / 100 of the motion's size if left out [m, rad, m/s, rad/s]
    """

    rtol: float = 1e-8
    atol: float | None = None

    def integration(self, dae: DAE, times: Array, *, order: int = 0, work: bool = False) -> Integration:
        if order:
            raise DeclarationError(
                "StabilizedIndex2 gives no derivatives along the run: use another solver for Taylor."
            )
        problem = stabilized_problem(dae, work=work)
        # Multipliers of index 2 are left out of all tests: their errors do not fall with the step, and they are what
        # positions and velocities ask for. A first step that has to be cut too often ends the run.
        options = {**_tolerances(self.rtol, self.atol, dae.scales.size), "suppress_algebraic": True, "calc_ic": False}
        atol = options.pop("abstol")
        options["abstolv"] = [atol] * problem.x.numel() + [_UNTESTED] * problem.z.numel()
        first = 1e-3 * self.rtol**0.5 * float(np.diff(times).min(initial=1.0))
        return multistep_integration(
            problem,
            "idas",
            lambda length: {**options, "step0": min(first, 1e-3 * self.rtol**0.5 * length)},
            times,
            longest_step(dae, times),
        )

    def tighter(self, factor: float = 10.0) -> "StabilizedIndex2":
        return replace(self, rtol=self.rtol / factor, atol=None if self.atol is None else self.atol / factor)


@dataclass(frozen=True, repr=False)
class CVODES(_Multistep):
    """Variable-order multistep method on the ODE with multipliers eliminated (SUNDIALS).

    Parameters
    ----------
    rtol : float             relative tolerance
    atol : float             absolute tolerance, rtol / 100 of the motion's size if left out [m, rad, m/s, rad/s]
    stiff : bool             BDF with Newton iterations in place of Adams with fixed-point iterations
    stabilization            None, Baumgarte(...), Projection() or AugmentedLagrangian(...)
    """

    plugin: ClassVar[str] = "cvodes"

    rtol: float = 1e-11
    atol: float | None = None
    stiff: bool = False
    stabilization: Stabilization = None

    def options(self, length: float, size: float) -> dict[str, Any]:
        method = {} if self.stiff else {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"}
        # Shorter steps get lost in rounding: the run is in a singularity, which it would creep into for long.
        return {**_tolerances(self.rtol, self.atol, size), **method, "min_step_size": 1e-14 * length}

    def tighter(self, factor: float = 10.0) -> "CVODES":
        return replace(self, rtol=self.rtol / factor, atol=None if self.atol is None else self.atol / factor)


class OneStep(Solver):
    """Fixed steps between output times."""

    algebraic: ClassVar[bool] = False
    steps: int
    stabilization: Stabilization

    @abstractmethod
    def advance(self, problem: Problem) -> Advance:
        """The compiled step."""

    def integration(self, dae: DAE, times: Array, *, order: int = 0, work: bool = False) -> Integration:
        problem = build_problem(dae, self.stabilization, algebraic=self.algebraic, work=work, one_step=True).jets(order)
        length = float(times[-1] - times[0]) / self.steps
        return fixed_step_integration(self.advance(problem), times, length, projection(problem))


@dataclass(frozen=True, repr=False)
class Collocation(OneStep):
    """Radau collocation with a fixed step on the index-1 DAE, multipliers as algebraic variables.

    Parameters
    ----------
    degree : int             collocation points a step; the order is 2 degree - 1
    steps : int              over the whole horizon; at least one for each output time
    stabilization            None, Baumgarte(...), Projection() or AugmentedLagrangian(...)
    """

    algebraic: ClassVar[bool] = True

    degree: int = 4
    steps: int = 1000
    stabilization: Stabilization = None

    def advance(self, problem: Problem) -> Advance:
        return collocation(problem, self.degree)

    def tighter(self, factor: float = 10.0) -> "Collocation":
        return replace(self, steps=int(np.ceil(self.steps * factor ** (1 / (2 * self.degree - 1)))))


_UNTESTED = 1e10
"""Absolute tolerance of what is not to be tested [N, N m, -]."""


def _tolerances(rtol: float, atol: float | None, size: float) -> dict[str, Any]:
    return {
        "reltol": rtol,
        "abstol": size * rtol / 100 if atol is None else atol,
        "quad_err_con": True,
        "disable_internal_warnings": True,
    }
