"""Pictures in axes of the caller, of chosen outputs, with one colour a method and units; and what pictures show."""

import pickle
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from faults import refused
from machines import spring_mass
from matplotlib import rcParams
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

import symmb as mb
from symmb.results import plot
from symmb.results.plot.colours import RUN_COLOUR
from symmb.study.stability import Stability

SPRUNG = spring_mass(stiffness=40.0)
BALL, START, BOX = SPRUNG.ball, {"ball.x": 0.1, "ball.vy": 1.0}, mb.Box(stiffness=(36.0, 44.0))
OUTPUTS = {"x": BALL.x, "vy": BALL.vy, "force": SPRUNG.p.stiffness * BALL.x}
SCENE = SPRUNG.scene(OUTPUTS, np.linspace(0.0, 1.0, 6), START, box=BOX)
RESTING = mb.Scene(SPRUNG.system, outputs={"x": BALL.x})


@cache
def a_run():
    return mb.simulate(SCENE)


@cache
def some_bounds():
    return mb.propagate(SCENE, mb.PolynomialChaos(order=3))


@cache
def a_comparison():
    return mb.compare(SCENE, [mb.Vertex(), mb.PolynomialChaos(), mb.PolynomialChaos.paper(2)])


@pytest.fixture
def result(request):
    return request.param()


RESULTS = pytest.mark.parametrize("result", [a_run, some_bounds, a_comparison], indirect=True)


def colours(axes):
    return {to_hex(line.get_color()) for line in axes.lines}


def legend_of(owner):
    """Texts of the legend of axes, or of the first one of a figure."""
    legend = owner.legends[0] if isinstance(owner, Figure) else owner.get_legend()
    return [text.get_text() for text in legend.get_texts()]


def looks(*all_axes):
    return [[axes.get_position().bounds for axes in all_axes], all_axes[-1].get_xlim(), all_axes[-1].get_ylim()]


@RESULTS
def test_no_path_is_needed_and_a_figure_comes_back(result, tmp_path):
    assert isinstance(result.plot(), Figure)
    result.plot(tmp_path / "p.png")
    assert (tmp_path / "p.png").stat().st_size > 1000


@RESULTS
def test_chosen_outputs(result):
    figure = result.plot(outputs=["force", "x"])
    titles = [axes.get_title(loc="left") for axes in figure.axes if axes.get_title(loc="left")]
    assert titles == ["force", "x [m]"]  # the unit of the force is not known: it may be any


@RESULTS
def test_given_axes_are_used_and_others_left_alone(result):
    figure = Figure()
    left, right = figure.subplots(1, 2)
    right.plot([1, 2], [3, 4])
    before = looks(left, right)
    assert result.plot(outputs="x", ax=left) is figure and looks(left, right) == before
    assert len(right.lines) == 1 and len(figure.axes) == 2 and len(left.lines) >= 1
    assert (left.get_xlabel(), left.get_ylabel()) == ("time [s]", "x [m]")
    assert not right.get_xlabel() and figure.get_suptitle() == ""


@RESULTS
def test_axes_for_each_output(result):
    panels = Figure().subplots(3, 1)
    result.plot(ax=panels)
    assert [axes.get_ylabel() for axes in panels] == ["x [m]", "vy [m/s]", "force"]


def test_all_outputs_of_a_run_in_one_axes():
    axes = Figure().subplots()
    a_run().plot(ax=axes)
    assert len(axes.lines) == 3 and len(colours(axes)) == 3
    assert axes.get_ylabel() == ""  # they differ
    np.testing.assert_array_equal(axes.lines[1].get_ydata(), a_run()["vy"])


def test_the_errors_of_a_comparison_in_one_axes():
    axes = Figure().subplots()
    a_comparison().plot(ax=axes)
    assert axes.get_yscale() == "log" and "[s]" in axes.get_xlabel()


