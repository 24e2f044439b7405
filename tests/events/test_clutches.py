"""Clutches and brakes that slip and stick, against closed forms."""

import casadi as ca
import drives
import numpy as np
import pytest
from faults import refused
from machines import GROUND, ORIGIN, run_of, wheel
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import symmb as mb

TIMES = np.linspace(0.0, 3.0, 13)


def braked(capacity, load, *, omega=0.0, p=None, ratio=1.0, more=(), box=None, outputs=None):
    """A wheel under a torque, with a brake."""
    disc = mb.Body("wheel", 1.0, 2.0)
    shaft = mb.Revolute("shaft", ORIGIN, disc.point(0, 0))
    brake = mb.Clutch("brake", GROUND, disc, capacity, ratio)
    more = [element(disc, shaft) for element in more]
    system = mb.System(disc, shaft, brake, mb.Torque("load", disc, load), *more, parameters=p)
    outputs = outputs(brake) if outputs else {"w": disc.omega, "torque": system.lam("brake")}
    return mb.Scene(system, {"wheel.omega": omega}, TIMES, outputs, box)


def happened(run):
    return [(event.name, event.what, round(event.time, 9)) for event in run.events]


def test_a_brake_stops_a_wheel_and_lets_it_go():
    """The load rises as 2 t. The brake of 4 N m holds it up to 1.3 times that, at 2.6 s."""
    run = mb.simulate(braked(4.0, 2 * mb.t, omega=1.75, ratio=1.3))
    # 2 w' = 2 t - 4: w = 1.75 + t^2 / 2 - 2 t is 0 at 2 - sqrt(0.5)
    stop = 2 - np.sqrt(0.5)
    assert [event[:2] for event in happened(run)] == [("brake", "closes"), ("brake", "opens")]
    assert_allclose([event.time for event in run.events], (stop, 2.6), atol=1e-12)
    t, after = run.t, np.maximum(run.t, 2.6)
    falls = 1.75 + t**2 / 2 - 2 * t
    assert_allclose(run["w"], np.where(t < stop, falls, (after**2 - 2.6**2) / 2 - 2 * (after - 2.6)), atol=1e-10)
    assert_allclose(run["torque"], np.where((t > stop) & (t < 2.6), 2 * t, 0.0), atol=1e-12)
    assert abs(run.events[0].work) < 1e-20 and run.energy_drift < 1e-9 and not run.doubts


def test_starts_without_slip():
    for load, events, slope in ((3.0, [], 0.0), (4.0, [], 0.0), (-6.0, [("brake", "opens", 0.0)], -1.0)):
        run = mb.simulate(braked(4.0, load))
        assert happened(run) == events
        assert_allclose(run["w"], slope * run.t, atol=1e-12)


def test_a_slip_that_goes_through_changes_its_direction_at_once():
    run = mb.simulate(braked(4.0, -9.0, omega=6.5))
    assert happened(run) == [("brake", "closes", 1.0), ("brake", "opens", 1.0)]
    assert_allclose(run["w"], np.where(run.t < 1, 6.5 - 6.5 * run.t, -2.5 * (run.t - 1)), atol=1e-12)


def test_capacities_that_are_zero_rise_or_are_negative():
    run = mb.simulate(braked(0.0, -2 * ca.cos(mb.t), omega=0.5))
    assert_allclose(run["w"], 0.5 - np.sin(run.t), atol=1e-10)
    run = mb.simulate(braked(3 * mb.t, 2.0))
    assert happened(run) == [("brake", "opens", 0.0), ("brake", "closes", round(4 / 3, 9))]
    assert_allclose(run["w"], np.where(run.t < 4 / 3, run.t - 0.75 * run.t**2, 0.0), atol=1e-12)
    run = mb.simulate(braked(4.0 - 4 * mb.t, 0.5))  # it slips from 0.875 s on, and nothing brakes from 1 s on
    u = np.clip(run.t, 0.875, 1.0) - 0.875
    assert_allclose(run["w"], u**2 + np.maximum(run.t - 1, 0) / 4, atol=1e-10)


