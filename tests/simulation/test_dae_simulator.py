"""The simulator of a scene: the same bits under every executor, what is prepared once, wrong calls, runs that go on."""

import gc
import importlib
import pickle
import weakref
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from multiprocessing import get_context

import casadi as ca
import machines
import numpy as np
import pytest
from conftest import ALL_SOLVERS
from faults import refused, warned
from machines import GROUND, rods
from mechanisms import double_pendulum, explosion, spinning_body
from numpy.testing import assert_allclose, assert_array_equal
from small_scenes import particle

import symmb as mb
from models import bouncing_ball, flexible_pendulum, four_bar, heavy_top, rolling_disc, stick_slip
from models import double_pendulum as paper
from symmb.connect.simulator import Jets, March, run_blocks
from symmb.run.formulations import Program, formulation

TIMES = np.linspace(0.0, 0.5, 6)
RNG = np.random.default_rng(11)
SAMPLES = np.array([1.0, 0.8]) * (1 + 0.1 * RNG.uniform(-1, 1, (300, 2)))


@cache
def pendulum():
    """It remembers its equations, which the tests share."""
    return double_pendulum(TIMES)


@cache
def spinning():
    return spinning_body(TIMES)


def test_results_are_the_same_bits_under_every_executor():
    simulator = mb.DAESimulator(pendulum())
    serial = run_blocks(simulator, SAMPLES)
    assert serial.ok.all() and serial.Y.shape == (300, 6, 4)
    with ThreadPoolExecutor(2) as threads:
        assert_array_equal(run_blocks(simulator, SAMPLES, threads).Y, serial.Y)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        assert_array_equal(run_blocks(simulator, SAMPLES, processes).Y, serial.Y)


def test_extremes_are_the_same_bits_under_every_executor():
    simulator = mb.DAESimulator(pendulum())
    box, method = mb.Box.around(simulator.parameters, 0.05), mb.MonteCarlo(9000)
    simulator.threads = 1
    serial = mb.propagate(simulator, method, box)
    simulator.threads = 3
    with ThreadPoolExecutor(2) as threads, ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        for executor in (None, threads, processes):
            bounds = mb.propagate(simulator, method, box, executor=executor)
            assert bounds.lower.tobytes() == serial.lower.tobytes()
            assert bounds.upper.tobytes() == serial.upper.tobytes()


def test_failed_samples_are_the_same_under_every_executor():
    simulator = mb.DAESimulator(explosion(np.linspace(0, 1, 5)))
    samples = np.linspace(0.0, 1.3, 150)[:, None]
    serial = run_blocks(simulator, samples)
    assert 0 < (~serial.ok).sum() < 150
    with ThreadPoolExecutor(2) as threads:
        threaded = run_blocks(simulator, samples, threads)
    for name in ("Y", "ok", "t_failed", "messages"):
        assert_array_equal(getattr(threaded, name), getattr(serial, name))


@pytest.mark.parametrize("solver", ALL_SOLVERS, ids=repr)
def test_a_sample_runs_as_it_does_alone(solver):
    simulator = mb.DAESimulator(spinning(), solver)
    samples = np.array([[1.5, 0.0], [1.4, 0.1], [1.7, -0.1]])
    together = simulator.run(samples)
    for k, sample in enumerate(samples):
        # Lanes share their step: alone, a sample takes others, within the tolerance.
        shared = 1e-9 if isinstance(solver, mb.DormandPrince | mb.Rosenbrock) else 0.0
        assert_allclose(simulator.run(sample[None]).Y[0], together.Y[k], rtol=0, atol=shared)
        run = mb.simulate(spinning(), solver, dict(zip(("m", "c"), sample, strict=True)))
        assert_allclose(run.values, together.Y[k], atol=1e-8)


@pytest.mark.parametrize("solver", ALL_SOLVERS, ids=repr)
def test_simulators_pickle(solver):
    simulator = mb.DAESimulator(pendulum(), solver)
    copy = pickle.loads(pickle.dumps(simulator))
    assert_array_equal(copy.run(SAMPLES[:3]).Y, simulator.run(SAMPLES[:3]).Y)
    assert copy.run([[-1.0, 0.8]]).messages == ("t = 0 s, l1 = -1, l2 = 0.8: Body 'rod1': mass is -1, not positive",)
    assert repr(copy) == f"DAESimulator('double pendulum', {solver!r})"
    assert (copy.parameters, copy.outputs) == ({"l1": 1.0, "l2": 0.8}, ("theta1", "theta2", "omega1", "omega2"))


def test_the_bundle_pickles():
    dae = mb.compile_dae(double_pendulum().system)
    copy = pickle.loads(pickle.dumps(dae))
    at = (RNG.uniform(-1, 1, 6), RNG.uniform(-1, 1, 6), [1.0, 0.8], 0.0)
    for first, second in zip(dae.rhs(*at), copy.rhs(*at), strict=True):
        assert_array_equal(first.full(), second.full())
    assert (copy.q_names, copy.rows) == (dae.q_names, dae.rows)


