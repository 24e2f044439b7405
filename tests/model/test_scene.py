"""A scene: what may be listed, what its outputs may be, which faults are told."""

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from faults import refused
from machines import ball
from numpy.testing import assert_allclose

import symmb as mb

P = mb.Parameters(l=1.0, a=0.3)
ROD = mb.Body("rod", P.l, P.l**3 / 12, mb.Planar())
TOP = mb.Body("top", 1.0, (1, 1, 1), mb.Spatial())
BALL = mb.Body("ball", 1.0, pose=mb.Particle())
HINGE = mb.Revolute("hinge", mb.Ground().point(0, 0), ROD.point(0, P.l / 2))
SYSTEM = mb.System(ROD, TOP, BALL, HINGE, mb.Force("up", BALL.point(0, 0), (0, 0, BALL.z)), parameters=P)
OTHER, ELSEWHERE = mb.Body("other", 1.0, 1.0), mb.System(ROD, HINGE, parameters=P)


def scene(**more):
    return mb.Scene(SYSTEM, **more)


FAULTS = [
    ({"times": []}, r"times: expected a list of times in s, such as numpy"),
    ({"times": 1.0}, r"times: expected a list of times in s, .* got 1.0"),
    ({"times": [0.0, 1.0, 0.5]}, "times: each time must be larger"),
    ({"times": [0.0, 1.0, 1.0]}, "times: each time must be larger"),
    ({"times": [0.0, np.nan]}, "times: some times are NaN"),
    ({"times": [0.0, 5e-324]}, r"times: from 0 to 4\.94066e-324 s, but a run must last 1e-60 to"),
    ({"times": [0.0, 1e-300]}, "times: from 0 to 1e-300 s, but a run must"),
    ({"times": [-1e308, 0.0, 1e308]}, r"times: from -1e\+308 to 1e\+308 s, but a run must"),
    ({"times": [1e15, 1e15 + 1]}, "near 1e.15 are 0.1 apart, which is too coarse for a run of 1 s. Start the times"),
    ({"times": [3e9, 3e9 + 1e-3]}, "near 3e.09 are 5e-07 apart, which is too coarse for a run of 0.00"),
    ({"start": {"rod.teta": 1.0}}, r"start: no coordinate or velocity 'rod\.teta'\. Did you mean 'rod\.theta'"),
    ({"start": {"rid.theta": 1.0}}, "start: no coordinate or velocity 'rid.theta'"),
    ({"start": {"top.e0": 1.0}}, r"start: no coordinate or velocity 'top\.e0'"),
    ({"start": {"top.theta": 1.0}}, r"no coordinate or velocity 'top\.theta'"),
    ({"start": {"top.rotation": 0.3}}, r"start 'top\.rotation': expected rotation\(axis=\.\.\., angle"),
    ({"start": {"top.omega": 3.0}}, r"start 'top\.omega': expected three numbers or expressions, got 3\.0"),
    ({"start": {"top.omega": (1, 2)}}, r"start 'top\.omega': expected three numbers"),
    ({"start": {"rod.x": ROD.y}}, r"start 'rod\.x': the value may depend on parameters only"),
    ({"start": {"rod.x": mb.t}}, r"start 'rod\.x': the value may depend on parameters only"),
    ({"start": {"rod.x": np.nan}}, r"start 'rod\.x': contains NaN"),
    ({"start": {"rod.x": mb.Parameters(b=1.0).b}}, r"start 'rod\.x': symbol 'b' does not belong to a parameter"),
    ({"guess": {"rod.vx": 1.0}}, "guess: velocities need no guess, .* List them in start"),
    ({"guess": {"ball.x": 1.0}}, r"guess: no element acts on 'ball\.x'\. List the value in start"),
    ({"guess": {"rod.xx": 1.0}}, r"guess: no coordinate or velocity 'rod\.xx'\. Did you mean"),
    ({"outputs": {"r": ca.vertcat(ROD.x, ROD.y)}}, "output 'r' has 2 components. Give each component its own"),
    ({"outputs": {"x": OTHER.x}}, "output 'x': symbol 'other.x' does not belong to a parameter or a body"),
    ({"outputs": {"x": "rod.x"}}, "output 'x': 'rod.x' is not a number"),
    ({"outputs": {"f": ELSEWHERE.reaction("hinge").fx}}, r"'f': 'hinge\.lam\[0\]' is a reaction.* of the same System"),
    ({"box": mb.Box(ll=(0, 1))}, "box: no parameter 'll'. Did you mean 'l'"),
]


