"""Solvers on CasADi's integrators: SUNDIALS' multistep methods, and Radau collocation."""

from abc import abstractmethod
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np

from symmb._types import Array
from symmb.codegen import Tolerances
from symmb.integrate.fixed_step import collocation, fixed_step_integration
from symmb.integrate.integration import Integration
from symmb.integrate.multistep import multistep_integration
from symmb.integrate.problem import Problem, build_problem
from symmb.integrate.solver import Solver
from symmb.integrate.stabilization import Baumgarte, Projection, Stabilization
from symmb.integrate.stabilized_index2 import stabilized_problem
from symmb.model import DAE

UNTESTED = 1e10
"""Absolute tolerance of variables that take no part in error tests [N, N m, -]: above any value that occurs."""
SHORTEST_STEP = 1e-14
"""Shortest step over the horizon: shorter ones are lost in rounding. tests/integrate/test_failures.py"""
FIRST_STEP = 1e-3
"""First step of index 2, over sqrt(rtol) and the horizon: a longer one is rejected too often for SUNDIALS to go on."""


class _Multistep(Solver):
    """A variable-order method of SUNDIALS on the index-1 DAE, or on the ODE without multipliers."""

    plugin: ClassVar[str]
    algebraic: ClassVar[bool]
    rtol: float
    stabilization: Stabilization

    @abstractmethod
    def _method(self, length: float) -> dict[str, Any]:
        """CasADi's options beside the tolerances, for an integration over a time of this length."""

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        def problem_of(dae: DAE) -> Problem:
            return build_problem(dae, self.stabilization, algebraic=self.algebraic, work=work)

        options, units = _measures(self.tolerances(dae, order))
        return multistep_integration(
            problem_of,
            dae,
            self.plugin,
            lambda _, length: options | self._method(length),
            times,
            self.rtol,
            units,
            order,
        )


@dataclass(frozen=True, repr=False)
class IDAS(_Multistep):
    """Variable-order BDF on the index-1 DAE, multipliers as algebraic variables (SUNDIALS).

    Parameters
    ----------
    rtol : float             relative tolerance
    atol : float             absolute tolerance, rtol / 100 of the motion's size if left out [m, rad, m/s, rad/s]
    stabilization            None, Baumgarte(...) or Projection()
    """

    plugin: ClassVar[str] = "idas"
    algebraic: ClassVar[bool] = True
    stabilizations: ClassVar[tuple[type, ...]] = (Baumgarte, Projection)

    rtol: float = 1e-11
    atol: float | None = None
    stabilization: Stabilization = None

    def _method(self, length: float) -> dict[str, Any]:
        return {}


@dataclass(frozen=True, repr=False)
class CVODES(_Multistep):
    """Variable-order multistep method on the ODE with multipliers eliminated (SUNDIALS).

    Parameters
    ----------
    rtol : float             relative tolerance
    atol : float             absolute tolerance, rtol / 100 of the motion's size if left out [m, rad, m/s, rad/s]
    stiff : bool             BDF with Newton iterations instead of Adams with fixed-point iterations
    stabilization            None, Baumgarte(...), Projection() or AugmentedLagrangian(...)
    """

    plugin: ClassVar[str] = "cvodes"
    algebraic: ClassVar[bool] = False

    rtol: float = 1e-11
    atol: float | None = None
    stiff: bool = False
    stabilization: Stabilization = None

    def _method(self, length: float) -> dict[str, Any]:
        adams = {} if self.stiff else {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"}
        # A run that reaches a singularity would otherwise creep into it with ever shorter steps.
        return {**adams, "min_step_size": SHORTEST_STEP * length}


@dataclass(frozen=True, repr=False)
class StabilizedIndex2(Solver):
    """Variable-order BDF on the stabilised index-2 form (SUNDIALS): positions and velocities are kept to the tolerance.

    Parameters
    ----------
    rtol : float             relative tolerance
    atol : float             absolute tolerance, rtol / 100 of the motion's size if left out [m, rad, m/s, rad/s]
    """

    keeps_positions: ClassVar[bool] = True
    gives_derivatives: ClassVar[bool] = False

    rtol: float = 1e-8
    atol: float | None = None

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        options, units = _measures(self.tolerances(dae))
        # Errors of index-2 multipliers do not fall with the step, so multipliers take no part in error tests.
        atol = options.pop("abstol")
        options |= {"suppress_algebraic": True, "calc_ic": False}
        first = FIRST_STEP * self.rtol**0.5
        between = first * float(np.diff(times).min(initial=1.0))

        def of_problem(problem: Problem, length: float) -> dict[str, Any]:
            absolute = [atol] * problem.x.numel() + [UNTESTED] * problem.z.numel()
            return {**options, "abstolv": absolute, "step0": min(between, first * length)}

        return multistep_integration(
            partial(stabilized_problem, work=work), dae, "idas", of_problem, times, self.rtol, units
        )


@dataclass(frozen=True, repr=False)
class Collocation(Solver):
    """Radau collocation with a fixed step on the index-1 DAE, multipliers as algebraic variables.

    Parameters
    ----------
    degree : int             collocation points a step; the order is 2 degree - 1
    steps : int              over the whole horizon; at least one for each output time
    stabilization            None, Baumgarte(...) or Projection()
    """

    stabilizations: ClassVar[tuple[type, ...]] = (Baumgarte, Projection)

    degree: int = 4
    steps: int = 1000
    stabilization: Stabilization = None

    @property
    def order(self) -> float:
        return 2 * self.degree - 1

    @property
    def controls_step(self) -> bool:
        return False

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        problem = build_problem(dae, self.stabilization, algebraic=True, work=work, one_step=True).jets(order)
        step = float(times[-1] - times[0]) / self.steps
        return fixed_step_integration(collocation(problem, self.degree), times, step, problem.projection())


def _measures(tolerances: Tolerances) -> tuple[dict[str, Any], Array | None]:
    """Options for tolerances, and units (n_x,) of states in which one absolute tolerance holds for all of them."""
    sizes = np.array(tolerances.sizes or (1.0,))
    size = float(sizes.max())
    # The integral of the power takes part in error tests: without, CasADi's quadratures can be far off.
    options = {"reltol": tolerances.rtol, "abstol": tolerances.atol * size, "quad_err_con": True}
    return options | {"disable_internal_warnings": True}, None if (sizes == size).all() else sizes / size
