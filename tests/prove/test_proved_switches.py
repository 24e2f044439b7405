"""Motions with switches of the state and sampled controllers, against closed forms and runs that restart at each."""

import casadi as ca
import numpy as np
import pytest
import switch_proofs
from black_boxes import quietly
from enclosure_samples import require_sharp
from machines import ball, pendulum
from mechanisms import exact
from scipy.interpolate import PchipInterpolator

import symmb as mb
from symmb.prove.problem import Phase

TIMES = np.linspace(0.0, 1.0, 21)


def doubted(law, start, nominal, box, order=6, times=TIMES):
    """Bounds of a mass of 1 kg, and the text of its doubts."""
    scene = quietly(switch_proofs.mass, times, law, start, nominal)
    bounds = quietly(mb.propagate, scene, mb.TaylorModel(order=order), mb.Box(**box))
    return bounds, " ".join(bounds.doubts)


def proved(*args, **options):
    """Bounds without doubts."""
    bounds, text = doubted(*args, **options)
    assert not text
    return bounds


def test_a_force_that_begins_at_a_place():
    """x = v t up to a / v, and a constant force F from then on."""
    law = lambda p, x, v, t: ca.if_else(x > p.a, -p.F, 0)  # noqa: E731
    bounds = proved(law, (0.0, 1.5), {"a": 0.5, "F": 2.0}, {"a": (0.48, 0.52), "F": (1.9, 2.1)})
    a, F = (own.reshape(-1, 1) for own in np.meshgrid(np.linspace(0.48, 0.52, 33), [1.9, 2.0, 2.1]))
    late = np.maximum(TIMES - a / 1.5, 0.0)
    require_sharp(bounds, np.stack([1.5 * TIMES - F * late**2 / 2, 1.5 - F * late, -F * (late > 0)], 2), 1e-12, 2e-3)


def test_a_place_that_is_no_polynomial_of_the_parameter():
    """The time of the pass, exp(2 a) / 1.5, errs by more than all else: v = 1.5 - 4 (t - exp(2 a) / 1.5)."""
    law = lambda p, x, v, t: ca.if_else(x > ca.exp(2 * p.a), -4.0, 0)  # noqa: E731
    bounds = proved(law, (0.0, 1.5), {"a": -0.2}, {"a": (-0.3, -0.1)}, order=2, times=np.array([0.0, 0.9, 1.0]))
    a = np.linspace(-0.3, -0.1, 101)[:, None]
    late = bounds.t[1:] - np.exp(2 * a) / 1.5
    for k, runs in enumerate((1.5 * bounds.t[1:] - 2 * late**2, 1.5 - 4 * late)):
        assert (bounds.lower[1:, k] <= runs.min(axis=0)).all() and (runs.max(axis=0) <= bounds.upper[1:, k]).all()
        assert (bounds.upper[1:, k] - bounds.lower[1:, k] - np.ptp(runs, axis=0) < 2e-2).all()


def test_friction_that_reverses():
    """v = v0 - (3 + mu) t, and -(3 - mu) (t - t0) behind the reversal at t0."""
    bounds = proved(lambda p, x, v, t: -3.0 - p.mu * ca.sign(v), (0.0, 2.0), {"mu": 1.0}, {"mu": (0.95, 1.05)})
    mu = np.linspace(0.95, 1.05, 201)[:, None]
    t0 = 2.0 / (3.0 + mu)
    before, late = np.minimum(TIMES, t0), np.maximum(TIMES - t0, 0.0)
    place = 2.0 * before - (3 + mu) * before**2 / 2 - (3 - mu) * late**2 / 2
    runs = np.stack([place, 2.0 - (3 + mu) * before - (3 - mu) * late, -3.0 - mu * np.sign(t0 - TIMES)], 2)
    require_sharp(bounds, runs, 1e-12, 2e-3)


def test_a_law_of_time_that_parameters_move():
    bounds = proved(lambda p, x, v, t: ca.if_else(t > p.s, 1.0, 0.0), (0.0, 0.0), {"s": 0.4}, {"s": (0.37, 0.42)})
    late = np.maximum(TIMES - np.linspace(0.37, 0.42, 101)[:, None], 0.0)
    require_sharp(bounds, np.stack([late**2 / 2, late, 1.0 * (late > 0)], 2), 1e-12, 1e-3)


def test_knots_of_a_table():
    """A force that a monotone cubic through points gives, at t = 0.2 s and 0.6 s from one piece to the next."""
    places, forces = [-1.0, 0.3, 0.9, 2.0], [0.0, 0.0, 1.2, 0.1]
    table, curve = mb.Table(places, forces), PchipInterpolator(places, forces).antiderivative()
    bounds = proved(lambda p, x, v, t: p.k * table(1.5 * t), (0.0, 1.5), {"k": 1.0}, {"k": (0.9, 1.1)})
    v = (curve(1.5 * TIMES) - curve(0.0)) / 1.5  # k times it
    for k, found in ((0.9, bounds.lower[:, 1]), (1.1, bounds.upper[:, 1])):
        np.testing.assert_allclose(found, 1.5 + k * v, atol=1e-9)


