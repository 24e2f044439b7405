"""Tables against SciPy's interpolants, outside their points, in every derivative and in compiled lanes."""

import pickle
import sys
import time
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from faults import refused
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

import symmb as mb
from symmb.declare.mechanics.mesh_file import coarser, read_mesh
from symmb.run.codegen import Engine, Lanes, StepTolerances, model_function

RNG = np.random.default_rng(11)
CURVES = {
    "two points": ([0.0, 2.0], [1.0, -3.0]),
    "three points": ([0.0, 0.5, 2.0], [1.0, 1.0, 4.0]),
    "a peak": ([0.0, 1e-3, 4e-3, 9e-3], [0.0, 300e6, 120e6, 0.0]),
    "a step": ([-1.0, 0.0, 1e-6, 1.0], [0.0, 0.0, 1.0, 1.0]),
    "ups and downs": (np.cumsum(RNG.uniform(0.01, 1, 30)), RNG.normal(size=30)),
    "turning at the ends": ([0.0, 1.0, 1.1, 3.0, 3.1], [0.0, 1.0, -2.0, -2.1, 5.0]),
}
X = ca.SX.sym("x")


@pytest.mark.parametrize("curve", CURVES)
def test_a_table_is_scipy_s_monotone_interpolant_and_keeps_beyond_its_points_to_its_ends(curve):
    x, y = (np.array(values) for values in CURVES[curve])
    at = np.sort(np.concatenate([x, RNG.uniform(x[0], x[-1], 300)]))
    expression, pchip = mb.Table(x, y)(X), PchipInterpolator(x, y)
    f = ca.Function("f", [X], [expression, ca.jacobian(expression, X)])
    for order in range(4):
        values = ca.Function("f", [X], [expression])(at[None]).full()[0]
        known = pchip.derivative(order)(at) if order else pchip(at)
        where = ~np.isin(at, x) | (order == 0)  # second derivatives jump at the points
        assert_allclose(values[where], known[where], rtol=1e-9, atol=1e-11 * max(1.0, np.abs(known).max()))
        expression = ca.jacobian(expression, X)
    values, slopes = (a.full()[0] for a in f(np.array([[x[0] - 1e9, x[0] - 1e-3, x[-1] + 1e-3, x[-1] + 1e9]])))
    assert_array_equal(values, [y[0], y[0], y[-1], y[-1]])
    assert_array_equal(slopes, 0)
    fine = f(np.linspace(x[0], x[-1], 4001)[None])[0].full()[0]
    assert fine.min() >= y.min() - 1e-12 * np.ptp(y) and fine.max() <= y.max() + 1e-12 * np.ptp(y)
    assert_allclose(f(x[None])[0].full()[0], y, rtol=1e-14, atol=1e-14 * np.ptp(y))


def test_lanes_read_a_table_each_at_its_own_place():
    x, y = CURVES["ups and downs"]
    table, p, t = mb.Table(x, y), ca.SX.sym("p"), ca.SX.sym("t")
    outputs = ca.vertcat(table(X), ca.jacobian(table(X), X), table(t))
    f = model_function(X, p, t, ca.SX(0.0), outputs, None)
    engine = Engine(Lanes(f, StepTolerances(1e-8, 1e-8)), np.array([2.5]))
    at = np.linspace(x[0] - 1, x[-1] + 1, 101)
    Y, _ = engine.values(at[:, None], np.ones((101, 1)))
    expected = ca.Function("f", [X, t], [outputs])(at[None], 2.5).full().T
    assert_allclose(Y[:, 0], expected, rtol=1e-12, atol=1e-12)


def block(points, argument):
    """A block that a table of its position, speed or of time pushes, and the same force as a function."""
    x = np.linspace(-2.5, 2.5, points) + np.where(np.arange(points) % 2, 0.7, 0) / points
    y = np.sin(1.7 * x) + 0.3 * np.cos(4.1 * x)
    p, body = mb.Parameters(k=3.1), mb.Body("block", mass=1.0, pose=mb.Particle())
    push = mb.Force("push", body.point(0, 0), (mb.Table(x, y)(argument(body, p)) - p.k * body.x, 0))
    start, times, outputs = {"block.x": 0.9, "block.vx": -0.35}, np.linspace(0, 2, 9), {"x": body.x, "v": body.vx}
    scene = mb.Scene(mb.System(body, push, parameters=p), start, times, outputs, mb.Box.around(p, 0.02))
    return scene, PchipInterpolator(x, y)


ARGUMENTS = {
    "time": (lambda b, p: mb.t - 0.8, lambda z, t: t - 0.8),
    "position": (lambda b, p: 2 * b.x, lambda z, t: 2 * z[0]),
    "speed": (lambda b, p: b.vx, lambda z, t: z[1]),
    "period": (lambda b, p: 4 * ca.fmod(mb.t, 0.45) - 1, lambda z, t: 4 * np.fmod(t, 0.45) - 1),
    "parameter": (lambda b, p: p.k / 2, lambda z, t: 1.55),
}


