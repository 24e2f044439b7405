"""Circles on curves, points held on curves, and cam followers, against closed forms and SciPy."""

import casadi as ca
import numpy as np
import pytest
from faults import refused, warned
from mechanisms import exact
from numpy.testing import assert_allclose

import symmb as mb

GROUND, FINE = mb.Ground(), mb.DormandPrince(rtol=1e-11)
SQUARE = mb.Curve([(1, 0), (0, 1), (-1, 0), (0, -1)], closed=True, corners=range(4))
CIRCLE = mb.Curve(lambda s: (ca.cos(s), ca.sin(s)), 0, 2 * np.pi, closed=True)
W = np.arange(8) * np.pi / 4
CAM = mb.Curve(np.column_stack([np.cos(W), np.sin(W)]), closed=True)


def ball_on(curve, law, radius=0.1, inside=False, gravity=10.0, **more):
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    contact = mb.CurveContact("track", GROUND.point(0, 0), curve, ball.point(0, 0), radius, law, inside=inside, **more)
    return mb.System(ball, contact, mb.Gravity(0, -gravity))


@pytest.mark.parametrize(("curve", "along", "across"), [(SQUARE, "y", "x"), (CAM, "x", "y")], ids=["corner", "cam"])
def test_a_ball_bounces_along_a_normal(curve, along, across):
    """Straight onto a corner, or onto a point of a spline: half a vibration of m and k, and up again."""
    k = 1e6
    turn = np.pi / np.sqrt(k)
    start = {f"ball.{along}": 1.2, f"ball.{across}": 0.0, f"ball.v{along}": -1.0}
    system = ball_on(curve, mb.KelvinVoigt(k), gravity=0.0)
    run = mb.simulate(mb.Scene(system, start, [0.0, 0.1, 0.1 + turn / 2, 0.1 + turn, 0.2]), FINE)
    assert_allclose(run[f"ball.{along}"], [1.2, 1.1, 1.1 - 1 / np.sqrt(k), 1.1, 1.2 - turn], atol=1e-9)
    assert_allclose(run[f"ball.{across}"], 0, atol=1e-9)
    assert_allclose(run[f"ball.v{across}"], 0, atol=1e-9)
    assert run.energy_drift < 1e-8


def test_a_ball_in_a_corner_touches_both_sides():
    """Inside of the square, in its lowest corner: each side carries m g / sqrt(2)."""
    k, r, g = 1e4, 0.1, 10.0
    system = ball_on(SQUARE, mb.KelvinVoigt(k), r, inside=True)
    rest = mb.simulate(mb.Scene(system, guess={"ball.x": 0.0, "ball.y": -0.9}, equilibrium=True))
    depth = g / np.sqrt(2) / k
    assert_allclose(rest["ball.y"], np.sqrt(2) * (r - depth) - 1, atol=1e-9)
    assert_allclose(rest["ball.x"], 0, atol=1e-9)


def test_a_ball_flies_through_the_centre_of_a_ring():
    """There no direction leads to the ring, and all feet on it are equally far."""
    k, r = 1e6, 0.1
    system = ball_on(CIRCLE, mb.KelvinVoigt(k), r, inside=True, gravity=0.0)
    turn = np.pi / np.sqrt(k)
    times = [0.0, 0.9 + turn, 2.7 + 2 * turn, 3.6 + 2 * turn]
    run = mb.simulate(mb.Scene(system, {"ball.vx": 0.8, "ball.vy": 0.6}, times), FINE)
    assert_allclose(run["ball.x"], np.array([0, 0.9, -0.9, 0]) * 0.8, atol=1e-7)
    assert_allclose(run["ball.vy"], np.array([1, -1, 1, 1]) * 0.6, atol=1e-6)


def test_a_ball_thrown_over_waves_lands_on_them_and_leaves_at_their_end():
    """By distances to many points it never is deeper than (5 E / 2 k)^(2 / 5) = 0.012 m, and energy is kept."""
    curve = mb.Curve(lambda s: (s, 0.08 * ca.sin(4 * s)), -1.5, 1.5)
    system = ball_on(curve, mb.HuntCrossley(1e6, 1.0, 1.0), 0.06)
    start = {"ball.x": -1.0, "ball.y": 0.5, "ball.vx": 1.2, "ball.vy": 0.0}
    run = mb.simulate(mb.Scene(system, start, np.linspace(0, 3, 301)), FINE)
    s = np.linspace(-1.5, 1.5, 3001)
    distance = np.hypot(run["ball.x"][:, None] - s, run["ball.y"][:, None] - 0.08 * np.sin(4 * s)).min(axis=1)
    over = np.abs(run["ball.x"]) < 1.4
    assert distance.min() > 0.06 - 0.012 and (run["ball.y"] > 0.08 * np.sin(4 * run["ball.x"]))[over].all()
    assert run["ball.y"][-1] < -1  # it has left the ground
    assert run.energy_drift < 1e-8


def test_a_bead_slides_on_a_wire():
    bead = mb.Body("bead", 1.0, pose=mb.Particle())
    wire = mb.PointOnCurve("wire", GROUND.point(0, 0), bead.point(0, 0), mb.Curve(lambda s: (s, s**2), -2, 2))
    times = np.linspace(0, 2, 21)
    system = mb.System(bead, wire, mb.Gravity(0, -10.0))
    run = mb.simulate(mb.Scene(system, {"bead.x": 1.0}, times, guess={"bead.y": 1.0}), FINE)

    def rates(t, y):
        return [y[1], -(4 * y[0] * y[1] ** 2 + 20 * y[0]) / (1 + 4 * y[0] ** 2)]

    assert_allclose(np.column_stack([run["bead.x"], run["bead.vx"]]), exact(rates, [1.0, 0.0], times), atol=1e-7)
    assert_allclose(run(system.reaction("wire").fy)[0], 10 * 1 / 5, rtol=1e-9)  # g cos^2 of the slope


