"""Impacts: Newton's law of restitution at the instant when a gap closes."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca

from symmb._options import is_real, number_text
from symmb._types import Expr
from symmb.declare.mechanics.element import Element
from symmb.declare.symbolic import Kind, Symbol, declare

RESTITUTION = "restitution {} is not between 0 and 1"


def _faults(title: str, _: str, value: object) -> Iterator[str]:
    """Fault of a number that is not a coefficient of restitution."""
    if is_real(value) and not 0 <= value <= 1:
        yield f"{title}: {RESTITUTION.format(number_text(value))}. Pass a number from 0 to 1."


COEFFICIENT = {"faults": _faults}
"""Metadata of a field for a coefficient of restitution."""


@dataclass(frozen=True, eq=False)
class Impact(Element):
    """Unilateral contact without friction: an instantaneous impact occurs each time the gap closes.

    When the gap g is 0 and closing, g' < 0, velocities jump by an impulse P along the gap's gradient,

        M (v+ - v-) + G' L = W' P,      G (v+ - v-) = 0,      g'+ = -e g'-,      W = dg'/dv,

    so that all constraints hold after the impact. Simultaneous impacts are resolved in rounds, until no gap of size 0
    closes. In each round, impacts are resolved one after the other in the order of declaration. A warning says if
    another order gives another result. If a rebound is as low as the rounding of positions, the contact stays closed. A
    closed contact is a constraint that can only push, and opens when the force would have to pull.

    Parameters
    ----------
    name : str
    gap : expression
        gap [m, rad] as an expression of coordinates, parameters and `t`, positive if open: `ball.y - radius`
    restitution : expression
        coefficient of restitution e, from 0 (no rebound) to 1 (no loss of energy); it may depend on parameters

    References
    ----------
    Glocker (2001), Set-Valued Force Laws, chapter 8. Pfeiffer, Glocker (1996), Multibody Dynamics with Unilateral
    Contacts, chapter 6.

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> system = mb.System(ball, mb.Gravity(0, -9.81), mb.Impact("floor", ball.y, restitution=0.5))
    >>> fall = mb.Scene(system, start={"ball.y": 4.905, "ball.vx": 1.0}, times=[0.0, 1.5])
    >>> traj = mb.simulate(fall)
    >>> first = traj.events[0]
    >>> round(first.time, 9), round(first.before, 9), round(first.after, 9)
    (1.0, -9.81, 4.905)
    >>> float(traj["ball.y"][-1].round(6))
    1.22625
    """

    name: str
    gap: Expr
    restitution: Expr = field(metadata=COEFFICIENT)

    @property
    def closed(self) -> ca.SX:
        """1 while the contact stays closed, 0 while it is open."""
        return self.state.sx

    @cached_property
    def state(self) -> Symbol:
        """The record of the state `closed`, which only changes at events."""
        name = f"{self.name}.closed"
        return declare([name], Kind.STATE, ca.SX.sym(name), ca.SX(1, 1), ca.SX(1, 1))[0]
