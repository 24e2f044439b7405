"""The runs that attain bounds, and the region of a point."""

import numpy as np
import pytest

import symmb as mb
from models import artillery, double_pendulum
from symmb.drawing import attaining_runs, of_bounds
from symmb.drawing.exhibit import convex_hull

ATTAINED = 1e-9


@pytest.mark.parametrize(
    "method",
    [mb.PolynomialChaos(), mb.PolynomialChaos.paper(2), mb.MonteCarlo(300), mb.Vertex(), mb.Scanning(5)],
    ids=repr,
)
@pytest.mark.parametrize(("output", "time"), [("y2", 4.2), ("theta2", 10.0)])
def test_ghosts_attain_the_bounds(method, output, time):
    bounds = mb.propagate(double_pendulum.scene(), method)
    k = int(np.abs(bounds.t - time).argmin())
    runs = attaining_runs(bounds.study, bounds.study.attaining(output, k))
    for run, inner in zip(runs, bounds.inner, strict=True):
        assert abs(run[output][k] - inner[k, bounds.names.index(output)]) <= ATTAINED


@pytest.mark.slow
def test_ghosts_of_the_gun_attain_the_bounds():
    bounds = mb.propagate(artillery.scene(), mb.Vertex())
    k, column = 140, bounds.names.index("muzzle_vertical")
    runs = attaining_runs(bounds.study, bounds.study.attaining("muzzle_vertical", k))
    attained = [run["muzzle_vertical"][k] for run in runs]
    np.testing.assert_allclose(attained, [bounds.lower[k, column], bounds.upper[k, column]], rtol=0, atol=ATTAINED)


def test_the_region_of_a_point_is_that_of_runs():
    scene = double_pendulum.scene().with_times(np.linspace(0, 1, 41))
    rod = scene.system.bodies[1]
    exhibit = of_bounds(mb.propagate(scene, mb.Vertex()), "y2", 0.5, rod.point(0, 0))
    region, bounds = exhibit.region, mb.propagate(scene, mb.Scanning(6))
    positions = np.stack([bounds["x2"], bounds["y2"]], axis=2)  # (lower or upper, time, axis)
    np.testing.assert_allclose(region.points[:, :, :2].min(axis=1), positions[0], atol=1e-6)
    np.testing.assert_allclose(region.points[:, :, :2].max(axis=1), positions[1], atol=1e-6)
    assert np.ptp(region.sweep, axis=0) == pytest.approx(np.ptp(positions.reshape(-1, 2), axis=0), abs=1e-6)


def test_hulls():
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    inside = np.random.default_rng(0).uniform(0, 1, (50, 2))
    assert sorted(map(tuple, convex_hull(np.vstack([inside, square])))) == sorted(map(tuple, square))
    assert len(convex_hull(np.array([[0.0, 0], [1, 1], [0.5, 0.5]]))) == 2


def test_bounds_that_cannot_be_drawn(tmp_path):
    scene = double_pendulum.scene().with_times([0.0, 0.1])
    bounds = mb.propagate(scene, mb.Vertex())
    with pytest.raises(mb.DeclarationError, match="Did you mean 'y2'"):
        mb.view(bounds, tmp_path / "b.html", output="y")
    bounds.save(tmp_path / "b.npz")
    with pytest.raises(mb.DeclarationError, match="hold no scene"):
        mb.view(mb.Bounds.load(tmp_path / "b.npz"), tmp_path / "b.html")
    with pytest.raises(mb.DeclarationError, match="runs no samples"):
        mb.view(mb.propagate(scene, mb.Taylor(1)), tmp_path / "b.html")
    with pytest.raises(mb.DeclarationError, match="goes with Bounds"):
        mb.view(scene, tmp_path / "b.html", output="y1")
