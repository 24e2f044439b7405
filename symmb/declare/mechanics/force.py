"""Forces. Each force returns the wrenches on its bodies, and its potential if it has one."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import casadi as ca

from symmb._errors import DeclarationError
from symmb._magnitudes import MEETING
from symmb._names import counted
from symmb._options import shown
from symmb._types import Expr
from symmb.declare.mechanics.angle import relative_angle, turning_direction
from symmb.declare.mechanics.body import AbstractBody, Body, Point
from symmb.declare.mechanics.element import Bind, Element, direction_faults
from symmb.declare.mechanics.pose import Planar, Spatial
from symmb.declare.symbolic import Kind, Symbol, components, ddt, is_time, is_zero, records_in, unit, vector

if TYPE_CHECKING:
    from symmb.declare import mechanics

_LARGE_TURN = 0.5
"""Angle [rad] at which the moment of a Bushing, which uses the sine, is 4 % below the moment of a linear spring."""


@dataclass(frozen=True, eq=False)
class Load:
    """A wrench on a body at its frame's origin: force (3,) in world axes [N], and torque (3,) in body axes [N m]."""

    body: AbstractBody
    force: ca.SX
    torque: ca.SX


@dataclass(frozen=True, eq=False)
class Action:
    """Loads with one cause, and their potential energy [J]. If the potential is None, the work is integrated.

    `states` are the first-order states of the loads. `force` is the value of a scalar law: a pull [N], a push [N] or a
    torque [N m]. For other laws, `force` is None.
    """

    loads: tuple[Load, ...]
    potential: ca.SX | None = None
    states: tuple[Symbol, ...] = ()
    force: ca.SX | None = None


def force_at(point: Point, force: ca.SX) -> Load:
    """Load of a force (3,) in world axes at a point of a body."""
    return Load(point.body, force, ca.cross(point.s, point.body.frame.R.T @ force))


def moment_on(body: AbstractBody, torque: ca.SX) -> Load:
    """Load of a torque (3,) in world axes on a body."""
    return Load(body, ca.SX(3, 1), body.frame.R.T @ torque)


def fixed_at(body: AbstractBody, r: ca.SX) -> Point:
    """The point of a body that is at the world position r (3,) [m] at the current time."""
    return Point(body, body.frame.R.T @ (r - body.frame.r))


def push(point: Point, body: AbstractBody, force: ca.SX) -> tuple[Load, Load]:
    """A force (3,) in world axes at a point, and the opposite force on another body.

    The opposite force acts at the same position, so that the two loads are in equilibrium, and the energy is conserved.
    """
    return force_at(point, force), force_at(fixed_at(body, point.r), -force)


def is_constant(*laws: ca.SX) -> bool:
    """Whether laws depend on parameters only, so that a potential exists."""
    return all(len(records_in(law, Kind.PARAMETER)) == len(ca.symvar(law)) for law in laws)


def is_moved(distance: ca.SX) -> bool:
    """Whether a distance depends explicitly on time, as for a moving support. The support then does work."""
    return any(is_time(symbol) for symbol in ca.symvar(distance))


class ForceElement(Element):
    """An element that adds to the generalised forces Q. `turns` says whether its law returns a torque."""

    turns: bool = False

    @abstractmethod
    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        """The actions of the force; `masses` lists every body of the system with its mass."""

    def impacts(self, bind: Bind) -> "tuple[mechanics.Impact, ...]":
        """The impacts of the force, as at the limits of a Stop."""
        return ()

    def events(self, bind: Bind) -> "tuple[mechanics.JointEvent, ...]":
        """The events of the force, as of a Clutch."""
        return ()


@dataclass(frozen=True, eq=False)
class PairForce(ForceElement):
    """A force between a point of body a and a point of body b."""

    name: str
    point_a: Point
    point_b: Point

    def pair_loads(self, force: ca.SX) -> tuple[Load, ...]:
        """Loads of a force (3,) in world axes on point a, and of the opposite force on point b."""
        return force_at(self.point_a, force), force_at(self.point_b, -force)


@dataclass(frozen=True, eq=False)
class Gravity(ForceElement):
    """Uniform gravity (gx, gy, gz) [m/s^2] in world axes on every body of the system.

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", 1.0, pose=mb.Particle())
    >>> mb.simulate(mb.Scene(mb.System(ball, mb.Gravity(0, -9.81)), times=[0.0, 1.0]))["ball.y"].round(4)
    array([ 0.   , -4.905])
    """

    gx: Expr
    gy: Expr
    gz: Expr = 0.0
    name: str = "gravity"

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        g = ca.vertcat(*[self.number(bind, what) for what in ("gx", "gy", "gz")])
        for body, mass in masses:
            potential = -mass * ca.dot(g, body.center.frame.r) if is_constant(g, mass) else None
            yield Action((Load(body.center, mass * g, ca.SX(3, 1)),), potential)


