"""Rotations as unit quaternions, scalar first, body to world."""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from symmb._errors import DeclarationError
from symmb._options import require_instance, shown
from symmb._types import Expr
from symmb.declare.symbolic import (
    has_irregular_constant,
    is_zero,
    product,
    rotation_matrix,
    scalar,
    unit,
    vector,
    without_rounding,
)


@dataclass(frozen=True, eq=False)
class Rotation:
    """A rotation as a unit quaternion (4,), scalar first. `A @ B` applies B first."""

    quaternion: ca.SX

    def __matmul__(self, other: "Rotation") -> "Rotation":
        require_instance("A rotation @ B", other, Rotation, "a rotation, mb.rotation(axis=..., angle=...)")
        return Rotation(product(self.quaternion, other.quaternion))

    @cached_property
    def matrix(self) -> ca.SX:
        """The rotation matrix (3, 3), body to world. Zeros and ones of a constant matrix are exact."""
        return without_rounding(rotation_matrix(self.quaternion))


def rotation(axis: tuple[Expr, ...], angle: Expr) -> Rotation:
    """Rotation by `angle` [rad] about `axis`.

    Raises
    ------
    DeclarationError
        If a number is not finite, or the axis has no direction

    Examples
    --------
    >>> import casadi as ca, numpy as np, symmb as mb
    >>> turn = mb.rotation(axis=(0, 0, 2), angle=np.pi / 3)
    >>> np.array(ca.DM((turn @ turn).quaternion)).ravel().round(3)
    array([0.5  , 0.   , 0.   , 0.866])
    """
    half, direction = scalar(angle, "rotation angle") / 2, vector(axis, "rotation axis")
    if has_irregular_constant(ca.vertcat(half, direction)) or is_zero(direction):
        raise DeclarationError(
            f"rotation: angle {shown(angle)} and axis {shown(axis)} must be finite, and the axis must not be zero."
        )
    direction = unit(direction)
    return Rotation(ca.densify(ca.vertcat(ca.cos(half), ca.sin(half) * direction)))
