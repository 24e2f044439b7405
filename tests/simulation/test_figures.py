"""Figures of motions: closed forms, SciPy, and what is refused."""

import pickle
from concurrent.futures import ProcessPoolExecutor

import casadi as ca
import machines
import numpy as np
import pytest
from faults import refused, told_in_a_line, warned
from figure_motions import KINDS, MOTIONS, figure, motion

import symmb as mb
from symmb.run.simulation.panels import Panels, values_at

G = 9.81


def thrown(outputs, times=(0.0, 1.0), **changes):
    machine = machines.ball(speed=2.0)
    start = {"ball.vy": machine.p.speed, "ball.vx": 3.0}
    return machine.scene(outputs(machine.ball), times, start, box=mb.Box(speed=(1.9, 2.1)), **changes)


def test_a_thrown_ball_has_its_closed_forms():
    integral = [t**2 - G * t**3 / 6 for t in (0.1, 0.6)]
    figures = {
        "height": (lambda ball: mb.maximum(ball.y), 4 / (2 * G)),
        "landing": (lambda ball: mb.first_time(ball.y < 0), 4 / G),
        "range": (lambda ball: mb.value_at(ball.x, ball.y < 0), 12 / G),
        "apex": (lambda ball: mb.first_time(ball.vy <= 0), 2 / G),
        "mean": (lambda ball: mb.mean(ball.y, window=(0.1, 0.6)), (integral[1] - integral[0]) / 0.5),
        "end": (lambda ball: mb.final(ball.y), 2 - G / 2),
    }
    run = mb.simulate(thrown(lambda ball: {name: figure(ball) for name, (figure, _) in figures.items()}))
    assert [run[name] for name in run.names] == pytest.approx([value for _, value in figures.values()], abs=1e-9)
    assert run.units[:2] == ("m", "s")


def test_an_oscillator_peaks_between_its_output_times():
    machine = machines.spring_mass(stiffness=25.0)
    x, k = machine.ball.x, machine.p.stiffness
    outputs = {"peak": mb.maximum(x), "load": mb.minimum(-k * x), "mean": mb.mean(x), "x": x}
    run = machine.run(outputs, [0.0, 1.0, 2.0], {"ball.x": 0.3, "ball.vx": 2.0})
    amplitude = np.hypot(0.3, 0.4)
    mean = (0.3 * np.sin(10.0) / 5 + 0.4 * (1 - np.cos(10.0)) / 5) / 2
    assert (run["peak"], run["load"], run["mean"]) == pytest.approx((amplitude, -25 * amplitude, mean), abs=1e-8)
    assert run["x"].shape == (3,)