@pytest.mark.parametrize(("more", "text"), FAULTS)
def test_a_fault_of_a_scene_is_told(more, text):
    refused(text, scene, **more)


def test_all_faults_of_a_scene_are_told_at_once():
    start, box = {"rod.teta": 1.0, "top.omega": 1.0}, mb.Box(ll=(0, 1))
    text = refused(None, scene, times=[0.0, 1.0], start=start, guess={"rod.vx": 1.0}, outputs={"x": "x"}, box=box)
    for part in ("'rod.teta'", "'top.omega'", "guess: velocities", "output 'x'", "box: no parameter"):
        assert part in text


def test_outputs_default_to_all_coordinates_and_velocities():
    dae = mb.compile_dae(SYSTEM)
    assert scene().output_names == (*dae.q_names, *dae.v_names)


def test_outputs_may_be_any_expression():
    theta, l = sp.symbols("rod.theta l")  # noqa: E741
    t = np.array([0.0, 0.5])
    sin, cos = np.sin(0.3 + 2 * t), np.cos(0.3 + 2 * t)  # no gravity: the rod spins uniformly about its end
    known = {
        "sympy": (l * sp.sin(theta), sin),
        "casadi": (P.l * ca.sin(ROD.theta), sin),
        "time": (mb.t**2, t**2),
        "number": (3, 3),
        "point": (ROD.point(0, P.l).y, 0.5 * cos),
        "rate": (mb.ddt(ROD.point(0, P.l).y), -sin),
        # The centre of mass is drawn to the hinge with m w^2 l / 2 = 2 N; it lies at (sin, -cos) / 2.
        "force": (SYSTEM.reaction("hinge").fx, -2 * sin),
        "multiplier": (SYSTEM.lam("hinge")[0], 2 * sin),
        "untouched": (BALL.x, 1 + 0.3 * t),
    }
    start = {"rod.theta": P.a, "rod.omega": 2.0, "ball.x": P.l, "ball.vx": P.a}
    outputs = {name: expression for name, (expression, _) in known.items()}
    run = mb.simulate(scene(outputs=outputs, start=start, times=t), mb.CVODES(rtol=1e-11))
    for name, (_, values) in known.items():
        assert_allclose(run[name], values, atol=1e-8, err_msg=name)
    assert_allclose(run["casadi"], run["sympy"], rtol=1e-14)


def test_scenes_are_frozen_and_copied_with():
    first = scene(times=[0.0, 1.0])
    with pytest.raises(AttributeError):
        first.times = [0.0]
    box = mb.Box(l=(0.9, 1.1))
    assert first.with_box(box).box is box and first.box is None
    assert_allclose(first.with_times([2.0, 3.0]).times, [2.0, 3.0])
    assert first.with_outputs({"x": ROD.x}).output_names == ("x",)
    assert first.with_name("other").name == "other"
    assert_allclose(first.times, [0.0, 1.0])


def test_a_trajectory_answers_for_any_name_or_expression():
    run = mb.simulate(scene(start={"rod.theta": 0.3, "rod.omega": 2.0}, times=[0.0, 0.5], outputs={"y": ROD.y}))
    assert_allclose(run["rod.theta"], run(ROD.theta))
    assert_allclose(run["rod.omega"], run.v[:, 2])
    assert_allclose(run["hinge.lam[1]"], run.lam[:, 1])
    assert_allclose(run(ca.vertcat(ROD.x, ROD.y))[:, 1], run["y"])
    assert_allclose(run(sp.Symbol("rod.y")), run["y"])
    refused("symbol 'c' does not belong to a parameter", run, ca.SX.sym("c"))


@pytest.mark.parametrize("times", [[0.0, 1e-16], [0.0, 1e-50], [0.0, 1e50], [1e6, 1e6 + 1], [-1e9, 1e9]], ids=str)
def test_horizons_of_any_usual_size_run(times):
    run = ball(g=1 / np.ptp([*times, 0]) ** 2).run("y", times)
    elapsed = np.array(times) - times[0]
    assert_allclose(run["y"], -0.5 * (elapsed / np.ptp([*times, 0])) ** 2, rtol=1e-6)
