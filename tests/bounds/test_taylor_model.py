"""TaylorModel: proved bounds of scenes, what it refuses, and what it says where a proof ends."""

import itertools
import warnings

import casadi as ca
import numpy as np
import pytest
import random_proofs
from black_boxes import errors_of, quietly
from enclosure_samples import require_sharp
from enclosure_scenes import pendulum, van_der_pol
from faults import refused, warned
from machines import ORIGIN, ball
from small_scenes import formulas, particle, state

import symmb as mb
from models import bouncing_ball, cubic
from symmb.prove import problem_of


def scanned(scene, points=9):
    """Bounds (2, n_t, n_y) of what many runs attain."""
    runs = mb.propagate(scene, mb.Scanning(points), solver=mb.DormandPrince(rtol=1e-12))
    return runs.lower, runs.upper


def test_the_cubic_is_exact():
    """Eq. (13): [0, 4/27]."""
    bounds = mb.propagate(cubic.scene(), mb.TaylorModel())
    assert bounds.kind == "enclosure" and not bounds.doubts
    assert bounds.lower[0, 0] <= 0.0 and bounds.upper[0, 0] >= 4 / 27
    np.testing.assert_allclose(bounds["f"], [[0.0], [4 / 27]], atol=1e-12)


def test_bounds_of_a_scene_hold_runs_and_are_close_to_them():
    scene = pendulum(spread=0.05)
    bounds = mb.propagate(scene, mb.TaylorModel(order=6))
    inner = mb.propagate(scene, mb.Scanning(41), solver=mb.DormandPrince(rtol=1e-12))
    assert bounds.evaluations == 1 and not bounds.doubts
    own = 1e-11 * np.abs(inner.upper).max(axis=0)  # error of the runs
    assert (bounds.lower <= inner.lower + own).all() and (inner.upper <= bounds.upper + own).all()
    width = (inner.upper - inner.lower).max(axis=0)
    assert (errors_of(bounds, inner.lower, inner.upper) <= 1e-3 * width).all()


def test_times_that_begin_later():
    early, late = van_der_pol(end=1.0), van_der_pol(end=1.0).with_times(np.linspace(0.0, 1.0, 21) + 7.0)
    first, second = (mb.propagate(scene, mb.TaylorModel(order=4)) for scene in (early, late))
    np.testing.assert_allclose(first.upper, second.upper, rtol=1e-9)


def test_a_lost_proof_is_doubtful_and_infinite(tmp_path):
    scene = particle(lambda p, mass: p.k * mass.x**3, np.linspace(0.0, 3.0, 31), {"mass.x": 1.0}, k=(0.9, 1.1))
    with pytest.warns(mb.SymmbWarning, match=r"proved up to t = 1\.\d+ s only and infinite later.*more boxes"):
        bounds = mb.propagate(scene, mb.TaylorModel(order=4))
    finite = np.isfinite(bounds.upper[:, 0])
    assert finite[:11].all() and not finite[-10:].any() and (np.isinf(bounds.lower) == np.isinf(bounds.upper)).all()
    assert "proved up to" in str(bounds)
    bounds.save(tmp_path / "bounds.npz")
    np.testing.assert_array_equal(type(bounds).load(tmp_path / "bounds.npz").upper, bounds.upper)
    assert bounds.to_json()["upper"][-1] == [None]
    bounds.plot(tmp_path / "bounds.png")


def test_wide_bounds_are_doubtful():
    """A phase that the parameter moves by 9 rad is beyond the order 2."""
    scene = state(lambda p, z: ca.cos(30 * p.k * mb.t) * z, np.linspace(0, 3, 7), 1.0, k=(0.9, 1.1))
    bounds = warned("proved, but wide from t = [012]", mb.propagate, scene, mb.TaylorModel(order=2))
    assert bounds.upper[-1, 0] > 2.0 and (bounds.upper[:2] < 1.1).all()


