"""Multipliers of the constraints, and reactions of joints."""

import casadi as ca

from symmb._errors import DeclarationError
from symmb._names import did_you_mean


class Multipliers(ca.SX):
    """All multipliers as one SX vector. A call with the name of a joint gives those of the joint."""

    rows: dict[str, slice]

    def __call__(self, name: str) -> ca.SX:
        if not isinstance(name, str) or name not in self.rows:
            raise DeclarationError(f"No constraint {name!r} with multipliers.{did_you_mean(name, self.rows)}")
        return ca.SX(self)[self.rows[name]]


class Reaction:
    """Reaction on the second body of a joint, at its point, in world axes: force (3,) [N], torque (3,) [N m]."""

    def __init__(self, force: ca.SX, torque: ca.SX) -> None:
        self.force, self.torque = force, torque
        self.fx, self.fy, self.fz = ca.vertsplit(force)
        self.tx, self.ty, self.tz = ca.vertsplit(torque)
