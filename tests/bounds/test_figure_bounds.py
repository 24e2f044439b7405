"""Bounds of figures of motions: closed forms, kinks between hills, answers, files."""

import pickle
import re

import casadi as ca
import numpy as np
import pytest
import scipy.stats
from black_boxes import reloaded
from machines import ball
from small_scenes import formulas

import symmb as mb

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
