"""Bodies and points fixed to them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, TypeGuard

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError, NoHandleError
from symmb._interrupts import kept_interrupts
from symmb._options import shown
from symmb._types import Expr
from symmb.declare.mechanics.declaration import declared
from symmb.declare.mechanics.geometry import Geometry, shapes_of
from symmb.declare.mechanics.pose import Fixed, Frame, Particle, Planar, Pose, Spatial
from symmb.declare.symbolic import ddt, is_zero, vector

if TYPE_CHECKING:
    from symmb.declare import mechanics

TRIANGLE = 5e-4
"""Tolerance of the check of inertias. The largest principal moment may exceed the sum of the other two by this fraction
of the sum of all three. Data of thin plates need this tolerance if they are rounded to three digits."""


def _component(vector: str, k: int, doc: str) -> Any:
    """A property that returns component k of an attribute of shape (3,)."""
    return property(lambda self: getattr(self, vector)[k], doc=doc)


class Located:
    """Components of the world position and velocity of a point, or of the centre of mass of a body."""

    _place: ca.SX
    _velocity: ca.SX

    x = _component("_place", 0, "World x [m].")
    y = _component("_place", 1, "World y [m].")
    z = _component("_place", 2, "World z [m].")
    vx = _component("_velocity", 0, "World x velocity [m/s].")
    vy = _component("_velocity", 1, "World y velocity [m/s].")
    vz = _component("_velocity", 2, "World z velocity [m/s].")


class AbstractBody(Located):
    """Base class of bodies and the ground: a name, a pose, a frame and points."""

    name: str
    pose: Pose
    frame: Frame
    com: tuple[Expr, ...]
    shapes: Sequence[Geometry] = ()
    _is_flexible: ClassVar[bool] = False

    @property
    def owner(self) -> "AbstractBody":
        """The body whose coordinates determine this frame."""
        return self

    @kept_interrupts()
    def point(self, x: Expr, y: Expr, z: Expr = 0) -> "Point":
        """Point fixed to the body at (x, y, z) [m] in body axes. The centre of mass has the coordinates `com`."""
        return Point(self, vector([x, y, z], f"point of {self.name!r}") - vector(self.com, f"com of {self.name!r}"))

    @property
    def rotation(self) -> ca.SX:
        """Rotation matrix, body to world, (3, 3)."""
        return self.frame.R

    @property
    def _place(self) -> ca.SX:
        return self.frame.r

    @property
    def _velocity(self) -> ca.SX:
        return self.frame.velocity

    @property
    def theta(self) -> ca.SX:
        """Angle about +z of a planar body [rad]."""
        if not isinstance(self.pose, Planar):
            raise NoHandleError(
                f"Body {self.name!r} has pose={self.pose!r} and no angle theta. Use joint.angle or body.rotation."
            )
        return self.frame.angle

    @property
    def omega(self) -> ca.SX:
        """Angular velocity [rad/s]: about z for a planar body, (3,) in body axes for a spatial body."""
        return self.frame.omega[2] if isinstance(self.pose, Planar) else self.frame.omega


@dataclass(frozen=True, eq=False)
class Body(AbstractBody):
    """A rigid body. The coordinates of a body are the position of its centre of mass and its orientation.

    Parameters
    ----------
    name : str
        without dots; coordinates are called `name.x`, ...
    mass : Expr
        mass [kg], not negative; 0 for a massless body. If the mass changes during the motion, added and removed mass
        has the velocity of the body
    inertia : Expr
        inertia about the centre of mass [kg m^2]: a scalar about z for `Planar()`, three principal values or a
        symmetric 3x3 matrix in body axes for `Spatial()`, none for `Particle()`
    pose : Pose
        possible motion of the body: `Planar()`, `Spatial()` or `Particle()`
    com : tuple
        centre of mass (x, y, z) [m], in the same coordinates as in `point`. The default is (0, 0, 0)
    shapes : sequence
        shapes of the body in drawings: `Box3(...)`, `Cylinder(...)`, `Sphere(...)` or `Mesh(...)`. By default drawings
        derive a shape from the points and the inertia. Shapes have no other effect

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", mass=2.0, inertia=0.5, pose=mb.Planar())
    >>> rod.point(0.5, 0).x
    SX((rod.x+(0.5*cos(rod.theta))))
    """

    name: str
    mass: Expr
    inertia: Expr = 0.0
    pose: Pose = field(default_factory=Planar)
    com: tuple[Expr, ...] = (0.0, 0.0, 0.0)
    shapes: Sequence[Geometry] = field(default=(), repr=False)
    frame: Frame = field(init=False, repr=False)

    @kept_interrupts()
    def __post_init__(self) -> None:
        if not isinstance(self.pose, Pose):
            pose = shown(self.pose)
            raise DeclarationError(
                f"Body {shown(self.name)}: {pose} is not a pose. Use Planar(), Spatial() or Particle()."
            )
        vector(self.com, f"com of {shown(self.name)}")
        name = self.name if isinstance(self.name, str) else shown(self.name)  # System reports an invalid name
        object.__setattr__(self, "shapes", shapes_of(f"Body {shown(self.name)}", self.shapes))
        object.__setattr__(self, "frame", self.pose.frame(name))
        declared(self)

    @property
    def center(self) -> AbstractBody:
        """The frame of the centre of mass. Gravity acts at its origin."""
        return self

    @property
    def nearly_singular(self) -> bool:
        """Whether the body's block of the mass matrix is nearly singular. The inverse of such a block is inaccurate."""
        return False

    @property
    def laws(self) -> ca.SX:
        """Expressions (n,) of parameters in internal forces of the body."""
        return ca.SX(0, 1)

    @property
    def faults(self) -> tuple[str, ...]:
        """Faults of the declaration of the body. Each fault is a sentence with a remedy."""
        return ()

    def inertial(self, mass: ca.SX, J: ca.SX) -> "Inertial":
        """Contribution of the body to the equations, from its mass and its inertia about the centre of mass (3, 3)."""
        S, omega = self.frame.S, self.frame.omega
        # The frame's origin is the centre of mass, so that the force has no gyroscopic part.
        gyroscopic = S.T @ ca.vertcat(ca.SX(3, 1), -ca.cross(omega, J @ omega))
        return Inertial(ca.sparsify(S.T @ ca.diagcat(mass, mass, mass, J) @ S), gyroscopic)