def test_fast_oscillations_are_proved():
    scene = formulas(lambda p: {"f": ca.cos(100 * p.k * mb.t)}, [0.0, 0.5, 1.0], k=(0.9, 1.1))
    bounds = mb.propagate(scene, mb.TaylorModel())
    np.testing.assert_allclose(bounds["f"], [[1.0, -1.0, -1.0], [1.0, 1.0, 1.0]], atol=1e-6)


def test_one_of_two_formulas_that_is_not_smooth():
    scene = formulas(lambda p: {"f": ca.fabs(p.k - 1), "g": p.k**2}, k=(0.9, 1.1))
    told = r"bounds are infinite for f, .* over the box is not proved; try smaller intervals"
    bounds = warned(told, mb.propagate, scene, mb.TaylorModel())
    np.testing.assert_allclose(bounds["g"], [[0.81], [1.21]], atol=1e-12)


def test_a_long_proof_tells_early_how_long_it_takes(monkeypatch):
    seconds = itertools.count(0.0, 20.0)
    monkeypatch.setattr("symmb.bound.bounds.taylor_model.time.monotonic", lambda: next(seconds))
    text = r"^TaylorModel\(order=8\): .* % of the time is proved; the rest takes about \d+ minutes"
    with pytest.warns(mb.SymmbWarning, match=text) as told:
        mb.propagate(van_der_pol(), mb.TaylorModel())
    assert len(told) == 1


def test_errors_of_a_solver_are_no_doubt_about_a_proof():
    scene, loose = van_der_pol(end=4.0), mb.DormandPrince(rtol=1e-1)
    with pytest.warns(mb.SymmbWarning, match="exceed a thousandth of their range"):
        assert mb.propagate(scene, mb.Vertex(), solver=loose).doubts
    assert not mb.propagate(scene, mb.TaylorModel(order=4), solver=loose).doubts


def _switched(window):
    return particle(lambda p, mass: ca.if_else(window(mb.t) > 0, p.a, 0), [0.0, 1.0], {}, a=(1, 2))


REDUNDANT = r"constraints depend on other constraints \(.*er\)\. It cannot be proved"
REFUSED = {
    "redundant": (lambda: _door_on_two_hinges(offset=(-1e-3, 1e-3)), REDUNDANT),
    "impact": (bouncing_ball.scene, "cannot prove bounds for scenes with impacts"),
    "floor": (lambda: formulas(lambda p: {"f": ca.floor(p.x)}, x=(0.0, 1.0)), "does not support floor"),
    "switch by fmod": (lambda: _switched(lambda t: ca.fmod(t, 0.5) - 0.1), "does not support floor"),
    "switch by remainder": (lambda: _switched(lambda t: ca.remainder(t, 0.3)), "does not support floor"),
    "switch by floor": (lambda: _switched(lambda t: t - ca.floor(t) - 0.5), "does not support floor"),
}


@pytest.mark.parametrize(("scene", "message"), REFUSED.values(), ids=REFUSED)
def test_what_is_refused(scene, message):
    refused(message, mb.propagate, scene(), mb.TaylorModel(), error=mb.PropagationError)


def _door_on_two_hinges(**box):
    p = mb.Parameters(mass=2.0, offset=0.0)
    door, ground = mb.Body("door", p.mass, (0.1, 0.2, 0.3), pose=mb.Spatial()), mb.Ground()
    places = (("lower", 0, -0.4), ("upper", p.offset, 0.4))
    hinges = [mb.Revolute(name, ground.point(x, 0, z), door.point(-0.5, 0, z), axis=(0, 0, 1)) for name, x, z in places]
    system = mb.System(door, *hinges, mb.Force("push", door.point(0.5, 0, 0), (0, 1, 0)), parameters=p)
    start = {"lower.angle_rate": 1.0}
    return mb.Scene(system, start, [0.0, 0.1], {"x": door.x}, guess={"door.x": 0.5}, box=mb.Box(**box))


