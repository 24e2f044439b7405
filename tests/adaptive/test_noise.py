"""Bounds of responses with noise, and of runs that fail: what they cost, and what is told."""

import re
import time

import numpy as np
import pytest
from black_boxes import black_box, black_box_bounds, unit_bounds
from faults import refused, warned
from machines import ball
from numpy.testing import assert_allclose

import symmb as mb

T = np.linspace(0, 1, 11)
BOX = mb.Box(a=(0.9, 1.1), b=(0.9, 1.1))


def random_looking(a, b):
    """Numbers from -1 to 1 that look random."""
    return 2 * np.modf(np.abs(1e4 * np.sin(1e5 * a + 3e4 * b + 77 * T)))[0] - 1


def simulator(f, noise=None, outputs="x", times=T):
    return black_box(f, times, outputs, noise, a=(0.9, 1.1), b=(0.9, 1.1))[0]


def study(f, noise=None, outputs="x", method=None, times=T):
    return mb.propagate(simulator(f, noise, outputs, times), method, BOX)


def estimated(estimate, upper=None):
    """Bounds from 0 up to 1, or to other ends, of an output at times 0, 1, 2, ... s with an estimated error."""
    upper = np.ones_like(estimate) if upper is None else upper
    return mb.Bounds(np.arange(float(len(estimate))), ("x",), 0 * upper, upper, "estimate", "", 1, estimate)


@pytest.mark.parametrize("noise", [None, {"other": 1e-13}], ids=["measured", "told"])
def test_an_output_of_rounding_noise_costs_nothing_and_is_not_doubtful(noise):
    bounds = study(lambda a, b: np.stack([np.sin(a + b + T), 1e-13 * random_looking(a, b)], 1), noise, "x other")
    alone = study(lambda a, b: np.sin(a + b + T))
    assert bounds.evaluations <= alone.evaluations + 5 and not bounds.doubts
    moments = bounds.moments()
    assert np.isnan(moments.first[:, :, 1]).all() and (moments.variance[:, 1] == 0).all()
    assert_allclose(moments.first[:, :, 0], alone.moments().first[:, :, 0], atol=1e-6)


@pytest.mark.parametrize("level", [1e-6, 1e-4, 1e-2])
def test_noise_is_not_refined(level):
    f = lambda a, b: np.exp(a * b * T) + level * random_looking(a, b)  # noqa: E731
    bounds = study(f, method=mb.PolynomialChaos(tolerance=1e-3))
    assert bounds.evaluations < 60
    assert bounds.noise is not None and bounds.noise[0] < 6 * level
    assert level < 1e-2 or bounds.noise[0] > level / 3
    assert (bounds.outer[0][:, 0] < np.exp(0.81 * T) + level).all()
    assert (bounds.outer[1][:, 0] > np.exp(1.21 * T) - level).all()


def test_a_box_of_no_width_is_bounded_by_its_point():
    box = mb.Box(a=(1.0, 1.0), b=(1.0, 1.0))
    bounds = mb.propagate(simulator(lambda a, b: a * T), mb.PolynomialChaos(), box)
    assert not bounds.doubts and bounds.evaluations < 20
    assert_allclose(bounds.lower[:, 0], T)


def test_scenes_tell_the_noise_of_their_runs():
    machine = ball()
    scene = machine.scene({"y": machine.ball.y, "nothing": machine.ball.x * 1e-3}, T, {"ball.y": 2.0})
    noise, tighter = (mb.prepare(scene, mb.DormandPrince(rtol=rtol)).noise for rtol in (1e-6, 1e-9))
    assert 0 < noise[0] < 1e-5 and noise[1] == 0
    assert_allclose(noise, 1e3 * tighter)


