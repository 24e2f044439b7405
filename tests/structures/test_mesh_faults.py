"""What a wrong section, beam or choice of modes is told."""

import numpy as np
import pytest
from faults import refused
from structures import LIGHT, SLENDER, STEEL, cantilever, frame, lattice

import symmb as mb
from symmb import Beam, FiniteElements, Material, Section

P = mb.Parameters(length=1.0)
LENGTH = P.length
LINE = [(0, 0, 0), (1, 0, 0)]
CIRCLE, TINY = Section.circle(0.1), Section(1e-3, 1e-6, 1e-6, 2e-6, 1e-320)
POSITIONS, K, M, _ = lattice()
MASSES, TOWER = FiniteElements.matrices(POSITIONS, K, M), cantilever()
SYMBOL = "contains a symbol. Give numbers, because the modes are computed once. Parameters are allowed only in joints"

FAULTS = {
    "parameter without a value": (
        lambda: FiniteElements.beams(Beam(LINE, Section.circle(LENGTH).without_shear(), STEEL)),
        r"'length' has no value. Give its interval, at=mb.Box\(length=\(lower, upper\)\), or its nominal value, at=",
    ),
    "parameters in a section": (lambda: Section.circle([LENGTH]), f"radius {SYMBOL}"),
    "parameter among points": (lambda: Beam([(0, 0, 0), (LENGTH, 0, 0)], CIRCLE, STEEL), f"points {SYMBOL}"),
    "parameter in a mass": (lambda: frame().with_mass(0, LENGTH), f"mass {SYMBOL}"),
    "parameter in an inertia": (lambda: frame().with_mass(0, 1.0, LENGTH), f"inertia {SYMBOL}"),
    "parameter in a matrix": (lambda: FiniteElements.matrices(POSITIONS, K.astype(object) * LENGTH, M), f"K {SYMBOL}"),
    "a module as a matrix": (lambda: FiniteElements.matrices(POSITIONS, np, M), r"K must be an array \(d, d\)"),
    "parameter in damping": (lambda: frame().modes(count=2, damping=LENGTH), "'length' has no value. Give its interv"),
    "parameters in damping": (lambda: frame().modes(count=2, damping=[LENGTH] * 2), f"damping {SYMBOL}"),
    "negative area": (lambda: Section(-1.0, 1, 1, 1), "Section: area must be above 0, got -1"),
    "infinite area": (lambda: Section(np.inf, 1, 1, 1), "Section: area must be finite"),
    "no shear area": (lambda: FiniteElements.beams(Beam(LINE, TINY, STEEL)), "is too small. Check the units"),
    "tube without wall": (lambda: Section.circle(1.0, 1.0), "inner must be between 0 and the radius 1, got 1"),
    "no nu and no G": (lambda: Material(E=1.0, density=1.0), "give either nu or G"),
    "both nu and G": (lambda: Material(E=1.0, density=1.0, nu=0.3, G=1.0), "give either nu or G"),
    "nu": (lambda: Material(E=1.0, density=1.0, nu=0.6), r"nu must be above -1 and at most 0\.5, got 0\.6"),
    "one point": (lambda: Beam([(0, 0, 0)], CIRCLE, STEEL), "expected at least two points"),
    "a point twice": (lambda: Beam([(0, 0, 0), (0, 0, 0)], CIRCLE, STEEL), "Neighbouring points must not coincide"),
    "planar points": (lambda: Beam([(0, 0), (1, 0)], CIRCLE, STEEL), r"points must be an array \(p, 3\)"),
    "none": (
        lambda: Beam(LINE, CIRCLE, STEEL, 0),
        "elements must be an integer of at least 1 and at most 10000, got 0",
    ),
    "sections": (lambda: Beam(LINE, [CIRCLE] * 3, STEEL), "3 sections for 2 points"),
    "shear at one end": (lambda: Beam(LINE, [CIRCLE, SLENDER], STEEL), "some sections are rigid in shear"),
    "orientation": (lambda: Beam(LINE, CIRCLE, STEEL, orientation=(2, 0, 0)), "along the beam. Give another"),
    "no beam": (FiniteElements.beams, "expected at least one Beam"),
    "beams apart": (
        lambda: FiniteElements.beams(Beam(LINE, CIRCLE, STEEL), Beam(np.array(LINE) + 5, CIRCLE, STEEL)).modes(count=1),
        "no strain energy for motions that are not rigid",
    ),
    "mass at no node": (lambda: frame().with_mass(99, 1.0), "there is no node 99. The nodes have the numbers 0 to 12"),
    "mass": (lambda: frame().with_mass(0, -1.0), "mass must be above 0, got -1"),
    "inertia": (lambda: frame().with_mass(0, 1.0, (1, 1, -1)), "inertia must be symmetric positive semidefinite"),
    "inertia's shape": (
        lambda: frame().with_mass(0, 1.0, (1, 1)),
        r"inertia must be a number or an array \(3,\) or an array \(3, 3\), got",
    ),
    "no rotations": (lambda: MASSES.with_mass(0, 1.0, 0.1), "the nodes have no rotations, so inertia has no effect"),
    "no number of modes": (lambda: frame().modes(), "the number of modes is missing. Pass count=10, or cutoff"),
    "count": (lambda: frame().modes(count=-1), "count must be an integer of at least 0, got -1"),
    "cutoff": (lambda: frame().modes(cutoff=0.0), "cutoff must be above 0, got 0"),
    "no mode below": (lambda: frame().modes(cutoff=1e-3), "no mode is below cutoff=0.001 Hz. Increase cutoff"),
    "too many modes": (lambda: cantilever(1).modes(count=7), "count=7, but the mesh has only 6 modes. Refine the mesh"),
    "dampings": (lambda: frame().modes(count=3, damping=[0.1, 0.1]), r"damping must be a number or an array \(3,\)"),
    "interface": (lambda: frame().modes(interfaces=[0, 13]), "interfaces: there is no node 13"),
    "clamped": (lambda: frame().modes(clamped=-1, count=1), "clamped: there is no node -1"),
    "clamped end": (lambda: frame().modes(clamped=0, interfaces=[0]), "node 0 is clamped, so it cannot be an inter"),
    "clamped without rotations": (
        lambda: MASSES.modes(clamped=0, count=1),
        "node 0 has no rotations, so clamping this node does not hold the body",
    ),
    "interface that does not hold": (
        lambda: MASSES.modes(interfaces=[0], cutoff=1.0),
        "interfaces .* that hold the body: one node with rotations, or three nodes that are not on a line",
    ),
    "stiffening of a free body": (lambda: frame().modes(count=3, stiffening=True), "beams with a clamped node"),
    "stiffening of matrices": (
        lambda: FiniteElements.matrices(TOWER.positions, TOWER.K, TOWER.M).modes(clamped=0, count=3, stiffening=True),
        "beams with a clamped node",
    ),
}


@pytest.mark.parametrize(("declare", "message"), FAULTS.values(), ids=FAULTS)
def test_faults(declare, message):
    refused(message, declare)


def test_a_numeric_material_is_taken():
    assert Material(E=1.0, density=1.0, G=0.4).shear_modulus == 0.4
    assert LIGHT.shear_modulus == 1e10
