"""Beam elements against closed forms: frequencies to the mesh's order, static deflections, sections."""

import numpy as np
import pytest
from faults import refused
from problems import read
from structures import LIGHT, SLENDER, STEEL, cantilever, dofs, frame, frequencies, lattice, slope

import symmb as mb
from symmb import Beam, FiniteElements, Material, Section

BETA = read("beam_modes")
MESHES = (8, 12, 16, 24)


def bending(elements, first, last, tip=0.0):
    """ω of bending in x-z with directions of the first and the last node held."""
    beam = cantilever(elements).with_mass(elements, tip) if tip else cantilever(elements)
    # Deflection z and rotation about y are left free.
    return frequencies(beam, dofs(range(elements + 1), (0, 1, 3, 5)) + dofs([0], first) + dofs([elements], last))


@pytest.mark.parametrize(
    ("first", "last", "tip", "roots", "rigid"),
    [
        ((2, 4), (), 0.0, BETA["clamped_free"], 0),
        ((), (), 0.0, BETA["free_free_and_clamped_clamped"], 2),
        ((2, 4), (2, 4), 0.0, BETA["free_free_and_clamped_clamped"], 0),
        ((2, 4), (2,), 0.0, BETA["clamped_pinned_and_pinned_free"], 0),
        ((2,), (), 0.0, BETA["clamped_pinned_and_pinned_free"], 1),
        ((2,), (2,), 0.0, np.pi * np.arange(1, 5), 0),
        ((2, 4), (), 1.0, BETA["clamped_free_tip_mass_ratio_1"], 0),
    ],
    ids=["clamped-free", "free-free", "clamped-clamped", "clamped-pinned", "pinned-free", "pinned-pinned", "tip mass"],
)
def test_bending_converges_with_fourth_order(first, last, tip, roots, rigid):
    found = np.array([bending(n, first, last, tip)[rigid : rigid + 3] for n in MESHES])
    errors = found / np.array(roots[:3]) ** 2 - 1
    for mode in (1, 2):  # the first one's error of 1e-8 is lost in the dense solver's rounding
        assert slope(MESHES, errors[:, mode]) == pytest.approx(4, abs=0.15)
    assert np.abs(errors[-1]).max() < 4e-5


@pytest.mark.parametrize(("direction", "speed"), [(0, 1e5), (3, 1e5)], ids=["axial", "torsion"])
def test_waves_along_the_beam_converge_with_second_order(direction, speed):
    """ω = (2n - 1) π/2 √(E/ρ)/L, and the same with G where J is the polar moment."""
    others = [k for k in range(6) if k != direction]
    exact = (2 * np.arange(1, 4) - 1) * np.pi / 2 * speed
    found = [frequencies(cantilever(n), dofs(range(n + 1), others) + dofs([0]))[:3] for n in (8, 16, 32)]
    errors = np.array(found) / exact - 1
    assert slope((8, 16, 32), errors[:, 0]) == pytest.approx(2, abs=0.05)
    assert np.abs(errors[-1]).max() < 3e-3


def test_timoshenko_frequencies_of_a_pinned_deep_beam():
    """Lower branch of ρI ρA/κGA ω⁴ - (ρA + ρI λ² + EI ρA λ²/κGA) ω² + EI λ⁴ = 0 with λ = nπ/L (Timoshenko 1921)."""
    deep = Section.rectangle(0.1, 0.2)
    rho_A, rho_I = STEEL.density * deep.area, STEEL.density * deep.Iy
    EI, shear, wave = STEEL.E * deep.Iy, STEEL.shear_modulus * deep.shear_z, np.arange(1, 4) * np.pi
    b = rho_A + rho_I * wave**2 + EI * rho_A * wave**2 / shear
    exact = np.sqrt((b - np.sqrt(b**2 - 4 * rho_I * rho_A / shear * EI * wave**4)) / (2 * rho_I * rho_A / shear))
    meshes = (16, 32, 64)
    held = [dofs(range(n + 1), (0, 1, 3, 5)) + dofs([0, n], (2,)) for n in meshes]
    found = [frequencies(cantilever(n, deep, STEEL), h)[:3] for n, h in zip(meshes, held, strict=True)]
    errors = np.array(found) / exact - 1
    assert slope(meshes, errors[:, 2]) == pytest.approx(2, abs=0.05)
    assert np.abs(errors[-1]).max() < 5e-4
    assert (wave**2 * np.sqrt(EI / rho_A) / exact > 1.05).all()  # Euler and Bernoulli's are far off


@pytest.mark.parametrize("shear", [False, True])
def test_tip_of_a_cone_under_a_force(shear):
    """δ = F L³/(3 E I₀) d₀/d₁ + F L/(κ G A₀) d₀/d₁, of the integrals of (L - x)²/EI and 1/κGA."""
    sections = [Section.circle(radius) if shear else Section.circle(radius).without_shear() for radius in (0.05, 0.02)]
    across = np.array([0.3, -0.6, 0.0]) / np.hypot(0.3, 0.6)  # and across the vertical
    beam = cantilever(8, sections, STEEL, end=(0.6, 0.3, 0.2))
    tip = np.linalg.solve(beam.K.toarray()[6:, 6:], np.concatenate([np.zeros(42), across, np.zeros(3)]))[-6:-3]
    root, length = sections[0], 0.7
    exact = 2.5 * length**3 / (3 * STEEL.E * root.Iy) + 2.5 * length / (STEEL.shear_modulus * root.shear_z)
    assert tip == pytest.approx(exact * across, rel=1e-9, abs=1e-9 * exact)


