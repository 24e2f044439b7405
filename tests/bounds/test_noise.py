"""Bounds of responses with noise, and of runs that fail: what they cost, and what is told."""

import re
import time

import numpy as np
import pytest
from numpy.testing import assert_allclose
from unit_functions import unit_function

import symmb as mb

T = np.linspace(0, 1, 11)
BOX = mb.Box(a=(0.9, 1.1), b=(0.9, 1.1))


def random_looking(a, b):
    """Numbers from -1 to 1 that look random."""
    return 2 * np.modf(np.abs(1e4 * np.sin(1e5 * a + 3e4 * b + 77 * T)))[0] - 1


def simulator(f, noise=None, outputs=("x", "other")):
    return mb.FunctionSimulator(f, {"a": 1.0, "b": 1.0}, T, outputs, noise=noise)


def estimated(estimate, upper=None):
    """Bounds from 0 up to 1, or to other ends, of an output at times 0, 1, 2, ... s with an estimated error."""
    upper = np.ones_like(estimate) if upper is None else upper
    return mb.Bounds(np.arange(float(len(estimate))), ("x",), 0 * upper, upper, "estimate", "", 1, estimate)


@pytest.mark.parametrize("noise", [None, {"other": 1e-13}], ids=["measured", "told"])
def test_an_output_of_rounding_noise_costs_nothing_and_is_not_doubtful(noise):
    def f(a, b):
        return np.stack([np.sin(a + b + T), 1e-13 * random_looking(a, b)], axis=1)

    bounds = mb.propagate(simulator(f, noise), mb.PolynomialChaos(), BOX)
    alone = mb.propagate(simulator(lambda a, b: np.sin(a + b + T), outputs=("x",)), mb.PolynomialChaos(), BOX)
    assert bounds.evaluations <= alone.evaluations + 5 and not bounds.doubts
    moments = bounds.moments()
    assert np.isnan(moments.first[:, :, 1]).all() and (moments.variance[:, 1] == 0).all()
    assert_allclose(moments.first[:, :, 0], alone.moments().first[:, :, 0], atol=1e-6)


@pytest.mark.parametrize("level", [1e-6, 1e-4, 1e-2])
def test_noise_is_not_refined(level):
    def f(a, b):
        return np.exp(a * b * T) + level * random_looking(a, b)

    bounds = mb.propagate(simulator(f, outputs=("x",)), mb.PolynomialChaos(tolerance=1e-3), BOX)
    assert bounds.evaluations < 60
    assert bounds.noise is not None and bounds.noise[0] < 6 * level
    assert level < 1e-2 or bounds.noise[0] > level / 3
    assert (bounds.outer[0][:, 0] < np.exp(0.81 * T) + level).all()
    assert (bounds.outer[1][:, 0] > np.exp(1.21 * T) - level).all()


def test_a_box_of_no_width_is_bounded_by_its_point():
    box = mb.Box(a=(1.0, 1.0), b=(1.0, 1.0))
    bounds = mb.propagate(simulator(lambda a, b: a * T, outputs=("x",)), mb.PolynomialChaos(), box)
    assert not bounds.doubts and bounds.evaluations < 20
    assert_allclose(bounds.lower[:, 0], T)


def test_scenes_tell_the_noise_of_their_runs():
    body = mb.Body("ball", 1.0, pose=mb.Particle())
    p = mb.Parameters(g=9.81)
    system = mb.System(body, mb.Gravity(0, -p.g), parameters=p)
    scene = mb.Scene(system, {"ball.y": 2.0}, T, {"y": body.y, "nothing": body.x * 1e-3})
    noise, tighter = (mb.prepare(scene, mb.DormandPrince(rtol=rtol)).noise for rtol in (1e-6, 1e-9))
    assert 0 < noise[0] < 1e-5 and noise[1] == 0
    assert_allclose(noise, 1e3 * tighter)


def test_a_simulator_takes_its_time_to_tell_its_noise():
    """A scene is compiled for it: the study is not late then."""

    quick = simulator(lambda a, b: T * np.cos(20 * (a + b)), outputs=("x",))

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
    with pytest.raises(mb.DeclarationError, match="noise"):
        simulator(lambda a, b: T, noise, outputs=("x",))


def test_a_pulse_is_doubtful_in_its_window():
    estimate = np.full((200, 1), 1e-3)
    estimate[100:104] = 0.3
    bounds = estimated(estimate)
    (window,) = bounds.doubtful_windows()
    assert window[0] == "x" and 97 <= window[1] <= 100 and 103 <= window[2] <= 106
    assert not bounds.doubtful()


