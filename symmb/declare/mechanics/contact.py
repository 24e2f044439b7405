"""Contacts: two surfaces push each other apart while they touch."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import casadi as ca

from symmb._magnitudes import MEETING
from symmb._types import Expr
from symmb.declare.mechanics.body import AbstractBody, Body, Point, velocity_at
from symmb.declare.mechanics.contact_law import ContactLaw
from symmb.declare.mechanics.element import DIRECTION, Bind, bound
from symmb.declare.mechanics.force import Action, ForceElement, Load, PairForce, PairTorque, fixed_at, is_constant, push
from symmb.declare.mechanics.friction import FrictionLaw
from symmb.declare.mechanics.pose import Planar
from symmb.declare.symbolic import Z, ddt, triad, unit, vector


def press(law: ContactLaw, penetration: ca.SX, loads: Callable[[ca.SX], tuple[Load, ...]], *fixed: ca.SX) -> Action:
    """The action of a law that `bound` has returned. The function `loads` converts the force of the law into loads.

    The action has a potential if all points, directions and sizes in `fixed` are constant.
    """
    force = law.force(penetration, ddt(penetration))
    potential = law.potential(penetration) if is_constant(law.stores, *fixed) else None
    return Action(loads(force), potential, force=force)


def touch(
    element: "SurfaceContact",
    bind: Bind,
    a: AbstractBody,
    point: Point,
    radius: ca.SX,
    axis: ca.SX,
    height: ca.SX,
    *fixed: ca.SX,
    rate: ca.SX | None = None,
    name: str = "",
) -> Iterator[Action]:
    """The actions between a circle or sphere about a point and a surface of body a.

    The foot is the point of the surface that is nearest to the given point. `axis` (3,) is the normal at the foot, in
    the axes of body a. `height` [m] is the height of the point above the foot. If a state follows the foot, `rate` is
    the rate of the height [m/s]. `name` is the prefix of friction states if the element has several contacts.
    """
    b, law = point.body, bound(element.law, bind, element.title)
    normal, penetration = a.frame.R @ axis, radius - height
    rate = ddt(penetration) if rate is None else ddt(radius) - rate
    force = law.force(penetration, rate)
    potential = law.potential(penetration) if is_constant(law.stores, radius, *fixed) else None
    yield Action(push(point, a, force * normal), potential, force=force)
    if element.friction is None:
        return
    if isinstance(a.pose, Planar) or isinstance(b.pose, Planar):
        tangents = ca.cross(Z, axis)
    elif is_constant(axis):
        tangents = triad(axis)[:, :2]
    else:  # no pair of tangents is smooth for all normals, so the tangential parts of three directions are used
        tangents = ca.SX.eye(3) - axis @ axis.T
    tangents = a.frame.R @ tangents
    foot = point.r - height * normal
    slip = tangents.T @ (velocity_at(b, foot - b.frame.r) - velocity_at(a, foot - a.frame.r))
    drag, states = bound(element.friction, bind, element.title).resistance(name or element.name, slip, force)
    yield Action(push(fixed_at(b, foot), a, tangents @ drag), states=states)


def distance_and_direction(d: ca.SX, least: ca.SX | float = 0.0) -> tuple[ca.SX, ca.SX]:
    """Length [m] of a vector, at least `least`, and its direction (3,). The direction of the zero vector is 0."""
    distance = ca.sqrt(ca.fmax(ca.sumsqr(d), ca.fmax(least, MEETING) ** 2))
    return distance, d / distance


class SurfaceContact(ForceElement):
    """A contact with a law along the normal, and optional friction in the tangential directions."""

    law: ContactLaw
    friction: FrictionLaw | None


@dataclass(frozen=True, eq=False)
class Contact(SurfaceContact):
    """A sphere against a plane that is fixed to another body or to the ground.

    Parameters
    ----------
    name : str
    point : Point
        centre of the sphere
    plane_point : Point
        any point of the plane
    normal : tuple
        outward normal of the plane, in the axes of plane_point's body
    law : ContactLaw
        contact law, such as `HuntCrossley(...)`
    radius : Expr
        radius of the sphere [m]; 0 for a point
    friction : FrictionLaw, optional
        `Coulomb(...)` or `Bristle(...)`

    Examples
    --------
    >>> import symmb as mb
    >>> ground, ball = mb.Ground(), mb.Body("ball", 1.0, pose=mb.Particle())
    >>> law = mb.HuntCrossley(1e5, restitution=0.9, speed=1.0)
    >>> floor = mb.Contact("floor", ball.point(0, 0), ground.point(0, 0), (0, 1, 0), law, radius=0.1)
    >>> scene = mb.Scene(mb.System(ball, floor), {"ball.y": 0.2, "ball.vy": -1.0}, [0.0, 0.3])
    >>> mb.simulate(scene, mb.CVODES())["ball.vy"].round(3)
    array([-1.   ,  0.909])
    """

    name: str
    point: Point
    plane_point: Point
    normal: tuple[Expr, ...] = field(metadata=DIRECTION)
    law: ContactLaw
    radius: Expr = 0.0
    friction: FrictionLaw | None = None

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        a = self.plane_point.body
        axis = unit(vector(self.normal))
        radius = self.number(bind, "radius")
        height = ca.dot(axis, a.frame.R.T @ (self.point.r - self.plane_point.r))
        yield from touch(self, bind, a, self.point, radius, axis, height, self.point.s, self.plane_point.s, axis)


@dataclass(frozen=True, eq=False)
class BushContact(PairForce):
    """A pin in a cylindrical bush with clearance. The pin is free until it touches the wall.

    Parameters
    ----------
    name : str
    point_a : Point
        point on the axis of the bush
    point_b : Point
        point on the axis of the pin; the pin may move along the bush
    axis : tuple
        axis of the bush, in the axes of point_a's body
    clearance : Expr
        radius of the bush minus radius of the pin [m]
    law : ContactLaw
        contact law, such as `HuntCrossley(...)`

    Examples
    --------
    >>> import symmb as mb
    >>> law = mb.KelvinVoigt(1e5, 200.0)
    >>> ground, pin = mb.Ground(), mb.Body("pin", 1.0, 0.1, mb.Planar())
    >>> bush = mb.BushContact("bush", ground.point(0, 0), pin.point(0, 0), (0, 0, 1), 1e-3, law)
    >>> scene = mb.Scene(mb.System(pin, bush, mb.Gravity(0, -10.0)), times=[0.0, 0.02])
    >>> mb.simulate(scene, mb.CVODES())["pin.y"].round(5)
    array([ 0.     , -0.00135])
    """

    axis: tuple[Expr, ...] = field(metadata=DIRECTION)
    clearance: Expr
    law: ContactLaw

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        a = self.point_a.body
        axis = unit(vector(self.axis))
        clearance = self.number(bind, "clearance")
        d = a.frame.R.T @ (self.point_b.r - self.point_a.r)
        across = d - ca.dot(d, axis) * axis
        # At the centre the direction to the wall is not defined. So the distance has a lower limit, half the clearance,
        # at which no force acts. Derivatives are then finite at the centre.
        distance, outward = distance_and_direction(across, clearance / 2)
        direction = a.frame.R @ outward
        law = bound(self.law, bind, self.title)
        fixed = (self.point_a.s, self.point_b.s, axis, clearance)
        yield press(law, distance - clearance, lambda force: push(self.point_b, a, -force * direction), *fixed)


@dataclass(frozen=True, eq=False)
class ToothContact(PairForce):
    """A tooth between two flanks. The tooth is free within the backlash, and each flank pushes it back.

    Parameters
    ----------
    name : str
    point_a : Point
        point halfway between the flanks
    point_b : Point
        point of the tooth
    direction : tuple
        direction from flank to flank (tangent to the pitch circle), in the axes of point_a's body
    backlash : Expr
        total play between the flanks [m]
    law : ContactLaw
        contact law of each flank

    Examples
    --------
    >>> import symmb as mb
    >>> law = mb.KelvinVoigt(1e4)
    >>> ground, tooth = mb.Ground(), mb.Body("tooth", 1.0, pose=mb.Particle())
    >>> flanks = mb.ToothContact("flanks", ground.point(0, 0), tooth.point(0, 0), (1, 0, 0), 0.02, law)
    >>> scene = mb.Scene(mb.System(tooth, flanks), {"tooth.vx": 1.0}, [0.0, 0.02, 0.05])
    >>> mb.simulate(scene, mb.CVODES())["tooth.vx"].round(3)
    array([ 1.  ,  0.54, -1.  ])
    """

    direction: tuple[Expr, ...] = field(metadata=DIRECTION)
    backlash: Expr
    law: ContactLaw

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        a = self.point_a.body
        direction = unit(vector(self.direction))
        backlash = self.number(bind, "backlash")
        d = ca.dot(direction, a.frame.R.T @ (self.point_b.r - self.point_a.r))
        outward, law = -ca.sign(d) * (a.frame.R @ direction), bound(self.law, bind, self.title)
        fixed = (self.point_a.s, self.point_b.s, direction, backlash)
        yield press(law, ca.fabs(d) - backlash / 2, lambda force: push(self.point_b, a, force * outward), *fixed)


@dataclass(frozen=True, eq=False)
class TorsionContact(PairTorque):
    """A coupling with backlash. The coupling turns freely within the backlash, and each stop pushes it back.

    If the axes of the bodies do not stay parallel, the angle is the twist, as in `TorsionSpring`.

    Parameters
    ----------
    name : str
    body_a, body_b : Body or Ground
    backlash : Expr
        total play between the stops [rad]
    law : ContactLaw
        contact law of each stop: torque [N m] for a penetration [rad]
    angle : Expr
        angle of b relative to a in the middle between the stops [rad]
    axis : tuple
        direction of the axis, with the same components in the axes of both bodies

    Examples
    --------
    >>> import symmb as mb
    >>> ground, shaft = mb.Ground(), mb.Body("shaft", 1.0, 1.0, mb.Planar())
    >>> bearing = mb.Revolute("bearing", ground.point(0, 0), shaft.point(0, 0))
    >>> coupling = mb.TorsionContact("coupling", ground, shaft, 0.2, mb.KelvinVoigt(1e3))
    >>> scene = mb.Scene(mb.System(shaft, bearing, coupling), {"shaft.omega": 1.0}, [0.0, 0.1, 0.3])
    >>> run = mb.simulate(scene, mb.CVODES())
    >>> run["shaft.omega"].round(3)
    array([ 1.,  1., -1.])
    """

    backlash: Expr
    law: ContactLaw
    angle: Expr = 0.0
    axis: tuple[Expr, ...] = (0, 0, 1)

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        backlash, middle = self.number(bind, "backlash"), self.number(bind, "angle")
        alpha, law = self.alpha - middle, bound(self.law, bind, self.title)
        penetration = ca.fabs(alpha) - backlash / 2
        yield press(law, penetration, lambda torque: self._loads(-ca.sign(alpha) * torque), backlash, middle)
