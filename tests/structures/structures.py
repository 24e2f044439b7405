"""Structures that several tests of flexible bodies share."""

import casadi as ca
import numpy as np
from scipy.linalg import eigh

from symmb import Beam, FiniteElements, Material, Section

STEEL = Material(E=2.1e11, nu=0.3, density=7850.0)
LIGHT = Material(E=1e10, G=1e10, density=1.0)  # with SLENDER: EI = 1, ρA = 1, rotary inertia 1e-10
SLENDER = Section(area=1.0, Iy=1e-10, Iz=1e-10, J=2e-10)


def cantilever(elements=8, section=SLENDER, material=LIGHT, end=(1.0, 0.0, 0.0), **options):
    return FiniteElements.beams(Beam([(0, 0, 0), end], section, material, elements=elements, **options))


def frame(elements=4):
    """A bent tube with a solid arm across and a wheel at its end: nothing symmetric."""
    tube = Beam([(0, 0, 0), (0.6, 0, 0.1), (0.9, 0.5, 0.2)], Section.circle(0.02, 0.015), STEEL, elements=elements)
    arm = Beam([(0.6, 0, 0.1), (0.6, -0.4, 0.3)], Section.rectangle(0.03, 0.02).without_shear(), STEEL, elements)
    structure = FiniteElements.beams(tube, arm)
    return structure.with_mass(structure.nearest(0.6, -0.4, 0.3), 1.5, (0.01, 0.02, 0.015))


def lattice():
    """Twelve point masses with springs between any two: three degrees of freedom a node."""
    positions = np.array([(x, 0.8 * y, 0.7 * z) for x in range(3) for y in range(2) for z in range(2)], dtype=float)
    positions += 0.05 * np.sin(np.arange(36.0)).reshape(12, 3)
    K = np.zeros((36, 36))
    for a in range(12):
        for b in range(a):
            along = positions[a] - positions[b]
            row = np.zeros(36)
            row[3 * a : 3 * a + 3], row[3 * b : 3 * b + 3] = along, -along
            K += 1e4 / (along @ along) ** 2 * np.outer(row, row)
    mass = 1 + 0.1 * np.arange(12)
    return positions, K, np.diag(np.repeat(mass, 3)), mass


def frequencies(structure, held=()):
    """ω (rad/s) of the whole structure with some degrees of freedom held, by a dense solver."""
    free = np.setdiff1d(np.arange(structure.K.shape[0]), np.asarray(held, dtype=int))
    K, M = (A.toarray()[np.ix_(free, free)] for A in (structure.K, structure.M))
    return np.sqrt(np.maximum(eigh(K, M, eigvals_only=True), 0.0))


def dofs(nodes, directions=range(6)):
    return [6 * node + direction for node in nodes for direction in directions]


def slope(sizes, errors):
    return -np.polyfit(np.log(sizes), np.log(np.abs(errors)), 1)[0]


def squares(modes, parameters, free):
    """A function from values of parameters to rising ω² of a body with parametric modes, clamped or free in space."""
    sums = (sum((law * ca.SX(ca.DM(of(part))) for law, part in modes.masses), ca.SX(0)) for of in (modal, rigid, along))
    f = ca.Function("parts", [parameters], [modes.family.stiffness, *sums])

    def at(values):
        K, M, frame, coupling = (part.full() for part in f(values))
        return eigh(K, M - coupling.T @ np.linalg.solve(frame, coupling) if free else M, eigvals_only=True)

    return at


def modal(part):
    return part.modal


def rigid(part):
    """Mass matrix (6, 6) of the frame's velocity and angular velocity."""
    x, y, z = part.moment
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.block([[part.mass * np.eye(3), -cross], [cross, part.J0]])


def along(part):
    """Momenta (6, n) of the frame's directions by the rates of modes."""
    return np.vstack([part.S, part.G0])
