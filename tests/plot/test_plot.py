"""What the pictures show: panels, bands, curves, axes."""

import subprocess
import sys

import numpy as np
import pytest

from symmb.results import plot

T = np.linspace(0.0, 1.0, 5)


def curve(label, n_y=1, excess=0.1, error=0.1, runs=9, seconds=0.1):
    ends = np.full((5, n_y), -excess), np.full((5, n_y), 1.0 + excess)
    error = np.broadcast_to(error, n_y)
    return plot.PlottedBounds(plot.family(label), label, "estimate", *ends, error, runs, seconds)


def draw(curves, n_y=1, measured=None, uncertainty=0.0, band=None, **more):
    band = plot.Band("reference: best", np.zeros((5, n_y)), np.ones((5, n_y))) if band is None else band
    names, measured = [f"y{i}" for i in range(n_y)], np.ones(n_y, dtype=bool) if measured is None else measured
    own = {"measured": measured, "uncertainty": np.full(n_y, uncertainty)}
    return plot.plot_comparison(T, names, band, curves, **own, **more)


def error_axes(figure):
    return figure.axes[-1]


def titles(figure):
    return [axes.get_title(loc="left") for axes in figure.axes if axes.get_visible()]


def legend_of(owner):
    return [text.get_text() for text in owner.get_texts()]


@pytest.mark.parametrize(
    ("name", "family"),
    [
        ("PolynomialChaos()", "PolynomialChaos"),
        ("PolynomialChaos(tolerance=0.001, budget=2000)", "PolynomialChaos"),
        ("PolynomialChaos.paper(order=2)", "PolynomialChaos.paper"),
        ("MonteCarlo(1000, sampler=Sobol())", "MonteCarlo(sampler=Sobol())"),
        ("MonteCarlo(100, seed=3)", "MonteCarlo"),
    ],
)
def test_a_family_is_a_method_without_its_numbers(name, family):
    assert plot.family(name) == family


def test_the_most_accurate_setting_stands_for_its_family():
    figure = draw([curve("Scanning(3)", error=0.3), curve("Scanning(9)", error=0.1), curve("Taylor(order=2)")])
    labels = figure.axes[0].get_legend_handles_labels()[1]
    assert sorted(labels) == ["Scanning(9), estimate", "Taylor(order=2), estimate", "reference: best"]


def test_six_panels_at_most_and_the_hardest_outputs_in_them():
    error = np.linspace(0.8, 0.1, 8)
    figure = draw([curve("Scanning(3)", n_y=8, error=error)], n_y=8, measured=np.arange(8) != 1, title="crane")
    assert titles(figure)[:-1] == ["y0", "y2", "y3", "y4", "y5", "y6"]


@pytest.mark.parametrize(("excess", "least", "most"), [(1e6, 0.0, 1.0), (0.2, 0.2, 1.0)])
def test_wild_bounds_do_not_squash_the_reference_and_those_near_it_are_wholly_shown(excess, least, most):
    bottom, top = draw([curve("Taylor(order=2)", excess=excess)]).axes[0].get_ylim()
    assert -most < bottom < -least and 1.0 + least < top < 1.0 + most


def test_one_log_log_curve_a_family_with_its_runs():
    curves = [curve(f"Scanning({k})", error=1 / k, runs=k, seconds=0.01 * k) for k in (21, 3, 6)]
    axes = error_axes(draw([*curves, curve("Taylor(order=2)", runs=77)]))
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert "[s]" in axes.get_xlabel()
    x, y = axes.lines[0].get_data()
    np.testing.assert_allclose(x, [0.03, 0.06, 0.21])
    np.testing.assert_allclose(y, [1 / 3, 1 / 6, 1 / 21])
    assert sorted(text.get_text() for text in axes.texts) == ["21", "3", "6", "77"]
    assert legend_of(axes.get_legend()) == ["Scanning", "Taylor"]


