"""Joint coordinates: the relative motion of two frames, one on each body of a joint."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from symmb._magnitudes import LAST_DIGITS
from symmb.declare.mechanics.element import Bind
from symmb.declare.symbolic import product, rotation_matrix, rotation_z

AXIS = ca.SX(ca.sparsify(ca.DM([0, 0, 1])))
_QUARTER = ca.SX(ca.sparsify(ca.DM([[1, 0, 0], [0, 0, -1], [0, 1, 0]])))
"""Rotation matrix about x: it makes the z axes of a universal joint's frames normal to each other."""


@dataclass(frozen=True, eq=False)
class RelativePose:
    """The pose of one frame relative to another frame, as expressions of body coordinates."""

    shift: ca.SX  # (3,) [m]
    turn: ca.SX  # (3, 3), rotation matrix
    quaternion: ca.SX  # (4,), quaternion of `turn`
    angle: ca.SX | None = None  # angle of planar bodies [rad]


@dataclass(frozen=True, eq=False)
class Turn:
    """A rotation: matrix (3, 3), quaternion (4,), angular velocity `spin` (3,) in rotated axes, and angle about z."""

    matrix: ca.SX
    quaternion: ca.SX
    spin: ca.SX
    angle: ca.SX


def about_z(angle: ca.SX, rate: ca.SX) -> Turn:
    """The rotation by an angle about the common axis z of two frames."""
    half = angle / 2
    return Turn(rotation_z(angle), ca.vertcat(ca.cos(half), 0, 0, ca.sin(half)), rate * AXIS, angle)


_NONE = Turn(ca.SX.eye(3), ca.SX(ca.sparsify(ca.DM([1, 0, 0, 0]))), ca.SX(3, 1), ca.SX(0))


def about_two(q: ca.SX, u: ca.SX) -> Turn:
    """The rotation about the axis of body a, and then about the axis of body b. The axes are normal to each other."""
    first, second = about_z(q[0], u[0]), about_z(q[1], u[1])
    between = product(quaternion_of(_QUARTER), second.quaternion)
    E = _QUARTER @ second.matrix
    return Turn(first.matrix @ E, product(first.quaternion, between), E.T @ first.spin + second.spin, ca.SX(0))


def about_point(e: ca.SX, omega: ca.SX) -> Turn:
    """The rotation by a quaternion, with an angular velocity in axes of the frame on body b."""
    return Turn(rotation_matrix(e), e / ca.norm_2(e), omega, ca.SX(0))


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
    e[np.abs(e) < LAST_DIGITS] = 0.0  # exact zeros make products shorter
    return ca.SX(ca.sparsify(ca.DM(e * (1 if e[0] >= 0 else -1))))


def angle_of(pose: RelativePose) -> ca.SX:
    """The angle [rad] for which `about_z` gives the rotation of a pose."""
    return ca.atan2(pose.turn[1, 0], pose.turn[0, 0]) if pose.angle is None else pose.angle


def angles_of(pose: RelativePose) -> ca.SX:
    """The two angles (2,) [rad] for which `about_two` gives the rotation of a pose."""
    E = pose.turn
    return ca.vertcat(ca.atan2(E[0, 2], -E[1, 2]), ca.atan2(E[2, 0], E[2, 1]))


@dataclass(frozen=True, eq=False)
class JointCoordinates:
    """Coordinates q (k,) and velocities u (n,) of the motion of body b relative to body a.

    `turn(q, u)` is the rotation of the frame on body b relative to the frame on body a. `shift(joint, q, bind)` is the
    relative position (3,) [m] in axes of the frame on body a. `measured(pose)` returns the coordinates (k,) of a pose.
    """

    q_names: tuple[str, ...] = ()
    u_names: tuple[str, ...] = ()
    turn: Callable[[ca.SX, ca.SX], Turn] = lambda q, u: _NONE
    shift: Callable[[Any, ca.SX, Bind], ca.SX] = lambda joint, q, bind: ca.SX(3, 1)
    measured: Callable[[RelativePose], ca.SX] = lambda pose: ca.SX(0, 1)
    q_rate: Callable[[ca.SX, ca.SX], ca.SX] = lambda q, u: u
    crossed: bool = False  # whether the axes are not parallel: the z axis of each frame is then the axis of its body
    in_plane: "JointCoordinates | None" = None  # coordinates of the joint if one of the bodies is planar


HINGE = JointCoordinates(("angle",), ("angle_rate",), about_z, measured=angle_of)
