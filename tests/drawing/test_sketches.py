"""Every element has a drawing of its own, open joints are drawn open, and bodies in their shapes and those of URDF."""

import pickle
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from faults import refused
from machines import bob, cart, pendulum, run_of
from numpy.testing import assert_allclose

import symmb as mb
from symmb.declare.mechanics import Element, OwnState
from symmb.show.drawing import draw
from symmb.show.drawing.elements import sketch
from symmb.show.drawing.geometry import outward
from symmb.show.drawing.outlines import Painter

WITHOUT_PLACE = {"Gravity", "Impact", "Motion", "VelocityConstraint"}
"""Gravity is an arrow beside the mechanism. The others are expressions, which a page names as not drawn."""
KINDS = {name: getattr(mb, name) for name in mb.__all__}
ELEMENTS = {name: kind for name, kind in KINDS.items() if isinstance(kind, type) and issubclass(kind, Element)}


@pytest.mark.parametrize("name", ELEMENTS)
def test_every_element_has_a_sketch(name):
    has_sketch = sketch.dispatch(ELEMENTS[name]) is not sketch.dispatch(object)
    assert has_sketch != (name in WITHOUT_PLACE or issubclass(ELEMENTS[name], OwnState | mb.Input))


def forms(drawing, name, k):
    """Forms of the shapes of an element in a picture."""
    return sorted(s.form for s in drawing.shapes if s.name == name and drawing.has(s, k))


def test_a_sling_is_there_until_it_opens():
    released = bob(lambda m: mb.Release(m.rod, m.bob.x < 0), g=None)
    drawing = draw(released.run(times=np.linspace(0, 3, 31), start={"bob.x": 1.0, "bob.y": 0.0, "bob.vy": 1.0}))
    for k, t in enumerate(drawing.t):
        closed = t < np.pi / 2
        assert forms(drawing, "rod", k) == (["ball", "ball", "bar"] if closed else [])
        assert forms(drawing, "rod_release", k) == ([] if closed else ["ball", "ring"])
    seen = {o.shape.name for o in Painter(drawing, 30, drawing.camera).outlines()}
    assert "rod" not in seen and "rod_release" in seen
    assert "Release 'rod'" not in drawing.notes
    numbers = {k: len(Painter(drawing, k, drawing.camera).outlines()) for k in (0, 30)}
    assert numbers[0] != numbers[30]


def test_a_latch_closes_where_the_bodies_are():
    """The hook catches at 0.1 m, at t = 0.5 s, and is drawn on body b from then on; its eye moves with body a."""
    a, b = (mb.Body(name, mass=1.0, pose=mb.Particle()) for name in "ab")
    hook = mb.Spherical("hook", a.point(0, 0), b.point(0, 0))
    start, times = {"a.x": 0.0, "a.vx": 2.0, "b.x": 1.1}, [0.0, 0.2, 0.4, 0.6, 0.8]
    drawing = draw(run_of(a, b, hook, mb.Latch(hook, b.x - a.x < 0.1), start=start, times=times))
    for k in range(5):
        assert forms(drawing, "hook", k) == ([] if k < 3 else ["ball"])
        assert forms(drawing, "hook_latch", k) == (["ball", "ring"] if k < 3 else [])
    (ball,) = (s for s in drawing.shapes if s.name == "hook")
    assert_allclose(drawing.track(ball.places[0])[3:, 0], 1.1 + 1.0 * (drawing.t[3:] - 0.5), atol=1e-9)
    (eye,) = (s for s in drawing.shapes if s.name == "hook_latch" and s.form == "ring")
    x = drawing.track(eye.places[0])[:, 0]
    assert_allclose(x, np.where(drawing.t < 0.5, 2, 1) * (drawing.t - 0.5) + 1, atol=1e-9)


def test_the_guide_of_a_slider_ends_where_it_opens():
    """The shot leaves its barrel at 0.9 m with 2 m/s; pictures are 0.2 m apart."""
    shot = cart(lambda m: mb.Release(m.rail, m.cart.x > 0.9))
    drawing = draw(shot.run(times=np.linspace(0, 20, 201), start={"cart.x": 0.0, "cart.vx": 2.0}))
    ends = sorted(float(drawing.position(place, 0)[0]) for place in _rail(drawing).places)
    assert ends == pytest.approx([-5 * drawing.unit, 0.8 + 5 * drawing.unit], abs=1e-6)
    assert forms(drawing, "rail", 200) == ["bar"] and "block" in forms(drawing, "rail", 0)


