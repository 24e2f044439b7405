"""STL files: read, damaged, and made coarser. NumPy writes them here, byte by byte."""

import sys

import numpy as np
import pytest
from faults import refused
from numpy.testing import assert_allclose

import symmb as mb
from symmb.declare.mechanics.mesh_file import coarser, read_mesh

CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
"""Corners; the triangles of its surface are anticlockwise from outside."""
FACES = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
    [1, 5, 7], [1, 7, 3],
])  # fmt: skip
TRIANGLES = CUBE[FACES]


def binary(triangles, head=b"made by hand", count=None):
    facets = [bytes(12) + corners.astype("<f4").tobytes() + bytes(2) for corners in triangles]
    return b"".join([head.ljust(80), np.uint32(len(triangles) if count is None else count).tobytes(), *facets])


def text(triangles, name="cube"):
    vertex = "  vertex {!r} {!r} {!r}\n"
    rows = ["".join(vertex.format(*corner) for corner in corners) for corners in triangles.tolist()]
    facets = [f"facet normal 0 0 0\n outer loop\n{row} endloop\nendfacet\n" for row in rows]
    return f"solid {name}\n{''.join(facets)}endsolid {name}\n".encode()


GOOD = {
    "binary": binary(TRIANGLES),
    "binary that begins with solid": binary(TRIANGLES, b"solid cube"),
    "binary with bytes behind": binary(TRIANGLES) + b"more",
    "text": text(TRIANGLES),
    "text in capitals": text(TRIANGLES).upper(),
    "text after blanks": b"\n  " + text(TRIANGLES),
    "text with Windows lines": text(TRIANGLES).replace(b"\n", b"\r\n"),
}


@pytest.mark.parametrize("kind", GOOD)
def test_triangles_are_read(kind, tmp_path):
    path = tmp_path / "part.STL"
    path.write_bytes(GOOD[kind])
    assert_allclose(read_mesh(path), TRIANGLES)


NAN = np.array([[[0.0, 0.0, np.nan]] * 3])
BAD = {
    "empty": (b"", "is empty"),
    "blank": (b" \n", "is empty"),
    "no STL": (b"\x89PNG\r\n", "is not an STL file"),
    "a picture": (b"\x89PNG\r\n" + bytes(range(256)), "is incomplete or not an STL file: the header says"),
    "a page": (b"<html>" + b"x" * 200, "is incomplete or not an STL file"),
    "cut off": (binary(TRIANGLES)[:-60], "header says 12 triangles, but the file contains 10"),
    "huge count": (binary(TRIANGLES, count=2**32 - 1), "4,294,967,295 triangles, but the file contains 12"),
    "head alone": (binary(TRIANGLES)[:84], "12 triangles, but the file contains 0"),
    "no triangle": (binary([]), "has no triangle"),
    "text without": (b"solid x\nendsolid x\n", "has no triangle"),
    "text cut off": (text(TRIANGLES)[:-140], "is incomplete or not an STL file"),
    "text without its end": (text(TRIANGLES).split(b"endsolid")[0], "is incomplete or not an STL file"),
    "text of words": (text(TRIANGLES).replace(b"1.0", b"one", 1), "a vertex that does not consist of three numbers"),
    "text of two": (text(TRIANGLES).replace(b"0.0 0.0 0.0", b"0.0 0.0", 1), "is incomplete or not an STL file"),
    "NaN": (binary(NAN), "not finite"),
    "text NaN": (text(NAN), "not finite"),
    "infinity": (binary(np.array([[[0.0, 0.0, np.inf]] * 3])), "not finite"),
}


@pytest.mark.parametrize("kind", BAD)
def test_damaged_files_are_told_in_a_sentence(kind, tmp_path):
    data, told = BAD[kind]
    path = tmp_path / "part.stl"
    path.write_bytes(data)
    caught = refused(told, mb.Mesh, path)
    assert caught.startswith("Mesh: part.stl ") and caught.count("\n") == 0


def test_random_damage_is_read_or_told(tmp_path):
    random, path = np.random.default_rng(0), tmp_path / "part.stl"
    for whole in (binary(TRIANGLES), text(TRIANGLES)):
        for _ in range(150):
            data = bytearray(whole)
            for at in random.integers(len(data), size=random.integers(1, 6)):
                data[at] = random.integers(256)
            path.write_bytes(bytes(data[: random.integers(len(data)) if random.random() < 0.5 else None]))
            try:
                assert np.isfinite(mb.Mesh(path).triangles).all()
            except mb.DeclarationError as error:
                assert "part.stl" in str(error)


def test_other_paths(tmp_path, monkeypatch):
    refused("there is no file", mb.Mesh, tmp_path / "none.stl")
    refused("there is no file", mb.Mesh, "a\0b")
    refused("is not a file", mb.Mesh, tmp_path)
    monkeypatch.setitem(sys.modules, "trimesh", None)
    (tmp_path / "part.obj").write_text("v 0 0 0")
    refused(r"is not an \.stl file. Install the package trimesh", mb.Mesh, tmp_path / "part.obj")


def test_a_file_that_changes_is_read_again(tmp_path):
    path = tmp_path / "part.stl"
    for count in (12, 6):
        path.write_bytes(binary(TRIANGLES[:count]))
        assert len(mb.Mesh(path).triangles) == count


def ball(n):
    """Triangles (2 n^2, 3, 3) of a ball of radius 1 about (5, 0, 0)."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, n + 1), np.linspace(0, np.pi, n + 1), indexing="ij")
    places = np.stack([5 + np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1)
    a, b, c, d = places[:-1, :-1], places[1:, :-1], places[1:, 1:], places[:-1, 1:]
    return np.concatenate([np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))])


@pytest.mark.parametrize("most", [5000, 1000, 100])
def test_coarser_surfaces_lie_on_the_surface(most):
    fewer = coarser(ball(80), most)
    assert most / 4 < len(fewer) <= most
    radius = np.linalg.norm(fewer - [5, 0, 0], axis=2)
    # Cells of side h with 2 triangles each cover the ball: h^2 = 8 pi / len(fewer). The mean of a cell's corners is
    # below the ball by 3 h^2 / 8 at most.
    assert radius.max() <= 1 + 1e-12 and radius.min() > 1 - 3 * np.pi / len(fewer)
    area = np.linalg.norm(np.cross(fewer[:, 1] - fewer[:, 0], fewer[:, 2] - fewer[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(4 * np.pi, rel=0.01 + 15 / most)


def test_few_triangles_stay():
    assert coarser(TRIANGLES, 12) is TRIANGLES
    assert len(coarser(TRIANGLES, 1)) <= 1
