"""One oscillator with closed-form bounds against every method."""

import itertools
import pickle
import re

import casadi as ca
import numpy as np
import pytest
import scipy.stats
from black_boxes import reloaded
from conftest import ALL_METHODS
from faults import refused
from machines import ball
from oscillators import BOX, TIMES, Wave, wave, wave_bounds
from small_scenes import formulas

import symmb
import symmb as mb
from symmb import Box, FunctionSimulator, MonteCarlo, Optimization, PolynomialChaos, Swarm, Taylor, Vertex, propagate
from symmb import _errors as errors

# Largest root mean square error over root mean square width; 2e-4 where nothing is said.
LARGEST_ERROR = {
    "PolynomialChaos.paper(order=2)": 0.07,
    "PolynomialChaos.paper(order=3, nodes=SparseGrid())": 0.07,
    "PolynomialChaos.paper(order=4, lockstep=True)": 0.07,
    "Taylor(order=2)": 0.07,
    "Taylor(order=5)": 0.07,
    "Taylor(order=2, subintervals=4)": 5e-3,
    "MonteCarlo(2000)": 0.02,
    "MonteCarlo(500, sampler=LatinHypercube())": 0.03,
    "MonteCarlo(500, sampler=Sobol())": 0.03,
    "Vertex()": 3e-3,
}


def _error(lower, upper, exact):
    deviation = np.concatenate([lower - exact[0], upper - exact[1]], axis=1)
    return np.sqrt(np.mean(deviation**2) / np.mean((exact[1] - exact[0]) ** 2))


@pytest.mark.parametrize("method", ALL_METHODS, ids=repr)
def test_against_closed_form(method):
    exact = wave_bounds()
    result = propagate(Wave(), method, BOX)
    assert result.method == repr(method) and result.kind == method.kind
    assert result.lower.shape == result.upper.shape == (len(TIMES), 1)
    assert _error(result.lower, result.upper, exact) < LARGEST_ERROR.get(repr(method), 2e-4)
    assert result.evaluations > 0 and result.failed == () and result.seconds > 0
    if result.kind == "enclosure":
        assert (result.lower <= exact[0]).all() and (result.upper >= exact[1]).all()
    if result.kind == "sampled":
        assert (result.lower >= exact[0] - 1e-14).all() and (result.upper <= exact[1] + 1e-14).all()
    if result.inner is not None:
        assert (result.inner[0] >= exact[0] - 1e-14).all() and (result.inner[1] <= exact[1] + 1e-14).all()


@pytest.mark.parametrize("method", ALL_METHODS, ids=repr)
def test_constructor_text_gives_the_method_back(method):
    assert eval(repr(method), {name: getattr(symmb, name) for name in symmb.__all__}) == method
    assert pickle.loads(pickle.dumps(method)) == method


@pytest.mark.parametrize("method", [m for m in ALL_METHODS if not isinstance(m, Taylor)], ids=repr)
def test_parameters_out_of_the_box_keep_their_values(method):
    box = Box(w=(0.95, 1.05))
    exact = wave_bounds(Box(amplitude=(1.0, 1.0), w=(0.95, 1.05)))
    result = propagate(Wave(), method, box)
    assert _error(result.lower, result.upper, exact) < LARGEST_ERROR.get(repr(method), 2e-4)


def test_taylor_with_parameters_out_of_the_box():
    result = propagate(Wave(), Taylor(order=3), Box(w=(0.95, 1.05)))
    angle, step = TIMES, 0.05 * TIMES
    even, odd = (-np.cos(angle) * step**2 / 2, np.abs(np.sin(angle) * step) + np.abs(np.sin(angle) * step**3 / 6))
    # x^3 and x are bounded apart, [-1, 1] each.
    np.testing.assert_allclose(result.upper[:, 0], np.cos(angle) + np.maximum(even, 0) + odd, atol=1e-12)
    assert result.evaluations == 4


@pytest.mark.parametrize("method", ALL_METHODS, ids=repr)
def test_function_simulator_serves_every_method_or_says_why_not(method):
    simulator = FunctionSimulator(wave, {"amplitude": 1.0, "w": 1.0}, TIMES, ["x"])
    if isinstance(method, Taylor | Optimization):
        message = r"needs derivatives of the trajectory, but FunctionSimulator\(wave\) gives values only"
    elif getattr(method, "lockstep", False):
        message = r"FunctionSimulator\(wave\) runs each sample separately"
    elif "TaylorModel" in repr(method):
        message = r"needs the equations of a scene, or outputs that.*but FunctionSimulator\(wave\)"
    elif "Interval" in repr(method):
        message = r"plain expressions of parameters and time, but FunctionSimulator\(wave\)"
    else:
        expected = propagate(Wave(), method, BOX).upper
        np.testing.assert_allclose(propagate(simulator, method, BOX).upper, expected, atol=1e-12)
        return
    refused(message, propagate, simulator, method, BOX, error=errors.PropagationError)


