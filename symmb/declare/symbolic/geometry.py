"""Vectors, frames and rotations in three dimensions as CasADi SX; zeros and ones stay structural."""

from typing import Any

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._limits import fits
from symmb._magnitudes import LAST_DIGITS, ROUNDING, SMALL
from symmb._names import counted
from symmb._options import shown
from symmb.declare.symbolic.given import given
from symmb.declare.symbolic.instructions import instructions

X, Y, Z = (ca.SX(ca.DM([1.0 if i == k else 0.0 for i in range(3)])) for k in range(3))


def components(value: Any) -> list[Any] | None:
    """The components of a list, a tuple, a NumPy array or a CasADi vector; None for other values, such as numbers."""
    if isinstance(value, list | tuple):
        return list(value)
    if isinstance(value, np.ndarray) and value.ndim and fits(value.size) and value.dtype.names is None:
        return value.ravel().tolist()
    if isinstance(value, ca.SX | ca.DM) and value.numel() > 1:
        return ca.vertsplit(ca.vec(ca.densify(value)))
    return None


def vector(values: Any, what: str = "vector") -> ca.SX:
    """A 3-vector from two or three numbers or SX scalars. The default of the third component is 0."""
    if isinstance(values, np.ndarray) and values.size > 3:
        raise DeclarationError(f"{what} has {values.size} components, expected two or three.")
    entries: list[Any] | None = components(values)
    entries = [values] if entries is None else entries
    if len(entries) not in (2, 3):
        raise DeclarationError(f"{what} has {counted(len(entries), 'component')}, expected two or three.")
    parts = [part for part in map(given, entries) if part is not None]
    if len(parts) < len(entries):
        raise DeclarationError(f"{what}: {shown(values)} contains a component that is neither a number nor CasADi SX.")
    if any(part.numel() != 1 for part in parts):
        raise DeclarationError(f"{what}: {shown(values)} contains a component that is not a scalar.")
    return ca.densify(ca.vertcat(*parts, *[0] * (3 - len(entries))))


def scalar(value: Any, what: str) -> ca.SX:
    """A number or an SX scalar as SX."""
    expression = given(value)
    if expression is None or expression.numel() != 1:
        raise DeclarationError(f"{what}: expected one number or CasADi SX, got {shown(value)}.")
    return expression


def is_zero(expression: ca.SX) -> bool:
    """Whether an expression is structurally zero."""
    return bool(ca.sparsify(expression).nnz() == 0)


def irregular_part(expression: ca.SX) -> str:
    """What makes an expression useless, as text: NaN or infinity, or an operation without exact values; else empty."""
    if is_zero(expression):
        return ""
    f = ca.Function("law", ca.symvar(expression), [expression])
    own = instructions(f)
    for k, code in enumerate(own.codes):
        if code == ca.OP_CONST and not np.isfinite(own.data[k]):
            return "NaN or infinity"
        if code == ca.OP_ERFINV:  # CasADi's values have errors of 2e-6, and a jump that their derivative does not have
            return "erfinv"
    return ""


def has_irregular_constant(expression: ca.SX) -> bool:
    """Whether an expression contains NaN or infinity."""
    return irregular_part(expression) == "NaN or infinity"


def unit(axis: ca.SX) -> ca.SX:
    """The unit vector along an axis. Constant axes are normalised numerically, so zeros and ones stay exact."""
    if axis.is_constant():
        values = np.asarray(ca.DM(axis)).ravel()
        largest = np.abs(values).max()
        if not 1e-150 < largest < 1e150:  # squares of other values overflow or underflow
            values = values / largest
        return ca.SX(values / np.linalg.norm(values))
    return axis / ca.norm_2(axis)


def without_rounding(matrix: ca.SX) -> ca.SX:
    """A constant matrix of cosines with exact, structural zeros and ones. Other matrices are unchanged."""
    if not matrix.is_constant():
        return matrix
    values = ca.DM(ca.densify(matrix)).full()
    whole = np.round(values)
    return ca.SX(ca.sparsify(ca.DM(np.where(np.abs(values - whole) < LAST_DIGITS, whole, values))))


