"""Stabilisation of the constraints of an index-reduced DAE."""

from dataclasses import dataclass

from symmb._options import require_between, require_whole

LARGEST = 1e60
"""Largest rate or penalty. Its square must be a finite number."""


@dataclass(frozen=True)
class Baumgarte:
    """Feedback of the drift. gamma - 2 alpha (G v + Phi_t) - beta^2 Phi replaces gamma in the equations G v' = gamma.

    Parameters
    ----------
    alpha, beta : float
        rates [1/s]; if they are equal, the drift has critical damping

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", 1.0, 1 / 3)
    >>> hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(-1, 0))
    >>> scene = mb.Scene(mb.System(rod, hinge, mb.Gravity(0, -9.81)), {"rod.theta": 0.0}, [0.0, 0.5, 1.0])
    >>> mb.simulate(scene, mb.CVODES(stabilization=mb.Baumgarte(10.0, 10.0)))["rod.theta"].round(3)
    array([ 0.   , -0.895, -2.65 ])

    References
    ----------
    Baumgarte (1972), Computer Methods in Applied Mechanics and Engineering 1(1), 1-16.
    """

    alpha: float = 5.0
    beta: float = 5.0

    def __post_init__(self) -> None:
        require_between(self, "alpha", "[]", 0.0, LARGEST)
        require_between(self, "beta", "[]", 0.0, LARGEST)


@dataclass(frozen=True)
class Projection:
    """Projection of positions and velocities onto the constraints at every output time, with the smallest change in
    the norm of M.

    CasADi's integrators cannot change the state within a call. Therefore they are restarted at every output time, and
    multistep methods lose their history.

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", 1.0, 1 / 3)
    >>> hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(-1, 0))
    >>> scene = mb.Scene(mb.System(rod, hinge, mb.Gravity(0, -9.81)), {"rod.theta": 0.0}, [0.0, 0.5, 1.0])
    >>> mb.simulate(scene, mb.DormandPrince(stabilization=mb.Projection()))["rod.theta"].round(3)
    array([ 0.   , -0.895, -2.65 ])
    """


@dataclass(frozen=True)
class AugmentedLagrangian:
    """Constraints as stiff elements, and a few iterations that correct their forces to constraint forces.

        (M + a G' G) v' = Q - G' lam + a G' b,      b = gamma - 2 damping omega (G v + Phi_t) - omega^2 Phi,
        lam <- lam + a (G v' - b)

    The matrix is regular even if rows depend on each other. The motion can pass singular positions, and constraints can
    move bodies without mass. a is `penalty` times the mean of the diagonal of M.

    Parameters
    ----------
    penalty : float
        factor of a
    omega, damping : float
        rate [1/s] and damping ratio of the feedback of the drift. If the rate of the motion is far from 1/s, omega is
        multiplied by this rate
    iterations : int
        number of corrections of lam; 0 gives the penalty method

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", 1.0, 1 / 3)
    >>> hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(-1, 0))
    >>> scene = mb.Scene(mb.System(rod, hinge, mb.Gravity(0, -9.81)), {"rod.theta": 0.0}, [0.0, 0.5, 1.0])
    >>> mb.simulate(scene, mb.DormandPrince(stabilization=mb.AugmentedLagrangian()))["rod.theta"].round(3)
    array([ 0.   , -0.895, -2.65 ])

    References
    ----------
    Bayo, Garcia de Jalon, Serna (1988), Computer Methods in Applied Mechanics and Engineering 71, 183-195.
    """

    penalty: float = 1e6
    omega: float = 100.0
    damping: float = 1.0
    iterations: int = 2

    def __post_init__(self) -> None:
        require_between(self, "penalty", "(]", 0.0, LARGEST)
        require_between(self, "omega", "[]", 0.0, LARGEST)
        require_between(self, "damping", "[]", 0.0, LARGEST)
        # Maximum number of corrections of the multipliers. Each correction adds operations, and a few are enough.
        require_whole(self, "iterations", 0, 100)


Stabilization = Baumgarte | Projection | AugmentedLagrangian | None
