"""Slips in calls, and files that are not what they seem, end in a sentence of symmb's own."""

import os

import casadi as ca
import numpy as np
import pytest
from faults import refused
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline

import symmb as mb
from symmb._errors import FileError

GROUND, BODY, LAW = mb.Ground(), mb.Body("b", 1.0, 0.1, mb.Planar()), mb.KelvinVoigt(1e5, 10.0)
A, B, TABLE = GROUND.point(0, 0), BODY.point(0, 0), mb.Table([0, 1], [0, 1])
SPRING = mb.Spring("s", A, B, 1.0)
SCENE = mb.Scene(mb.System(BODY, SPRING), times=[0.0, 0.1], outputs={"y": BODY.y})
ELEMENTS = {
    "BoxContact": lambda a, b, law: mb.BoxContact("c", a, (1.0, 2.0), b, law),
    "CircleContact": lambda a, b, law: mb.CircleContact("c", a, b, 0.1, 0.2, law),
    "SlotContact": lambda a, b, law: mb.SlotContact("c", a, b, (1, 0), 0.3, 0.06, 0.05, law),
    "Contact": lambda a, b, law: mb.Contact("c", b, a, (0, 1, 0), law),
    "Soil": lambda a, b, law: mb.Soil("c", a, b, (0, 1, 0), law),
}


@pytest.mark.parametrize("kind", ELEMENTS)
@pytest.mark.parametrize("places", [(A, BODY), (GROUND, B), (GROUND, BODY), (BODY, A), (A, 3)], ids=str)
def test_a_body_in_the_place_of_a_point(kind, places):
    refused("'c': expected a point", lambda: mb.System(BODY, ELEMENTS[kind](*places, LAW)))


@pytest.mark.parametrize("kind", ELEMENTS)
@pytest.mark.parametrize(
    "law", [lambda t: mb.KelvinVoigt(t), lambda t: mb.KelvinVoigt(1e5, t), lambda t: mb.HuntCrossley(t, 0.5, 0.1)]
)
def test_a_table_in_the_place_of_a_number_of_a_law(kind, law):
    refused("(stiffness|damping).* is not a number", mb.System, BODY, ELEMENTS[kind](A, B, law(TABLE)))


@pytest.mark.parametrize("shape", [lambda s: (s, s), [(0, 0), (1, 0), (1, 1)]])
@pytest.mark.parametrize("closed", ["no", 1, None, [True]])
def test_a_curve_is_closed_or_it_is_not(shape, closed):
    refused("Curve: closed must be True or False", lambda: mb.Curve(shape, 0.0, 1.0, closed=closed))


@pytest.mark.parametrize("value", [[1], {"s": 1}, np.ones(2), None])
def test_what_has_no_hash_is_no_name_and_no_solver(value):
    system = SCENE.system
    by_calibration = lambda name: mb.calibrate(SCENE, {"y": np.zeros(2)}, [name])  # noqa: E731
    for call in (system.force, system.lam, system.reaction, by_calibration):
        refused("name|element|constraint|list|parameter", call, value)
    for call in (lambda: mb.prepare(SCENE, [value]), lambda: mb.calibrate(SCENE, {"y": np.zeros(2)}, None, [value])):
        refused("is not a Solver|no parameter", call)


@pytest.mark.parametrize("ends", [(-1.7e308, 1.7e308), (-1e308, 1e308), (-9e307, 1.79e308)])
def test_a_box_is_no_wider_than_numbers_are_large(ends):
    refused("Box: the interval of 'a' .* wider than the largest number", lambda: mb.Box(a=ends))


def test_samples_do_not_leave_a_box_by_rounding():
    box = mb.Box(a=(1.0, np.nextafter(1.0, 2.0)), b=(0.1, 0.3))
    inside = box.from_unit(np.random.default_rng(0).uniform(-1, 1, (500, 2)))
    assert (inside >= box.lower).all() and (inside <= box.upper).all()


