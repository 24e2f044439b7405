"""The angle between two bodies about a common axis, with its turns counted."""

import casadi as ca

from symmb._interrupts import kept_interrupts
from symmb.declare.mechanics.body import AbstractBody
from symmb.declare.mechanics.pose import turns_about_z
from symmb.declare.symbolic import Kind, Symbol, declare, triad


@kept_interrupts()
def relative_angle(
    name: str, a: AbstractBody, axis_a: ca.SX, b: AbstractBody, alignment: ca.SX, parallel: bool = False
) -> tuple[ca.SX, tuple[Symbol, ...]]:
    """Angle of body b relative to body a about an axis fixed in both [rad], and the records of its state.

    The angle is 0 where `alignment` (3, 3) turns vectors from axes of body a to those of body b. Where the axes do not
    stay parallel, it is the twist: the least rotation that brings the axes together does not count. Where a joint keeps
    them parallel, that costs nothing.

    For bodies that turn about z alone it is a difference of coordinates. Quaternions determine an angle only up to
    whole turns. Therefore a first-order state named `name.angle` follows the angle. It only chooses the number of
    turns, so that its error is not an error of the angle. The angle has neither kinks nor jumps.
    """
    if turns_about_z(a.pose) and turns_about_z(b.pose):
        return (b.frame.angle - a.frame.angle) * axis_a[2], ()
    frame_a = triad(axis_a)
    A = a.frame.R @ frame_a
    B = b.frame.R @ alignment @ frame_a
    sine, cosine = ca.dot(A[:, 1], B[:, 0]), ca.dot(A[:, 0], B[:, 0])
    if not parallel:
        sine, cosine = sine - ca.dot(A[:, 0], B[:, 1]), cosine + ca.dot(A[:, 1], B[:, 1])
    wrapped = ca.atan2(sine, cosine)
    omega = b.frame.R @ b.frame.omega - a.frame.R @ a.frame.omega
    rate = ca.dot(A[:, 2] if parallel else turning_direction(a, axis_a, b, alignment), omega)
    state = ca.SX.sym(f"{name}.angle")
    records = declare([f"{name}.angle"], Kind.STATE, state, rate, wrapped)
    s, c = ca.sin(state), ca.cos(state)
    return state + ca.atan2(sine * c - cosine * s, cosine * c + sine * s), records


def turning_direction(a: AbstractBody, axis_a: ca.SX, b: AbstractBody, alignment: ca.SX) -> ca.SX:
    """The vector (3,) in world axes whose product with the relative angular velocity is the rate of `relative_angle`.

    It is the axis where the axes are parallel. A torque along it does work on this angle alone, so that no energy is
    created, whatever else the bodies do.
    """
    axis = a.frame.R @ axis_a
    if turns_about_z(a.pose) and turns_about_z(b.pose):
        return axis
    other = b.frame.R @ alignment @ axis_a
    return (axis + other) / (1 + ca.dot(axis, other))
