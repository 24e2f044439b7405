"""Joints. Each joint returns its rows of the position constraints Phi in space, without rows that are always zero.

Rows describe body b relative to body a. Without `axis_b`, an axis has the same components in the frames of both bodies.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import casadi as ca

from symmb._options import shown
from symmb._types import Expr
from symmb.declare.mechanics.angle import relative_angle
from symmb.declare.mechanics.axis_joint import ORIENTED, AxisJoint, Joint, SlidingJoint, TurningJoint
from symmb.declare.mechanics.body import AbstractBody, Ground
from symmb.declare.mechanics.constraint import Constraint
from symmb.declare.mechanics.element import TRUTH, Bind, Element, function, law_value, within
from symmb.declare.mechanics.joint_coordinates import (
    AXIS,
    HINGE,
    JointCoordinates,
    about_point,
    about_two,
    about_z,
    angle_of,
    angles_of,
)
from symmb.declare.mechanics.pose import Fixed, Particle, Planar, Pose, Spatial
from symmb.declare.symbolic import Symbol, is_zero, quaternion_rate, vector

_ANY: tuple[type[Pose], ...] = (Planar, Spatial, Particle)
_SPATIAL: tuple[type[Pose], ...] = (Spatial,)


class Revolute(TurningJoint):
    """Hinge: the points coincide, and the axes stay parallel.

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", 1.0, 1 / 3, mb.Planar())
    >>> hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(-1, 0))
    >>> run = mb.simulate(mb.Scene(mb.System(rod, hinge, mb.Gravity(0, -9.81)), {"hinge.angle": 0.0}, [0.0, 0.5]))
    >>> run(hinge.angle).round(4), run(hinge.angle_rate).round(4)
    (array([ 0.    , -0.8948]), array([ 0.    , -3.3881]))
    """

    coordinate = "angle"
    without = "This joint does not slide. Use angle and angle_rate."
    motion = HINGE

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(self.d, self._parallel())


class Cylindrical(TurningJoint, SlidingJoint):
    """Cylindrical joint: the bodies turn about a common axis, and slide along it.

    Examples
    --------
    >>> import symmb as mb
    >>> block = mb.Body("block", 2.0, (1, 1, 1), mb.Spatial())
    >>> joint = mb.Cylindrical("joint", mb.Ground().point(0, 0, 0), block.point(0, 0, 0), axis=(0, 0, 1))
    >>> start = {"joint.angle_rate": 2.0, "joint.displacement_rate": 0.5}
    >>> run = mb.simulate(mb.Scene(mb.System(block, joint), start, [0.0, 1.0], {"angle": joint.angle}))
    >>> run["angle"].round(6), run(joint.displacement).round(6)
    (array([0., 2.]), array([0. , 0.5]))
    """

    poses = (_SPATIAL, _SPATIAL)
    handles = ("angle", "displacement")
    motion = JointCoordinates(
        ("angle", "displacement"),
        ("angle_rate", "displacement_rate"),
        turn=lambda q, u: about_z(q[0], u[0]),
        shift=lambda joint, q, bind: q[1] * AXIS,
        measured=lambda pose: ca.vertcat(angle_of(pose), pose.shift[2]),
    )

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(self._across(), self._parallel())


@dataclass(frozen=True, eq=False)
class Screw(TurningJoint, SlidingJoint):
    """A cylindrical joint that advances by `pitch` [m] along its axis with every turn.

    Examples
    --------
    >>> import symmb as mb
    >>> block = mb.Body("block", 2.0, (1, 1, 1), mb.Spatial())
    >>> screw = mb.Screw("screw", mb.Ground().point(0, 0, 0), block.point(0, 0, 0), pitch=0.1)
    >>> run = mb.simulate(mb.Scene(mb.System(block, screw), {"screw.displacement_rate": 0.1}, [0.0, 1.0]))
    >>> run["block.omega_z"].round(4)
    array([6.2832, 6.2832])
    """

    poses: ClassVar = (_SPATIAL, _SPATIAL)
    handles: ClassVar = ("angle", "displacement")
    coordinate: ClassVar = "angle"
    motion: ClassVar = replace(HINGE, shift=lambda screw, q, bind: screw.advance(q, bind) * AXIS)

    pitch: Expr = field(default=0.0, kw_only=True)

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(self._across(), self._parallel(), self.displacement - self.advance(self.angle, bind))

    def advance(self, angle: ca.SX, bind: Bind) -> ca.SX:
        """The displacement [m] at an angle [rad]."""
        return self.number(bind, "pitch") * angle / (2 * ca.pi)


class Prismatic(SlidingJoint):
    """Slider: the frames stay parallel, and point b stays on the axis through point a.

    Examples
    --------
    >>> import symmb as mb
    >>> block = mb.Body("block", 2.0, (1, 1, 1), mb.Spatial())
    >>> slide = mb.Prismatic("slide", mb.Ground().point(0, 0, 0), block.point(0, 0, 0), axis=(1, 0, 0))
    >>> push = mb.Actuator("push", slide, 4.0)
    >>> run = mb.simulate(mb.Scene(mb.System(block, slide, push), times=[0.0, 1.0]))
    >>> run(slide.displacement).round(6), run(slide.displacement_rate).round(6)
    (array([0., 1.]), array([0., 2.]))
    """

    coordinate = "displacement"
    parallel = (0, 2)
    without = "This joint does not turn. Use displacement and displacement_rate."
    motion = JointCoordinates(
        ("displacement",),
        ("displacement_rate",),
        shift=lambda joint, q, bind: q * AXIS,
        measured=lambda pose: pose.shift[2],
    )

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(self._across(), self._locked())


class Weld(AxisJoint):
    """Rigid connection: the points coincide, and the relative orientation is constant. `axis_b` is parallel to `axis`.

    Examples
    --------
    >>> import symmb as mb
    >>> block = mb.Body("block", 2.0, (1, 1, 1), mb.Spatial())
    >>> weld = mb.Weld("weld", mb.Ground().point(0, 0, 0), block.point(0, 0, 1))
    >>> system = mb.System(block, weld, mb.Gravity(0, 0, -10.0))
    >>> run = mb.simulate(mb.Scene(system, times=[0.0, 1.0]))
    >>> run(system.reaction("weld").fz).round(6)
    array([20., 20.])
    """

    aligns = True
    parallel = (0, 2)
    without = "This joint does not turn and does not slide."
    motion = JointCoordinates()

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(self.d, self._locked())


class Universal(AxisJoint):
    """Hooke joint: the points coincide, and `axis` of body a stays normal to `axis_b` of body b. `axis_b` is required.

    Examples
    --------
    >>> import symmb as mb
    >>> block = mb.Body("block", 2.0, (1, 1, 1), mb.Spatial())
    >>> ground = mb.Ground()
    >>> joint = mb.Universal("joint", ground.point(0, 0, 0), block.point(0, 0, 0), axis=(1, 0, 0), axis_b=(0, 1, 0))
    >>> mb.System(block, joint).Phi.shape
    (4, 1)
    """

    poses = (_SPATIAL, _SPATIAL)
    parallel = ()
    without = (
        "This joint turns about two axes and does not slide. Use two Revolute joints with a body of mass 0 between "
        "them: each Revolute joint has an angle."
    )
    motion = JointCoordinates(
        ("angle_a", "angle_b"), ("angle_a_rate", "angle_b_rate"), about_two, measured=angles_of, crossed=True
    )

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if self.axis_b is None:
            yield f"{self.title}: axis_b is missing. Pass axis_b=..., the axis of the cross in axes of point_b's body."

    def position_rows(self, bind: Bind) -> ca.SX:
        a, b = self.axes
        return ca.vertcat(self.d, ca.dot(self.point_a.body.frame.R @ a, self.point_b.body.frame.R @ b))


class PlanarJoint(AxisJoint):
    """Point b stays in the plane through point a with the normal `axis`, and the normals on both bodies stay parallel.

    Examples
    --------
    >>> import symmb as mb
    >>> block = mb.Body("block", 2.0, (1, 1, 1), mb.Spatial())
    >>> table = mb.PlanarJoint("table", mb.Ground().point(0, 0, 0), block.point(0, 0, 0), axis=(0, 0, 1))
    >>> run = mb.simulate(mb.Scene(mb.System(block, table), {"block.vx": 1.0}, [0.0, 2.0]))
    >>> run["block.x"].round(6)
    array([0., 2.])
    """

    poses = (_SPATIAL, _SPATIAL)
    aligns = True
    also = "A PlanarJoint also keeps its normals parallel. Motion(name, expression, 0) only keeps a point on a plane."
    without = (
        "This joint slides in two directions and turns about the normal. Use coordinates and points of its bodies."
    )
    motion = JointCoordinates(
        ("x", "y", "angle"),
        ("vx", "vy", "angle_rate"),
        turn=lambda q, u: about_z(q[2], u[2]),
        shift=lambda joint, q, bind: ca.vertcat(q[:2], ca.SX(1, 1)),
        measured=lambda pose: ca.vertcat(pose.shift[:2], angle_of(pose)),
    )

    def position_rows(self, bind: Bind) -> ca.SX:
        A, _ = self.frames
        return ca.vertcat(self._parallel(), ca.dot(A[:, 2], self.d))


class PointOnLine(AxisJoint):
    """Point b stays on the line through point a along `axis`; orientations are free.

    Examples
    --------
    >>> import symmb as mb
    >>> bead = mb.Body("bead", 1.0, pose=mb.Particle())
    >>> wire = mb.PointOnLine("wire", mb.Ground().point(0, 0, 0), bead.point(0, 0, 0), axis=(1, 0, -1))
    >>> run = mb.simulate(mb.Scene(mb.System(bead, wire, mb.Gravity(0, 0, -10.0)), times=[0.0, 1.0]))
    >>> run["bead.z"].round(6)
    array([ 0. , -2.5])
    """

    poses = (ORIENTED, _ANY)
    parallel = ()

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        body = getattr(self.point_a, "body", None)
        if isinstance(body, AbstractBody) and isinstance(body.pose, Planar) and not is_zero(vector(self.axis)[2]):
            yield (
                f"{self.title}: planar body {body.name!r} needs an axis with z = 0, but the axis is {self.axis}. "
                "Use an axis with z = 0 or pose=Spatial()."
            )

    def position_rows(self, bind: Bind) -> ca.SX:
        return self._across()


class Spherical(Joint):
    """Ball joint: the points coincide.

    Examples
    --------
    >>> import symmb as mb
    >>> top = mb.Body("top", 1.0, (0.1, 0.1, 0.2), mb.Spatial())
    >>> ball = mb.Spherical("ball", mb.Ground().point(0, 0, 0), top.point(0, 0, -0.5))
    >>> mb.System(top, ball).Phi.shape
    (3, 1)
    """

    poses = (_ANY, _ANY)
    without = (
        "This joint turns about three axes and does not slide. Use body.rotation, or three Revolute joints with bodies "
        "of mass 0 between them: each Revolute joint has an angle."
    )
    motion = JointCoordinates(
        ("e0", "e1", "e2", "e3"),
        ("omega_x", "omega_y", "omega_z"),
        about_point,
        measured=lambda pose: pose.quaternion,
        q_rate=quaternion_rate,
        in_plane=HINGE,
    )

    def position_rows(self, bind: Bind) -> ca.SX:
        return self.d


@dataclass(frozen=True, eq=False)
class Distance(Joint):
    """Massless rod of positive length [m] between the points. The multiplier of a Distance is the pull in the rod [N].

    The rod pulls and pushes. A Distance can represent a rope only while the pull is positive. With `unilateral=True`, a
    warning gives the time at which the rod starts to push. A `Rope` never pushes.

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> rod = mb.Distance("rod", mb.Ground().point(0, 0, 0), bob.point(0, 0, 0), 1.0)
    >>> system = mb.System(bob, rod, mb.Gravity(0, 0, -9.81))
    >>> run = mb.simulate(mb.Scene(system, {"bob.x": 0.0, "bob.y": 0.0}, [0.0, 1.0], guess={"bob.z": -1.0}))
    >>> run(system.lam("rod")).round(6)
    array([9.81, 9.81])
    """

    poses: ClassVar = (_ANY, _ANY)

    length: Expr = field(metadata=within(above=0.0, remedy="Use Spherical for points that coincide."))
    unilateral: bool = field(default=False, kw_only=True, metadata=TRUTH)

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.norm_2(self.d) - self.number(bind, "length")


@dataclass(frozen=True, eq=False)
class Gear(AxisJoint):
    """Gear pair: the angle of body b is `ratio` times the angle of body a. Angles are relative to the carrier.

    The carrier is the body that holds both axes, such as the arm of a planetary gear. By default it is the ground. An
    angle is 0 if the frame of its body is parallel to the carrier's frame. With a negative ratio the bodies turn in
    opposite directions.

    Examples
    --------
    >>> import symmb as mb
    >>> ground = mb.Ground()
    >>> a, b = (mb.Body(name, 1.0, 0.1, mb.Planar()) for name in "ab")
    >>> pin_a = mb.Revolute("pin_a", ground.point(0, 0), a.point(0, 0))
    >>> pin_b = mb.Revolute("pin_b", ground.point(3, 0), b.point(0, 0))
    >>> gear = mb.Gear("gear", a.point(0, 0), b.point(0, 0), ratio=-0.5)
    >>> run = mb.simulate(mb.Scene(mb.System(a, b, pin_a, pin_b, gear), {"a.omega": 2.0}, [0.0, 1.0]))
    >>> run["b.omega"].round(6)
    array([-1., -1.])
    """

    turns: ClassVar[bool] = True
    parallel: ClassVar[tuple[int, ...]] = ()
    without: ClassVar[str] = "A Gear couples two angles. Use the angles of the Revolute joints that carry the wheels."

    ratio: Expr = field(kw_only=True)
    carrier: AbstractBody | None = field(default=None, kw_only=True)

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if self.carrier is not None and not isinstance(self.carrier, AbstractBody):
            yield f"{self.title}: carrier must be the body that holds both axes, got {shown(self.carrier)}."
        elif self.carrier is not None and not isinstance(self.carrier.pose, (*ORIENTED, Fixed)):
            yield f"{self.title}: carrier {self.carrier.name!r} cannot turn. Use pose=Planar() or pose=Spatial()."

    @cached_property
    def _angles(self) -> tuple[tuple[ca.SX, tuple[Symbol, ...]], ...]:
        carrier = Ground() if self.carrier is None else self.carrier
        return tuple(
            relative_angle(f"{self.name}.{side}", carrier, axis, body, ca.SX.eye(3))
            for side, axis, body in zip("ab", self.axes, self.bodies(), strict=True)
        )

    def position_rows(self, bind: Bind) -> ca.SX:
        (angle_a, _), (angle_b, _) = self._angles
        return angle_b - self.number(bind, "ratio") * angle_a


@dataclass(frozen=True, eq=False)
class CamFollower(Constraint):
    """A follower that a cam moves. The lift is the displacement or angle of the follower, a function of the cam angle.

    The lift must already include the effect of the follower's shape, such as a flat face or a roller. The constraint is
    as smooth as the lift. The multiplier is minus the force of the cam on the follower [N, N m]. A warning gives the
    time at which the cam would have to pull.

    Parameters
    ----------
    name : str
    cam, follower : Joint
        joints of the cam and of the follower: Revolute, Prismatic, ...
    lift : callable
        `Table`, or function of the cam's angle [rad] (SX) that returns the follower's displacement [m] or angle [rad]
    unilateral : bool
        False if the cam has a groove and can also pull

    Examples
    --------
    >>> import casadi as ca
    >>> import symmb as mb
    >>> ground, disc = mb.Ground(), mb.Body("disc", 1.0, 0.1, mb.Planar())
    >>> rod = mb.Body("rod", 0.5, 0.1, mb.Planar())
    >>> shaft = mb.Revolute("shaft", ground.point(0, 0), disc.point(0, 0))
    >>> guide = mb.Prismatic("guide", ground.point(0, 0), rod.point(0, 0), axis=(0, 1, 0))
    >>> valve = mb.CamFollower("valve", shaft, guide, lambda angle: 0.01 * (1 - ca.cos(angle)))
    >>> system = mb.System(disc, rod, shaft, guide, valve)
    >>> run = mb.simulate(mb.Scene(system, {"shaft.angle": ca.pi, "shaft.angle_rate": 0.0}))
    >>> run(guide.displacement).round(6)
    array([0.02])
    """

    name: str
    cam: Joint
    follower: Joint
    lift: Callable[[ca.SX], Expr] = field(metadata=function("the cam's angle, or a Table."))
    unilateral: bool = field(default=True, kw_only=True, metadata=TRUTH)

    def bodies(self) -> tuple[AbstractBody, ...]:
        return (*self.cam.bodies(), *self.follower.bodies())

    def parts(self) -> tuple[Element, ...]:
        return (self.cam, self.follower)

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        for joint in self.parts():
            if isinstance(joint, Joint) and joint.coordinate is None:
                yield f"{self.title}: {joint.title} does not have exactly one coordinate. {joint.without}"

    def position_rows(self, bind: Bind) -> ca.SX:
        angle, moved = (getattr(joint, str(joint.coordinate)) for joint in (self.cam, self.follower))
        title = f"{self.title}: lift"
        return moved - bind(law_value(self.lift, title, angle), title)

    def pressure(self, lam: ca.SX) -> ca.SX:
        return -lam[0]