def triad(axis: ca.SX) -> ca.SX:
    """Right-handed orthonormal frame [u1 u2 a], (3, 3). The third column is the given axis."""
    a = unit(axis)

    # The helper direction must not be parallel to the axis. The best choice is a component that is 0, then a symbolic
    # component (a small misalignment), then the smallest constant.
    def rank(k: int) -> tuple[int, float]:
        if is_zero(a[k]):
            return (0, 0.0)
        return (2, abs(float(a[k]))) if a[k].is_constant() else (1, 0.0)

    helper = (X, Y, Z)[min((2, 0, 1), key=rank)]
    u1 = unit(ca.cross(helper, a))
    return ca.horzcat(u1, ca.cross(a, u1), a)


def turn(a: ca.SX, b: ca.SX, in_plane: bool = False) -> ca.SX:
    """Rotation matrix (3, 3) of the smallest rotation from the direction a to b. With `in_plane` the axis is z."""
    a, b = unit(a), unit(b)
    if is_zero(ca.simplify(a - b)):
        return ca.SX.eye(3)
    if in_plane:
        c, s = ca.dot(a, b), a[0] * b[1] - a[1] * b[0]
        return ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1))
    axis = ca.cross(a, b)
    sides = ca.norm_2(a + b), ca.norm_2(axis)
    # For nearly opposite directions, 1 plus their cosine has lost digits.
    if is_zero(ca.simplify(a + b)) or (sides[0].is_constant() and float(sides[0]) < SMALL):
        # Half a turn, then the remaining rotation. If rounding determines the axis, another normal axis is used.
        is_clear = sides[1].is_constant() and float(sides[1]) > ROUNDING
        n = unit(axis - ca.dot(axis, a) * a) if is_clear else triad(a)[:, 0]
        return turn(-a, b) @ (2 * n @ n.T - ca.SX.eye(3))
    w = ca.skew(axis)
    return ca.SX.eye(3) + w + w @ w / (1 + ca.dot(a, b))


def rotation_z(theta: ca.SX) -> ca.SX:
    """Rotation matrix about z by theta [rad], (3, 3)."""
    c, s = ca.cos(theta), ca.sin(theta)
    return ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1))


def rotation_matrix(e: ca.SX) -> ca.SX:
    """Rotation matrix (3, 3) from body to world axes of the unit quaternion e / |e|, scalar first."""
    w, x, y, z = ca.vertsplit(e)
    s = 2 / ca.sumsqr(e)
    return ca.vertcat(
        ca.horzcat(1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
        ca.horzcat(s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)),
        ca.horzcat(s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)),
    )


def quaternion_rate(e: ca.SX, omega: ca.SX) -> ca.SX:
    """Rate e * (0, omega) / 2 (4,) of a quaternion for the angular velocity omega in body axes [rad/s]."""
    return 0.5 * product(e, ca.vertcat(0, omega))


def product(a: ca.SX, b: ca.SX) -> ca.SX:
    """Quaternion product a b, scalar first, (4,)."""
    av, bv = a[1:4], b[1:4]
    return ca.vertcat(a[0] * b[0] - ca.dot(av, bv), a[0] * bv + b[0] * av + ca.cross(av, bv))


def conjugate(e: ca.SX) -> ca.SX:
    """The quaternion of the inverse rotation, (4,)."""
    return ca.vertcat(e[0], -e[1:4])


def rotation_by(delta: ca.SX) -> ca.SX:
    """Unit quaternion (4,) of the rotation vector delta (3,) [rad], exact to the sixth order in its length.

    The series of cosine and sine in |delta|^2 are smooth at 0, but |delta| itself is not smooth.
    """
    s = ca.sumsqr(delta)
    e = ca.vertcat(1 - s / 8 + s**2 / 384, delta * (0.5 - s / 48 + s**2 / 3840))
    return e / ca.norm_2(e)
