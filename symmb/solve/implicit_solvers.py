"""Implicit schemes with a fixed step as solvers."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Self

from symmb._types import Array
from symmb.dae import DAE
from symmb.schemes._step import Step
from symmb.schemes.generalized_alpha import generalized_alpha
from symmb.schemes.nstiff_si2 import nstiff_si2
from symmb.solve._fixed_step import fixed_step_integration, implicit
from symmb.solve._integration import Integration
from symmb.solve.solvers import Solver


class _Implicit(Solver):
    step: float
    tolerance: float

    @abstractmethod
    def formula(self, dae: DAE, work: bool) -> Step:
        """The scheme as a symbolic step."""

    def integration(self, dae: DAE, times: Array, *, order: int = 0, work: bool = False) -> Integration:
        advance = implicit(self.formula(dae, work).jets(order), self.tolerance)
        return fixed_step_integration(advance, times, self.step)

    def tighter(self, factor: float = 10.0) -> Self:
        return replace(self, step=self.step / factor**0.5)  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True, repr=False)
class NSTIFFSI2(_Implicit):
    """Second-order BDF on the stabilised index-2 form, the paper's solver (see `schemes.nstiff_si2`).

    Parameters
    ----------
    step : float             longest step [s]
    tolerance : float        of Newton's method
    """

    step: float = 5e-3
    tolerance: float = 1e-10

    def formula(self, dae: DAE, work: bool) -> Step:
        return nstiff_si2(dae, work)


@dataclass(frozen=True, repr=False)
class BDFI3(_Implicit):
    """Second-order BDF on the index-3 form: positions alone are kept, velocities follow to the error of the step.

    Parameters
    ----------
    step : float             longest step [s]
    tolerance : float        of Newton's method, in displacements [m, rad]
    """

    step: float = 1e-3
    tolerance: float = 1e-12

    def formula(self, dae: DAE, work: bool) -> Step:
        return nstiff_si2(dae, work, stabilized=False)


@dataclass(frozen=True, repr=False)
class Newmark(_Implicit):
    """Newmark's method on the index-3 form, of first order: gamma above 1/2 damps what the constraints excite.

    Parameters
    ----------
    step : float             longest step [s]
    gamma : float            damping, 1/2 (trapezoidal rule, none) to 1
    tolerance : float        of Newton's method, in displacements [m, rad]
    """

    limits: ClassVar = {"gamma": (0.5, 1.0)}

    step: float = 1e-3
    gamma: float = 0.6
    tolerance: float = 1e-13

    def formula(self, dae: DAE, work: bool) -> Step:
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
    tolerance : float        of Newton's method, in displacements [m, rad]
    """

    limits: ClassVar = {"rho": (0.0, 1.0)}

    step: float = 1e-3
    rho: float = 0.8
    tolerance: float = 1e-13

    def formula(self, dae: DAE, work: bool) -> Step:
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
    tolerance : float        of Newton's method, in displacements [m, rad]
    """

    limits: ClassVar = {"alpha": (0.0, 1 / 3)}

    step: float = 1e-3
    alpha: float = 0.1
    tolerance: float = 1e-13

    def formula(self, dae: DAE, work: bool) -> Step:
        return generalized_alpha(dae, work, alpha_m=0.0, alpha_f=self.alpha)
