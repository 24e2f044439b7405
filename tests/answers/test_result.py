"""Bounds: what they give, saving and loading; failed samples of sampling methods."""

import re
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.stats
from black_boxes import black_box, black_box_bounds, quietly, reloaded, unit_bounds
from faults import refused, warned
from machines import ball
from oscillators import BOX, TIMES, Wave, wave

import symmb as mb
from symmb.bound.responses.failures import Failure


def _fails_above(amplitude, w):
    if w > 1.04:
        raise RuntimeError("blew up")
    return wave(amplitude, w)


FAILING = mb.FunctionSimulator(_fails_above, {"amplitude": 1.0, "w": 1.0}, TIMES, ["x"])


@pytest.mark.parametrize(
    ("simulator", "method"),
    [(Wave(), mb.PolynomialChaos()), (Wave(), mb.PolynomialChaos(order=3)), (FAILING, mb.Scanning(5))],
)
@pytest.mark.filterwarnings("ignore:.*runs failed:symmb.SymmbWarning")
def test_save_and_load(tmp_path, simulator, method):
    bounds = mb.propagate(simulator, method, BOX)
    loaded = reloaded(bounds, tmp_path / "wave.npz")
    for name in ("t", "lower", "upper", "estimate", "inner"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(bounds, name))
    for name in ("names", "kind", "method", "evaluations", "failed", "seconds", "doubts"):
        assert getattr(loaded, name) == getattr(bounds, name)


def test_outputs_are_doubtful_from_where_the_error_outgrows_the_width():
    t, width = np.linspace(0.0, 10.0, 11), np.ones((11, 3))
    estimate = np.column_stack([np.full(11, 0.05), np.where(t < 6, 0.01, 0.2), np.where(t < 6, 0.2, 0.0)])
    bounds = mb.Bounds(t, ("good", "late", "early"), -width / 2, width / 2, "estimate", "test", 1, estimate)
    assert bounds.doubtful() == {"late": 0.0, "early": 0.0}
    assert bounds.doubtful(0.15) == {"late": 3.0}
    doubt = "The estimated error is above 10 % of the width: late from 6 s, early from 0 to 5 s."
    assert bounds.doubts == (doubt,) and f"warning      {doubt}" in str(bounds)
    assert mb.Bounds(t, ("x",), width[:, :1], width[:, :1], "sampled", "test", 1).doubtful() == {}


def test_times_of_a_large_error_are_in_order():
    """A window that is doubtful because of an error just after it."""
    i = np.arange(201)
    estimate, width = np.where(i < 56, 0.0, 0.03)[:, None], np.where(i < 58, 0.0, 1.0)[:, None]
    bounds = mb.Bounds(i / 100, ("x",), -width / 2, width / 2, "estimate", "test", 1, estimate)
    assert bounds.doubtful_windows() == (("x", 0.54, 0.55),)
    assert bounds._doubtful_part("x", 0.0, bounds.doubtful_windows()) == " at 0.56 s"


def test_outer_is_wider_by_the_estimate():
    bounds = mb.propagate(Wave(), mb.PolynomialChaos(), BOX)
    np.testing.assert_array_equal(bounds.outer, [bounds.lower - bounds.estimate, bounds.upper + bounds.estimate])
    fixed = mb.propagate(Wave(), mb.PolynomialChaos(order=2), BOX)
    assert fixed.outer[0] is fixed.lower and fixed.outer[1] is fixed.upper


def test_outputs_go_by_name_and_the_text_says_the_kind():
    bounds = mb.propagate(Wave(), mb.Vertex(), BOX)
    np.testing.assert_array_equal(bounds["x"], (bounds.lower[:, 0], bounds.upper[:, 0]))
    refused("no output 'y'", bounds.__getitem__, "y")
    assert repr(bounds) == str(bounds)
    assert "sampled (attained by runs" in str(bounds) and "evaluations  4, none failed" in str(bounds)