def test_a_simulator_takes_its_time_to_tell_its_noise():
    """A scene is compiled for it: the study is not late then."""

    quick = simulator(lambda a, b: T * np.cos(20 * (a + b)))

    class Slow:
        times, outputs, parameters, run, stream = T, ("x",), quick.parameters, quick.run, quick.stream

        @property
        def noise(self):
            begin = time.thread_time()
            while time.thread_time() < begin + 0.3:
                pass
            return np.zeros(1)

    assert not mb.propagate(Slow(), mb.PolynomialChaos(seconds=0.25), BOX).doubts


@pytest.mark.parametrize("noise", [{"z": 1.0}, {"x": -1.0}, {"x": np.nan}, 1e-3])
def test_malformed_noise_is_refused(noise):
    refused("noise", simulator, lambda a, b: T, noise)


def test_a_pulse_is_doubtful_in_its_window():
    bounds = estimated(1e-3 + 0.299 * np.isin(np.arange(200.0)[:, None], np.arange(100, 104)))
    (window,) = bounds.doubtful_windows()
    assert window[0] == "x" and 97 <= window[1] <= 100 and 103 <= window[2] <= 106
    assert not bounds.doubtful()


def test_what_has_died_out_is_not_doubtful():
    t = np.linspace(0, 10, 501)

    bounds = study(lambda a, b: np.exp(-(3 + 5 * (a - 1)) * t) * np.cos((9 + 20 * (b - 1)) * t), times=t)
    width = bounds.upper - bounds.lower
    assert bounds.estimate is not None and (bounds.estimate > 0.1 * width).any() and width[-1] < 1e-6 * width.max()
    assert not bounds.doubts


def test_a_doubt_names_no_time_at_which_bounds_have_no_error():
    """The width and the error are 0 up to 1 s, as at a start that is known."""
    upper = np.array([[0.0], [0.0], [1.0], [1.0]])
    assert estimated(upper / 2, upper).doubts == ("The estimated error is above 10 % of the width: x from 2 s.",)


@pytest.mark.parametrize(
    ("first", "text"), [(40, "x from 3. to 6. s"), (150, r"x from 14\d to 17\d s and from 18\d s")]
)
def test_a_doubt_names_the_window_in_which_the_error_is_large(first, text):
    estimate = np.full((200, 1), 1e-3)
    estimate[first : first + 20] = 1.0
    estimate[-10:] = 1e-3 if first == 40 else 1.0
    bounds = estimated(estimate)
    assert bounds.doubtful() == {"x": 0.0}
    assert re.fullmatch(f"The estimated error is above 10 % of the width: {text}.", bounds.doubts[0])


def test_failed_points_are_run_once_and_those_near_them_bounded_by_what_runs_attained():
    points = []

    def f(a, b):
        points.append((a, b))
        if a + b > 2.12:
            raise ValueError("no convergence")
        return np.exp(5 * a + 10 * b) * (1 + T)

    bounds = warned("responses near the failed runs are not known", study, f)
    assert len(points) == len(set(points)) == bounds.evaluations < 100
    assert bounds.inner is not None
    assert (bounds.upper == bounds.inner[1]).all()


def test_a_told_noise_above_the_response_is_doubtful():
    for method in mb.PolynomialChaos(), mb.PolynomialChaos(order=3), mb.MonteCarlo(20, seed=0):
        with pytest.warns(mb.SymmbWarning, match="than the width of x. The true width is not known.$"):
            study(lambda a, b: np.stack([a * T, b * T], 1), {"x": 5.0, "other": 0.01}, "x other", method)


def test_an_estimate_that_is_the_noise_itself_is_not_doubtful():
    """Sums of their squares differ by rounding."""
    times = np.linspace(0.0, 1.0, 121)
    for noise in 10 ** np.random.default_rng(3).uniform(-9, -6, 200):
        estimate = np.full((len(times), 1), noise)
        zero = np.zeros_like(estimate)
        for factor in (1.0, 1.01):
            own = factor * estimate, np.array([noise])
            bounds = mb.Bounds(times, ("y",), zero, zero, "estimate", "a method", 9, *own)
            assert bool(bounds.doubtful()) == bool(bounds.doubtful_windows()) == (factor > 1)