@RESULTS
def test_malformed_axes_outputs_and_sizes_are_refused(result):
    for ax in (3, np.ones(3), np.broadcast_to(np.array(None), 10**9)):
        refused("ax must be matplotlib Axes", result.plot, ax=ax)
    for outputs in (3, {"x": 1}, [3], ["z"]):
        refused("outputs must be a name|no output", result.plot, outputs=outputs)
    refused(r"no output 'forse'.*'force'", result.plot, outputs="forse")
    refused("figsize is for new figures", result.plot, outputs="x", ax=Figure().subplots(), figsize=(4, 3))
    if not isinstance(result, mb.Trajectory):
        refused(r"2 outputs .* need 2 axes", result.plot, outputs=["x", "vy"], ax=Figure().subplots())


def test_limits_fits_and_stability_in_given_axes():
    figure = Figure()
    first, second = figure.subplots(1, 2)
    assert some_bounds().check({"x": (None, 1.0)}).plot(ax=second) is figure
    assert not first.lines and second.lines[-1].get_ydata() == [1.0, 1.0]
    assert EVERY_PICTURE["Calibration"]().plot(ax=first) is figure
    assert legend_of(first) == ["data", "fitted run"]
    study = EVERY_PICTURE["Stability"]()
    first, second = figure.subplots(1, 2)
    assert study.plot(ax=first) is figure and not second.get_xlabel()
    assert isinstance(study.plot(), Figure)


@pytest.mark.parametrize("name", ["LimitCheck", "Calibration"])
def test_the_size_of_limits_and_fits_stands_before_axes(name):
    assert EVERY_PICTURE[name]().plot(None, "x", (4, 3), "title").get_size_inches().tolist() == [4, 3]


def test_a_method_has_one_colour_in_every_picture():
    alone = colours(some_bounds().plot(outputs="x").axes[0])
    assert alone == {plot.colour_of("PolynomialChaos"), RUN_COLOUR}  # that of the nominal run
    together = colours(a_comparison().plot(outputs="x").axes[0])
    errors = colours(a_comparison().plot().axes[-1])
    names = ("PolynomialChaos", "PolynomialChaos.paper", "Vertex")
    assert together == {plot.colour_of(name) for name in names}
    assert together <= errors


@pytest.mark.parametrize("of", ["METHODS", "SOLVERS"])
def test_all_methods_and_solvers_differ(of):
    from symmb.bound.methods import METHODS
    from symmb.run.integrate import SOLVERS

    if of == "METHODS":
        families = {plot.family(repr(m)).partition("(")[0] for e in METHODS for m in (*e.examples, *e.compared(2))}
    else:
        families = {entry.family for entry in SOLVERS if entry.ladder is not None}
    assert len({plot.colour_of(name) for name in families}) == len(families) > 5


def test_figures_show_themselves_and_can_be_pickled():
    figure = a_run().plot()
    data, size = figure._repr_png_()
    assert data.startswith(b"\x89PNG") and size["width"] == 800
    assert pickle.loads(pickle.dumps(figure))._repr_png_()[0].startswith(b"\x89PNG")


EVERY_PICTURE = {
    "Trajectory": a_run,
    "Bounds": some_bounds,
    "Comparison": a_comparison,
    "Contributions": lambda: some_bounds().contributions(),
    "LimitCheck": lambda: some_bounds().check({"x": (None, 1.0)}),
    "Sweep": lambda: mb.sweep(SCENE, {"stiffness": [36.0, 44.0]}),
    "Sensitivities": lambda: mb.sensitivities(SCENE),
    "Calibration": lambda: mb.calibrate(SCENE, {"x": a_run()["x"] + 1e-3 * np.sin(9 * a_run().t)}, ["stiffness"]),
    "Stability": lambda: Stability("scene", np.array([0.0, 1.0]), (), (), {}, np.nan, {}, "advice"),
    "RootLocus": lambda: mb.root_locus(RESTING, "stiffness", (36.0, 44.0), count=3),
}


@pytest.fixture(scope="module", params=EVERY_PICTURE)
def pictured(request):
    return request.param, EVERY_PICTURE[request.param]()


