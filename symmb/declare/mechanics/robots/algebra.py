"""Vectors, rotations and masses with entries that are numbers or expressions.

Most entries are numbers. Python multiplies numbers much faster than CasADi multiplies constant expressions.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import TypeAlias

import casadi as ca

from symmb._magnitudes import LAST_DIGITS
from symmb.declare.mechanics.rotation import Rotation

Scalar: TypeAlias = "float | ca.SX"
Vector: TypeAlias = "tuple[Scalar, ...]"
Matrix: TypeAlias = "tuple[Vector, ...]"
"""Rows of a 3x3 matrix."""


def plain(value: ca.SX) -> Scalar:
    """A constant expression as a number. Other expressions are returned unchanged."""
    return float(value) if value.is_constant() else value


def is_nought(value: Scalar) -> bool:
    """Whether a number is 0, or an expression is the constant 0."""
    return bool(value.is_zero()) if isinstance(value, ca.SX) else value == 0.0


def add(a: Vector, b: Vector) -> Vector:
    """The sum a + b of two vectors."""
    return tuple(x + y for x, y in zip(a, b, strict=True))


def dot(a: Vector, b: Vector) -> Scalar:
    """The dot product a . b."""
    total: Scalar = 0.0
    for x, y in zip(a, b, strict=True):
        # Products with 0 are left out, so that sums of numbers and expressions keep few terms.
        if not (is_nought(x) or is_nought(y)):
            total = total + x * y
    return total


def turned(R: Matrix, a: Vector) -> Vector:
    """The product R a of a matrix and a vector."""
    return tuple(dot(row, a) for row in R)


def transposed(R: Matrix) -> Matrix:
    """The transpose of R."""
    return tuple(zip(*R, strict=True))


def product(A: Matrix, B: Matrix) -> Matrix:
    """The product A B of two matrices."""
    columns = transposed(B)
    return tuple(tuple(dot(row, column) for column in columns) for row in A)


def unit(a: Vector) -> Vector:
    """The unit vector a / |a|."""
    squared = dot(a, a)
    if squared == 1.0:
        return a
    length = ca.sqrt(squared) if isinstance(squared, ca.SX) else math.sqrt(squared)
    return tuple(x / length for x in a)


def by_angles(rpy: Vector) -> Vector:
    """The quaternion of rotations by roll, pitch and yaw [rad] about the fixed axes x, y and z, in this order."""
    (cr, sr), (cp, sp), (cy, sy) = map(_cos_and_sin, rpy)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def about(axis: Vector, angle: Scalar) -> Vector:
    """The quaternion of a rotation by an angle [rad] about an axis."""
    c, s = _cos_and_sin(angle)
    return (c, *(s * x for x in unit(axis)))


def angles(e: Vector) -> tuple[float, ...]:
    """Roll, pitch and yaw [rad] of a unit quaternion of numbers, for `by_angles`.

    Roll is computed from the known yaw. So the three angles are consistent also at a pitch of 90 degrees, where only
    the sum or the difference of roll and yaw is determined.
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
    """The quaternion of two rotations: first b, then a."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def conjugate(e: Vector) -> Vector:
    """The quaternion of the inverse rotation."""
    w, x, y, z = e
    return (w, -x, -y, -z)


def matrix(e: Vector) -> Matrix:
    """The rotation matrix of a unit quaternion. Constant zeros and ones are exact."""
    w, x, y, z = e
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return tuple(tuple(map(_exact, row)) for row in rows)


def _exact(cosine: Scalar) -> Scalar:
    """A cosine without the rounding errors of 0, 1 and -1."""
    if isinstance(cosine, ca.SX):
        return plain(cosine)
    return float(round(cosine)) if abs(cosine - round(cosine)) < LAST_DIGITS else cosine


def rotation(e: Vector) -> Rotation:
    """The `Rotation` of a unit quaternion."""
    return Rotation(ca.densify(ca.vertcat(*map(ca.SX, e))))


@dataclass(frozen=True, eq=False)
class Mass:
    """Mass [kg], centre of mass (3,) [m], and inertia (3, 3) about the centre of mass [kg m^2], in axes of the body."""

    mass: Scalar
    com: Vector
    inertia: Matrix


def united(parts: Sequence[Mass]) -> Mass:
    """The mass, the centre of mass and the inertia of all parts together."""
    heavy = [part for part in parts if not is_nought(part.mass)]
    inertias = [part.inertia for part in parts]
    if not heavy:
        return Mass(parts[0].mass, (0.0, 0.0, 0.0), _sum(inertias))
    if len(heavy) == 1:
        return Mass(heavy[0].mass, heavy[0].com, _sum(inertias))
    mass = reduce(lambda a, b: a + b, [part.mass for part in heavy])
    moments = [tuple(part.mass * x for x in part.com) for part in heavy]
    com = tuple(x / mass for x in _total(moments))
    offsets = [_offset(part.mass, tuple(x - c for x, c in zip(part.com, com, strict=True))) for part in heavy]
    return Mass(mass, com, _sum([*inertias, *offsets]))


def _offset(mass: Scalar, arm: Vector) -> Matrix:
    """Inertia (3, 3) of a point mass about a point. `arm` (3,) leads from point to mass (parallel axis theorem)."""
    squared = dot(arm, arm)
    return tuple(tuple(mass * ((squared if i == k else 0.0) - arm[i] * arm[k]) for k in range(3)) for i in range(3))


def _total(vectors: Sequence[Vector]) -> Vector:
    """The sum of vectors."""
    return reduce(add, vectors)


def _sum(matrices: Sequence[Matrix]) -> Matrix:
    """The sum of matrices."""
    return tuple(_total(rows) for rows in zip(*matrices, strict=True))
