"""The runs that attain bounds, and the region of a point."""

import numpy as np
import pytest
from faults import refused
from machines import GROUND, ball, pendulum
from small_scenes import particle

import symmb as mb
from models import artillery, double_pendulum
from symmb.show.drawing import attaining_runs, of_bounds
from symmb.show.drawing.exhibit import convex_hull, of_run
from symmb.show.drawing.still import canvas, paint

ATTAINED = 1e-9

# Bounds of few runs are doubted over ten seconds. The runs attain them all the same.
pytestmark = pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")


def ghosts_attain(bounds, output, row):
    column = bounds.names.index(output)
    samples = bounds.attaining.samples([(side, row, column) for side in ("lower", "upper")])
    for run, inner in zip(attaining_runs(bounds.study, samples), bounds.inner, strict=True):
        assert abs(run[output][row] - inner[row, column]) <= ATTAINED


@pytest.mark.parametrize(
    "method",
    [mb.PolynomialChaos(), mb.PolynomialChaos.paper(2), mb.MonteCarlo(300), mb.Vertex(), mb.Scanning(5)],
    ids=repr,
)
@pytest.mark.parametrize(("output", "time"), [("y2", 4.2), ("theta2", 10.0)])
def test_ghosts_attain_the_bounds(method, output, time):
    bounds = mb.propagate(double_pendulum.scene(), method)
    ghosts_attain(bounds, output, int(np.abs(bounds.t - time).argmin()))


def test_one_simulator_makes_the_nominal_run_and_the_ghosts(monkeypatch):
    """A large model compiles for half a minute."""
    scene = double_pendulum.scene().with_times(np.linspace(0, 2, 41))
    bounds, run = mb.propagate(scene, mb.PolynomialChaos()), mb.simulate(scene)
    monkeypatch.setattr("symmb.show.drawing.exhibit.simulate", None)
    drawing = of_bounds(bounds, "y2", 1.0, None).drawing
    np.testing.assert_array_equal(drawing.t, run.t)
    np.testing.assert_allclose(drawing.values, run.values, rtol=0, atol=1e-6)


def test_a_nominal_run_that_fails_is_told():
    """It is lost at 0.6 s. Those at the ends of the box are at rest."""
    scene = particle(lambda p, mass: 50 * (1 - p.a**2) * mass.x**2, [0.0, 1.0], {"mass.x": 1.0}, a=(-1.0, 1.0))
    bounds = mb.propagate(scene, mb.Vertex())
    refused(r"run fails|not finite|does not start", of_bounds, bounds, "x", 1.0, None, error=mb.SimulationError)


def test_bounds_of_a_figure_are_shown_at_a_time_of_the_run():
    thrown = ball(g=None, speed=2.0)
    options = {"start": {"ball.vx": thrown.p.speed}, "box": mb.Box(speed=(1.0, 3.0))}
    scene = thrown.scene({"end": mb.final(thrown.ball.x)}, np.linspace(0, 1, 11), **options)
    exhibit = of_bounds(mb.propagate(scene, mb.Vertex()), "end", 0.5, None)
    assert exhibit.drawing.t[exhibit.picture] == 0.5
    assert ["= 1 " in exhibit.ghosts[0].label, "= 3 " in exhibit.ghosts[1].label] == [True, True]


@pytest.mark.long
def test_ghosts_of_the_gun_attain_the_bounds():
    bounds = mb.propagate(artillery.scene(), mb.Vertex())
    assert np.array_equal(bounds.inner, [bounds.lower, bounds.upper])
    ghosts_attain(bounds, "muzzle_vertical", 140)


def test_the_region_of_a_point_is_that_of_runs():
    scene = double_pendulum.scene().with_times(np.linspace(0, 1, 41))
    rod = scene.system.bodies[1]
    exhibit = of_bounds(mb.propagate(scene, mb.Vertex()), "y2", 0.5, rod.point(0, 0))
    region, bounds = exhibit.region, mb.propagate(scene, mb.Scanning(6))
    positions = np.stack([bounds["x2"], bounds["y2"]], axis=2)  # (lower or upper, time, axis)
    np.testing.assert_allclose(region.points[:, :, :2].min(axis=1), positions[0], atol=1e-6)
    np.testing.assert_allclose(region.points[:, :, :2].max(axis=1), positions[1], atol=1e-6)
    wide = np.ptp(region.sweep, axis=0) - np.ptp(positions.reshape(-1, 2), axis=0)
    assert (wide > -1e-6).all()
    assert (wide < exhibit.drawing.unit).all()  # it consists of squares of half this side