def test_switches_that_are_passed_together():
    """Two laws of one place, written in different ways, and one of time at the same time."""

    def law(p, x, v, t):
        return ca.if_else(x > 0.5, p.F, 0) + ca.if_else(3 * x - 1.5 > 0, 1, 0) - ca.if_else(t > 0.5, 2, 0)

    bounds = proved(law, (0.0, 1.0), {"F": 2.0}, {"F": (1.9, 2.1)})
    late, F, inner = np.maximum(TIMES - 0.5, 0.0), np.array([[1.9], [2.0], [2.1]]), TIMES != 0.5
    runs = np.stack([TIMES + (F - 1) * late**2 / 2, 1 + (F - 1) * late, (F - 1) * (late > 0)], 2)[:, inner]
    assert (bounds.lower[inner] <= runs.min(axis=0) + 1e-12).all()
    np.testing.assert_allclose(bounds.lower[inner], runs.min(axis=0), atol=1e-9)
    np.testing.assert_allclose(bounds.upper[inner], runs.max(axis=0), atol=1e-9)


@pytest.mark.parametrize(
    ("law", "nominal", "box", "until", "message"),
    [
        # v = 1 - 2 t up to 0.5 s, when the friction holds the mass
        (lambda p, x, v, t: -1.0 - p.mu * ca.sign(v), {"mu": 1.5}, {"mu": (1.4, 1.6)}, 1 / 2.6, "m.vx"),
        # it is highest, x = 1 / (2 F), at the place of the spring for some F
        (lambda p, x, v, t: -p.F + ca.fmax(x - 0.5, 0), {"F": 1.0}, {"F": (0.98, 1.02)}, 0.9, "m.x"),
        # two places are one for some parameters
        (lambda p, x, v, t: (x > p.a) + ca.if_else(x > 0.5, 2, 0), {"a": 0.5}, {"a": (0.49, 0.51)}, 0.49, "(a-m.x)"),
    ],
    ids=["sticks", "grazes", "together"],
)  # fmt: skip
def test_what_is_not_passed_by_all_of_the_box_ends_the_proof(law, nominal, box, until, message):
    bounds, text = doubted(law, (0.0, 1.0), nominal, box)
    finite = np.isfinite(bounds.upper).all(axis=1)
    np.testing.assert_array_equal(finite, (until - 0.1 < TIMES) & finite | (TIMES <= until - 0.1))
    assert finite[TIMES <= until - 0.1].all() and not finite[TIMES >= until + 0.15].any()
    assert "the equations have kinks or jumps" in text and message in text


def test_what_samples_do_not_see_is_not_proved():
    """A narrow band of a force, and a place that only a corner of the box reaches: no node lies in either."""
    band = lambda p, x, v, t: ca.if_else((x - 0.5) ** 2 < 1e-6, p.F, 0)  # noqa: E731
    bounds, text = doubted(band, (0.0, 1.0), {"F": 200.0}, {"F": (190.0, 210.0)})
    for F in (190.0, 210.0):
        last = np.sqrt(1 + 2 * F * 2e-3)  # behind the band
        assert bounds.lower[-1, 1] <= last <= bounds.upper[-1, 1]
    assert "'(sq((m.x-0.5))-1e-06)' changes its sign once for the whole box" in text

    corner = lambda p, x, v, t: -p.F - 1000 * (x > 0.5095)  # noqa: E731
    bounds, text = doubted(corner, (0.0, 1.0), {"F": 1.0}, {"F": (0.98, 1.02)})
    early = (1 - np.sqrt(1 - 2 * 0.98 * 0.5095)) / 0.98  # when the mass with 0.98 N comes there
    assert 0.9 < bounds.t[np.isfinite(bounds.upper[:, 0])][-1] <= early
    assert "(0.5095-m.x)" in text and "change its sign only for a part of the box" in text


@pytest.mark.parametrize(
    ("law", "v", "a"),
    [
        (lambda p, x, v, t: ca.if_else(t > 0, p.F, 0), 0.0, lambda F: F),
        (lambda p, x, v, t: p.F * ca.if_else(x > 0, 1, 2), 1.0, lambda F: F),
        (lambda p, x, v, t: p.F * ca.if_else(x > 0, 1, 2), -1.0, lambda F: 2 * F),
        (lambda p, x, v, t: 1.5 - p.F * ca.sign(v), 0.0, lambda F: 1.5 - F),
        (lambda p, x, v, t: p.F * ca.fmax(x, 0) * ca.if_else(t >= 0, 0, 1) + p.F * ca.sign(v), 0.5, lambda F: F),
    ],
    ids=["step", "up", "down", "slips", "two"],
)
def test_motions_that_begin_on_switches_and_leave_them(law, v, a):
    """x = v t + a t^2 / 2 at a time; at the first time an acceleration may be that of either side."""
    times = np.linspace(0.0, 0.45, 10)
    bounds = proved(law, (0.0, v), {"F": 1.0}, {"F": (0.9, 1.1)}, times=times)
    runs = [np.stack([v * times + a(F) * times**2 / 2, v + a(F) * times], 1) for F in (0.9, 1.0, 1.1)]
    for own, extreme in ((bounds.lower, np.min), (bounds.upper, np.max)):
        np.testing.assert_allclose(own[:, :2], extreme(runs, axis=0), atol=1e-12)
    known = np.sort([[a(0.9)], [a(1.1)]], axis=0)
    np.testing.assert_allclose([bounds.lower[1:, 2], bounds.upper[1:, 2]], known + 0 * times[1:])