ADAPTIVE = mb.IDAS | mb.CVODES | mb.DormandPrince | mb.StabilizedIndex2 | mb.Rosenbrock
FIXED_STEP = [*(s for s in ALL_SOLVERS if not isinstance(s, ADAPTIVE)), mb.Rosenbrock(step=1e-3)]


@pytest.mark.parametrize("solver", FIXED_STEP, ids=repr)
def test_marching_samples_side_by_side_is_the_same_run(solver):
    simulator = mb.DAESimulator(pendulum(), solver)
    expected = simulator.run(SAMPLES[:5]).Y
    steps = list(simulator.march(SAMPLES[:5]))
    assert [i for i, _ in steps] == list(range(6))
    assert_allclose(np.stack([y for _, y in steps], axis=1), expected, atol=1e-9)


def test_marching_needs_a_fixed_step():
    with pytest.raises(mb.PropagationError, match="needs a solver with a fixed step, such as RungeKutta"):
        next(mb.DAESimulator(pendulum()).march(SAMPLES[:2]))


def test_capabilities_are_told_by_type():
    simulator = mb.DAESimulator(pendulum())
    assert isinstance(simulator, Jets) and isinstance(simulator, March) and not hasattr(simulator, "expression")
    plain = mb.Scene(mb.System(parameters=mb.Parameters(a=1.0)), outputs={"t": mb.t})
    assert hasattr(mb.DAESimulator(plain), "expression")


def test_no_samples_and_no_times_but_the_start():
    simulator = mb.DAESimulator(double_pendulum([0.0]))
    assert simulator.run(np.zeros((0, 2))).Y.shape == (0, 1, 4)
    assert_allclose(simulator.run(SAMPLES[:2]).Y, np.broadcast_to([0.9, -0.4, 1.0, -2.0], (2, 1, 4)))


def test_times_do_not_start_at_zero_and_need_not_be_even():
    early = mb.simulate(double_pendulum(np.array([0.0, 0.1, 0.35, 0.5])), mb.CVODES(rtol=1e-11))
    late = mb.simulate(double_pendulum(np.array([7.0, 7.1, 7.35, 7.5])), mb.CVODES(rtol=1e-11))
    assert_allclose(late.values, early.values, atol=1e-8)


def test_simulate_takes_times_and_outputs_in_place_of_the_scene_s():
    scene = pendulum()
    rod1, _ = scene.system.bodies
    run = mb.simulate(scene, times=[0.0, 0.25], outputs={"x": rod1.x})
    assert run.names == ("x",) and run.values.shape == (2, 1)
    assert scene.output_names == ("theta1", "theta2", "omega1", "omega2")


SCENE = explosion()
BOX = mb.Box(a=(0.1, 0.2))


@pytest.mark.parametrize(
    ("solver", "message"),
    [
        ("cvode", "There is no solver 'cvode'. Did you mean 'cvodes'"),
        (mb.IDAS, "solver: got the class IDAS; call it"),
        (mb.Projection(), r"solver: Projection\(\) is not a Solver"),
    ],
)
def test_solvers(solver, message):
    refused(message, mb.simulate, SCENE, solver)
    refused(message, mb.propagate, SCENE, mb.Vertex(), BOX, solver=solver)


def test_systems_are_no_scenes_and_intervals_no_boxes():
    refused(r"Expected a Scene, got System. Scene\(system, times=...\)", mb.simulate, SCENE.system)
    refused(r"Expected a Scene or a simulator, got System. Scene\(", mb.propagate, SCENE.system, mb.Vertex(), BOX)
    refused(r"box: \{'a': \(0.1, 0.2\)\} is not a Box", mb.propagate, SCENE, mb.Vertex(), {"a": (0.1, 0.2)})
    refused("No box", mb.propagate, SCENE.with_box(None), mb.Vertex())


def test_a_failed_run_of_a_scene_tells_its_parameters_and_time_once():
    bounds = warned("1 of 2 runs failed", mb.propagate, SCENE, mb.Vertex(), mb.Box(a=(0.2, 1.0)), mb.CVODES(rtol=1e-9))
    assert str(bounds.failed[0]).startswith("t = 0.99")
    assert str(bounds.failed[0]).count("0.99") == 1


def rod():
    def spring(m):
        return mb.Spring("spring", GROUND.point(1, 1), m.rod0.point(0, -m.p.length / 2), m.p.stiffness, length=0.8)

    box = mb.Box(length=(0.98, 1.02), stiffness=(36, 44))
    machine = rods(1, spring, stiffness=40.0)
    return machine.scene("y", np.linspace(0, 1, 21), {"rod0.theta": 0.5}, box=box, name="rod")