def test_rows_that_vanish_are_left_out():
    """With one hinge more, or without it."""
    scene = _door_on_two_hinges(mass=(1.9, 2.1))
    bounds = mb.propagate(scene, mb.TaylorModel())
    np.testing.assert_allclose([bounds.lower, bounds.upper], scanned(scene), atol=1e-10)


def _four_bar(start, box, times=(0.0, 0.1, 0.2), coordinates=None, lengths=(0.3, 0.9, 0.7, 0.8)):
    """A crank of length a, a coupler, and a rocker, on the branch above the ground."""
    p, ground, (_, b, c, d) = mb.Parameters(a=lengths[0], tilt=0.8, spin=1.0), mb.Ground(), lengths
    crank, coupler, rocker = (mb.Body(name, 1.0, 0.04) for name in ("crank", "coupler", "rocker"))
    joints = [
        mb.Revolute("O", ground.point(0, 0), crank.point(-p.a / 2, 0)),
        mb.Revolute("A", crank.point(p.a / 2, 0), coupler.point(-b / 2, 0)),
        mb.Revolute("B", coupler.point(b / 2, 0), rocker.point(c / 2, 0)),
        mb.Revolute("C", ground.point(d, 0), rocker.point(-c / 2, 0)),
    ]
    system = mb.System(crank, coupler, rocker, *joints, mb.Gravity(0, -9.81), parameters=p)
    guess = {"coupler.theta": 0.5, "rocker.theta": 1.5, "crank.theta": 0.8}
    outputs = {"rocker": rocker.theta, "speed": rocker.omega}
    return mb.Scene(system, start(p), times, outputs, guess=guess, box=box, coordinates=coordinates)


@pytest.mark.parametrize("times", [(0.0,), (0.0, 0.1, 0.2)])
def test_a_loop_against_runs_in_coordinates_of_bodies(times):
    start, box = lambda p: {"crank.theta": p.tilt, "crank.omega": p.spin}, mb.Box(a=(0.298, 0.302))
    scene, in_bodies = (_four_bar(start, box, times, coordinates) for coordinates in (None, "body"))
    bounds = mb.propagate(scene, mb.TaylorModel(order=5))
    assert not bounds.doubts
    runs = mb.propagate(in_bodies, mb.Scanning(9), solver=mb.CVODES(rtol=1e-12, atol=1e-13))
    require_sharp(bounds, [runs.lower, runs.upper], 1e-9, 1e-6, size=1.0)


@pytest.mark.parametrize(
    "start",
    [
        lambda p: {"crank.theta": p.tilt, "crank.omega": p.spin - 1, "rocker.omega": 0.0},
        lambda p: {"crank.theta": p.tilt, "rocker.omega": 0.0, "coupler.omega": 1.0 - p.spin},
    ],
)
def test_starts_that_agree_at_the_nominal_parameters_only_are_refused(start):
    with pytest.raises(mb.PropagationError, match=r"spin = .*, the start values contradict the constraints"):
        mb.propagate(_four_bar(start, mb.Box(spin=(0.9, 1.1))), mb.TaylorModel(order=4))


def test_a_change_point_is_not_passed():
    """All bars of a parallelogram come into one line, where it may go on as another mechanism."""
    lengths, times = (0.5, 0.8, 0.5, 0.8), np.linspace(0, 0.5, 26)
    start = {"crank.theta": 0.8, "crank.omega": -3.0}
    scene = _four_bar(lambda p: start, mb.Box(spin=(0.9, 1.1)), times, lengths=lengths)
    bounds = warned(r"proved up to t = 0\.[12]", mb.propagate, scene, mb.TaylorModel(order=4))
    assert np.isfinite(bounds.upper[:5]).all() and not np.isfinite(bounds.upper[15:]).any()


