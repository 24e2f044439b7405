"""Nodes and matrices from files of other programs: Nastran's cards and meshes that meshio reads."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from bernoulli import AREA, DENSITY, HEIGHT, I_Y, LENGTH, E, free_beam
from faults import refused, told_in_a_line
from numpy.testing import assert_allclose
from scipy.io import mmwrite
from scipy.linalg import eigh
from structures import frame

import symmb as mb
from symmb import Modes
from symmb.declare.structures.nastran import read_dmig

BEAM = Path(__file__).parents[1] / "data" / "nastran" / "beam.bdf"
"""Four elements of `free_beam`, written by pyNastran 1.4.1; nodes 100, 110, ..., 140."""
POSITIONS, K, M = free_beam(4)


def cantilever_eigenvalues(K, M, count):
    """Of the beam whose first node is clamped [1/s^2]."""
    return eigh(K[6:, 6:], M[6:, 6:], eigvals_only=True)[:count]


def dmig(name, A, nodes, card="DMIG"):
    """A symmetric matrix in free fields, with all digits."""
    degrees = [(node, part) for node in nodes for part in range(1, 7)]
    lines = [f"{card},{name},0,6,2,0,,,{len(A)}"]
    for j, (node, part) in enumerate(degrees):
        rows = [i for i in range(j, len(A)) if A[i, j]]
        for i in rows:
            lines.append(f"{card},{name},{node},{part},,{degrees[i][0]},{degrees[i][1]},{float(A[i, j])!r}")
    return "\n".join(lines) + "\n"


def grids(positions, nodes):
    places = zip(nodes, positions.tolist(), strict=True)
    return "".join(f"GRID,{node},,{x!r},{y!r},{z!r}\n" for node, (x, y, z) in places)


def test_frequencies_of_a_cantilever_from_matrix_market_files(tmp_path):
    positions, stiffness, mass = free_beam(20)
    for name, A in (("K", stiffness), ("M", mass)):
        mmwrite(tmp_path / f"{name}.mtx", A, precision=17)
    modes = mb.FiniteElements.matrices(positions, tmp_path / "K.mtx", tmp_path / "M.mtx").modes(clamped=0, count=4)
    assert_allclose(modes.stiffness, cantilever_eigenvalues(stiffness, mass, 4), rtol=1e-9)
    closed = np.array([1.875104068711961, 4.694091132974175]) ** 2 * np.sqrt(E * I_Y / (DENSITY * AREA)) / LENGTH**2
    assert_allclose(np.sqrt(modes.stiffness)[[0, 2]], closed, rtol=1e-5)  # of twenty elements


def test_a_file_that_pynastran_wrote():
    """Nodes, K and M stand in one file, in large fields of ten digits and numbers with the letter D."""
    structure = mb.FiniteElements.matrices(BEAM, BEAM, BEAM)
    assert_allclose(structure.positions, POSITIONS)
    assert_allclose(structure.K.toarray(), K, rtol=1e-9, atol=1e-9 * K.max())
    assert_allclose(structure.M.toarray(), M, rtol=1e-9, atol=1e-9 * M.max())
    modes = structure.modes(clamped=0, count=3)
    assert_allclose(modes.stiffness, cantilever_eigenvalues(structure.K.toarray(), structure.M.toarray(), 3), rtol=1e-9)
    assert_allclose(modes.frequencies[0], 0.5596 * np.sqrt(E * HEIGHT**2 / 12 / DENSITY) / LENGTH**2, rtol=1e-3)


def test_nodes_stand_in_the_order_of_their_numbers(tmp_path):
    """The file lists them in another order, and has one without freedom."""
    nodes = [7, 9, 30, 31, 400]
    order = [3, 0, 4, 1, 2]
    mesh = grids(POSITIONS[order], [nodes[k] for k in order]) + "GRID,8,,0.,0.,5.\n"
    (tmp_path / "mesh.dat").write_text("$ a comment\nSOL 103\nCEND\nBEGIN BULK\n" + mesh + "ENDDATA\n")
    (tmp_path / "matrices.pch").write_text(dmig("KAAX", K, nodes) + dmig("MAAX", M, nodes))
    structure = mb.FiniteElements.matrices(tmp_path / "mesh.dat", *[tmp_path / "matrices.pch"] * 2)
    assert_allclose(structure.positions, POSITIONS)
    assert_allclose(structure.K.toarray(), K, rtol=1e-15)
    assert_allclose(mb.FiniteElements.matrices(POSITIONS, *[tmp_path / "matrices.pch"] * 2).M.toarray(), M, rtol=1e-15)
    modes = structure.modes(clamped=0, count=4)
    assert_allclose(modes.stiffness, cantilever_eigenvalues(K, M, 4), rtol=1e-9)


SMALL = """\
DMIG    K              0       6       2
DMIG    K              1       1               1       1     2.0
+              2       1    -2.0
DMIG    K              1       2               1       2   2.0+3
               2       2  -2.0+3