def test_what_is_no_parameter_and_no_method_is_told():
    refused(r"no parameter 'amplitud'.*'amplitude'", propagate, Wave(), Vertex(), Box(amplitud=(0, 1)))
    refused("expected a method", propagate, Wave(), 0.5, BOX)
    refused("propagate: got the class Vertex; call it", propagate, Wave(), Vertex, BOX)


WHOLE, SHARE = "must be an integer of at least 1", "tolerance must be a number above 0 and below 1"
OPTIONS = [
    (MonteCarlo, {"samples": [0]}, f"samples {WHOLE}"), (MonteCarlo, {"samples": [1.5]}, "got 1.5"),
    (PolynomialChaos, {"order": [0]}, "order must be an integer"),
    (PolynomialChaos, {"order": [2], "budget": [10]}, "Leave out order"),
    (PolynomialChaos, {"lockstep": [True]}, "give order"), (PolynomialChaos, {"tolerance": [0.0]}, SHARE),
    (PolynomialChaos, {"seconds": [0, -1.0, np.nan, "1", True]}, "seconds must be a number above 0"),
    (PolynomialChaos, {"probes": [-1, 1.5]}, "probes"), (PolynomialChaos, {"probes": [10], "order": [3]}, "probes"),
    (PolynomialChaos, {"range": [symmb.LegendreInclusion()]}, "chooses nodes, basis and range itself"),
    *(  # NumPy has a function `indices`, which is what a basis must have
        (PolynomialChaos, {"order": [2], name: [np]}, f"{name} must be an object such as")
        for name in ("nodes", "basis", "range")
    ),
    (Taylor, {"order": [0]}, f"order {WHOLE}"), (Taylor, {"subintervals": [0]}, f"subintervals {WHOLE}"),
    (symmb.TaylorModel, {"order": [0, 2.5]}, WHOLE), (symmb.TaylorModel, {"boxes": [0]}, WHOLE),
    (Optimization, {"budget": [0]}, f"budget {WHOLE}"), (Optimization, {"tolerance": [1]}, f"{SHARE}, got 1"),
    (Swarm, {"particles": [0]}, f"particles {WHOLE}"), (Swarm, {"steps": [0]}, f"steps {WHOLE}"),
    (Swarm, {"seed": [-1]}, "seed must be an integer of at least 0"),
    (symmb.Exact, {"budget": [0]}, "integer of at least 1"),
    (symmb.Exact, {"tolerance": [0.0, 1.0, np.nan]}, "at least 1e-12 and below 1"),
    (symmb.Bernstein, {"boxes": [0, 1.5]}, "integer of at least 1"),
    (symmb.HyperbolicCross, {"q": [0, -0.5, 1.5, np.nan]}, "^HyperbolicCross: q must be .* above 0 and at most 1, got"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "options", "message"), OPTIONS)
def test_options_out_of_range(make, options, message):
    for values in itertools.product(*options.values()):
        refused(message, make, **dict(zip(options, values, strict=True)))


# Bounds of figures of motions: closed forms, kinks between hills, answers, files.


G = 9.81


@pytest.fixture(scope="module")
def bounds():
    machine = ball(speed=2.0)
    y, box = machine.ball.y, mb.Box(speed=(1.9, 2.1), g=(9.7, 9.9))
    outputs = {"y": y, "height": mb.maximum(y), "landing": mb.first_time(y < 0)}
    scene = machine.scene(outputs, np.linspace(0.0, 1.0, 6), {"ball.vy": machine.p.speed}, box=box)
    return mb.propagate(scene, mb.PolynomialChaos())


LOW, HIGH = 1.9**2 / (2 * 9.9), 2.1**2 / (2 * 9.7)


def test_a_figure_has_a_pair_of_numbers(bounds):
    assert bounds["height"] == pytest.approx((LOW, HIGH), rel=1e-4)
    assert bounds["landing"] == pytest.approx((2 * 1.9 / 9.9, 2 * 2.1 / 9.7), rel=1e-4)
    assert bounds["y"][0].shape == (6,)
    assert bounds.units == ("m", "m", "s")
    assert not bounds.doubts


def test_answers_are_those_of_any_output(bounds):
    worst = bounds.worst("height").upper
    assert worst.parameters == {"mass": 1.0, "g": 9.7, "speed": 2.1}
    assert worst.run()["height"] == pytest.approx(HIGH)
    assert bounds.check({"height": (None, 0.23)}).kept
    assert bounds.check({"landing": (0.4, None)}).kept is False
    contributions = bounds.contributions()
    alone = contributions.alone[0, 1]
    assert alone == pytest.approx([(2.1**2 - 1.9**2) / (2 * G), 2 / 9.7 - 2 / 9.9], rel=1e-3)
    assert "height  " in str(contributions)


