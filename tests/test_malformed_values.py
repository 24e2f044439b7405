"""Values that do not fit: not finite, very large or small, of another kind, or files that are not what they seem."""

import os
from functools import cache, partial

import casadi as ca
import numpy as np
import pytest
from conftest import but_long
from faults import refused, told_in_a_line
from machines import GROUND, ball
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline

import symmb as mb
from symmb._errors import FileError

NAN, INF = float("nan"), float("inf")
STIFF = mb.KelvinVoigt(1e4, 10.0)
BALL = mb.Body("ball", 1.0, pose=mb.Particle())
DIRECTED = {
    "Contact": lambda a, b, n: mb.Contact("e", b, a, n, STIFF),
    "Soil": lambda a, b, n: mb.Soil("e", a, b, n, STIFF),
    "BushContact": lambda a, b, n: mb.BushContact("e", a, b, n, 1e-3, STIFF),
    "ToothContact": lambda a, b, n: mb.ToothContact("e", a, b, n, 1e-3, STIFF),
    "TorsionContact": lambda a, b, n: mb.TorsionContact("e", a.body, b.body, 0.1, STIFF, axis=n),
    "TorsionSpring": lambda a, b, n: mb.TorsionSpring("e", a.body, b.body, 1.0, axis=n),
    "Friction": lambda a, b, n: mb.Friction("e", a, b, n, 1.0, mb.Coulomb(0.1, speed=0.01)),
    "Revolute": lambda a, b, n: mb.Revolute("e", a, b, n),
    "Prismatic": lambda a, b, n: mb.Prismatic("e", a, b, n, (0, 0, 1)),
    "Universal": lambda a, b, n: mb.Universal("e", a, b, (1, 0, 0), n),
}


def pushed(element, direction):
    """A body on one element that is pushed and turned in all directions."""
    body = mb.Body("b", 1.0, (1, 2, 3), mb.Spatial())
    joint = DIRECTED[element](GROUND.point(0, 0, 0), body.point(0, 0, 0), direction)
    forces = mb.Gravity(1, 2, -9.81), mb.Torque("torque", body, (0.1, 0.2, 0.3))
    outputs = {"x": body.x, "z": body.z, "vy": body.vy, "wz": body.omega[2]}
    start = {} if element in ("Revolute", "Prismatic", "Universal") else {"b.z": 0.01, "b.vz": -1.0}
    return mb.Scene(mb.System(body, joint, *forces), start, np.linspace(0, 0.2, 5), outputs)


@pytest.mark.parametrize("body", [GROUND, mb.Body("a", 1.0, (1, 2, 3), mb.Spatial(), com=(0, ca.SX(INF), 0))])
def test_points_that_are_not_finite_are_refused_by_name(body):
    contact = mb.Contact("e", BALL.point(0, 0, 0), body.point(0, NAN, 0), (0, 0, 1), STIFF)
    with told_in_a_line(f"Contact 'e'.*a point of body '{body.name}' contains NaN or infinity"):
        mb.System(BALL, *([body] if body is not GROUND else []), contact)


@cache
def along_z(element):
    return mb.simulate(pushed(element, (0.0, 0.0, 1.0)))


@pytest.mark.parametrize("element", DIRECTED)
@pytest.mark.parametrize("size", but_long([1e-320, 1e-200, 1e200, 1.5e308], 1e-200, 1e200))
def test_only_the_direction_of_a_vector_counts(element, size):
    known = along_z(element)
    run = mb.simulate(pushed(element, (0.0, 0.0, size)))
    assert all(np.array_equal(run[name], known[name]) for name in known.names)


def test_oblique_directions_of_any_size():
    for size in (1e-200, 1e200):
        rotations = [mb.rotation((3 * s, 0, 4 * s), 0.3).quaternion for s in (1.0, size)]
        assert np.allclose(ca.DM(rotations[0]), ca.DM(rotations[1]), rtol=1e-15, atol=0)


LAWS = {
    "pressure": lambda value: mb.GasSpring(value, 1e-3, 1e-3, 0.3)(mb.t, mb.t),
    "exponent": lambda value: mb.GasSpring(1e5, 1e-3, 1e-3, 0.3, value)(mb.t, mb.t),
    "length": lambda value: mb.GasSpring(1e5, 1e-3, 1e-3, 0.3)(value, mb.t),
    "area": lambda value: mb.Orifice(value, 1e-4)(mb.t, mb.t),
    "rate": lambda value: mb.Orifice(1e-3, 1e-4)(mb.t, value),
    "opening": lambda value: mb.Orifice(1e-3, lambda stroke, rate: value)(mb.t, mb.t),
}


