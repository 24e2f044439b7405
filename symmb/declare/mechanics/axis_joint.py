"""The base classes of joints: points, axes, and handles, which are the coordinates of a joint's motion."""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import casadi as ca

from symmb._errors import DeclarationError, NoHandleError
from symmb._options import shown
from symmb._types import Expr
from symmb.declare.mechanics.angle import relative_angle
from symmb.declare.mechanics.body import AbstractBody, Point, velocity_at
from symmb.declare.mechanics.constraint import Constraint
from symmb.declare.mechanics.element import Bind, direction_faults
from symmb.declare.mechanics.joint_coordinates import JointCoordinates
from symmb.declare.mechanics.pose import Planar, Pose, Spatial
from symmb.declare.mechanics.rotation import Rotation
from symmb.declare.symbolic import Kind, Symbol, is_time, is_zero, lookup, triad, turn, unit, vector, without_rounding

Axis = tuple[Expr, ...]
ORIENTED: tuple[type[Pose], ...] = (Planar, Spatial)


@dataclass(frozen=True, eq=False)
class Joint(Constraint):
    """A constraint between a point of body a and a point of body b.

    Joints that turn have an `angle` [rad] and an `angle_rate` [rad/s]. Joints that slide have a `displacement` [m] and
    a `displacement_rate` [m/s]. These handles describe the motion of body b relative to body a, positive about and
    along `axis`. Handles are 0 if the joint's frames on both bodies coincide. `handles` lists the handles of a joint.
    If the joint has exactly one coordinate, `coordinate` is the name of this coordinate, else None. `motion` has the
    joint coordinates of a body that the joint carries, or None if the joint can only close loops. `also` is a hint for
    users of the joint.
    """

    expected: ClassVar[str] = "a joint, got {}. Pass a joint, such as Revolute(...)."
    poses: ClassVar = (ORIENTED, ORIENTED)
    handles: ClassVar[tuple[str, ...]] = ()
    coordinate: ClassVar[str | None] = None
    motion: ClassVar[JointCoordinates | None] = None
    also: ClassVar[str] = ""
    without: ClassVar[str] = "Use coordinates and points of the joint's bodies."

    name: str
    point_a: Point
    point_b: Point

    @property
    def d(self) -> ca.SX:
        """Vector from point a to point b, world axes [m], (3,)."""
        return self.point_b.r - self.point_a.r

    @property
    def angle(self) -> ca.SX:
        """Angle of body b relative to body a about the axis, with whole turns [rad]."""
        raise self._lacks("angle")

    @property
    def angle_rate(self) -> ca.SX:
        """Angular velocity of body b relative to body a about the axis [rad/s]."""
        raise self._lacks("angle_rate")

    @property
    def displacement(self) -> ca.SX:
        """Distance from point a to point b along the axis [m]."""
        raise self._lacks("displacement")

    @property
    def displacement_rate(self) -> ca.SX:
        """Velocity of point b relative to body a along the axis [m/s]."""
        raise self._lacks("displacement_rate")

    def _lacks(self, handle: str) -> DeclarationError:
        return NoHandleError(f"{self.title} has no {handle}. {self.without}")

    @abstractmethod
    def position_rows(self, bind: Bind) -> ca.SX: ...


