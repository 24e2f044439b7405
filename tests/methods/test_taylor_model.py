"""TaylorModel: proved bounds of scenes, what it refuses, and what it says where a proof ends."""

import itertools
import pickle
import warnings

import casadi as ca
import machines
import numpy as np
import pytest
import random_proofs
from black_boxes import errors_of, quietly, reloaded
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
    lower, upper = scanned(scene, 41)
    assert bounds.evaluations == 1 and not bounds.doubts
    own = 1e-11 * np.abs(upper).max(axis=0)  # error of the runs
    assert (bounds.lower <= lower + own).all() and (upper <= bounds.upper + own).all()
    assert (errors_of(bounds, lower, upper) <= 1e-3 * (upper - lower).max(axis=0)).all()


def test_times_that_begin_later():
    early, late = van_der_pol(end=1.0), van_der_pol(end=1.0).with_times(np.linspace(0.0, 1.0, 21) + 7.0)
    first, second = (mb.propagate(scene, mb.TaylorModel(order=4)) for scene in (early, late))
    np.testing.assert_allclose(first.upper, second.upper, rtol=1e-9)


def test_a_lost_proof_is_doubtful_and_infinite(tmp_path):
    scene = particle(lambda p, mass: p.k * mass.x**3, np.linspace(0.0, 3.0, 31), {"mass.x": 1.0}, k=(0.9, 1.1))
    told = r"proved up to t = 1\.\d+ s only and infinite later.*more boxes"
    bounds = warned(told, mb.propagate, scene, mb.TaylorModel(order=4))
    finite = np.isfinite(bounds.upper[:, 0])
    assert finite[:11].all() and not finite[-10:].any() and (np.isinf(bounds.lower) == np.isinf(bounds.upper)).all()
    assert "proved up to" in str(bounds)
    np.testing.assert_array_equal(reloaded(bounds, tmp_path / "bounds.npz").upper, bounds.upper)
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
    monkeypatch.setattr("symmb.bound.methods.taylor_model.time.monotonic", lambda: next(seconds))
    text = r"^TaylorModel\(order=8\): .* % of the time is proved; the rest takes about \d+ minutes"
    with pytest.warns(mb.SymmbWarning, match=text) as told:
        mb.propagate(van_der_pol(), mb.TaylorModel())
    assert len(told) == 1


def test_errors_of_a_solver_are_no_doubt_about_a_proof():
    scene, loose = van_der_pol(end=4.0), mb.DormandPrince(rtol=1e-1)
    assert warned("exceed a thousandth of their range", mb.propagate, scene, mb.Vertex(), solver=loose).doubts
    assert not mb.propagate(scene, mb.TaylorModel(order=4), solver=loose).doubts


def _switched(window):
    return particle(lambda p, mass: ca.if_else(window(mb.t) > 0, p.a, 0), [0.0, 1.0], {}, a=(1, 2))


REDUNDANT = r"constraints depend on other constraints \(.*er\)\. It cannot be proved"
REFUSED = {
    "redundant": (lambda: door_on_two_hinges(offset=(-1e-3, 1e-3)), REDUNDANT),
    "impact": (bouncing_ball.scene, "cannot prove bounds for scenes with impacts"),
    "floor": (lambda: formulas(lambda p: {"f": ca.floor(p.x)}, x=(0.0, 1.0)), "does not support floor"),
    "switch by fmod": (lambda: _switched(lambda t: ca.fmod(t, 0.5) - 0.1), "does not support floor"),
    "switch by remainder": (lambda: _switched(lambda t: ca.remainder(t, 0.3)), "does not support floor"),
    "more parameters than polynomials have room for": (
        lambda: formulas(lambda p: {"f": p.a * p.b * p.c * p.d * p.e * p.f}, **dict.fromkeys("abcdef", (0.99, 1.01))),
        "of 6 parameters have 4826809 terms.* Use order=5, fewer",
    ),
    "switch by floor": (lambda: _switched(lambda t: t - ca.floor(t) - 0.5), "does not support floor"),
}


@pytest.mark.parametrize(("scene", "message"), REFUSED.values(), ids=REFUSED)
def test_what_is_refused(scene, message):
    refused(message, mb.propagate, scene(), mb.TaylorModel(), error=mb.PropagationError)


def door_on_two_hinges(**box):
    p = mb.Parameters(mass=2.0, offset=0.0)
    door, ground = mb.Body("door", p.mass, (0.1, 0.2, 0.3), pose=mb.Spatial()), mb.Ground()
    places = (("lower", 0, -0.4), ("upper", p.offset, 0.4))
    hinges = [mb.Revolute(name, ground.point(x, 0, z), door.point(-0.5, 0, z), axis=(0, 0, 1)) for name, x, z in places]
    push = mb.Force("push", door.point(0.5, 0, 0), (0, 1, 0)), mb.Gravity(0, 0, -9.81)
    system = mb.System(door, *hinges, *push, parameters=p)
    start = {"lower.angle_rate": 1.0}
    return mb.Scene(system, start, [0.0, 0.1], {"x": door.x}, guess={"door.x": 0.5}, box=mb.Box(**box))