def test_the_guide_of_a_latched_slider_lies_where_it_closed():
    """A drawer that is tilted by 0.3 rad is caught as it is."""
    drawer = cart(lambda m: mb.Latch(m.rail, m.cart.x > 0.3))
    start = {"cart.y": 0.2, "cart.vx": 1.0, "cart.vy": -0.3, "cart.theta": 0.3}
    run = drawer.run(times=[0.0, 0.1, 0.6, 1.0], start=start)
    drawing = draw(run)
    a, b = (np.stack([drawing.position(place, k) for k in range(4)]) for place in _rail(drawing).places)
    along = (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
    tilted = [np.cos(0.3), np.sin(0.3), 0]
    assert_allclose(along, [[1, 0, 0], [1, 0, 0], tilted, tilted], atol=1e-12)
    r = np.stack([run["cart.x"], run["cart.y"], 0 * run.t], axis=1)
    assert_allclose(np.cross(r - a, along)[2:], 0, atol=1e-9)  # the drawer is on its guide


def _rail(drawing):
    return next(s for s in drawing.shapes if s.name == "rail" and s.form == "bar")


def outline_of(drawing, name):
    """The only outline of an element in the first picture."""
    (outline,) = (o for o in Painter(drawing, 0, drawing.camera).outlines() if o.shape.name == name)
    return outline


def test_a_rope_touches_its_pulleys_and_is_dashed_while_it_is_slack():
    """Free fall by g t^2 / 2 until the rope, about 0.2 m longer than its way, is tight."""
    load, ground, r = mb.Body("load", 1.0, pose=mb.Particle()), mb.Ground(), 0.1
    points = [ground.point(-1, -0.5), (ground.point(0, 0), -r), load.point(0, 0)]
    rope = mb.Rope("rope", points, 1e4, length=np.hypot(1, 0.5) + 1.4, damping=100.0)
    start = {"load.x": r, "load.y": -1.0}
    drawing = draw(run_of(load, rope, mb.Gravity(0, -10.0), start=start, times=[0.0, 0.1, 0.4]))
    dashed, drawn_through = ([form in forms(drawing, "rope", k) for k in range(3)] for form in ("dashes", "bar"))
    assert dashed == [True, True, False] and drawn_through == [False, False, True]
    bars = [s for s in drawing.shapes if s.name == "rope" and s.form == "bar"]
    for bar in bars:
        p, q = (drawing.position(place, 2) for place in bar.places)
        touch = min((p, q), key=np.linalg.norm)
        assert np.linalg.norm(touch) == pytest.approx(r) and touch @ (p - q) == pytest.approx(0, abs=1e-12)
    assert touch == pytest.approx([r, 0, 0])


LIFTS = {"guide": lambda a: 0.02 * (1 - ca.cos(2 * a)), "pivot": lambda a: 0.2 * (1 - ca.cos(a))}


@pytest.mark.parametrize("follower", LIFTS)
def test_the_tip_of_a_follower_stays_on_its_cam(follower):
    ground, disc, rod = mb.Ground(), mb.Body("disc", 1.0, 0.1), mb.Body("rod", 0.5, 0.1)
    shaft = mb.Revolute("shaft", ground.point(0.3, 0.1), disc.point(0, 0))
    joint = mb.Revolute("pivot", ground.point(0.6, 0.1), rod.point(0, 0))
    if follower == "guide":
        joint = mb.Prismatic("guide", ground.point(0.3, 0.2), rod.point(0, 0), axis=(0, 1, 0))
    valve = mb.CamFollower("valve", shaft, joint, LIFTS[follower], unilateral=False)
    start = {"shaft.angle": 0.4, "shaft.angle_rate": 5.0}
    drawing = draw(run_of(disc, rod, shaft, joint, valve, start=start, times=np.linspace(0, 1.2, 25)))
    shapes = [s for s in drawing.shapes if s.name == "valve"]
    cam, tip = (next(s for s in shapes if s.form == form) for form in ("curve", "ball"))
    outline = np.stack([drawing.track(place) for place in cam.places], axis=1)
    path = np.broadcast_to(drawing.track(tip.places[0]), (25, 3))
    assert np.ptp(path, axis=0).max() > 0.03
    for k in range(25):
        a, d = outline[k, :-1], np.diff(outline[k], axis=0)
        share = np.clip(((path[k] - a) * d).sum(axis=1) / (d**2).sum(axis=1), 0, 1)
        assert np.linalg.norm(a + share[:, None] * d - path[k], axis=1).min() < 2e-4  # between corners of the outline


def test_a_weld_in_the_plane_is_seen():
    tip = mb.Body("tip", 1.0, 0.1)
    welded = pendulum(tip, lambda m: mb.Weld("weld", m.rod.point(0.5, 0), tip.point(0, 0)), length=0.0, g=None)
    drawing = draw(welded.run(times=[0.0], start={"hinge.angle": 0.0}))
    size = np.ptp(outline_of(drawing, "weld").points, axis=0)
    assert drawing.planar and size == pytest.approx([2.2 * drawing.unit] * 2)


def with_shapes(shapes, **options):
    p = mb.Parameters(r=0.1)
    rod = mb.Body("rod", 2.0, 0.5, com=(0.2, 0.0, 0.0), shapes=shapes(p), **options)
    hinge = mb.Revolute("hinge", mb.Ground(shapes(p)).point(0, 0), rod.point(0, 0))
    system = mb.System(rod, hinge, mb.Gravity(0, -9.81), parameters=p)
    return mb.Scene(system, {"hinge.angle": 0.3}, np.linspace(0, 0.2, 3), box=mb.Box.around(p, 0.1))


def test_shapes_are_drawn_at_their_place_in_parameters_and_change_nothing_else():
    turn = mb.rotation(axis=(0, 0, 1), angle=np.pi / 2)
    scene = with_shapes(lambda p: [mb.Box3((4 * p.r, 0.1, 0.02), at=(0.5, 0, -0.1), rotation=turn), mb.Sphere(p.r)])
    drawing = draw(mb.simulate(scene))
    own = [s for s in drawing.shapes if s.name == "rod"]
    assert [s.kind for s in own] == ["box", "sphere"]
    assert [s.name for s in drawing.shapes].count("ground") == 3  # a support
    c, s = np.cos(0.3), np.sin(0.3)
    assert_allclose(drawing.position(own[0].places[0], 0), [0.5 * c, 0.5 * s, -0.1], atol=1e-12)
    assert_allclose(own[0].direction, [[0, -0.05, 0], [0.2, 0, 0], [0, 0, 0.01]], atol=1e-12)
    assert drawing.planar  # though the box is beside the plane
    plain = with_shapes(lambda p: ())
    for a, b in ((scene, plain), (pickle.loads(pickle.dumps(scene)), plain)):
        assert mb.DAESimulator(a).identity() == mb.DAESimulator(b).identity()
    assert_allclose(mb.simulate(scene).x, mb.simulate(plain).x, rtol=0, atol=0)


@pytest.mark.parametrize(
    ("shape", "told"),
    [
        (lambda: mb.Box3((1, 2)), "must have three sides"), (lambda: mb.Box3((1, 2, -3)), "must be positive"),
        (lambda: mb.Box3((1, 2, 3), at=(np.nan, 0, 0)), "NaN or infinity"),
        (lambda: mb.Box3((1, 2, 3), rotation=0.3), "mb.rotation"), (lambda: mb.Cylinder(1.0, np.inf), "finite"),
        (lambda: mb.Cylinder(0.0, 1.0), "radius is 0.0; it must be positive"),
        (lambda: mb.Cylinder(1.0, 1.0, axis=(0, 0, 0)), "no direction"),
        *((partial(mb.Sphere, radius), "expected one number") for radius in (None, [1.0, 2.0], np.ma.masked_all(()))),
        (lambda: mb.Cylinder(1.0, "long"), "expected one number"), (lambda: mb.Mesh(3), "expected the path"),
        (lambda: mb.Box3(np.ma.masked_all(())), "must have three sides"),
        (lambda: mb.Body("rod", 1.0, 0.1, shapes=mb.Sphere(1.0)), "must be a list of Box3"),
        (lambda: mb.Ground([3]), "must be a list of Box3"),
    ],
)  # fmt: skip
def test_faults_of_shapes(shape, told):
    refused(told, shape)


@pytest.mark.parametrize(
    "at",
    [(1.0, 2.0, 3.0), [1.0, 2.0, 3.0], *(np.array([1, 2, 3], kind) for kind in (float, ">f8", "f4", np.longdouble))],
)
def test_a_place_a_size_and_an_axis_are_the_same_in_each_form(at):
    assert repr(mb.Cylinder(0.1, 1.0, axis=at)) == repr(mb.Cylinder(0.1, 1.0, axis=(1.0, 2.0, 3.0)))
    assert repr(mb.Box3(at)) == repr(mb.Box3((1.0, 2.0, 3.0))) and repr(mb.Sphere(at[0])) == repr(mb.Sphere(1.0))
    for shape in (mb.Sphere(0.1, at), mb.Cylinder(0.1, 1.0, at=at), mb.Box3((1, 2, 3), at)):
        assert shape.at == (1.0, 2.0, 3.0) and "at=(1.0, 2.0, 3.0)" in repr(shape)


def test_faces_of_a_box_that_are_seen_are_painted(tmp_path):
    """Of a turned box three faces are seen, 2 triangles each; their areas are those of projections of the faces."""
    size = np.array([0.4, 0.3, 0.2])
    block = mb.Body("block", 1.0, (1, 1, 1), mb.Spatial(), shapes=[mb.Box3(size)])
    drawing = draw(run_of(block, mb.Gravity(0, 0, -9.81)))
    outline = outline_of(drawing, "block")
    a, b, c = np.moveaxis(outline.points.reshape(-1, 3, 2), 1, 0)
    areas = np.abs(np.linalg.det(np.stack([b - a, c - a], axis=1))) / 2
    faces = size.prod() / size * np.abs(drawing.camera[2])
    assert_allclose(np.sort(areas), np.sort(np.repeat(faces / 2, 2)), rtol=1e-12)
    assert len(outline.light) == 6 and len(np.unique(outline.light.round(9))) == 3


def test_meshes_share_the_triangles_of_a_drawing(tmp_path, monkeypatch):
    """A ball of 1,800 triangles."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 31), np.linspace(0, np.pi, 31), indexing="ij")
    places = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1)
    a, b, c, d = places[:-1, :-1], places[1:, :-1], places[1:, 1:], places[:-1, 1:]
    facets = np.zeros(1800, dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    facets["corners"] = np.concatenate([np.stack(k, axis=2).reshape(-1, 3, 3) for k in ((a, b, c), (a, c, d))])
    (tmp_path / "ball.stl").write_bytes(bytes(80) + np.uint32(1800).tobytes() + facets.tobytes())
    monkeypatch.setattr("symmb.show.drawing.geometry.MOST_TRIANGLES", 1000)
    shapes = [mb.Mesh(tmp_path / "ball.stl", scale=0.01), mb.Mesh(tmp_path / "ball.stl", scale=(0.01, 0.02, 0.01))]
    body = mb.Body("body", 1.0, (1, 1, 1), mb.Spatial(), shapes=shapes)
    drawing = draw(run_of(body))
    meshes = [s for s in drawing.shapes if s.form == "mesh"]
    assert [len(s.direction) <= 1500 for s in meshes] == [True, True]
    assert np.ptp(meshes[1].direction, axis=0) == pytest.approx([0.02, 0.04, 0.02], rel=0.1)
    assert drawing.notes[0].endswith("of 3,600 triangles of 2 meshes")


def test_closed_surfaces_face_outward():
    """A tetrahedron, turned inside out, and without a face."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = corners[[0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]]
    for given in (faces, faces[::-1]):
        seen, closed = outward(given)
        a, b, c = (seen[k::3] for k in range(3))
        assert closed and (np.einsum("ij,ij->i", np.cross(b - a, c - a), a - corners.mean(axis=0)) > 0).all()
    assert not outward(faces[3:])[1]


FILES = Path(__file__).parents[1] / "data" / "urdf"
TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3], [0.1, 0.1, 0.1]])
"""Corners, and a point inside."""
FACETS = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3], [0, 1, 4]])