def test_tolerances_keep_a_limit_of_a_figure(bounds):
    result = mb.tolerances(bounds.study.simulator.scene, limits={"height": (None, 0.22)})
    assert result.bounds["height"][1] == pytest.approx(0.22, rel=1e-3)


@pytest.mark.parametrize("suffix", ["json", "npz"])
def test_files_hold_figures(bounds, tmp_path, suffix):
    assert reloaded(bounds, tmp_path / f"bounds.{suffix}")["height"] == bounds["height"]
    assert pickle.loads(pickle.dumps(bounds))["height"] == bounds["height"]


def test_reports_and_pictures_show_figures(bounds, tmp_path):
    bounds.report(tmp_path / "report.html", {"height": (None, 0.25)})
    assert "height" in (tmp_path / "report.html").read_text()
    bounds.plot(tmp_path / "bounds.png", "height")
    assert (tmp_path / "bounds.png").stat().st_size


def test_figures_are_bars(bounds):
    """They have no time axis, and the bar is narrower than the panel; limits and other outputs go across."""
    check = bounds.check({"height": (None, 9.0), "y": (None, 9.0)})
    for figure in (bounds.plot(outputs=["height", "y"]), check.plot()):
        bar, curve = figure.axes
        assert not bar.xaxis.get_visible() and curve.xaxis.get_visible()
        assert np.ptp(bar.lines[0].get_xdata()) < 0.5 * np.ptp(bounds.t)
        assert np.ptp(curve.lines[0].get_xdata()) == np.ptp(bounds.t)
        assert np.ptp(bar.get_xlim()) == np.ptp(bounds.t)
    assert [text.get_text() for text in bar.texts] == ["limit"]


def test_figures_alone_have_no_times():
    peak = lambda p: {"peak": mb.maximum(p.a * ca.sin(mb.t), window=(0.0, 3.0))}  # noqa: E731
    bounds = mb.propagate(formulas(peak, [0.0, 4.0], a=(0.9, 1.1)), mb.PolynomialChaos())
    assert bounds.t.tolist() == [0.0]
    assert bounds["peak"] == pytest.approx((0.9, 1.1), rel=1e-6)
    assert "at [s]" not in str(bounds)


def hill(t, at):
    return ca.exp(-(((t - at) / 0.1) ** 2))


def test_peaks_that_jump_from_hill_to_hill_have_honest_bounds():
    peak = lambda p: mb.maximum(p.a * hill(mb.t, 0.5) + (2 - p.a) * hill(mb.t, 1.5))  # noqa: E731
    scene = formulas(lambda p: {"peak": peak(p)}, [0.0, 2.0], a=(0.8, 1.3))  # max(a, 2 - a)
    bounds = mb.propagate(scene, mb.PolynomialChaos())
    assert bounds["peak"] == pytest.approx((1.0, 1.3), abs=max(0.01 * 0.3, bounds.estimate[0, 0]))


def test_a_first_time_that_jumps_is_seen():
    height = lambda p: p.a * hill(mb.t, 0.5) + 2 * hill(mb.t, 1.5)  # noqa: E731
    scene = formulas(lambda p: {"first": mb.first_time(height(p) > 1)}, [0.0, 2.0], a=(0.7, 1.6))
    bounds = mb.propagate(scene, mb.PolynomialChaos())
    lower, upper = 0.5 - 0.1 * np.sqrt(np.log(1.6)), 1.5 - 0.1 * np.sqrt(np.log(2))
    assert bounds["first"] == pytest.approx((lower, upper), abs=0.01 * (upper - lower))


def test_answers_about_figures_tell_no_time():
    outputs = lambda p: {"peak": mb.maximum(p.a * hill(mb.t, 0.5)), "height": p.a * hill(mb.t, 0.5)}  # noqa: E731
    bounds = mb.propagate(formulas(outputs, [0.0, 0.5, 2.0], a=(0.8, 1.3)), mb.PolynomialChaos())
    laws = {"a": scipy.stats.uniform(0.8, 0.5)}
    for answers, times in (("peak", False), ("height", True)):
        limit = bounds.check({answers: (None, 2.0)})
        found = (
            bounds.worst(answers), limit, limit.worst, bounds.quantiles(answers, [0.5], laws=laws),
            bounds.probability(answers, above=1.2, laws=laws),
        )  # fmt: skip
        for answer in found:
            assert bool(re.search(r"at \[s\]|at [\d.]+ s|output time", str(answer))) == times
