"""Vectors and rotations whose entries are numbers or expressions, as tuples.

Nearly all entries are numbers, and Python multiplies these much faster than CasADi multiplies constant expressions.
"""

import math
from typing import TypeAlias

import casadi as ca

from symmb._magnitudes import LAST_DIGITS
from symmb.declare.mechanics.rotation import Rotation

Scalar: TypeAlias = "float | ca.SX"
Vector: TypeAlias = "tuple[Scalar, ...]"
Matrix: TypeAlias = "tuple[Vector, ...]"
"""Rows of a 3x3 matrix."""
NO_TURN: Vector = (1.0, 0.0, 0.0, 0.0)


def plain(value: ca.SX) -> Scalar:
    """A constant as a number."""
    return float(value) if value.is_constant() else value


def is_nought(value: Scalar) -> bool:
    """Whether a number or an expression is 0 as it stands."""
    return bool(value.is_zero()) if isinstance(value, ca.SX) else value == 0.0


def add(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return tuple(x + y for x, y in zip(a, b, strict=True))


def dot(a: Vector, b: Vector) -> Scalar:
    """a . b."""
    total: Scalar = 0.0
    for x, y in zip(a, b, strict=True):
        if not (is_nought(x) or is_nought(y)):
            total = total + x * y
    return total


def turned(R: Matrix, a: Vector) -> Vector:
    """R a."""
    return tuple(dot(row, a) for row in R)


def transposed(R: Matrix) -> Matrix:
    """R'."""
    return tuple(zip(*R, strict=True))


def product(A: Matrix, B: Matrix) -> Matrix:
    """A B."""
    columns = transposed(B)
    return tuple(tuple(dot(row, column) for column in columns) for row in A)


def unit(a: Vector) -> Vector:
    """a over its length."""
    squared = dot(a, a)
    if squared == 1.0:
        return a
    length = ca.sqrt(squared) if isinstance(squared, ca.SX) else math.sqrt(squared)
    return tuple(x / length for x in a)


def by_angles(rpy: Vector) -> Vector:
    """The quaternion of turns by roll, pitch and yaw [rad] about the fixed axes x, y and z, one after the other."""
    (cr, sr), (cp, sp), (cy, sy) = map(_cos_and_sin, rpy)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def about(axis: Vector, angle: Scalar) -> Vector:
    """The quaternion of the turn by an angle [rad] about an axis."""
    c, s = _cos_and_sin(angle)
    return (c, *(s * x for x in unit(axis)))


def angles(e: Vector) -> tuple[float, ...]:
    """Roll, pitch and yaw [rad] of a unit quaternion of numbers, as `by_angles` takes them.

    Roll follows from the yaw that was chosen, so that their turns belong together where only their sum is determined.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, _, _) = (map(float, row) for row in matrix(e))
    yaw = math.atan2(yx, xx)
    c, s = math.cos(yaw), math.sin(yaw)
    return math.atan2(s * xz - c * yz, c * yy - s * xy), math.atan2(-zx, math.hypot(xx, yx)), yaw


def _cos_and_sin(angle: Scalar) -> tuple[Scalar, Scalar]:
    """The cosine and the sine of half an angle."""
    if isinstance(angle, float):
        return math.cos(angle / 2), math.sin(angle / 2)
    return ca.cos(angle / 2), ca.sin(angle / 2)


def one_after(a: Vector, b: Vector) -> Vector:
    """The quaternion of the turn b, and of the turn a after it."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def conjugate(e: Vector) -> Vector:
    """The quaternion of the turn back."""
    w, x, y, z = e
    return (w, -x, -y, -z)


def matrix(e: Vector) -> Matrix:
    """The rotation matrix of a unit quaternion. Zeros and ones are exact."""
    w, x, y, z = e
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return tuple(tuple(map(_exact, row)) for row in rows)


def _exact(cosine: Scalar) -> Scalar:
    if isinstance(cosine, ca.SX):
        return plain(cosine)
    return float(round(cosine)) if abs(cosine - round(cosine)) < LAST_DIGITS else cosine


def rotation(e: Vector) -> Rotation:
    """The rotation of a unit quaternion."""
    return Rotation(ca.densify(ca.vertcat(*map(ca.SX, e))))