def test_print_tells_kind_cost_extremes_and_widths():
    bounds = mb.propagate(Wave(), mb.PolynomialChaos(), BOX)
    lines = str(bounds).splitlines()
    assert lines[0] == "Bounds by PolynomialChaos(), 61 times from 0 to 6 s"
    assert lines[1].split()[:2] == ["kind", "estimate"]
    assert lines[2].split() == ["evaluations", f"{bounds.evaluations},", "none", "failed"]
    lower, upper = bounds["x"]
    width = upper - lower
    name, *numbers = lines[-1].replace("≤", "").split()
    assert name == "x"
    extremes = ((lower, lower.argmin()), (upper, upper.argmax()))
    expected = [part for curve, i in extremes for part in (curve[i], TIMES[i], bounds.nominal[i, 0])]
    expected += [width.max(), TIMES[width.argmax()]]
    np.testing.assert_allclose([float(n) for n in numbers[:8]], expected, rtol=1e-5)
    assert float(numbers[8]) == pytest.approx(bounds.estimate.max(), rel=0.05)
    assert str(mb.propagate(Wave(), mb.Vertex(), BOX)).endswith("–")


def test_print_tells_the_nominal_run_of_a_scene_beside_the_extremes():
    machine, box = ball(g=None, speed=2.0), mb.Box(speed=(1.5, 3.0))
    bounds = mb.propagate(machine.scene("x", [0.0, 1.0, 2.0], {"ball.vx": machine.p.speed}, box=box), mb.Vertex())
    np.testing.assert_allclose(bounds.nominal, [[0], [2], [4]], atol=1e-9)
    assert [f"{float(n):g}" for n in str(bounds).splitlines()[-1].split()[1:9]] == "0 0 0 6 2 4 3 2".split()
    assert str(bounds).splitlines()[-2].count("nominal then") == 2
    assert bounds.to_xarray()["nominal"].dims == ("time", "output")


@pytest.mark.parametrize("name", ["polynomials", "threads", "corners"])
def test_a_run_of_a_black_box_at_the_nominal_parameters_is_kept(name):
    """None is made for it: Vertex() has none. The middle of this box is 0.7 but for rounding."""
    calls, t = [], np.array([0.0, 1.0, 2.0])
    simulator = mb.FunctionSimulator(lambda k, m: calls.append(k) or np.exp(k * t) + m, {"k": 0.7, "m": 1.0}, t, ["x"])
    method = mb.Vertex() if name == "corners" else mb.PolynomialChaos()
    with ThreadPoolExecutor(2) as pool:
        bounds = mb.propagate(simulator, method, mb.Box(k=(0.6, 0.8)), executor=pool if name == "threads" else None)
    if name == "corners":
        assert bounds.nominal is None
        refused("nominal parameters are in the middle", bounds.plot, deviation=True)
        return
    assert len(calls) == bounds.evaluations
    np.testing.assert_allclose(bounds.nominal[:, 0], np.exp(0.7 * t) + 1, rtol=1e-13)
    assert bounds.plot(deviation=True).axes and str(bounds).splitlines()[-2].count("nominal then") == 2


def test_rounding_is_printed_as_0():
    lower, upper = np.array([[-1e-16], [1.0]]), np.array([[3e-13], [2.0]])
    bounds = mb.Bounds(np.array([0.0, 1.0]), ("x",), lower, upper, "sampled", "Vertex()", 4, nominal=lower)
    assert str(bounds).splitlines()[-1].split() == ["x", "0", "0", "0", "2", "1", "1", "1", "1", "–"]
    tiny = mb.Bounds(np.array([0.0]), ("x",), lower[:1], -lower[:1], "sampled", "Vertex()", 4)
    assert str(tiny).splitlines()[-1].split()[1:3] == ["-1e-16", "1e-16"]


def test_a_failed_run_tells_its_parameters_and_time_once():
    told = Failure({"w": 2.0}, 0.5, "t = 0.5 s, w = 2, k = 1: it broke")
    assert str(told) == "t = 0.5 s, w = 2, k = 1: it broke"
    assert str(Failure({"w": 2.0}, 0.5, "not finite, however")) == "w=2: t = 0.5: not finite, however"


