"""What no node of a grid shows: bumps of fields, narrow windows, dead zones. Bounds are right, or they are doubtful."""

from itertools import combinations, product

import numpy as np
import pytest
from black_boxes import black_box_bounds, quietly, unit_bounds
from faults import told_in_a_line

import symmb as mb
from models import slider_crank
from symmb.bound.bounds.adaptive.check_points import screening_corners


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