def drawn(path):
    """The run of a robot and its drawing, and where a point of one of its bodies is."""
    robot = mb.load_urdf(path)
    run = run_of(*robot.elements, start=robot.start)
    return run, draw(run), lambda body, *place: run(robot.bodies[body].point(*place).r)[0]


def test_shapes_are_drawn_where_the_file_puts_them():
    """The trunk's cylinder stands on the turntable, and the left arm's box lies along the x of its link."""
    _, drawing, at = drawn(FILES / "branch.urdf")
    solids = {shape.name: shape for shape in drawing.shapes if shape.form == "solid" and shape.kind != ""}
    trunk, arm = solids["trunk"], solids["left_arm"]
    assert (trunk.kind, trunk.size, arm.kind, arm.size) == ("cylinder", (1.0,), "box", (0.0,))
    assert_allclose(drawing.position(trunk.places[0], 0), [0, 0, 0.4], atol=1e-12)
    assert_allclose(trunk.direction, np.diag([0.08, 0.08, 0.3]))
    assert_allclose(drawing.position(arm.places[0], 0), at("left_arm", 0.25, 0, 0), atol=1e-12)
    assert_allclose(arm.direction, np.diag([0.25, 0.03, 0.03]), atol=1e-15)
    ball = next(shape for shape in drawing.shapes if shape.kind == "sphere")
    assert ball.name == "left_hand"  # which carries the tool
    assert_allclose(drawing.position(ball.places[0], 0), at("tool", 0, 0, 0), atol=1e-12)


