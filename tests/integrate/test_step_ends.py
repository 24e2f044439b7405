"""Steps end at switches of time and state, also between impacts: closed forms, and SciPy, restarted at each event."""

from itertools import product

import casadi as ca
import numpy as np
import pytest
from conftest import in_turns
from faults import refused
from machines import ball
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import symmb as mb
from symmb.run.events import TimeSwitches

ULP = np.spacing(1.2345)


def oscillator(stiffness, gap, times, *others, **start):
    """x'' = -x with amplitude 1 against a wall of some stiffness at 1 - gap, and elements that do not act on it."""
    p = mb.Parameters(wall=1 - gap, k=stiffness)
    mass = mb.Body("mass", 1.0, pose=mb.Particle())
    push = -mass.x - ca.if_else(mass.x > p.wall, p.k * (mass.x - p.wall), 0)
    system = mb.System(mass, mb.Force("push", mass.point(0, 0), (push, 0)), *others, parameters=p)
    return mb.Scene(system, start={"mass.vx": 1.0, **start}, times=times, outputs={"x": mass.x})


def bouncing(stiffness, gap, times):
    """The closed form: pieces of two harmonic motions, about 0 and about the middle of the wall's spring."""
    wall, fast = 1 - gap, np.sqrt(1 + stiffness)
    x, v, begin, inside, values = 0.0, 1.0, 0.0, False, []
    times = list(times)
    while times:
        middle, rate = (stiffness * wall / (1 + stiffness), fast) if inside else (0.0, 1.0)
        amplitude, phase = np.hypot(x - middle, v / rate), np.arctan2(v / rate, x - middle)
        angle = np.arccos((wall - middle) / amplitude)
        turn = (phase + (angle if inside else -angle)) % (2 * np.pi)
        turn += 2 * np.pi if turn < 1e-9 else 0.0
        end = begin + turn / rate
        while times and times[0] <= end:
            values.append(middle + amplitude * np.cos(rate * (times.pop(0) - begin) - phase))
        x, v, begin, inside = wall, -amplitude * rate * np.sin(turn - phase), end, not inside
    return np.array(values)


