"""Sets of parameters that are consistent with data, against linear programs, closed forms on grids, and random runs."""

import math

import numpy as np
import pytest
from black_boxes import reloaded
from faults import refused, warned
from machines import ball
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection
from test_calibration import T, oscillator, particle, swing

import symmb as mb
from models import four_bar


def are_in(found, points):
    """Mask (N,) of points (N, d) in a piece."""
    return ((found.lower <= points[:, None]) & (points[:, None] <= found.upper)).all(axis=2).any(axis=1)


def sampled(found, n, rng):
    """Points (n, d), uniform in all pieces, and their pieces (n,)."""
    sizes = (found.upper - found.lower).prod(axis=1)
    k = rng.choice(len(sizes), n, p=sizes / sizes.sum())
    return found.lower[k] + rng.random((n, found.lower.shape[1])) * (found.upper - found.lower)[k], k


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_the_set_of_a_linear_model_is_a_polygon(seed):
    rng, error = np.random.default_rng(seed), 0.05
    y = 1.3 * T + 0.5 * 0.8 * T**2 + error * rng.uniform(-1, 1, len(T))
    found = mb.calibrate(particle(), {"x": y}).consistent(error)
    A = np.stack([T, T**2 / 2], axis=1)
    sides, ends = np.concatenate([A, -A]), np.concatenate([y, -y]) + error
    exact = [[s * linprog(s * row, sides, ends, bounds=(None, None)).fun for s in (1, -1)] for row in np.eye(2)]
    inner, outer = np.transpose(exact), np.array([found.box.lower, found.box.upper])
    assert ((outer - inner) * [[-1], [1]] >= -1e-9).all() and np.abs(outer - inner).max() < 0.1 * np.ptp(inner)
    moving = np.abs(sides).sum(axis=1) > 0  # all bounds but those at the start, where the output is 0
    start = linprog([0, 0, -1], np.c_[sides, np.linalg.norm(sides, axis=1)], ends, bounds=[(None, None)] * 2 + [(0, 1)])
    corners = HalfspaceIntersection(np.c_[sides, -ends][moving], start.x[:2]).intersections
    area = ConvexHull(corners).volume
    assert found.volume == pytest.approx(area, rel=0.1)
    assert area <= (found.upper - found.lower).prod(axis=1).sum() <= 2 * area
    mixed = rng.dirichlet(np.ones(len(corners)), 500) @ corners
    assert are_in(found, mixed).all() and are_in(found, np.array([[1.3, 0.8]])).all() and not found.doubts


def test_pieces_hold_all_that_is_consistent_and_pieces_inside_nothing_else():
    """With errors of a fifth of the swing, the set is bent. The closed form decides at 40,000 points."""
    rng = np.random.default_rng(21)
    y = swing(T, 6.3, 0.3) + 0.1 * rng.uniform(-1, 1, len(T))
    found = mb.calibrate(oscillator(), {"x": y}, ["k", "c"]).consistent("20%")
    error = 0.2 * np.abs(y).max()
    assert found.error == {"x": pytest.approx(error)}
    points = found.box.from_unit(rng.uniform(-1.2, 1.2, (40_000, 2)).clip(-1, 1))
    off = np.array([np.abs(swing(T, *p) - y).max() for p in points])
    # Runs and polynomials have errors: values within 0.1 % of the error belong to both sides.
    assert are_in(found, points[off < 0.999 * error]).all()
    points, k = sampled(found, 4000, rng)
    off = np.array([np.abs(swing(T, *p) - y).max() for p in points])
    assert (off[found.inside[k]] <= 1.001 * error).all() and found.inside[k].any()
    assert 0.5 < (off <= error).mean()


