"""The relative motion that a joint allows, in joint coordinates."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from symmb.declare.mechanics import (
    AXIS,
    AxisJoint,
    Joint,
    JointCoordinates,
    Particle,
    Planar,
    RelativePose,
    Spatial,
    quaternion_of,
)
from symmb.declare.symbolic import Kind, Symbol, conjugate, declare, symmetric_solver, triad
from symmb.equations.model.binding import Binding


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Motion of the follower's joint frame relative to the carrier's joint frame, in k coordinates and n rates."""

    q_names: tuple[str, ...]
    u_names: tuple[str, ...]
    q: ca.SX  # (k,), coordinates
    u: ca.SX  # (n,), velocities
    q_rate: ca.SX  # (k,), q'
    shift: ca.SX  # (3,), position of the follower's joint frame in axes of the carrier's joint frame [m]
    turn: ca.SX  # (3, 3), rotation from the follower's to the carrier's joint frame
    quaternion: ca.SX  # (4,), quaternion of `turn`
    spin: ca.SX  # (3,), angular velocity in axes of the follower's frame [rad/s]
    angle: ca.SX  # for planar bodies: follower's angle minus carrier's angle [rad]
    carrier: ca.SX  # (3, 3), the joint's frame on the carrier to its body
    follower: ca.SX  # (3, 3), the joint's frame on the follower to its body
    carrier_quaternion: ca.SX  # (4,), of `carrier`; zeros between planar bodies
    follower_quaternion: ca.SX  # (4,), of `follower`; zeros between planar bodies
    measured: Callable[[RelativePose], ca.SX]  # the coordinates (k,) of a position
    records: tuple[Symbol, ...]  # records of the symbols in q and u

    def turned(self, turns: int) -> "JointMotion":
        """The motion of planar bodies after whole turns of the follower."""
        return replace(self, angle=self.angle + 2 * ca.pi * turns)

    def reversed(self) -> "JointMotion":
        """The motion with carrier and follower exchanged."""

        def measured(seen: RelativePose) -> ca.SX:
            back, angle = seen.turn.T, None if seen.angle is None else -seen.angle
            return self.measured(RelativePose(-back @ seen.shift, back, conjugate(seen.quaternion), angle))

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
        """Matrix (3, n) in speed = speed_matrix u."""
        return ca.jacobian(self.speed, self.u)

    @cached_property
    def spin_matrix(self) -> ca.SX:
        """Matrix (3, n) in spin = spin_matrix u."""
        return ca.jacobian(self.spin, self.u)

    @cached_property
    def speed_change(self) -> ca.SX:
        """Rate of `speed` for u' = 0, (3,) [m/s^2]."""
        return ca.jtimes(self.speed, self.q, self.q_rate)

    @cached_property
    def spin_change(self) -> ca.SX:
        """Rate of `spin` for u' = 0, (3,) [rad/s^2]."""
        return ca.jtimes(self.spin, self.q, self.q_rate)

    def rates(self, speed: ca.SX, spin: ca.SX) -> ca.SX:
        """The velocities (n,) of a motion with this speed and this spin."""
        H = ca.vertcat(self.speed_matrix, self.spin_matrix)
        return symmetric_solver(H.T @ H)(H.T @ ca.vertcat(speed, spin)) if H.shape[1] else ca.SX(0, 1)


def _quaternion_of_frame(F: ca.SX, bind: Binding) -> ca.SX:
    """The quaternion (4,) of a rotation matrix that may depend on parameters, scalar first.

    The formulas divide by the component that is largest at the nominal parameters. The result is regular for rotations
    up to 60 degrees from the nominal rotation. (Shepperd 1978, J. Guid. Control 1(3))
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
    """The angle about z that turns the axis b onto the axis a [rad].

    If the angle depends on parameters, it is counted from the nominal angle, so it has no jump at half a turn.
    """
    if a.is_constant() and b.is_constant():
        return ca.atan2(a[1], a[0]) - ca.atan2(b[1], b[0])
    c, s = b[0] * a[0] + b[1] * a[1], b[0] * a[1] - b[1] * a[0]
    c0, s0 = bind.nominal(ca.vertcat(c, s)).ravel()
    return float(np.arctan2(s0, c0)) + ca.atan2(s * c0 - c * s0, c * c0 + s * s0)


def _coordinates_of(joint: Joint) -> JointCoordinates | None:
    """The joint coordinates of a joint between rigid bodies that can rotate; None for other joints."""
    poses = [body.pose for body in joint.bodies()]
    if joint.motion is None or any(isinstance(pose, Particle) or pose.modes for pose in poses):
        return None
    in_plane = any(isinstance(pose, Planar) for pose in poses)
    return (joint.motion.in_plane if in_plane else None) or joint.motion


def motion_of(joint: Joint, bind: Binding) -> JointMotion | None:
    """The motion of body b relative to body a; None if joint, axes or bodies do not allow joint coordinates."""
    coordinates = _coordinates_of(joint)
    if coordinates is None:
        return None
    (a, b), frames = (AXIS, AXIS), (triad(AXIS), triad(AXIS))
    if isinstance(joint, AxisJoint):
        (a, b), frames = joint.axes, joint.own_frames
    if not bind.has_parameters_alone(ca.vertcat(a, b, ca.vec(frames[1]))):
        return None
    q, q_names = _symbols(joint.name, coordinates.q_names)
    u, u_names = _symbols(joint.name, coordinates.u_names)
    turned, q_rate = coordinates.turn(q, u), coordinates.q_rate(q, u)
    carrier, follower = ca.sparsify(frames[0]), ca.sparsify(triad(b) if coordinates.crossed else frames[1])
    in_space = any(isinstance(body.pose, Spatial) for body in joint.bodies())
    quaternions = [_quaternion_of_frame(F, bind) if in_space else ca.SX(4, 1) for F in (carrier, follower)]
    return JointMotion(
        q_names=q_names,
        u_names=u_names,
        q=q,
        u=u,
        q_rate=q_rate,
        shift=coordinates.shift(joint, q, bind),
        turn=ca.sparsify(turned.matrix),
        quaternion=turned.quaternion,
        spin=turned.spin,
        angle=turned.angle * a[2] + _angle_in_plane(a, b, bind),
        carrier=carrier,
        follower=follower,
        carrier_quaternion=quaternions[0],
        follower_quaternion=quaternions[1],
        measured=coordinates.measured,
        records=declare(q_names, Kind.COORDINATE, q, q_rate) + declare(u_names, Kind.VELOCITY, u),
    )


def _symbols(owner: str, names: tuple[str, ...]) -> tuple[ca.SX, tuple[str, ...]]:
    full = tuple(f"{owner}.{name}" for name in names)
    return ca.vertcat(*[ca.SX.sym(name) for name in full]) if full else ca.SX(0, 1), full