METHODS = mb.PolynomialChaos(), mb.PolynomialChaos(order=4), mb.PolynomialChaos.paper(2)


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_a_given_order_respects_a_told_noise(method):
    def f(a, b):
        return np.stack([a * b + T, 3.0 + 1e-3 * random_looking(a, b)], axis=1)

    bounds = study(f, {"other": 1e-3}, "x other", method)
    assert bounds.noise is not None and bounds.noise[1] == 1e-3 and bounds.inner is not None
    assert (bounds.lower[:, 1] == bounds.inner[0][:, 1]).all() and (bounds.upper[:, 1] == bounds.inner[1][:, 1]).all()
    moments = bounds.moments()
    assert (moments.variance[:, 1] == 0).all() and (moments.variance[:, 0] > 0).all()
    assert "nan" not in str(moments) and str(moments).splitlines()[-1].split() == ["other", "no", "variance"]


@pytest.mark.filterwarnings("ignore:.*Check runs show errors:symmb.SymmbWarning")
@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_a_parameter_of_no_width_has_no_share(method):
    rng = np.random.default_rng(0)
    noisy = simulator(lambda a, b: a * b * T + rng.uniform(-1e-2, 1e-2, len(T)))
    moments = mb.propagate(noisy, method, mb.Box(a=(0.9, 1.1), b=(1.0, 1.0))).moments()
    assert (moments.first[1] == 0).all() and (moments.total[1] == 0).all()
    assert_allclose(moments.first[0], 1.0)


@pytest.mark.parametrize("d", [1, 2, 4])
@pytest.mark.parametrize("times", [T, T[:1]], ids=["field", "scalar"])
def test_estimates_near_failed_points_cover_what_is_predicted_there(d, times):
    """The response grows towards a corner where runs fail."""

    def f(x):
        mean = sum(x) / d
        return np.exp(2 * mean) * (1 + times) if mean < 0.7 else np.full(len(times), np.nan)

    bounds = warned("above 10 % of the width: x", unit_bounds, f, d, None, times, ["x"])
    assert bounds.inner is not None and (bounds.upper == bounds.inner[1]).all()
    assert (bounds.outer[1][:, 0] > np.exp(1.4) * (1 + times)).all()
    assert bounds.doubtful() == {"x": 0.0} and [name for name, *_ in bounds.doubtful_windows()] == ["x"]


def uniform(*x):
    """A number from -1 to 1 that is random, the same at the same place."""
    return np.random.default_rng(np.array(x, dtype=float).view(np.uint64)).uniform(-1, 1)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_noise_of_one_parameter_is_measured(tolerance):
    method = mb.PolynomialChaos(tolerance=tolerance)
    bounds = black_box_bounds(lambda a: np.sin(3 * a) + 0.1 * uniform(a), method, a=(-1.0, 1.0))
    assert bounds.evaluations < 100
    assert bounds.noise is not None and 0.05 < bounds.noise[0] < 0.4


@pytest.mark.parametrize("d", [1, 3, 6])
def test_noise_of_an_output_does_not_spoil_another(d):
    f, method = lambda x: [np.exp(x.mean()), 1 + 1e-9 * uniform(*x)], mb.PolynomialChaos(seconds=600.0)
    bounds = unit_bounds(f, d, method, outputs=["smooth", "noisy"])
    assert bounds.evaluations < 200 and not bounds.doubts
    assert_allclose(bounds.upper[0], [np.e, 1], rtol=1e-2)


# Responses whose numbers are very large or small, or vary in their last digits only


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
    for small in (0.0, 1.0):
        bounds = bounds_of(lambda p, c=small: c * (1.0 + p) + 1e200 * max(0.0, 0.3 - abs(p - 0.34)) ** 3)
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