class Flywheel(Body):
    """A body that represents the inertia of a drive. A flywheel is not drawn, because its position has no meaning."""


class Link(Body):
    """A body of a machine from a file. In the file, joint values determine the pose of the body."""


@dataclass(frozen=True, eq=False)
class Inertial:
    """The contribution of a body to the equations of motion."""

    M: ca.SX  # (n_v, n_v), its block of the mass matrix
    Q: ca.SX  # (n_v,), gyroscopic and elastic forces, which conserve energy
    Q_work: ca.SX | None = None  # (n_v,), internal damping forces
    potential: ca.SX | None = None  # strain energy [J]
    flows: bool = True  # whether mass may be added or removed during the motion

    @property
    def M_flow(self) -> ca.SX:
        """The matrix M (n_v, n_v) if mass may be added or removed during the motion, else zeros."""
        return self.M if self.flows else ca.SX(*self.M.shape)


class Ground(AbstractBody):
    """The world frame, at rest.

    Parameters
    ----------
    shapes : sequence
        shapes of the ground in drawings: `Box3(...)`, `Cylinder(...)`, `Sphere(...)` or `Mesh(...)`. Shapes are drawn
        only if an element is attached to this ground

    Examples
    --------
    >>> import symmb as mb
    >>> mb.Ground().point(1, 2).x
    SX(1)
    """

    @kept_interrupts()
    def __init__(self, shapes: Sequence[Geometry] = ()) -> None:
        self.shapes = shapes_of("Ground", shapes)
        self.name = "ground"
        self.pose = Fixed()
        self.com = (0.0, 0.0, 0.0)
        self.frame = self.pose.frame(self.name)

    def __repr__(self) -> str:
        return "Ground()"


@dataclass(frozen=True, eq=False)
class Point(Located):
    """A point fixed to a body, or to a node of a flexible body. `s` (3,) is its position in the body's frame [m]."""

    body: "AbstractBody"
    s: ca.SX

    @property
    @kept_interrupts()
    def r(self) -> ca.SX:
        """World position [m], (3,)."""
        return self.body.frame.r + self.body.frame.R @ self.s

    @property
    @kept_interrupts()
    def velocity(self) -> ca.SX:
        """World velocity [m/s], (3,)."""
        return ddt(self.r)

    @property
    def _place(self) -> ca.SX:
        return self.r

    @property
    def _velocity(self) -> ca.SX:
        return self.velocity


def velocity_at(body: AbstractBody, arm: ca.SX) -> ca.SX:
    """World velocity (3,) [m/s] of a point of a body. `arm` (3,) [m] leads from the frame's origin to the point."""
    return body.frame.velocity + ca.cross(body.frame.R @ body.frame.omega, arm)


def inertia_matrix(body: Body, inertia: ca.SX) -> ca.SX:
    """Inertia (3, 3) about the centre of mass in body axes. The pose determines how many numbers `inertia` has."""
    if isinstance(body.pose, Planar) and inertia.numel() == 1:
        return ca.diag(ca.vertcat(0, 0, inertia))
    if isinstance(body.pose, Spatial) and inertia.numel() == 3:
        return ca.sparsify(ca.diag(inertia))
    if isinstance(body.pose, Spatial) and inertia.shape == (3, 3):
        return ca.sparsify(inertia)
    if isinstance(body.pose, Particle) and is_zero(inertia):
        return ca.SX(3, 3)
    expected = {Planar: "one scalar about z", Spatial: "three principal values or a 3x3 matrix", Particle: "no inertia"}
    raise DeclarationError(
        f"Body {body.name!r}: inertia of shape {inertia.shape} cannot be used with {body.pose!r}. "
        f"Pass {expected.get(type(body.pose), 'no inertia')}."
    )


def _is_sequence(value: object) -> TypeGuard[Sequence[Any]]:
    return isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)


def as_matrix(value: Expr, what: str, bind: Callable[..., ca.SX]) -> ca.SX:
    """A law, or nested sequences of laws, as one vector or matrix. `bind` converts each entry."""
    if _is_sequence(value):
        rows = [row if _is_sequence(row) else [row] for row in value]
        if len({len(row) for row in rows}) > 1:
            lengths = " and ".join(str(len(row)) for row in rows)
            raise DeclarationError(f"{what}: the rows have {lengths} entries. Pass rows of one length.")
        return ca.vertcat(*[ca.horzcat(*[bind(entry, what) for entry in row]) for row in rows])
    return bind(value, what, any_size=True)


def is_flexible(body: AbstractBody) -> "TypeGuard[mechanics.FlexibleBody]":
    """Whether a body is a FlexibleBody. Scenes without flexible bodies do not load this class."""
    return body._is_flexible
