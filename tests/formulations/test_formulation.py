"""Runs in coordinates of joints against those in coordinates of bodies."""

import pickle
from dataclasses import replace

import bricard
import casadi as ca
import machines
import numpy as np
import pytest
from conftest import but_long
from faults import refused
from machines import GROUND, rods
from mechanisms import double_pendulum
from numpy.testing import assert_allclose

import symmb as mb
from models import andrews, bicycle, four_bar, six_axis_arm, spherical_pendulum

TIGHT = mb.DormandPrince(rtol=1e-11)


def both(scene, way=mb.DAESimulator, solver=TIGHT):
    """A simulator or a run in coordinates of bodies, and one in those of joints."""
    return [way(replace(scene, coordinates=coordinates), solver) for coordinates in ("body", "joint")]


def controlled_arm():
    """Two links with a sampled law, a state, a stop and a motor in each joint."""
    p = mb.Parameters(m=1.0)
    elements, outputs, end = [mb.Gravity(0, -9.81)], {}, GROUND.point(0, 0)
    for k in range(2):
        link = mb.Body(f"link{k}", p.m, 0.1)
        joint = mb.Revolute(f"j{k}", end, link.point(-0.5, 0))
        lag = mb.State(f"lag{k}", rate=lambda z, joint=joint: (joint.angle - z) / 0.1)
        held = mb.Sampled(f"held{k}", period=0.013, law=-20 * (lag.value - 0.5) - 3 * joint.angle_rate)
        stop = mb.Stop(f"stop{k}", joint, -1.2, 0.4, mb.KelvinVoigt(500.0, 5.0))
        elements += [link, joint, lag, held, stop, mb.Actuator(f"motor{k}", joint, held.value)]
        outputs |= {f"angle{k}": joint.angle, f"held{k}": held.value, f"lag{k}": lag.value}
        end = link.point(0.5, 0)
    system = mb.System(*elements, parameters=p)
    return mb.Scene(system, {"j0.angle": -0.4, "j1.angle": 0.3}, np.linspace(0, 1, 11), outputs)


def hanging():
    """Two rods that hang in equilibrium against a torsional spring, and then its support moves."""
    law = lambda hinge: -8.0 * (hinge.angle + 0.4) * (1 - 0.1 * mb.t)  # noqa: E731
    springs = lambda m: tuple(mb.Actuator(f"spring{k}", hinge, law(hinge)) for k, hinge in enumerate(m.hinges))  # noqa: E731
    pair = rods(2, springs)
    outputs = {"x": pair.rod1.point(0, -0.5).x}
    return pair.scene(outputs, np.linspace(0, 2, 11), equilibrium=True, name="hanging")


SCENES = {
    "sampled values, states, stops": controlled_arm,
    "equilibrium": hanging,
    "redundant loop": lambda: bricard.scene(np.linspace(0, 1, 5)),
    "loops": lambda: andrews.scene().with_times(np.linspace(0, 0.01, 5)),
}


@pytest.mark.parametrize("name", but_long(SCENES, "redundant loop"))
def test_samples_run_alike_in_both_coordinates(name):
    bodies, joints = both(SCENES[name]())
    assert joints.formulation.dae.n_v < bodies.formulation.dae.n_v
    P = bodies.dae.p_nominal * np.array([[1.0], [1.02]])
    assert_allclose(joints.run(P).Y, expected := bodies.run(P).Y, rtol=0, atol=1e-8 * max(1, np.abs(expected).max()))
    if name != "sampled values, states, stops":  # which switch
        slopes = [s.jets(bodies.dae.p_nominal, np.eye(P.shape[1])[:1], 1)[1] for s in (bodies, joints)]
        assert_allclose(slopes[1], slopes[0], rtol=0, atol=1e-6 * max(1, np.abs(slopes[0]).max()))


@pytest.mark.parametrize("make", [lambda: bricard.scene(np.linspace(0, 1, 5)), double_pendulum])
def test_a_trajectory_looks_the_same_in_both(make):
    body, joint = both(replace(make(), outputs=None), mb.simulate, mb.CVODES(rtol=1e-12))
    assert body.names == joint.names
    assert_allclose(joint.q, body.q, atol=1e-8)
    assert_allclose(joint.values, body.values, atol=1e-7)
    assert joint.position_drift < 1e-8