@dataclass(frozen=True, eq=False)
class SpringDamper(PairForce):
    """Spring and damper along the line between two points at the distance d. The pull is k (d - length) + c d'.

    A spring of length 0 pulls along the vector between the points. The force of this spring is smooth even if the
    points coincide. A damper acts along the line only, so it does not brake a common rotation of the bodies. A
    `Bushing` damps in all directions.

    Parameters
    ----------
    name : str
    point_a, point_b : Point
    stiffness : Expr
        stiffness k [N/m]
    damping : Expr
        damping c [N s/m]; negative damping adds energy, as in models of vibrations caused by flow or friction
    length : Expr
        length without load [m]; negative for a preloaded spring, which pulls even at distance 0

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> strut = mb.SpringDamper("strut", mb.Ground().point(0, 0), bob.point(0, 0), 4.0, length=1.0, damping=1.0)
    >>> scene = mb.Scene(mb.System(bob, strut), {"bob.x": 1.5}, [0.0, 1.0])
    >>> run = mb.simulate(scene, mb.CVODES())
    >>> run["bob.x"].round(4)
    array([1.5   , 0.9647])
    """

    stiffness: Expr = 0.0
    damping: Expr = 0.0
    length: Expr = 0.0

    @property
    def kind(self) -> str:
        """`Spring` if the damping is 0, `Damper` if the stiffness is 0, else `SpringDamper`."""
        without_damping, without_stiffness = (
            isinstance(law, int | float) and law == 0 for law in (self.damping, self.stiffness)
        )
        if without_damping == without_stiffness:
            return super().kind
        return "Spring" if without_damping else "Damper"

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        k, c, length = (self.number(bind, what) for what in ("stiffness", "damping", "length"))
        d = self.point_b.r - self.point_a.r
        if not is_zero(k):
            stretch = ca.sumsqr(d) if is_zero(length) else (ca.norm_2(d) - length) ** 2
            force = k * d if is_zero(length) else k * (1 - length / ca.norm_2(d)) * d
            potential = 0.5 * k * stretch if is_constant(k, length) and not is_moved(d) else None
            yield Action(self.pair_loads(force), potential, force=k * (ca.norm_2(d) - length))
        if not is_zero(c):
            rate = ddt(d)
            # Points closer than MEETING do not determine a line. There the pull decreases to 0, and stays finite.
            squared = ca.fmax(ca.sumsqr(d), MEETING**2)
            share = c * ca.dot(d, rate) / squared
            yield Action(self.pair_loads(share * d), force=share * ca.sqrt(squared))


def Spring(name: str, point_a: Point, point_b: Point, stiffness: Expr, length: Expr = 0.0) -> SpringDamper:
    """Spring between two points: stiffness [N/m], length without load [m].

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0)
    >>> scene = mb.Scene(mb.System(bob, spring), {"bob.x": 1.0}, [0.0, 1.0, 2.0])
    >>> mb.simulate(scene)["bob.x"].round(4)
    array([ 1.    , -0.4161, -0.6536])
    """
    return SpringDamper(name, point_a, point_b, stiffness, 0.0, length)


def Damper(name: str, point_a: Point, point_b: Point, damping: Expr) -> SpringDamper:
    """Damper along the line between two points: damping [N s/m].

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> damper = mb.Damper("damper", mb.Ground().point(0, 0), bob.point(0, 0), 0.5)
    >>> scene = mb.Scene(mb.System(bob, damper), {"bob.x": 1.0, "bob.vx": 2.0}, [0.0, 1.0])
    >>> run = mb.simulate(scene, mb.CVODES())
    >>> run["bob.vx"].round(4)
    array([2.    , 1.2131])
    """
    return SpringDamper(name, point_a, point_b, 0.0, damping, 0.0)


