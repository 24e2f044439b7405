"""Scores against numbers worked out by hand, and the words of their definitions."""

import numpy as np
import pytest

from symmb.study.metrics import Yardstick

LOWER = np.array([[0.0], [1.0]])
UPPER = np.array([[1.0], [4.0]])  # widths 1 and 3: mean 2, mean square 5


def yardstick(lower=LOWER, upper=UPPER, uncertainty=0.0):
    return Yardstick(lower, upper, np.full(lower.shape[1], uncertainty))


def test_error_over_and_under_by_hand():
    score = yardstick().score(np.array([[-0.2], [1.3]]), np.array([[1.0], [4.1]]))
    assert score.error == pytest.approx([np.sqrt((0.04 + 0.09 + 0.0 + 0.01) / 4 / 5)])
    assert score.over == pytest.approx([(0.2 + 0.1) / 2 / 2])
    assert score.under == pytest.approx([0.3 / 2 / 2])
    assert score.coverage == pytest.approx([0.5])  # the second time falls 0.3 short


def test_the_reference_itself_has_no_error_and_covers():
    score = yardstick().score(LOWER, UPPER)
    for share in (score.error, score.outer_error, score.over, score.under):
        assert share == [0.0]
    assert score.coverage == [1.0]


def test_the_estimate_widens_outer_bounds_only():
    bare = yardstick().score(LOWER + 0.1, UPPER - 0.1)
    widened = yardstick().score(LOWER + 0.1, UPPER - 0.1, np.full((2, 1), 0.1))
    assert bare.coverage == [0.0]
    assert widened.coverage == [1.0]
    assert widened.outer_error == pytest.approx([0.0], abs=1e-15)
    assert widened.error == bare.error == bare.outer_error == pytest.approx([0.1 / np.sqrt(5)])
    assert widened.under == bare.under


@pytest.mark.parametrize(("uncertainty", "covered"), [(0.04, 0.0), (0.05, 1.0), (np.nan, 0.0)])
def test_coverage_allows_for_the_uncertainty_of_the_reference(uncertainty, covered):
    short = 0.045 * np.sqrt(5)  # the norm of the uncertainty is the rms width
    assert yardstick(uncertainty=uncertainty).score(LOWER, UPPER - short).coverage == [covered]


@pytest.mark.parametrize(("short", "covered"), [(2.9e-6, 1.0), (3.1e-6, 0.0)])
def test_coverage_allows_for_a_millionth_of_the_largest_width(short, covered):
    assert yardstick().score(LOWER + short, UPPER).coverage == [covered]


@pytest.mark.parametrize("lower", [np.array([[-0.2], [1.3]]), LOWER - 0.1], ids=["on both sides", "outside"])
@pytest.mark.parametrize("unit", [1e-300, 1e-20, 1e-15, 1e-3, 1e6, 1e20, 1e300])
def test_a_change_of_unit_changes_no_score(unit, lower):
    upper = UPPER + [[0.0], [0.1]]
    score = yardstick().score(lower, upper)
    scaled = yardstick(unit * LOWER, unit * UPPER).score(unit * lower, unit * upper)
    assert scaled.error == pytest.approx(score.error) and scaled.error > 0
    assert scaled.over == pytest.approx(score.over) and scaled.coverage == score.coverage


def test_errors_of_an_output_without_width_are_absolute():
    constant = np.full((3, 1), 5.0)
    measure = yardstick(constant, constant)
    assert measure.zero_width == [True]
    within = measure.score(constant - 4e-9, constant + 4e-9)
    assert (within.error, within.over, within.under, within.coverage) == ([0.0], [0.0], [0.0], [1.0])
    beyond = measure.score(constant - 0.25, constant)
    assert beyond.error == pytest.approx([0.25 / np.sqrt(2)])
    assert beyond.over == pytest.approx([0.25])
    assert measure.score(constant + 1e-7, constant + 1e-7).coverage == [0.0]


def test_rounding_noise_of_a_zero_output_is_no_width():
    noise = np.array([[0.0], [1e-17], [3e-17]])
    score = Yardstick(-noise, noise, np.zeros(1), noise=np.array([1e-17])).score(noise, 2 * noise)
    assert score.error == [0.0]
    assert score.coverage == [1.0]


def test_outputs_are_scored_each_by_itself():
    lower, upper = np.hstack([LOWER, LOWER]), np.hstack([UPPER, UPPER + 10.0])
    score = yardstick(lower, upper).score(lower, np.hstack([UPPER, UPPER]))
    assert score.error[0] == 0.0
    assert score.error[1] == pytest.approx(10.0 / np.sqrt(2) / np.sqrt((11**2 + 13**2) / 2))


def test_infinite_bounds_cover_and_missing_ones_do_not():
    wide = yardstick().score(LOWER - np.inf, UPPER + np.inf)
    assert (wide.error, wide.coverage) == ([np.inf], [1.0])
    gap = yardstick().score(np.array([[0.0], [np.nan]]), UPPER)
    assert np.isnan(gap.error).all()
    assert gap.coverage == [0.5]