def test_size_and_title_of_every_picture(pictured, tmp_path):
    _, result = pictured
    figure = result.plot(tmp_path / "p.png", figsize=(4, 3.5), title="of $x$")
    assert figure.get_size_inches().tolist() == [4, 3.5]
    assert [part.get_suptitle() for part in (figure, *figure.subfigs) if part.get_suptitle()] == [r"of \$x\$"]
    assert (tmp_path / "p.png").stat().st_size > 1000


@pytest.mark.parametrize(
    "wrong",
    [
        {"figsize": 3}, {"figsize": (0, 1)}, {"figsize": (8, 1e6)}, {"figsize": ("a", 1)}, {"title": 3}, {"label": 3},
        {"label": ["a"] * 9}, {"color": "reddish"}, {"color": ["r"] * 9}, {"legend": "no"},
    ],
)  # fmt: skip
def test_wrong_sizes_titles_labels_colours_and_legends_are_refused(pictured, wrong):
    owner, result = pictured
    refused(rf"^{owner}\.plot: {next(iter(wrong))} must be [^\n]*$", result.plot, **wrong)


def test_the_nominal_run_is_drawn_beside_its_bounds():
    figure = some_bounds().plot(outputs="x")
    line = {line.get_label(): line for line in figure.axes[0].lines}["nominal run"]
    np.testing.assert_allclose(line.get_ydata(), a_run()["x"], atol=1e-9)
    assert "nominal run" in legend_of(figure)


def test_deviations_from_the_nominal_run():
    axes = some_bounds().plot(outputs="x", deviation=True).axes[0]
    assert axes.get_title(loc="left") == "x − nominal [m]"
    lines = [line.get_ydata() for line in axes.lines]
    np.testing.assert_array_equal(lines[0], some_bounds().lower[:, 0] - some_bounds().nominal[:, 0])
    np.testing.assert_array_equal(lines[1], some_bounds().upper[:, 0] - some_bounds().nominal[:, 0])
    assert not lines[-1].any()
    unknown = mb.Bounds(a_run().t, ("x",), a_run().values[:, :1], a_run().values[:, :1], "sampled", "Vertex()", 4)
    refused("deviation needs the nominal run", unknown.plot, deviation=True)
    refused("deviation must be True or False", some_bounds().plot, deviation="yes")


def test_labels_colours_and_legends_of_every_picture(pictured):
    """One label and colour are for the curves of each, and a legend is drawn if it is asked for."""
    name, result = pictured
    figure = result.plot(label="mine $", color="#ff1493", legend=False)
    lines = [line for axes in figure.axes for line in axes.lines]
    drawn = {to_hex(line.get_color()) for line in lines}
    drawn |= {to_hex(patch.get_facecolor()) for axes in figure.axes for patch in axes.patches}
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes), *(p.legends for p in figure.subfigs)]
    assert not any(legends)
    if name != "Stability":  # this one has no trials
        assert "#ff1493" in drawn
        assert any("mine $" in axes.get_legend_handles_labels()[1] for axes in figure.axes)


def test_labels_and_colours_of_each_curve():
    axes = Figure().subplots()
    EVERY_PICTURE["Sweep"]().plot(outputs="x", ax=axes, label=["soft", "hard"], color=["r", (0.0, 0.5, 0.0)])
    assert legend_of(axes) == ["soft", "hard"]
    assert [to_hex(line.get_color()) for line in axes.lines] == ["#ff0000", "#008000"]


@pytest.mark.parametrize("size", [(2.2, 1.8), (3.1, 2.4), (6.0, 4.0)])
def test_a_legend_stays_inside_the_axes_of_the_caller(size):
    figure = Figure(figsize=size)
    first, second, third = figure.subplots(1, 3)
    for result, axes in zip((a_comparison(), some_bounds(), a_run()), figure.axes, strict=True):
        result.plot(outputs="x", ax=axes)
    figure.draw_without_rendering()
    assert third.get_legend() is None  # there is one line
    for axes in (first, second):
        if (legend := axes.get_legend()) is not None:
            box, room = legend.get_window_extent(), axes.bbox
            assert room.x0 <= box.x0 and box.x1 <= room.x1 and room.y0 <= box.y0 and box.y1 <= room.y1
    assert size[0] < 6 or (first.get_legend() and second.get_legend())


