"""The relative motion that a joint allows, in coordinates of its own."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from symmb.mechanics import (
    AxisJoint,
    Cylindrical,
    Joint,
    Particle,
    Planar,
    PlanarJoint,
    Prismatic,
    Revolute,
    Screw,
    Spatial,
    Spherical,
    Universal,
    Weld,
)
from symmb.model.binding import Binding
from symmb.symbolic import (
    Kind,
    Symbol,
    conjugate,
    declare,
    product,
    quaternion_rate,
    rotation_matrix,
    rotation_z,
    symbols_in,
    symmetric_solver,
    triad,
)

Z = ca.SX(ca.sparsify(ca.DM([0, 0, 1])))
_QUARTER = ca.SX(ca.sparsify(ca.DM([[1, 0, 0], [0, 0, -1], [0, 1, 0]])))
"""Rotation about x that makes the axes z of a universal joint's frames normal to each other."""


@dataclass(frozen=True, eq=False)
class Relative:
    """Measured position of one frame on another.

    shift (3,), turn (3, 3), its quaternion (4,), and the angle of planar bodies [rad], which the others do not have.
    """

    shift: ca.SX
    turn: ca.SX
    quaternion: ca.SX
    angle: ca.SX | None = None


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Motion of a joint's frame on the follower relative to the one on its carrier, in k coordinates and n rates.

    Attributes
    ----------
    q_names, u_names : tuples of str
    q : (k,), u : (n,), q_rate : (k,)       coordinates, velocities and q'
    shift : (3,)           position of the follower's frame in axes of the carrier's [m]
    turn : (3, 3)          rotation, axes of the follower's frame to those of the carrier's
    quaternion : (4,)      of `turn`
    spin : (3,)            angular velocity in axes of the follower's frame [rad/s]
    angle : scalar         of planar bodies, the follower's less the carrier's [rad]
    carrier, follower : (3, 3)              rotations of the frames, frame to body
    carrier_quaternion, follower_quaternion : (4,)       of these, zeros between planar bodies
    records                what the symbols of q and u are
    measured : Relative -> (k,)             the coordinates of a position
    """

    q_names: tuple[str, ...]
    u_names: tuple[str, ...]
    q: ca.SX
    u: ca.SX
    q_rate: ca.SX
    shift: ca.SX
    turn: ca.SX
    quaternion: ca.SX
    spin: ca.SX
    angle: ca.SX
    carrier: ca.SX
    follower: ca.SX
    carrier_quaternion: ca.SX
    follower_quaternion: ca.SX
    measured: Callable[[Relative], ca.SX]
    records: tuple[Symbol, ...]

    def turned(self, turns: int) -> "JointMotion":
        """The same motion of planar bodies, of which the follower has made whole turns."""
        return replace(self, angle=self.angle + 2 * ca.pi * turns)

    def reversed(self) -> "JointMotion":
        """The same motion with carrier and follower exchanged."""

        def measured(seen: Relative) -> ca.SX:
            back, angle = seen.turn.T, None if seen.angle is None else -seen.angle
            return self.measured(Relative(-back @ seen.shift, back, conjugate(seen.quaternion), angle))

        return replace(
            self,
            shift=-self.turn.T @ self.shift,
            turn=self.turn.T,
            quaternion=conjugate(self.quaternion),
            spin=-self.turn @ self.spin,
            angle=-self.angle,
            carrier=self.follower,
            follower=self.carrier,
            carrier_quaternion=self.follower_quaternion,
            follower_quaternion=self.carrier_quaternion,
            measured=measured,
        )

    @cached_property
    def speed(self) -> ca.SX:
        """Rate of `shift` (3,) [m/s]."""
        return ca.jtimes(self.shift, self.q, self.q_rate)

    @cached_property
    def speed_matrix(self) -> ca.SX:
        """(3, n) in speed = speed_matrix u."""
        return ca.jacobian(self.speed, self.u)

    @cached_property
    def spin_matrix(self) -> ca.SX:
        """(3, n) in spin = spin_matrix u."""
        return ca.jacobian(self.spin, self.u)

    @cached_property
    def speed_change(self) -> ca.SX:
        """Rate of `speed` without accelerations (3,) [m/s^2]."""
        return ca.jtimes(self.speed, self.q, self.q_rate)

    @cached_property
    def spin_change(self) -> ca.SX:
        """Rate of `spin` without accelerations (3,) [rad/s^2]."""
        return ca.jtimes(self.spin, self.q, self.q_rate)

    def rates(self, speed: ca.SX, spin: ca.SX) -> ca.SX:
        """The velocities (n,) of a motion with this speed and this spin."""
        H = ca.vertcat(self.speed_matrix, self.spin_matrix)
        return symmetric_solver(H.T @ H)(H.T @ ca.vertcat(speed, spin)) if H.shape[1] else ca.SX(0, 1)


def _quaternion_of_frame(F: ca.SX, bind: Binding) -> ca.SX:
    """The quaternion (4,) of a rotation matrix that may depend on parameters, scalar first.

    Its largest component at their nominal values divides the others: it is regular up to rotations by 60 degrees from
    there. (Shepperd 1978, J. Guid. Control 1(3))
    """
    if F.is_constant():
        return quaternion_of(F)
    at, trace = bind.nominal(F), ca.trace(F)
    x, y, z = F[2, 1] - F[1, 2], F[0, 2] - F[2, 0], F[1, 0] - F[0, 1]
    xy, xz, yz = F[0, 1] + F[1, 0], F[0, 2] + F[2, 0], F[1, 2] + F[2, 1]
    products = [  # of the components, times 4
        [1 + trace, x, y, z],
        [x, 1 + 2 * F[0, 0] - trace, xy, xz],
        [y, xy, 1 + 2 * F[1, 1] - trace, yz],
        [z, xz, yz, 1 + 2 * F[2, 2] - trace],
    ]
    e = ca.vertcat(*products[int(np.argmax([np.trace(at), *np.diag(at)]))])
    return ca.sparsify(e / ca.norm_2(e))


def _angle_in_plane(a: ca.SX, b: ca.SX, bind: Binding) -> ca.SX:
    """The angle about z by which a body turns whose axis b comes to lie on a [rad].

    It passes half a turn without a jump: with parameters, it is counted from its nominal value.
    """
    if a.is_constant() and b.is_constant():
        return ca.atan2(a[1], a[0]) - ca.atan2(b[1], b[0])
    c, s = b[0] * a[0] + b[1] * a[1], b[0] * a[1] - b[1] * a[0]
    c0, s0 = bind.nominal(ca.vertcat(c, s)).ravel()
    return float(np.arctan2(s0, c0)) + ca.atan2(s * c0 - c * s0, c * c0 + s * s0)


def quaternion_of(F: ca.SX) -> ca.SX:
    """The quaternion (4,) of a constant rotation matrix, scalar first. (Shepperd 1978, J. Guid. Control 1(3))"""
    R = ca.DM(F).full()
    K = np.array(
        [
            [np.trace(R), R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [0, 2 * R[0, 0] - np.trace(R), R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
            [0, 0, 2 * R[1, 1] - np.trace(R), R[1, 2] + R[2, 1]],
            [0, 0, 0, 2 * R[2, 2] - np.trace(R)],
        ]
    )
    e = np.linalg.eigh(K, "U")[1][:, -1]
    e[np.abs(e) < 1e-15] = 0.0  # exact zeros make products shorter
    return ca.SX(ca.sparsify(ca.DM(e * (1 if e[0] >= 0 else -1))))


@dataclass(frozen=True, eq=False)
class _Turn:
    """A rotation: matrix (3, 3), quaternion (4,), spin (3,) in the follower's axes, and angle about z."""

    matrix: ca.SX
    quaternion: ca.SX
    spin: ca.SX
    angle: ca.SX


