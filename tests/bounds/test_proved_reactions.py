"""Proved bounds of reactions, accelerations and forces of actuators, against closed forms."""

import pickle

import casadi as ca
import numpy as np
import pytest
from faults import warned

import symmb as mb


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
    p, ground = mb.Parameters(mass=2.0), mb.Ground()
    door = mb.Body("door", p.mass, (0.1, 0.2, 0.3), pose=mb.Spatial())
    places = (("lower", -0.4), ("upper", 0.4))
    hinges = [mb.Revolute(name, ground.point(0, 0, z), door.point(-0.5, 0, z), axis=(0, 0, 1)) for name, z in places]
    system = mb.System(door, *hinges, mb.Gravity(0, 0, -9.81), parameters=p)
    outputs = {name: system.reaction(name).fz for name in ("lower", "upper")}
    start, box = {"lower.angle_rate": 1.0}, mb.Box(mass=(1.9, 2.1))
    scene = mb.Scene(system, start, [0.0, 0.1], outputs, guess={"door.x": 0.5}, box=box)
    told = "'lower', 'upper' depend on how the redundant constraints"
    bounds = warned(told, mb.propagate, scene, mb.TaylorModel(order=4))
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