@pytest.mark.parametrize("points", [*(pytest.param(n, marks=pytest.mark.long) for n in (10, 100_000)), 1_000])
@pytest.mark.parametrize("argument", ARGUMENTS)
def test_runs_are_driven_by_tables_of_any_size(argument, points):
    of, known = ARGUMENTS[argument]
    scene, pchip = block(points, of)
    end = [scene.times[0], scene.times[-1]]
    ends = np.union1d(end, np.arange(0.45, 2, 0.45)) if argument == "period" else end
    z, reference = [0.9, -0.35], []
    for a, b in pairwise(ends):  # periods one by one

        def rates(t, z, a=a, b=b):
            at = known(z, np.clip(t, a, np.nextafter(b, a)))
            return [z[1], pchip(np.clip(at, pchip.x[0], pchip.x[-1])) - 3.1 * z[0]]

        own = scene.times[(scene.times >= a) & (scene.times < b)]
        part = solve_ivp(rates, (a, b), z, "DOP853", [*own, b], rtol=1e-9, atol=1e-11, max_step=0.005)
        reference, z = [*reference, *part.y.T[:-1]], part.y[:, -1]
    reference = np.array([*reference, z])
    solvers = [mb.DormandPrince(), mb.CVODES(stiff=True), mb.Rosenbrock(), mb.RungeKutta()]
    of_time = argument in ("time", "period")
    for solver in solvers[: 1 if points == 100_000 else 3 if of_time else 4]:  # fixed steps doubt what they pass over
        run = mb.simulate(scene, solver)
        allowed = 1e-4 if isinstance(solver, mb.RungeKutta) else 2e-6
        assert_allclose(run["x"], reference[:, 0], rtol=0, atol=allowed)
        assert_allclose(run["v"], reference[:, 1], rtol=0, atol=10 * allowed)


def test_a_value_costs_the_same_for_any_number_of_points():
    x = np.linspace(0, 1, 100_000)
    f, g = (ca.Function("f", [X], [ca.jacobian(mb.Table(x[::step], x[::step] ** 2)(X), X)]) for step in (11_111, 1))
    assert f.n_instructions() == g.n_instructions() < 60
    assert float(g(0.437)) == pytest.approx(0.874, abs=1e-9)


def test_a_large_table_is_ready_as_soon_as_a_small_one():
    """But for a second, beside the compiler, whose sources differ in names and sizes alone."""
    seconds = []
    for points in (10, 100_000):
        begin = time.process_time()
        scene, _ = block(points, lambda b, p: b.x)
        mb.simulate(scene, mb.DormandPrince())
        seconds.append(time.process_time() - begin)
    assert seconds[1] < seconds[0] + 2.0


def test_taylor_proofs_and_copies_read_tables():
    scene, _ = block(12, lambda b, p: p.k / 2)
    copy = pickle.loads(pickle.dumps(scene))
    assert_allclose(mb.simulate(copy)["x"], mb.simulate(scene)["x"], rtol=0, atol=1e-9)
    proved, sampled = mb.propagate(scene, mb.TaylorModel()), mb.propagate(scene, mb.Scanning(5))
    assert (proved["x"][0] < sampled["x"][0] + 1e-8).all() and (proved["x"][1] > sampled["x"][1] - 1e-8).all()
    assert np.ptp([proved["x"][0], proved["x"][1]], axis=0).max() < 1.1 * np.ptp(sampled["x"], axis=0).max() + 1e-8


TABLE = mb.Table([0, 1], [0, 1])


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (([0.0, 1.0, 1.0], [1, 2, 3]), r"Table: x must increase, but x\[2\] = 1 follows 1"),
        (([0.0, 1.0], [1, 2, 3]), r"x has the shape \(2,\) and y has \(3,\)\. Pass two lists of equal length"),
        (([0.0], [1.0]), "at least 2"),
        (([0.0, np.nan], [1.0, 2.0]), "Table: x and y must be finite"),
        (([0.0, "one"], [1.0, 2.0]), "Table: x and y must be lists of numbers"),
        ((np.arange(2e6), np.zeros(2_000_000)), "Table: 2000000 points are too many. Pass at most 1000000"),
        (([0.0, 1.0], [1.0, X]), "must be numbers. Multiply the table by"),
        (("x",), "Table: expected a number or a CasADi SX expression, got 'x'"),
        *(((place,), r"Table: .* is not finite") for place in (np.nan, -np.inf, [0.3, np.nan])),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_points_that_make_no_curve_and_places_that_are_no_expression_are_refused(arguments, text):
    refused(text, mb.Table if len(arguments) == 2 else TABLE, *arguments)


# STL files: read, damaged, and made coarser. NumPy writes them here, byte by byte.


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