CALLS = LAWS | {
    "KelvinVoigt": lambda value: mb.KelvinVoigt(value).force(mb.t, mb.t),
    "HuntCrossley": lambda value: mb.HuntCrossley(1.0, 0.5, value, value).force(mb.t, mb.t),
    "Coulomb": lambda value: mb.Coulomb(value, value, value).resistance("name", mb.t, mb.t)[0],
    "Bristle": lambda value: mb.Bristle(value, value, value).resistance("name", mb.t, mb.t)[0],
    "Tabulated": lambda value: mb.Tabulated(mb.Table([0, 1], [0, 1]), value).force(mb.t, mb.t),
}


@pytest.mark.parametrize("name", CALLS)
def test_long_doubles_in_laws_are_numbers(name):
    assert str(CALLS[name](np.longdouble(1.25))) == str(CALLS[name](1.25))


TIMES = np.linspace(0.0, 1.0, 3)
DECAY = mb.FunctionSimulator(lambda k: np.exp(-k * TIMES), {"k": 1.0, "c": 1.0}, TIMES, ["x"])
BOX = mb.Box(k=(0.9, 1.1), c=(0.9, 1.1))
FALL = ball().scene("y")
LARGE = {n: (mb.Scanning(n), "Scanning.* takes .* runs, more than") for n in (10**5, 10**9, 10**18, 2**63, 10**400)}
LARGE["level"] = mb.PolynomialChaos(2, nodes=mb.SparseGrid(level=10**18)), "level 1000000000000000000 is too high"
LARGE["boxes"] = mb.TaylorModel(boxes=10**18), r"takes 1\.0e\+18 runs, more than"


@pytest.mark.parametrize("case", LARGE, ids=lambda n: str(n)[:20])
def test_what_cannot_be_afforded_is_told_by_its_number(case):
    method, text = LARGE[case]
    subject = (FALL, mb.Box(mass=(1, 2))) if case == "boxes" else (DECAY, BOX)
    refused(text, mb.propagate, subject[0], method, subject[1], error=mb.PropagationError)


class NoText:
    def __repr__(self):
        raise OSError("no text")


def inside_itself(value):
    values = [value]
    values.append(values)
    return values


ODD = {
    "itself": lambda: inside_itself(ca.SX.sym("x")),
    "numbers in itself": lambda: inside_itself(1.0),
    "no text": NoText,
    "a broadcast array": lambda: np.broadcast_to(1.0, (2, 10**12)),
}
TAKERS = {
    "Table": lambda v: mb.Table(v, [0, 1]),
    "Box": lambda v: mb.Box(k=v),
    "Box ends": lambda v: mb.Box(k=(v, 1)),
    "Box.without": lambda v: BOX.without(v),
    "Parameters": lambda v: mb.Parameters(k=v),
    "with_nominal": lambda v: mb.Parameters(k=1.0).with_nominal({"k": v}),
    "samples": lambda v: DECAY.run(v),
    "Section": lambda v: mb.Section(v, 1.0, 1.0, 1.0),
    "Beam": lambda v: mb.Beam([v, (1, 0, 0)], mb.Section.circle(0.01), mb.Material(1e9, 1e3, 0.3)),
    "Force": lambda v: mb.System(BALL, mb.Force("f", BALL.point(0, 0), v)),
    "Spring": lambda v: mb.System(BALL, mb.Spring("s", GROUND.point(0, 0), BALL.point(0, 0), v)),
    "Bushing": lambda v: mb.System(BALL, mb.Bushing("s", GROUND.point(0, 0), BALL.point(0, 0), v)),
    "point": lambda v: GROUND.point(v, 0),
    "name": lambda v: FREE.with_name(v),
    "pose": lambda v: mb.Body("b", 1.0, pose=v),
    "times": lambda v: mb.Scene(mb.System(BALL), times=v, outputs={"y": BALL.y}),
    "output": lambda v: mb.Scene(mb.System(BALL), times=[0, 1], outputs={"y": v}),
    "method": lambda v: mb.propagate(DECAY, v, BOX),
    "box": lambda v: mb.propagate(DECAY, mb.Vertex(), v),
    "executor": lambda v: mb.propagate(DECAY, mb.Vertex(), BOX, executor=v),
    "solver": lambda v: mb.simulate(FREE, v),
    "inputs": lambda v: mb.linearize(FREE, inputs=[v]),
    "outputs": lambda v: mb.linearize(FREE, outputs=[v]),
    "progress": lambda v: mb.stability(FREE, progress=v),
    "command": lambda v: mb.CommandSimulator(v, {"k": 1.0}, [0.0], ["x"]),
    "function": lambda v: mb.FunctionSimulator(v, {"k": 1.0}, [0.0], ["x"]),
    "rule": lambda v: mb.SparseGrid(v),
    "tolerance": lambda v: mb.PolynomialChaos(order=2, tolerance=v),
    "probes": lambda v: mb.PolynomialChaos(order=2, probes=v),
    "file": lambda v: mb.simulate(FREE).save(v),
}
FREE = mb.Scene(mb.System(BALL), times=[0, 1], outputs={"y": BALL.y})