@dataclass(frozen=True, eq=False)
class PairTorque(ForceElement):
    """Opposite torques on two bodies as a function of their relative angle about an axis fixed in both bodies."""

    turns = True
    poses: ClassVar = ((Planar, Spatial), (Planar, Spatial))

    name: str
    body_a: AbstractBody
    body_b: AbstractBody

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if not all(isinstance(body, AbstractBody) for body in self.bodies()):
            return
        astray, a = list(direction_faults(self.title, "axis", self.axis)), vector(self.axis)
        yield from astray
        in_plane = any(isinstance(body.pose, Planar) for body in self.bodies())
        if in_plane and not astray and not (is_zero(a[0]) and is_zero(a[1])):
            yield f"{self.title}: planar bodies turn about z only, but the axis is {self.axis}. Use axis=(0, 0, 1)."

    @property
    @abstractmethod
    def axis(self) -> tuple[Expr, ...]:
        """The direction (3,) of the axis. The direction has the same components in the axes of both bodies."""

    @cached_property
    def _angle(self) -> tuple[ca.SX, tuple[Symbol, ...]]:
        """Angle of b relative to a about the axis [rad], and the records of the state that counts its turns."""
        return relative_angle(self.name, self.body_a, unit(vector(self.axis)), self.body_b, ca.SX.eye(3))

    @property
    def alpha(self) -> ca.SX:
        """Angle of b relative to a about the axis [rad]."""
        return self._angle[0]

    def _loads(self, torque: ca.SX) -> tuple[Load, Load]:
        """Loads of a torque on body b and the opposite torque on body a. The power is torque times angular rate."""
        turning = torque * turning_direction(self.body_a, unit(vector(self.axis)), self.body_b, ca.SX.eye(3))
        return (moment_on(self.body_a, -turning), moment_on(self.body_b, turning))


@dataclass(frozen=True, eq=False)
class TorsionSpring(PairTorque):
    """Torsion spring and damper between two bodies about an axis that is fixed in both.

    The torque on body b is -(stiffness (alpha - angle) + damping alpha'). The angle of b relative to a is alpha. If the
    axes do not stay parallel, as on a Spherical joint, alpha is the twist. The relative rotation then has two parts:
    the smallest rotation that makes the axes coincide, and a rotation by alpha about the axis. The potential of the
    spring is stiffness (alpha - angle)^2 / 2 in all cases.

    Parameters
    ----------
    name : str
    body_a, body_b : Body or Ground
    stiffness : Expr
        stiffness [N m/rad]
    damping : Expr
        damping [N m s/rad]
    angle : Expr
        angle without load [rad]
    axis : tuple
        direction of the axis, with the same components in the axes of both bodies

    Examples
    --------
    >>> import symmb as mb
    >>> ground, disc = mb.Ground(), mb.Body("disc", 1.0, 0.5, mb.Planar())
    >>> hinge = mb.Revolute("hinge", ground.point(0, 0), disc.point(0, 0))
    >>> spring = mb.TorsionSpring("spring", ground, disc, stiffness=2.0)
    >>> run = mb.simulate(mb.Scene(mb.System(disc, hinge, spring), {"disc.theta": 0.1}, [0.0, 1.0]))
    >>> run["disc.theta"].round(4)
    array([ 0.1   , -0.0416])
    """

    stiffness: Expr
    damping: Expr = 0.0
    angle: Expr = 0.0
    axis: tuple[Expr, ...] = (0, 0, 1)

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        k, c, rest = (self.number(bind, what) for what in ("stiffness", "damping", "angle"))
        turn = self.alpha - rest
        if not is_zero(k):
            potential = 0.5 * k * turn**2 if is_constant(k, rest) else None
            yield Action(self._loads(-k * turn), potential, force=-k * turn)
        if not is_zero(c):
            torque = -c * ddt(self.alpha)
            yield Action(self._loads(torque), force=torque)


@dataclass(frozen=True, eq=False)
class Bushing(PairForce):
    """Elastic mount between two points: springs and dampers along and about the axes of body a.

    Parameters
    ----------
    name : str
    point_a, point_b : Point
    stiffness, damping : scalar or (x, y, z)
        stiffness [N/m] and damping [N s/m] along the axes
    rotational_stiffness, rotational_damping : scalar or (x, y, z)
        stiffness [N m/rad] and damping [N m s/rad] about the axes, for small angles. Moments use the sine of the angle

    Examples
    --------
    >>> import symmb as mb
    >>> block = mb.Body("block", 2.0, 0.1, mb.Planar())
    >>> foot = mb.Ground().point(0, 0)
    >>> mount = mb.Bushing("mount", foot, block.point(0, 0), (100.0, 400.0, 0.0), rotational_stiffness=5.0)
    >>> run = mb.simulate(mb.Scene(mb.System(block, mount, mb.Gravity(0, -10.0)), equilibrium=True))
    >>> run["block.y"].round(6)
    array([-0.05])
    """

    stiffness: Expr
    damping: Expr = 0.0
    rotational_stiffness: Expr = 0.0
    rotational_damping: Expr = 0.0

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        yield from mount(self.point_a, self.point_b, *mount_matrices(self, bind))

    def doubtful(self, bind: Bind) -> Iterator[tuple[ca.SX, str]]:
        relative = self.point_a.body.frame.R.T @ self.point_b.body.frame.R
        if not is_zero(mount_matrices(self, bind)[2] @ _sines(relative)):
            cosine = (ca.trace(relative) - 1) / 2
            yield (
                cosine - ca.cos(_LARGE_TURN),
                f"the mount turns by more than {_LARGE_TURN:g} rad{{}}. The mount's moment uses the sine of the angle, "
                "and is too small. Use a TorsionSpring.",
            )