@pytest.mark.parametrize("stiffness", [1e5, 1e6, 1e7])
@pytest.mark.parametrize("gap", [1e-3, 1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("solver", [None, mb.DormandPrince(), mb.DormandPrince(rtol=1e-11)], ids=repr)
def test_short_contacts_are_neither_missed_nor_wrong(stiffness, gap, solver):
    times = np.linspace(0, 20, 201)
    run = mb.simulate(oscillator(stiffness, gap, times), solver)
    atol = 1e-9 if solver and solver.rtol < 1e-9 else 1e-6
    assert_allclose(run["x"], bouncing(stiffness, gap, times), rtol=0, atol=atol)
    assert run.statistics["integrator"]["steps"] < 300


def test_contacts_that_begin_closed_cost_a_block_no_steps():
    p = mb.Parameters(draw=0.3, rate=2000.0, gap=0.0)
    pusher, load = (mb.Body(name, mass, pose=mb.Particle()) for name, mass in (("pusher", 0.1), ("load", 0.02)))
    spring = mb.Force("spring", pusher.point(0, 0), (-p.rate * pusher.x, 0))
    touch = mb.Contact("touch", load.point(0, 0), pusher.point(0, 0), (1, 0), mb.KelvinVoigt(5e5, 20.0))
    start = {"pusher.x": -p.draw, "load.x": -p.draw + p.gap}
    scene = mb.Scene(mb.System(pusher, load, spring, touch, parameters=p), start, [0.0, 0.002], {"v": load.vx})
    simulator = mb.DAESimulator(scene, mb.DormandPrince())

    def slope(t, x, rate):
        force = max(0.0, 5e5 * (x[0] - x[1]) + 20.0 * (x[2] - x[3])) if x[0] > x[1] else 0.0
        return [x[2], x[3], (-rate * x[0] - force) / 0.1, force / 0.02]

    corners = np.array([(draw, rate) for draw in (0.29, 0.31) for rate in (1900.0, 2100.0)])
    options = {"method": "LSODA", "rtol": 1e-9, "atol": 1e-12, "max_step": 1e-5}
    known = [solve_ivp(slope, (0, 0.002), [-d, -d, 0, 0], args=(r,), **options).y[3, -1] for d, r in corners]

    def steps(gap, atol):
        v = simulator.run(np.column_stack([corners, [gap] * 4])).Y[:, -1, 0]
        assert_allclose(v, known, rtol=0, atol=atol)
        return simulator.program.engine().counts.steps

    clear = steps(1e-5, 0.1)
    for gap in (0.0, 1e-17, -1e-17, 1e-12):
        assert steps(gap, 1e-5) < 1.5 * clear


def test_contacts_beside_a_part_of_a_large_scene_are_as_accurate():
    times = np.linspace(0, 20, 201)
    far = mb.Body("far", 1.0, pose=mb.Particle())
    scene = oscillator(1e6, 1e-5, times, far, mb.Force("away", far.point(0, 0), (-far.x, 0)), **{"far.x": 1e7})
    assert_allclose(mb.simulate(scene)["x"], bouncing(1e6, 1e-5, times), rtol=0, atol=1e-6)


@pytest.mark.parametrize(("solver", "count", "error"), [(mb.DormandPrince(), 201, 1e-6), (mb.Rosenbrock(), 41, 1e-3)])
def test_every_sample_of_a_study_has_its_own_contacts(solver, count, error):
    times, gaps = np.linspace(0, 20, count), np.geomspace(1e-2, 1e-5, 20)
    simulator = mb.DAESimulator(oscillator(1e6, 1e-3, times), solver)
    ensemble = simulator.run(np.column_stack([1 - gaps, np.full(20, 1e6)]))
    expected = [bouncing(1e6, gap, times) for gap in gaps]
    assert_allclose(ensemble.Y[:, :, 0], expected, rtol=0, atol=error)


def pushed(law, times=(0.0, 2.5, 5.0), **parameters):
    """A mass of 1 kg at 1 m/s under a force, a function of parameters and mass."""
    p = mb.Parameters(**parameters)
    mass = mb.Body("mass", 1.0, pose=mb.Particle())
    system = mb.System(mass, mb.Force("push", mass.point(0, 0), (law(p, mass), 0)), parameters=p)
    return mb.Scene(system, start={"mass.vx": 1.0}, times=times, outputs={"x": mass.x, "v": mass.vx})


BEGIN = 1.2345
PULSES = {
    "if_else": lambda p, m: ca.if_else(ca.logic_and(mb.t > BEGIN, mb.t < BEGIN + p.width), 1 / p.width, 0),
    "fabs": lambda p, m: ca.if_else(ca.fabs(mb.t - BEGIN - p.width / 2) < p.width / 2, 1 / p.width, 0),
    "sign": lambda p, m: (ca.sign(mb.t - BEGIN) - ca.sign(mb.t - BEGIN - p.width)) / (2 * p.width),
}


WIDTHS = [1e-3, 1e-5, 1e-7, 1e-9]


CONTROLLED = [
    mb.CVODES(), mb.CVODES(stiff=True), mb.IDAS(), mb.StabilizedIndex2(), mb.StateSpace(), mb.Rosenbrock(),
    mb.NSTIFFSI2(step=1.0, rtol=1e-9), mb.EventDriven(),
]  # fmt: skip
IMPULSES = *product([mb.DormandPrince()], [*PULSES, "Table"], WIDTHS), *in_turns(CONTROLLED, PULSES, [1e-3, 1e-6, 1e-8])


@pytest.mark.parametrize(("solver", "pulse", "width"), IMPULSES, ids=str)
def test_impulses_of_any_width(solver, pulse, width):
    table = mb.Table([0, BEGIN, BEGIN + width / 2, BEGIN + width, 10], [0, 0, 2 / width, 0, 0])
    run = mb.simulate(pushed(PULSES.get(pulse, lambda p, m: table(mb.t)), width=width), solver)
    error = 1e-6 + 4 * ULP / width
    assert_allclose(run["v"], [1, 2, 2], rtol=0, atol=error)
    assert_allclose(run["x"][-1], 5 + (5 - BEGIN - width / 2), rtol=0, atol=4 * error)


def test_two_pulses_within_one_step_and_pulses_of_uncertain_place():
    def law(p, m):
        first = ca.if_else(ca.logic_and(mb.t > p.begin, mb.t < p.begin + p.width), 1 / p.width, 0)
        late = p.begin + 1e-3
        return first - 2 * ca.if_else(ca.logic_and(mb.t > late, mb.t < late + p.width), 1 / p.width, 0)

    simulator = mb.DAESimulator(pushed(law, begin=1.0, width=1e-6), mb.DormandPrince())
    begins, widths = np.linspace(0.1, 4.9, 13), np.geomspace(1e-7, 1e-4, 13)
    ensemble = simulator.run(np.column_stack([begins, widths]))
    assert_allclose(ensemble.Y[:, -1, 1], 0.0, atol=1e-6)
    x = 1.0 * begins + 2.0 * 1e-3 + widths / 2 * (1 - 2)  # in the middle of the first and of the second pulse
    assert_allclose(ensemble.Y[:, -1, 0], x + widths / 2 * 2 - widths / 2, rtol=0, atol=2e-4)


def test_switches_at_the_start_and_at_the_end_of_the_run():
    scene = pushed(lambda p, m: ca.if_else(mb.t > 0, p.a, 100.0) + ca.if_else(mb.t < 5, 0, 1e6), a=1.0)
    assert_allclose(mb.simulate(scene, mb.DormandPrince())["v"], [1, 3.5, 6], atol=1e-8)


@pytest.mark.parametrize("friction", [2.0, 5.0])
def test_a_motion_that_sticks_is_an_error(friction):
    scene = pushed(lambda p, m: -p.mu * ca.sign(m.vx) + 3 * ca.sin(2 * mb.t), mu=friction)
    refused("sticks to a switch", mb.simulate, scene, error=mb.SimulationError)


def overdamped_stop(damping, length=1.0, time=1.0):
    """A mass against a stop, and its speed after it. In closed form, d'' + c d' + k d = 0 until d'' = 0."""
    stiffness, mass = 100.0, mb.Body("mass", 1.0, pose=mb.Particle())
    law = mb.KelvinVoigt(stiffness / time**2, damping / time)
    stop = mb.Contact("stop", mass.point(0, 0), mb.Ground().point(length, 0), (-1, 0), law)
    scene = mb.Scene(mb.System(mass, stop), start={"mass.vx": length / time}, times=[0.0, 8.0 * time])
    fast, slow = np.roots([1, damping, stiffness])
    contact = 2 * np.log(fast / slow) / (slow - fast)
    rate = (slow * np.exp(slow * contact) - fast * np.exp(fast * contact)) / (slow - fast)
    return scene, rate * length / time


SIZES = [(1.0, 1.0), (1e-6, 1e5), (1e6, 1e-5)]
"""Of length and time."""


@pytest.mark.parametrize("damping", [25.0, 50.0, 500.0])
@pytest.mark.parametrize("size", SIZES)
def test_an_overdamped_stop_does_not_stick(size, damping):
    """The force jumps when the contact begins."""
    scene, speed = overdamped_stop(damping, *size)
    assert_allclose(mb.simulate(scene)["mass.vx"][-1], speed, rtol=1e-5)


def test_sliding_without_sticking_is_as_by_scipy():
    times = np.linspace(0, 10, 101)
    scene = pushed(lambda p, m: -p.mu * ca.sign(m.vx) - 4 * m.x + 3 * ca.sin(2.7 * mb.t), times=times, mu=0.1)
    run = mb.simulate(scene, mb.DormandPrince())
    sign, t, y, states = 1.0, 0.0, np.array([0.0, 1.0]), [np.array([[0.0], [1.0]])]
    turned = lambda t, y: y[1]  # noqa: E731
    turned.terminal = True
    while t < 10:
        turned.direction = -sign
        rates = lambda t, y, sign=sign: [y[1], -0.1 * sign - 4 * y[0] + 3 * np.sin(2.7 * t)]  # noqa: E731
        some = times[(times > t)]
        piece = solve_ivp(rates, (t, 10), y, "DOP853", some, events=turned, rtol=1e-12, atol=1e-13)
        states.append(piece.y)
        if not piece.t_events[0].size:
            break
        t, y, sign = piece.t_events[0][0], piece.y_events[0][0], -sign
    expected = np.concatenate(states, axis=1)
    assert_allclose(run["x"], expected[0], rtol=0, atol=1e-7)


def test_switches_of_time_are_found_for_each_sample():
    p, t = ca.SX.sym("p", 2), ca.SX.sym("t")
    switches = ca.vertcat(t - p[0], 3 - p[1] * t, ca.sin(2 * np.pi * t) - 0.5, (t - 1.3) ** 2 - 1e-12, t - 20)
    found = TimeSwitches(switches, p, t, np.array([0.0, 2.0]))(np.array([[0.4, 2.0], [5.0, 4.0]]))
    waves = [1 / 12, 5 / 12, 13 / 12, 17 / 12]
    assert_allclose(found[0], sorted([0.4, 1.5, *waves, 1.3 - 1e-6, 1.3 + 1e-6]), rtol=1e-9)
    assert_allclose(found[1, :-1], sorted([0.75, *waves, 1.3 - 1e-6, 1.3 + 1e-6]), rtol=1e-9)
    assert np.isinf(found[1, -1])


@pytest.mark.parametrize("frequency", [3.0, 200.0, 1234.5])
def test_switches_of_time_that_oscillate_are_all_found(frequency):
    p, t = ca.SX.sym("p"), ca.SX.sym("t")
    found = TimeSwitches(ca.sin(2 * np.pi * p * t), p, t, np.array([0.0, 10.0]))(np.array([[frequency]]))[0]
    expected = np.arange(1, int(20 * frequency)) / (2 * frequency)
    inner = found[(found > 1e-6) & (found < 10 - 1e-6)]
    assert_allclose(inner, expected[expected < 10 - 1e-6], rtol=1e-9)


def test_impulses_between_impacts():
    push = ca.if_else(ca.logic_and(mb.t > BEGIN, mb.t < BEGIN + 1e-8), 1e8, 0)
    machine = ball(lambda m: (mb.Force("push", m.at, (push, 0)), mb.Impact("wall", 3 - m.ball.x, 1.0)), g=None)
    run = machine.run("x vx", [0.0, 1.0, 2.0, 4.0], {"ball.vx": 1.0})
    assert_allclose(run["vx"], [1, 1, 2, -2], rtol=0, atol=1e-6)
    assert_allclose(run["x"][-1], 3 - 2 * (4 - BEGIN - (3 - BEGIN) / 2), rtol=0, atol=1e-6)


def test_taylor_sees_impulses_of_fixed_time():
    scene = pushed(lambda p, m: p.size * ca.if_else(ca.logic_and(mb.t > BEGIN, mb.t < BEGIN + 1e-6), 1e6, 0), size=1.0)
    bounds = mb.propagate(scene, mb.Taylor(1), mb.Box(size=(0.5, 1.5)))
    assert_allclose([bounds.lower[-1, 1], bounds.upper[-1, 1]], [1.5, 2.5], rtol=0, atol=1e-6)


def test_tables_over_the_state_cost_no_step_ends_unless_they_are_steep():
    places = np.linspace(-2, 2, 201)
    smooth, steep = mb.Table(places, -places), mb.Table([-5, 2, 2 + 5e-7, 2 + 1e-6, 5], [0, 0, 2e6, 0, 0])
    times = np.linspace(0, 10, 51)
    run = mb.simulate(pushed(lambda p, m: smooth(m.x), times=times), mb.DormandPrince())
    assert_allclose(run["x"], np.sin(times), rtol=0, atol=1e-7)
    assert run.statistics["integrator"]["steps"] < 100
    run = mb.simulate(pushed(lambda p, m: steep(m.x)), mb.DormandPrince())
    assert_allclose(run["v"][1:], np.sqrt(3), rtol=0, atol=1e-6)


CURVES = [
    ([0, 0.5, 1], [0, 1, 0], 2 / 3),  # a parabola
    ([-2, 0, 0.5, 1, 3], [0, 0, 1, 0, 0], 1 / 2),  # level where it begins and ends
    ([0, 1, 2], [0, 1, 2], 2.0),  # a ramp
]
"""Places, heights and the area."""


@pytest.mark.parametrize("width", [1e-2, 1e-5])
@pytest.mark.parametrize("curve", CURVES)
def test_tables_that_are_narrow_as_a_whole_do_their_work(curve, width):
    knots, heights, area = curve
    table = mb.Table(2 + width * np.array(knots), np.array(heights) / width)
    run = mb.simulate(pushed(lambda p, m: ca.if_else(m.x < 2 + 2 * width, table(m.x), 0)), mb.DormandPrince())
    assert_allclose(run["v"][1:], np.sqrt(1 + 2 * area), rtol=0, atol=1e-6)


GRAVITY, RESTITUTION, ZONE = 9.81, 0.8, 0.5
TIMES = np.linspace(0, 3, 31)


def falling(force, times=TIMES):
    """A ball that falls from 1 m and bounces, under a force of its body and the parameters."""
    body = mb.Body("ball", 1.0, pose=mb.Particle())
    p = mb.Parameters(work=2.0)
    push = mb.Force("push", body.point(0, 0), (0, force(body, p) - GRAVITY))
    system = mb.System(body, push, mb.Impact("floor", body.y, restitution=RESTITUTION), parameters=p)
    return mb.Scene(system, {"ball.x": 0.0, "ball.y": 1.0}, times, {"y": body.y, "v": body.vy}, name="ball")


def zone(width):
    """A force that does a work over a width, upwards."""
    return falling(lambda b, p: ca.if_else(ca.logic_and(b.y > ZONE, b.y < ZONE + width), p.work / width, 0))


def exact(work, width, times=TIMES):
    """Positions and velocities: parabolas from edge to edge of the zone and from impact to impact."""
    t, y, v, pieces = 0.0, 1.0, 0.0, []
    while t < times[-1]:
        inside = ZONE < y < ZONE + width or (y == ZONE and v > 0) or (y == ZONE + width and v < 0)
        a = (work / width if inside else 0.0) - GRAVITY
        pieces.append((t, y, v, a))
        ways = [(time, edge) for edge in (0.0, ZONE, ZONE + width) for time in passes(y - edge, v, a)]
        ahead, y = min(ways)
        t, v = t + ahead, v + a * ahead
        v = -RESTITUTION * v if y == 0.0 else v
    begin, y, v, a = np.array([next(p for p in reversed(pieces) if p[0] <= now) for now in times]).T
    ahead = times - begin
    return y + v * ahead + a * ahead**2 / 2, v + a * ahead


def passes(y, v, a):
    """Times at which y + v t + a t^2 / 2 is 0 after the start."""
    square = v**2 - 2 * a * y
    roots = [(-v + sign * np.sqrt(square)) / a for sign in (-1, 1)] if square >= 0 else []
    return [t for t in roots if t > 1e-12 or (y != 0 and t > 0)]


@pytest.mark.parametrize("work", [2.0, -2.0, 3.0])
@pytest.mark.parametrize("width", [1e-3, 1e-6, 1e-9])
def test_narrow_zones_do_their_work_between_impacts(width, work):
    run = mb.simulate(zone(width), parameters={"work": work})
    y, v = exact(work, width)
    near = 1e-6 + 4 * np.spacing(1.0) / width
    assert "EventDriven" in run.solver and len(run.events) >= 6
    np.testing.assert_allclose(run["y"], y, atol=near)
    np.testing.assert_allclose(run["v"], v, atol=near)


def test_samples_pass_zones_at_their_own_times():
    works = np.linspace(-3, 4, 11)
    Y = mb.DAESimulator(zone(1e-6)).run(works[:, None]).Y
    for values, work in zip(Y, works, strict=True):
        np.testing.assert_allclose(values.T, exact(work, 1e-6), atol=1e-6)


def test_a_motion_that_sticks_to_a_switch_between_impacts_ends_with_the_reason():
    rough = falling(lambda b, p: ca.if_else(b.y < ZONE, -20 * ca.sign(b.vy), 0))
    refused("switch", mb.simulate, rough, error=mb.SimulationError)


def test_bounces_on_a_floor_behind_an_elastic_layer():
    stiff = 1e4
    run = mb.simulate(falling(lambda b, p: ca.if_else(b.y < 0.1, stiff * (0.1 - b.y), 0)))
    weak = GRAVITY / stiff
    speed = np.sqrt(2 * GRAVITY * 0.9)
    depth = weak + np.sqrt(weak**2 + speed**2 / stiff)
    assert depth < 0.1 and not run.events
    omega = np.sqrt(stiff)
    in_layer = 2 * (np.pi - np.arctan(speed / (omega * weak))) / omega
    fall = np.sqrt(2 * 0.9 / GRAVITY)
    now = TIMES % (2 * fall + in_layer)
    flying = (now < fall) | (now > fall + in_layer)
    ahead = np.where(now < fall, now, 2 * fall + in_layer - now)[flying]
    np.testing.assert_allclose(run["y"][flying], 1 - GRAVITY * ahead**2 / 2, atol=1e-6)