def test_a_pulse_of_time_is_not_passed_over():
    pulse = ca.if_else(ca.logic_and(mb.t > 1, mb.t < 1.001), 50.0, 1.0)
    assert happened(mb.simulate(braked(5.0, pulse))) == [("brake", "opens", 1.0), ("brake", "closes", 1.01225)]


def agrees(scene, reference):
    run, (values, events) = mb.simulate(scene), reference
    assert [(event.name, event.what) for event in run.events if event.time > 0] == [event[:2] for event in events]
    assert_allclose([event.time for event in run.events if event.time > 0], [event[2] for event in events], atol=1e-9)
    assert_allclose(run.values, values, atol=1e-9)


def test_a_brake_at_rest_slips_for_a_moment():
    """Nothing moves before, so that steps are long, and the torque is little above the capacity."""
    agrees(*drives.motor(np.random.default_rng(216), True))


def test_a_pendulum_turns_back_against_its_brake():
    agrees(*drives.pendulums(np.random.default_rng(5), [(-1, 0)], 1))


@pytest.mark.long
def test_steps_pass_the_instant_at_which_a_clutch_lets_go(monkeypatch):
    """Steps may end just before it, again and again, if they take the laws of time behind it."""
    monkeypatch.setattr(drives, "TIMES", np.array([0.0, 1.2]))
    agrees(*drives.press(np.random.default_rng(201)))


def test_two_clutches_in_a_row_stick_at_once():
    a, b, c = shafts = [mb.Body(name, 1.0, inertia) for name, inertia in (("a", 1.0), ("b", 2.0), ("c", 3.0))]
    pins = [mb.Revolute(f"pin_{e.name}", ORIGIN, e.point(0, 0)) for e in shafts]
    clutches = mb.Clutch("c0", a, b, 4.0), mb.Clutch("c1", b, c, 3.0)
    start = {"a.omega": 6.0, "b.omega": 1.5, "c.omega": 1.0}
    run = run_of(*shafts, *pins, *clutches, start=start, times=[0.0, 0.5, 2.0])
    assert happened(run) == [("c0", "closes", 1.0), ("c1", "closes", 1.0)]
    speeds = [run[f"{name}.omega"] for name in "abc"]
    assert_allclose(np.transpose(speeds), [(6, 1.5, 1), (4, 1.75, 1.5), (2, 2, 2)], atol=1e-12)


def test_a_brake_on_a_shaft_that_a_motion_drives():
    """It cannot stick where the speed changes its sign, whatever its capacity."""
    scene = braked(2.0, 0.0, omega=1.0, more=[lambda wheel, shaft: mb.Motion("motion", shaft.angle, ca.sin(mb.t))])
    run = mb.simulate(scene)
    assert happened(run) == [("brake", what, round(np.pi / 2, 9)) for what in ("closes", "opens")]
    assert_allclose(-run(scene.system.lam("motion")), -2 * np.sin(run.t) + 2 * np.sign(np.cos(run.t)), atol=1e-6)


def test_a_brake_takes_over_from_a_weld_that_opens():
    machine = wheel(
        lambda m: (mb.Weld("weld", ORIGIN, m.at), mb.Clutch("brake", GROUND, m.wheel, 2.0)),
        lambda m: (mb.Release(m.weld, mb.t > 1), mb.Torque("load", m.wheel, 3.0)), inertia=2.0,
    )  # fmt: skip
    run = machine.run("omega", TIMES)
    assert happened(run) == [("weld", "opens", 1.0), ("brake", "opens", 1.0)]
    assert_allclose(run["omega"], np.maximum(run.t - 1, 0) / 2, atol=1e-9)