def test_tip_of_a_cone_pulled_and_twisted():
    """u = F L/(E A₀) d₀/d₁ and φ = T ∫ dx/GJ = T L/(3 G J₀) (d₀/d₁ + (d₀/d₁)² + (d₀/d₁)³)."""
    root, tip = Section.circle(0.05), Section.circle(0.02)
    beam = cantilever(8, [root, tip], STEEL, end=(0.0, 0.0, 0.7))
    load = np.zeros(48)
    load[[-4, -1]] = 1.0
    moved = np.linalg.solve(beam.K.toarray()[6:, 6:], load)
    assert moved[-4] == pytest.approx(0.7 / (STEEL.E * root.area) * 2.5, rel=1e-9)
    twist = 0.7 / (3 * STEEL.shear_modulus * root.J) * (2.5 + 2.5**2 + 2.5**3)
    assert moved[-1] == pytest.approx(twist, rel=1e-7)


def test_the_section_stands_as_oriented():
    flat = Section(area=1.0, Iy=1.0, Iz=4.0, J=1.0)
    for direction, orientation in ((1, None), (2, (0, 0, 1)), (2, (5, 0, 1))):
        K = cantilever(1, flat, orientation=orientation).K.toarray()
        ratio = K[6 + direction, 6 + direction] / K[9 - direction, 9 - direction]
        assert ratio == pytest.approx(4.0)


def test_mass_of_a_meshed_cylinder_is_that_of_the_solid():
    radius, inner, length = 0.05, 0.02, 0.8
    modes = cantilever(3, Section.circle(radius, inner), STEEL, end=(length, 0, 0)).modes(count=0)
    mass, squares = STEEL.density * np.pi * (radius**2 - inner**2) * length, radius**2 + inner**2
    assert modes.mass == pytest.approx(mass)
    assert modes.J0 == pytest.approx(mass * np.diag([squares / 2, *[squares / 4 + length**2 / 12] * 2]))
    assert not modes.center.any()
    assert modes.positions[[0, -1]] == pytest.approx(np.array([[-0.4, 0, 0], [0.4, 0, 0]]))


def test_mass_of_a_cone():
    """V = π L (R² + R r + r²)/3, centroid at L/4 (R² + 2 R r + 3 r²)/(R² + R r + r²) from the wide end."""
    R, r, length = 0.06, 0.02, 0.5
    modes = cantilever(2, [Section.circle(R), Section.circle(r)], STEEL, end=(length, 0, 0)).modes(clamped=0, count=0)
    sum2 = R**2 + R * r + r**2
    assert modes.mass == pytest.approx(STEEL.density * np.pi * length * sum2 / 3)
    assert modes.center[0] == pytest.approx(length / 4 * (R**2 + 2 * R * r + 3 * r**2) / sum2)


def test_torsion_constants_of_rectangles():
    """Of a square 0.140577 a⁴, of 2 : 1 0.228682 a b³ (Timoshenko and Goodier, table of art. 109: 0.1406, 0.229)."""
    assert Section.rectangle(1.0, 1.0).J == pytest.approx(0.1405770, rel=1e-6)
    assert Section.rectangle(1.0, 2.0).J == pytest.approx(2 * 0.2286816, rel=1e-6)
    assert Section.rectangle(2.0, 1.0).J == Section.rectangle(1.0, 2.0).J
    assert Section.circle(1.0, 1 - 1e-9).shear_y / Section.circle(1.0, 1 - 1e-9).area == pytest.approx(0.53, abs=0.005)


def test_elements_of_a_polyline_run_from_corner_to_corner_and_beams_meet_at_their_nodes():
    structure = frame(elements=4)
    assert len(structure.positions) == 9 + 4
    assert structure.nearest(0.9, 0.5, 0.2) == 8
    assert len(np.unique(structure.positions.round(9), axis=0)) == 13
    line = FiniteElements.beams(Beam([(0, 0, 0), (1, 0, 0), (1, 2, 0)], SLENDER, LIGHT, elements=2))
    assert line.positions == pytest.approx(np.array([[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1, 1, 0], [1, 2, 0.0]]))


@pytest.mark.parametrize("G", [1e-296, 1e-307])
def test_ratios_beyond_doubles_are_told(G):
    beam = Beam([(0, 0, 0), (1, 0, 0)], Section.rectangle(0.02, 0.01), Material(2e11, 7800.0, G=G))
    told = "beyond the range of doubles|is too small. Check the units"
    refused(told, lambda: FiniteElements.beams(beam).modes(clamped=0, count=2))


# What a wrong section, beam or choice of modes is told.

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
def test_faults_of_sections_beams_and_modes(declare, message):
    refused(message, declare)


def test_a_numeric_material_is_taken():
    assert Material(E=1.0, density=1.0, G=0.4).shear_modulus == 0.4
    assert LIGHT.shear_modulus == 1e10
