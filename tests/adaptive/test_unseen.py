"""What no node of a grid shows: bumps of fields, narrow windows, dead zones. Bounds are right, or they are doubtful."""

from itertools import combinations, product

import casadi as ca
import numpy as np
import pytest
from black_boxes import black_box_bounds, errors_of, quietly, unit_bounds
from faults import told_in_a_line, warned
from machines import ball
from numpy.testing import assert_allclose

import symmb as mb
from models import slider_crank
from symmb.bound.adaptive.check_points import screening_corners

pytestmark = pytest.mark.usefixtures("optimised")


def bounds_of(f, d, n_t, probes=0):
    """Bounds of f(x) (n_t,), d parameters from -1 to 1."""
    return quietly(unit_bounds, f, d, mb.PolynomialChaos(probes=probes), np.arange(float(n_t)))


@pytest.mark.parametrize("shape", ["is constant", "some of the times", "swinging"])
@pytest.mark.parametrize("seed", [9, 11, 15, 28, 50, 55, 59])
def test_a_bump_of_few_shapes_is_seen(shape, seed):
    rng = np.random.default_rng(seed)
    at, sigma, t = rng.uniform(-0.9, 0.9, 2), rng.uniform(0.3, 0.5), np.linspace(0, 10, 101)
    of_time = {"is constant": 1 + 0 * t, "some of the times": (t > 3) & (t < 6), "swinging": np.sin(t)}[shape]
    bounds = bounds_of(lambda x: np.exp(-np.square(x - at).sum() / (2 * sigma**2)) * of_time, 2, 101)
    highest = of_time.max() - 0.02
    assert bounds.outer[1].max() >= highest or bounds.doubts


@pytest.mark.parametrize(
    ("d", "width", "probes"), [(1, 0.05, 40), (2, 0.12, 150), (3, 0.25, 60), (4, 0.4, 60), (5, 0.45, 100)]
)
@pytest.mark.parametrize("seed", [3, 4])
def test_probes_show_bumps_of_a_small_part_of_the_box(d, width, probes, seed):
    rng = np.random.default_rng([seed, d])
    at, slope = rng.uniform(-0.9, 0.9, d), rng.uniform(-0.1, 0.1, d)
    bounds = bounds_of(lambda x: x @ slope + 2 * np.exp(-np.square(x - at).sum() / (2 * width**2)), d, 1, probes=probes)
    top = 2 + at @ slope
    assert bounds.outer[1][0, 0] >= top - 0.05 or bounds.doubts
    assert bounds.evaluations > probes


def test_probes_are_run_where_responses_are_simple():
    bounds = bounds_of(lambda x: x.sum(), 5, 1, probes=70)
    assert 70 < bounds.evaluations < 150 and not bounds.doubts
    np.testing.assert_allclose([bounds.lower[0, 0], bounds.upper[0, 0]], [-5, 5], atol=0.05)


def test_probes_beyond_the_budget_are_refused():
    with told_in_a_line("first level and the probes take 55 runs, more than the budget of 50", mb.PropagationError):
        black_box_bounds(lambda a: a, mb.PolynomialChaos(probes=50, budget=50), a=(0.0, 1.0))


def test_a_narrow_window_of_the_slider_crank_is_refined_or_doubtful():
    """At 4.58 s, a scan of 101 x 101 runs finds the angular velocity 2.562 of the rod."""
    box = mb.Box(l1=(0.9, 1.1), l2=(1.8, 2.2))
    bounds = quietly(mb.propagate, slider_crank.scene(), mb.PolynomialChaos(), box)
    highest = bounds.outer[1][:, bounds.names.index("phi_dot")]
    assert highest[np.argmin(np.abs(bounds.t - 4.58))] > 2.562 or bounds.doubts


@pytest.mark.parametrize("d", [5, 6, 8])
@pytest.mark.parametrize("is_field", [False, True], ids=["scalar", "field"])
def test_a_dead_zone_is_left_or_doubtful(d, is_field):
    """A response that is 0 in most of the box, at some of the times, and 0.7 in a corner."""
    t = np.linspace(0, 10, 101) if is_field else np.zeros(1)
    zone = (t >= 4) & (t < 6) if is_field else np.ones(1, dtype=bool)
    bounds = bounds_of(lambda x: np.where(zone, max(0.0, x.mean() - 0.3), np.sin(t + 0.1 * x[0])), d, len(t))
    assert bounds.outer[1][zone].min() >= 0.68 or bounds.doubts


def test_corners_that_are_screened_combine_all_signs_of_three_parameters():
    for d in range(3, 12):
        corners = screening_corners(d)
        assert len(corners) == 12
        for three in combinations(range(d), 3):
            assert len(np.unique(corners[:, three], axis=0)) == 8


@pytest.mark.parametrize("d", [4, 5])
@pytest.mark.parametrize("seed", range(6))
def test_a_hinge_that_acts_in_few_corners_is_bounded(d, seed):
    """A linear response and a contact with slopes of other signs: it is convex, so that its maximum is at a corner."""
    rng = np.random.default_rng([d, seed])
    slope, own = rng.uniform(0.2, 1.0, (2, d)) * rng.choice([-1.0, 1.0], (2, d))
    gap = np.abs(own).sum() * rng.uniform(0.5, 0.85)
    corners = np.array(list(product([-1.0, 1.0], repeat=d)))
    highest = (corners @ slope + 8 * np.maximum(corners @ own - gap, 0.0)).max()
    bounds = bounds_of(lambda x: slope @ x + 8 * max(own @ x - gap, 0.0), d, 1)
    assert bounds.outer[1][0, 0] >= highest * 0.98 or bounds.doubts


@pytest.mark.parametrize("place", [0.9, 0.95, 0.99])
def test_a_step_on_a_slope_is_bounded_on_the_whole_box(place):
    """Pieces of the box that check runs call for are refined in the place of themselves, not of others."""
    bounds = black_box_bounds(lambda x: x + 5.0 * (x > place), x=(-1.0, 1.0))
    np.testing.assert_allclose([bounds.lower[0, 0], bounds.upper[0, 0]], [-1.0, 6.0], atol=1e-9)
    assert bounds.estimate.max() < 0.1 * 7 and not bounds.doubts


# Pulses and switches of time that parameters move


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

    motion = lambda a: np.stack([a * np.sin(6e-3 * times), in_pulse / (1 + 100 * (a - 0.3) ** 2)], axis=1)  # noqa: E731
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
