"""Inertia invariants against sums over material points of the deformed body."""

import numpy as np
import pytest
from faults import refused
from scipy.interpolate import CubicHermiteSpline
from scipy.io import mmwrite
from scipy.sparse import coo_array
from structures import STEEL, cantilever, frame, lattice

from symmb import Beam, FiniteElements, Section

RADIUS = 0.03
X, W = np.polynomial.legendre.leggauss(6)
ETA = np.array([0.03, -0.02, 0.015, 0.04, -0.01])
RATE = np.array([1.0, -2.0, 0.5, 3.0, 1.5])


def material_points(modes, section):
    """Masses, places, shapes (3, n), rotations (3, n) and axes of points along a chain of uniform elements.

    Bending by Hermite's cubics of SciPy, of deflections and slopes θ × t across each element's axis t.
    """
    for a in range(len(modes.positions) - 1):
        ends = modes.positions[a : a + 2]
        length = np.linalg.norm(ends[1] - ends[0])
        t = (ends[1] - ends[0]) / length
        u, theta = modes.shapes[a : a + 2], modes.rotations[a : a + 2]
        across = np.eye(3) - np.outer(t, t)
        deflection = CubicHermiteSpline([0, length], across @ u, np.cross(theta.swapaxes(1, 2), t).swapaxes(1, 2))
        for x, weight in zip((X + 1) / 2, W / 2, strict=True):
            along = np.outer(t, t @ (u[0] * (1 - x) + u[1] * x))
            slope = deflection(x * length, 1)
            turn = np.outer(t, t @ (theta[0] * (1 - x) + theta[1] * x)) + np.cross(t, slope, axisb=0, axisc=0)
            mass = STEEL.density * section.area * length * weight
            yield mass, ends[0] + x * length * t, along + deflection(x * length), turn, t


def inertia(mass, x):
    return mass * (x @ x * np.eye(3) - np.outer(x, x))


@pytest.mark.parametrize("options", [{"clamped": 0, "count": 5}, {"count": 5}, {"interfaces": [0, 6], "count": 11}])
def test_beam_against_its_material_points(options):
    section = Section.circle(RADIUS).without_shear()
    points = [(0, 0, 0), (0.7, 0.1, 0), (0.9, 0.8, 0.4)]
    modes = FiniteElements.beams(Beam(points, section, STEEL, elements=3)).modes(**options)
    n = len(modes.stiffness)
    eta, rate = np.resize(ETA, n), np.resize(RATE, n)
    mass, moment, J, momentum, angular = 0.0, np.zeros(3), np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    for m, s, phi, turn, t in material_points(modes, section):
        x = s + phi @ eta
        rotary = m * section.Iy / section.area * (np.eye(3) + np.outer(t, t))
        mass, moment, J = mass + m, moment + m * x, J + inertia(m, x) + rotary
        momentum = momentum + m * phi @ rate
        angular = angular + m * np.cross(x, phi @ rate) + rotary @ turn @ rate
    assert modes.mass == pytest.approx(mass)
    assert modes.mass * modes.center + modes.S @ eta == pytest.approx(moment, abs=1e-10)
    quadratic = np.einsum("i,j,ijab->ab", eta, eta, modes.J2)
    assert modes.J0 + np.einsum("j,jab->ab", eta, modes.J1) + quadratic == pytest.approx(J, abs=1e-10)
    assert np.abs(quadratic).max() > 1e-5
    assert modes.S @ rate == pytest.approx(momentum, abs=1e-9)
    spin = np.einsum("i,iaj,j->a", eta, modes.G1, rate)
    assert modes.G0 @ rate + spin == pytest.approx(angular, abs=1e-10)
    assert np.abs(spin).max() > 1e-3


