"""Actuators, motors and stops: generalised forces against virtual power, motions against closed forms."""

import pickle

import casadi as ca
import numpy as np
import pytest
import sympy
from faults import refused
from joints import SKEW, bundle, make_body, random_state
from machines import GROUND, cart, pendulum, run_of, wheel
from numpy.testing import assert_allclose
from scipy.linalg import expm

import symmb as mb

TIMES, SECOND = np.linspace(0.0, 2.0, 21), np.linspace(0.0, 1.0, 11)
SPATIAL_AXES = {"axis": SKEW, "axis_b": (0.4, -0.2, 0.6)}
ALL = [
    (mb.Revolute, "angle", {}),
    (mb.Prismatic, "displacement", {}),
    (mb.Cylindrical, "angle", {"coordinate": "angle"}),
    (mb.Cylindrical, "displacement", {"coordinate": "displacement"}),
    (mb.Screw, "angle", {}),
    (mb.Screw, "displacement", {"coordinate": "displacement"}),
]
CASES = [(*case, kinds) for case in ALL for kinds in (("Spatial", "Spatial"), ("Ground", "Spatial"))]
CASES += [(*case, kinds) for case in ALL[:2] for kinds in (("Planar", "Planar"), ("Planar", "Ground"))]


def pair(joint, kinds):
    bodies = [make_body(kind, name) for kind, name in zip(kinds, "ab", strict=True)]
    axes = SPATIAL_AXES if "Spatial" in kinds else {"axis": (0.6, 0.8, 0)} if joint is mb.Prismatic else {}
    more = {"pitch": 0.3} if joint is mb.Screw else {}
    z = (0.2,) if "Spatial" in kinds else ()
    return bodies, joint("joint", bodies[0].point(0.2, -0.1, *z), bodies[1].point(0.3, 0.4, *z), **axes, **more)


@pytest.mark.parametrize(("joint", "handle", "options", "kinds"), CASES)
def test_the_force_of_an_actuator_has_the_power_of_the_handle_s_rate(joint, handle, options, kinds):
    """Q v = law * rate for all velocities, at every state, also away from the constraints."""
    bodies, element = pair(joint, kinds)
    rate = getattr(element, f"{handle}_rate")
    law = 3.0 - 2 * rate + ca.sin(mb.t)
    system, dae = bundle(*bodies, element, mb.Actuator("motor", element, law, **options))
    free, _ = bundle(*bodies, element)
    q, v = random_state(dae, np.random.default_rng(1))
    f = ca.Function("f", [system.q, system.v, mb.t], [system.Q, law * ca.gradient(rate, system.v)])
    without = ca.Function("f", [free.q, free.v], [free.Q])(q, v)
    Q, expected = (np.asarray(x).ravel() for x in f(q, v, 0.4))
    assert_allclose(Q - np.asarray(without).ravel(), expected, atol=1e-13)
    assert np.abs(expected).max() > 0.1


@pytest.mark.parametrize("pose", [mb.Planar(), mb.Spatial()], ids=repr)
def test_a_motor_with_a_linear_law_swings_like_an_oscillator(pose):
    """J a'' = -k a - c a' + 0.5: a step response."""
    J, k, c = 0.5, 8.0, 0.4
    motor = lambda m: mb.Actuator("motor", m.hinge, 0.5 - k * m.hinge.angle - c * m.hinge.angle_rate)  # noqa: E731
    run = pendulum(motor, length=0.0, inertia=J, g=None, pose=pose).run(lambda m: {"a": m.hinge.angle}, TIMES)
    d = c / (2 * J)
    w = np.sqrt(k / J - d**2)
    expected = 0.5 / k * (1 - np.exp(-d * TIMES) * (np.cos(w * TIMES) + d / w * np.sin(w * TIMES)))
    assert_allclose(run["a"], expected, atol=1e-8)
    assert run.energy_drift < 1e-8


def test_a_cylinder_pushes_two_bodies_apart_and_keeps_their_momentum():
    a, b = mb.Body("a", 2.0, (1, 1, 1), mb.Spatial()), mb.Body("b", 3.0, (1, 1, 1), mb.Spatial())
    slide = mb.Prismatic("slide", a.point(0, 0, 0), b.point(0, 0, 0), axis=(1, 1, 0))
    outputs = {"d": slide.displacement, "rate": slide.displacement_rate, "px": 2 * a.vx + 3 * b.vx}
    run = run_of(a, b, slide, mb.Actuator("ram", slide, 6 * mb.t), times=TIMES, outputs=outputs)
    assert_allclose(run["d"], (1 / 2 + 1 / 3) * TIMES**3, atol=1e-9)
    assert_allclose(run["rate"], 3 * (1 / 2 + 1 / 3) * TIMES**2, atol=1e-9)
    assert_allclose(run["px"], 0, atol=1e-10)
    assert run.energy_drift < 1e-8