def test_a_spring_that_holds_a_mass_in_equilibrium():
    machine = ball(lambda m: mb.Spring("spring", ORIGIN, m.at, m.p.k, length=1.0), k=100.0)
    options = {"equilibrium": True, "guess": {"ball.y": -1.1}, "box": mb.Box(k=(90, 110))}
    bounds = mb.propagate(machine.scene("y", [0.0, 1.0], **options), mb.TaylorModel())
    assert errors_of(bounds, -1 - 9.81 / 90, -1 - 9.81 / 110).max() < 1e-6


def test_more_parameters_than_polynomials_have_room_for_are_refused():
    product = lambda p: {"f": p.a * p.b * p.c * p.d * p.e * p.f}  # noqa: E731
    scene, told = formulas(product, **dict.fromkeys("abcdef", (0.99, 1.01))), "of 6 parameters have 4826809 terms"
    refused(rf"{told}.* Use order=5, fewer", mb.propagate, scene, mb.TaylorModel(), error=mb.PropagationError)


def test_a_rate_at_the_start_may_follow_a_parameter():
    """The start divides by pivots that nearly cancel; bounds against runs."""
    p = mb.Parameters(k=1.0)
    rod = mb.Body("rod", mass=1.0, inertia=p.k**2 / 12)
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(0, p.k / 2))
    system = mb.System(rod, hinge, mb.Gravity(0, -9.81), parameters=p)
    start, times = {"hinge.angle": 1.0, "hinge.angle_rate": -p.k}, np.linspace(0, 0.5, 3)
    scene = mb.Scene(system, start, times, {"angle": hinge.angle, "rate": hinge.angle_rate}, box=mb.Box(k=(0.9, 1.1)))
    bounds = mb.propagate(scene, mb.TaylorModel())
    lower, upper = scanned(scene, 41)
    assert (bounds.lower <= lower + 1e-11).all() and (upper <= bounds.upper + 1e-11).all()
    assert (bounds.upper - bounds.lower <= (upper - lower) * 1.01 + 1e-8).all()


def test_one_time_is_enough():
    bounds = mb.propagate(state(lambda p, z: -p.k * z, [0.0], 2.0, k=(0.9, 1.1)), mb.TaylorModel())
    np.testing.assert_allclose([bounds.lower[0, 0], bounds.upper[0, 0]], 2.0, rtol=1e-12)


def test_infinite_bounds_make_a_comparison_doubtful():
    """With k = 1.1, the state is infinite at t = 1.515."""
    scene = state(lambda p, z: p.k * z**2, np.linspace(0.0, 1.51, 4), 0.6, k=(0.9, 1.1))
    found = warned("not proved|infinite later", mb.compare, scene, [mb.TaylorModel(order=2)], reference=mb.Scanning(11))
    assert found.doubts


@pytest.mark.parametrize(
    ("start", "mass", "arm"),
    [
        ({"a.theta": "tilt"}, 1.0, 0.5),
        ({"a.theta": 0.3, "j.angle": 0.04}, 2.5, 0.3),
        ({"a.theta": "tilt", "a.omega": -1.7, "j.angle": 0.04, "j.angle_rate": 0.8}, 0.4, 0.5),
        ({"a.theta": "tilt", "b.theta": 0.4}, 1.0, 0.8),
        ({"a.theta": "tilt", "a.x": 0.3, "a.vy": 2.0}, 1.0, 0.2),
    ],
)
def test_a_free_body_that_carries_a_hinge(start, mass, arm):
    """Two bodies on a hinge that fly freely; "tilt" in the start is a parameter."""
    p = mb.Parameters(tilt=0.7, mass=mass)
    a, b = mb.Body("a", 1.0, 0.1), mb.Body("b", p.mass, 0.1)
    hinge = mb.Revolute("j", a.point(arm, 0), b.point(-arm, 0))
    system = mb.System(a, b, hinge, mb.Gravity(0, -9.81), parameters=p)
    tilt = {"tilt": (0.69, 0.71)} if "tilt" in start.values() else {}
    start = {name: p.tilt if value == "tilt" else value for name, value in start.items()}
    box = mb.Box(mass=(0.9 * mass, 1.1 * mass), **tilt)
    scene = mb.Scene(system, start, np.linspace(0.0, 0.3, 3), {"y": b.y, "angle": b.theta}, box=box)
    bounds = mb.propagate(scene, mb.TaylorModel(order=4))
    assert not bounds.doubts
    require_sharp(bounds, scanned(scene), 1e-11, 1e-3, size=1.0)