def test_the_picture(tmp_path):
    bounds = mb.propagate(Wave(), mb.PolynomialChaos(), BOX)
    (axes,) = bounds.plot(tmp_path / "b.png").axes
    assert (tmp_path / "b.png").read_bytes().startswith(b"\x89PNG")
    curves = [*(bounds.lower, bounds.upper), *bounds.outer, *bounds.inner, bounds.nominal]
    for k, (line, curve) in enumerate(zip(axes.lines, curves, strict=True)):
        drawn = np.asarray(line.get_ydata())
        seen = np.isfinite(drawn)
        np.testing.assert_array_equal(drawn[seen], curve[seen, 0])
        assert seen.all() or k in range(2, 6)  # those of the error and of runs end where they touch the bounds
    assert len(mb.propagate(Wave(), mb.Vertex(), BOX).plot().axes[0].lines) == 2


def test_failed_samples_are_told_and_the_others_count():
    told = "5 of 25 runs failed. The bounds use only the other runs"
    bounds = warned(told, mb.propagate, FAILING, mb.Scanning(5), BOX)
    assert bounds.evaluations == 25 and len(bounds.failed) == 5
    assert bounds.failed[0].parameters == pytest.approx({"amplitude": 0.9, "w": 1.05})
    assert "RuntimeError: blew up" in bounds.failed[0].message
    fine = mb.propagate(Wave(), mb.Scanning(5), mb.Box(amplitude=(0.9, 1.1), w=(0.95, 1.05)))
    assert np.isfinite(bounds.lower).all() and (bounds.lower >= fine.lower).all()
    lines = str(bounds).splitlines()
    assert lines[2:4] == ["  evaluations  25, 5 failed:", "    RuntimeError: blew up (amplitude=0.9, w=1.05)"]
    assert lines[6] == "    and 2 more"


def test_all_samples_failed():
    box = mb.Box(w=(1.041, 1.05), amplitude=(1, 1))
    refused(r"all 4 runs failed(.|\n)*blew up", mb.propagate, FAILING, mb.Vertex(), box, error=mb.PropagationError)


@pytest.mark.parametrize("sampler", [mb.Random(), mb.Sobol(), mb.LatinHypercube()], ids=repr)
def test_samplers_fill_the_box_and_repeat_by_seed(sampler):
    points = sampler.points(300, 3, seed=5)
    assert points.shape == (300, 3) and np.abs(points).max() <= 1
    np.testing.assert_array_equal(points, sampler.points(300, 3, seed=5))
    assert (points != sampler.points(300, 3, seed=6)).any()
    # Mean square 1/3 with a standard deviation of 0.3 / sqrt(300) for independent points.
    np.testing.assert_allclose((points**2).mean(axis=0), 1 / 3, atol=0.09)


def test_latin_hypercube_has_one_point_a_slice():
    slices = np.floor((mb.LatinHypercube().points(50, 2, 0) + 1) * 25)
    assert (np.sort(slices, axis=0) == np.arange(50)[:, None]).all()


@pytest.mark.filterwarnings("ignore:.*Check runs show errors:symmb.SymmbWarning")
def test_same_seed_same_bounds():
    first, second, other = (mb.propagate(Wave(), mb.MonteCarlo(50, seed=seed), BOX).lower for seed in (3, 3, 4))
    assert (first == second).all() and (first != other).any()