def test_what_has_died_out_is_not_doubtful():
    t = np.linspace(0, 10, 501)

    def f(a, b):
        return np.exp(-(3 + 5 * (a - 1)) * t) * np.cos((9 + 20 * (b - 1)) * t)

    bounds = mb.propagate(mb.FunctionSimulator(f, {"a": 1.0, "b": 1.0}, t, ["x"]), mb.PolynomialChaos(), BOX)
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

    with pytest.warns(mb.SymmbWarning, match="responses near the failed runs are not known"):
        bounds = mb.propagate(simulator(f, outputs=("x",)), mb.PolynomialChaos(), BOX)
    assert len(points) == len(set(points)) == bounds.evaluations < 100
    assert bounds.inner is not None
    assert (bounds.upper == bounds.inner[1]).all()


def test_a_told_noise_above_the_response_is_doubtful():
    for method in mb.PolynomialChaos(), mb.PolynomialChaos(order=3), mb.MonteCarlo(20, seed=0):
        with pytest.warns(mb.SymmbWarning, match="than the width of x. The true width is not known.$"):
            mb.propagate(simulator(lambda a, b: np.stack([a * T, b * T], 1), {"x": 5.0, "other": 0.01}), method, BOX)


def test_an_estimate_that_is_the_noise_itself_is_not_doubtful():
    """Sums of their squares differ by rounding."""
    times = np.linspace(0.0, 1.0, 121)
    for noise in 10 ** np.random.default_rng(3).uniform(-9, -6, 200):
        estimate = np.full((len(times), 1), noise)
        zero = np.zeros_like(estimate)
        bounds = mb.Bounds(times, ("y",), zero, zero, "estimate", "a method", 9, estimate, np.array([noise]))
        assert not bounds.doubtful() and not bounds.doubtful_windows()
        louder = mb.Bounds(times, ("y",), zero, zero, "estimate", "a method", 9, 1.01 * estimate, np.array([noise]))
        assert louder.doubtful() and louder.doubtful_windows()


METHODS = mb.PolynomialChaos(), mb.PolynomialChaos(order=4), mb.PolynomialChaos.paper(2)


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_a_given_order_respects_a_told_noise(method):
    def f(a, b):
        return np.stack([a * b + T, 3.0 + 1e-3 * random_looking(a, b)], axis=1)

    bounds = mb.propagate(simulator(f, {"other": 1e-3}), method, BOX)
    assert bounds.noise is not None and bounds.noise[1] == 1e-3 and bounds.inner is not None
    assert (bounds.lower[:, 1] == bounds.inner[0][:, 1]).all() and (bounds.upper[:, 1] == bounds.inner[1][:, 1]).all()
    moments = bounds.moments()
    assert (moments.variance[:, 1] == 0).all() and (moments.variance[:, 0] > 0).all()
    assert "nan" not in str(moments) and str(moments).splitlines()[-1].split() == ["other", "no", "variance"]


@pytest.mark.filterwarnings("ignore:.*Check runs show errors:symmb.SymmbWarning")
@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_a_parameter_of_no_width_has_no_share(method):
    rng = np.random.default_rng(0)
    noisy = simulator(lambda a, b: a * b * T + rng.uniform(-1e-2, 1e-2, len(T)), outputs=("x",))
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

    failing, box = unit_function(f, d, times, ["x"])
    with pytest.warns(mb.SymmbWarning, match="above 10 % of the width: x"):
        bounds = mb.propagate(failing, mb.PolynomialChaos(), box)
    assert bounds.inner is not None and (bounds.upper == bounds.inner[1]).all()
    assert (bounds.outer[1][:, 0] > np.exp(1.4) * (1 + times)).all()
    assert bounds.doubtful() == {"x": 0.0} and [name for name, *_ in bounds.doubtful_windows()] == ["x"]


def uniform(*x):
    """A number from -1 to 1 that is random, the same at the same place."""
    return np.random.default_rng(np.array(x, dtype=float).view(np.uint64)).uniform(-1, 1)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_noise_of_one_parameter_is_measured(tolerance):
    noisy = mb.FunctionSimulator(lambda a: [[np.sin(3 * a) + 0.1 * uniform(a)]], {"a": 0.0}, [0.0], ["y"])
    bounds = mb.propagate(noisy, mb.PolynomialChaos(tolerance=tolerance), mb.Box(a=(-1.0, 1.0)))
    assert bounds.evaluations < 100
    assert bounds.noise is not None and 0.05 < bounds.noise[0] < 0.4


@pytest.mark.parametrize("d", [1, 3, 6])
def test_noise_of_an_output_does_not_spoil_another(d):
    simulator, box = unit_function(lambda x: [np.exp(x.mean()), 1 + 1e-9 * uniform(*x)], d, outputs=["smooth", "noisy"])
    bounds = mb.propagate(simulator, mb.PolynomialChaos(seconds=600.0), box)
    assert bounds.evaluations < 200 and not bounds.doubts
    assert_allclose(bounds.upper[0], [np.e, 1], rtol=1e-2)