def test_impacts_are_touched_and_count_on_both_sides():
    first, speed = np.sqrt(2 / G), np.sqrt(2 * G)
    figures = [
        (lambda ball: mb.first_time(ball.y <= 0), first),
        (lambda ball: mb.first_time(ball.y < 0), first),
        (lambda ball: mb.first_time(ball.y <= 0, window=(0.6, None)), first + 2 * 0.7 * speed / G),
        (lambda ball: mb.maximum(ball.y, window=(0.6, 3.0)), 0.49),
        (lambda ball: mb.minimum(ball.vy), -speed),
        (lambda ball: mb.maximum(ball.vy), 0.7 * speed),
        (lambda ball: mb.value_at(ball.vy, ball.y <= 0), -speed),
        (lambda ball: mb.minimum(ball.y), 0.0),
    ]
    outputs = lambda m: {f"f{k}": figure(m.ball) for k, (figure, _) in enumerate(figures)}  # noqa: E731
    run = machines.bouncing_ball(restitution=0.7).run(outputs, [0.0, 3.0], {"ball.y": 1.0, "ball.vx": 1.0})
    assert [run[name] for name in run.names] == pytest.approx([value for _, value in figures], abs=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_random_motions_agree_with_scipy(seed):
    random = np.random.default_rng(seed)
    own = motion(MOTIONS[seed], random)
    drawn = {kind: figure(own, kind, random) for kind in KINDS}
    k, c = random.uniform(0.95, 1.05, 2)
    run = mb.simulate(own.scene({n: d.figure for n, d in drawn.items()}), parameters={"k": k, "c": c})
    pieces = own.segments(k, c)
    expected = {name: one.value(pieces, k, c) for name, one in drawn.items()}
    assert {name: run[name] for name in drawn} == pytest.approx(expected, rel=1e-7, abs=1e-7)


@pytest.mark.parametrize(
    ("one", "expected"),
    [
        (mb.maximum(ca.sin(mb.t)), 1.0),
        (mb.maximum(3.0), 3.0),
        (mb.maximum(mb.t), 2.0),
        (mb.maximum(mb.t, window=(0.1, 0.77)), 0.77),
        (mb.maximum(-ca.fabs(mb.t - 0.7123)), 0.0),
        (mb.maximum(ca.if_else(mb.t < 0.7123, mb.t, -1)), 0.7123),
        (mb.maximum(ca.exp(-(((mb.t - 1.234) / 1e-3) ** 2))), 1.0),
        (mb.mean(ca.fabs(mb.t - 0.5)), 0.625),
        (mb.mean(ca.sin(1000 * mb.t) ** 2), 0.5 - np.sin(4000) / 8000),
        (mb.first_time(mb.t >= 0), 0.0),
        (mb.first_time(mb.t >= 2.0), 2.0),
        (mb.first_time(ca.fabs(mb.t - 1.00123) < 1e-6), 1.001229),
        (mb.first_time((mb.t - 1.00123) ** 2 < 1e-10), 1.00122),
        (mb.first_time(ca.logic_and(mb.t > 0.5, mb.t < 0.7)), 0.5),
        (mb.first_time(ca.logic_or(mb.t > 1.5, mb.t > 0.7)), 0.7),
        (mb.first_time(ca.logic_not(mb.t < 0.7)), 0.7),
        (mb.first_time(mb.t - 1 < mb.t * (mb.t - 1)), 0.0),
        (mb.first_time(mb.t * (mb.t - 1) <= 0), 0.0),  # an equality at the begin counts for what it is
        (mb.first_time(mb.t * (1 - mb.t) < 0), 1.0),
        (mb.value_at(ca.if_else(mb.t < 0.7123, mb.t, -1), mb.t >= 0.7123), 0.7123),
    ],
    ids=str,
)
def test_kinks_jumps_and_ends(one, expected):
    still = mb.Scene(mb.System(), times=(0.0, 2.0), outputs={"f": one})
    assert mb.simulate(still)["f"] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(
    "law", [mb.KelvinVoigt(1e5), mb.KelvinVoigt(1e5, 20.0), mb.HuntCrossley(1e5, 0.8, 3.0)], ids=repr
)
def test_a_force_begins_when_it_leaves_zero(law):
    """Both sides of force > 0 are equal for as long as nothing touches."""
    machine = machines.ball(lambda m: mb.Contact("floor", m.at, machines.ORIGIN, (0, 1, 0), law))
    begins = machine.system.force("floor") > 0
    outputs = {"begin": mb.first_time(begins), "speed": mb.value_at(machine.ball.vy, begins)}
    run = machine.run(outputs, [0.0, 0.6], {"ball.y": 1.0})
    assert abs(run["begin"] - np.sqrt(2 / G)) < 1e-7 and abs(run["speed"] + np.sqrt(2 * G)) < 1e-6
    never = warned("Output 'begin' is nan", machine.run, outputs, [0.0, 0.4], {"ball.y": 1.0})
    assert np.isnan(never["begin"]) and np.isnan(never["speed"])


@pytest.mark.parametrize("check", [False, True])
@pytest.mark.parametrize("file", ["a.npz", "a.json"])
def test_a_condition_that_never_holds_is_doubted_in_a_run_and_infinite_in_a_study(check, file, tmp_path):
    scene = thrown(lambda ball: {"y": ball.y, "top": mb.maximum(ball.y), "high": mb.first_time(ball.y > 5)})
    run = warned("Output 'high' is nan, because its condition never holds", mb.simulate, scene, check=check)
    run.save(tmp_path / file)
    for one in (run, mb.Trajectory.load(tmp_path / file)):
        assert np.isnan(one["high"]) and one["top"] == pytest.approx(0.2039, abs=1e-4)
        assert sum("'high'" in doubt for doubt in one.doubts) == 1
    scene = thrown(lambda ball: {"high": mb.first_time(ball.y > 0.2)})
    bounds = mb.propagate(scene, mb.MonteCarlo(60))
    assert bounds["high"][1] == np.inf and not bounds.failed and "never holds in a run" in "".join(bounds.remarks)


@pytest.mark.parametrize(
    ("outputs", "message"),
    [
        (lambda ball: {"f": mb.first_time(ball.y)}, "the condition is not a comparison"),
        (lambda ball: {"f": mb.first_time(ball.y == 0)}, "the condition requires equality"),
        (lambda ball: {"f": mb.first_time(True)}, "first_time: the condition is True at all times"),
        (lambda ball: {"f": mb.first_time(None)}, "first_time: the condition is missing"),
        (lambda ball: {"f": mb.maximum(None)}, "maximum: the expression is missing"),
        (lambda ball: {"f": mb.maximum(mb.mean(ball.y))}, "got a scalar output"),
        (lambda ball: {"f": mb.maximum(ball.y, window=(0.0, 5.0))}, "0 to 5 s is not inside the run from 0 to 1 s"),
        (lambda ball: {"f": mb.maximum(ball.y, window=(-1, 1))}, "-1 to 1 s is not inside the run from 0 to 1 s"),
        (lambda ball: {"f": mb.maximum(ball.y, window=(1.0, 0.0))}, "must end after its start"),
        (lambda ball: {"f": mb.maximum(ball.y, window=3)}, "window must be a pair of times"),
        (lambda ball: {"f": mb.maximum(ball.y)}, "with at least two times"),
        (lambda ball: mb.maximum(ball.x) - mb.minimum(ball.x), "maximum: a scalar output is one number per run"),
        (lambda ball: 2.0 * mb.final(ball.x), "final: a scalar output is one number per run"),
        (lambda ball: {"f": mb.maximum(ca.vertcat(ball.x, ball.y))}, "has 2 components"),
        (lambda ball: {"f": mb.maximum(ca.SX.sym("z"))}, "'z' does not belong to a parameter"),
    ],
)
def test_faults_are_told(outputs, message):
    refused(message, thrown, outputs, times=[0.0] if "two times" in message else (0.0, 1.0))


def mixed():
    return thrown(lambda ball: {"y": ball.y, "height": mb.maximum(ball.y), "x": ball.x}, np.linspace(0.0, 1.0, 6))


def test_figures_stand_beside_outputs_over_time(tmp_path):
    run = mb.simulate(mixed(), check=True)
    assert run["height"] == pytest.approx(4 / (2 * G))
    assert run.values.shape == run.error.shape == (6, 3)
    run.save(tmp_path / "run.json")
    assert mb.Trajectory.load(tmp_path / "run.json")["height"] == run["height"]
    assert mb.Trajectory.load(tmp_path / "run.json", mixed())["height"] == run["height"]


def test_sweeps_have_one_number_a_run(tmp_path):
    runs = mb.sweep(mixed(), {"speed": [1.0, 2.0]})
    assert runs["height"] == pytest.approx(np.array([1.0, 4.0]) / (2 * G))
    assert runs["y"].shape == (2, 6)
    runs.save(tmp_path / "runs.json")
    assert mb.Sweep.load(tmp_path / "runs.json")["height"].shape == (2,)
    assert mb.simulate(mixed(), parameters=[{"speed": 1.0}])["height"].shape == (1,)


def test_sensitivities_of_a_height():
    slopes = mb.sensitivities(mixed())
    np.testing.assert_allclose(slopes["height", "speed"], 2 / G, rtol=1e-9)  # of v^2 / 2 g at 2 m/s
    np.testing.assert_allclose(slopes["y", "speed"], slopes.t, atol=1e-9)


def test_what_needs_derivatives_is_refused():
    refused(r"scalar outputs \(.*\) have values only", mb.propagate, mixed(), mb.Taylor(2), error=mb.PropagationError)
    refused("returns only values", mb.propagate, mixed(), mb.TaylorModel(), error=mb.PropagationError)
    refused("'height' is a scalar output", mb.calibrate, mixed(), {"height": np.zeros(6)})


def test_copies_and_processes_give_the_same():
    scene = pickle.loads(pickle.dumps(mixed()))
    with ProcessPoolExecutor(1) as executor:
        apart = mb.propagate(scene, mb.Vertex(), executor=executor)["height"]
    assert apart == mb.propagate(mixed(), mb.Vertex())["height"]
    assert apart == pytest.approx((1.9**2 / (2 * G), 2.1**2 / (2 * G)))


def test_a_solver_without_lanes_gives_the_same():
    scene = thrown(lambda ball: {"height": mb.maximum(ball.y), "range": mb.value_at(ball.x, ball.y < 0)})
    run = mb.simulate(scene, mb.CVODES(rtol=1e-10))
    assert (run["height"], run["range"]) == pytest.approx((2 / G, 12 / G), abs=1e-7)


def test_panels_are_exact_for_polynomials_of_degree_five():
    t = np.array([0.2, 0.5, 0.8])
    values = np.stack([t**5 - t, 5 * t**4 - 1])[None, :, :, None]
    panel = Panels(np.zeros(1, dtype=int), t[:1], t[2:], values)
    x = np.linspace(0, 1, 7)
    at = t[0] + 0.6 * x
    assert values_at(panel.bernstein(0), x) == pytest.approx(at**5 - at, abs=1e-13)


def test_a_speed_that_starts_at_rest_has_figures():
    machine = machines.ball()
    speed = ca.sqrt(machine.ball.vx**2 + machine.ball.vy**2)
    there = mb.value_at(speed, machine.ball.y <= -0.5)
    run = machine.run({"mean": mb.mean(speed), "peak": mb.maximum(speed), "there": there})
    assert (run["mean"], run["peak"], run["there"]) == pytest.approx((G / 2, G, np.sqrt(G)), abs=1e-8)


def test_runs_that_all_fail_are_told():
    outputs = lambda m: {"end": mb.final(m.p.a / m.ball.y), "mean": mb.mean(m.p.a / m.ball.y)}  # noqa: E731
    refused("t = 0 s, .*a = 1: an output is not finite", machines.ball(a=1.0).run, outputs, error=mb.SimulationError)


def test_runs_that_fail_by_their_outputs_alone_are_told():
    simulator = mb.DAESimulator(machines.ball(a=1.0).scene(lambda m: {"y": 1 / (m.p.a - mb.t)}), mb.CVODES())
    np.testing.assert_array_equal(simulator.run([[1, G, 1], [1, G, 3]]).t_failed, [1, np.nan])
    p = mb.Parameters(a=3.0)
    scene = mb.Scene(mb.System(parameters=p), times=(0.0, 2.0), outputs={"f": mb.first_time(mb.t > p.a)})
    bounds = mb.propagate(scene, mb.Vertex(), mb.Box(a=(0.5, 1.5)))
    assert bounds["f"] == pytest.approx((0.5, 1.5)) and bounds.nominal[0, 0] == np.inf


def test_bounds_beside_a_nominal_run_without_an_output_have_a_warning():
    p = mb.Parameters(a=1.0)
    scene = mb.Scene(mb.System(parameters=p), times=(0.0, 2.0), outputs={"f": mb.maximum(mb.t / (p.a - 1))})
    with pytest.warns(mb.SymmbWarning, match="The nominal run fails at t = 0 s, a = 1: an output is not finite"):
        bounds = mb.propagate(scene, mb.Vertex(), mb.Box(a=(1.2, 1.5)))
    assert bounds["f"] == pytest.approx((4.0, 10.0))


def test_an_unknown_text_in_a_condition_is_told_once():
    with told_in_a_line(r"^first_time: expected an expression over time, got 'ball.x > 0'\.$"):
        machines.ball().scene(lambda m: {"a": mb.first_time("ball.x > 0")})


def test_the_largest_speed_of_a_wheel_that_a_brake_holds_is_rounding():
    wheel, ground = mb.Body("wheel", 1.0, 0.3), mb.Ground()
    pin = mb.Revolute("pin", ground.point(0, 0), wheel.point(0.1, 0))
    system = mb.System(wheel, pin, mb.Clutch("brake", ground, wheel, 5.0), mb.Torque("load", wheel, 3 * mb.t))
    run = mb.simulate(mb.Scene(system, {"pin.angle": 0.3}, [0.0, 1.0], {"peak": mb.maximum(wheel.omega)}))
    assert abs(run["peak"]) < 1e-12


@pytest.mark.parametrize("e, slow, number", [(0.5, 0.1, 3), (0.4, 0.05, 2), (0.6, 0.2, 3)])
@pytest.mark.parametrize("end", [4.75, 5.5, 6.0, 7.25, 10.0])
def test_two_conditions_hold_at_once_and_not_between_nodes_only(end, e, slow, number):
    """A bouncing ball is slow at each apex, and low at the apex of this number: the closed form tells when."""
    machine = machines.bouncing_ball(restitution=e, slow=slow)
    both = ca.logic_and(machine.ball.y < 0.05, machine.ball.vy**2 < machine.p.slow**2)
    outputs = {"t": mb.first_time(both), "y": mb.value_at(machine.ball.y, both)}
    run = machine.run(outputs, [0.0, end], {"ball.y": 1.0})
    apex = np.sqrt(2 / G) * (1 + 2 * sum(e**k for k in range(1, number)) + e**number)
    assert run["t"] == pytest.approx(apex - slow / G, abs=1e-7)
    assert run["y"] == pytest.approx(e ** (2 * number) - slow**2 / (2 * G), abs=1e-7)
