"""Runs with impacts: steps of the Dormand-Prince pair from event to event."""

from dataclasses import dataclass
from typing import ClassVar

from symmb._errors import PropagationError
from symmb._types import Array
from symmb.integrate.event_runs import EventIntegration
from symmb.integrate.explicit import DormandPrince
from symmb.integrate.integration import Integration
from symmb.integrate.solver import Solver
from symmb.model import DAE, Impacts


@dataclass(frozen=True, repr=False)
class EventDriven(Solver):
    """Explicit pair of order 8 whose steps end where an `Impact` happens, located on their interpolant to rounding.

    Samples run side by side, each with steps of its own. After every step positions and velocities are moved onto the
    constraints, with those of closed contacts. At the time of an impact, outputs have their values after it.

    Parameters
    ----------
    rtol : float             relative tolerance
    atol : float             absolute tolerance, rtol / 100 of the motion's size if left out [m, rad, m/s, rad/s]

    References
    ----------
    Hairer, Norsett, Wanner (1993), Solving Ordinary Differential Equations I, section II.6. Acary, Brogliato (2008),
    Numerical Methods for Nonsmooth Dynamical Systems, chapter 8.
    """

    locates_events: ClassVar[bool] = True

    rtol: float = 1e-10
    atol: float | None = None

    def has_dense_output(self, dae: DAE) -> bool:
        return True

    def _integration(self, dae: DAE, times: Array, order: int, work: bool) -> Integration:
        if dae.impacts is None:
            return DormandPrince(self.rtol, self.atol).integration(dae, times, order=order, work=work)
        if order:
            raise PropagationError(
                f"Derivatives with respect to parameters, and Taylor with them, are not valid across the events of "
                f"{impacts_text(dae.impacts)}. Use PolynomialChaos(), Scanning(...) or MonteCarlo(...)."
            )
        return EventIntegration(dae, dae.impacts, times, self.tolerances(dae, n_quad=int(work)), work)


def impacts_text(impacts: Impacts) -> str:
    """The impacts by name, for messages."""
    return ", ".join(f"Impact {name!r}" for name in impacts.names)
