"""The poses of bodies: coordinates, velocities, and the frame that depends on them.

All poses have the same kinematics: position r (3,), rotation R (3, 3) body to world, and twist (r', omega) = S v, (6,).
r' is in world axes, and omega is in body axes. The matrix S selects velocities. A planar pose is a spatial pose whose
entries out of the plane are always zero. A flexible body has the coordinates of its floating frame, followed by modal
coordinates.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from symmb._options import whole
from symmb.declare.symbolic import (
    Kind,
    Symbol,
    declare,
    product,
    quaternion_rate,
    rotation_by,
    rotation_matrix,
    rotation_z,
    vector,
)


@dataclass(frozen=True, eq=False)
class Frame:
    """The coordinates of a body and a frame that depends on them: the frame of the body, or of a flexible body's node.

    Fields: q (n_q,), v (n_v,), rate q' = N v (n_q,), r (3,) [m], R (3, 3), S (6, n_v) with the twist (r', omega) = S v,
    and the angle [rad] about +z of a body that turns about z only. `rigid` (n_v, 6) times a twist of the frame gives
    the velocities of a rigid motion. `records` contain the symbols.
    """

    q: ca.SX
    v: ca.SX
    rate: ca.SX
    r: ca.SX
    R: ca.SX
    S: ca.SX
    angle: ca.SX
    rigid: ca.SX
    records: tuple[Symbol, ...]

    @property
    def velocity(self) -> ca.SX:
        """Velocity of the origin in world axes [m/s], (3,)."""
        return self.S[:3, :] @ self.v

    @property
    def omega(self) -> ca.SX:
        """Angular velocity in body axes [rad/s], (3,)."""
        return self.S[3:, :] @ self.v


class Pose(ABC):
    """The pose of a body: its coordinates, and the frame that depends on them.

    Parameters
    ----------
    modes : int
        number of modal coordinates of a flexible body
    """

    rigid_coordinates: ClassVar[tuple[str, ...]]
    rigid_velocities: ClassVar[tuple[str, ...]]
    _twist: ClassVar[tuple[int, ...]]
    """Indices of the rigid velocities in the twist."""

    def __init__(self, modes: int = 0) -> None:
        # Largest number of modal coordinates of a body: the number of terms in the equations grows with its square.
        self.modes = whole(type(self).__name__, "modes", modes, 0, 1000)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates. Modal coordinates come last."""
        return (*self.rigid_coordinates, *(f"eta{j + 1}" for j in range(self.modes)))

    @property
    def velocities(self) -> tuple[str, ...]:
        """Names of the velocities. Rates of modal coordinates come last."""
        return (*self.rigid_velocities, *(f"eta{j + 1}_dot" for j in range(self.modes)))

    def frame(self, name: str) -> Frame:
        """The frame of the body called `name`, with new symbols `name.x`, ..."""
        q_names, v_names = ([f"{name}.{x}" for x in names] for names in (self.coordinates, self.velocities))
        q, v = (ca.vertcat(ca.SX(0, 1), *map(ca.SX.sym, names)) for names in (q_names, v_names))
        S = np.zeros((6, len(v_names)))
        S[list(self._twist), range(len(self._twist))] = 1.0
        rate, r, R, angle = self._placed(q, v)
        records = declare(q_names, Kind.COORDINATE, q, rate) + declare(v_names, Kind.VELOCITY, v)
        S = ca.SX(ca.sparsify(ca.DM(S)))
        return Frame(q, v, rate, r, R, S, angle, S.T, records)

    @abstractmethod
    def _placed(self, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Rates of the coordinates (n_q,), position (3,), rotation (3, 3) and angle about z."""

    def retract(self, q: ca.SX, delta: ca.SX) -> ca.SX:
        """The coordinates q (n_q,) after a small displacement delta (n_v,). Quaternions have the norm 1."""
        return q + delta

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"


class Planar(Pose):
    """Motion in the xy plane: q = (x, y, theta), v = q', theta [rad] positive about +z.

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", mass=2.0, inertia=0.5, pose=mb.Planar())
    >>> rod.x, rod.y, rod.theta, rod.omega
    (SX(rod.x), SX(rod.y), SX(rod.theta), SX(rod.omega))
    """

    rigid_coordinates = ("x", "y", "theta")
    rigid_velocities = ("vx", "vy", "omega")
    _twist = (0, 1, 5)

    def _placed(self, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        return v, vector(q[:2]), rotation_z(q[2]), q[2]


class Spatial(Pose):
    """Free motion in space: q = (r, e), v = (r', omega). e is a unit quaternion, scalar first. omega is in body axes.

    Examples
    --------
    >>> import symmb as mb
    >>> top = mb.Body("top", mass=1.0, inertia=(0.1, 0.1, 0.2), pose=mb.Spatial())
    >>> system = mb.System(top)
    >>> system.q.numel(), system.v.numel()
    (7, 6)
    """

    rigid_coordinates = ("x", "y", "z", "e0", "e1", "e2", "e3")
    rigid_velocities = ("vx", "vy", "vz", "omega_x", "omega_y", "omega_z")
    _twist = (0, 1, 2, 3, 4, 5)

    def _placed(self, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        rate = ca.vertcat(v[:3], quaternion_rate(q[3:7], v[3:6]), v[6:])
        return rate, q[:3], rotation_matrix(q[3:7]), ca.SX()

    def retract(self, q: ca.SX, delta: ca.SX) -> ca.SX:
        e = product(q[3:7], rotation_by(delta[3:6]))
        return ca.vertcat(q[:3] + delta[:3], e / ca.sqrt(ca.sumsqr(e)), q[7:] + delta[6:])


class Particle(Pose):
    """Translation in space without rotation: q = (x, y, z), v = q'.

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", mass=1.0, pose=mb.Particle())
    >>> bob.x, bob.vz
    (SX(bob.x), SX(bob.vz))
    """

    rigid_coordinates = ("x", "y", "z")
    rigid_velocities = ("vx", "vy", "vz")
    _twist = (0, 1, 2)

    def _placed(self, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        return v, q, ca.SX.eye(3), ca.SX()


class Fixed(Pose):
    """No motion: the pose of the ground."""

    rigid_coordinates = rigid_velocities = _twist = ()

    def _placed(self, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        return v, ca.SX(3, 1), ca.SX.eye(3), ca.SX(0)


def turns_about_z(pose: Pose) -> bool:
    """Whether one angle about z gives the orientation: for a planar pose, or for a body that is fixed."""
    return isinstance(pose, Planar | Fixed)
