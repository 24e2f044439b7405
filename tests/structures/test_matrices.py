"""Structures from matrices: arrays, sparse matrices and Matrix Market files."""

import numpy as np
import pytest
from faults import refused
from scipy.io import mmwrite
from scipy.sparse import coo_array
from structures import cantilever, frame, lattice

from symmb import FiniteElements

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