def test_a_legend_of_one_line_or_none_is_asked_for():
    axes, other = Figure().subplots(1, 2)
    a_run().plot(outputs="x", ax=axes, legend=True)
    assert legend_of(axes) == ["x"]
    some_bounds().plot(outputs="x", ax=other, legend=False)
    assert other.get_legend() is None
    assert a_run().plot(legend=True).legends and not a_run().plot().legends


def test_fonts_of_pdf_files_are_of_type_42_and_settings_stay(tmp_path):
    before = dict(rcParams)
    some_bounds().plot(tmp_path / "b.pdf")
    pdf = (tmp_path / "b.pdf").read_bytes()
    assert b"/CIDFontType2" in pdf and b"/Type3" not in pdf
    assert dict(rcParams) == before


@pytest.mark.parametrize(
    ("unit", "printed"),
    [
        ("m/s^2", "m/s²"), ("kg m^2/s^3", "kg m²/s³"), ("m^-12", "m⁻¹²"), ("deg/s", "°/s"), ("um", "µm"),
        ("degree of use", "degree of use"), ("us/rad^2", "µs/rad²"), ("N m", "N m"),
    ],
)  # fmt: skip
def test_units_are_typeset(unit, printed):
    values = np.zeros((2, 2))
    assert plot.labels(["y"], [unit]) == (f"y [{printed}]",)
    axes = Figure().subplots()
    plot.plot_trajectory(np.arange(2.0), values, ["a", "b"], units=[unit, unit], style=plot.Style(ax=axes))
    assert axes.get_ylabel() == f"[{printed}]"


def test_lines_of_contributions_are_the_widths_of_each_parameter():
    contributions = some_bounds().contributions()
    (axes,) = contributions.plot(outputs="x").axes
    whole, *alone = axes.lines
    k = contributions.names.index("x")
    np.testing.assert_array_equal(whole.get_ydata(), contributions.width[:, k])
    assert [line.get_label() for line in alone] == ["stiffness"]
    np.testing.assert_array_equal(alone[0].get_ydata(), contributions.alone[:, k, 0])
    first, second = contributions.plot(outputs="x", time=1.0).axes[0].patches
    heights = [contributions.alone[-1, k, 0], contributions.saved[-1, k, 0]]
    assert [first.get_height(), second.get_height()] == heights and first.get_x() + first.get_width() < second.get_x()
    own = Figure().subplots()
    contributions.plot(outputs="x", ax=own)
    assert len(own.lines) == 2 and own.get_ylabel() == "width of x [m]"


def test_scalar_outputs_have_no_time_axis():
    outputs = {"x": BALL.x, "v": BALL.vx, "peak": mb.maximum(BALL.vx), "low": mb.minimum(BALL.vx)}
    scene = SPRUNG.scene(outputs, np.linspace(0, 3, 31), {"ball.x": 1.0}, box=BOX)
    bounds = mb.propagate(scene)
    for figure in (mb.simulate(scene).plot(), bounds.plot(), bounds.contributions().plot()):
        x, v, *scalars = [axes for axes in figure.axes if axes.get_visible()]
        assert [axes.xaxis.get_visible() for axes in (x, v, *scalars)] == [True, True, False, False]
        assert {axes.get_xlabel() for axes in (x, v)} == {"time [s]"}
        for axes in scalars:
            low, high = axes.lines[0].get_xdata()[[0, -1]]
            assert 0 < low < high < 3


# What the pictures show: panels, bands, curves, axes

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


def draw_in(axes, curves):
    """The errors against run time in a single axes."""
    return draw(curves, style=plot.Style("test", axes))


