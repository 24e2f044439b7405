"""Drawings, stills and films without a browser."""

import json
import shutil
from io import BytesIO

import casadi as ca
import numpy as np
import pytest
from faults import printed, refused, refused_command
from machines import ORIGIN, ball, bouncing_ball, run_of

import symmb as mb
from models import double_pendulum, flexible_pendulum, spherical_pendulum
from symmb.show.drawing import draw, of_run, start_picture, still
from symmb.show.drawing.bodies import mesh_edges
from symmb.show.drawing.exhibit import Exhibit, Ghost
from symmb.show.drawing.outlines import Painter
from symmb.show.drawing.page import page
from symmb.show.drawing.shapes import Drawing, FramePoint, MovingFrame, Shape

SIGNATURES = {".png": b"\x89PNG", ".svg": b"<?xml", ".html": b"<!DOCTYPE html>"}


def test_a_homogeneous_rod_has_its_length_by_its_inertia():
    run = mb.simulate(double_pendulum.scene(), times=[0.0, 0.5])
    rod2, l2 = run.scene.system.bodies[1], run.scene.system.parameters.l2
    expected = np.stack([run(rod2.point(0, y).r) for y in (-l2 / 2, l2 / 2)], axis=1)
    drawing = draw(run)
    bar = next(s for s in drawing.shapes if s.name == "rod2" and s.form == "bar")
    ends = np.stack([drawing.track(place) for place in bar.places], axis=1)  # (n_f, 2, 3)
    np.testing.assert_allclose(ends, expected, atol=1e-12)


def test_elastic_nodes_are_where_their_points_are():
    run = mb.simulate(flexible_pendulum.scene(), times=np.linspace(0, 0.4, 5))
    rod, drawing = run.scene.system.bodies[0], draw(run)
    bars = [s for s in drawing.shapes if s.name == "rod" and s.form == "bar"]
    tracks = [drawing.track(place) for bar in bars for place in bar.places]
    places = [run(rod.node(node).r) for node in range(len(rod.modes.positions))]
    assert all(min(np.abs(track - r).max() for track in tracks) < 1e-12 for r in places)
    assert len(bars) == len(places) - 1


def test_meshes_of_chains_and_grids_are_given_back():
    x = np.linspace(0, 1, 9)
    assert mesh_edges(np.column_stack([x, x**2, 0 * x])) == [(i, i + 1) for i in range(8)]
    assert len(mesh_edges(np.array([[i, j, 0.0] for i in range(4) for j in range(3)]))) == 3 * 3 + 4 * 2


