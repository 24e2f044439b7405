"""Implicit schemes with fixed steps after which positions satisfy their constraints, as solvers."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

from symmb._types import Array
from symmb.equations.model import DAE
from symmb.run import schemes
from symmb.run.codegen import FixedStep, StepTolerances
from symmb.run.integrate.implicit import SchemeSolver


class _PositionScheme(SchemeSolver):
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
