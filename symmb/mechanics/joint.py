"""Joints. Each gives its rows of Phi in three dimensions; rows that are zero by structure are left out.

Rows are differences b - a. Axes are vectors in the frame of point_a's body, and the same vectors in point_b's unless
`axis_b` says otherwise.
"""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import casadi as ca

from symmb._types import Expr
from symmb.mechanics.angle import relative_angle
from symmb.mechanics.body import AbstractBody, Ground, Point
from symmb.mechanics.constraint import Constraint
from symmb.mechanics.element import Bind, point_faults, pose_faults
from symmb.mechanics.pose import Particle, Planar, Pose, Spatial
from symmb.symbolic import Symbol, is_zero, triad, turn, unit, vector

Axis = tuple[Expr, ...]
_Z: Axis = (0, 0, 1)
_ORIENTED: tuple[type[Pose], ...] = (Planar, Spatial)
_ANY: tuple[type[Pose], ...] = (Planar, Spatial, Particle)
_SPATIAL: tuple[type[Pose], ...] = (Spatial,)


@dataclass(frozen=True, eq=False)
class Joint(Constraint):
    """A constraint between a point of body a and a point of body b."""

    poses: ClassVar[tuple[tuple[type[Pose], ...], tuple[type[Pose], ...]]] = (_ORIENTED, _ORIENTED)

    name: str
    point_a: Point
    point_b: Point

    def bodies(self) -> tuple[AbstractBody, ...]:
        return (self.point_a.body, self.point_b.body)

    def faults(self) -> Iterator[str]:
        faults = list(point_faults(self.title, self.point_a, self.point_b))
        yield from faults
        if not faults:
            yield from pose_faults(self.title, self.bodies(), self.poses)

    @property
    def d(self) -> ca.SX:
        """Vector from point a to point b, world axes [m], (3,)."""
        return self.point_b.r - self.point_a.r

    @abstractmethod
    def position_rows(self, bind: Bind) -> ca.SX: ...


@dataclass(frozen=True, eq=False)
class AxisJoint(Joint):
    """A joint with an axis in each body. `turns` and `slides` tell whether it allows rotation and translation."""

    turns: ClassVar[bool] = False
    slides: ClassVar[bool] = False

    axis: Axis = _Z
    axis_b: Axis | None = None

    def faults(self) -> Iterator[str]:
        faults = list(super().faults())
        yield from faults
        if faults:
            return
        for body, axis in zip(
            self.bodies(), (self.axis, self.axis if self.axis_b is None else self.axis_b), strict=True
        ):
            a = vector(axis, f"axis of {self.title}")
            if is_zero(a):
                yield f"{self.title}: axis {axis} has no direction. Give a vector that is not zero."
            elif isinstance(body.pose, Planar) and self.turns and not (is_zero(a[0]) and is_zero(a[1])):
                yield (
                    f"{self.title}: axis {axis} leaves the plane of planar body {body.name!r}. "
                    "Planar joints turn about z; use pose=Spatial() or axis=(0, 0, 1)."
                )
            elif isinstance(body.pose, Planar) and self.slides and not is_zero(a[2]):
                yield (
                    f"{self.title}: axis {axis} leaves the plane of planar body {body.name!r}. "
                    "Planar bodies slide in the xy plane; use pose=Spatial() or an axis with z = 0."
                )

    @cached_property
    def axes(self) -> tuple[ca.SX, ca.SX]:
        """Unit axis in the frame of body a and in that of body b, (3,) each."""
        a = unit(vector(self.axis))
        return a, a if self.axis_b is None else unit(vector(self.axis_b))

    @cached_property
    def frames(self) -> tuple[ca.SX, ca.SX]:
        """The joint's frame on body a and on body b in world axes, (3, 3) each. The third column is the axis."""
        a, b = self.axes
        F = triad(a)
        return self.point_a.body.frame.R @ F, self.point_b.body.frame.R @ turn(a, b) @ F

    def _parallel(self) -> ca.SX:
        A, B = self.frames
        return ca.vertcat(ca.dot(A[:, 0], B[:, 2]), ca.dot(A[:, 1], B[:, 2]))

    def _locked(self) -> ca.SX:
        A, B = self.frames
        return ca.vertcat(self._parallel(), ca.dot(A[:, 0], B[:, 1]))

    def _across(self) -> ca.SX:
        A, _ = self.frames
        return ca.vertcat(ca.dot(A[:, 0], self.d), ca.dot(A[:, 1], self.d))

    def assembly_cosines(self) -> ca.SX:
        A, B = self.frames
        return ca.dot(A[:, 2], B[:, 2])

    @cached_property
    def _angle(self) -> tuple[ca.SX, tuple[Symbol, ...]]:
        a, b = self.axes
        return relative_angle(self.name, self.point_a.body, a, self.point_b.body, b)