@pytest.mark.parametrize("taker", TAKERS)
@pytest.mark.parametrize("odd", ODD)
def test_odd_values_are_told_in_a_sentence(taker, odd):
    refused(None, TAKERS[taker], ODD[odd](), error=mb.SymmbError)


def test_a_folder_whose_name_is_no_name():
    refused("not the name of a file", mb.DAESimulator(FREE).dae.save_c, "\ud800", error=mb.SymmbError)


BODY, TABLE = mb.Body("b", 1.0, 0.1), mb.Table([0, 1], [0, 1])
A, B = GROUND.point(0, 0), BODY.point(0, 0)
SPRING = mb.Spring("s", A, B, 1.0)
SCENE = mb.Scene(mb.System(BODY, SPRING), times=[0.0, 0.1], outputs={"y": BODY.y})
ELEMENTS = {
    "BoxContact": lambda a, b, law: mb.BoxContact("c", a, (1.0, 2.0), b, law),
    "CircleContact": lambda a, b, law: mb.CircleContact("c", a, b, 0.1, 0.2, law),
    "SlotContact": lambda a, b, law: mb.SlotContact("c", a, b, (1, 0), 0.3, 0.06, 0.05, law),
    "Contact": lambda a, b, law: mb.Contact("c", b, a, (0, 1, 0), law),
    "Soil": lambda a, b, law: mb.Soil("c", a, b, (0, 1, 0), law),
}


def modes(**options):
    """Of a clamped rod of steel."""
    beam = mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.01), mb.Material(2e11, 7850, 0.3), 4)
    return mb.FiniteElements.beams(beam).modes(clamped=0, count=2, **options)


STEPPED = mb.GeneralizedAlpha, mb.Newmark, mb.HHT, mb.BDFI3
INFINITE = (0, 0, NAN), (0, INF, 1), (0, 0, -INF), (0, ca.SX(NAN), 1), (0, 0, mb.t / 0), (ca.sin(mb.t) * NAN, 0, 1)
NO_NUMBERS = None, [1.0, 2.0], "a", 1j, True, ca.SX.sym("v", 2), object()
NO_POINTS = (A, BODY), (GROUND, B), (GROUND, BODY), (BODY, A), (A, 3)
OF_TABLES = mb.KelvinVoigt(TABLE), mb.KelvinVoigt(1e5, TABLE), mb.HuntCrossley(TABLE, 0.5, 0.1)
NO_STEPS = np.longdouble("1e-4000"), 0.0, -1e-3, INF
NO_NOMINALS = [1], {"m": None}, {"z": 1.0}, None, {"m": NAN}
WIDE = (-1.7e308, 1.7e308), (-1e308, 1e308), (-9e307, 1.79e308)
REFUSED = [
    (r"with_nominal: (expected numbers for m|m: .* finite number)", mb.Parameters(m=1.0).with_nominal, NO_NOMINALS),
    ("Box: the interval of 'a' .* wider than the largest number", lambda ends: mb.Box(a=ends), WIDE),
]
for name in DIRECTED:
    REFUSED.append((rf"{name} 'e'.*(NaN or infinity|depends on t)", partial(pushed, name), INFINITE))
for name, law in LAWS.items():
    REFUSED.append((f"{name}: expected one number or CasADi SX", law, NO_NUMBERS))