def test_laws_take_sympy_and_multipliers_are_refused():
    rod = mb.Body("rod", 1.0, 0.5)
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), rod.point(0, 0))
    theta, time = sympy.symbols("rod.theta t")
    system = mb.System(rod, hinge, mb.Actuator("motor", hinge, sympy.cos(time) - theta))
    assert_allclose(np.asarray(ca.Function("Q", [system.q, mb.t], [system.Q[2]])([0, 0, 0.2], 0.0)), 0.8)
    motor = mb.Actuator("motor", hinge, mb.System(rod, hinge).lam("hinge")[0])
    refused(r"Actuator 'motor': law: 'hinge.lam\[0\]' is a reaction", mb.System, rod, hinge, motor)


@pytest.mark.parametrize("slides", [False, True])
@pytest.mark.parametrize("spatial", [False, True])
def test_a_stop_with_a_restitution_sends_the_joint_back_and_forth(slides, spatial):
    """Free motion between -0.5 and 1 at 2, 1, 0.5, ... per second: it starts at 0."""
    pose = mb.Spatial() if spatial else mb.Planar()
    body = mb.Body("body", 1.0, (1, 1, 1) if spatial else 1.0, pose)
    axis = SKEW if spatial else (1, 0, 0) if slides else (0, 0, 1)
    kind = mb.Prismatic if slides else mb.Revolute
    joint = kind("joint", GROUND.point(0, 0), body.point(0, 0), axis=axis)
    stop, start = mb.Stop("limit", joint, -0.5, 1.0, restitution=0.5), {f"joint.{joint.coordinate}_rate": 2.0}
    outputs = {"value": getattr(joint, joint.coordinate)}
    run = run_of(body, joint, stop, start=start, times=np.linspace(0, 4, 41), outputs=outputs)
    times = np.array([0.0, 0.5, 2.0, 5.0])  # 1 at 2/s, then 1.5 at 1/s, then 1.5 at 0.5/s
    assert_allclose(run["value"], np.interp(run.t, times, [0.0, 1.0, -0.5, 1.0]), atol=1e-8)
    assert [event.name for event in run.events] == ["limit.upper", "limit.lower"]
    assert_allclose([event.time for event in run.events], times[1:3], atol=1e-9)


def test_a_stop_beyond_half_a_turn_counts_turns():
    stop = lambda m: mb.Stop("limit", m.hinge, None, 9.0, restitution=1.0)  # noqa: E731
    machine = pendulum(stop, length=0.0, inertia=1.0, g=None, pose=mb.Spatial())
    run = machine.run(lambda m: {"a": m.hinge.angle}, TIMES, {"rod.omega": (0, 0, 6.0)})
    assert_allclose(run["a"], 9.0 - np.abs(9.0 - 6 * TIMES), atol=1e-8)


@pytest.mark.parametrize("coordinates", ["body", "joint"])
def test_a_controller_follows_an_angle_over_many_turns(coordinates):
    """J angle'' = k (w t - angle) from rest: angle = w t - w / r sin(r t), r = sqrt(k / J). Alone and in a study."""
    w, box = 20.0, mb.Box(k=(49.0, 51.0))
    motor = lambda m: mb.Actuator("motor", m.hinge, m.p.k * (w * mb.t - m.hinge.angle))  # noqa: E731
    machine = pendulum(motor, length=0.1, inertia=2.0, g=None, pose=mb.Spatial(), k=50.0)
    outputs = {"a": machine.hinge.angle, "x": machine.rod.x}
    scene = machine.scene(outputs, np.linspace(0, 3, 31), coordinates=coordinates, box=box)
    run, r = mb.simulate(scene, mb.DormandPrince(rtol=1e-11)), np.sqrt(np.array([[49.0], [50.0], [51.0]]) / 2.01)
    angles = w * run.t - w / r * np.sin(r * run.t)
    assert_allclose([run["a"], run["x"]], [angles[1], 0.1 * np.cos(angles[1])], rtol=1e-8, atol=1e-8)
    assert not run.events
    study = mb.propagate(scene, mb.Scanning(3))
    assert_allclose(study["a"], [angles.min(axis=0), angles.max(axis=0)], atol=1e-5)