def test_a_body_with_a_shape_has_no_other():
    _, drawing, _ = drawn(FILES / "branch.urdf")
    own = {name: [s.form for s in drawing.shapes if s.name == name] for name in ("trunk", "right_arm")}
    assert own["trunk"] == ["solid"] and "bar" in own["right_arm"]


@pytest.fixture
def with_mesh(tmp_path):
    path = tmp_path / "arm" / "arm.urdf"
    (path.parent / "meshes").mkdir(parents=True)
    mesh = '<mesh filename="package://arm/meshes/hand.stl" scale="1 2 1"/>'
    path.write_text((FILES / "branch.urdf").read_text().replace('<sphere radius="0.04"/>', mesh))
    corners = (" ".join("vertex {} {} {}".format(*p) for p in TETRAHEDRON[facet]) for facet in FACETS)
    facets = (f"facet normal 0 0 0 outer loop {three} endloop endfacet" for three in corners)
    (path.parent / "meshes" / "hand.stl").write_text("\n".join(["solid hand", *facets, "endsolid hand"]))
    return path


def mesh_is_drawn(path, page):
    run, drawing, at = drawn(path)
    mesh = next(shape for shape in drawing.shapes if shape.form == "mesh")
    assert mesh.name == "left_hand" and mesh.direction.shape == (5 * 3, 3)
    pose = drawing.pose(drawing.places[mesh.places[0]].frame, 0)
    seen = mesh.direction @ pose[:, :3].T + pose[:, 3]
    corners = np.array([at("tool", x, 2 * y, z) for x, y, z in TETRAHEDRON])
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
    _, drawing, _ = drawn(with_mesh)
    (note,) = (note for note in drawing.notes if "hand" in note)
    assert note.startswith("Mesh 'hand.") and why in note
    assert "bar" in [shape.form for shape in drawing.shapes if shape.name == "left_hand"]