def test_a_proof_that_ends_at_a_switch_tells_when():
    phase = Phase(*[ca.Function()] * 3, np.ones(1), ("m.x",), "jumps", begin=2.0)
    assert "jumps at t = 2.25 s" in phase.sentence(0, 0.25, "")


def test_a_motion_that_sticks_at_the_start_is_not_proved():
    bounds, text = doubted(lambda p, x, v, t: 0.5 - p.F * ca.sign(v), (0.0, 0.0), {"F": 1.0}, {"F": (0.9, 1.1)})
    assert "its value may be 0 when the motion begins" in text and not np.isfinite(bounds.upper[1:]).any()


@pytest.mark.parametrize("seed", [0, 1002, 8, 4])
def test_random_scenes_against_runs_that_restart(seed):
    """A draw of tests/benchmarks."""
    wrong, share, excess, _, text = switch_proofs.judged(seed, 20, order=5)
    assert not wrong and share == 1 and (excess < 0.05).all(), text


@pytest.mark.parametrize("begin", [0.0, -0.7, 1.3])
def test_a_brake_with_a_held_force(begin):
    """At an instant, outputs have the new value: both outputs at and between instants are compared."""
    brake = lambda m: mb.Sampled("brake", period=0.1, law=-m.p.k * m.ball.vx)  # noqa: E731
    cart = ball(brake, lambda m: mb.Force("push", m.at, (m.brake.value, 0)), g=None, k=2.0, v=8.0)
    times, outputs = np.linspace(0, 1, 21), {"v": cart.ball.vx, "x": cart.ball.x, "force": cart.brake.value}
    scene = cart.scene(outputs, begin + times, {"ball.vx": cart.p.v}, box=mb.Box(k=(1.9, 2.1), v=(7.9, 8.1)))
    runs = []
    for k in np.linspace(1.9, 2.1, 21):
        for v in (7.9, 8.0, 8.1):
            number = np.floor(times / 0.1 + 1e-9)
            late, rest = times - 0.1 * number, (1 - 0.1 * k) ** number
            x = v * (1 - rest) / k * (1 - 0.05 * k)  # the sum of v_i T (1 - k T / 2) with v_i = v (1 - k T)^i
            places = x + v * rest * (late - k * late**2 / 2)
            runs.append(np.stack([v * rest * (1 - k * late), places, -k * v * rest], 1))
    require_sharp(mb.propagate(scene, mb.TaylorModel(order=5)), runs, 1e-10, 1e-7)


def test_a_pendulum_with_two_controllers_of_different_periods():
    """A law of angle, rate and time, and one that sums up the angle, of its own last value."""

    def controlled(m):
        sum_of = mb.Sampled("sum", period=0.15, law=lambda held: held - m.rod.theta)
        pd = mb.Sampled("pd", period=0.1, law=-m.p.k * m.rod.theta - 3.0 * m.rod.omega + mb.t + sum_of.value)
        return sum_of, pd, mb.Torque("motor", m.rod, pd.value)

    arm, times = pendulum(controlled, length=0.5, k=20.0, angle=0.5), np.linspace(0, 0.9, 10)
    outputs = {"angle": arm.rod.theta, "rate": arm.rod.omega, "torque": arm.pd.value, "sum": arm.sum.value}
    box = mb.Box(k=(19.9, 20.1), angle=(0.495, 0.505))
    scene = arm.scene(outputs, times, {"rod.theta": arm.p.angle, "rod.omega": 0.0}, box=box)
    runs = []
    for k in (19.9, 20.0, 20.1):
        for angle in (0.495, 0.5, 0.505):
            z, held, sum_, rows = np.array([angle, 0.0]), 0.0, 0.0, []
            for n in range(19):  # instants of either are multiples of 0.05 s
                if n % 3 == 0:
                    sum_ = sum_ - z[0]
                if n % 2 == 0:
                    held = -k * z[0] - 3.0 * z[1] + 0.05 * n + sum_
                    rows.append([*z, held, sum_])
                z = exact(lambda t, z, u=held: [z[1], (u - 9.81 * 0.5 * np.cos(z[0])) / 0.35], z, (0, 0.05))[-1]
            runs.append(rows)
    require_sharp(mb.propagate(scene, mb.TaylorModel(order=4)), runs, 1e-10, 1e-4)
