"""Where runs failed, in words: against failures of which the truth is known."""

import re

import numpy as np
import pytest
from black_boxes import reloaded
from faults import warned

import symmb as mb
from symmb.bound.nodes import Sobol, grid
from symmb.bound.responses.failures import failed_region, find_failed_region


def box(d):
    return mb.Box(**dict.fromkeys("abcde"[:d], (0.9, 1.1)))


def told(fails, d, points=None):
    """The text for failures of samples (N, d), and counts of failed and all runs there and elsewhere."""
    points = np.random.default_rng(1).uniform(-1, 1, (400, d)) if points is None else points
    failed = fails(box(d).from_unit(points))
    text = failed_region(box(d), points, failed)
    counts = [int(number) for pair in re.findall(r"(\d+) of (\d+)", text) for number in pair]
    assert not counts or (counts[0] + counts[2], counts[1] + counts[3]) == (failed.sum(), len(points))
    return text, counts


def close(text, *limits):
    """Whether the numbers of a description lie near the true limits."""
    pairs = re.findall(r"[<>] ([\d.]+)|([\d.]+) <", text.split("(")[0])
    found = [float(number) for pair in pairs for number in pair if number]
    return len(found) == len(limits) and np.allclose(sorted(found), sorted(limits), atol=0.015)


@pytest.mark.parametrize(
    ("fails", "d", "words", "limits"),
    [
        *((lambda X: X[:, 0] > 1.07, d, r"for a > 1\.07 \(", [1.07]) for d in (1, 2, 5)),
        (lambda X: np.abs(X[:, 1] - 1) < 0.02, 3, r".* < b < ", [0.98, 1.02]),
        (lambda X: (X[:, 0] > 1.05) & (X[:, 2] < 0.95), 3, r"for a > .* and c < ", [1.05, 0.95]),
        (lambda X: (X > 1.03).all(axis=1), 3, r"for( [abc] > [^ ]*( and|,)?){3} \(", [1.03] * 3),
    ],
)
def test_half_spaces_strips_and_corners(fails, d, words, limits):
    text, (failed, runs, others, _) = told(fails, d)
    assert re.match(words, text) and close(text, *limits) and failed == runs > 0 == others


@pytest.mark.parametrize(
    ("fails", "n", "words"),
    [
        (lambda X: X[:, 0] <= 0.1, 101, "for a < 0.105 (11 of 11 runs there, 0 of 90 elsewhere)"),
        (lambda X: X[:, 0] >= 0.6, 11, "for a > 0.55 (5 of 5 runs there, 0 of 6 elsewhere)"),
        (lambda X: X[:, 0] > 0.9, 201, "for a > 0.903 (20 of 20 runs there, 0 of 181 elsewhere)"),
    ],
)  # fmt: skip
def test_limits_lie_between_runs(fails, n, words):
    unit = mb.Box(a=(0, 1))
    points = np.linspace(-1, 1, n)[:, None]
    failed = fails(np.round(unit.from_unit(points), 12))
    assert failed_region(unit, points, failed) == words


def test_most_of_a_half_space():
    chance = np.random.default_rng(2).random(400)
    text, (failed, runs, others, _) = told(lambda X: (X[:, 1] < 0.93) & (chance < 0.85), 3)
    assert re.match(r"for b < 0\.9\d+ \(", text) and close(text, 0.93) and runs > failed > 0.7 * runs and others == 0


def test_corner_among_crashes_at_random():
    chance = np.random.default_rng(3).random(400) < 0.08
    text, (failed, runs, others, _) = told(lambda X: chance | (X[:, :2] > 1.05).all(axis=1), 4)
    assert text.startswith("for a > ") and close(text, 1.05, 1.05) and failed == runs and others > 10


def test_crashes_at_random_are_scattered():
    texts = []
    for seed in range(40):
        chance = np.random.default_rng(seed).random(400) < 0.05
        texts.append(told(lambda X, chance=chance: chance, 4)[0])
    assert texts.count("scattered over the box") >= 36


def test_nodes_of_grids():
    points = grid(np.linspace(-1, 1, 3), 2)
    assert told(lambda X: X[:, 0] > 1.07, 2, points)[0] == "for a > 1.05 (3 of 3 runs there, 0 of 6 elsewhere)"
    assert told(lambda X: X[:, 0] < 0.93, 2, grid(np.array([-1.0, 1.0]), 2))[0].startswith("for a < 1 (2 of 2")


def test_one_failed_run_is_told_by_itself():
    assert told(lambda X: np.arange(400) == 7, 2) == ("", [])


def test_a_parameter_that_is_fixed():
    fixed = mb.Box(a=(1.0, 1.0), b=(0.9, 1.1))
    points = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    assert failed_region(fixed, points, points[:, 1] > 0.5).startswith("for b > 1.0")