def test_rows_that_vanish_are_left_out():
    """With one hinge more, or without it."""
    scene = door_on_two_hinges(mass=(1.9, 2.1))
    bounds = mb.propagate(scene, mb.TaylorModel())
    np.testing.assert_allclose([bounds.lower, bounds.upper], scanned(scene), atol=1e-10)


def _four_bar(start, box, times=(0.0, 0.1, 0.2), coordinates=None, lengths=(0.3, 0.9, 0.7, 0.8)):
    """A crank of length a, a coupler, and a rocker, on the branch above the ground."""
    machine = machines.linkage(lengths=lengths, inertia=0.04, g=9.81, tilt=0.8, spin=1.0)
    guess = {"coupler.theta": 0.5, "rocker.theta": 1.5, "crank.theta": 0.8}
    outputs = {"rocker": machine.rocker.theta, "speed": machine.rocker.omega}
    return machine.scene(outputs, times, start(machine.p), guess=guess, box=box, coordinates=coordinates)


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


def test_a_rate_at_the_start_may_follow_a_parameter():
    """The start divides by pivots that nearly cancel; bounds against runs."""
    machine = machines.rods(1)
    start = {"hinge0.angle": 1.0, "hinge0.angle_rate": -machine.p.length}
    outputs = {"angle": machine.hinge0.angle, "rate": machine.hinge0.angle_rate}
    scene = machine.scene(outputs, np.linspace(0, 0.5, 3), start, box=mb.Box(length=(0.9, 1.1)))
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
    machine, guess = machines.pendulum(length=0.5, y=0.47), {"rod.theta": 0.5}
    return machine.scene("x", times, {"rod.y": machine.p.y}, guess=guess, box=mb.Box(y=(0.45, upper)))


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


# Reactions, accelerations and forces of actuators, against closed forms


def _tension(**kw):
    """A mass on an arm without mass, released at rest: its closed form is m g (3 cos(angle) - 2 cos(start))."""
    p = mb.Parameters(m=2.0, l=0.8)
    ball = mb.Body("ball", p.m, 0.0)
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), ball.point(0, p.l))
    system = mb.System(ball, hinge, mb.Gravity(0, -9.81), parameters=p)
    pull, angle = system.reaction("hinge"), ball.theta
    tension = pull.fy * ca.cos(angle) - pull.fx * ca.sin(angle)
    exact = p.m * 9.81 * (3 * ca.cos(angle) - 2 * np.cos(1.0))
    fall = system.ddt(ball.omega) + 9.81 / p.l * ca.sin(angle)
    outputs = {"tension": tension, "off": tension - exact, "fall": fall}
    box = mb.Box(m=(1.9, 2.1), l=(0.78, 0.82))
    return mb.Scene(system, {"ball.theta": 1.0}, np.linspace(0.0, 1.0, 11), outputs, box=box, **kw)


@pytest.mark.parametrize("coordinates", ["joint", "body"])
def test_the_reaction_of_a_pendulum(coordinates):
    """m g cos(angle) + m l rate^2, with the rate from the energy."""
    scene = _tension(coordinates=coordinates)
    bounds = mb.propagate(scene, mb.TaylorModel(order=6))
    alone = scene.with_outputs({"tension": scene.outputs["tension"]})
    runs = mb.propagate(alone, mb.Scanning(21), solver=mb.DormandPrince(rtol=1e-12))
    assert not bounds.doubts
    np.testing.assert_allclose(bounds["tension"], runs["tension"], atol=1e-4)
    for name in ("off", "fall"):
        lower, upper = bounds[name]
        assert (lower <= 0).all() and (upper >= 0).all() and (upper - lower < 1e-4).all()


def test_a_copy_of_a_simulator_proves_the_same():
    """A pickle has no scene."""
    scene = _tension().with_times([0.0, 0.1])
    simulator = mb.DAESimulator(scene)
    both = (simulator, pickle.loads(pickle.dumps(simulator)))
    bounds, copied = (mb.propagate(each, mb.TaylorModel(order=4), box=scene.box) for each in both)
    np.testing.assert_allclose([copied.lower, copied.upper], [bounds.lower, bounds.upper], atol=1e-6)