@dataclass(frozen=True, eq=False)
class AxisJoint(Joint):
    """A joint with an axis in each body.

    `turns` and `slides` say whether the joint allows rotation and translation. `aligns` says whether the joint has a
    zero: the orientation of body b relative to body a at which the angle is 0. The zero is the rotation `zero`. With
    `axis_b` it is the smallest rotation that makes both axes coincide. By default the frames of the bodies are parallel
    at the zero. If start and guess do not set the pose of a body, the body starts at the zero of its joint. `parallel`
    lists the columns of the joint's frames that the constraint keeps parallel.
    """

    turns: ClassVar[bool] = False
    slides: ClassVar[bool] = False
    aligns: ClassVar[bool] = False
    parallel: ClassVar[tuple[int, ...]] = (2,)

    axis: Axis = (0, 0, 1)
    axis_b: Axis | None = None
    zero: Rotation | None = field(default=None, kw_only=True)

    def faults(self) -> Iterator[str]:
        faults = list(super().faults())
        yield from faults
        if faults:
            return
        if self.zero is not None:
            yield from self._zero_faults(self.zero)
        axes = self.axis, self.axis if self.axis_b is None else self.axis_b
        for body, axis in zip(self.bodies(), axes, strict=True):
            yield from self._axis_faults(body, axis)

    def _axis_faults(self, body: AbstractBody, axis: Axis) -> Iterator[str]:
        astray = list(direction_faults(self.title, "axis", axis))
        a = vector(axis)
        moving = [s for s in ca.symvar(a) if is_time(s) or ((r := lookup(s)) and r.kind is not Kind.PARAMETER)]
        if moving:
            yield f"{self.title}: axis {axis} depends on {moving[0]}. Use numbers and parameters only."
        elif astray:
            yield from astray
        elif isinstance(body.pose, Planar) and self.turns and not (is_zero(a[0]) and is_zero(a[1])):
            yield (
                f"{self.title}: planar body {body.name!r} can turn about z only, but the axis is {axis}. "
                "Use pose=Spatial() or axis=(0, 0, 1)."
            )
        elif isinstance(body.pose, Planar) and self.slides and not is_zero(a[2]):
            yield (
                f"{self.title}: planar body {body.name!r} can slide in the xy plane only, but the axis is {axis}. "
                "Use pose=Spatial() or an axis with z = 0."
            )

    def _zero_faults(self, zero: object) -> Iterator[str]:
        if not isinstance(zero, Rotation):
            yield f"{self.title}: zero must be rotation(axis=..., angle=...), got {shown(zero)}."
        elif not self.aligns:
            yield f"{self.title}: this joint does not accept zero=. Omit zero."
        elif self.axis_b is not None:
            yield f"{self.title}: zero and axis_b both determine the axis in body b. Omit zero or axis_b."
        elif any(isinstance(body.pose, Planar) for body in self.bodies()):
            yield f"{self.title}: zero cannot be used with planar bodies. Use pose=Spatial(), or axis_b."

    @cached_property
    def axes(self) -> tuple[ca.SX, ca.SX]:
        """Unit axis (3,) in the frame of body a, and unit axis (3,) in the frame of body b."""
        a = unit(vector(self.axis))
        if self.zero is not None:
            return a, ca.densify(without_rounding(self.zero.matrix.T @ a))
        return a, a if self.axis_b is None else unit(vector(self.axis_b))

    @cached_property
    def alignment(self) -> ca.SX:
        """Matrix (3, 3) that converts components from axes of body a to axes of body b, at the zero of the joint.

        Without `zero` it is the smallest rotation that makes the axes coincide. Planar bodies turn in their plane.
        """
        if self.zero is not None:
            return self.zero.matrix.T
        in_plane = self.slides and any(isinstance(body.pose, Planar) for body in self.bodies())
        return turn(*self.axes, in_plane)

    @cached_property
    def own_frames(self) -> tuple[ca.SX, ca.SX]:
        """The joint's frames on body a and on body b in body axes, (3, 3) each. The third column is the axis."""
        F = triad(self.axes[0])
        return F, without_rounding(self.alignment @ F)

    @cached_property
    def frames(self) -> tuple[ca.SX, ca.SX]:
        """The joint's frames on body a and on body b in world axes, (3, 3) each. The third column is the axis."""
        F_a, F_b = self.own_frames
        return self.point_a.body.frame.R @ F_a, self.point_b.body.frame.R @ F_b

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
        return ca.vertcat(ca.SX(0, 1), *[ca.dot(*(F[:, k] for F in self.frames)) for k in self.parallel])

    @cached_property
    def _angle(self) -> tuple[ca.SX, tuple[Symbol, ...]]:
        bodies = self.point_a.body, self.point_b.body
        return relative_angle(self.name, bodies[0], self.axes[0], bodies[1], self.alignment, parallel=True)

    @property
    def turn_states(self) -> tuple[Symbol, ...]:
        """The states that count the turns of the angle; empty if no expression uses the angle."""
        return self._angle[1] if "_angle" in self.__dict__ else ()


class TurningJoint(AxisJoint):
    """A joint that turns about its axis."""

    turns: ClassVar[bool] = True
    aligns: ClassVar[bool] = True
    handles: ClassVar[tuple[str, ...]] = ("angle",)

    @property
    def angle(self) -> ca.SX:
        """Angle of body b relative to body a about the axis, with whole turns [rad]."""
        return self._angle[0]

    @cached_property
    def angle_rate(self) -> ca.SX:
        """Angular velocity of body b relative to body a about the axis [rad/s]."""
        A, (a, b) = self.frames[0], (body.frame for body in self.bodies())
        return ca.dot(A[:, 2], b.R @ b.omega - a.R @ a.omega)


class SlidingJoint(AxisJoint):
    """A joint that slides along its axis."""

    slides: ClassVar[bool] = True
    aligns: ClassVar[bool] = True
    handles: ClassVar[tuple[str, ...]] = ("displacement",)

    @cached_property
    def displacement(self) -> ca.SX:
        """Distance from point a to point b along the axis [m]."""
        return ca.dot(self.frames[0][:, 2], self.d)

    @cached_property
    def displacement_rate(self) -> ca.SX:
        """Velocity of point b relative to body a along the axis [m/s]."""
        a, b = self.bodies()
        arm_a, arm_b = self.point_b.r - a.frame.r, b.frame.R @ self.point_b.s
        return ca.dot(self.frames[0][:, 2], velocity_at(b, arm_b) - velocity_at(a, arm_a))