def test_points_in_a_region():
    points = grid(np.linspace(-1, 1, 9), 2)
    region = find_failed_region(box(2), points, points[:, 0] > 0.6)
    assert region is not None
    assert region.contains(np.array([[[0.9, 0.0], [0.1, 0.9]]])).tolist() == [[True, False]]


def simulator(d):
    t = np.linspace(0.0, 1.0, 5)

    def response(a, b, c, d):
        if a > 1.07:
            raise RuntimeError("no convergence")
        return np.exp(-a * t) * np.cos(3 * (a + b + c + d) * t)

    return mb.FunctionSimulator(response, dict.fromkeys("abcd", 1.0), t, ["x"]), box(d)


@pytest.mark.parametrize(
    "method", [mb.PolynomialChaos(), mb.MonteCarlo(200), mb.Scanning(4), mb.Swarm(2, steps=5)], ids=repr
)
def test_methods_tell_where_runs_fail(method):
    pattern = r"Runs fail for a > 1\.0\d+ \(\d+ of \d+ runs there, 0 of \d+ elsewhere\)"
    bounds = warned(pattern, mb.propagate, simulator(2)[0], method, simulator(2)[1])
    assert bounds.failed_region in str(bounds)


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_files_keep_where_runs_fail(tmp_path):
    bounds = mb.propagate(simulator(2)[0], mb.Scanning(4), simulator(2)[1])
    assert reloaded(bounds, tmp_path / "bounds.json").failed_region == bounds.failed_region != ""


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("d", [2, 4])
def test_bounds_are_those_of_the_region_that_runs(d):
    made, where = simulator(d)
    bounds = mb.propagate(made, mb.PolynomialChaos(budget=200), where)
    region = mb.Box(**{name: (0.9, 1.07 if name == "a" else 1.1) for name in where.names})
    true = mb.propagate(made, mb.Scanning(9 if d < 4 else 7), region)
    width = (true.upper - true.lower).max()
    assert (bounds.upper < true.upper + 0.06 * width).all() and (bounds.lower > true.lower - 0.06 * width).all()
    assert (bounds.outer[1] > true.upper - 1e-3 * width).all() and (bounds.outer[0] < true.lower + 1e-3 * width).all()


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_comparisons_tell_where_runs_fail(tmp_path):
    made, where = simulator(2)
    comparison = mb.compare(made, [mb.MonteCarlo(100), mb.Vertex()], where, reference=mb.Scanning(9))
    assert "Runs of MonteCarlo(100) fail for a > 1.0" in " ".join(str(comparison).split())
    rows = reloaded(comparison, tmp_path / "comparison.json").rows
    assert [row.failed_region for row in rows] == [row.failed_region for row in comparison.rows]
    assert rows[1].failed_region == "for a > 1 (2 of 2 runs there, 0 of 2 elsewhere)"


@pytest.mark.parametrize("method", [mb.PolynomialChaos(), mb.Vertex(), mb.MonteCarlo(10)], ids=repr)
@pytest.mark.parametrize("second", [mb.Revolute, mb.Spherical])
def test_constraints_that_contradict_each_other_over_the_box_are_named(second, method):
    p = mb.Parameters(height=1.0)
    door = mb.Body("door", 5.0, (0.4, 0.3, 0.2), mb.Spatial())
    ground, axis = mb.Ground(), {"axis": (0, 0, 1)}
    lower = mb.Revolute("lower", ground.point(0, 0, 0), door.point(-0.4, 0, -0.5), **axis)
    above, at = ground.point(0, 0, p.height), door.point(-0.4, 0, 0.5)
    upper = second("upper", above, at, **(axis if second is mb.Revolute else {}))
    system = mb.System(door, lower, upper, mb.Gravity(0, -9.81, 0), parameters=p)
    scene = mb.Scene(system, times=[0.0, 0.5], outputs={"x": door.x})
    with pytest.raises(mb.PropagationError, match=r"'lower', 'upper' are redundant .* contradict each other"):
        mb.propagate(scene, method, mb.Box(height=(0.95, 1.05)))


def test_half_space_of_a_four_bar():
    """The crank of a four-bar cannot rotate if crank + ground > coupler + rocker (Grashof)."""
    bars = mb.Box(crank=(0.8, 1.2), coupler=(1.8, 2.2), rocker=(2.2, 2.6), ground=(2.9, 3.3))
    points = Sobol().points(400, 4, seed=1)
    crank, coupler, rocker, ground = bars.from_unit(points).T
    region = find_failed_region(bars, points, crank + ground > coupler + rocker)
    assert str(region).startswith("for crank - coupler - rocker + ground > ")
    assert region.limit == pytest.approx(0.0, abs=0.02)
    others = np.random.default_rng(0).uniform(-1, 1, (2000, 4))
    crank, coupler, rocker, ground = bars.from_unit(others).T
    assert (region.contains(others) == (crank + ground > coupler + rocker)).mean() > 0.98
