"""Impacts against closed forms: times and speeds, what a jump keeps, contacts that stay closed, errors told."""

import pickle
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from decimal import Decimal, localcontext
from itertools import pairwise

import casadi as ca
import machines
import numpy as np
import problems
import pytest
from faults import refused
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp

import symmb as mb
from models import bouncing_ball
from symmb.connect.simulator import run_blocks
from symmb.run.events import event_doubts

G = 9.81
KNOWN = problems.read("bouncing_ball")


def dropped(e, times, **start):
    """A particle above y = 0."""
    machine = machines.bouncing_ball(restitution=e, mass=2.0)
    outputs = {"y": machine.ball.y, "y_dot": machine.ball.vy, "closed": machine.floor.closed}
    return machine.scene(outputs, times, {f"ball.{key}": value for key, value in start.items()})


def rods(e, wall, times):
    """Two hinged rods of 1 m and 1 kg, the tip of the second in front of a wall."""
    machine = machines.rods(2, lambda m: mb.Impact("wall", m.bodies[1].point(0, -0.5).x - wall, e))
    return machine.scene(None, times, {"rod0.theta": 0.9, "rod1.theta": 0.9})


def mass_of_rods(theta):
    """Mass matrix in the angles, by Lagrange."""
    c = np.cos(theta[0] - theta[1]) / 2
    return np.array([[4 / 3, c], [c, 1 / 3]])


@pytest.mark.parametrize("e", ["0.8", "0.99"])
def test_times_speeds_and_apexes_of_a_bouncing_ball(e):
    known = np.array(KNOWN["cases"][e]["values"])[:30]
    apexes = known[:, 0] + known[:, 1] / G
    run = mb.simulate(bouncing_ball.scene(restitution=float(e)).with_times([0.0, 0.4, *apexes]))
    impacts = [event for event in run.events if event.what == "impact"]
    time, after, before = np.array([[event.time, event.after, -event.before] for event in impacts[:30]]).T
    assert_allclose(time, known[:, 0], rtol=0, atol=1e-9)
    assert_allclose([after, before], [known[:, 1], known[:, 1] / float(e)], rtol=1e-9)
    assert_allclose(run["y"][2:], known[:, 2], rtol=1e-8)
    assert run.energy_drift < 1e-10


def test_contacts_that_open_at_one_instant_all_open():
    p = mb.Parameters(load=27.0, w=70.0, k=712.0)
    balls = [mb.Body(f"ball{k}", 0.08, pose=mb.Particle()) for k in range(2)]
    lift = p.load * (2 * ca.sin(p.w * mb.t) - 1)
    forces = [mb.Force(f"lift{k}", ball.point(0, 0), (0, lift - p.k * ball.y)) for k, ball in enumerate(balls)]
    floors = [mb.Impact(f"floor{k}", ball.y, 0.5) for k, ball in enumerate(balls)]
    system = mb.System(*balls, *forces, *floors, parameters=p)
    simulator = mb.DAESimulator(mb.Scene(system, {}, [0.0, 0.02], {ball.name: ball.y for ball in balls}))
    P = np.random.default_rng(0).uniform((26.0, 65.0, 700.0), (28.0, 75.0, 720.0), (100, 3))
    load, w, k = P.T
    begin, own, driven = np.pi / 6 / w, np.sqrt(k / 0.08), 2 * load / (k - 0.08 * w**2)  # loads turn at a sine of 1/2
    flight, rest = 0.02 - begin, load / k
    height = driven * np.sin(w * 0.02) - rest - (driven / 2 - rest) * np.cos(own * flight)
    height -= driven * w / own * np.cos(w * begin) * np.sin(own * flight)
    assert_allclose(simulator.run(P).Y[:, -1], np.column_stack([height] * 2), rtol=1e-7)


def test_impacts_of_one_instant_are_told_if_their_order_matters():
    events = [mb.Event(2.5, name, "impact", -1.0, 0.5, -0.1, name != "c", (3.0,)) for name in "cab"]
    assert "impacts of 'a', 'b' at t = 2.5 s are simultaneous" in event_doubts(events)[0]