def error_axes(figure):
    return figure.axes[-1]


def titles(figure):
    return [axes.get_title(loc="left") for axes in figure.axes if axes.get_visible()]


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
    assert titles(figure)[:-2] == ["y0", "y2", "y3", "y4", "y5", "y6"]


@pytest.mark.parametrize(("excess", "least", "most"), [(1e6, 0.0, 1.0), (0.2, 0.2, 1.0)])
def test_wild_bounds_do_not_squash_the_reference_and_those_near_it_are_wholly_shown(excess, least, most):
    bottom, top = draw([curve("Taylor(order=2)", excess=excess)]).axes[0].get_ylim()
    assert -most < bottom < -least and 1.0 + least < top < 1.0 + most


def test_one_log_log_curve_a_family_with_its_runs():
    curves = [curve(f"Scanning({k})", error=1 / k, runs=k, seconds=0.01 * k) for k in (21, 3, 6)]
    curves.append(curve("Taylor(order=2)", runs=77))
    for axes, label, x in zip(draw(curves).axes[-2:], ("runs", "[s]"), ([3, 6, 21], [0.03, 0.06, 0.21]), strict=True):
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
        assert label in axes.get_xlabel() and not axes.texts
        np.testing.assert_allclose(axes.lines[0].get_data(), [x, [1 / 3, 1 / 6, 1 / 21]])
    assert legend_of(axes) == ["Scanning", "Taylor"]
    own = Figure().subplots()
    draw_in(own, curves)
    assert "[s]" in own.get_xlabel()
    assert sorted(text.get_text() for text in own.texts) == ["21", "3", "6", "77"]


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
    own = Figure().subplots()
    draw_in(own, [*close, far])
    first, second = (np.array(text.get_position()) for text in own.texts[:2])
    assert np.hypot(*(first - second)) > 8.0


def test_endless_errors_are_left_out_of_the_diagram_only():
    figure = draw([curve("Scanning(3)"), curve("Taylor(order=2)", error=np.inf)])
    assert legend_of(error_axes(figure)) == ["Scanning"]
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
    assert legend_of(figure) == ["Vertex(), sampled"]


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


def test_colours_of_many_curves_differ_from_those_beside_them_and_the_legend_names_three():
    figure = plot.plot_family(T, np.zeros((9, 5, 1)), ["y"], [*"abcdefghi"])
    drawn = np.array([to_rgb(line.get_color()) for line in figure.axes[0].lines])
    assert np.abs(np.diff(drawn, axis=0)).max(axis=1).min() > 0.05 and legend_of(figure) == ["a", "e", "i"]


def test_legends_tell_of_curves_that_can_be_seen():
    """Of two outputs between 0 and 1, the second may be off by 0.1, and runs attain all but a thousandth of both."""
    lower, upper, error = np.zeros((5, 2)), np.ones((5, 2)), np.array([0.0, 0.1])
    band = plot.Band("band", lower, upper)
    given = {"outer": (lower - error, upper + error), "inner": (lower + 1e-3, upper - 1e-3)}
    figure = plot.plot_bounds(T, ["y0", "y1"], band, **given)
    assert legend_of(figure) == ["band", "widened by the estimated error"]
    assert [len(axes.lines) for axes in figure.axes] == [6, 6]


def test_curves_that_touch_the_bounds_do_not_thicken_them():
    """Runs attain the bounds in the first half, and stay away by a tenth of the height in the second one."""
    t = np.linspace(0.0, 1.0, 40)
    lower, upper = np.zeros((40, 1)), np.ones((40, 1))
    gap = np.where(t < 0.5, 1e-3, 0.1)[:, None]
    figure = plot.plot_bounds(t, ["y"], plot.Band("band", lower, upper), inner=(lower + gap, upper - gap))
    attained = [np.asarray(line.get_ydata()) for line in figure.axes[0].lines[2:]]
    assert all(np.array_equal(np.isnan(y), t < 0.5) for y in attained)