def test_samples_stick_at_times_of_their_own():
    p = mb.Parameters(capacity=4.0, load=1.0)
    box = mb.Box(capacity=(3.0, 6.0), load=(0.5, 1.0))
    inputs = {"omega": 2.9, "p": p, "box": box}
    scene = braked(p.capacity, p.load, **inputs)  # nothing happens at an output time

    def speed(capacity, load):
        return np.maximum(2.9 - (capacity - load) / 2 * TIMES, 0)

    swept = mb.sweep(scene, {"capacity": np.linspace(3, 6, 5)})
    for values, capacity in zip(swept.values, np.linspace(3, 6, 5), strict=True):
        assert_allclose(values[:, 0], speed(capacity, 1.0), atol=1e-12)
    assert_allclose(mb.propagate(scene, mb.Vertex())["w"], (speed(6.0, 0.5), speed(3.0, 1.0)), atol=1e-12)
    figures = braked(p.capacity, p.load, outputs=lambda brake: {"t": mb.first_time(brake.closed > 0.5)}, **inputs)
    assert_allclose(mb.propagate(figures, mb.PolynomialChaos(order=8))["t"], (5.8 / 5.5, 2.9), rtol=1e-4)


def test_a_run_goes_on_with_its_clutches():
    scene = braked(4.0, 1.0, omega=3.0)
    run = mb.simulate(scene.with_times([0.0, 2.5]))
    longer = mb.simulate(scene.starting_at(run))
    assert len(run.events) == 1 and longer.events == ()
    assert_allclose(longer["w"], 0.0, atol=1e-12)
    half = mb.simulate(scene.with_times([0.0, 1.0]))
    assert_allclose(mb.simulate(scene.starting_at(half)).events[0].time, 2.0, atol=1e-12)


@pytest.mark.parametrize("e", [0.5, None])
def test_no_clutch_passes_on_an_impulse(e):
    """Two wheels turn together at 1 rad/s until one is struck, or held. Behind it 2 N m bring them together again."""
    a, b = mb.Body("a", 1.0, 1.0), mb.Body("b", 1.0, 2.0)
    pins = [mb.Revolute(f"pin_{wheel.name}", ORIGIN, wheel.point(0, 0)) for wheel in (a, b)]
    strikes = [mb.Stop("stop", pins[1], upper=1.0, restitution=e)]
    if e is None:
        weld = mb.Weld("weld", ORIGIN, b.point(0, 0))
        strikes = [weld, mb.Latch(weld, b.theta > 1)]
    elements = a, b, *pins, mb.Clutch("clutch", a, b, 2.0), *strikes
    run = run_of(*elements, start={"a.omega": 1.0, "b.omega": 1.0}, times=[0.0, 1.25, 1.5, 3.0])
    first = ("weld", "closes", 1.0) if e is None else ("stop.upper", "impact", 1.0)
    assert happened(run) == [first, ("clutch", "opens", 1.0), ("clutch", "closes", 1.5)]
    assert_allclose(run.events[0].work, -1.0 if e is None else -0.75, atol=1e-12)
    assert_allclose(run["a.omega"], [1, 0.5, 0, 0], atol=1e-12)
    assert_allclose(run["b.omega"], [1, *([0, 0, 0] if e is None else [-0.25, 0, 0])], atol=1e-12)


def test_an_impulse_turns_the_slip():
    """A wheel that a brake slows from 3 to 2 rad/s strikes a stop, turns back, and is slowed again until it rests."""
    scene = braked(4.0, 0.0, omega=3.0, more=[lambda wheel, shaft: mb.Stop("stop", shaft, None, 1.25, restitution=0.5)])
    run = mb.simulate(scene)
    of_brake = [("brake", "closes", 0.5), ("brake", "opens", 0.5), ("brake", "closes", 1.0)]
    assert happened(run) == [("stop.upper", "impact", 0.5), *of_brake]
    off = run.t != 0.5  # rounding decides on which side of the impact that output is
    exact = np.where(run.t < 0.5, 3 - 2 * run.t, np.minimum(2 * run.t - 2, 0))
    assert_allclose(run["w"][off], exact[off], atol=1e-12)