def test_point_masses_with_springs():
    positions, K, M, mass = lattice()
    modes = FiniteElements.matrices(positions, K, M).modes(count=5)
    x = modes.positions + modes.shapes @ ETA
    velocity = modes.shapes @ RATE
    assert modes.positions - positions == pytest.approx(np.tile(-(mass @ positions) / mass.sum(), (12, 1)))
    J = sum(inertia(m, place) for m, place in zip(mass, x, strict=True))
    quadratic = np.einsum("i,j,ijab->ab", ETA, ETA, modes.J2)
    assert modes.J0 + np.einsum("j,jab->ab", ETA, modes.J1) + quadratic == pytest.approx(J, rel=1e-12, abs=1e-12)
    angular = (mass[:, None] * np.cross(x, velocity)).sum(axis=0)
    assert np.einsum("i,iaj,j->a", ETA, modes.G1, RATE) == pytest.approx(angular, abs=1e-12)
    assert not modes.G0.any() and not modes.rotations.any()


def test_kinetic_energy_of_motion_and_deformation_is_that_of_the_mass_matrix():
    """T by the invariants, of the undeformed body in motion, against ½ ẋᵀ M ẋ of the whole structure."""
    structure = frame()
    modes = structure.modes(clamped=2, count=5)
    v, omega = np.array([1.0, -0.5, 2.0]), np.array([0.4, 3.0, -1.0])
    turning = np.cross(omega, modes.positions)
    rates = np.hstack([v + turning + modes.shapes @ RATE, omega + modes.rotations @ RATE]).ravel()
    energy = 0.5 * modes.mass * v @ v + v @ np.cross(omega, modes.mass * modes.center) + v @ modes.S @ RATE
    energy += 0.5 * omega @ modes.J0 @ omega + omega @ modes.G0 @ RATE + 0.5 * RATE @ RATE
    assert energy == pytest.approx(0.5 * rates @ structure.M @ rates, rel=1e-12)


def test_symmetry_leaves_exact_zeros():
    modes = cantilever(6, Section.rectangle(0.02, 0.03), STEEL).modes(count=4)
    assert (modes.J0[~np.eye(3, dtype=bool)] == 0).all()
    in_plane = modes.J2[0, 0]
    assert (in_plane[~np.eye(3, dtype=bool)] == 0).all()
    assert np.count_nonzero(modes.G1[0]) == np.count_nonzero(modes.G1[0, 0])


def test_lumped_inertia_of_matrices_approaches_the_beams():
    """First-order terms and stiffness are the beam's own; the masses lumped at nodes err by O(h²)."""
    errors = []
    for elements in (8, 16):
        beam = cantilever(elements, Section.rectangle(0.02, 0.03), STEEL)
        exact = beam.modes(clamped=0, count=4)
        found = FiniteElements.matrices(beam.positions, beam.K, beam.M).modes(clamped=0, count=4)
        for name in ("mass", "center", "J0", "S", "G0", "stiffness", "shapes", "rotations", "positions"):
            size = np.abs(getattr(exact, name)).max()
            assert getattr(found, name) == pytest.approx(getattr(exact, name), abs=1e-9 * size, rel=1e-9)
        errors.append([np.abs(getattr(found, name) - getattr(exact, name)).max() for name in ("J1", "J2", "G1")])
    assert np.log2(np.array(errors[0]) / errors[1]) == pytest.approx(2 * np.ones(3), abs=0.2)


# Structures from matrices: arrays, sparse matrices and Matrix Market files.


POSITIONS, K, M, MASS = lattice()
TOWER = cantilever(2)


def test_arrays_sparse_matrices_and_files_are_the_same_and_a_file_that_is_none_is_told(tmp_path):
    mmwrite(tmp_path / "K.mtx", coo_array(K), symmetry="symmetric", precision=17)
    mmwrite(tmp_path / "M.mtx", M, precision=17)
    given = [(K, M), (coo_array(K), coo_array(M)), (tmp_path / "K.mtx", str(tmp_path / "M.mtx"))]
    structures = [FiniteElements.matrices(POSITIONS, *pair) for pair in given]
    for structure in structures:
        assert structure.K.toarray() == pytest.approx(K, abs=1e-9)
        assert structure.M.toarray() == pytest.approx(M)
        assert structure.per_node == 3
        assert structure.samples.mass == pytest.approx(MASS)
    (tmp_path / "K.mtx").write_text("K = 1\n", encoding="utf-8")
    refused("is not a Matrix Market file", FiniteElements.matrices, POSITIONS, tmp_path / "K.mtx", M)