def test_bouncing_ends_in_a_contact_that_stays_closed():
    end = KNOWN["cases"]["0.8"]["zeno_time"]
    run = mb.simulate(dropped(0.8, np.linspace(0, 6, 13), y=1.0, vx=3.0))
    last = run.events[-1]
    assert (last.name, last.what) == ("floor", "closes") and abs(last.time - end) < 1e-6
    assert_array_equal(run["closed"], run.t > end)
    assert_array_equal(run["y"][run.t > end], 0.0)
    assert_allclose(run.energy.work[-1], -2.0 * G, rtol=1e-9)  # all of the potential is lost
    assert run.energy_drift < 1e-10
    assert "'floor' closes at 4.06371 s" in str(run)


@pytest.mark.parametrize("shift", [0.0, 2.0, -1e3])
def test_bouncing_ends_beside_a_pendulum_wherever_the_origin_is(shift):
    """The projection of the pendulum ends steps at a gap of 0; the last flights of the ball are lost in rounding."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    machine = machines.bob(ball, lambda m: mb.Impact("floor", ball.y + m.p.shift, 0.5), g=10.0, shift=shift)
    run = machine.run(times=[0.0, 2.5], start={"ball.y": 2 - shift, "bob.x": 1.0, "bob.y": 0.0})
    assert run.events[-1].what == "closes"
    rounding = np.finfo(float).eps * (1 + abs(shift))  # flights in it are not made
    assert_allclose(run.events[-1].time, 3 * np.sqrt(0.4), rtol=10 * np.sqrt(rounding))
    assert_allclose(run["ball.y"][-1], -shift, atol=4 * rounding)


def test_without_restitution_it_sticks_at_once():
    run = mb.simulate(dropped(0.0, [0.0, 1.0, 2.0], y=1.0))
    assert [event.what for event in run.events] == ["impact", "closes"]
    assert_allclose([run.events[0].time, run.events[0].after], [np.sqrt(2 / G), 0.0], rtol=1e-12, atol=1e-15)
    assert_array_equal(run.values[1:], [[0.0, 0.0, 1.0]] * 2)


def test_full_restitution_keeps_the_energy():
    run = mb.simulate(dropped(1.0, np.linspace(0, 20, 201), y=1.0))
    assert_allclose([event.time for event in run.events], np.sqrt(2 / G) * np.arange(1, 2 * len(run.events), 2))
    assert len(run.events) == 22 and run.energy.work[-1] == 0.0
    assert run.energy_drift < 1e-10


def test_at_the_time_of_an_impact_an_output_tells_what_is_after_it():
    fall = np.sqrt(2 / G)
    event = mb.simulate(dropped(0.5, [0.0, 1.0], y=1.0)).events[0]
    run = mb.simulate(dropped(0.5, [0.0, event.time - 1e-9, event.time], y=1.0))
    assert_allclose(run["y_dot"], [0.0, -G * fall, 0.5 * G * fall], rtol=1e-8)


def test_a_short_dip_below_zero_is_found():
    machine = machines.spring_mass(lambda m: mb.Impact("stop", m.ball.x + 1 - 1e-6, 1.0), stiffness=1.0)
    (event,) = machine.run(times=[0.0, 5.0], start={"ball.x": 1.0}).events
    assert_allclose(event.time, np.arccos(1e-6 - 1), rtol=1e-9)
    assert abs(event.after / np.sin(np.arccos(1e-6 - 1)) - 1) < 1e-6


@pytest.mark.parametrize("e", [0.0, 0.6, 1.0])
def test_jump_of_jointed_rods(e):
    first = mb.simulate(rods(e, -0.3, [0.0, 1.2])).events[0]
    run = mb.simulate(rods(e, -0.3, [0.0, first.time - 1e-9, first.time]))
    theta = np.column_stack([run["rod0.theta"], run["rod1.theta"]])[-1]
    before, after = np.column_stack([run["rod0.omega"], run["rod1.omega"]])[1:]
    M, W = mass_of_rods(theta), np.cos(theta)  # the tip is at sin(theta_1) + sin(theta_2)
    assert_allclose(np.sin(theta).sum(), -0.3, atol=1e-10)
    assert_allclose([first.before, first.after], [W @ before, -e * (W @ before)], atol=1e-7)
    assert abs(np.linalg.det([M @ (after - before), W])) < 1e-6  # the momentum across the gap's gradient is kept
    effective = 1 / (W @ np.linalg.solve(M, W))
    assert_allclose(first.work, -effective * (1 - e**2) * first.before**2 / 2, rtol=1e-9, atol=1e-12)
    assert run.position_drift < 1e-9 and run.velocity_drift < 1e-9


def test_run_of_jointed_rods_as_by_an_integrator_in_minimal_coordinates():
    e, wall, end = 0.6, 0.0, 4.0
    run = mb.simulate(rods(e, wall, np.linspace(0, end, 31)))

    def rates(t, y):
        a, b = y[:2]
        s = np.sin(a - b) / 2
        force = np.array([-1.5 * G * np.sin(a) - s * y[3] ** 2, -0.5 * G * np.sin(b) + s * y[2] ** 2])
        return [*y[2:], *np.linalg.solve(mass_of_rods(y[:2]), force)]

    def gap(t, y):
        return np.sin(y[:2]).sum() - wall

    gap.terminal, gap.direction = True, -1
    t, y, times = 0.0, np.array([0.9, 0.9, 0.0, 0.0]), []
    while t < end:
        found = solve_ivp(rates, (t, end), y, "DOP853", events=gap, rtol=1e-12, atol=1e-13)
        t, y = found.t[-1], found.y[:, -1]
        if found.status == 1:
            times.append(t)
            W = np.cos(y[:2])
            B = np.linalg.solve(mass_of_rods(y[:2]), W)
            y[2:] -= (1 + e) * (W @ y[2:]) / (W @ B) * B
    assert len(times) >= 3
    assert_allclose([event.time for event in run.events], times, atol=1e-7)
    assert_allclose([run["rod0.theta"][-1], run["rod1.omega"][-1]], [y[0], y[3]], atol=1e-6)
    assert run.energy_drift < 1e-8 and run.position_drift < 1e-9 and run.velocity_drift < 1e-9


def test_rod_dropped_on_its_end():
    e, theta, m, length, height = 0.7, 0.4, 3.0, 2.0, 1.5
    J, arm, speed = m * length**2 / 12, length / 2 * np.cos(theta), np.sqrt(2 * G * height)
    rod = mb.Body("rod", m, J, mb.Planar())
    system = mb.System(rod, mb.Gravity(0, -G), mb.Impact("end", rod.point(-length / 2, 0).y, e))
    y = length / 2 * np.sin(theta) + height
    fall = speed / G
    run = mb.simulate(mb.Scene(system, {"rod.y": y, "rod.theta": theta, "rod.vx": 1.0}, [0.0, fall, fall * 1.01]))
    impulse = (1 + e) * speed / (1 / m + arm**2 / J)
    (event,) = run.events
    assert_allclose(event.time, fall, rtol=1e-12)
    assert_allclose(event.work, -(1 - e**2) * speed**2 / (1 / m + arm**2 / J) / 2, rtol=1e-10)
    assert_allclose(run["rod.omega"][1:], -arm * impulse / J, rtol=1e-10)
    assert_allclose(run["rod.vy"][2], -speed + impulse / m - 0.01 * G * fall, rtol=1e-10)
    assert_allclose(run["rod.vx"], 1.0, rtol=1e-12)


def test_corner_of_a_body_in_space():
    """The impulse n P at r from the centre changes the angular momentum by r x n P."""
    e, inertia, corner = 0.5, np.array([0.02, 0.05, 0.04]), np.array([0.3, 0.2, -0.1])
    turned = mb.rotation(axis=(1, 2, -1), angle=0.7)
    box = mb.Body("box", 2.0, tuple(inertia), mb.Spatial())
    system = mb.System(box, mb.Impact("corner", box.point(*corner).z, e))
    z = 0.5
    start = {"box.z": z, "box.vz": -2.0, "box.rotation": turned}
    probe = mb.simulate(mb.Scene(system, start, [0.0, 1.0], outputs={"z": box.point(*corner).z}))
    (event, *_) = probe.events
    outputs = {"vz": box.vz} | {f"w{i}": box.omega[i] for i in range(3)}
    outputs |= {f"R{i}": box.rotation[2, i] for i in range(3)}
    run = mb.simulate(mb.Scene(system, start, [0.0, event.time], outputs=outputs))
    n = run.values[-1, 4:]  # the vertical in body axes
    lever = np.cross(corner, n)
    impulse = (1 + e) * 2.0 / (1 / 2.0 + lever @ (lever / inertia))
    assert_allclose(event.time, (z + corner @ n) / 2.0, rtol=1e-10)
    assert_allclose(run.values[-1, :4], [-2.0 + impulse / 2.0, *(lever * impulse / inertia)], rtol=1e-9)


def test_a_rod_that_falls_flat_on_both_ends_comes_to_rest():
    rod = mb.Body("rod", 1.0, 1 / 12, mb.Planar())
    ends = [mb.Impact(name, rod.point(x, 0).y, 0.0) for name, x in (("left", -0.5), ("right", 0.5))]
    run = mb.simulate(mb.Scene(mb.System(rod, mb.Gravity(0, -G), *ends), {"rod.y": 1.0}, [0.0, 1.0]))
    assert [event.name for event in run.events if event.what == "closes"] == ["left", "right"]
    assert_allclose(run.values[-1], 0.0, atol=1e-12)
    assert_allclose(run.energy.work[-1], -G, rtol=1e-9)


def test_a_ball_between_two_walls():
    machine = machines.ball(lambda m: (mb.Impact("left", m.ball.x, 0.5), mb.Impact("right", 1 - m.ball.x, 1.0)), g=None)
    run = machine.run(times=[0.0, 10.0], start={"ball.x": 0.5, "ball.vx": -1.0})
    assert [event.name for event in run.events] == ["left", "right"] * 2
    assert_allclose([event.time for event in run.events], [0.5, 2.5, 4.5, 8.5])
    assert_allclose([event.before for event in run.events], [-1.0, -0.5, -0.5, -0.25])
    assert_allclose(run["ball.x"][-1], 1 - 1.5 * 0.25)


def test_a_table_that_swings_throws_what_lies_on_it_when_its_acceleration_passes_gravity():
    amplitude, rate, times = 0.1, 15.0, np.linspace(0, 0.6, 61)
    table = amplitude * ca.sin(rate * mb.t)
    machine = machines.ball(lambda m: mb.Impact("table", m.ball.y - table, 0.0), mass=2.0)
    run = machine.run(times=times, start={"ball.y": 0.0, "ball.vy": amplitude * rate})
    closes, opens, lands = run.events[:3]
    assert (closes.time, closes.what, opens.what, lands.what) == (0.0, "closes", "opens", "impact")
    leaves = np.arcsin(G / (amplitude * rate**2)) / rate
    assert_allclose(opens.time, leaves, rtol=1e-9)
    s = times - leaves
    flight = np.sin(rate * leaves) * amplitude + rate * amplitude * np.cos(rate * leaves) * s - G * s**2 / 2
    before = times < lands.time
    flying = (times > leaves) & (times < lands.time)
    assert flying.sum() > 5
    expected = np.where(flying, flight, amplitude * np.sin(rate * times))
    assert_allclose(run["ball.y"][before], expected[before], atol=1e-9)
    assert run.energy_drift < 1e-9  # the table's work is counted, and what the landing loses


def test_reactions_of_joints_know_of_closed_contacts():
    machine = machines.pendulum(lambda m: mb.Impact("stop", m.rod.point(0.5, 0).y, 0.3), length=0.5, inertia=1 / 12)
    run = machine.run(None, [0.0, 0.1, 3.0], {"rod.theta": 0.5})
    force, _ = run.reaction("hinge")
    assert run.events[-1].what == "closes" and abs(run["rod.theta"][-1]) < 1e-12
    assert_allclose(force[-1], [0.0, G / 2, 0.0], atol=1e-9)  # the stop bears the other half
    assert run.energy_drift < 1e-9


def test_samples_have_events_of_their_own_and_threads_change_nothing():
    scene = bouncing_ball.scene()
    simulator = mb.DAESimulator(scene)
    assert simulator.solver == mb.EventDriven() and "floor" in simulator.reason
    e = np.linspace(0.5, 1.0, 200)
    P = np.column_stack([e, np.linspace(0.5, 1.5, 200)])
    serial = run_blocks(simulator, P)
    with ThreadPoolExecutor(2) as pool:
        assert_array_equal(run_blocks(simulator, P, pool).Y, serial.Y)
    assert_allclose(serial.Y, [motion(scene.times, G, height, e) for e, height in P], atol=2e-9)
    assert_array_equal(pickle.loads(pickle.dumps(simulator)).run(P[:3]).Y, simulator.run(P[:3]).Y)
    assert_allclose(simulator.run(P[17:18]).Y[0], serial.Y[17], atol=1e-12)


def test_a_sample_with_an_impossible_restitution_fails_alone():
    found = mb.DAESimulator(bouncing_ball.scene()).run(np.array([[0.8, 1.0], [1.2, 1.0], [0.8, -0.5]]))
    assert_array_equal(found.ok, [True, False, False])
    assert "Impact 'floor': restitution 1.2 is not between 0 and 1" in found.messages[0]
    assert "the gap is -0.5 at the start" in found.messages[1]


@pytest.mark.parametrize("gap", [0.0, -1e-9, -1e-12])
@pytest.mark.parametrize("span", [0.1, 1.0, 10.0])
def test_a_gap_that_rounding_closes_starts_as_closed(gap, span):
    """Nothing but the gap itself tells of the size of the scene. A ball that lies on the floor stays there."""
    run = mb.simulate(dropped(0.5, np.linspace(0, span, 5), y=gap))
    assert [(event.time, event.what) for event in run.events] == [(0.0, "closes")]
    assert_allclose(run["y"], 0, atol=1e-9)
    assert gap != 0.0 or (run.values == [0.0, 0.0, 1.0]).all()


LOST = {  # elements beside a ball, its start, and what is told
    "a gap that is small, but as large as the motion": (
        lambda m: (mb.Spring("spring", machines.ORIGIN, m.at, 1.0), mb.Impact("wall", m.ball.y, 0.5)),
        {"ball.y": -1e-9}, "the gap is -1e-09 at the start"),
    "a gap below 0, with its own remedy only": (
        lambda m: (mb.Force("drag", m.at, (-0.1 * ca.sign(m.ball.vx), -9.81)), mb.Impact("floor", m.ball.y, 0.5)),
        {"ball.y": -0.5, "ball.vx": 1.0}, r"-0\.5 at the start\. Start with a gap of at least 0\.$"),
    "impacts between walls that meet come without end": (
        lambda m: (mb.Impact("left", m.ball.x + 1 - mb.t, 0.5), mb.Impact("right", 1 - mb.t - m.ball.x, 0.5)),
        {"ball.vx": 1.0}, r"t = 1 s.*'(left|right)'"),
    "a gap that a constraint closes": (
        lambda m: (mb.Motion("drive", m.ball.x, 1 - mb.t), mb.Impact("stop", m.ball.x, 0.5)),
        {}, r"t = 1 s.*Impact 'stop' cannot rebound"),
}  # fmt: skip


@pytest.mark.parametrize("case", LOST)
def test_runs_that_are_lost_at_an_impact_tell_why(case):
    elements, start, told = LOST[case]
    refused(told, machines.ball(elements, g=None).run, None, [0.0, 2.0], start, error=mb.SimulationError)


def test_other_solvers_do_not_locate_events():
    refused(r"CVODES\(\) does not locate the events of Impact 'floor'", mb.simulate, bouncing_ball.scene(), mb.CVODES())
    refused(r"Use EventDriven\(\)", mb.DAESimulator, bouncing_ball.scene(), mb.DormandPrince())


def test_taylor_is_not_valid_across_events():
    with pytest.warns(mb.SymmbWarning, match=r"not valid from t = 0\.\d+ s on.* contain the Impact 'floor'"):
        mb.propagate(bouncing_ball.scene(), mb.Taylor(2))
    paper = mb.PolynomialChaos.paper(2, lockstep=True)
    for method, why in (
        (mb.Taylor(4), "cannot be integrated across the events of Impact 'floor'"),
        (paper, "fixed step"),
    ):
        refused(why, mb.propagate, bouncing_ball.scene(), method, error=mb.PropagationError)


@pytest.mark.parametrize(
    ("law", "told"),
    [
        (lambda ball, p: (ball.vy, 0.5), "must not contain velocities"),
        (lambda ball, p: (p.e + 0, 0.5), "contains no coordinate"),
        (lambda ball, p: (ca.vertcat(ball.x, ball.y), 0.5), "gap has 2 components"),
        (lambda ball, p: (ball.y, 1.5), "restitution 1.5 is not between 0 and 1"),
        (lambda ball, p: (ball.y, p.e + 0.8), "restitution 1.3 is not between 0 and 1 at the nominal parameters"),
        (lambda ball, p: (ball.y, ball.y), "may depend on parameters only"),
        (lambda ball, p: (mb.Body("far", 1.0, pose=mb.Particle()).y, 0.5), "does not belong to a parameter or a body"),
    ],
)
def test_faults_of_the_declaration(law, told):
    p = mb.Parameters(e=0.5)
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    assert "Impact 'floor'" in refused(told, mb.System, ball, mb.Impact("floor", *law(ball, p)), parameters=p)


def rows(places, restitution, times, length=0.0, walls=()):
    """The run of balls of some length on a line, of which the first one moves at 1 m/s; a wall may be at the end."""
    balls = [mb.Body(f"b{i}", 1.0, pose=mb.Particle()) for i in range(len(places))]
    gaps = [b.x - a.x - length for a, b in pairwise(balls)] + [wall - balls[-1].x for wall in walls]
    start = {f"b{i}.x": x for i, x in enumerate(places)} | {"b0.vx": 1.0}
    system = mb.System(*balls, *[mb.Impact(f"c{i}", gap, restitution) for i, gap in enumerate(gaps)])
    return mb.simulate(mb.Scene(system, start, times, {b.name: b.vx for b in balls}))


@pytest.mark.parametrize("number", [2, 5, 12, 30])
def test_waggons_that_couple_go_on_together(number):
    """One of unit mass hits others that stand in contact, with restitution 0: momentum tells the speed of all."""
    run = rows([0.0, *(np.arange(number) + 1.5)], 0.0, [0.0, 1.0], length=1.0)
    assert run.values[-1] == pytest.approx(1 / (number + 1), abs=1e-10)
    assert max(Counter(event.time for event in run.events).values()) <= 100 and not run.doubts


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("number, restitution", [(3, 0.2), (4, 0.1), (5, 0.1), (5, 0.2)])
def test_balls_that_collapse_go_on_together(number, restitution):
    """Infinitely many impacts in a finite time, one of which may stop them for good (McNamara and Young, 1992)."""
    run = rows(0.7 * np.arange(number) + 0.1, restitution, [0.0, 9.0, 20.0], walls=[number])
    assert run.values[-1] == pytest.approx(0.0, abs=1e-10)


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("number, restitution", [(12, 0.51), (13, 0.45), (13, 0.55)])
def test_a_row_without_walls_that_collapses_goes_on_together(number, restitution):
    """Impacts get slower and slower while no force holds the balls: momentum tells the speed of all."""
    gaps = np.zeros(number - 1)
    gaps[[0, 4]] = 0.8, 0.18
    run = rows(np.cumsum([0.5, *(1 + gaps)]), restitution, [0.0, 6.0], length=1.0)
    assert run.values[-1] == pytest.approx(1 / number, abs=1e-10)


def motion(times, g, height, restitution):
    """Heights and rates (n_t, 2) of a ball that falls from a height, in arithmetic of 40 digits, until it rests."""
    with localcontext() as context:
        context.prec = 40
        g, low, e = Decimal(g), Decimal(height), Decimal(restitution)
        start, end, speed = Decimal(0), (2 * low / g).sqrt(), Decimal(0)
        rebound, values = e * (2 * g * low).sqrt(), []
        for t in map(Decimal, times.tolist()):
            while t >= end and rebound > 1e-20:
                start, low, speed = end, Decimal(0), rebound
                end, rebound = start + 2 * speed / g, e * speed
            since = t - start
            values.append((low + speed * since - g * since**2 / 2, speed - g * since) if t < end else (0, 0))
        return np.array(values, dtype=float)


@pytest.mark.parametrize(
    ("g", "height", "restitution", "end"),
    [
        (9.81, 1.0, 1.0, 5.0), (9.81, 1.0, 1.0, 60.0), (9.81, 0.7, 1.0, 90.0), (1.62, 2.3, 1.0, 50.0),
        (9.81, 1.3, 0.99, 40.0),
    ],
)  # fmt: skip
def test_the_error_after_many_bounces_is_told(g, height, restitution, end):
    """Flights are parabolas, on which steps of all tolerances are exact: errors are those of rounding."""
    machine = machines.bouncing_ball(restitution=restitution, g=g)
    run = mb.simulate(machine.scene("y", np.linspace(0, end, 51), {"ball.y": height}), check=True)
    error = np.abs(run["y"] - motion(run.t, g, height, restitution)[:, 0]).max()
    assert error < 1e-7 and error / 3 < run.error.max() < 10 * error
