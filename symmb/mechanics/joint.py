"""Joints. Each gives its rows of Phi in three dimensions; rows that are zero by structure are left out.

Rows are differences b - a. Axes are vectors in the frame of point_a's body, and the same vectors in point_b's unless
`axis_b` says otherwise.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import casadi as ca

from symmb._options import is_real
from symmb._types import Expr
from symmb.mechanics.angle import relative_angle
from symmb.mechanics.axis_joint import ORIENTED, AxisJoint, Joint, SlidingJoint, TurningJoint
from symmb.mechanics.body import AbstractBody, Ground
from symmb.mechanics.element import Bind
from symmb.mechanics.pose import Particle, Planar, Pose, Spatial
from symmb.symbolic import Symbol, is_zero, vector

_ANY: tuple[type[Pose], ...] = (Planar, Spatial, Particle)
_SPATIAL: tuple[type[Pose], ...] = (Spatial,)


class Revolute(TurningJoint):
    """Hinge: the points coincide, the axes stay parallel."""

    coordinate = "angle"
    without = "Its points coincide, so that nothing slides. Use angle and angle_rate."

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(self.d, self._parallel())


class Cylindrical(TurningJoint, SlidingJoint):
    """The bodies turn about and slide along a common axis."""

    poses = (_SPATIAL, _SPATIAL)
    handles = ("angle", "displacement")

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(self._across(), self._parallel())


@dataclass(frozen=True, eq=False)
class Screw(TurningJoint, SlidingJoint):
    """A cylindrical joint that advances by `pitch` [m] along its axis with every turn."""

    poses: ClassVar = (_SPATIAL, _SPATIAL)
    handles: ClassVar = ("angle", "displacement")
    coordinate: ClassVar = "angle"

    pitch: Expr = field(default=0.0, kw_only=True)

    def position_rows(self, bind: Bind) -> ca.SX:
        advance = bind(self.pitch, f"{self.title}: pitch") * self.angle / (2 * ca.pi)
        return ca.vertcat(self._across(), self._parallel(), self.displacement - advance)


class Prismatic(SlidingJoint):
    """Slider: the frames are locked parallel, point b stays on the axis through point a."""

    coordinate = "displacement"
    without = "Its frames are locked parallel, so that nothing turns. Use displacement and displacement_rate."

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(self._across(), self._locked())

    def assembly_cosines(self) -> ca.SX:
        A, B = self.frames
        return ca.vertcat(ca.dot(A[:, 0], B[:, 0]), ca.dot(A[:, 2], B[:, 2]))


class Weld(AxisJoint):
    """The points coincide and the frames are locked parallel, `axis` onto `axis_b`."""

    aligns = True
    without = "It holds its bodies together, so that nothing turns and nothing slides."

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(self.d, self._locked())

    def assembly_cosines(self) -> ca.SX:
        A, B = self.frames
        return ca.vertcat(ca.dot(A[:, 0], B[:, 0]), ca.dot(A[:, 2], B[:, 2]))


class Universal(AxisJoint):
    """Hooke joint: the points coincide, and `axis` of body a is normal to `axis_b` of body b, which must be given."""

    poses = (_SPATIAL, _SPATIAL)
    without = (
        "It turns about two axes and does not slide. Use two Revolute joints with a body between them, which may have "
        "no mass: each has an angle of its own."
    )

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if self.axis_b is None:
            yield f"{self.title}: needs axis_b, the axis of the cross fixed in the body of point b."

    def position_rows(self, bind: Bind) -> ca.SX:
        a, b = self.axes
        return ca.vertcat(self.d, ca.dot(self.point_a.body.frame.R @ a, self.point_b.body.frame.R @ b))

    def assembly_cosines(self) -> ca.SX:
        return ca.SX(0, 1)


class PlanarJoint(AxisJoint):
    """Point b stays in the plane through point a whose normal is `axis`; the normals stay parallel."""

    poses = (_SPATIAL, _SPATIAL)
    aligns = True
    without = "It slides in two directions and turns about a third one. Use coordinates and points of its bodies."

    def position_rows(self, bind: Bind) -> ca.SX:
        A, _ = self.frames
        return ca.vertcat(self._parallel(), ca.dot(A[:, 2], self.d))


class PointOnLine(AxisJoint):
    """Point b stays on the line through point a along `axis`; orientations are free."""

    poses = (ORIENTED, _ANY)

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        body = getattr(self.point_a, "body", None)
        if isinstance(body, AbstractBody) and isinstance(body.pose, Planar) and not is_zero(vector(self.axis)[2]):
            yield (
                f"{self.title}: axis {self.axis} leaves the plane of planar body {body.name!r}. "
                "Use an axis with z = 0 or pose=Spatial()."
            )

    def position_rows(self, bind: Bind) -> ca.SX:
        return self._across()

    def assembly_cosines(self) -> ca.SX:
        return ca.SX(0, 1)


class Spherical(Joint):
    """Ball joint: the points coincide."""

    poses = (_ANY, _ANY)
    without = (
        "It turns about three axes and does not slide. Use body.rotation, or three Revolute joints with bodies between "
        "them, which may have no mass: each has an angle of its own."
    )

    def position_rows(self, bind: Bind) -> ca.SX:
        return self.d


@dataclass(frozen=True, eq=False)
class Distance(Joint):
    """Massless rod of the given length [m], not zero, between the points; its multiplier is the pull in the rod [N].

    The rod pulls and pushes. It stands for a rope only while its multiplier stays positive: make
    `system.lam("name")[0]` an output and look at its sign. A `NonlinearSpring` pulls only, with a law such as
    `lambda d, v: ca.fmax(k * (d - length), 0)`.
    """

    poses: ClassVar = (_ANY, _ANY)

    length: Expr

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if is_real(self.length) and not self.length > 0:
            yield f"{self.title}: length {self.length!r} is not positive. For coinciding points use Spherical."

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.norm_2(self.d) - self.positive(bind)

    def positive(self, bind: Bind) -> ca.SX:
        return bind(self.length, f"{self.title}: length")


@dataclass(frozen=True, eq=False)
class Gear(AxisJoint):
    """Gear pair: the angle of body b is `ratio` times that of body a, each about its axis against the ground.

    The angles are 0 where the frames are parallel to the world's. With a negative ratio the bodies turn in opposite
    directions.
    """

    turns: ClassVar[bool] = True
    without: ClassVar[str] = "It couples two angles. Use those of the Revolute joints that carry its wheels."

    ratio: Expr = field(kw_only=True)

    @cached_property
    def _angles(self) -> tuple[tuple[ca.SX, tuple[Symbol, ...]], ...]:
        ground = Ground()
        return tuple(
            relative_angle(f"{self.name}.{side}", ground, axis, body, ca.SX.eye(3))
            for side, axis, body in zip("ab", self.axes, self.bodies(), strict=True)
        )

    def position_rows(self, bind: Bind) -> ca.SX:
        (angle_a, _), (angle_b, _) = self._angles
        return angle_b - bind(self.ratio, f"{self.title}: ratio") * angle_a

    def assembly_cosines(self) -> ca.SX:
        return ca.SX(0, 1)
