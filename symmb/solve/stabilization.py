"""What keeps an index-reduced DAE on its constraints."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Baumgarte:
    """Feedback of the drift: gamma - 2 alpha (G v + Phi_t) - beta^2 Phi in the place of gamma.

    Parameters
    ----------
    alpha, beta : float      rates [1/s]; equal ones damp the drift critically

    References
    ----------
    Baumgarte (1972), Computer Methods in Applied Mechanics and Engineering 1(1), 1-16.
    """

    alpha: float = 5.0
    beta: float = 5.0


@dataclass(frozen=True)
class Projection:
    """At every output time, positions and velocities are moved onto the constraints, least in the norm of M.

    CasADi's integrators cannot be interrupted within a call: they are restarted at every output time, which costs a
    multistep method its history.
    """


Stabilization = Baumgarte | Projection | None