@pytest.fixture
def derivations(monkeypatch):
    """Names of the scenes whose equations are derived, in order."""
    names, derive = [], formulation._formulations
    monkeypatch.setattr(formulation, "_formulations", lambda scene: names.append(scene.name) or derive(scene))
    return names


def test_equations_are_derived_once_whatever_is_asked(derivations):
    scene = rod()
    mb.simulate(scene)
    mb.simulate(scene, mb.IDAS(), {"length": 1.01}, check=True)
    mb.propagate(scene, mb.Vertex())
    mb.propagate(scene, mb.PolynomialChaos())
    mb.compare(scene, [mb.Vertex(), mb.Taylor(2)])
    repr(mb.DAESimulator(scene))
    assert derivations == ["rod"]


def test_options_are_checked_before_anything_is_derived(derivations):
    scene = rod()
    for study in (mb.simulate, mb.sensitivities, mb.compare):
        refused("each time must be larger", study, scene, times=[1.0, 0.0])
    refused("is not a Box", mb.propagate, scene, box=3)
    refused("expected 'cuda' or None", mb.propagate, scene, device="gpu")
    assert derivations == []


def test_prepared_scenes_are_taken_in_the_place_of_scenes(derivations, tmp_path):
    prepared = mb.prepare(rod(), mb.DormandPrince(rtol=1e-9))
    assert prepared is mb.prepare(prepared.scene, mb.DormandPrince(rtol=1e-9))
    run = mb.simulate(prepared, parameters={"length": 1.02})
    assert run.solver == "DormandPrince(rtol=1e-09)"
    assert_array_equal(run.values, mb.simulate(rod(), prepared.solver, {"length": 1.02}).values)
    assert mb.propagate(prepared, mb.Vertex()).evaluations == 4
    assert warned("neither an equilibrium nor a steady motion", mb.linearize, prepared).frequencies.size
    mb.view(prepared, tmp_path / "rod.svg")
    for options in ({"solver": mb.CVODES()}, {"times": [0.0, 1.0]}, {"outputs": {}}):
        refused("has its own solver, times, outputs and device", mb.simulate, prepared, **options)


@pytest.mark.parametrize("solver", [None, mb.CVODES(), mb.DormandPrince(), mb.Rosenbrock(), mb.HHT(1e-3)], ids=repr)
def test_a_second_run_derives_and_compiles_nothing(solver, monkeypatch):
    scene = rod()
    first = mb.simulate(scene, solver, {"length": 1.01})
    with monkeypatch.context() as patched:
        patched.setattr(ca.Function, "__init__", lambda *made: pytest.fail(f"{made[1:2]} is made anew"))
        other = mb.simulate(scene, solver, {"stiffness": 41.0})
        again = mb.simulate(scene, solver, {"length": 1.01})
    assert_array_equal(again.x, first.x)
    assert again.reason == first.reason
    assert_array_equal(other.x, mb.simulate(rod(), solver, {"stiffness": 41.0}).x)  # whatever ran before


def test_runs_with_other_pulses_take_other_steps():
    pulse = lambda p, _: ca.exp(-(((mb.t - 0.5) / p.width) ** 2)) / (np.sqrt(np.pi) * p.width)  # noqa: E731
    scene = particle(pulse, [0.0, 100.0], {}, ("vx",), width=(0.1, 0.9))
    for solver in (mb.DormandPrince(), mb.CVODES()):
        assert mb.simulate(scene, solver)["vx"][-1] == pytest.approx(0.921350, abs=1e-5)  # (1 + erf(1)) / 2
        assert mb.simulate(scene, solver, {"width": 0.1})["vx"][-1] == pytest.approx(1.0, abs=1e-6)


def test_solvers_are_chosen_when_a_simulator_is_made(monkeypatch):
    simulator = mb.DAESimulator(rod())
    monkeypatch.setattr(Program, "runs", lambda *_: pytest.fail("a run is made"))
    assert repr(simulator) == "DAESimulator('rod', DormandPrince())"
    assert simulator.solver == mb.DormandPrince() and "a pilot run took" in simulator.reason
    assert simulator.setup_seconds > 0
    assert simulator.noise is None and not simulator.doubts


def test_what_is_prepared_has_taken_its_second_look(monkeypatch):
    prepared = mb.prepare(rod())
    monkeypatch.setattr(Program, "runs", lambda *_: pytest.fail("a run is made"))
    prepared.second_look()
    assert prepared.noise.shape == (1,) and 0 < prepared.noise[0] < 1e-6 and not prepared.doubts
    assert_array_equal(pickle.loads(pickle.dumps(prepared)).noise, prepared.noise)