def _sines(relative: ca.SX) -> ca.SX:
    """The axis (3,) of a rotation matrix (3, 3), multiplied by the sine of the rotation angle."""
    return ca.inv_skew(relative - relative.T) / 2


def mount_matrices(element: Element, bind: Bind) -> list[ca.SX]:
    """Diagonal matrices (3, 3) of the four laws of an elastic mount. A law is one number or three."""
    matrices = []
    for what in ("stiffness", "damping", "rotational_stiffness", "rotational_damping"):
        law, title = getattr(element, what), f"{element.title}: {what}"
        values = components(law) or [law] * 3
        if len(values) != 3:
            raise DeclarationError(f"{title} has {counted(len(values), 'component')}. Pass one number or three.")
        matrices.append(ca.sparsify(ca.diag(ca.vertcat(*[bind(value, title) for value in values]))))
    return matrices


def mount(point_a: Point, point_b: Point, K: ca.SX, C: ca.SX, K_turn: ca.SX, C_turn: ca.SX) -> Iterator[Action]:
    """Mount between two points. The matrices (3, 3) are in axes of body a [N/m, N s/m, N m/rad, N m s/rad]."""
    a, b = point_a.body, point_b.body
    d = a.frame.R.T @ (point_b.r - point_a.r)
    if not is_zero(K):
        potential = 0.5 * ca.dot(d, K @ d) if is_constant(K) and not is_moved(d) else None
        yield Action(push(point_b, a, -a.frame.R @ K @ d), potential)
    if not is_zero(C):
        yield Action(push(point_b, a, -a.frame.R @ C @ ddt(d)))
    if is_zero(K_turn) and is_zero(C_turn):
        return
    relative = a.frame.R.T @ b.frame.R
    sines = _sines(relative)
    omega = relative @ b.frame.omega - a.frame.omega
    torque = -a.frame.R @ (K_turn @ sines + C_turn @ omega)
    yield Action((moment_on(b, torque), moment_on(a, -torque)))


@dataclass(frozen=True, eq=False)
class Force(ForceElement):
    """A force (fx, fy[, fz]) [N] in world axes at a point: a list, a NumPy array or a CasADi vector.

    Examples
    --------
    >>> import casadi as ca
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 2.0, pose=mb.Particle())
    >>> push = mb.Force("push", bob.point(0, 0), (ca.sin(mb.t), 0))
    >>> mb.simulate(mb.Scene(mb.System(bob, push), times=[0.0, 1.0]))["bob.vx"].round(4)
    array([0.    , 0.2298])
    """

    name: str
    point: Point
    force: tuple[Expr, ...]

    def faults(self) -> Iterator[str]:
        yield from super().faults()
        if components(self.force) is None:
            yield f"{self.title}: expected a force (fx, fy[, fz]), got {shown(self.force)}."

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        values = [bind(f, f"{self.title}: force") for f in components(self.force) or ()]
        yield Action((force_at(self.point, vector(values, self.title)),))


@dataclass(frozen=True, eq=False)
class Torque(ForceElement):
    """A torque tz or (tx, ty, tz) [N m] in world axes on a body: a number, or a list, NumPy array or CasADi vector.

    Examples
    --------
    >>> import symmb as mb
    >>> disc = mb.Body("disc", 1.0, 0.5, mb.Planar())
    >>> brake = mb.Torque("brake", disc, -0.2 * disc.omega)
    >>> mb.simulate(mb.Scene(mb.System(disc, brake), {"disc.omega": 1.0}, [0.0, 1.0]))["disc.omega"].round(4)
    array([1.    , 0.6703])
    """

    poses: ClassVar = ((Planar, Spatial),)

    name: str
    body: AbstractBody
    torque: Expr

    def actions(self, bind: Bind, masses: Sequence[tuple[Body, ca.SX]]) -> Iterator[Action]:
        values = components(self.torque) or (0, 0, self.torque)
        yield Action((moment_on(self.body, vector([bind(v, f"{self.title}: torque") for v in values], self.title)),))
