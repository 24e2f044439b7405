"""Solvers that use CasADi's integrators: the multistep methods of SUNDIALS, and Radau collocation."""

from abc import abstractmethod
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np

from symmb._limits import MOST_STEPS_KEPT, require_steps
from symmb._types import Array
from symmb.declare.symbolic import has_kinks
from symmb.equations.model import DAE
from symmb.run import integrate
from symmb.run.codegen import StepTolerances
from symmb.run.integrate.initial_value_problem import InitialValueProblem, build_problem
from symmb.run.integrate.integration import Integration
from symmb.run.integrate.multistep import multistep_integration
from symmb.run.integrate.solver import Solver
from symmb.run.integrate.stabilization import AugmentedLagrangian, Baumgarte, Projection, Stabilization


class _Multistep(Solver):
    """A variable-order method of SUNDIALS on the index-1 DAE, or on the ODE without multipliers."""

    plugin: ClassVar[str]
    algebraic: ClassVar[bool]
    rtol: float
    stabilization: Stabilization

    @abstractmethod
    def _method(self, options: dict[str, Any], problem: InitialValueProblem, length: float) -> dict[str, Any]:
        """CasADi's options for an integration over a time `length` [s]. `options` are the options for tolerances."""

    def has_dense_output(self, dae: DAE) -> bool:
        return not isinstance(self.stabilization, Projection) and not has_kinks(dae.rhs) and dae.sampling is None

    def independent_integration(self, dae: DAE, times: Array, of_state: bool = False) -> Integration:
        """An integration in which step control alone follows switches of the state.

        With `of_state`, steps also end at switches that DormandPrince locates, so that short pulses are not missed.
        """
        return self._integration(dae, times, 0, False, independent=True, of_state=of_state)

    def _integration(self, dae: DAE, times: Array, order: int, work: bool, **options: bool) -> Integration:
        def problem_of(dae: DAE) -> InitialValueProblem:
            return build_problem(dae, self.stabilization, algebraic=self.algebraic, work=work)

        tolerances, units = _measures(self.tolerances(dae, order, int(work and dae.power is not None)))
        method = partial(self._method, tolerances)
        return multistep_integration(problem_of, dae, self.plugin, method, times, self.rtol, units, order, **options)


@dataclass(frozen=True, repr=False)
class IDAS(_Multistep):
    """Variable-order BDF on the index-1 DAE, with multipliers as algebraic variables (SUNDIALS).

    Parameters
    ----------
    rtol, atol : float
        relative and absolute tolerance, see `CVODES`
    stabilization
        None, Baumgarte(...) or Projection()

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> system = mb.System(bob, mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0))
    >>> mb.simulate(mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0]), mb.IDAS(rtol=1e-9))["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])
    """

    plugin: ClassVar[str] = "idas"
    algebraic: ClassVar[bool] = True
    stabilizations: ClassVar[tuple[type, ...]] = (Baumgarte, Projection)

    rtol: float = 1e-11
    atol: float | None = None
    stabilization: Stabilization = None

    def _method(self, options: dict[str, Any], problem: InitialValueProblem, length: float) -> dict[str, Any]:
        return _with_multipliers(options, problem)


