"""A comparison as JSON, as text and as a picture, and its scores against numbers worked out by hand."""

import json

import numpy as np
import pytest
from black_boxes import reloaded

from symmb import Box, Comparison
from symmb.study.metrics import Yardstick
from symmb.study.reference import Reference
from symmb.study.row import NotRun, Row

T = np.linspace(0.0, 2.0, 5)
ONE = np.ones((5, 2))


def row(reference, name="Vertex()", kind="sampled", short=0.0, **more):
    lower, upper = reference.lower + short, reference.upper
    own = {"estimate": None, "inner": None, "failed": 0} | more
    score = reference.yardstick.score(lower, upper, own["estimate"])
    cost = {"evaluations": 4, "setup_seconds": 0.5, "run_seconds": 0.0123}
    return Row(name=name, kind=kind, lower=lower, upper=upper, score=score, **cost, **own)


def comparison(uncertainty=(1e-3, 1e-3), reference_upper=ONE, **more):
    reference = Reference("Scanning(45)", 0.0 * ONE, reference_upper, np.array(uncertainty), 2554, 0, 1.5)
    methods = {
        "rows": (
            row(reference, short=0.1),
            row(reference, "PolynomialChaos()", "estimate", short=1e-5, estimate=0.01 * ONE, inner=(ONE, ONE)),
        ),
        "not_run": (NotRun("Taylor(order=2)", "It needs derivatives."),),
        **more,
    }
    subject = {"scene": "crane", "times": T, "outputs": ("x", "load [N]"), "box": Box(l1=(0.95, 1.05))}
    cost = {"setup_seconds": 0.5, "threads": 1, "repeats": 3}
    own = np.array([1e-6, 2e-6])
    return Comparison(**subject, solver="IDAS()", reference=reference, solver_error=own, **cost, **methods)


def test_json_has_the_documented_layout():
    layout = json.loads(json.dumps(comparison(not_run=()).to_json()))
    assert set(layout) >= {"scene", "times", "outputs", "box", "solver", "reference", "methods"}
    assert set(layout["reference"]) >= {"method", "lower", "upper", "uncertainty"}
    always = {"name", "kind", "evaluations", "failed", "setup_seconds", "run_seconds"}
    always |= {"error", "over", "under", "coverage", "lower", "upper"}
    assert set(layout["methods"][0]) == always
    assert set(layout["methods"][1]) == always | {"estimate", "inner_lower", "inner_upper"}
    assert layout["box"] == {"l1": [0.95, 1.05]} and layout["outputs"] == ["x", "load [N]"]
    assert np.shape(layout["methods"][0]["lower"]) == (5, 2)
    assert layout["methods"][0]["error"] == pytest.approx([0.1 / np.sqrt(2)] * 2)
    wide = comparison(uncertainty=(np.nan, np.inf))
    assert wide.to_json()["reference"]["uncertainty"] == [None, None]
    json.dumps(wide.to_json(), allow_nan=False)


def test_what_is_saved_is_what_is_loaded_and_drawn(tmp_path):
    saved = comparison()
    loaded = reloaded(saved, tmp_path / "c.json")
    assert loaded.to_json() == saved.to_json()
    assert loaded.rows[1].score.outer_error == pytest.approx(saved.rows[1].score.outer_error)
    assert loaded.not_run == saved.not_run
    assert repr(loaded) == str(loaded) == str(saved) and str(saved).startswith("crane: x, load [N]; ")
    figure = loaded.plot(tmp_path / "c.png")
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["x", "load [N]", "", ""]


def lines_of(printed, word):
    return [line for line in str(printed).splitlines() if word in line]


def test_the_table_is_aligned_and_says_the_kind():
    lines = str(comparison()).splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("method"))
    table = [lines[start], *lines[start + 2 : start + 4]]
    column = table[0].index("kind")
    assert [line[column:].split()[0] for line in table] == ["kind", "sampled", "estimate"]
    ends = {line.index(cell) + len(cell) for line, cell in zip(table, ["error", "7.1e-02", "1.0e-03"], strict=True)}
    assert len(ends) == 1 and table[1].endswith("7.1e-02 x")


def test_an_error_below_the_uncertainty_is_told_as_at_most_that():
    """In the last case, the first output has the larger error, and the second one the larger uncertainty."""
    assert "≤ 1.0e-03" in lines_of(comparison(), "PolynomialChaos()")[0]
    for unknown in (0.0, np.nan):
        assert "≤" not in lines_of(comparison(uncertainty=(unknown, unknown)), "PolynomialChaos()")[0]
    printed = str(comparison(uncertainty=(1e-9, 1e-1)))
    assert "≤ 5.0e-02" in printed and "≤ 1.0e-01 " in printed


def test_the_head_tells_reference_cost_and_the_solvers_own_error():
    text = str(comparison(doubts=("Steps are long.",)))
    assert "\nwarning: Steps are long.\n" in text
    assert "reference: Scanning(45), 2554 runs, 1.5 s; uncertainty 1.0e-03 of the width" in text
    assert "solver's own error: 1.5e-06 of the width, at most 2.0e-06 (load [N])" in text
    assert "Taylor(order=2) did not run: It needs derivatives." in text
    assert "median of at least 3 measurements, 1 thread" in text