def test_the_torque_of_a_driven_crank():
    """By virtual power: torque times rate = sum of the powers of inertia and weight. A guide without friction."""
    p = mb.Parameters(crank=0.3, mass=1.0)
    ground = mb.Ground()
    crank, rod, slider = mb.Body("crank", 1.0, 0.01), mb.Body("rod", p.mass, 0.06), mb.Body("slider", 2.0, 0.01)
    main = mb.Revolute("main", ground.point(0, 0), crank.point(-p.crank / 2, 0))
    elements = (
        main,
        mb.Revolute("pin", crank.point(p.crank / 2, 0), rod.point(-0.45, 0)),
        mb.Revolute("wrist", rod.point(0.45, 0), slider.point(0, 0)),
        mb.Prismatic("guide", ground.point(0, 0), slider.point(0, 0), axis=(1, 0, 0)),
        mb.Motion("drive", main.angle, 0.5 + 3.0 * mb.t),
    )
    system = mb.System(crank, rod, slider, *elements, mb.Gravity(0, -9.81), parameters=p)
    power = sum(
        m * (system.ddt(b.vx) * b.vx + (system.ddt(b.vy) + 9.81) * b.vy) + inertia * system.ddt(b.omega) * b.omega
        for b, m, inertia in ((crank, 1.0, 0.01), (rod, p.mass, 0.06), (slider, 2.0, 0.01))
    )
    torque, guide = -system.lam("drive")[0], system.reaction("guide")
    outputs = {"torque": torque, "off": torque * 3.0 - power, "side": guide.fy, "along": guide.fx}
    guess = {"crank.theta": 0.5, "rod.theta": -0.2, "slider.x": 1.1}
    times, box = np.linspace(0.0, 0.5, 6), mb.Box(crank=(0.29, 0.31), mass=(0.9, 1.1))
    scene = mb.Scene(system, {}, times, outputs, guess=guess, box=box)
    bounds = mb.propagate(scene, mb.TaylorModel(order=5))
    runs = mb.propagate(scene, mb.Scanning(17), solver=mb.DormandPrince(rtol=1e-12))
    assert not bounds.doubts  # the guide has no force along it, and bounds that are 0 are not wide
    np.testing.assert_allclose(bounds["torque"], runs["torque"], atol=1e-5)
    np.testing.assert_allclose(bounds["side"], runs["side"], atol=1e-5)
    lower, upper = bounds["off"]
    assert (lower <= 0).all() and (upper >= 0).all() and (upper - lower < 1e-6).all()


@pytest.mark.parametrize(("coordinates", "more"), [("joint", {"k": (45.0, 55.0)}), ("body", {})])
def test_the_reaction_of_a_controlled_hinge(coordinates, more):
    """A body that follows its controller exactly, beyond half a turn: m r w^2 towards the axis, and the weight."""
    p = mb.Parameters(k=50.0, m=2.0)
    body = mb.Body("body", p.m, (0.1, 0.2, 0.3), pose=mb.Spatial())
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0, 0), body.point(-0.5, 0, 0), axis=(0, 0, 1))
    law = p.k * (3.1 + 8.0 * mb.t - hinge.angle)
    system = mb.System(body, hinge, mb.Actuator("motor", hinge, law), mb.Gravity(0, 0, -9.81), parameters=p)
    pull, times = system.reaction("hinge"), np.linspace(0.0, 0.05, 2)
    outputs = {"x": pull.fx, "y": pull.fy, "z": pull.fz, "law": law, "rate": system.ddt(hinge.angle_rate)}
    box, start = mb.Box(m=(1.9, 2.1), **more), {"hinge.angle": 3.1, "hinge.angle_rate": 8.0}
    scene = mb.Scene(system, start, times, outputs, box=box, coordinates=coordinates)
    bounds = mb.propagate(scene, mb.TaylorModel(order=3))
    angle, m = 3.1 + 8 * times, np.array([[1.9], [2.1]])
    for name, pull in {"x": -32.0 * np.cos(angle), "y": -32.0 * np.sin(angle), "z": 9.81 + 0 * times}.items():
        np.testing.assert_allclose(bounds[name], np.sort(m * pull, axis=0), atol=1e-5)
    np.testing.assert_allclose([*bounds["law"], *bounds["rate"]], 0.0, atol=1e-5)


def test_multipliers_that_are_not_determined_are_those_of_least_norm():
    """Two hinges share the weight of a door."""
    scene = door_on_two_hinges(mass=(1.9, 2.1))
    outputs = {name: scene.system.reaction(name).fz for name in ("lower", "upper")}
    told = "'lower', 'upper' depend on how the redundant constraints"
    bounds = warned(told, mb.propagate, scene.with_outputs(outputs), mb.TaylorModel(order=4))
    weight = np.array([[1.9], [2.1]]) * 9.81 / 2
    for name in outputs:
        np.testing.assert_allclose(bounds[name], weight + np.zeros(2), atol=1e-6)


def test_a_body_at_rest():
    """A welded beam has no motion: its reactions are formulas of the parameters."""
    p = mb.Parameters(m=2.0, l=1.5)
    beam = mb.Body("beam", p.m, 0.1)
    weld = mb.Weld("weld", mb.Ground().point(0, 0), beam.point(-p.l, 0))
    system = mb.System(beam, weld, mb.Gravity(0, -9.81), parameters=p)
    hold = system.reaction("weld")
    outputs, box = {"force": hold.fy, "moment": hold.tz}, mb.Box(m=(1.9, 2.1), l=(1.4, 1.6))
    bounds = mb.propagate(mb.Scene(system, {}, [0.0, 1.0], outputs, box=box), mb.TaylorModel())
    np.testing.assert_allclose(bounds.lower[-1], [1.9 * 9.81, 1.9 * 9.81 * 1.4], rtol=1e-9)
    np.testing.assert_allclose(bounds.upper[-1], [2.1 * 9.81, 2.1 * 9.81 * 1.6], rtol=1e-9)
