"""Forces along the coordinate of a joint: actuators and stops."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import cast

import casadi as ca

from symmb._options import is_real
from symmb._types import Expr
from symmb.declare.mechanics.axis_joint import AxisJoint, Joint
from symmb.declare.mechanics.body import AbstractBody, Body
from symmb.declare.mechanics.contact_law import ContactLaw
from symmb.declare.mechanics.element import Bind, Element, bound
from symmb.declare.mechanics.force import Action, ForceElement, Load, is_constant, moment_on, push
from symmb.declare.mechanics.impact import COEFFICIENT, Impact
from symmb.declare.symbolic import ddt


@dataclass(frozen=True, eq=False)
class JointForce(ForceElement):
    """A force on body b along the coordinate of a joint, at the joint's point. The reaction acts on body a."""

    name: str
    joint: Joint
    coordinate: str | None = field(default=None, kw_only=True)

    def bodies(self) -> tuple[AbstractBody, ...]:
        return self.joint.bodies()

    def parts(self) -> tuple[Element, ...]:
        return (self.joint,)

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        joint, coordinate = self.joint, self.coordinate
        if not isinstance(joint, Joint):
            return
        if not joint.handles:
            yield f"{self.title}: {joint.title} has no angle and no displacement. {joint.without}"
        elif coordinate is None and joint.coordinate is None:
            yield f"{self.title}: {joint.title} turns and also slides. Pass coordinate='angle' or 'displacement'."
        elif coordinate is not None and not (isinstance(coordinate, str) and coordinate in joint.handles):
            known = " or ".join(map(repr, joint.handles))
            yield f"{self.title}: {joint.title} has no coordinate {coordinate!r}. Use coordinate={known}."
        else:
            yield from joint.faults()

    @property
    def handle(self) -> str:
        """The name of the coordinate: "angle" or "displacement"."""
        return cast(str, self.coordinate or self.joint.coordinate)

    @property
    def turns(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether the coordinate is an angle."""
        return self.handle == "angle"

    @property
    def axis(self) -> ca.SX:
        """The axis of the joint in world axes, (3,)."""
        return cast(AxisJoint, self.joint).frames[0][:, 2]

    def loads(self, force: ca.SX) -> tuple[Load, ...]:
        """Loads of a force [N] along the joint's axis, or of a torque [N m] about the axis."""
        a, b = self.joint.bodies()
        if self.handle == "displacement":
            return push(self.joint.point_b, a, force * self.axis)
        return moment_on(b, force * self.axis), moment_on(a, -force * self.axis)


@dataclass(frozen=True, eq=False)
class Actuator(JointForce):
    """A motor or a cylinder in a joint: a torque [N m] about the joint's axis, or a force [N] along the axis.

    The load acts on body b in the direction of increasing `angle` or `displacement` of the joint. The opposite load
    acts on body a. In a `Screw` the load is a torque about the axis.

    Parameters
    ----------
    name : str
    joint : Joint
        Revolute, Prismatic, Cylindrical or Screw
    law : Expr
        torque [N m] or force [N]: any expression of coordinates, velocities, states, parameters and `t`
    coordinate : str
        "angle" or "displacement", for joints that have both

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", mass=1.0, inertia=0.1)
    >>> hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(-0.5, 0))
    >>> hold = mb.Actuator("motor", hinge, -20 * hinge.angle - 2 * hinge.angle_rate)
    >>> mb.System(rod, hinge, hold).Q
    SX(@1=0, [@1, @1, ((-20*rod.theta)-(2.*rod.omega))])
    """

    law: Expr

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        law = self.number(bind, "law")
        yield Action(self.loads(law), force=law)


@dataclass(frozen=True, eq=False)
class Stop(JointForce):
    """Limits of a joint's motion at one or both ends: contact laws, or impacts with a coefficient of restitution.

    Parameters
    ----------
    name : str
    joint : Joint
        Revolute, Prismatic, Cylindrical or Screw
    lower, upper : Expr
        limits of the joint's `angle` [rad] or `displacement` [m]; default: no limit at this end
    law : ContactLaw
        law such as `KelvinVoigt(...)`: torque [N m] for a penetration [rad], or force [N] for a penetration [m]
    restitution : Expr
        coefficient of restitution in place of a law: the limits are impacts `name.lower` and `name.upper`, see `Impact`
    coordinate : str
        "angle" or "displacement", for joints that have both

    Examples
    --------
    >>> import symmb as mb
    >>> cart = mb.Body("cart", mass=1.0, inertia=1.0)
    >>> rail = mb.Prismatic("rail", mb.Ground().point(0, 0), cart.point(0, 0), axis=(1, 0, 0))
    >>> system = mb.System(cart, rail, mb.Stop("buffer", rail, upper=2.0, restitution=0.5))
    >>> run = mb.simulate(mb.Scene(system, {"cart.vx": 4.0}, [0.0, 1.0]))
    >>> float(run["cart.x"][-1].round(9)), run.events[0].name
    (1.0, 'buffer.upper')
    """

    lower: Expr | None = None
    upper: Expr | None = None
    law: ContactLaw | None = None
    restitution: Expr | None = field(default=None, metadata=COEFFICIENT)

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if not self._ends:
            yield f"{self.title}: lower and upper are both None. Pass lower, upper or both."
        numbers = [end for end in (self.lower, self.upper) if is_real(end)]
        if len(numbers) == 2 and not numbers[0] < numbers[1]:
            yield f"{self.title}: lower {numbers[0]!r} must be below upper {numbers[1]!r}."
        if (self.law is None) == (self.restitution is None):
            yield f"{self.title}: pass either a contact law, or restitution=... from 0 to 1."

    @property
    def _ends(self) -> dict[str, int]:
        """The limits by name, each with the sign of the joint's rate when the joint moves away from the limit."""
        return {name: sign for name, sign in (("lower", 1), ("upper", -1)) if getattr(self, name) is not None}

    def impacts(self, bind: Bind) -> tuple[Impact, ...]:
        """The impacts at the limits; empty without a coefficient of restitution."""
        if self.restitution is None:
            return ()
        value = getattr(self.joint, self.handle)
        gaps = {name: sign * (value - self.number(bind, name)) for name, sign in self._ends.items()}
        return tuple(Impact(f"{self.name}.{name}", gap, self.restitution) for name, gap in gaps.items())

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        if self.law is None:
            return
        law = bound(self.law, bind, self.title)
        value, rate = (getattr(self.joint, f"{self.handle}{suffix}") for suffix in ("", "_rate"))
        for name, sign in self._ends.items():
            end = self.number(bind, name)
            penetration = sign * (end - value)
            force = law.force(penetration, sign * (ddt(end) - rate))
            potential = law.potential(penetration) if is_constant(law.stores, end) else None
            yield Action(self.loads(sign * force), potential, force=force)