@pytest.mark.parametrize(("error", "uncertainty", "drawn"), [(1e-6, 1e-3, 1e-3), (0.0, 0.0, 1e-16)])
def test_an_error_below_uncertainty_or_rounding_is_a_hollow_marker_on_it(error, uncertainty, drawn):
    axes = error_axes(draw([curve("Scanning(9)", error=error)], uncertainty=uncertainty))
    marker = next(line for line in axes.lines if line.get_marker() == "o" and len(line.get_xdata()))
    assert marker.get_ydata() == [drawn]
    assert marker.get_markerfacecolor() == "white"
    assert axes.get_ylim() == pytest.approx((drawn / 10, drawn * 10))


def test_numbers_keep_clear_of_each_other():
    close = [curve(f"Scanning({k})", error=0.1, runs=k, seconds=0.1 + 1e-4 * k) for k in (3, 4)]
    far = curve("Taylor(order=2)", error=1e-5, seconds=10.0)
    first, second = (np.array(text.get_position()) for text in error_axes(draw([*close, far])).texts[:2])
    assert np.hypot(*(first - second)) > 8.0


def test_endless_errors_are_left_out_of_the_diagram_only():
    figure = draw([curve("Scanning(3)"), curve("Taylor(order=2)", error=np.inf)])
    assert legend_of(error_axes(figure).get_legend()) == ["Scanning"]
    assert "Taylor(order=2), estimate" in figure.axes[0].get_legend_handles_labels()[1]
    nothing = draw([curve("Scanning(3)", error=0.0)], measured=np.zeros(1, dtype=bool))  # to measure
    nothing.draw_without_rendering()


@pytest.mark.parametrize("n", [1, 2, 5])
def test_outputs_without_a_time_are_bars_side_by_side(n):
    values, more = np.stack([np.cos(T), np.full(5, 0.3)], axis=1), (np.ones(2), 9, 0.1)
    curves = [plot.PlottedBounds(f"A{k}", f"A{k}()", "estimate", values - k, values + k, *more) for k in range(n)]
    over_time, bars = draw(curves, 2, band=plot.Band("reference", values - 1, values + 1)).axes[:2]
    assert over_time.xaxis.get_visible() and not bars.xaxis.get_visible()
    ends = np.array([line.get_xdata()[[0, -1]] for line in bars.lines]).reshape(n, 2, 2)
    assert (ends[:, 0] == ends[:, 1]).all()  # both lines of a bar
    assert (np.diff(ends[:, 0].ravel()) > 0).all() and ends.min() > T[0] and ends.max() < T[-1]
    edges = [0.3 + s * k for k in range(n) for s in (-1, 1)]
    assert [line.get_ydata()[0] for line in bars.lines] == pytest.approx(edges)


def test_a_trajectory_has_one_panel_an_output(tmp_path):
    own = plot.plot_trajectory(T, T[:, None] ** np.arange(1, 6), list("abcde"), title="crane")
    figure = plot.save(own, tmp_path / "t.png")
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert titles(figure) == list("abcde")
    np.testing.assert_array_equal(shown[2].lines[0].get_ydata(), T**3)
    assert {axes.get_xlabel() for axes in shown[2:]} == {"time [s]"}  # those with nothing below them
    assert (tmp_path / "t.png").stat().st_size > 1000


def test_bounds_of_the_first_six_outputs():
    lower = np.zeros((5, 8))
    figure = plot.plot_bounds(T, [f"y{i}" for i in range(8)], plot.Band("Vertex(), sampled", lower, lower + 1.0))
    assert titles(figure) == [f"y{i}" for i in range(6)] and figure.get_suptitle() == "the first 6 of 8 outputs"
    assert legend_of(figure.legends[0]) == ["Vertex(), sampled"]


def test_a_single_time_is_a_stretch():
    axes = plot.plot_trajectory(np.array([2.0]), np.array([[7.0]]), ["a"]).axes[0]
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), [7.0, 7.0])
    assert axes.get_xlim() == (1.5, 2.5) and list(axes.get_xticks()) == [2.0]