@pytest.mark.parametrize(
    "text", ["l=" + "[" * 20_000, "l=" + "9" * 5000, "[l]\nnominal=" + "9" * 4400, "l=\udcff", "a" * 10]
)
def test_a_table_of_tolerances_that_toml_cannot_read(text, tmp_path):
    (tmp_path / "a.toml").write_bytes(text.encode(errors="surrogateescape"))
    refused(r"Box\.read: a\.toml is not a table", mb.Box.read, tmp_path / "a.toml")


@pytest.mark.parametrize("entries", ["900000000000", "100", "82"])
def test_a_matrix_market_file_with_more_entries_than_places(entries, tmp_path):
    path = tmp_path / "k.mtx"
    path.write_text(f"%%MatrixMarket matrix coordinate real general\n9 9 {entries}\n1 1 1\n")
    refused(
        f"header gives {entries} entries, too many for 9 rows", mb.FiniteElements.matrices, np.eye(3), path, np.eye(9)
    )


@pytest.mark.parametrize("name", ["b.npz", "b.json", "k.mtx", "k.bdf", "t.csv", "t.toml"])
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_pipes_and_devices_are_not_read(name, kind, tmp_path):
    path = tmp_path / name
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    read_matrices = lambda path: mb.FiniteElements.matrices(np.eye(3), path, np.eye(9))  # noqa: E731
    readers = {"b": mb.Bounds.load, "k": read_matrices, "t": mb.Box.read}
    refused(f"{name}' cannot be read: it is a {kind}", readers[name[0]], path, error=FileError)


@pytest.mark.parametrize("n", [2, 3, 4, 5])
@pytest.mark.parametrize("corners", [[], [1]])
def test_an_open_curve_through_few_points_is_that_of_scipy(n, corners):
    points = np.random.default_rng(n).uniform(-1, 1, (n, 2))
    along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T))]
    curve = mb.Curve(points, corners=corners)
    place = ca.Function("place", [curve.s], [curve.place])
    for begin, end in ((0, 1), (1, n - 1)) if corners and n > 2 else ((0, n - 1),):
        spline = CubicSpline(along[begin : end + 1], points[begin : end + 1])
        for s in np.linspace(along[begin], along[end], 7)[1:-1]:
            assert_allclose(np.array(place(s)).ravel(), spline(s), atol=1e-12)


@pytest.mark.parametrize("solver", [mb.Rosenbrock(), mb.NSTIFFSI2(1e-2, rtol=1e-6), mb.HHT(1e-2)])
def test_a_body_without_forces_moves_on(solver):
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    run = mb.simulate(mb.Scene(mb.System(ball), {"ball.vx": 1.5}, [0.0, 0.4, 1.0], {"x": ball.x}), solver)
    assert_allclose(run["x"], [0.0, 0.6, 1.5], atol=1e-12)


def test_joints_and_bodies_tell_what_they_have():
    slide, pin = mb.Prismatic("s", A, B, axis=(1, 0, 0)), mb.Revolute("p", A, B)
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    has = [hasattr(joint, what) for joint in (slide, pin) for what in ("angle", "displacement_rate")]
    assert has == [False, True, True, False]
    assert not hasattr(ball, "theta") and getattr(slide, "angle", None) is None
    refused("'s' has no angle", lambda: slide.angle)


@pytest.mark.parametrize(
    ("outputs", "result"),
    [
        (["y"], lambda a: 2 * a),
        (["y"], lambda a: np.float64(2 * a)),
        (["y"], lambda a: [2 * a]),
        (["y", "z"], lambda a: (2 * a, a)),
    ],
)
def test_a_function_at_one_time_returns_a_number_or_one_for_each_output(outputs, result):
    f = mb.FunctionSimulator(result, {"a": 1.0}, [0.0], outputs)
    assert mb.propagate(f, mb.Vertex(), mb.Box(a=(1.0, 3.0)))["y"] == (np.array([2.0]), np.array([6.0]))


@pytest.mark.parametrize("result", [lambda a: a, lambda a: (a, a, a), lambda a: [[a], [a], [a]]])
def test_a_function_at_several_times_returns_no_number(result):
    f = mb.FunctionSimulator(result, {"a": 1.0}, [0.0, 1.0], ["y", "z"])
    refused("expected numbers of the shape", mb.propagate, f, mb.Vertex(), mb.Box(a=(1.0, 3.0)), error=mb.SymmbError)
