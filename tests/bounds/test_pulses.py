"""Pulses and switches of time that parameters move: bounds are right, or they are doubtful."""

import casadi as ca
import numpy as np
import pytest
from black_boxes import black_box_bounds, errors_of, quietly, unit_bounds
from faults import warned
from machines import ball
from numpy.testing import assert_allclose

import symmb as mb

pytestmark = pytest.mark.usefixtures("optimised")


def hit(law, nominal, times=(0.0, 4.0, 8.0)):
    """A mass of 1 kg at rest under a force, a function of parameters."""
    machine = ball(lambda m: mb.Force("push", m.at, (law(m.p), 0)), g=None, **nominal)
    return machine.scene({"v": machine.ball.vx}, times)


def agnesi(p):
    """A pulse with the integral 1, which no operation with a front makes."""
    return 2 / (np.pi * p.width) / (1 + ((mb.t - 2) / p.width) ** 2) ** 2


def test_taylor_tells_of_switches_of_time_that_parameters_move():
    scene = hit(lambda p: ca.if_else(mb.t > p.begin, 1.0, 0.0), {"begin": 3.9})
    warned("kinks or jumps", mb.propagate, scene, mb.Taylor(), mb.Box(begin=(3.6, 4.2)))


def test_taylor_says_nothing_of_switches_of_time_that_stay():
    scene = hit(lambda p: p.force * ca.if_else(mb.t > 3.9, 1.0, 0.0), {"force": 1.0})
    bounds = mb.propagate(scene, mb.Taylor(), mb.Box(force=(0.9, 1.1)))
    assert not bounds.caution
    assert_allclose(bounds.upper[-1], 1.1 * 4.1, rtol=1e-7)


@pytest.mark.parametrize("width", [1e-1, 1e-2, 2e-3])
def test_runs_follow_pulses_at_their_own_parameters(width):
    run = mb.simulate(hit(agnesi, {"width": 1.0}), mb.DormandPrince(), parameters={"width": width})
    tail = 2 / np.pi * (width / 2) ** 3  # less than what is left beyond 2 s on either side
    assert_allclose(run["v"][1:], 1, atol=1e-6 + tail)


def test_pulses_at_a_corner_of_the_box_are_doubtful():
    scene = hit(agnesi, {"width": 1.0})
    told, box = "pulse that is shorter than the steps of the solver", mb.Box(width=(1e-3, 1.0))
    bounds = warned(told, mb.propagate, scene, mb.MonteCarlo(50, seed=0), box)
    assert any("width = 0.001" in doubt for doubt in bounds.doubts)


def test_smooth_pulses_of_any_width_in_a_box_are_neither_missed_nor_doubtful():
    def law(p):
        return p.impulse * ca.exp(-(((mb.t - p.at) / p.width) ** 2)) / (np.sqrt(np.pi) * p.width)

    scene = hit(law, {"impulse": 1.0, "width": 1.0, "at": 2.0})
    box = mb.Box(impulse=(0.9, 1.1), width=(1e-5, 1e-2), at=(1.0, 3.0))
    for method in mb.Scanning(3), mb.PolynomialChaos():
        bounds = mb.propagate(scene, method, box)
        assert errors_of(bounds, 0.9, 1.1)[1:].max() < 1e-6 and not bounds.doubts


def test_errors_of_motions_with_a_period_of_four_output_times_are_estimated():
    i = np.arange(1001)
    motion = lambda a, b: np.sin(np.pi / 2 * i) * np.exp(np.sin(2 * a + b))  # noqa: E731
    bounds = black_box_bounds(motion, None, i, a=(-1, 1), b=(-1, 1))
    error = np.abs(bounds.upper[1::4, 0] - np.e)  # sin(2 a + b) reaches 1
    assert error.min() > 1e-5
    assert (bounds.estimate[1::4, 0] >= error).mean() > 0.99


def test_pulses_between_the_times_at_which_errors_are_estimated_are_bounded():
    times = np.arange(1000)
    in_pulse = (times >= 9) & (times < 15)

    def motion(a):
        return np.stack([a * np.sin(6e-3 * times), in_pulse / (1 + 100 * (a - 0.3) ** 2)], axis=1)

    bounds = black_box_bounds(motion, None, times, "y z", a=(-1, 1))
    assert_allclose(bounds["z"][1][in_pulse], 1, atol=0.01)


@pytest.mark.parametrize("seed", [0, 2])
def test_impacts_that_move_past_output_times_are_bounded_at_each_of_them(seed):
    rng, d, times = np.random.default_rng(seed), 5, np.linspace(0, 2, 81)
    late, strong = (a / np.abs(a).sum() for a in rng.uniform(0.3, 1, (2, d)) * rng.choice([-1, 1], (2, d)))
    best = rng.uniform(-0.6, 0.6, d)

    def force(x):
        """A jump and its decay, (..., n_t) for points (..., d). Few points have their jump just before a time."""
        delay, off = x @ late, np.square(x - best).mean(axis=-1)
        since = times - (1 + delay / 2 + delay**2 / 10)[..., None]
        return np.where(since > 0, (1 + 0.3 * (x @ strong - off))[..., None] * np.exp(-20 * np.maximum(since, 0)), 0)

    bounds = quietly(unit_bounds, force, d, mb.PolynomialChaos(seconds=100), times, ["force"])
    x = rng.uniform(-1, 1, (60_000, d))
    x = np.where(rng.uniform(size=x.shape) < rng.choice([0, 0.5, 0.8], (len(x), 1)), np.sign(x), x)
    highest = np.max([force(part).max(axis=0) for part in np.array_split(x, 60)], axis=0)
    width = np.sqrt(np.mean(highest**2))  # the force may be 0 at any time
    assert np.sqrt(np.mean((highest - bounds.upper[:, 0]) ** 2)) < 0.1 * width
