"""Pictures in the caller's axes, of chosen outputs, with one colour a method and units."""

import pickle
from functools import cache

import numpy as np
import pytest
from faults import refused
from machines import spring_mass
from matplotlib import rcParams
from matplotlib.colors import to_hex
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
    from symmb.bound.bounds import METHODS
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
