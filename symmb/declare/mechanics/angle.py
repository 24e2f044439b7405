"""The angle between two bodies about a common axis, including whole turns."""

import casadi as ca

from symmb._interrupts import kept_interrupts
from symmb.declare.mechanics.body import AbstractBody
from symmb.declare.mechanics.pose import turns_about_z
from symmb.declare.symbolic import Kind, Symbol, declare, triad


@kept_interrupts()
def relative_angle(
    name: str, a: AbstractBody, axis_a: ca.SX, b: AbstractBody, alignment: ca.SX, parallel: bool = False
) -> tuple[ca.SX, tuple[Symbol, ...]]:
    """Angle [rad] of body b relative to body a about an axis fixed in both bodies, and the records of its state.

    The angle is 0 if `alignment` (3, 3) converts components in axes of body a to axes of body b. If the axes of the
    bodies do not stay parallel, the angle is the twist. The relative rotation then consists of the smallest rotation
    that makes the axes coincide, and the rotation by this angle about the axis. If a joint keeps the axes parallel,
    `parallel` gives shorter expressions.

    If both bodies turn about z only, the angle is a difference of coordinates. In other cases, quaternions determine
    the angle up to whole turns. A first-order state named `name.angle` follows the angle. The state only determines the
    number of turns. So the angle has neither kinks nor jumps, and an error of the state is not an error of the angle.
    """
    if turns_about_z(a.pose) and turns_about_z(b.pose):
        return (b.frame.angle - a.frame.angle) * axis_a[2], ()
    frame_a = triad(axis_a)
    A = a.frame.R @ frame_a
    B = b.frame.R @ alignment @ frame_a
    sine, cosine = ca.dot(A[:, 1], B[:, 0]), ca.dot(A[:, 0], B[:, 0])
    # The twist follows from sums over two columns. The sums are not normalized, because atan2 uses only their ratio.
    if not parallel:
        sine, cosine = sine - ca.dot(A[:, 0], B[:, 1]), cosine + ca.dot(A[:, 1], B[:, 1])
    wrapped = ca.atan2(sine, cosine)
    omega = b.frame.R @ b.frame.omega - a.frame.R @ a.frame.omega
    rate = ca.dot(A[:, 2] if parallel else turning_direction(a, axis_a, b, alignment), omega)
    state = ca.SX.sym(f"{name}.angle")
    records = declare([f"{name}.angle"], Kind.STATE, state, rate, wrapped)
    # The state is subtracted from the angle before atan2 is used. The difference is far from the jump of atan2 at pi.
    s, c = ca.sin(state), ca.cos(state)
    return state + ca.atan2(sine * c - cosine * s, cosine * c + sine * s), records


def turning_direction(a: AbstractBody, axis_a: ca.SX, b: AbstractBody, alignment: ca.SX) -> ca.SX:
    """Vector (3,) in world axes. The rate of `relative_angle` is vector . relative angular velocity (dot product).

    If the axes of the bodies are parallel, the vector is the axis. A torque along the vector does work on this angle
    only. So a torsion spring conserves energy for all motions of the bodies.
    """
    axis = a.frame.R @ axis_a
    if turns_about_z(a.pose) and turns_about_z(b.pose):
        return axis
    other = b.frame.R @ alignment @ axis_a
    return (axis + other) / (1 + ca.dot(axis, other))
