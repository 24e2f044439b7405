"""The base class of solvers. Solvers are frozen objects, and their fields are options."""

import math
from abc import ABC, abstractmethod
from dataclasses import Field, fields, replace
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np

from symmb._errors import DeclarationError, PropagationError
from symmb._limits import require_steps
from symmb._options import is_finite_number, is_real, is_whole, python_number, require_truth, shown
from symmb._types import Array
from symmb.equations.model import DAE
from symmb.run import integrate
from symmb.run.codegen import StepTolerances, with_compiler
from symmb.run.integrate.cells import interval_steps
from symmb.run.integrate.integration import Integration, stateless_integration
from symmb.run.integrate.stabilization import AugmentedLagrangian, Baumgarte, Projection

_LEAST_RTOL = 1e-15
"""Smallest relative tolerance, about the relative rounding error of numbers."""


class Solver(ABC):
    """An integration method for the index-reduced DAE.

    Subclasses are frozen dataclasses. Class attributes declare what a solver can do.
    """

    limits: ClassVar[dict[str, tuple[float, float]]] = {}
    """Name of an option -> its range, ends included. Numbers of other options must be above 0."""
    keeps_positions: ClassVar[bool] = False
    """Whether the method itself satisfies Phi = 0 after every step."""
    stabilizations: ClassVar[tuple[type, ...]] = (Baumgarte, Projection, AugmentedLagrangian)
    """Types of the option `stabilization`, besides None."""
    locates_events: ClassVar[bool] = False
    """Whether steps end at impacts."""
    meets_switches: ClassVar[bool] = False
    """Whether the solver itself locates switches of the state. Steps of other solvers end at switches that a run of
    DormandPrince locates."""
    begins_anew: ClassVar[bool] = False
    """Whether fixed steps start again at each output time, although only the state is stored there."""
    needs_compiler: ClassVar[bool] = False
    """Whether single runs are compiled too, if `runs_in_lanes` is true."""
    gives_derivatives: ClassVar[bool] = True
    """Whether Taylor coefficients of the motion can be integrated."""

    @property
    def takes_any_coordinates(self) -> bool:
        """Whether the solver needs only accelerations, so that coordinates of joints can replace those of bodies."""
        return False

    @property
    def order(self) -> float:
        """Order of the method with a fixed step: the error is proportional to step**order."""
        return 2

    @property
    def controls_step(self) -> bool:
        """Whether tolerances determine the step."""
        return getattr(self, "rtol", None) is not None

    def runs_in_lanes(self, dae: DAE) -> bool:
        """Whether the engine of `codegen` can run many samples of this DAE in parallel with this solver."""
        return False

    def has_dense_output(self, dae: DAE) -> bool:
        """Whether the state at output times is interpolated, so that output times do not change the steps."""
        return False

    def integration(self, dae: DAE, times: Array, *, order: int = 0, work: bool = False) -> Integration:
        """The compiled integration of one DAE.

        Parameters
        ----------
        times : (n_t,) array
            output times [s]
        order : int
            number of the highest Taylor coefficient along a line of parameters
        work : bool
            whether the power of forces without potential is integrated too [J]

        Raises
        ------
        PropagationError
            If the solver cannot compute the Taylor coefficients, or there are too many steps
        """
        self.require_affordable(times)
        if order and not self.gives_derivatives:
            raise PropagationError(
                f"{self!r} gives no derivatives along the run. Use another solver for Taylor, such as DormandPrince()."
            )
        if not dae.n_v + dae.n_s:
            return stateless_integration(dae, times, order)
        make = partial(self._integration, dae, times, order, work)
        return with_compiler(make, make)  # without a compiler, the same call makes another integration

    def require_affordable(self, times: Array) -> None:
        """Raise PropagationError if there are too many steps of a fixed length over the times (n_t,)."""
        horizon = float(times[-1] - times[0])
        require_steps(self, self._values.get("steps") or horizon / (self._values.get("step") or math.inf))

    def fixed_step(self, times: Array) -> float:
        """The longest fixed step [s] for output times (n_t,). Steps are shortened so that they end at output times."""
        return self._values.get("step") or float(times[-1] - times[0]) / self._values["steps"]

    @abstractmethod
    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration: ...

    def tolerances(self, dae: DAE, order: int = 0, n_quad: int = 0) -> StepTolerances:
        """Step control by the options `rtol` and `atol`. By default, atol is rtol / 100 times the size of each state.

        Tolerances are for states (n_x,), their Taylor coefficients up to `order`, and `n_quad` integrals along the
        motion. Tolerances of coefficients do not depend on their values, which may be 0 until they jump at a kink.
        """
        rtol: float = self.rtol  # pyright: ignore[reportAttributeAccessIssue]
        atol: float | None = getattr(self, "atol", None)
        if atol is not None:
            return StepTolerances(rtol, atol)
        sizes = [*np.tile(dae.state_sizes, order + 1).tolist(), *[dae.scales.work] * n_quad]
        # Smallest size of a state, divided by the size of its part of the scene. Above it, absolute tolerances are
        # proportional to the size. It rises with 1e-12 / rtol, because balanced forces cause rounding in states that do
        # not move.
        least = 1.0 if order else min(1.0, max(1e-2, 1e-12 / rtol))
        # Slopes at the start predict later sizes over this time, divided by the time of the fastest part. Without the
        # prediction, runs from rest take seven more steps, with lengths that depend on rounding.
        # tests/codegen/test_c_files.py
        ahead = 1.0 / dae.scales.rate
        return StepTolerances(rtol, rtol / 100, sizes=tuple(sizes), growth=rtol / 100, least=least, ahead=ahead)

    def tighter(self, factor: float = 10.0, times: Array | None = None) -> Self:
        """The same solver with options that make errors about `factor` times smaller.

        Output times limit fixed steps. If the times (n_t,) [s] are given, steps between them become shorter.
        """
        values = self._values
        changes: dict[str, Any] = {}
        if self.controls_step:
            changes = {name: values[name] / factor for name in ("rtol", "atol") if values.get(name)}
            if "rtol" in changes:
                changes["rtol"] = max(changes["rtol"], 2 * _LEAST_RTOL)
        shorter = factor ** (1 / self.order)
        horizon = 1.0 if times is None else float(times[-1] - times[0])
        if "steps" in values:
            taken = _longest_taken(horizon / values["steps"], times)
            changes["steps"] = int(np.ceil(shorter * horizon / taken - 1e-9))
        elif values.get("step"):
            changes["step"] = _longest_taken(values["step"], times) / shorter
        return replace(self, **changes)  # pyright: ignore[reportArgumentType]

    @property
    def _values(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}  # pyright: ignore[reportArgumentType]

    def step_taken(self, times: Array) -> float:
        """The longest step for output times (n_t,) if steps have a fixed length [s]; 0 otherwise."""
        if self.controls_step or len(times) < 2:
            return 0.0
        return _longest_taken(self.fixed_step(times), times)

    def __post_init__(self) -> None:
        faults = []
        for f in fields(self):  # pyright: ignore[reportArgumentType]
            value = getattr(self, f.name)
            value = python_number(value) if is_real(value) else value
            object.__setattr__(self, f.name, value)
            fault = self._stabilization_fault(value) if f.name == "stabilization" else self._fault(f, value)
            faults += [fault] if fault else []
        if faults:
            raise DeclarationError("\n".join(f"{type(self).__name__}: {fault}." for fault in faults))

    def _stabilization_fault(self, value: object) -> str:
        if value is None or isinstance(value, self.stabilizations):
            return ""
        if isinstance(value, AugmentedLagrangian):
            return "AugmentedLagrangian(...) is for solvers that eliminate the multipliers: use CVODES()"
        allowed = ", ".join(f"{kind.__name__}(...)" for kind in self.stabilizations)
        return f"stabilization={value!r} is not a stabilization: use {allowed} or None"

    def _fault(self, option: Field, value: Any) -> str:
        """The reason why an option cannot have a value; an empty text if it can."""
        name, counts = option.name, isinstance(option.default, int)
        if isinstance(option.default, bool):
            require_truth(type(self).__name__, name, value)
            return ""
        if value is None and option.default is None:
            return ""
        if counts and is_real(value) and not is_whole(value):
            return f"{name}={value!r} must be an integer"
        low, high = self.limits.get(name, _LIMITS.get(name, (0.0, np.inf)))
        if (is_finite_number(value) or (counts and is_whole(value))) and (
            low < value < high or value in self.limits.get(name, ())
        ):
            return ""
        below = f" and below {high:g}" if high < np.inf else ""
        within = f"from {low:g} to {high:g}" if name in self.limits else f"above {low:g}{below}"
        return f"{name}={shown(value)} must be a number {within}"

    def __repr__(self) -> str:
        default = type(self)()
        options = [f.name for f in fields(self) if getattr(self, f.name) != getattr(default, f.name)]  # pyright: ignore[reportArgumentType]
        return f"{type(self).__name__}({', '.join(f'{name}={getattr(self, name)!r}' for name in options)})"


_LIMITS = {"rtol": (_LEAST_RTOL, 1.0), "atol": (1e-30, np.inf), "tolerance": (0.0, 1.0)}
"""Ranges of options that several solvers have. With a tolerance of 1, Newton's method would stop at once. If absolute
tolerances are too small, the sum of the squares of their weights is not finite, and SUNDIALS does not stop."""


def _longest_taken(step: float, times: Array | None) -> float:
    """The longest step that is taken between output times, for a given longest step."""
    if times is None or len(times) < 2:
        return step
    return float((np.diff(times) / interval_steps(times, step)).max())


def solver_of(solver: object) -> Solver | None:
    """The given solver, or the solver that a text such as "cvodes:1e-8" names. Other values raise DeclarationError."""
    if isinstance(solver, str):
        return integrate.read_solver(solver)
    if isinstance(solver, type):
        raise DeclarationError(f"solver: got the class {solver.__name__}; call it, as in CVODES() or HHT(step=1e-3).")
    if solver is not None and not isinstance(solver, Solver):
        raise DeclarationError(f"solver: {shown(solver)} is not a Solver; give an object such as CVODES(rtol=1e-9).")
    return solver