def test_reactions_and_accelerations_are_outputs_in_both():
    scene = double_pendulum(np.linspace(0, 1, 5))
    reaction, a = scene.system.reaction("shoulder").force, scene.system.vdot
    body, joint = both(scene.with_outputs({"x": reaction[0], "y": reaction[1], "a": a[4]}), mb.simulate)
    assert_allclose(joint.values, body.values, atol=1e-8)


def test_the_cheaper_coordinates_are_chosen_and_told():
    study = mb.DAESimulator(double_pendulum(), mb.DormandPrince())
    assert study.coordinates == "joint"
    assert study.reason.startswith("coordinates of joints, which take fewer operations")
    assert "coordinates of joints, which take fewer" in mb.simulate(double_pendulum()).reason
    assert mb.DAESimulator(spherical_pendulum.scene(), mb.DormandPrince()).coordinates == "body"
    augmented = mb.DormandPrince(stabilization=mb.AugmentedLagrangian())
    assert mb.DAESimulator(four_bar.scene(), augmented).coordinates == "body"


def test_accelerations_of_bodies_are_not_derived_where_their_rows_alone_cost_more(monkeypatch):
    scene = replace(six_axis_arm.scene(), times=np.linspace(0, 0.1, 3))

    def derived(*arguments):
        raise AssertionError("the accelerations of the bodies are derived")

    with monkeypatch.context() as patched:
        patched.setattr("symmb.equations.model.system.saddle_solver", derived)
        simulator = mb.DAESimulator(scene, mb.DormandPrince())
        P = simulator.dae.p_nominal[None]
        Y = simulator.run(P).Y
        assert simulator.coordinates == "joint" and "more than" in simulator.reason
    copy = pickle.loads(pickle.dumps(simulator))  # contains what has not been used
    assert np.array_equal(copy.run(P).Y, Y)
    state = simulator.start.nominal()
    at = (*(state[name] for name in "qv"), *((state["s"],) if simulator.dae.n_s else ()), state["p"], 0.0)
    (_, a, *_), whole = copy.dae.rhs(*at), mb.compile_dae(scene.system)
    assert_allclose(a.full(), whole.rhs(*at)[1].full(), rtol=1e-12, atol=1e-12)


def test_coordinates_that_are_not_possible_are_refused():
    scene = replace(spherical_pendulum.scene(), coordinates="joint")
    refused("not possible: no joint carries a rigid body", mb.DAESimulator, scene, mb.DormandPrince())


def tilted_chain():
    """Bodies on joints of which all axes depend on parameters."""
    p = mb.Parameters(e=0.1, f=-0.2)
    joints = [mb.Revolute, mb.Universal, mb.Prismatic, mb.Cylindrical, mb.Spherical]
    elements, end = [mb.Gravity(0, 0, -9.81)], GROUND.point(0, 0, 0)
    for k, kind in enumerate(joints):
        body = mb.Body(f"b{k}", 1.0, (0.1, 0.2, 0.15), mb.Spatial())
        axes = {"axis": (p.e, 1 + p.f, 0.5 - p.e), "axis_b": (1 - p.f, p.e, 0.2)} if kind is not mb.Spherical else {}
        joint = kind(f"j{k}", end, body.point(-0.3, 0, 0.1), **axes)
        elements += [body, joint, mb.SpringDamper(f"s{k}", body.point(0, 0, 0), GROUND.point(0, 1, 0), 20.0, 0.5, 1.0)]
        end = body.point(0.3, 0.1, 0)
    outputs = {"x": end.x, "y": end.y, "z": end.z, "angle": elements[2].angle, "slide": elements[8].displacement}
    times = np.linspace(0, 0.5, 6)
    return mb.Scene(mb.System(*elements, parameters=p), {"j0.angle_rate": 2.0}, times, outputs, name="tilted chain")


def test_axes_that_depend_on_parameters_move_alike_at_the_corners_of_a_box():
    bodies, joints = both(tilted_chain())
    assert joints.dae.n_v == 30 and joints.formulation.dae.n_v == 9 and joints.formulation.dae.n_c == 0
    P = np.array([[0.1, -0.2], [0.2, -0.1], [0.2, -0.3], [0.0, -0.1], [0.0, -0.3]])
    expected = bodies.run(P)
    assert expected.ok.all()
    assert_allclose(joints.run(P).Y, expected.Y, rtol=0, atol=1e-9 * np.abs(expected.Y).max())


