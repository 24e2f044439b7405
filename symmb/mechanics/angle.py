"""The angle between two bodies about a common axis, with its turns counted."""

import math

import casadi as ca

from symmb.mechanics.body import AbstractBody
from symmb.mechanics.pose import turns_about_z
from symmb.symbolic import Kind, Symbol, declare, triad


def relative_angle(
    name: str, a: AbstractBody, axis_a: ca.SX, b: AbstractBody, alignment: ca.SX
) -> tuple[ca.SX, tuple[Symbol, ...]]:
    """Angle of body b relative to body a about an axis fixed in both [rad], and the records of its state.

    The angle is 0 where `alignment` (3, 3) turns vectors from axes of body a to those of body b.

    For bodies that turn about z alone it is a difference of coordinates. Quaternions determine an angle only up to
    whole turns. Therefore a first-order state named `name.angle` follows the angle. It only chooses the number of
    turns, so that its error is not an error of the angle.
    """
    if turns_about_z(a.pose) and turns_about_z(b.pose):
        return (b.frame.angle - a.frame.angle) * axis_a[2], ()
    frame_a = triad(axis_a)
    A = a.frame.R @ frame_a
    B = b.frame.R @ alignment @ frame_a
    wrapped = ca.atan2(ca.dot(A[:, 1], B[:, 0]), ca.dot(A[:, 0], B[:, 0]))
    rate = ca.dot(A[:, 2], b.frame.R @ b.frame.omega - a.frame.R @ a.frame.omega)
    state = ca.SX.sym(f"{name}.angle")
    records = declare([f"{name}.angle"], Kind.STATE, state, rate, wrapped)
    return wrapped + 2 * math.pi * ca.floor((state - wrapped) / (2 * math.pi) + 0.5), records