NOISE = np.array([0.0, 1e-17, -1e-17, 1e-17, 0.0])
ROUNDED = {
    "about 0, beside an output of its unit": (NOISE, "N", True),
    "about 0, of an output of another unit": (NOISE, "m", True),
    "tiny motion of an output of another unit": (1e-17 * np.arange(5) ** 2, "m", False),
    "about 3": (3.0 + 1e3 * NOISE, "m", True),
    "motion about 3": (3.0 + 1e12 * NOISE, "m", False),
}


def share_of_the_height(axes):
    bottom, top = axes.get_ylim()
    return np.ptp(axes.lines[0].get_ydata()) / (top - bottom)


@pytest.mark.parametrize("name", ROUNDED)
def test_rounding_looks_flat(name):
    noise, unit, is_flat = ROUNDED[name]
    values, units = np.stack([noise, 10.0 * T], axis=1), [unit, "N"]
    band = plot.Band("reference: best", values - 1e-18, values + 1e-18)
    own = plot.PlottedBounds("A", "A()", "estimate", band.lower, band.upper, np.zeros(2), 9, 0.1)
    for figure in (
        plot.plot_trajectory(T, values, "ab", units=units),
        plot.plot_family(T, np.stack([values, values]), "ab", ["first", "last"], units=units),
        plot.plot_bounds(T, "ab", band, units=units), draw([own], 2, band=band, units=units),
    ):  # fmt: skip
        share = share_of_the_height(figure.axes[0])
        assert share < 0.02 if is_flat else share > 0.5
        assert "about 0" not in name or "motion" in name or np.ptp(figure.axes[0].get_ylim()) > 0.1
        assert share_of_the_height(figure.axes[1]) > 0.5


def test_pyplot_is_not_touched(tmp_path):
    code = (
        "import sys, numpy as np; from symmb.results import plot\n"
        f"plot.save(plot.plot_trajectory(np.arange(3.0), np.zeros((3, 1)), ['x']), {str(tmp_path / 't.png')!r})\n"
        "print('matplotlib.pyplot' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


def test_lines_of_many_parameters_differ_in_colour_or_dashes():
    names, width, alone = [f"p{k}" for k in range(20)], np.full((2, 1), 20.0), np.ones((2, 1, 20))
    figure = plot.plot_contributions(np.array([0.0, 1.0]), ["y"], names, width, alone, alone)
    lines = figure.axes[0].lines
    assert len({(line.get_color(), str(line._dash_pattern)) for line in lines}) == len(lines) == 21
    plot.png(figure)


def test_legends_tell_of_curves_that_can_be_seen():
    """Of two outputs between 0 and 1, the second may be off by 0.1, and runs attain all but a thousandth of both."""
    lower, upper, error = np.zeros((5, 2)), np.ones((5, 2)), np.array([0.0, 0.1])
    band = plot.Band("band", lower, upper)
    given = {"outer": (lower - error, upper + error), "inner": (lower + 1e-3, upper - 1e-3)}
    figure = plot.plot_bounds(T, ["y0", "y1"], band, **given)
    assert legend_of(figure.legends[0]) == ["band", "widened by the estimated error"]
    assert [len(axes.lines) for axes in figure.axes] == [6, 6]


def test_curves_that_touch_the_bounds_do_not_thicken_them():
    """Runs attain the bounds in the first half, and stay away by a tenth of the height in the second one."""
    t = np.linspace(0.0, 1.0, 40)
    lower, upper = np.zeros((40, 1)), np.ones((40, 1))
    gap = np.where(t < 0.5, 1e-3, 0.1)[:, None]
    figure = plot.plot_bounds(t, ["y"], plot.Band("band", lower, upper), inner=(lower + gap, upper - gap))
    attained = [np.asarray(line.get_ydata()) for line in figure.axes[0].lines[2:]]
    assert all(np.array_equal(np.isnan(y), t < 0.5) for y in attained)