@pytest.mark.parametrize("slides", [False, True])
def test_a_stop_with_an_elastic_law_holds_for_half_a_period(slides):
    """m = 1 meets k = 400 at 0.5 with speed 2: v / w sin(w t) inside, and the speed back after pi / w."""
    make, joint, handle, rate = (cart, "rail", "displacement", "vx") if slides else (wheel, "shaft", "angle", "omega")
    machine = make(lambda m: mb.Stop("limit", getattr(m, joint), -0.5, 0.5, mb.KelvinVoigt(400.0)))
    start, outputs = {f"{machine.body.name}.{rate}": 2.0}, {"x": getattr(getattr(machine, joint), handle)}
    run = machine.run(outputs, np.linspace(0, 1, 41), start, solver=mb.DormandPrince(rtol=1e-11))
    w, hit = 20.0, 0.25
    out = hit + np.pi / w
    inside = 0.5 + 2 / w * np.sin(w * (run.t - hit))
    expected = np.where(run.t < hit, 2 * run.t, np.where(run.t < out, inside, 0.5 - 2 * (run.t - out)))
    second = out + 0.5  # at the lower end
    lower = -0.5 - 2 / w * np.sin(w * (run.t - second))
    expected = np.where(run.t < second, expected, lower)
    assert_allclose(run["x"], expected, atol=1e-9)
    assert run.energy_drift < 1e-9


def test_limits_may_move_with_time_and_do_work():
    """A wall that moves towards the body at 1 m/s, elastic: the relative speed is reversed, v = -2 - 1 - 1."""
    for options in ({"law": mb.KelvinVoigt(1e4)}, {"restitution": 1.0}):
        machine = cart(lambda m, more=options: mb.Stop("wall", m.rail, None, 1.0 - mb.t, **more))
        run = machine.run("vx", np.linspace(0, 1, 11), {"cart.vx": 2.0})
        assert_allclose(run["vx"][-1], -4.0, atol=1e-6)
        assert run.energy_drift < 1e-6


ROD = mb.Body("rod", 1.0, (1, 1, 1), mb.Spatial())
PIN, SPARE = (mb.Revolute(name, GROUND.point(0, 0), ROD.point(0, 0)) for name in ("pin", "spare"))
TUBE = mb.Cylindrical("tube", GROUND.point(0, 0), ROD.point(0, 0))
BALL = mb.Spherical("ball", GROUND.point(0, 0), ROD.point(0, 0))
SLIDING = {"coordinate": "displacement"}
LAW = mb.KelvinVoigt(1e3)
FAULTS = [
    (lambda: mb.Actuator("m", "pin", 1.0), "Actuator 'm': expected a joint, got .pin.. Pass a joint, such as Revolute"),
    (lambda: mb.Actuator("m", BALL, 1.0), r"Spherical 'ball' has no angle and no displacement. .*three Revolute"),
    (lambda: mb.Actuator("m", TUBE, 1.0), r"'tube' turns and also slides. Pass coordinate='angle' or 'displacement'"),
    (lambda: mb.Actuator("m", PIN, 1.0, **SLIDING), r"no coordinate 'displacement'. Use coordinate='angle'"),
    (lambda: mb.Actuator("m", PIN, "fast"), r"Actuator 'm': law: 'fast' is not a number"),
    (lambda: mb.Actuator("m", PIN, (1, 2)), r"Actuator 'm': law"),
    (lambda: mb.Actuator("m", SPARE, 1.0), r"Actuator 'm': Revolute 'spare' is not part of the System. Add it"),
    (lambda: mb.Motor("m", PIN, 12.0, 0.0, 0.5), "Motor 'm': resistance is 0; it must be above 0"),
    (lambda: mb.Motor("m", PIN, 12.0, 2.0, 0.5, -1.0), "Motor 'm': inductance is -1; it must be at least 0"),
    (lambda: mb.Motor("m", PIN, 12.0, 2.0, 0.5, friction=-1.0), "Motor 'm': friction is -1; it must be at least 0"),
    (lambda: mb.Motor("m", PIN, ca.SX.sym("u"), 2.0, 0.5), "Motor 'm': voltage: symbol 'u' does not belong to a param"),
    (lambda: mb.Stop("s", PIN, None, None, LAW), r"Stop 's': lower and upper are both None. Pass lower, upper or both"),
    (lambda: mb.Stop("s", PIN, law=LAW), r"Stop 's': lower and upper are both None. Pass lower, upper or both"),
    (lambda: mb.Stop("s", PIN, 1.0, -1.0, LAW), r"lower 1.0 must be below upper -1.0"),
    (lambda: mb.Stop("s", PIN, -1.0, 1.0), r"pass either a contact law, or restitution="),
    (lambda: mb.Stop("s", PIN, -1.0, 1.0, LAW, restitution=0.5), r"pass either a contact law, or restitution="),
    (lambda: mb.Stop("s", PIN, -1.0, 1.0, 0.5), r"expected a contact law, got 0.5. Use HuntCrossley"),
    (lambda: mb.Stop("s", PIN, -1.0, 1.0, restitution=1.5), r"restitution 1.5 is not between 0 and 1"),
    (lambda: mb.Stop("s", PIN, -1.0, PIN.angle_rate, restitution=0.5), r"the gap must not contain velocities"),
    (lambda: mb.Stop("s", PIN, "low", 1.0, LAW), r"Stop 's': lower: 'low' is not a number"),
    (lambda: mb.Stop("s", PIN, "low", 1.0, restitution=0.5), r"Stop 's': lower: 'low' is not a number"),
]


