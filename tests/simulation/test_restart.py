"""Scenes that go on from the end of a run."""

import pickle
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from faults import refused
from small_scenes import particle

import symmb as mb
from models import bouncing_ball, double_pendulum, flexible_pendulum, four_bar, heavy_top, rolling_disc, stick_slip

TIGHT = mb.DormandPrince(rtol=1e-11, atol=1e-13)
GROUND = mb.Ground()


def split(scene, solver=TIGHT, k=None, parameters=None):
    """Outputs (n, n_y) of an uninterrupted run from the output time k on, and of a run that starts again there."""
    times, k = scene.times, len(scene.times) // 2 if k is None else k
    whole = mb.simulate(scene, solver, parameters)
    first = mb.simulate(scene, solver, parameters, times=times[: k + 1])
    return whole.values[k:], mb.simulate(scene.starting_at(first).with_times(times[k:]), solver).values


def assert_goes_on(scene, rtol, **options):
    whole, again = split(scene, **options)
    assert (np.abs(again - whole) <= rtol * np.abs(whole).max(axis=0) + 1e-14).all()


@pytest.mark.parametrize("coordinates", ["joint", "body"])
@pytest.mark.parametrize("model", [double_pendulum, four_bar, heavy_top])
def test_trees_and_loops_go_on_in_both_coordinates(model, coordinates):
    scene = model.scene()
    scene = replace(scene, coordinates=coordinates, times=scene.times[: len(scene.times) // 2])
    assert_goes_on(scene, 1e-9)


@pytest.mark.parametrize(
    ("model", "solver"),
    [(flexible_pendulum, TIGHT), (rolling_disc, TIGHT), (stick_slip, TIGHT), (bouncing_ball, mb.EventDriven())],
)
def test_modes_rolling_friction_and_impacts_go_on(model, solver):
    assert_goes_on(model.scene(), 1e-8, solver=solver)


@pytest.mark.parametrize("time", [1.0, 1.5, 6.0], ids=["at rest", "in flight", "about to be lifted"])
def test_contacts_stay_closed_or_open(time):
    ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    floor = mb.Impact("floor", ball.y, restitution=0.5)
    lift = mb.Force("lift", ball.point(0, 0, 0), (0, 15 * ca.sin(mb.t) ** 9, 0))
    system = mb.System(ball, mb.Gravity(0, -9.81), floor, lift)
    scene = mb.Scene(system, {"ball.y": 0.5}, np.linspace(0, 8, 81), {"y": ball.y, "vy": ball.vy})
    k = round(10 * time)
    closed = mb.simulate(scene, times=scene.times[: k + 1])(floor.closed)[-1]
    assert closed == (time != 1.5)
    assert_goes_on(scene, 1e-9, solver=mb.EventDriven(), k=k)


def servo(coordinates):
    """An arm and a tool that turns many times, under a filter and two controllers; and a body that nothing turns."""
    p = mb.Parameters(gain=3.0)
    tool = mb.Body("tool", mass=0.5, inertia=(0.1, 0.1, 0.2), pose=mb.Spatial())
    arm = mb.Body("arm", mass=1.0, inertia=(0.1, 0.1, 0.2), pose=mb.Spatial())
    free = mb.Body("free", mass=1.0, pose=mb.Particle())
    shoulder = mb.Revolute("shoulder", GROUND.point(0, 0, 0), arm.point(-0.5, 0, 0), axis=(0, 1, 0))
    wrist = mb.Revolute("wrist", arm.point(0.5, 0, 0), tool.point(0, 0, 0), axis=(1, 0, 0.5))
    filtered = mb.State("filtered", rate=lambda z: (shoulder.angle - z) / 0.3)
    control = mb.Sampled("control", 0.037, lambda held: 0.5 * held - p.gain * filtered.value + ca.sin(5 * mb.t))
    brake = mb.Sampled("brake", 0.05, control.value - wrist.angle_rate)
    motors = mb.Actuator("first", shoulder, control.value), mb.Actuator("second", wrist, 0.3 * brake.value + 1)
    lift = mb.Force("lift", free.point(0, 0, 0), (0, 0, 9.81 - ca.cos(mb.t)))
    own = filtered, control, brake
    system = mb.System(arm, tool, free, shoulder, wrist, *own, *motors, lift, mb.Gravity(0, 0, -9.81), parameters=p)
    start = {"shoulder.angle": 0.2, "wrist.angle_rate": 9.0, "filtered": 0.1, "control": 0.3, "free.vx": 2.0}
    outputs = {part.name: part.value for part in own} | {"turns": wrist.angle, "angle": shoulder.angle}
    outputs |= {"free_x": free.x, "free_z": free.z, "force": system.reaction("wrist").fz}
    return mb.Scene(system, start, np.linspace(1, 3, 41), outputs, coordinates=coordinates)


@pytest.mark.parametrize("coordinates", ["joint", "body"])
@pytest.mark.parametrize("k", [20, 23], ids=["at an instant", "between instants"])
def test_states_turns_held_values_and_laws_of_time_go_on(coordinates, k):
    assert_goes_on(servo(coordinates), 1e-11, k=k, parameters={"gain": 2.5})


def test_a_restart_of_a_restart_goes_on_with_the_same_instants():
    scene, t = servo(None), np.linspace(1, 3, 41)
    whole, run = mb.simulate(scene, TIGHT), mb.simulate(scene, TIGHT, times=t[:14])
    for part in (t[13:28], t[27:]):
        scene = pickle.loads(pickle.dumps(scene.starting_at(run).with_times(part)))
        run = mb.simulate(scene, TIGHT)
    np.testing.assert_allclose(run.values[-1], whole.values[-1], rtol=1e-10, atol=1e-12)


def test_the_times_and_the_parameters_are_those_of_the_end():
    scene = particle(lambda p, mass: -p.k * mass.x + ca.cos(mb.t), np.linspace(0, 2, 21), {}, k=(3.0, 5.0))
    again = scene.starting_at(mb.simulate(scene, TIGHT, {"k": 9.0}))
    assert (again.times[0], again.times[-1], again.system.parameters["k"]) == (2.0, 4.0, 9.0)
    assert scene.system.parameters["k"] == 4.0
    exact = (np.cos(again.times) - np.cos(3 * again.times)) / 8  # of x" = cos t - 9 x, at rest at 0
    np.testing.assert_allclose(mb.simulate(again, TIGHT)["x"], exact, atol=1e-10)


def test_samples_of_a_box_start_on_their_own_constraints():
    scene = four_bar.scene()
    again = scene.starting_at(mb.simulate(scene, times=scene.times[:100]))
    P = np.array([[1.0, 3.0, 2.5, 3.0], [1.01, 2.98, 2.52, 3.02]])
    start = mb.DAESimulator(again, TIGHT).start
    X, reasons = start.states(P)
    assert reasons == ("", "")
    for x, p in zip(X, P, strict=True):
        q, v = np.split(x, 2)
        assert np.abs(start.dae.Phi(q, v, p, start.t0)).max() < 1e-12
        assert np.abs(start.dae.Phi_dot(q, v, p, start.t0)).max() < 1e-12
    assert np.abs(X[1] - X[0]).max() < 0.2


def test_runs_that_cannot_be_gone_on_from_are_refused(tmp_path):
    scene = four_bar.scene().with_times(np.linspace(0, 1, 11))
    run = mb.simulate(scene)
    refused(r"expected a run that simulate\(\) returned, got Scene\.", scene.starting_at, scene)
    refused(r"another system: only one of the systems has 'rod1\.x'", double_pendulum.scene().starting_at, run)
    refused("the run has failed", scene.starting_at, replace(run, x=run.x * np.nan))
    run.save(tmp_path / "run.npz")
    refused(r"Pass the scene: Trajectory\.load", scene.starting_at, mb.Trajectory.load(tmp_path / "run.npz"))
    read = scene.starting_at(mb.Trajectory.load(tmp_path / "run.npz", scene))
    refused(r"the first time must be 1\.0 s", read.with_times, [0.0, 2.0])
    refused("Omit equilibrium", replace, read, equilibrium=True)
    np.testing.assert_array_equal(mb.simulate(read).values, mb.simulate(scene.starting_at(run)).values)


def test_turns_that_a_run_did_not_count_are_refused():
    wheel = mb.Body("wheel", mass=1.0, inertia=(0.1, 0.1, 0.2), pose=mb.Spatial())
    hinge = mb.Revolute("hinge", GROUND.point(0, 0, 0), wheel.point(0, 0, 0), axis=(0, 1, 0))
    scene = mb.Scene(mb.System(wheel, hinge), {"hinge.angle_rate": 5.0}, [0.0, 2.0], {"x": wheel.x})
    counting = scene.with_outputs({"angle": hinge.angle})
    refused(r"the run has no state 'hinge\.angle'", counting.starting_at, mb.simulate(scene))
    run = mb.simulate(scene.starting_at(mb.simulate(counting)))  # the count of turns is not needed any more
    assert run.t[0] == 2.0
