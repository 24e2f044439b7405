"""A comparison as JSON, as text and as a picture."""

import json

import numpy as np
import pytest

from symmb import Box, Comparison
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
    assert layout["box"] == {"l1": [0.95, 1.05]}
    assert layout["outputs"] == ["x", "load [N]"]
    assert np.shape(layout["methods"][0]["lower"]) == (5, 2)
    assert layout["methods"][0]["error"] == pytest.approx([0.1 / np.sqrt(2)] * 2)


def test_numbers_that_are_not_finite_are_null():
    wide = comparison(reference_upper=np.where(ONE > 0, 1.0, 0.0), uncertainty=(np.nan, np.inf))
    assert wide.to_json()["reference"]["uncertainty"] == [None, None]
    json.dumps(wide.to_json(), allow_nan=False)


def test_what_is_saved_is_what_is_loaded(tmp_path):
    saved = comparison()
    saved.save(tmp_path / "c.json")
    loaded = Comparison.load(tmp_path / "c.json")
    assert loaded.to_json() == saved.to_json()
    assert loaded.rows[1].score.outer_error == pytest.approx(saved.rows[1].score.outer_error)
    assert loaded.not_run == saved.not_run
    assert str(loaded) == str(saved)


def lines_of(printed, word):
    return [line for line in str(printed).splitlines() if word in line]


def test_the_table_is_aligned_and_says_the_kind():
    lines = str(comparison()).splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("method"))
    table = [lines[start], *lines[start + 2 : start + 4]]
    column = table[0].index("kind")
    assert [line[column:].split()[0] for line in table] == ["kind", "sampled", "estimate"]
    ends = {line.index(cell) + len(cell) for line, cell in zip(table, ["error", "7.1e-02", "1.0e-03"], strict=True)}
    assert len(ends) == 1
    assert table[1].endswith("7.1e-02 x")


def test_an_error_below_the_uncertainty_is_told_as_at_most_that():
    assert "≤ 1.0e-03" in lines_of(comparison(), "PolynomialChaos()")[0]
    assert "≤" not in lines_of(comparison(uncertainty=(0.0, 0.0)), "PolynomialChaos()")[0]
    assert "≤" not in lines_of(comparison(uncertainty=(np.nan, np.nan)), "PolynomialChaos()")[0]


def test_the_worst_output_is_not_better_than_the_mean():
    """The first output has the larger error, and the second one the larger uncertainty, which is told instead."""
    printed = str(comparison(uncertainty=(1e-9, 1e-1)))
    assert "≤ 5.0e-02" in printed and "≤ 1.0e-01 " in printed


def test_the_head_tells_reference_cost_and_the_solvers_own_error():
    text = str(comparison())
    assert "reference: Scanning(45), 2554 runs, 1.5 s; uncertainty 1.0e-03 of the width" in text
    assert "solver's own error: 1.5e-06 of the width, at most 2.0e-06 (load [N])" in text
    assert "Taylor(order=2) did not run: It needs derivatives." in text
    assert "median of at least 3 measurements, 1 thread" in text


def test_an_output_without_width_is_told_apart():
    upper = ONE * [1.0, 0.0]
    told = " ".join(str(comparison(reference_upper=upper)).split())
    assert (
        "load [N] does not vary over the box and is left out of the mean errors: absolute error of Vertex() 7.1e-02"
        in told
    )
    assert "7.1e-02 x" in lines_of(comparison(reference_upper=upper), "Vertex()")[0]


def test_only_outputs_without_width():
    assert "uncertainty not known" in str(comparison(reference_upper=0.0 * ONE))


def test_failed_runs_are_counted():
    reference = comparison().reference
    printed = comparison(rows=(row(reference, failed=3),))
    assert lines_of(printed, "Vertex()")[0].split()[3] == "3"
    assert lines_of(printed, "failed: number of failed runs")
    assert not lines_of(comparison(), "failed: number of failed runs")


def test_the_picture(tmp_path):
    figure = comparison().plot(tmp_path / "c.png")
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["x", "load [N]", ""]


def test_repr_is_short():
    assert repr(comparison()) == str(comparison())
    assert repr(comparison()).startswith("crane: x, load [N]; ")
