"""Traces of adaptive studies: their rounds, and the rule that decides each estimated error."""

import itertools

import numpy as np
import pytest
from black_boxes import black_box_bounds
from faults import refused

import symmb as mb
from models import double_pendulum
from symmb.bound.responses.trace import RULES

T = np.linspace(0.0, 1.0, 11)


def studied(f, method=None, **box):
    return black_box_bounds(f, method, T, "x", **box)


def kink(a):
    return np.abs(a - 0.3 * T)


def ridge(a, b, c, d):
    return np.exp(-((a + 0.5 * b * T - 0.3 * c + 0.1 * d) ** 2) * 4)


STUDIES = {
    "smooth": lambda: studied(lambda a, b: np.sin(a + b * T), a=(0.0, 1.0), b=(0.5, 2.0)),
    "kinks": lambda: studied(kink, a=(-1.0, 1.0)),
    "four parameters": lambda: studied(ridge, a=(-1, 1), b=(-1, 1), c=(-1, 1), d=(-1, 1)),
    "monotonic": lambda: studied(lambda a, b, c, d: a + b * T + c**3 - d, a=(1, 2), b=(1, 2), c=(1, 2), d=(1, 2)),
    "scene": lambda: mb.propagate(double_pendulum.scene()),
}


@pytest.fixture(scope="module", params=STUDIES)
def bounds(request):
    return STUDIES[request.param]()


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_a_trace_counts_all_runs_and_ends_with_the_estimate(bounds):
    trace = bounds.trace
    assert sum(step.runs for step in trace) == bounds.evaluations
    assert [step.round for step in trace] == list(range(1, len(trace) + 1))
    assert {step.rule for step in trace} <= RULES.keys() and {step.output for step in trace} <= {*bounds.names}
    width = np.sqrt(np.mean(np.square(bounds.upper - bounds.lower), axis=0))
    error = np.sqrt(np.mean(np.square(bounds.estimate), axis=0)) / width
    assert trace[-1].after == pytest.approx(error.max(), rel=0.2)
    assert trace[-1].output == bounds.names[int(error.argmax())]
    for before, after in itertools.pairwise(trace):
        known = [step.after for step in trace[: before.round] if step.output == after.output]
        assert after.before == known[-1] if known else np.isnan(after.before)


def test_the_rule_is_that_of_the_largest_error(bounds):
    name = bounds.names[-1]
    i = int(np.argmax(bounds.estimate[name]))
    rule = RULES[bounds.trace.rule(i, len(bounds.names) - 1)]
    told = bounds.why(name)
    assert rule.cause[1:] in told and told.endswith(rule.remedy)
    assert f"{bounds.estimate[name][i]:.2g}" in told and f"t = {bounds.t[i]:g} s" in told
    assert bounds.why(name, float(bounds.t[i]) + 1e-9) == told


def test_traces_are_saved_printed_and_tables(bounds, tmp_path):
    for suffix in "json", "npz":
        bounds.save(tmp_path / f"b.{suffix}")
        loaded = mb.Bounds.load(tmp_path / f"b.{suffix}")
        assert repr(loaded.trace) == repr(bounds.trace)
        np.testing.assert_array_equal(loaded.trace.rules, bounds.trace.rules)
        assert loaded.why(bounds.names[0]) == bounds.why(bounds.names[0])
    assert len(str(bounds.trace).splitlines()) == 1 + len(bounds.trace)
    pytest.importorskip("pandas")
    table = bounds.trace.to_pandas()
    assert table["runs"].sum() == bounds.evaluations and table["after"].iloc[-1] == bounds.trace[-1].after


def test_rules_fit_their_studies():
    assert "corners" in {step.rule for step in STUDIES["monotonic"]().trace}
    assert "kinks" in {step.rule for step in STUDIES["kinks"]().trace}
    noisy = studied(lambda a: 1 + 1e-12 * np.sin(1e6 * a) + 0 * T, a=(0, 1))
    assert noisy.trace.rule(3, 0) == "noise" and "Only more accurate runs" in noisy.why("x")
    exact = studied(lambda a, b: (a + 2 * b) * T, a=(0, 1), b=(0, 1))
    assert "all runs have the same value" in exact.why("x", 0.0)
    assert "accuracy of the search" in exact.why("x", 1.0)
    with pytest.warns(mb.SymmbWarning):
        rough = studied(
            lambda a, b: np.abs(a - 0.3) + np.abs(b - 0.1) * T, mb.PolynomialChaos(budget=40), a=(-1, 1), b=(-1, 1)
        )
    assert "The study used up its runs or its time" in rough.why("x")


def test_other_methods_say_that_they_have_no_reasons():
    box = {"a": (0.0, 1.0)}
    assert "does not estimate the error" in studied(lambda a: a * T, mb.Vertex(), **box).why("x")
    given = mb.Bounds(T, ("x",), np.zeros((11, 1)), np.ones((11, 1)), "estimate", "Mine()", 3, np.full((11, 1), 0.1))
    told = "At t = 0.5 s, the estimated error of x is 0.1, 10 % of the width there. The reasons of this error are not"
    assert given.why("x", 0.5) == f"{told} recorded."
    refused("no output 'z'", given.why, "z")
    refused("time must be finite, got nan", given.why, "x", np.nan)
    refused("time must be real numbers, got 'late'", given.why, "x", "late")


def test_choices_name_the_reason_of_the_worst_combination():
    found = black_box_bounds(lambda a, n: np.sin(n * a * T), None, T, "x", a=(0.5, 1.5), n={1, 2})
    assert found.trace is None and sum(step.runs for part in found.parts for step in part.trace) == found.evaluations
    assert found.why("x") in {part.why("x", float(found.t[found.estimate[:, 0].argmax()])) for part in found.parts}