DMIG    K              2       1               2       1     2.0
DMIG    K              2       2               2       2   2.0+3
"""
LARGE = """\
DMIG*   K                              0               6               2
DMIG*   K                              1               1
*                      1               1             2.0
*                      2               1            -2.0
DMIG*   K                              1               2
*                      1               2         2.0D+03
*                      2               2        -2.0D+03
DMIG*   K                              2               1
*                      2               1             2.0
DMIG*   K                              2               2
*                      2               2          2.0E+3
"""
FREE = """\
dmig,K,0,6,2,,,,4
dmig,K,1,1,,1,1,2.0,,+
+,2,1,-2.0
DMIG,K,1,2,,1,2,2.+3,,
,2,2,-2000.
DMIG,K,2,1,,2,1,2
DMIG*,K,2,2,
*,2,2,2.0d3
"""


@pytest.mark.parametrize("text", [SMALL, LARGE, FREE], ids=["small", "large", "free"])
def test_fields_of_all_widths_and_numbers_of_all_kinds(text, tmp_path):
    (tmp_path / "K.nas").write_text(text)
    A = np.array([[2.0, -2.0], [-2.0, 2.0]])
    assert_allclose(read_dmig(tmp_path / "K.nas", "K").sparse([1, 2], 3).toarray(), np.kron(A, np.diag([1.0, 1e3, 0])))


def test_positions_of_a_mesh(tmp_path):
    meshio = pytest.importorskip("meshio")
    lines = [("line", [[k, k + 1] for k in range(4)])]
    for name in ("beam.vtk", "beam.inp", "beam.vtu"):
        meshio.Mesh(POSITIONS, lines).write(tmp_path / name)
        assert_allclose(mb.FiniteElements.matrices(tmp_path / name, K, M).positions, POSITIONS, atol=1e-15)
    (tmp_path / "cut.vtu").write_text("<VTKFile>")
    for name in ("cut.vtu", "beam.unknown"):
        (tmp_path / "beam.unknown").write_text("")
        refused(rf"positions: meshio cannot read .*{name}\.$", mb.FiniteElements.matrices, tmp_path / name, K, M)
    refused(r"none\.vtk", mb.FiniteElements.matrices, tmp_path / "none.vtk", K, M, error=mb.SymmbError)


GOOD = "DMIG,K,0,6,2\nDMIG,K,1,1,,1,1,2.0\n"
FAULTS = {
    "no matrix": (
        "GRID,1,,0.,0.,0.\n",
        "no matrix DMIG. Pass a file with one matrix, or with exactly one matrix whose name starts with K",
    ),
    "two matrices": (GOOD + GOOD.replace(",K,", ",KB,"), "the matrices K, KB. Pass a file with one matrix, or with"),
    "no number": (GOOD + "DMIG,K,1,2,,1,2,two\n", "line 3, DMIG: an entry must be a number, got 'two'"),
    "infinite": (GOOD + "DMIG,K,1,2,,1,2,1e999\n", "line 3, DMIG: an entry must be finite, got '1e999'"),
    "no node": (GOOD + "DMIG,K,one,2,,1,2,1.\n", "line 3, DMIG: a node must be a whole number, got 'one'"),
    "a scalar point": (GOOD + "DMIG,K,5,0,,5,0,1.\n", "line 3, DMIG: node 5 has the component 0, .*Scalar points"),
    "a component": (GOOD + "DMIG,K,5,7,,5,7,1.\n", "node 5 has the component 7"),
    "twice": (GOOD + "DMIG,K,1,1,,1,1,2.0\n", "line 3, DMIG: the entry of node 1, component 1 appears twice"),
    "complex": (GOOD.replace(",6,2", ",6,4"), "line 1, DMIG: K is complex"),
    "rectangular": (GOOD.replace(",6,2", ",2,2"), "line 1, DMIG: K must start with a header of form 1 .square. or 6"),
    "no header": (GOOD.split("\n")[1] + "\n", "line 1, DMIG: K must start with a header"),
    "no entry": (GOOD.split("\n")[0] + "\n", "line 1, DMIG: K has no entries"),
    "other nodes": (GOOD, "positions has 5 nodes, but the matrices have 1"),
}


GRIDS = {
    "no node": ("BEGIN BULK\n", "has no GRID card"),
    "twice": ("GRID,1,,0.,0.,0.\nGRID,1,,1.,0.,0.\n", "line 2, GRID: node 1 appears twice"),
    "a system of all nodes": ("GRDSET,,7,,,,5\nGRID,1,,0.,0.,0.\n", "line 1, GRDSET: all nodes are in another"),
    "a system": ("GRID,1,4,0.,0.,0.\n", "line 1, GRID: the position of node 1 is in coordinate system 4"),
    "a system of displacements": ("GRID,1,,0.,0.,0.,2\n", "the displacement of node 1 is in coordinate system 2"),
    "no number": ("GRID,1,,0.,y,0.\n", "line 1, GRID: y of node 1 must be a number, got 'y'"),
    "a node that is missing": ("GRID,100,,0.,0.,0.\n", "the matrices have node 110, but .* has no such GRID card"),
}


@pytest.mark.parametrize(("faults", "case"), [*((FAULTS, case) for case in FAULTS), *((GRIDS, case) for case in GRIDS)])
def test_faults_of_matrices_and_nodes_are_one_sentence(faults, case, tmp_path):
    text, message = faults[case]
    (path := tmp_path / "faults.pch").write_text(text)
    with told_in_a_line(rf"{message}(.|\n)*\.$"):
        mb.FiniteElements.matrices(*((POSITIONS, path, M) if faults is FAULTS else (path, BEAM, BEAM)))


def test_a_file_that_is_not_there_and_one_that_is_binary(tmp_path):
    told, matrices = r"none\.pch' cannot be read", mb.FiniteElements.matrices
    refused(told, matrices, POSITIONS, tmp_path / "none.pch", M, error=mb.SymmbError)
    (tmp_path / "K.pch").write_bytes(bytes(range(256)) * 10)
    refused("no matrix DMIG", matrices, POSITIONS, tmp_path / "K.pch", M)


# The modal file and the checks of its arrays.

MODES = frame().modes(clamped=0, count=3, damping=0.01)
ARRAYS = {field.name: getattr(MODES, field.name) for field in fields(MODES)}


@pytest.mark.parametrize("count", [0, 3])
def test_file_round_trip(tmp_path, count):
    modes = frame().modes(clamped=0, count=count)
    for name in ("frame.npz", "frame.json"):
        modes.save(tmp_path / name)
        again = Modes.load(tmp_path / name)
        for field in fields(modes):
            assert np.array_equal(getattr(again, field.name), getattr(modes, field.name))


def test_a_file_by_others_needs_arrays_and_layout_only(tmp_path):
    np.savez(tmp_path / "own.npz", layout="symmb modes 1", **ARRAYS)
    assert Modes.load(tmp_path / "own.npz").frequencies == pytest.approx(MODES.frequencies)


def test_the_nearest_node_is_found_and_values_cannot_be_changed():
    assert MODES.nearest(*(MODES.positions[7] + 1e-3)) == 7
    refused("read-only", MODES.J0.fill, 1.0, error=ValueError)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"S": np.zeros((3, 2))}, r"S must be an array \(3, 3\), got the shape \(3, 2\)"),
        ({"shapes": MODES.shapes[1:]}, r"shapes must be an array \(13, 3, 3\), got the shape \(12, 3, 3\)"),
        ({"stiffness": np.array([0.0, 1, 2])}, "stiffness must be above 0, got 0. Remove rigid modes"),
        ({"damping": np.array([-1.0, 1, 2])}, "damping must not be negative, got -1"),
        ({"mass": 0.0}, "mass must be above 0, got 0"),
        ({"J0": np.triu(np.ones((3, 3)))}, "J0 must be symmetric"),
        ({"J2": MODES.J2 + np.arange(3.0)[:, None, None, None] * np.eye(3)}, "J2 must be symmetric"),
        ({"center": [0.0, np.nan, 0.0]}, "center must be finite"),
    ],
)
def test_wrong_arrays(change, message):
    refused(message, replace, MODES, **change)


LAYOUT = {"layout": "symmb modes 1"}
FILES = {
    "no layout": (ARRAYS, "layout is missing"),
    "another layout": (ARRAYS | {"layout": "symmb modes 0"}, "layout must be 'symmb modes 1', got 'symmb modes 0'"),
    "names": (LAYOUT | {"mass": 1.0, "extra": 2.0}, r"missing arrays: \['G0', .*\]; unknown arrays: \['extra'\]\. The"),
    "shape": (ARRAYS | LAYOUT | {"J0": np.eye(2)}, r"J0 must be an array of the shape \(3, 3\)"),
}


@pytest.mark.parametrize("kind", FILES)
def test_wrong_files(tmp_path, kind):
    content, message = FILES[kind]
    np.savez(tmp_path / "wrong.npz", **content)
    refused(message, Modes.load, tmp_path / "wrong.npz")


def test_a_file_that_is_no_archive(tmp_path):
    (tmp_path / "text.npz").write_text("modes", encoding="utf-8")
    with (tmp_path / "array.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    for name in ("text.npz", "array.npz"):
        refused("does not hold saved Modes", Modes.load, tmp_path / name)
    refused(None, Modes.load, tmp_path / "none.npz", error=FileNotFoundError)