@pytest.mark.parametrize(
    ("f", "noise", "method"),
    [
        (lambda a, b: np.exp(a * b), None, mb.PolynomialChaos(tolerance=1e-300, budget=300)),
        (lambda a, b: np.exp(a * b), None, mb.PolynomialChaos(tolerance=1e-9)),
        (lambda a, b: abs(a - 0.3 * b + 0.1) + a, None, mb.PolynomialChaos(tolerance=1e-4, budget=100)),
        (lambda a, b: np.sin(a + b), {"x": 1e-3}, mb.PolynomialChaos(tolerance=1e-5)),
    ],
)
def test_a_tolerance_that_is_not_reached_is_told(tmp_path, f, noise, method):
    simulator, box = black_box(f, outputs="x", noise=noise, a=(-1.0, 1.0), b=(-1.0, 1.0))
    bounds = mb.propagate(simulator, method, box)
    (remark,) = bounds.remarks
    assert remark.startswith(f"The tolerance {method.tolerance:g} of the method was not reached: the estimated error")
    assert float(re.search(r"error of x is (\S+) times", remark)[1]) > method.tolerance and remark in str(bounds)
    assert reloaded(bounds, tmp_path / "b.json").remarks == bounds.remarks
    assert mb.propagate(simulator, mb.PolynomialChaos(tolerance=0.1), box).remarks == ()


@pytest.mark.parametrize(
    ("f", "d", "n_t", "name"),
    [
        (lambda x, t: np.exp(x[0] * x[1]) * t, 2, 5, "an interpolant on a tensor grid"),
        (lambda x, t: np.sin(25 * x[0]) * t, 1, 5, "an interpolant on a tensor grid"),
        (lambda x, t: (x[0] + x[1] / 2 > 0.3) + 0 * t, 2, 5, r"interpolants on \d+ tensor grids"),
        (lambda x, t: (x[0] > 0.3) * t, 1, 5, "runs near kinks"),
        (lambda x, t: sum(x) * t, 5, 40, "runs at corners"),
        (lambda x, t: np.cos(x[0] - x[1] + 3 * t) + x[2] * x[3], 4, 40, "an interpolant on a sparse grid"),
        (lambda x, t: np.cos(2 * x[0] + x[1]) + x[2] * x[3] + 0 * t, 4, 1, "a response surface"),
        (lambda x, t: np.abs(np.sin(9 * sum(x) + 5 * t)), 4, 40, "runs near extremes"),
    ],
)
def test_bounds_tell_whose_range_they_are(tmp_path, f, d, n_t, name):
    times = np.linspace(1.0, 2.0, n_t)
    bounds = quietly(unit_bounds, lambda x: f(x, times), d, None, times)
    assert re.fullmatch(name, bounds.range_of) and bounds.range_of in str(bounds)
    assert reloaded(bounds, tmp_path / "b.json").range_of == bounds.range_of


@pytest.mark.parametrize(("time", "is_told"), [(0.0, False), (2.0, True)])
def test_an_only_time_of_0_is_neither_told_nor_drawn(tmp_path, time, is_told):
    """As of a result without times. Another only time means something."""
    bounds = black_box_bounds(lambda a, b: a + b**2, None, [time], a=(0.9, 1.1), b=(0.9, 1.1))
    worst, check = bounds.worst("y"), bounds.check({"y": (None, 3)})
    again = reloaded(bounds, tmp_path / "b.json").worst("y")
    law = {name: scipy.stats.uniform(0.9, 0.2) for name in "ab"}
    figures = bounds.quantiles("y", 0.9, law), bounds.probability("y", above=2, laws=law), bounds.samples(9, law)
    for result in (bounds, bounds.contributions(), worst, worst.upper, again, again.upper, check, *figures):
        assert any(text in str(result) for text in ("at [s]", "at 2 s")) == is_told and " 0 s" not in str(result)
    for figure in (bounds.plot(), check.plot()):
        drawn = [*figure.axes[0].get_xticks()], figure.axes[0].get_xlabel()
        assert drawn == (([2.0], "time [s]") if is_told else ([], ""))


def test_an_only_time_of_0_is_not_told_of_runs_that_fail():
    broken = mb.FunctionSimulator(lambda a: [[np.nan]], {"a": 1.0}, [0.0], ["y"])
    assert broken.run([[1.0]]).messages == ("y is not finite (a=1)",)