def test_things_fall_down():
    planar, spatial = (draw(mb.simulate(m.scene(), times=[0.0])) for m in (double_pendulum, spherical_pendulum))
    assert planar.planar and not spatial.planar
    for drawing in (planar, spatial):
        assert drawing.camera[1] @ drawing.gravity < 0
        np.testing.assert_allclose(drawing.camera @ drawing.camera.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(drawing.camera) == pytest.approx(1)


@pytest.mark.parametrize("suffix", SIGNATURES)
def test_every_format(suffix, tmp_path):
    path = tmp_path / f"scene{suffix}"
    mb.view(double_pendulum.scene().with_times([0.0, 0.1, 0.2]), path)
    assert path.read_bytes().startswith(SIGNATURES[suffix])


def test_mp4(tmp_path):
    scene = double_pendulum.scene().with_times([0.0, 0.1])
    if shutil.which("ffmpeg") is None:
        refused("needs the program ffmpeg", mb.view, scene, tmp_path / "scene.mp4")
    else:
        mb.view(scene, tmp_path / "scene.mp4")
        assert b"ftyp" in (tmp_path / "scene.mp4").read_bytes()[:16]


def test_a_gif_moves(tmp_path):
    image = pytest.importorskip("PIL.Image")
    mb.view(double_pendulum.scene().with_times(np.linspace(0, 0.2, 5)), tmp_path / "a.gif")
    with image.open(tmp_path / "a.gif") as film:
        first = np.asarray(film.convert("L"))
        film.seek(film.n_frames - 1)
        assert film.format == "GIF" and film.n_frames > 1 and (first != np.asarray(film.convert("L"))).any()


def test_symmb_view(tmp_path, capsys):
    path = tmp_path / "drawn.html"
    assert printed(capsys, "view", "spherical_pendulum", "-o", str(path), "--set", "length=1.1").strip() == str(path)
    assert "spherical pendulum" in path.read_text()
    refused_command(capsys, "view", "spherical_pendulum", "-o", str(tmp_path / "drawn.txt"))


def test_a_run_without_a_scene(tmp_path):
    run, page = tmp_path / "run.npz", tmp_path / "run.html"
    mb.simulate(spherical_pendulum.scene(), times=[0.0, 0.1]).save(run)
    refused("has no scene", mb.view, mb.Trajectory.load(run), page)
    mb.view(mb.Trajectory.load(run, spherical_pendulum.scene()), page)


def test_arrows_turn_and_pages_have_the_runs_of_bounds():
    tips = np.array([[1.0, 0, 0], [0, 2, 0]])
    arrow = Shape("arrow", "push", "Force", "force", (0,), (0.01,), tips)
    fixed = (MovingFrame("ground", np.eye(3, 4)[None]),), (FramePoint(0, np.zeros(3)),)
    view = np.eye(3), True, np.eye(3)[1], 1.0, 0.1, np.zeros(3)
    drawing = Drawing("push", np.arange(2), *fixed, (arrow,), *view, (), np.zeros((2, 0)))
    for k, tip in enumerate(tips):
        points = np.vstack([outline.points for outline in Painter(drawing, k, np.eye(3)).outlines()])
        assert np.abs(points - tip[:2]).max(axis=1).min() < 1e-12
    text = page(Exhibit(drawing, tuple(Ghost(name, "red", drawing) for name in ("lowest", "highest"))))
    runs = json.loads(text.partition('id="drawing">')[2].partition("</script>")[0])["runs"]
    assert [(run["label"], run["tint"]) for run in runs] == [("nominal", ""), ("lowest", "red"), ("highest", "red")]


def test_what_has_no_place_is_named():
    driven = bouncing_ball(lambda m: mb.Motion("drive", m.ball.x, ca.sin(mb.t)))
    run = driven.run(times=[0.0, 0.1], start={"ball.y": 1.0})
    assert draw(run).notes == ("Impact 'floor'", "Motion 'drive'")


def test_a_plane_is_drawn_where_the_ball_touches_it():
    law = mb.HuntCrossley(1e5, restitution=0.8, speed=3.0)
    sloping = ball(lambda m: mb.Contact("slope", m.at, ORIGIN, (0.3, 1), law, radius=0.05))
    drawing = draw(sloping.run(times=np.linspace(0, 0.5, 101), start={"ball.y": 0.5}))
    (plane,) = (shape for shape in drawing.shapes if shape.form == "plane")
    assert np.abs(drawing.places[plane.places[0]].base[:2]).max() < 0.05  # below the ball, which falls on the origin
    assert plane.size[0] > 0.05


def test_actuators_and_stops_are_drawn_at_their_joints():
    rod, cart = mb.Body("rod", 1.0, 0.3), mb.Body("cart", 1.0, 0.1)
    hinge = mb.Revolute("hinge", ORIGIN, rod.point(0, 0.5))
    rail = mb.Prismatic("rail", rod.point(0, -0.5), cart.point(0, 0), axis=(1, 0, 0))
    motor, ram = mb.Actuator("motor", hinge, -2.0 * mb.t), mb.Actuator("ram", rail, 3.0)
    limit = mb.Stop("limit", hinge, -1.0, 1.0, mb.KelvinVoigt(1e3))
    state, held = mb.State("state", rate=1.0), mb.Sampled("held", 0.1, mb.t)
    drawing = draw(run_of(rod, cart, hinge, rail, motor, ram, limit, state, held, times=np.linspace(0, 0.2, 5)))
    shapes = {shape.name: shape for shape in drawing.shapes if shape.name in ("motor", "ram", "limit")}
    assert {name: shape.form for name, shape in shapes.items()} == {"motor": "twist", "ram": "arrow", "limit": "ring"}
    assert np.argmax(np.abs(shapes["motor"].direction[-1])) == 2 and shapes["motor"].direction[-1, 2] < 0
    assert np.argmax(np.abs(shapes["ram"].direction[0])) == 0
    assert not drawing.notes


def test_the_start_is_drawn_without_a_run(monkeypatch):
    """A large model compiles for half a minute."""
    scene = double_pendulum.scene()
    file = BytesIO()
    still(of_run(mb.simulate(scene.with_times(scene.times[:1])), None, None), file, ".png")
    monkeypatch.setattr("symmb.show.drawing.show.simulate", None)
    for subject in (scene, mb.prepare(scene)):
        assert start_picture(subject) == file.getvalue()
