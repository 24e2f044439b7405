"""The two-node Timoshenko beam element in space. Without shear deformation it is the Euler-Bernoulli element.

The shape functions are the static solutions of the uniform or tapered element under forces at its ends. Nodal
displacements under static loads at nodes are therefore exact. For a uniform element the shape functions are the cubic
polynomials of Hermite, or of Timoshenko.

References
----------
Z. Friedman, J. B. Kosmatka, Exact stiffness matrix of a nonuniform beam, Computers & Structures 42 (1992) 671-682 and
49 (1993) 545-555.
"""

from dataclasses import dataclass

import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array

GAUSS = 5  # exact to degree 9: the square of a cubic displacement times a quadratic area
X, W = np.polynomial.legendre.leggauss(GAUSS)
XI, WEIGHTS = (X + 1) / 2, W / 2
UPPER = np.append(XI, 1.0)[:, None]  # integrals end at Gauss points or at the second node
NESTED, SHARES = UPPER * XI, UPPER * WEIGHTS
BENDING_XY, BENDING_XZ = [1, 5, 7, 11], [2, 4, 8, 10]
# The rotation about y is the negative slope of z.
PLANES = ((1, 5, BENDING_XY, np.array([1, 1, 1, 1]), 1), (2, 4, BENDING_XZ, np.array([1, -1, 1, -1]), -1))


@dataclass(frozen=True, eq=False)
class Line:
    """e elements in global axes. An element has 12 degrees of freedom: three translations and rotations of two nodes.

    Matrices map the degrees of freedom to fields at the g Gauss points. `weights` are Gauss weights times lengths.
    """

    weights: Array  # (e, g) [m]
    translation: Array  # (e, g, 3, 12)
    rotation: Array  # (e, g, 3, 12)
    stiffness: Array  # (6, e, 12, 12), parts: extension, both shears, torsion, both bendings
    slopes: Array  # (e, g, 2, 12), slopes in the two planes of bending
    axial: Array  # (e, 12), uniform axial force for unit nodal displacements


def properties(ends: Array, xi: Array) -> Array:
    """Area, Iy, Iz, J, shear_y, shear_z (e, g, 6) at xi (g,), interpolated between the values (e, 2, 6) at the ends.

    √A and I^¼ are linear along the element, which is exact for similar sections.
    """
    power = np.array([2, 4, 4, 4, 2, 2])
    rigid = np.isinf(ends[:, :1])
    roots = np.where(rigid, 1.0, ends) ** (1 / power)
    between = roots[:, :1] * (1 - xi[:, None]) + roots[:, 1:] * xi[:, None]
    return np.where(rigid, np.inf, between**power)


def compliances(ends: Array, xi: Array, E: float, G: float) -> Array:
    """Strains (e, g, 6) per unit of axial force, both shear forces, torque and both bending moments."""
    area, Iy, Iz, J, shear_y, shear_z = np.moveaxis(properties(ends, xi), -1, 0)
    with np.errstate(over="ignore", divide="ignore"):
        strains = 1 / np.stack([E * area, G * shear_y, G * shear_z, G * J, E * Iy, E * Iz], axis=-1)
    if not np.isfinite(strains).all():
        raise DeclarationError("Beam: the area or a second moment of a section is too small. Check the units.")
    return strains


def stretching(length: Array, whole: Array, nested: Array) -> tuple[Array, Array]:
    """Displacement and force (e, g, 2) for unit displacements of both ends, in extension or torsion."""
    summed = (SHARES * nested).sum(axis=-1)
    total = summed[:, -1:]
    share = summed[:, :-1] / total
    force = np.broadcast_to(1 / (length[:, None] * total), whole.shape)
    return np.stack([1 - share, share], axis=-1), np.stack([-force, force], axis=-1)


def bending(length: Array, nested: Array, nested_shear: Array) -> tuple[Array, Array, Array, Array]:
    """Deflection, rotation, moment and shear force, each (e, g, 4), for unit (v1, θ1, v2, θ2).

    The moment is linear between its values c at the ends, with θ' = M/EI, v' = θ + V/κGA and V = -M'. The values c
    follow from the displacements of the second end.
    """
    h = length[:, None, None, None]
    curvature = np.stack([1 - NESTED, NESTED], axis=-1) * nested[..., None]
    shear = np.array([1.0, -1.0]) / h * nested_shear[..., None]
    weights = SHARES[..., None] * h
    turned = (weights * curvature).sum(axis=2)
    moved = (weights * (h * (UPPER - NESTED)[..., None] * curvature + shear)).sum(axis=2)
    known = np.zeros((len(length), 2, 4))
    known[:, 0] = np.stack(np.broadcast_arrays(-1.0, -length, 1.0, 0.0), axis=-1)
    known[:, 1] = [0, -1, 0, 1]
    c = np.linalg.solve(np.stack([moved[:, -1], turned[:, -1]], axis=1), known)[:, None]
    zero, x = np.zeros((len(length), GAUSS)), length[:, None] * XI
    v = np.stack([zero + 1, x, zero, zero], axis=-1) + (moved[:, :-1, None] @ c)[:, :, 0]
    theta = np.array([0, 1, 0, 0]) + (turned[:, :-1, None] @ c)[:, :, 0]
    moment = np.stack([1 - XI, XI], axis=-1) @ c[:, 0]
    force = (c[:, :, 0] - c[:, :, 1]) / length[:, None, None]
    return v, theta, moment, np.broadcast_to(force, moment.shape)


def elements(length: Array, axes: Array, ends: Array, E: float, G: float) -> Line:
    """Elements with length (e,), axes (e, 3, 3) with rows x, y, z, and section properties (e, 2, 6) at their ends."""
    e, g = len(length), GAUSS
    whole = compliances(ends, XI, E, G)
    nested = np.moveaxis(compliances(ends, NESTED.ravel(), E, G).reshape(e, g + 1, g, 6), -1, 0)
    translation, rotation, slopes = (np.zeros((e, g, rows, 12)) for rows in (3, 3, 2))
    force = np.zeros((e, g, 6, 12))
    translation[:, :, 0, [0, 6]], force[:, :, 0, [0, 6]] = stretching(length, whole[..., 0], nested[0])
    rotation[:, :, 0, [3, 9]], force[:, :, 3, [3, 9]] = stretching(length, whole[..., 3], nested[3])
    for shear, moment, columns, signs, turn in PLANES:
        v, theta, couple, across = (signs * field for field in bending(length, nested[moment], nested[shear]))
        translation[:, :, shear, columns] = v
        rotation[:, :, moment - 3, columns] = turn * theta
        force[:, :, shear, columns] = across
        force[:, :, moment, columns] = turn * couple
        slopes[:, :, shear - 1, columns] = theta + whole[..., shear, None] * across
    T = np.zeros((e, 12, 12))
    for k in range(0, 12, 3):
        T[:, k : k + 3, k : k + 3] = axes
    weights = WEIGHTS * length[:, None]
    local = np.einsum("eg,egs,egsi,egsj->seij", weights, whole, force, force, optimize=True)
    turned, back = T[:, None], axes.swapaxes(1, 2)[:, None]
    return Line(
        weights,
        back @ translation @ turned,
        back @ rotation @ turned,
        T.swapaxes(1, 2) @ local @ T,
        slopes @ turned,
        (force[:, 0, :1] @ T)[:, 0],
    )
