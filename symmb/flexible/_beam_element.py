"""The two-node beam element in space, Timoshenko's, of which Euler-Bernoulli's is the case without shear.

Shape functions that solve the uniform element's static equations exactly: Z. Friedman, J. B. Kosmatka, An improved
two-node Timoshenko beam finite element, Computers & Structures 47 (1993), eqs. 13-22.
"""

from dataclasses import dataclass

import numpy as np

from symmb._types import Array

GAUSS = 5  # integrates degree 9: cubic displacements twice over a section whose second moments are quartic
X, W = np.polynomial.legendre.leggauss(GAUSS)
XI, WEIGHTS = (X + 1) / 2, W / 2
BENDING_XY, BENDING_XZ = [1, 5, 7, 11], [2, 4, 8, 10]


@dataclass(frozen=True, eq=False)
class Line:
    """e elements in global axes, d = 12 degrees of freedom each: three translations, three rotations a node.

    Fields at the g Gauss points, rows of (e, g, 3, 12) matrices; lengths are already in `weights` (e, g) [m].
    """

    weights: Array
    translation: Array
    rotation: Array
    stiffness: Array
    """(e, 12, 12)"""
    slopes: Array
    """(e, g, 2, 12) slopes v' and w'"""
    axial: Array
    """(e, 12) axial force, which nodal displacements make uniform"""


def properties(ends: Array, xi: Array) -> Array:
    """(e, g, 6) area, Iy, Iz, J, shear_y, shear_z between the values (e, 2, 6) at the ends.

    What grows like a length interpolates linearly: √A and I^¼, which is exact for sections that stay similar.
    """
    power = np.array([2, 4, 4, 4, 2, 2])
    rigid = np.isinf(ends[:, :1])
    roots = np.where(rigid, 1.0, ends) ** (1 / power)
    between = roots[:, :1] * (1 - xi[:, None]) + roots[:, 1:] * xi[:, None]
    return np.where(rigid, np.inf, between**power)


def bending(xi: Array, length: Array, phi: Array) -> tuple[Array, Array, Array, Array]:
    """(e, g, 4) deflection v, its slope v', rotation θ and curvature θ' by (v1, θ1, v2, θ2)."""
    x, L, P = xi[None, :], length[:, None], phi[:, None]
    a = 1 / (1 + P)
    v = [
        a * (2 * x**3 - 3 * x**2 - P * x + 1 + P),
        a * L * (x**3 - (2 + P / 2) * x**2 + (1 + P / 2) * x),
        a * (-2 * x**3 + 3 * x**2 + P * x),
        a * L * (x**3 - (1 - P / 2) * x**2 - P / 2 * x),
    ]
    theta = [
        6 * a / L * (x**2 - x),
        a * (3 * x**2 - (4 + P) * x + 1 + P),
        -6 * a / L * (x**2 - x),
        a * (3 * x**2 - (2 - P) * x),
    ]
    curvature = [
        6 * a / L**2 * (2 * x - 1),
        a / L * (6 * x - 4 - P),
        -6 * a / L**2 * (2 * x - 1),
        a / L * (6 * x - 2 + P),
    ]
    # Shear is uniform in the element; the slope is the rotation plus it.
    shear = np.stack(np.broadcast_arrays(-P / L, -P / 2, P / L, -P / 2), axis=-1) * a[..., None]
    rotation = np.stack(theta, axis=-1)
    return np.stack(v, axis=-1), rotation + shear, rotation, np.stack(curvature, axis=-1)


def elements(length: Array, axes: Array, ends: Array, E: float, G: float) -> Line:
    """Elements of length (e,) with axes (e, 3, 3), rows x, y, z of the section, properties (e, 2, 6) at their ends."""
    e, g = len(length), GAUSS
    section, middle = properties(ends, XI), properties(ends, np.array([0.5]))[:, 0]
    u, turn, strain = np.zeros((e, g, 3, 12)), np.zeros((e, g, 3, 12)), np.zeros((e, g, 6, 12))
    linear, rise = np.stack([1 - XI, XI], axis=-1), np.stack([-1 / length, 1 / length], axis=-1)[:, None]
    u[:, :, 0, [0, 6]] = linear
    turn[:, :, 0, [3, 9]] = linear
    strain[:, :, 0, [0, 6]] = rise
    strain[:, :, 3, [3, 9]] = rise
    slopes = np.zeros((e, g, 2, 12))
    weights = WEIGHTS * length[:, None]
    # Rotation about y is minus the slope of z.
    for plane, columns, sign in ((1, BENDING_XY, np.ones(4)), (2, BENDING_XZ, np.array([1, -1, 1, -1]))):
        second, shear_area = middle[:, 3 - plane], middle[:, 3 + plane]
        v, slope, theta, curvature = (
            field * sign for field in bending(XI, length, 12 * E * second / (G * shear_area * length**2))
        )
        u[:, :, plane, columns] = v
        turn[:, :, 3 - plane, columns] = theta if plane == 1 else -theta
        strain[:, :, plane, columns] = slope - theta
        strain[:, :, 6 - plane, columns] = curvature if plane == 1 else -curvature
        slopes[:, :, plane - 1, columns] = slope
    area, Iy, Iz, J, shear_y, shear_z = np.moveaxis(section, -1, 0)
    shear = [np.where(np.isinf(A), 0.0, G * A) for A in (shear_y, shear_z)]  # where infinite, the strain is 0
    law = np.stack([E * area, *shear, G * J, E * Iy, E * Iz], axis=-1)
    T = np.zeros((e, 12, 12))
    for k in range(0, 12, 3):
        T[:, k : k + 3, k : k + 3] = axes
    local = np.einsum("eg,egs,egsi,egsj->eij", weights, law, strain, strain)
    turned, back = T[:, None], axes.swapaxes(1, 2)[:, None]
    return Line(
        weights,
        back @ u @ turned,
        back @ turn @ turned,
        T.swapaxes(1, 2) @ local @ T,
        slopes @ turned,
        np.einsum("eg,egi->ei", WEIGHTS * E * area, strain[:, :, 0] @ T),
    )