def test_faults_are_told():
    for arguments, text in (
        (lambda m: (GROUND, m.wheel, -1.0), "capacity is -1; it must be at least 0"),
        (lambda m: (GROUND, m.wheel, 1.0, 0.9), "static_ratio is 0.9; it must be at least 1"),
        (lambda m: (GROUND, GROUND, 1.0), "so the element has no effect"),
        (lambda m: (m.shaft, m.wheel, 1.0), "expected a body, got Revolute"),
        (
            lambda m: (GROUND, m.wheel, ca.if_else(m.wheel.omega >= 0, 1e4, 0)),
            "capacity jumps when the slip changes its sign",
        ),
        (
            lambda m: (GROUND, m.wheel, 2 + mb.t + ca.sign(m.wheel.omega)),
            "capacity jumps when the slip changes its sign",
        ),
    ):
        refused(f"Clutch 'brake': .*{text}", wheel, lambda m, of=arguments: mb.Clutch("brake", *of(m)))


@pytest.mark.parametrize(
    "law",
    [
        lambda wheel: 1 + ca.exp(-ca.fabs(wheel.omega) / 1e-3),
        lambda wheel: ca.if_else(wheel.theta > 1, 2.0, 1.0),
        lambda wheel: ca.if_else(wheel.omega > 2, 2.0, 1.0),
        lambda wheel: 1 + ca.tanh(wheel.omega / 1e-2),
    ],
)
def test_capacities_may_bend_at_the_slip_and_jump_elsewhere(law):
    wheel(lambda m: mb.Clutch("brake", GROUND, m.wheel, law(m.wheel)))


@pytest.mark.parametrize(("load", "limit"), [(0.0, 0.0), (-0.2, 0.0), (-0.2, 0.15)])
def test_a_freewheel_lets_go_where_its_torque_turns_round(load, limit):
    """A Weld with a Latch by speed, in 40 samples: the wheel is never slower than the shaft, and runs down by itself.

    At the instant of the Release, slip and its rate are 0 but for rounding, from where the Latch must not close.
    """
    p = mb.Parameters(drag=0.05)
    a, b = (mb.Body(name, 1.0, inertia, mb.Planar()) for name, inertia in (("a", 0.01), ("b", 0.1)))
    shafts = [mb.Revolute(f"shaft_{x.name}", mb.Ground().point(0, 0), x.point(0, 0)) for x in (a, b)]
    drive = mb.Motion("drive", shafts[0].angle, 0.5 * (1 - ca.cos(6 * mb.t)))
    lock = mb.Weld("lock", a.point(0, 0), b.point(0, 0))
    events = mb.Latch(lock, a.omega - b.omega > 0), mb.Release(lock, lambda on_b: on_b.tz < -limit)
    torque = mb.Torque("torque", b, load - p.drag * b.omega)
    times = np.linspace(0, 0.7, 71)
    system = mb.System(a, b, *shafts, lock, *events, drive, torque, parameters=p)
    drags = [{"drag": c} for c in np.linspace(0.04, 0.06, 40)]
    run = mb.simulate(mb.Scene(system, {}, times, {"b": b.omega}), parameters=drags)
    for c, omega in zip(np.linspace(0.04, 0.06, 40), run["b"], strict=True):
        speed, rate = (lambda t: 3 * np.sin(6 * t)), (lambda t: 18 * np.cos(6 * t))
        lets_go = brentq(lambda t: 0.1 * rate(t) + c * speed(t) - load + limit, 0.2, 0.5)  # noqa: B023
        at, end = times - lets_go, load / c
        free = end + (speed(lets_go) - end) * np.exp(-c / 0.1 * at)
        assert_allclose(omega, np.where(at < 0, speed(times), free), atol=1e-9)