def _steep_rod(upper, times):
    """A rod whose centre is at a height up to one that it reaches upright: the angle is steep there."""
    p, rod = mb.Parameters(y=0.47), mb.Body("rod", 1.0, 0.1)
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(-0.5, 0))
    system, guess = mb.System(rod, hinge, mb.Gravity(0, -9.81), parameters=p), {"rod.theta": 0.5}
    return mb.Scene(system, {"rod.y": p.y}, times, {"x": rod.x}, guess=guess, box=mb.Box(y=(0.45, upper)))


@pytest.mark.parametrize(("upper", "boxes", "enough"), [(0.4999, 1, False), (0.499, 8, True), (0.4995, 16, True)])
def test_a_start_is_proved_in_parts(upper, boxes, enough):
    scene = _steep_rod(upper, [0.0, 0.05, 0.1])
    bounds = quietly(mb.propagate, scene, mb.TaylorModel(order=6, boxes=boxes))
    assert np.isfinite(bounds.upper).all() == enough
    if enough:
        assert not bounds.doubts and 1 < bounds.evaluations <= boxes
        np.testing.assert_allclose([bounds.lower[0, 0], bounds.upper[0, 0]],
                                   np.sqrt(0.25 - np.array([upper, 0.45]) ** 2), atol=1e-5)  # fmt: skip
    else:
        assert "the start cannot be proved" in bounds.doubts[0] and "more boxes" in bounds.doubts[0]


def _formula(f):
    return formulas(lambda p: {"f": f(p.k)}, k=(-1.0, 3.0)).with_box(mb.Box(k=(-1.0, 1.0)))


NO_TIME = "not proved at any time: no output can be shown to be smooth.* over the box; try smaller intervals"
INFINITE = {
    "corner": (lambda: _formula(ca.fabs), NO_TIME),
    "corner inside": (lambda: formulas(lambda p: {"f": ca.fabs(p.k - 1)}, k=(0.9, 1.1)), NO_TIME),
    "pole": (lambda: _formula(lambda k: 1 / k), NO_TIME),
    "root": (lambda: _formula(ca.sqrt), NO_TIME),
    "no start": (lambda: _steep_rod(0.51, [0.0, 0.1]), "cannot be started; try smaller intervals"),
}


@pytest.mark.parametrize(("scene", "message"), INFINITE.values(), ids=INFINITE)
def test_what_is_proved_nowhere_has_infinite_bounds(scene, message):
    method = mb.TaylorModel() if message is NO_TIME else mb.TaylorModel(order=4, boxes=8)
    bounds = warned(message, mb.propagate, scene(), method)
    assert np.isinf(bounds.upper).all() and np.isinf(bounds.lower).all()


@pytest.mark.parametrize("operation", [ca.floor, ca.ceil, lambda x: ca.fmod(x, 0.3)], ids=["floor", "ceil", "fmod"])
def test_an_output_without_a_remainder_leaves_others_their_bounds(operation):
    both = lambda z: {"steps": operation(3 * z), "z": z}  # noqa: E731
    scene = state(lambda p, z: -p.k * z, [0.0, 1.0], 2.0, both, k=(0.9, 1.1))
    bounds = warned(r"are infinite for steps, because \w+ has no remainder\.", mb.propagate, scene, mb.TaylorModel())
    assert np.isinf(bounds.upper[:, 0]).all()
    np.testing.assert_allclose([bounds.lower[1, 1], bounds.upper[1, 1]], 2 * np.exp([-1.1, -0.9]), rtol=1e-6)