def test_nothing_keeps_a_scene_alive_that_was_prepared():
    scene = rod()
    mb.simulate(scene)
    mb.propagate(scene, mb.Vertex())
    known = weakref.ref(scene)
    del scene
    gc.collect()
    assert known() is None


def test_copies_and_pickles_of_scenes_remember_nothing():
    scene = rod()
    simulator = mb.prepare(scene)
    assert not pickle.loads(pickle.dumps(scene)).memory and not scene.with_times([0.0, 1.0]).memory
    copy = pickle.loads(pickle.dumps(simulator))
    P = np.array([[1.01, 1.0, 9.81, 38.0]])
    assert_array_equal(copy.run(P).Y, simulator.run(P).Y)


@pytest.mark.parametrize("model", ["four_bar", "half_car", "six_axis_arm", "stick_slip"])
def test_models_run_again_with_what_was_prepared(model, monkeypatch):
    scene = importlib.import_module(f"models.{model}").scene()
    first = mb.simulate(scene)
    monkeypatch.setattr(ca.Function, "__init__", lambda *_: pytest.fail("a Function is made anew"))
    assert_array_equal(mb.simulate(scene).x, first.x)


@pytest.mark.parametrize("rate", [4e7, 9e8, 3e10])
def test_no_explicit_steps_are_tried_over_a_decay_beyond_their_limit(rate):
    """A damper of 1 s whose transient decays at a high rate, beside a spring: y = exp(-t) (1 + O(1 / rate))."""
    law = lambda p, mass: (-p.k * mass.x, -p.rate * (mass.vy + mass.y))  # noqa: E731
    start, rates = {"mass.x": 1.0, "mass.y": 1.0}, (0.5 * rate, 1.5 * rate)
    prepared = mb.DAESimulator(particle(law, np.linspace(0, 1, 5), start, ("x", "y"), k=(90, 110), rate=rates))
    assert prepared.solver == mb.Rosenbrock() and "too fast for explicit steps" in prepared.reason
    assert "DormandPrince" not in prepared.reason
    (values,) = prepared.run([[90.0, rate]]).Y
    np.testing.assert_allclose(values.T, [np.cos(np.sqrt(90.0) * prepared.times), np.exp(-prepared.times)], atol=1e-6)


TIGHT = mb.DormandPrince(rtol=1e-11, atol=1e-13)


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
@pytest.mark.parametrize("model", [paper, four_bar, heavy_top])
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
    machine = machines.bouncing_ball(lambda m: mb.Force("lift", m.at, (0, 15 * ca.sin(mb.t) ** 9)))
    scene, k = machine.scene("y vy", np.linspace(0, 8, 81), {"ball.y": 0.5}), round(10 * time)
    closed = mb.simulate(scene, times=scene.times[: k + 1])(machine.floor.closed)[-1]
    assert closed == (time != 1.5)
    assert_goes_on(scene, 1e-9, solver=mb.EventDriven(), k=k)


def servo(coordinates):
    """An arm and a tool that turns many times, under a filter and two controllers; and a body that nothing turns."""
    p = mb.Parameters(gain=3.0)
    tool = mb.Body("tool", mass=0.5, inertia=(0.1, 0.1, 0.2), pose=mb.Spatial())
    arm = mb.Body("arm", mass=1.0, inertia=(0.1, 0.1, 0.2), pose=mb.Spatial())
    free = mb.Body("free", mass=1.0, pose=mb.Particle())
    shoulder = mb.Revolute("shoulder", machines.GROUND.point(0, 0, 0), arm.point(-0.5, 0, 0), axis=(0, 1, 0))
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
    refused(r"another system: only one of the systems has 'rod1\.x'", paper.scene().starting_at, run)
    refused("the run has failed", scene.starting_at, replace(run, x=run.x * np.nan))
    run.save(tmp_path / "run.npz")
    refused(r"Pass the scene: Trajectory\.load", scene.starting_at, mb.Trajectory.load(tmp_path / "run.npz"))
    read = scene.starting_at(mb.Trajectory.load(tmp_path / "run.npz", scene))
    refused(r"the first time must be 1\.0 s", read.with_times, [0.0, 2.0])
    refused("Omit equilibrium", replace, read, equilibrium=True)
    np.testing.assert_array_equal(mb.simulate(read).values, mb.simulate(scene.starting_at(run)).values)


def test_turns_that_a_run_did_not_count_are_refused():
    machine = machines.pendulum(pose=mb.Spatial(), axis=(0, 1, 0), g=None)
    scene = machine.scene("x", [0.0, 2.0], {"hinge.angle_rate": 5.0})
    counting = scene.with_outputs({"angle": machine.hinge.angle})
    refused(r"the run has no state 'hinge\.angle'", counting.starting_at, mb.simulate(scene))
    run = mb.simulate(scene.starting_at(mb.simulate(counting)))  # the count of turns is not needed any more
    assert run.t[0] == 2.0