def _about_z(angle: ca.SX, rate: ca.SX) -> _Turn:
    half = angle / 2
    return _Turn(rotation_z(angle), ca.vertcat(ca.cos(half), 0, 0, ca.sin(half)), rate * Z, angle)


def _none() -> _Turn:
    return _Turn(ca.SX.eye(3), ca.SX(ca.sparsify(ca.DM([1, 0, 0, 0]))), ca.SX(3, 1), ca.SX(0))


def _about_two(q: ca.SX, u: ca.SX) -> _Turn:
    first, second = _about_z(q[0], u[0]), _about_z(q[1], u[1])
    between = product(quaternion_of(_QUARTER), second.quaternion)
    E = _QUARTER @ second.matrix
    return _Turn(first.matrix @ E, product(first.quaternion, between), E.T @ first.spin + second.spin, ca.SX(0))


def _about_point(e: ca.SX, omega: ca.SX) -> _Turn:
    return _Turn(rotation_matrix(e), e / ca.norm_2(e), omega, ca.SX(0))


def _angle(seen: Relative) -> ca.SX:
    return ca.atan2(seen.turn[1, 0], seen.turn[0, 0]) if seen.angle is None else seen.angle


def _angles(seen: Relative) -> ca.SX:
    E = seen.turn
    return ca.vertcat(ca.atan2(E[0, 2], -E[1, 2]), ca.atan2(E[2, 0], E[2, 1]))