def test_the_steering_of_the_bicycle_carries_the_fork():
    scene = bicycle.scene(speed=5.0).with_times(np.linspace(0, 0.5, 3))
    bodies, joints = both(scene)
    assert joints.formulation.dae.n_v == 9
    assert mb.DAESimulator(scene, TIGHT).coordinates == "joint"
    P = bodies.dae.p_nominal * np.ones((3, 1))
    P[:, bodies.dae.p_names.index("lean_rate")] = 0.1
    P[1:, bodies.dae.p_names.index("tilt")] *= [0.9, 1.1]
    expected = bodies.run(P)
    assert expected.ok.all() and np.ptp(expected.Y[:, -1], axis=0).min() > 1e-6
    assert_allclose(joints.run(P).Y, expected.Y, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("axis", "axis_b", "theta"),
    [
        ((1, 0), (-1, 0), np.pi), ((1, 0), (-1, 0), -np.pi), ((0, 1), (0, -1), 3 * np.pi),
        ((0.6, 0.8), (-0.8, 0.6), 1.5 * np.pi), ((-1, 0), (-1, 0), 2 * np.pi),
    ],
)  # fmt: skip
def test_planar_slides_with_axes_of_their_own_carry_a_body_with_its_turns(axis, axis_b, theta):
    """A law of the angle itself, which is not the same after a turn."""
    slider, rod = mb.Body("slider", 1.0, 0.1), mb.Body("rod", 1.0, 0.1)
    slide = mb.Prismatic("slide", GROUND.point(0, 0), slider.point(0.1, 0.2), axis, axis_b)
    pin = mb.Revolute("pin", slider.point(0.3, 0), rod.point(-0.5, 0))
    system = mb.System(slider, rod, slide, pin, mb.Torque("motor", rod, -2 * slider.theta), mb.Gravity(0, -9.81))
    outputs = {"x": slider.x, "theta": slider.theta, "rod": rod.theta, "slide": slide.displacement}
    scene = mb.Scene(system, {"slider.theta": theta, "pin.angle": 0.4}, np.linspace(0, 1, 6), outputs)
    bodies, joints = both(scene, mb.simulate)
    assert_allclose(joints.values, bodies.values, atol=1e-9)
    assert_allclose(joints["theta"], theta, atol=1e-12)


def test_a_slide_may_be_tilted_through_half_a_turn():
    """The axes are opposite within the box, where the angle between them must not jump."""
    p = mb.Parameters(e=0.0)
    slider = mb.Body("slider", 1.0, 0.1)
    slide = mb.Prismatic("slide", GROUND.point(0, 0), slider.point(0.1, 0.2), (1, p.e), (-1, 0))
    system = mb.System(slider, slide, mb.Gravity(0, -9.81), parameters=p)
    outputs = {"x": slider.x, "theta": slider.theta}
    scene = mb.Scene(system, times=np.linspace(0, 1, 6), outputs=outputs, guess={"slider.theta": 3.0})
    E = np.array([[-0.2], [0.0], [0.2]])
    for simulator in both(scene):
        Y = simulator.run(E).Y
        assert_allclose(Y[..., 1], np.pi + np.arctan(E) + 0 * Y[..., 1], atol=1e-9)
        along = -9.81 * E / np.hypot(1, E) / 2 * scene.times**2  # the slide falls along its axis
        assert_allclose(Y[..., 0] - Y[:, :1, 0], along / np.hypot(1, E), atol=1e-9)


def test_samples_do_not_start_with_frames_flipped():
    """Far from the nominal axes Newton's method in coordinates of the body finds the root with opposite axes."""
    p = mb.Parameters(a=0.1)
    body = mb.Body("body", 1.0, (0.1, 0.2, 0.15), mb.Spatial())
    slide = mb.Prismatic("slide", GROUND.point(0, 0), body.point(-0.3, 0.1, 0), (1, p.a, 0.3), (p.a, 1, 0.2))
    system = mb.System(body, slide, mb.Gravity(0.1, -3, -9.81), parameters=p)
    scene = mb.Scene(system, times=np.linspace(0, 0.5, 4), outputs={"cosine": slide.assembly_cosines()[0]})
    A = np.array([[0.1], [1.0], [-1.0], [3.0]])
    bodies, joints = (simulator.run(A) for simulator in both(scene))
    assert bodies.ok.tolist() == [True, True, False, False] and joints.ok.all()
    assert_allclose(bodies.Y[:2], 1.0, atol=1e-9)
    assert_allclose(joints.Y, 1.0, atol=1e-9)


