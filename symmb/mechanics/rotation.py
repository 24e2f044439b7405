"""Rotations as unit quaternions, scalar first, body to world."""

from dataclasses import dataclass

import casadi as ca

from symmb._types import Expr
from symmb.symbolic.geometry import product, unit, vector


@dataclass(frozen=True, eq=False)
class Rotation:
    """A rotation; `A @ B` applies B first. quaternion (4,) scalar first."""

    quaternion: ca.SX

    def __matmul__(self, other: "Rotation") -> "Rotation":
        return Rotation(product(self.quaternion, other.quaternion))


def rotation(axis: tuple[Expr, ...], angle: Expr) -> Rotation:
    """Rotation by `angle` [rad] about `axis`.

    Examples
    --------
    >>> import numpy as np
    >>> half = rotation(axis=(0, 0, 2), angle=np.pi / 2)
    >>> (half @ half).quaternion
    SX([6.12323e-17, 0, 0, 1])
    """
    half = ca.SX(angle) / 2
    return Rotation(ca.densify(ca.vertcat(ca.cos(half), ca.sin(half) * unit(vector(axis, "rotation axis")))))