@pytest.mark.parametrize("seed", range(31, 37))
def test_lengths_of_a_four_bar_are_in_the_set(seed):
    scene, names, rng = four_bar.scene(), ["crank", "coupler", "rocker"], np.random.default_rng(seed)
    scene = scene.with_times(np.linspace(0, 2, 200)).with_outputs({"angle": scene.outputs["rocker_angle"]})
    truth = np.array([1.0, 3.0, 2.5]) * (1 + 0.01 * rng.uniform(-1, 1, 3))
    exact = mb.simulate(scene, parameters=dict(zip(names, truth, strict=True)))["angle"]
    error = 1e-3 * np.abs(exact).max()
    y = exact + error * rng.uniform(-1, 1, 200)
    found = mb.calibrate(scene, {"angle": y}, names).consistent({"angle": error})
    assert are_in(found, truth[None]).all() and not found.doubts
    points, k = sampled(found, 2000, rng)
    simulator = mb.DAESimulator(scene)
    columns = [points.T[names.index(n)] if n in names else np.full(2000, v) for n, v in simulator.parameters.items()]
    fits = (np.abs(simulator.run(np.column_stack(columns)).Y[:, :, 0] - y) <= error).all(axis=1)
    assert fits[found.inside[k]].all() and fits.mean() > 0.5


def test_boxes_have_units_and_are_boxes_of_studies():
    machine = ball(g=None, speed=(1000.0, "mm/s"))
    scene = machine.scene("x", [0.0, 1.0, 2.0], {"ball.vx": machine.p.speed})
    found = mb.calibrate(scene, {"x": [0.0, 1.49, 3.02]}, ["speed"]).consistent(0.03)
    assert found.box["speed"] == pytest.approx((1495, 1520), abs=0.1) and found.box.units == ("mm/s",)
    assert "speed [mm/s]" in str(found) and found.runs > 0
    for box in (found.box, *found.pieces[:2]):
        assert mb.propagate(scene, box=box)["x"][1][2] == pytest.approx(2e-3 * box["speed"][1])


def test_a_set_ends_where_runs_fail():
    """Data determine a from -0.1 to 0.5. Below 0, runs fail."""
    simulator = mb.FunctionSimulator(lambda a: np.full(2, a if a >= 0 else math.nan), {"a": 0.1}, [0.0, 1.0], ["y"])
    fit = mb.calibrate(simulator, {"y": [0.19, 0.21]})
    found = warned("The set ends at a = .*, because runs beyond fail or are", fit.consistent, 0.31)
    assert found.box["a"] == pytest.approx((0.0, 0.5), abs=1e-3) and found.inside.any()


def test_no_piece_counts_as_inside_if_runs_fail_in_the_box():
    """The failed runs are in a corner of the box, so that no run on an axis fails."""
    line = lambda a, b: (a * T + b) * (math.nan if a + b < 2.05 else 1.0)  # noqa: E731
    fit = mb.calibrate(mb.FunctionSimulator(line, {"a": 1.3, "b": 0.9}, T, ["y"]), {"y": 1.3 * T + 0.9})
    found = warned("failed. The set is only estimated", fit.consistent, 0.2)
    assert not found.inside.any() and are_in(found, np.array([[1.3, 0.9]])).all()


def test_what_has_no_set_is_refused(tmp_path):
    fit = mb.calibrate(particle(), {"x": 1.3 * T})
    wrong = {-1.0: "above 0", None: "above 0", "small": "percentage such as", 1e-12: "must be at least 5.2e-09"}
    for error, match in wrong.items():
        refused(match, fit.consistent, error)
    refused("for each of x", fit.consistent, {"y": 1.0})
    y = 1.3 * T + 0.1 * np.sin(9 * T)
    other = warned("correlated", mb.calibrate, particle(), {"x": y})
    refused("no run is within", other.consistent, 0.01, error=mb.SimulationError)
    simulator = mb.FunctionSimulator(lambda a, b: np.log(a) * T + b, {"a": 1.0, "b": 1.0}, T, ["y"])
    rough = mb.calibrate(simulator, {"y": np.log(0.3) * T + 0.7})
    refused("Give a smaller error", rough.consistent, 2.0, error=mb.SimulationError)
    refused("Call calibrate again", reloaded(fit, tmp_path / "fit.json").consistent, 0.1)