for kind in (*STEPPED, mb.Rosenbrock):
    told = f"{kind.__name__}: step=.* must be a number above 0"
    REFUSED.append((told, lambda step, kind=kind: kind(step=step), NO_STEPS))
for kind in STEPPED:  # Newton's method would do nothing
    told = "tolerance=.* must be a number above 0 and below 1"
    REFUSED.append((told, lambda tolerance, kind=kind: kind(tolerance=tolerance), (1.0, 1e10, 2.0**63)))
for name in ("planar", "stiffening"):
    told = f"{name} must be True or False"
    REFUSED.append((told, lambda value, name=name: modes(**{name: value}), ("no", 0, None, ca.DM(0))))
for make in ELEMENTS.values():
    on_bodies = lambda places, make=make: mb.System(BODY, make(*places, STIFF))  # noqa: E731
    of_tables = lambda law, make=make: mb.System(BODY, make(A, B, law))  # noqa: E731
    REFUSED.append(("'c': expected a point", on_bodies, NO_POINTS))
    REFUSED.append(("(stiffness|damping).* is not a number", of_tables, OF_TABLES))
for shape in (lambda s: (s, s), [(0, 0), (1, 0), (1, 1)]):
    curve = lambda closed, shape=shape: mb.Curve(shape, 0.0, 1.0, closed=closed)  # noqa: E731
    REFUSED.append(("Curve: closed must be True or False", curve, ("no", 1, None, [True])))


@pytest.mark.parametrize(("told", "call", "value"), [(*row, value) for *row, values in REFUSED for value in values])
def test_values_that_do_not_fit_are_refused_by_name(told, call, value):
    refused(told, call, value)


@pytest.mark.parametrize("value", [[1], {"s": 1}, np.ones(2), None])
def test_what_has_no_hash_is_no_name_and_no_solver(value):
    system = SCENE.system
    by_calibration = lambda name: mb.calibrate(SCENE, {"y": np.zeros(2)}, [name])  # noqa: E731
    for call in (system.force, system.lam, system.reaction, by_calibration):
        refused("name|element|constraint|list|parameter", call, value)
    for call in (lambda: mb.prepare(SCENE, [value]), lambda: mb.calibrate(SCENE, {"y": np.zeros(2)}, None, [value])):
        refused("is not a Solver|no parameter", call)


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
    path, told = tmp_path / "k.mtx", f"header gives {entries} entries, too many for 9 rows"
    path.write_text(f"%%MatrixMarket matrix coordinate real general\n9 9 {entries}\n1 1 1\n")
    refused(told, mb.FiniteElements.matrices, np.eye(3), path, np.eye(9))


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
    run = ball(g=None).run("x", [0.0, 0.4, 1.0], {"ball.vx": 1.5}, solver=solver)
    assert_allclose(run["x"], [0.0, 0.6, 1.5], atol=1e-12)


def test_joints_and_bodies_tell_what_they_have():
    slide, pin = mb.Prismatic("s", A, B, axis=(1, 0, 0)), mb.Revolute("p", A, B)
    has = [hasattr(joint, what) for joint in (slide, pin) for what in ("angle", "displacement_rate")]
    assert has == [False, True, True, False]
    assert not hasattr(ball().ball, "theta") and getattr(slide, "angle", None) is None
    refused("'s' has no angle", lambda: slide.angle)


@pytest.mark.parametrize(
    ("outputs", "result"),
    [("y", lambda a: 2 * a), ("y", lambda a: np.double(2 * a)), ("y", lambda a: [2 * a]), ("yz", lambda a: (2 * a, a))],
)
def test_a_function_at_one_time_returns_a_number_or_one_for_each_output(outputs, result):
    f = mb.FunctionSimulator(result, {"a": 1.0}, [0.0], [*outputs])
    assert mb.propagate(f, mb.Vertex(), mb.Box(a=(1.0, 3.0)))["y"] == (np.array([2.0]), np.array([6.0]))


@pytest.mark.parametrize("result", [lambda a: a, lambda a: (a, a, a), lambda a: [[a], [a], [a]]])
def test_a_function_at_several_times_returns_no_number(result):
    f = mb.FunctionSimulator(result, {"a": 1.0}, [0.0, 1.0], ["y", "z"])
    refused("expected numbers of the shape", mb.propagate, f, mb.Vertex(), mb.Box(a=(1.0, 3.0)), error=mb.SymmbError)
