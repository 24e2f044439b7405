"""The base class of constraints, drives, and constraints of velocities. Joints are in `joint`."""

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca

from symmb._types import Expr
from symmb.declare.mechanics.element import Bind, Element


class Constraint(Element):
    """An element that adds rows to Phi (positions) or Psi (velocities only)."""

    def position_rows(self, bind: Bind) -> ca.SX:
        """Rows of Phi, (n,)."""
        return ca.SX(0, 1)

    def velocity_rows(self, bind: Bind) -> ca.SX:
        """Rows of Psi, linear in the velocities, (n,)."""
        return ca.SX(0, 1)

    def assembly_cosines(self) -> ca.SX:
        """Cosines (n,) of angles between axes: 1 in the intended assembly, and -1 in the other solution of Phi = 0."""
        return ca.SX(0, 1)

    unilateral: bool = False

    def pressure(self, lam: ca.SX) -> ca.SX:
        """The force [N] of multipliers lam (n,). A unilateral constraint can only exert positive forces."""
        return lam[0]


@dataclass(frozen=True, eq=False)
class Motion(Constraint):
    """Drive: a position expression follows a law of time, expression - law = 0.

    The multiplier is minus the driving force on the expression [N, N m], because M v' + Phi_v' lam = Q.

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", 1.0, 1 / 3, mb.Planar())
    >>> hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(-1, 0))
    >>> motor = mb.Motion("motor", hinge.angle, 2 * mb.t)
    >>> system = mb.System(rod, hinge, motor, mb.Gravity(0, -9.81))
    >>> run = mb.simulate(mb.Scene(system, times=[0.0, 1.0]))
    >>> run["rod.theta"].round(6), -run(system.lam("motor")).round(3)
    (array([0., 2.]), array([ 9.81 , -4.082]))
    """

    name: str
    expression: Expr
    law: Expr

    def position_rows(self, bind: Bind) -> ca.SX:
        return self.number(bind, "expression") - self.number(bind, "law")


@dataclass(frozen=True, eq=False)
class VelocityConstraint(Constraint):
    """A constraint of velocities, such as rolling without slip. All expressions stay 0, and are linear in velocities.

    Examples
    --------
    >>> import symmb as mb
    >>> disc = mb.Body("disc", 1.0, 0.5, mb.Planar())
    >>> ground = mb.VelocityConstraint("no_slip", (disc.vx + 0.3 * disc.omega, disc.vy))
    >>> run = mb.simulate(mb.Scene(mb.System(disc, ground), {"disc.vx": 0.6}, [0.0, 1.0]))
    >>> run["disc.omega"].round(6)
    array([-2., -2.])
    """

    name: str
    expressions: tuple[Expr, ...]

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if not isinstance(self.expressions, tuple | list):
            yield f"{self.title}: expressions must be a tuple or a list, got {type(self.expressions).__name__}."

    def velocity_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(*[bind(e, f"{self.title}: expression") for e in self.expressions])
