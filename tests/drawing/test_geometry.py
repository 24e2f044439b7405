"""Shapes that stand in URDF files, drawn."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import symmb as mb
from symmb.show.drawing import draw

FILES = Path(__file__).parents[1] / "data" / "urdf"
TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3], [0.1, 0.1, 0.1]])
"""Corners, and a point inside."""
FACETS = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3], [0, 1, 4]])


def drawing_of(robot):
    return draw(mb.simulate(mb.Scene(mb.System(*robot.elements), robot.start)))


def test_shapes_are_drawn_where_the_file_puts_them():
    """The trunk's cylinder stands on the turntable, and the left arm's box lies along the x of its link."""
    robot = mb.load_urdf(FILES / "branch.urdf")
    drawing = drawing_of(robot)
    solids = {shape.name: shape for shape in drawing.shapes if shape.form == "solid" and shape.kind != ""}
    trunk, arm = solids["trunk"], solids["left_arm"]
    assert (trunk.kind, trunk.size, arm.kind, arm.size) == ("cylinder", (1.0,), "box", (0.0,))
    assert_allclose(drawing.position(trunk.places[0], 0), [0, 0, 0.4], atol=1e-12)
    assert_allclose(trunk.direction, np.diag([0.08, 0.08, 0.3]))
    link = robot.bodies["left_arm"]
    run = mb.simulate(mb.Scene(mb.System(*robot.elements), robot.start))
    assert_allclose(drawing.position(arm.places[0], 0), run(link.point(0.25, 0, 0).r)[0], atol=1e-12)
    assert_allclose(arm.direction, np.diag([0.25, 0.03, 0.03]), atol=1e-15)
    ball = next(shape for shape in drawing.shapes if shape.kind == "sphere")
    assert ball.name == "left_hand"  # which carries the tool
    assert_allclose(drawing.position(ball.places[0], 0), run(robot.bodies["tool"].point(0, 0, 0).r)[0], atol=1e-12)


def test_a_body_with_a_shape_has_no_other():
    drawing = drawing_of(mb.load_urdf(FILES / "branch.urdf"))
    own = {name: [s.form for s in drawing.shapes if s.name == name] for name in ("trunk", "right_arm")}
    assert own["trunk"] == ["solid"] and "bar" in own["right_arm"]


@pytest.fixture
def with_mesh(tmp_path):
    text = (FILES / "branch.urdf").read_text()
    (tmp_path / "arm" / "meshes").mkdir(parents=True)
    mesh = '<mesh filename="package://arm/meshes/hand.stl" scale="1 2 1"/>'
    path = tmp_path / "arm" / "arm.urdf"
    path.write_text(text.replace('<sphere radius="0.04"/>', mesh))
    (tmp_path / "arm" / "meshes" / "hand.stl").write_text(_stl())
    return path


def _stl():
    corners = (" ".join("vertex {} {} {}".format(*p) for p in TETRAHEDRON[facet]) for facet in FACETS)
    facets = (f"facet normal 0 0 0 outer loop {three} endloop endfacet" for three in corners)
    return "\n".join(["solid hand", *facets, "endsolid hand"])


def mesh_is_drawn(path, page):
    robot = mb.load_urdf(path)
    drawing = drawing_of(robot)
    mesh = next(shape for shape in drawing.shapes if shape.form == "mesh")
    assert mesh.name == "left_hand" and mesh.direction.shape == (5 * 3, 3)
    run = mb.simulate(mb.Scene(mb.System(*robot.elements), robot.start))
    pose = drawing.pose(drawing.places[mesh.places[0]].frame, 0)
    seen = mesh.direction @ pose[:, :3].T + pose[:, 3]
    corners = np.array([run(robot.bodies["tool"].point(x, 2 * y, z).r)[0] for x, y, z in TETRAHEDRON])
    assert_allclose(seen, corners[FACETS].reshape(-1, 3), atol=1e-12)
    mb.view(run, page)
    assert page.stat().st_size > 10_000


@pytest.mark.parametrize("suffix", ["html", "svg"])
def test_the_mesh_of_a_link(with_mesh, monkeypatch, suffix):
    """An STL needs no package."""
    monkeypatch.setitem(sys.modules, "trimesh", None)
    mesh_is_drawn(with_mesh, with_mesh.with_suffix(f".{suffix}"))


def as_obj(path):
    path.write_text(path.read_text().replace("hand.stl", "hand.obj"))
    lines = ["v {} {} {}".format(*p) for p in TETRAHEDRON] + ["f {} {} {}".format(*(f + 1)) for f in FACETS]
    (path.parent / "meshes" / "hand.obj").write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("is_own", [True, False], ids=["installed", "its interface"])
def test_another_mesh_by_trimesh(with_mesh, monkeypatch, is_own):
    """As trimesh reads it: all corners of the file, in a class of its own."""
    if is_own:
        pytest.importorskip("trimesh")
    else:
        mesh = SimpleNamespace(vertices=TETRAHEDRON, faces=FACETS)
        monkeypatch.setitem(sys.modules, "trimesh", SimpleNamespace(load=lambda path, force: mesh))
    mesh_is_drawn(as_obj(with_mesh), with_mesh.with_suffix(".html"))


@pytest.mark.parametrize("how, why", [("no trimesh", "Install the package trimesh"), ("no file", "there is no file")])
def test_a_mesh_that_cannot_be_read_is_told(with_mesh, monkeypatch, how, why):
    if how == "no trimesh":
        monkeypatch.setitem(sys.modules, "trimesh", None)
        as_obj(with_mesh)
    else:
        (with_mesh.parent / "meshes" / "hand.stl").unlink()
    drawing = drawing_of(mb.load_urdf(with_mesh))
    (note,) = (note for note in drawing.notes if "hand" in note)
    assert note.startswith("Mesh 'hand.") and why in note
    assert "bar" in [shape.form for shape in drawing.shapes if shape.name == "left_hand"]


@pytest.mark.parametrize("count", [1, 2, 5])
def test_solids_of_links_without_shapes_are_no_larger_than_the_robot(tmp_path, count):
    """Rods of any density keep their size in short chains. Placeholders of 1 kg m^2 get the size of a light part."""
    rng = np.random.default_rng(count)
    lengths, widths = rng.uniform(0.2, 0.9, count), rng.uniform(0.02, 0.05, count)
    masses = rng.uniform(600, 8000, count) * lengths * widths**2

    def solids(placeholder):
        parts = ['<link name="link0"/>']
        for k, (length, width, m) in enumerate(zip(lengths, widths, masses, strict=True), 1):
            along, across = (m * width**2 / 6, m * (length**2 + width**2) / 12) if not placeholder else (1.0, 1.0)
            parts.append(
                f'<link name="link{k}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="{m}"/>'
                f'<inertia ixx="{along}" iyy="{across}" izz="{across}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
                f'<joint name="j{k}" type="continuous"><origin xyz="{lengths[k - 2] if k > 1 else 0} 0 0"/>'
                f'<parent link="link{k - 1}"/><child link="link{k}"/><axis xyz="0 1 0"/></joint>'
            )
        path = tmp_path / "arm.urdf"
        path.write_text(f'<robot name="arm">{"".join(parts)}</robot>')
        drawing = draw(mb.simulate(mb.Scene(mb.System(*mb.load_urdf(path).elements), times=[0.0])))
        return [np.sort(np.linalg.norm(s.direction, axis=1)) for s in drawing.shapes if s.form == "solid"], drawing.size

    own, _ = solids(placeholder=False)
    for half, length in zip(own, lengths, strict=True):
        assert half[-1] <= length / 2 * (1 + 1e-9) and half[-1] >= 0.2 * lengths.min()
        assert count > 2 or half[-1] == pytest.approx(length / 2)
    balls, size = solids(placeholder=True)
    assert all(half.max() < 0.5 * size for half in balls) and size < 1.5 * lengths.sum()
    assert all(4 / 3 * np.pi * half.prod() <= 1.2 * m / 500 for half, m in zip(balls, masses, strict=True))


def test_meshes_that_fail_in_the_same_way_are_told_together(tmp_path, monkeypatch):
    """Readers of trimesh say what they miss. Files that are not there are another reason."""

    def load(path, force):
        raise ImportError("missing `pip install pycollada`")

    monkeypatch.setitem(sys.modules, "trimesh", SimpleNamespace(load=load))
    names = [f"part{k}.{'dae' if k < 4 else 'stl'}" for k in range(6)]
    flange = '<visual><geometry><sphere radius="0.1"/></geometry></visual>'  # which does not tell where the part is
    links = "".join(
        f'<link name="link{k}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        f'</inertial><visual><geometry><mesh filename="{name}"/></geometry></visual>{flange}</link>'
        f'<joint name="j{k}" type="continuous"><parent link="base"/><child link="link{k}"/></joint>'
        for k, name in enumerate(names)
    )
    for name in names[:4]:
        (tmp_path / name).write_text("<COLLADA/>")
    (tmp_path / "star.urdf").write_text(f'<robot name="star"><link name="base"/>{links}</robot>')
    drawing = drawing_of(mb.load_urdf(tmp_path / "star.urdf"))
    assert {"sphere", "centre of mass"} <= {shape.kind for shape in drawing.shapes if shape.name == "link2"}
    read, missing = drawing.notes
    assert read == (
        "Mesh 'part0.dae' of 'link0' (part0.dae cannot be read by trimesh: missing `pip install pycollada`) "
        "and 3 more for the same reason"
    )
    assert "there is no file" in missing and missing.endswith("part4.stl') and 1 more for the same reason")
