"""Multipliers of the constraints, and reactions of joints."""

from collections.abc import Sequence

import casadi as ca

from symmb._errors import DeclarationError
from symmb._names import did_you_mean, normal
from symmb._options import shown
from symmb.declare.mechanics import Ground, Joint


class Multipliers(ca.SX):
    """All multipliers as one SX vector. A call with the name of a joint returns the multipliers of this joint."""

    rows: dict[str, slice]

    def __call__(self, name: str) -> ca.SX:
        name = normal(name)
        if not isinstance(name, str) or name not in self.rows:
            raise DeclarationError(f"There is no constraint {name!r} with multipliers.{did_you_mean(name, self.rows)}")
        return ca.SX(self)[self.rows[name]]


class Reaction:
    """Reaction on the second body of a joint, at its point, in world axes: force (3,) [N], torque (3,) [N m]."""

    def __init__(self, force: ca.SX, torque: ca.SX) -> None:
        self.force, self.torque = force, torque
        self.fx, self.fy, self.fz = ca.vertsplit(force)
        self.tx, self.ty, self.tz = ca.vertsplit(torque)


def reaction(joints: Sequence[Joint], name: str, Phi: ca.SX, lam: Multipliers) -> Reaction:
    """Reaction of the joint with this name, from the position rows (n_c,) and the multipliers of a system."""
    known, name = {joint.name: joint for joint in joints}, normal(name)
    if not isinstance(name, str):
        raise DeclarationError(f"The name of a joint must be a text, got {shown(name)}.{did_you_mean(name, known)}")
    if name not in known:
        hint = f" Its multipliers are system.lam({name!r})." if name in lam.rows else did_you_mean(name, known)
        raise DeclarationError(f"There is no joint {name!r} between two bodies.{hint}")
    if name not in lam.rows:
        raise DeclarationError(
            f"Joint {name!r} has no multipliers in joint coordinates. Use the reaction of the system before "
            "joint_space()."
        )
    return joint_reaction(known[name], Phi[lam.rows[name]], lam(name))


def joint_reaction(joint: Joint, rows: ca.SX, lam: ca.SX) -> Reaction:
    """Reaction of a joint with position rows (n,) and multipliers (n,), by the virtual power of the rows."""
    onto_b = not isinstance(joint.point_b.body, Ground)
    point = joint.point_b if onto_b else joint.point_a
    frame = point.body.frame
    # The wrench on the body about its centre of mass is -(d rows'/d twist)' lam.
    twist = ca.SX.sym("twist", 6)
    q_rate = ca.substitute(frame.rate, frame.v, ca.densify(frame.rigid @ twist))
    rate = ca.jtimes(rows, frame.q, q_rate)
    wrench = -ca.jacobian(rate, twist).T @ lam
    force, torque = wrench[:3], frame.R @ wrench[3:]
    torque = torque - ca.cross(frame.R @ point.s, force)
    if onto_b:
        return Reaction(ca.densify(force), ca.densify(torque))
    torque = torque + ca.cross(point.r - joint.point_b.r, force)
    return Reaction(ca.densify(-force), ca.densify(-torque))