@pytest.mark.parametrize(("make", "text"), FAULTS)
def test_faults_name_the_element_and_the_remedy(make, text):
    refused(text, lambda: mb.System(ROD, PIN, TUBE, BALL, make()))


def test_pickles_run_alike():
    motor = lambda m: mb.Actuator("motor", m.shaft, 1.0 - mb.t)  # noqa: E731
    stop = lambda m: mb.Stop("limit", m.shaft, None, 0.4, restitution=0.3)  # noqa: E731
    scene = wheel(motor, stop).scene(lambda m: {"a": m.shaft.angle, "w": m.shaft.angle_rate}, TIMES)
    assert np.array_equal(mb.simulate(pickle.loads(pickle.dumps(scene))).values, mb.simulate(scene).values)


# Motors: a wheel and a current are a linear system.


def driven(*more, voltage=12.0, R=2.0, k=0.5, L=0.0, start=None, **options):
    """A wheel of 0.1 kg m^2 on a motor."""
    machine = wheel(lambda m: mb.Motor("motor", m.shaft, voltage, R, k, L, **options), *more, inertia=0.1)
    outputs = {name: getattr(machine.motor, name) for name in ("current", "power", "torque")}
    start = {"wheel.omega": 3.0} if start is None else start
    return machine.scene({"w": machine.shaft.angle_rate, **outputs}, SECOND, start)


def test_a_wheel_and_a_current():
    start = {"wheel.omega": 3.0, "motor.current": 1.0}
    scene = driven(L=0.3, gear=3.0, friction=0.02, emf_constant=0.45, start=start)
    run = mb.simulate(scene, mb.DormandPrince())
    A = np.array([[-0.02 * 9 / 0.1, 3 * 0.5 / 0.1], [-0.45 * 3 / 0.3, -2.0 / 0.3]])
    rest = -np.linalg.solve(A, [0.0, 12.0 / 0.3])
    expected = np.array([rest + expm(A * t) @ ([3.0, 1.0] - rest) for t in SECOND])
    assert_allclose(np.column_stack([run["w"], run["current"]]), expected, atol=1e-8)
    assert_allclose(run["power"], 12 * expected[:, 1], atol=1e-6)
    assert_allclose(run["torque"], 3 * (0.5 * expected[:, 1] - 0.02 * 3 * expected[:, 0]), atol=1e-6)
    assert run.energy_drift < 1e-8


def test_without_inductance_the_current_follows_at_once():
    run = mb.simulate(driven(gear=2.0), mb.DormandPrince())
    rate = (2 * 0.5) ** 2 / 2 / 0.1
    w = 12.0 + (3.0 - 12.0) * np.exp(-rate * SECOND)  # idle speed V / (n k)
    assert_allclose(run["w"], w, atol=1e-8)
    assert_allclose(run["current"], (12 - w) / 2, atol=1e-8)
    assert "motor.current" not in run.state_names[2]


def test_a_linear_motor():
    machine = cart(lambda m: mb.Motor("motor", m.rail, 10.0, 5.0, 4.0), mass=2.0)
    run = machine.run("vx", SECOND, solver=mb.DormandPrince())
    assert_allclose(run["vx"], 2.5 * (1 - np.exp(-16 / 5 / 2 * SECOND)), atol=1e-8)


def test_a_brake_stalls_a_motor():
    """The stalled current is V / R. The brake of 6 N m holds its torque until it is weaker than 3 N m, at 0.5 s."""
    run = mb.simulate(driven(lambda m: mb.Clutch("brake", GROUND, m.wheel, 6.0 - 6 * mb.t), start={}))
    assert_allclose([event.time for event in run.events], 0.5, atol=1e-12)
    assert_allclose(run["current"][run.t <= 0.5], 6.0, atol=1e-12)
    # 0.1 w' = 3 - k^2 w / R - 6 (1 - t): w' = -1.25 w + 60 (t - 0.5)
    u = np.maximum(run.t - 0.5, 0)
    assert_allclose(run["w"], 60 / 1.25 * (u - (1 - np.exp(-1.25 * u)) / 1.25), atol=1e-9)


def test_its_torque_is_a_force_and_its_voltage_the_input():
    scene = driven()
    run = mb.simulate(scene)
    assert_allclose(run(scene.system.force("motor")), run["torque"], rtol=0, atol=0)
    refused(r"the input of Motor 'motor' is its voltage\. .*u\.value", mb.linearize, scene, inputs=["motor"])
