"""Responses whose numbers are very large or small, or vary in their last digits only."""

import numpy as np
import pytest
from black_boxes import unit_bounds
from numpy.testing import assert_allclose

import symmb as mb


def bounds_of(f, d=1, noise=None, method=None):
    bounds = unit_bounds(lambda x: f(*x), d, method, noise=noise)
    assert str(bounds) and bounds.doubtful_windows() == () and bounds.doubts == () and bounds.outer
    assert bounds.expansion is None or str(bounds.moments())
    return bounds


@pytest.mark.parametrize("power", [-960, -700, -500, -200, 200, 400, 550, 1020])
@pytest.mark.parametrize("d", [1, 2, 4])
def test_bounds_do_not_depend_on_a_factor(power, d):
    ordinary = bounds_of(lambda *p: np.sin(3 * sum(p) / d), d)
    scaled = bounds_of(lambda *p: np.ldexp(np.sin(3 * sum(p) / d), power), d)
    assert scaled.evaluations == ordinary.evaluations
    for part in ("lower", "upper", "estimate"):
        expected = np.ldexp(getattr(ordinary, part), power)
        assert_allclose(getattr(scaled, part), expected, rtol=1e-9)


@pytest.mark.parametrize("method", [mb.PolynomialChaos(order=4), mb.PolynomialChaos.paper(2)], ids=repr)
@pytest.mark.parametrize("power", [-600, 600, 1020])
def test_a_given_order_does_not_depend_on_a_factor(method, power):
    ordinary = bounds_of(lambda p, q: np.sin(0.3 * p + 0.2 * q), 2, method=method)
    scaled = bounds_of(lambda p, q: np.ldexp(np.sin(0.3 * p + 0.2 * q), power), 2, method=method)
    assert_allclose(scaled.upper, np.ldexp(ordinary.upper, power), rtol=1e-9)
    assert str(scaled.moments()) == str(ordinary.moments())


def test_numbers_that_are_large_at_later_runs_only():
    bounds = bounds_of(lambda p: 1e200 * max(0.0, 0.3 - abs(p - 0.34)) ** 3)
    assert_allclose(bounds.upper, 0.027e200, rtol=2e-2)
    bounds = bounds_of(lambda p: 1.0 + p + 1e200 * max(0.0, 0.3 - abs(p - 0.34)) ** 3)
    assert_allclose(bounds.upper, 0.027e200, rtol=2e-2)


def test_first_runs_in_the_tail_of_a_narrow_bump():
    bounds = bounds_of(lambda p: np.exp(-(((p - 0.37) / 0.02) ** 2)))
    assert_allclose(bounds.upper, 1.0, rtol=2e-2)
    assert_allclose(bounds.lower, 0.0, atol=1e-2)


def test_a_width_that_counts_as_rounding_is_told():
    assert "width is below 1e-9 of the values" in str(bounds_of(lambda p: 1e6 + 1e-6 * p))
    assert "1e-9" not in str(bounds_of(lambda p: 1e6 + 1e-6 * p, noise={"y": 1e-10}))
    assert "1e-9" not in str(bounds_of(lambda p: 1e6 + 0 * p))


@pytest.mark.parametrize(("mean", "width"), [(1e6, 1e-4), (1.0, 1e-10), (-300.0, 1e-9), (7e-5, 1e-16)])
def test_a_small_width_is_resolved_if_noise_is_told_and_within_the_error_otherwise(mean, width):
    def f(p):
        return mean + width * np.sin(9 * p)

    told, not_told = bounds_of(f, noise={"y": 0}), bounds_of(f)
    for bounds in (told, not_told):
        assert (bounds.outer[0] <= mean - width * 0.999).all() and (bounds.outer[1] >= mean + width * 0.999).all()
    assert (told.estimate < 0.05 * width).all()
    assert_allclose(told.upper - told.lower, 2 * width, rtol=0.02)
    assert not_told.evaluations < 15 and (not_told.estimate <= 1.01e-9 * abs(mean)).all()