# Accelerations as outputs, against closed forms.

TIMES = np.linspace(0, 2, 41)


def driven_crank():
    """A crank of length 0.3 at 5 rad/s draws a ram by a rod of length 1."""
    ground, p = mb.Ground(), mb.Parameters(crank=0.3, rod=1.0)
    crank, rod = mb.Body("crank", 1.0, 0.1), mb.Body("rod", 1.0, 0.1)
    ram = mb.Body("ram", 5.0, 1.0)
    system = mb.System(
        crank, rod, ram,
        mb.Revolute("main", ground.point(0, 0), crank.point(0, 0)),
        mb.Revolute("pin", crank.point(p.crank, 0), rod.point(0, 0)),
        mb.Revolute("wrist", rod.point(p.rod, 0), ram.point(0, 0)),
        mb.Prismatic("guide", ground.point(0, 0), ram.point(0, 0), axis=(1, 0, 0)),
        mb.Motion("drive", crank.theta, 5 * mb.t),
        parameters=p,
    )  # fmt: skip
    return system, ram, {"ram.x": 1.3}


@pytest.mark.parametrize("solver", [None, mb.DormandPrince(), mb.Rosenbrock(), mb.IDAS()], ids=repr)
def test_the_ram_of_a_crank_accelerates_as_its_closed_form(solver):
    system, ram, guess = driven_crank()
    outputs = {"a": system.ddt(ram.vx), "twice": system.ddt(mb.ddt(2 * ram.x))}
    run = mb.simulate(mb.Scene(system, {}, TIMES, outputs, guess=guess), solver)
    x = 0.3 * ca.cos(5 * mb.t) + ca.sqrt(1 - (0.3 * ca.sin(5 * mb.t)) ** 2)
    exact = ca.Function("a", [mb.t], [ca.jacobian(ca.jacobian(x, mb.t), mb.t)])
    assert_allclose(run["a"], np.array(exact(TIMES)).ravel(), atol=1e-6)
    assert_allclose(run["twice"], 2 * run["a"], atol=1e-9)
    assert_allclose(run(system.ddt(ram.vx**2)), 2 * run["ram.vx"] * run["a"], atol=1e-9)


def test_bounds_of_accelerations():
    """The largest acceleration of the ram, where the crank points outwards at the start, is w^2 c (1 + c / r)."""
    system, ram, guess = driven_crank()
    scene = mb.Scene(system, {}, TIMES, {"a": system.ddt(ram.vx)}, guess=guess, box=mb.Box(crank=(0.29, 0.31)))
    lower, upper = (-25 * c * (1 + c) for c in (0.31, 0.29))
    for method in (mb.PolynomialChaos(), mb.Taylor(order=2)):
        bounds = mb.propagate(scene, method)
        assert_allclose([bounds.lower[0, 0], bounds.upper[0, 0]], [lower, upper], rtol=1e-3)
    assert mb.DAESimulator(scene, mb.DormandPrince()).units == ("m/s^2",)


def test_free_bodies_and_what_nothing_moves():
    free = machines.ball()
    ball = free.ball
    outputs = {name: free.system.ddt(rate) for name, rate in (("y", ball.vy), ("x", ball.vx), ("xx", ball.x * ball.vx))}
    run = free.run(outputs, TIMES, {"ball.vx": 2.0})
    assert_allclose(run.values, np.full((41, 3), [-9.81, 0, 4.0]))


def test_rates_of_what_is_unknown_or_solved_for_are_errors():
    system, _, _ = driven_crank()
    refused(r"ddt: symbol 'stranger\.vx' does not belong", system.ddt, mb.Body("stranger", 1.0, 0.1).vx)
    refused(r"ddt: 'main\.lam", system.ddt, system.lam("main")[0])