def test_a_still_tells_all_parameters_of_a_ghost():
    """Its label has several lines, which are above the mechanism and inside the picture."""
    p = [f"initial_speed_{k}" for k in range(9)]
    thrown = ball(g=None, **dict.fromkeys(p, 0.1))
    start, box = {"ball.vx": sum(getattr(thrown.p, name) for name in p)}, mb.Box(**dict.fromkeys(p, (-0.1, 0.3)))
    scene = thrown.scene("x", np.linspace(0, 1, 3), start, box=box)
    exhibit = of_bounds(mb.propagate(scene, mb.Vertex()), "x", 1.0, None)
    figure, axes = canvas(exhibit, [exhibit.picture], dpi=100)
    paint(axes, exhibit, exhibit.picture)
    figure.draw_without_rendering()
    texts = [text for text in axes.texts if text.get_color() in {ghost.tint for ghost in exhibit.ghosts}]
    assert all(sum(f"{name} = {end}" in text.get_text() for text in texts) == 1 for name in p for end in (-0.1, 0.3))
    assert len(texts) > 4 and all(text.get_window_extent().x1 < figure.bbox.x1 for text in texts)
    lowest = min(text.get_window_extent().y0 for text in texts)
    assert axes.transData.transform([0, exhibit.drawing.unit])[1] < lowest


def test_hulls():
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    inside = np.random.default_rng(0).uniform(0, 1, (50, 2))
    assert sorted(map(tuple, convex_hull(np.vstack([inside, square])))) == sorted(map(tuple, square))
    assert len(convex_hull(np.array([[0.0, 0], [1, 1], [0.5, 0.5]]))) == 2


def test_bounds_that_cannot_be_drawn(tmp_path):
    scene = double_pendulum.scene().with_times([0.0, 0.1])
    bounds = mb.propagate(scene, mb.Vertex())
    bounds.save(tmp_path / "b.npz")
    foreign = mb.Body("other", mass=1.0, pose=mb.Particle()).point(0, 0)
    for words, subject, wrong in (
        ("Did you mean 'y2'", bounds, {"output": "y"}),
        ("have no scene", mb.Bounds.load(tmp_path / "b.npz"), {}),
        ("stores no runs", mb.propagate(scene, mb.Taylor(1)), {}),
        ("Use it with Bounds only", scene, {"output": "y1"}),
        ("from 0 to 0.1", scene, {"time": 0.2}), ("a number", scene, {"time": "a"}),
        ("a point", scene, {"point": (0, 0)}), ("'other' is not in this scene", scene, {"point": foreign}),
        ("got System", scene.system, {}),
    ):  # fmt: skip
        refused(words, mb.view, subject, tmp_path / "b.html", **wrong)


def test_pictures_of_long_runs_hold_the_time_and_the_extremes():
    t = np.linspace(0, 1, 5001)
    outputs = lambda m: {"x": m.ball.x, "peak": 1 / (1e-4 + (mb.t - t[2501]) ** 2 * 1e4)}  # noqa: E731
    run = ball(g=None).run(outputs, t, {"ball.vx": 1.0})
    exhibit = of_run(run, t[2503], None)
    assert exhibit.drawing.t[exhibit.picture] == t[2503] and exhibit.drawing.t[-1] == t[-1]
    assert exhibit.drawing.values[:, 1].max() == run["peak"].max()


def test_the_region_of_a_point_on_a_circle_is_no_disc():
    spring = lambda m: mb.TorsionSpring("spring", GROUND, m.rod, m.p.stiffness, m.p.damping)  # noqa: E731
    swing = pendulum(spring, length=0.5, inertia=1 / 12, stiffness=5.0, damping=0.02)
    box = mb.Box(mass=(0.7, 1.3), inertia=(0.7 / 12, 1.3 / 12), stiffness=(3, 7), damping=(0, 0.04))
    scene = swing.scene("theta", np.linspace(0, 4, 201), {"rod.theta": 1.0}, box=box)
    exhibit = of_bounds(mb.propagate(scene, mb.Vertex()), None, None, swing.rod.point(0.5, 0))
    middles = exhibit.region.sweep.reshape(-1, 3, 2).mean(axis=1)
    assert np.hypot(*middles.T).min() > 0.95