def test_an_output_without_width_is_told_apart():
    one = comparison(reference_upper=ONE * [1.0, 0.0])
    left_out = "load [N] does not vary over the box and is left out of the mean errors: absolute error of Vertex() "
    assert left_out + "7.1e-02" in " ".join(str(one).split()) and "7.1e-02 x" in lines_of(one, "Vertex()")[0]
    assert "uncertainty not known" in str(comparison(reference_upper=0.0 * ONE))


def test_failed_runs_are_counted():
    reference = comparison().reference
    printed = comparison(rows=(row(reference, failed=3),))
    assert lines_of(printed, "Vertex()")[0].split()[3] == "3"
    assert lines_of(printed, "failed: number of failed runs")
    assert not lines_of(comparison(), "failed: number of failed runs")


# Scores

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
    score = yardstick().score(LOWER, UPPER)  # the reference itself
    assert score.error == score.outer_error == score.over == score.under == [0.0] and score.coverage == [1.0]


def test_the_estimate_widens_outer_bounds_only():
    bare = yardstick().score(LOWER + 0.1, UPPER - 0.1)
    widened = yardstick().score(LOWER + 0.1, UPPER - 0.1, np.full((2, 1), 0.1))
    assert bare.coverage == [0.0] and widened.coverage == [1.0]
    assert widened.outer_error == pytest.approx([0.0], abs=1e-15)
    assert widened.error == bare.error == bare.outer_error == pytest.approx([0.1 / np.sqrt(5)])
    assert widened.under == bare.under


NORM = np.sqrt(5)
"""The rms width, which is the norm of the uncertainty."""


@pytest.mark.parametrize(
    ("uncertainty", "short", "covered"),
    [(0.04, 0.045 * NORM, 0.0), (0.05, 0.045 * NORM, 1.0), (np.nan, 0.045 * NORM, 0.0), (0, 2.9e-6, 1), (0, 3.1e-6, 0)],
)
def test_coverage_allows_for_the_uncertainty_and_for_a_millionth_of_the_largest_width(uncertainty, short, covered):
    measure = yardstick(uncertainty=uncertainty)
    assert measure.score(LOWER, UPPER - short).coverage == measure.score(LOWER + short, UPPER).coverage == [covered]


@pytest.mark.parametrize("lower", [np.array([[-0.2], [1.3]]), LOWER - 0.1], ids=["on both sides", "outside"])
@pytest.mark.parametrize("unit", [1e-300, 1e-20, 1e-15, 1e-3, 1e6, 1e20, 1e300])
def test_a_change_of_unit_changes_no_score(unit, lower):
    upper = UPPER + [[0.0], [0.1]]
    score = yardstick().score(lower, upper)
    scaled = yardstick(unit * LOWER, unit * UPPER).score(unit * lower, unit * upper)
    assert scaled.error == pytest.approx(score.error) and scaled.error > 0
    assert scaled.over == pytest.approx(score.over) and scaled.coverage == score.coverage


def test_errors_of_an_output_without_width_are_absolute():
    """Rounding noise of a zero output is no width either."""
    constant = np.full((3, 1), 5.0)
    measure = yardstick(constant, constant)
    assert measure.zero_width == [True]
    within = measure.score(constant - 4e-9, constant + 4e-9)
    assert (within.error, within.over, within.under, within.coverage) == ([0.0], [0.0], [0.0], [1.0])
    beyond = measure.score(constant - 0.25, constant)
    assert beyond.error == pytest.approx([0.25 / np.sqrt(2)]) and beyond.over == pytest.approx([0.25])
    assert measure.score(constant + 1e-7, constant + 1e-7).coverage == [0.0]
    noise = np.array([[0.0], [1e-17], [3e-17]])
    score = Yardstick(-noise, noise, np.zeros(1), noise=np.array([1e-17])).score(noise, 2 * noise)
    assert score.error == [0.0] and score.coverage == [1.0]


def test_outputs_are_scored_each_by_itself():
    lower, upper = np.hstack([LOWER, LOWER]), np.hstack([UPPER, UPPER + 10.0])
    score = yardstick(lower, upper).score(lower, np.hstack([UPPER, UPPER]))
    assert score.error[0] == 0.0
    assert score.error[1] == pytest.approx(10.0 / np.sqrt(2) / np.sqrt((11**2 + 13**2) / 2))


def test_infinite_bounds_cover_and_missing_ones_do_not():
    wide = yardstick().score(LOWER - np.inf, UPPER + np.inf)
    assert (wide.error, wide.coverage) == ([np.inf], [1.0])
    gap = yardstick().score(np.array([[0.0], [np.nan]]), UPPER)
    assert np.isnan(gap.error).all() and gap.coverage == [0.5]