def test_a_roller_on_an_eccentric_disc_lifts_off_at_speed():
    """y = e sin + sqrt((R + r)^2 - e^2 cos^2): the same by its curve and by its lift."""
    e, reach, w = 0.02, 0.06, 25.0
    disc, rod, arm = (mb.Body(name, 1.0, 0.1) for name in ("disc", "rod", "arm"))
    shaft = mb.Revolute("shaft", GROUND.point(0, 0), disc.point(0, 0))
    guides = [
        mb.Prismatic(f"{b.name}.guide".replace(".", "_"), GROUND.point(0, 0), b.point(0, 0), (0, 1, 0))
        for b in (rod, arm)
    ]
    curve = mb.Curve(lambda s: (e + 0.05 * ca.cos(s), 0.05 * ca.sin(s)), 0, 2 * np.pi, closed=True)
    lift = lambda a: e * ca.sin(a) + ca.sqrt(reach**2 - (e * ca.cos(a)) ** 2)  # noqa: E731
    on = mb.PointOnCurve("on", disc.point(0, 0), rod.point(0, 0), curve, radius=0.01, unilateral=True)
    by = mb.CamFollower("by", shaft, guides[1], lift)
    turn, gravity = mb.Motion("turn", shaft.angle, w * mb.t), mb.Gravity(0, -10.0)
    system = mb.System(disc, rod, arm, shaft, *guides, on, by, turn, gravity)
    t = np.linspace(0, 0.25, 26)
    scene = mb.Scene(system, {}, t, {"rod": rod.y, "arm": arm.y}, guess={"rod.y": 0.06})
    run = warned("PointOnCurve 'on': its force changes sign at t = 0.0.*CamFollower 'by'", mb.simulate, scene)
    known = e * np.sin(w * t) + np.sqrt(reach**2 - (e * np.cos(w * t)) ** 2)
    assert_allclose(run["rod"], known, atol=1e-8)
    assert_allclose(run["arm"], known, atol=1e-8)
    assert_allclose(run(system.reaction("on").fy), -run(system.lam("by")[0]), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("law", [lambda a: 0.01 * ca.sin(a), mb.Table([-1, 0, 1], [0, 0.01, 0])])
def test_a_lift_is_a_function_or_a_table(law):
    disc, rod = (mb.Body(name, 1.0, 0.1) for name in ("disc", "rod"))
    shaft = mb.Revolute("shaft", GROUND.point(0, 0), disc.point(0, 0))
    guide = mb.Prismatic("guide", GROUND.point(0, 0), rod.point(0, 0), (0, 1, 0))
    cam = mb.CamFollower("cam", shaft, guide, law)
    run = mb.simulate(mb.Scene(mb.System(disc, rod, shaft, guide, cam), {"shaft.angle": 0.5}))
    assert_allclose(run["rod.y"], float(law(ca.SX(0.5))), atol=1e-12)


@pytest.mark.parametrize(
    ("curve", "radius", "fault"),
    [
        (mb.Curve(lambda s: (s, 5 * s**2), -1, 1), 0.2, r"bends more tightly than the circle\. Use a smaller"),
        (mb.Curve(lambda s: (s, 1 / s), -1, 1), 0.1, "a point that is not finite"),
        (mb.Curve(lambda s: (s, s), 0, 1, closed=True), 0.1, "its end differs from its start"),
        ("circle", 0.1, r"expected a curve, got 'circle'"),
        (CIRCLE, -0.1, "radius is -0.1; it must be at least 0"),
    ],
)
def test_faults_of_contacts(curve, radius, fault):
    refused(f"CurveContact 'track': .*{fault}", ball_on, curve, mb.KelvinVoigt(1e4), radius)


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (lambda: mb.Curve([(0, 0), (0, 0), (1, 1)]), "two successive points are equal"),
        (lambda: mb.Curve([(0, 0, 1)]), "must be a function of s, or points"),
        (lambda: mb.Curve(lambda s: (s, s), 1, 0), "must be finite, and start must be below end"),
        (lambda: mb.Curve(lambda s: (s, s), 0, 1, corners=[2]), "must be from 0 to 1"),
        (lambda: mb.Curve(lambda s: 1 / "s", 0, 1), "the law raises"),
    ],
)
def test_faults_of_curves(make, fault):
    refused(f"Curve: .*{fault}", make)


@pytest.mark.parametrize("x", [2.0, -3.0])
def test_an_open_curve_goes_on_straight_beyond_its_ends(x):
    """A bead that slides down the tangent of y = x^2 at x = 1 or -1, with the acceleration g sin(63.4 deg)."""
    bead = mb.Body("bead", 1.0, pose=mb.Particle())
    wire = mb.PointOnCurve("wire", GROUND.point(0, 0), bead.point(0, 0), mb.Curve(lambda s: (s, s**2), -1, 1))
    system = mb.System(bead, wire, mb.Gravity(0, -1.0))
    run = mb.simulate(mb.Scene(system, {"bead.x": x}, [0.0, 1.0], guess={"bead.y": x**2}))
    along = abs(x) - 0.4 * np.array([0.0, 0.5])
    assert_allclose(np.abs(run["bead.x"]), along, atol=1e-9)
    assert_allclose(run["bead.y"], 2 * along - 1, atol=1e-9)