def test_a_mass_may_be_added():
    heavier = FiniteElements.matrices(POSITIONS, K, M).with_mass(3, 5.0).modes(count=3)
    direct = FiniteElements.matrices(POSITIONS, K, M + np.diag(np.repeat(5.0 * (np.arange(12) == 3), 3))).modes(count=3)
    for name in ("mass", "J0", "J1", "J2", "G1", "stiffness"):
        assert getattr(heavier, name) == pytest.approx(getattr(direct, name), rel=1e-9, abs=1e-9)


def test_masses_without_rotary_inertia_will_do():
    """Rotations without mass, as in lumped mass matrices: as many modes as there are masses that move."""
    beam = frame(elements=2)
    masses = np.zeros(beam.K.shape[0])
    masses[np.arange(len(masses)) % 6 < 3] = 1.0
    structure = FiniteElements.matrices(beam.positions, beam.K, np.diag(masses))
    assert len(structure.modes(cutoff=1e9).stiffness) == 3 * len(beam.positions) - 6
    reduced = structure.modes(interfaces=[0, 4], count=8)
    assert reduced.frequencies[0] == pytest.approx(structure.modes(count=1).frequencies[0], rel=0.02)


ONE = np.eye(36)
ORDER = np.arange(18).reshape(3, 6)[:, [3, 4, 5, 0, 1, 2]].ravel()
FAULTS = {
    "size": ((POSITIONS[:-1], K, M), r"K has the shape \(36, 36\), but 11 nodes have 3 or 6 .*: 33 or 66 rows"),
    "other sizes": ((POSITIONS[:6], K, M[:18, :18]), r"K has the shape \(36, 36\), but M has the shape \(18, 18\)"),
    "not symmetric": (
        (POSITIONS, K + np.outer(ONE[0], ONE[5]), M),
        "K is not symmetric. If only one triangle is stored",
    ),
    "supported": (
        (POSITIONS, K + 1e3 * np.outer(ONE[0], ONE[0]), M),
        r"K has strain energy for a rigid translation along x \(row 0\).*without supports",
    ),
    "positions in other units": ((POSITIONS * [1, 2, 1], K, M), "K has strain energy for a rigid rotation about x"),
    "rotations first": (
        (TOWER.positions, TOWER.K.toarray()[np.ix_(ORDER, ORDER)], TOWER.M),
        "K has strain energy for a rigid translation",
    ),
    "negative mass": ((POSITIONS, K, M - 1.5 * np.outer(ONE[4], ONE[4])), "the mass matrix is not positive"),
    "not finite": ((POSITIONS, K * np.nan, M), "K must be finite"),
    "no matrix": ((POSITIONS, K[0], M), r"K must be an array \(d, d\), got the shape \(36,\)"),
    "no positions": ((POSITIONS.ravel(), K, M), r"positions must be an array \(k, 3\)"),
    "one place": ((POSITIONS[:1], K[:3, :3], M[:3, :3]), "two nodes"),
}


@pytest.mark.parametrize(("given", "message"), FAULTS.values(), ids=FAULTS)
def test_faults(given, message):
    refused(message, FiniteElements.matrices, *given)


def test_a_mechanism_is_refused():
    loose = K.copy()
    loose[33:] = loose[:, 33:] = 0.0
    for i in range(11):  # the last node hangs on nothing: take its springs off the others as well
        along, at = POSITIONS[11] - POSITIONS[i], slice(3 * i, 3 * i + 3)
        loose[at, at] -= 1e4 / (along @ along) ** 2 * np.outer(along, along)
    told = "no strain energy for motions that are not rigid"
    refused(told, FiniteElements.matrices(POSITIONS, loose, M).modes, count=3)