def linked(k, mass, inertia, parent, place="0 0 0", centre="0 0 0", visual=""):
    """A link of URDF on a joint about y."""
    moments = '<inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/>'.format(*inertia)
    inertial = f'<inertial><origin xyz="{centre}"/><mass value="{mass}"/>{moments}</inertial>'
    joint = f'<origin xyz="{place}"/><parent link="{parent}"/><child link="link{k}"/><axis xyz="0 1 0"/>'
    return f'<link name="link{k}">{inertial}{visual}</link><joint name="j{k}" type="continuous">{joint}</joint>'


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
            place = lengths[k - 2] if k > 1 else 0
            parts.append(linked(k, m, (along, across, across), f"link{k - 1}", f"{place} 0 0", f"{length / 2} 0 0"))
        path = tmp_path / "arm.urdf"
        path.write_text(f'<robot name="arm">{"".join(parts)}</robot>')
        _, drawing, _ = drawn(path)
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
    seen = [f'<visual><geometry><mesh filename="{name}"/></geometry></visual>{flange}' for name in names]
    links = "".join(linked(k, 1, (1, 1, 1), "base", visual=visual) for k, visual in enumerate(seen))
    for name in names[:4]:
        (tmp_path / name).write_text("<COLLADA/>")
    (tmp_path / "star.urdf").write_text(f'<robot name="star"><link name="base"/>{links}</robot>')
    _, drawing, _ = drawn(tmp_path / "star.urdf")
    assert {"sphere", "centre of mass"} <= {shape.kind for shape in drawing.shapes if shape.name == "link2"}
    read, missing = drawing.notes
    told = "Mesh 'part0.dae' of 'link0' (part0.dae cannot be read by trimesh: missing `pip install pycollada`) "
    assert read == told + "and 3 more for the same reason"
    assert "there is no file" in missing and missing.endswith("part4.stl') and 1 more for the same reason")