@dataclass(frozen=True, repr=False)
class CVODES(_Multistep):
    """Variable-order multistep method on the ODE without multipliers (SUNDIALS).

    Parameters
    ----------
    rtol : float
        relative tolerance
    atol : float
        absolute tolerance [m, rad, m/s, rad/s]; default: rtol / 100 times the size of the motion
    stiff : bool
        BDF with Newton iterations instead of Adams with fixed-point iterations
    stabilization
        None, Baumgarte(...), Projection() or AugmentedLagrangian(...)

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> system = mb.System(bob, mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0))
    >>> mb.simulate(mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0]), mb.CVODES())["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])
    """

    plugin: ClassVar[str] = "cvodes"
    algebraic: ClassVar[bool] = False

    rtol: float = 1e-11
    atol: float | None = None
    stiff: bool = False
    stabilization: Stabilization = None

    @property
    def takes_any_coordinates(self) -> bool:
        return not isinstance(self.stabilization, AugmentedLagrangian)

    def _method(self, options: dict[str, Any], problem: InitialValueProblem, length: float) -> dict[str, Any]:
        adams = {} if self.stiff else {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"}
        # Shortest step divided by the horizon. Shorter steps are lost in rounding. Without a limit, a run that
        # approaches a singularity would take shorter and shorter steps. tests/integrate/test_failures.py
        return {**options, **adams, "min_step_size": 1e-14 * length}


@dataclass(frozen=True, repr=False)
class StabilizedIndex2(Solver):
    """Variable-order BDF on the stabilised index-2 form (SUNDIALS). Positions and velocities satisfy the constraints.

    Parameters
    ----------
    rtol, atol : float
        relative and absolute tolerance, see `CVODES`

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> system = mb.System(bob, mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0))
    >>> mb.simulate(mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0]), mb.StabilizedIndex2())["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])
    """

    keeps_positions: ClassVar[bool] = True
    gives_derivatives: ClassVar[bool] = False

    rtol: float = 1e-8
    atol: float | None = None

    def has_dense_output(self, dae: DAE) -> bool:
        return not has_kinks(dae.rhs) and dae.sampling is None

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        options, units = _measures(self.tolerances(dae, n_quad=int(work and dae.power is not None)))
        # IDAS computes no consistent rates at index 2. With rates of zero, IDAS shortens the first step until the
        # motion in this step is within the tolerance.
        # First step of index 2, divided by rtol and by the time of the fastest motion at the start. SUNDIALS may reject
        # a first step ten times, and divides it by four each time. So the first step may be a million times too long
        # after a restart.
        first = 1e-3 * self.rtol / dae.scales.rate

        def method(problem: InitialValueProblem, length: float) -> dict[str, Any]:
            return _with_multipliers(options, problem) | {"calc_ic": False}

        problem_of = partial(integrate.stabilized_problem, work=work)
        return multistep_integration(problem_of, dae, "idas", method, times, self.rtol, units, first=first)


@dataclass(frozen=True, repr=False)
class Collocation(Solver):
    """Radau collocation with a fixed step on the index-1 DAE, with multipliers as algebraic variables.

    Parameters
    ----------
    degree : int
        number of collocation points in a step, at most 9; the order is 2 degree - 1
    steps : int
        number of steps over the whole horizon; each output interval has at least one step
    stabilization
        None, Baumgarte(...) or Projection()

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> system = mb.System(bob, mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0))
    >>> mb.simulate(mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0]), mb.Collocation(steps=20))["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])
    """

    limits: ClassVar[dict[str, tuple[float, float]]] = {"degree": (1, 9)}
    stabilizations: ClassVar[tuple[type, ...]] = (Baumgarte, Projection)
    begins_anew: ClassVar[bool] = True

    degree: int = 4
    steps: int = 1000
    stabilization: Stabilization = None

    @property
    def order(self) -> float:
        return 2 * self.degree - 1

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        problem = build_problem(dae, self.stabilization, algebraic=True, work=work, one_step=True).jets(order)
        require_steps(self, self.steps, MOST_STEPS_KEPT)
        step = self.fixed_step(times)
        return integrate.fixed_step_integration(
            integrate.collocation(problem, self.degree), times, step, problem.projection()
        )


def _with_multipliers(options: dict[str, Any], problem: InitialValueProblem) -> dict[str, Any]:
    """The options of IDAS for a problem with multipliers as unknowns."""
    # Absolute tolerance of multipliers [N, N m, -]. It is above all values that occur, so that error tests ignore
    # multipliers. At index 2 the errors of multipliers do not decrease with the step. At index 1 steps would be
    # rejected because of rounding of multipliers, and a run would take 100 times as many steps.
    tolerances = [options["abstol"]] * problem.x.numel() + [1e10] * problem.z.numel()
    # Rows of constraints are small in comparison with rows of short steps. CasADi's own QR factorisation, which has no
    # pivoting, is not accurate then.
    return options | {"abstolv": tolerances, "suppress_algebraic": True, "linear_solver": "csparse"}


def _measures(tolerances: StepTolerances) -> tuple[dict[str, Any], Array | None]:
    """Options for tolerances, and units (n_x + n_quad,) of states and integrals, for which one tolerance suffices."""
    sizes = np.array(tolerances.sizes or (1.0,))
    size = float(sizes.max())
    # Error tests include the integral of the power. Otherwise CasADi's quadratures can have large errors.
    options = {"reltol": tolerances.rtol, "abstol": tolerances.atol * size, "quad_err_con": True}
    return options | {"disable_internal_warnings": True}, None if (sizes == size).all() else sizes / size