class _Hinged(AxisJoint):
    """A joint that turns about its axis and measures the angle."""

    turns: ClassVar[bool] = True

    @property
    def angle(self) -> ca.SX:
        """Angle of body b relative to body a about the axis, with whole turns [rad]."""
        return self._angle[0]


class Revolute(_Hinged):
    """Hinge: the points coincide, the axes stay parallel."""

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(self.d, self._parallel())


class Cylindrical(_Hinged):
    """The bodies turn about and slide along a common axis."""

    poses = (_SPATIAL, _SPATIAL)

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(self._across(), self._parallel())


@dataclass(frozen=True, eq=False)
class Screw(_Hinged):
    """A cylindrical joint that advances by `pitch` [m] along its axis with every turn."""

    poses: ClassVar = (_SPATIAL, _SPATIAL)

    pitch: Expr = field(default=0.0, kw_only=True)

    def position_rows(self, bind: Bind) -> ca.SX:
        A, _ = self.frames
        advance = bind(self.pitch, f"{self.title}: pitch") * self.angle / (2 * ca.pi)
        return ca.vertcat(self._across(), self._parallel(), ca.dot(A[:, 2], self.d) - advance)


class Prismatic(AxisJoint):
    """Slider: the frames are locked parallel, point b stays on the axis through point a."""

    slides = True

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(self._across(), self._locked())

    def assembly_cosines(self) -> ca.SX:
        A, B = self.frames
        return ca.vertcat(ca.dot(A[:, 0], B[:, 0]), ca.dot(A[:, 2], B[:, 2]))


class Weld(AxisJoint):
    """The points coincide and the frames are locked parallel, `axis` onto `axis_b`."""

    def position_rows(self, bind: Bind) -> ca.SX:
        return ca.vertcat(self.d, self._locked())

    def assembly_cosines(self) -> ca.SX:
        A, B = self.frames
        return ca.vertcat(ca.dot(A[:, 0], B[:, 0]), ca.dot(A[:, 2], B[:, 2]))


class Universal(AxisJoint):
    """Hooke joint: the points coincide, and `axis` of body a is normal to `axis_b` of body b, which must be given."""

    poses = (_SPATIAL, _SPATIAL)

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

    def position_rows(self, bind: Bind) -> ca.SX:
        A, _ = self.frames
        return ca.vertcat(self._parallel(), ca.dot(A[:, 2], self.d))


class PointOnLine(AxisJoint):
    """Point b stays on the line through point a along `axis`; orientations are free."""

    poses = (_ORIENTED, _ANY)

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

    def position_rows(self, bind: Bind) -> ca.SX:
        return self.d


@dataclass(frozen=True, eq=False)
class Distance(Joint):
    """Massless rod of the given length [m], not zero, between the points; its multiplier is the pull in the rod [N]."""

    poses: ClassVar = (_ANY, _ANY)

    length: Expr

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if isinstance(self.length, int | float) and not self.length > 0:
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

    ratio: Expr = field(kw_only=True)

    @cached_property
    def _angles(self) -> tuple[tuple[ca.SX, tuple[Symbol, ...]], ...]:
        ground = Ground()
        return tuple(
            relative_angle(f"{self.name}.{side}", ground, axis, body, axis)
            for side, axis, body in zip("ab", self.axes, self.bodies(), strict=True)
        )

    def position_rows(self, bind: Bind) -> ca.SX:
        (angle_a, _), (angle_b, _) = self._angles
        return angle_b - bind(self.ratio, f"{self.title}: ratio") * angle_a

    def assembly_cosines(self) -> ca.SX:
        return ca.SX(0, 1)