@dataclass(frozen=True, eq=False)
class _Kind:
    """Coordinates and velocities of a kind of joint, how it turns and shifts, and how its coordinates are measured."""

    coordinates: tuple[str, ...] = ()
    velocities: tuple[str, ...] = ()
    turn: Callable[[ca.SX, ca.SX], _Turn] = lambda q, u: _none()
    shift: Callable[[ca.SX], ca.SX] = lambda q: ca.SX(3, 1)
    measured: Callable[[Relative], ca.SX] = lambda seen: ca.SX(0, 1)


_HINGE = _Kind(("angle",), ("angle_rate",), _about_z, measured=_angle)
_KINDS = {
    Revolute: _HINGE,
    Screw: _HINGE,
    Prismatic: _Kind(
        ("displacement",), ("displacement_rate",), shift=lambda q: q * Z, measured=lambda seen: seen.shift[2]
    ),
    Cylindrical: _Kind(
        ("angle", "displacement"),
        ("angle_rate", "displacement_rate"),
        lambda q, u: _about_z(q[0], u[0]),
        lambda q: q[1] * Z,
        lambda seen: ca.vertcat(_angle(seen), seen.shift[2]),
    ),
    PlanarJoint: _Kind(
        ("x", "y", "angle"),
        ("vx", "vy", "angle_rate"),
        lambda q, u: _about_z(q[2], u[2]),
        lambda q: ca.vertcat(q[:2], ca.SX(1, 1)),
        lambda seen: ca.vertcat(seen.shift[:2], _angle(seen)),
    ),
    Universal: _Kind(("angle_a", "angle_b"), ("angle_a_rate", "angle_b_rate"), _about_two, measured=_angles),
    Spherical: _Kind(
        ("e0", "e1", "e2", "e3"), ("omega_x", "omega_y", "omega_z"), _about_point, measured=lambda seen: seen.quaternion
    ),
    Weld: _Kind(),
}


def _kind_of(joint: Joint) -> _Kind | None:
    """The kind of a joint between rigid bodies that can turn; in the plane a spherical joint is a hinge."""
    poses = [body.pose for body in joint.bodies()]
    if any(isinstance(pose, Particle) or pose.modes for pose in poses):
        return None
    in_plane = isinstance(joint, Spherical) and any(isinstance(pose, Planar) for pose in poses)
    return _HINGE if in_plane else _KINDS.get(type(joint))


def motion_of(joint: Joint, bind: Binding) -> JointMotion | None:
    """The motion of body b relative to body a; None if no coordinates suit the joint, its axes or its bodies."""
    kind = _kind_of(joint)
    if kind is None:
        return None
    (a, b), frames = (Z, Z), (triad(Z), triad(Z))
    if isinstance(joint, AxisJoint):
        (a, b), frames = joint.axes, joint.own_frames
    if not all(bind.is_parameter(symbol) for symbol in symbols_in(ca.vertcat(a, b, ca.vec(frames[1])))):
        return None
    q, q_names = _symbols(joint.name, kind.coordinates)
    u, u_names = _symbols(joint.name, kind.velocities)
    turned, shift = kind.turn(q, u), kind.shift(q)
    if isinstance(joint, Screw):
        shift = bind(joint.pitch, f"{joint.title}: pitch") * q / (2 * ca.pi) * Z
    carrier, follower = ca.sparsify(frames[0]), ca.sparsify(triad(b) if isinstance(joint, Universal) else frames[1])
    in_space = any(isinstance(body.pose, Spatial) for body in joint.bodies())
    quaternions = [_quaternion_of_frame(F, bind) if in_space else ca.SX(4, 1) for F in (carrier, follower)]
    q_rate = quaternion_rate(q, u) if kind is _KINDS[Spherical] else u
    return JointMotion(
        q_names=q_names,
        u_names=u_names,
        q=q,
        u=u,
        q_rate=q_rate,
        shift=shift,
        turn=ca.sparsify(turned.matrix),
        quaternion=turned.quaternion,
        spin=turned.spin,
        angle=turned.angle * a[2] + _angle_in_plane(a, b, bind),
        carrier=carrier,
        follower=follower,
        carrier_quaternion=quaternions[0],
        follower_quaternion=quaternions[1],
        measured=kind.measured,
        records=declare(q_names, Kind.COORDINATE, q, q_rate) + declare(u_names, Kind.VELOCITY, u),
    )


def _symbols(owner: str, names: tuple[str, ...]) -> tuple[ca.SX, tuple[str, ...]]:
    full = tuple(f"{owner}.{name}" for name in names)
    return ca.vertcat(*[ca.SX.sym(name) for name in full]) if full else ca.SX(0, 1), full