@pytest.mark.parametrize(
    ("begin", "law"),
    [
        (0.0, lambda p, t: ca.if_else(ca.logic_and(t > 0.5, t < 0.52), 5.0, 0.0)),
        (0.0, lambda p, t: ca.if_else(ca.logic_and(t > 0.5, t < 0.5003), 500.0, 0.0)),
        (-3.0, lambda p, t: ca.fmax(t + 2.3, 0.0)),
        (0.0, lambda p, t: p.k * ca.sign(ca.sin(29.0 * t + 1.0)) * ca.fabs(t - 0.31)),
        (0.0, lambda p, t: ca.if_else(t > p.s, p.k, 0.0)),
        (0.0, lambda p, t: ca.if_else(ca.logic_and(t > 0.3, t > p.s), p.k, 0.0)),
        (1.0, lambda p, t: ca.fabs(ca.sin(2.0 * (t - 0.4)))),
        (0.0, lambda p, t: ca.if_else(t > 7.0, 5.0, 0.0)),
        (0.0, lambda p, t: ca.if_else(t >= 1.0, 5.0, 0.0)),
    ],
)
def test_laws_of_time_that_switch(begin, law):
    """Without the law, z = 2 exp(-k t)."""
    times = np.linspace(begin, begin + 1.0, 21)
    scene = state(lambda p, z: -p.k * z + law(p, mb.t), times, 2.0, k=(0.9, 1.1), s=(0.58, 0.62))
    if not ca.depends_on(law(scene.system.parameters, mb.t), scene.system.parameters.s):
        scene = scene.with_box(mb.Box(k=(0.9, 1.1)))
    with warnings.catch_warnings(record=True, action="always") as told:
        bounds = mb.propagate(scene, mb.TaylorModel(order=6, boxes=4))
    assert not told
    require_sharp(bounds, scanned(scene, 5), 1e-10, 1e-4, size=1.0)


@pytest.mark.parametrize("seed", [3, 4, 9])
def test_random_scenes_against_runs(seed):
    """Open chains with free bodies, pulses, and an output without a remainder: a draw of tests/benchmarks."""
    found = random_proofs.check(random_proofs.random_case(seed), order=3, samples=40)
    assert found.outside <= random_proofs.INSIDE and not found.fault and found.proved > 0.5


@pytest.mark.parametrize(
    ("height", "offset", "length", "element", "met"),
    [
        (1.0, 0.0, 0.3, mb.SpringDamper, True), (0.7, 0.0, 0.2, mb.SpringDamper, True),
        (0.7, 0.0, 0.2, mb.NonlinearSpring, True), (1.0, 0.05, 0.3, mb.SpringDamper, False),
        (0.7, 0.03, 0.2, mb.NonlinearSpring, False), (1.0, 0.0, 0.0, mb.SpringDamper, False),
        (-1.0, 0.0, 0.5, mb.SpringDamper, False),
    ],
)  # fmt: skip
def test_a_spring_whose_points_meet_is_named_before_the_proof(height, offset, length, element, met):
    """A body falls on the point that holds its spring, or past it. Without free length the force stays smooth."""
    linear = lambda m: mb.SpringDamper("cord", ORIGIN, m.at, m.p.k, length=length)  # noqa: E731
    other = lambda m: mb.NonlinearSpring("cord", ORIGIN, m.at, lambda d, v: m.p.k * (d - length))  # noqa: E731
    machine = ball(linear if element is mb.SpringDamper else other, k=5.0, h=height)
    start, box = {"ball.x": offset, "ball.y": machine.p.h}, mb.Box.around({"k": 5.0, "h": height}, 0.02)
    scene = machine.scene("y", np.linspace(0, 1.0, 11), start, box=box)
    told = problem_of(mb.TaylorModel(), mb.prepare(scene), box).meeting
    assert ("'cord' may reach the length 0 at about t = " in told and "Use earlier times" in told) if met else not told
