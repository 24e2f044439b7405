"""Contacts of curves, points held on curves, and cam followers, against closed forms and SciPy."""

from functools import partial

import casadi as ca
import contact_shapes
import numpy as np
import pytest
from conftest import but_long
from faults import refused, warned
from machines import GROUND, PLANAR
from mechanisms import exact
from numpy.testing import assert_allclose

import symmb as mb

FINE = mb.DormandPrince(rtol=1e-11)
SQUARE = mb.Curve([(1, 0), (0, 1), (-1, 0), (0, -1)], closed=True, corners=range(4))
CIRCLE = mb.Curve(lambda s: (ca.cos(s), ca.sin(s)), 0, 2 * np.pi, closed=True)
RAIL = mb.Curve(lambda s: (s, 0 * s), -1, 1)
W = np.arange(8) * np.pi / 4
CAM = mb.Curve(np.column_stack([np.cos(W), np.sin(W)]), closed=True)


def oval(a, b):
    return mb.Curve(lambda s: (a * ca.cos(s), b * ca.sin(s)), 0, 2 * np.pi, closed=True)


OVALS = oval(1.0, 0.5), oval(0.3, 0.2)
CORNERED = mb.Curve([(0.5, 0), (0, 0.5), (-0.5, 0), (0, -0.5)], closed=True, corners=range(4)), OVALS[1]


def body_on(curve, law=None, radius=0.1, curve_b=None, gravity=10.0, pose=PLANAR, **more):
    """A ball, or a body of 1 kg and 0.1 kg m^2 with an outline, against a curve of the ground."""
    law, outline = law or mb.KelvinVoigt(1e4), {} if curve_b is None else {"curve_b": curve_b}
    inertia = 0.1 if pose is PLANAR else np.eye(3)
    body = mb.Body("body", 1.0, inertia, pose) if outline else mb.Body("body", 1.0, pose=mb.Particle())
    radius = 0.0 if outline else radius
    contact = mb.CurveContact("on", GROUND.point(0, 0), curve, body.point(0, 0), radius, law, **outline, **more)
    return mb.System(body, contact, mb.Gravity(0, -gravity))


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    "name", but_long(contact_shapes.KINDS, "ground", *(name for name in contact_shapes.KINDS if "oval" in name))
)
def test_motions_are_those_of_scipy(name, seed):
    scene, known = contact_shapes.KINDS[name](np.random.default_rng([seed, len(name)]))
    run = mb.simulate(scene, contact_shapes.solver_of(name))
    assert_allclose(run.values, known, rtol=0, atol=1e-7 * max(np.abs(known).max(), 1))


@pytest.mark.long
def test_feet_behind_a_centre_of_curvature_do_not_touch():
    """A foot on the far side of a cam of points jumped along the curve, and seemed next to a body in free flight."""
    scene, known = contact_shapes.spline(np.random.default_rng([27, 6]))
    assert_allclose(mb.simulate(scene, mb.DormandPrince(rtol=1e-9)).values, known, rtol=0, atol=1e-7)


@pytest.mark.long
def test_feet_that_pass_a_corner_need_few_steps():
    """Steps that ended where each of three evaluations of a foot passes it were 600,000."""
    scene, known = contact_shapes.polygon(np.random.default_rng([3, 7]))
    run = mb.simulate(scene, mb.DormandPrince(rtol=1e-12))
    assert run.statistics["integrator"]["steps"] < 2000
    assert_allclose(run.values, known, rtol=0, atol=1e-9)


AGAINST = [
    pytest.param({"curve": SQUARE}, "yx", 1.2, 1.1, 1e-9, id="a ball and a corner"),
    pytest.param({"curve": CAM}, "xy", 1.2, 1.1, 1e-9, id="a ball and a cam"),
    pytest.param({"curve": OVALS[0], "curve_b": OVALS[1]}, "yx", 0.8, 0.7, 1e-12, id="ovals"),
    *(
        pytest.param({"curve": a, "curve_b": b}, "yx", 0.8, 0.7, 1e-9, id=name, marks=pytest.mark.long)
        for name, (a, b) in {"a corner": CORNERED, "a corner that moves": CORNERED[::-1]}.items()
    ),
]


@pytest.mark.parametrize(("curves", "axes", "high", "touch", "aside"), AGAINST)
def test_a_body_bounces_along_a_normal(curves, axes, high, touch, aside):
    """Straight onto a corner, a point of a spline or an oval: half a vibration of m and k, and up again."""
    k, (along, across) = 1e6, axes
    turn = np.pi / np.sqrt(k)
    start = {f"body.{along}": high, f"body.{across}": 0.0, f"body.v{along}": -1.0}
    system = body_on(**curves, law=mb.KelvinVoigt(k), gravity=0.0)
    run = mb.simulate(mb.Scene(system, start, [0.0, 0.1, 0.1 + turn / 2, 0.1 + turn, 0.2 + turn]), FINE)
    assert_allclose(run[f"body.{along}"], [high, touch, touch - 1 / np.sqrt(k), touch, high], atol=1e-9)
    assert_allclose(run[f"body.{across}"], 0, atol=aside)
    assert_allclose(run[f"body.v{across}"], 0, atol=max(aside, 1e-9))
    assert run.energy_drift < 1e-8


@pytest.mark.parametrize(
    ("shape", "support", "guess"),
    [({"radius": 0.1}, 0.1, -0.9), ({"curve_b": OVALS[1]}, np.hypot(0.3, 0.2) / np.sqrt(2), -0.64)],
    ids=["a ball", "an oval"],
)
def test_a_body_in_a_corner_touches_both_sides(shape, support, guess):
    """Inside of the square, in its lowest corner: each side carries m g / sqrt(2), a support from the middle."""
    start = {"body.x": 0.0, "body.y": guess}
    rest = mb.simulate(mb.Scene(body_on(SQUARE, inside=True, **shape), guess=start, equilibrium=True))
    depth = 10.0 / np.sqrt(2) / 1e4
    assert_allclose(rest["body.y"], np.sqrt(2) * (support - depth) - 1, atol=1e-9)
    assert_allclose(rest["body.x"], 0, atol=1e-9)


def test_a_ball_flies_through_the_centre_of_a_ring():
    """There no direction leads to the ring, and all feet on it are equally far."""
    k = 1e6
    system = body_on(CIRCLE, mb.KelvinVoigt(k), inside=True, gravity=0.0)
    turn = np.pi / np.sqrt(k)
    times = [0.0, 0.9 + turn, 2.7 + 2 * turn, 3.6 + 2 * turn]
    run = mb.simulate(mb.Scene(system, {"body.vx": 0.8, "body.vy": 0.6}, times), FINE)
    assert_allclose(run["body.x"], np.array([0, 0.9, -0.9, 0]) * 0.8, atol=1e-7)
    assert_allclose(run["body.vy"], np.array([1, -1, 1, 1]) * 0.6, atol=1e-6)


def test_a_ball_thrown_over_waves_lands_on_them_and_leaves_at_their_end():
    """By distances to many points it never is deeper than (5 E / 2 k)^(2 / 5) = 0.012 m, and energy is kept."""
    curve = mb.Curve(lambda s: (s, 0.08 * ca.sin(4 * s)), -1.5, 1.5)
    system = body_on(curve, mb.HuntCrossley(1e6, 1.0, 1.0), 0.06)
    start = {"body.x": -1.0, "body.y": 0.5, "body.vx": 1.2, "body.vy": 0.0}
    run = mb.simulate(mb.Scene(system, start, np.linspace(0, 3, 301)), FINE)
    s = np.linspace(-1.5, 1.5, 3001)
    distance = np.hypot(run["body.x"][:, None] - s, run["body.y"][:, None] - 0.08 * np.sin(4 * s)).min(axis=1)
    over = np.abs(run["body.x"]) < 1.4
    assert distance.min() > 0.06 - 0.012 and (run["body.y"] > 0.08 * np.sin(4 * run["body.x"]))[over].all()
    assert run["body.y"][-1] < -1  # it has left the ground
    assert run.energy_drift < 1e-8


def on_a_parabola(end, g, x, times):
    """A bead that starts at rest at x."""
    bead = mb.Body("bead", 1.0, pose=mb.Particle())
    wire = mb.PointOnCurve("wire", GROUND.point(0, 0), bead.point(0, 0), mb.Curve(lambda s: (s, s**2), -end, end))
    return mb.Scene(mb.System(bead, wire, mb.Gravity(0, -g)), {"bead.x": x}, times, guess={"bead.y": x**2})


def test_a_bead_slides_on_a_wire():
    times = np.linspace(0, 2, 21)
    scene = on_a_parabola(2, 10.0, 1.0, times)
    run = mb.simulate(scene, FINE)

    def rates(t, y):
        return [y[1], -(4 * y[0] * y[1] ** 2 + 20 * y[0]) / (1 + 4 * y[0] ** 2)]

    assert_allclose(np.column_stack([run["bead.x"], run["bead.vx"]]), exact(rates, [1.0, 0.0], times), atol=1e-7)
    assert_allclose(run(scene.system.reaction("wire").fy)[0], 10 * 1 / 5, rtol=1e-9)  # g cos^2 of the slope


def test_a_roller_on_an_eccentric_disc_lifts_off_at_speed():
    """y = e sin + sqrt((R + r)^2 - e^2 cos^2): the same by its curve and by its lift."""
    e, reach, w = 0.02, 0.06, 25.0
    disc, rod, arm = (mb.Body(name, 1.0, 0.1) for name in ("disc", "rod", "arm"))
    shaft = mb.Revolute("shaft", GROUND.point(0, 0), disc.point(0, 0))
    guides = [mb.Prismatic(f"{b.name}_guide", GROUND.point(0, 0), b.point(0, 0), (0, 1, 0)) for b in (rod, arm)]
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


CONTACTS = [
    (
        {"curve": mb.Curve(lambda s: (s, 5 * s**2), -1, 1), "radius": 0.2},
        r"bends more tightly than the circle\. Use a smaller",
    ),
    ({"curve": mb.Curve(lambda s: (s, 1 / s), -1, 1)}, "a point that is not finite"),
    ({"curve": mb.Curve(lambda s: (s, s), 0, 1, closed=True)}, "its end differs from its start"),
    ({"curve": "circle"}, "expected a curve, got 'circle'"),
    ({"curve": CIRCLE, "radius": -0.1}, "radius is -0.1; it must be at least 0"),
    ({"curve": oval(0.5, 0.5), "curve_b": oval(0.4, 0.2), "inside": True}, "bends more tightly than the circle"),
    ({"curve": RAIL, "curve_b": RAIL}, "a straight part of one curve may touch the other curve at several points"),
    ({"curve": SQUARE, "curve_b": SQUARE}, "only one of two curves may have corners"),
    ({"curve": oval(0.5, 0.4), "curve_b": "oval"}, "expected a curve, got 'oval'"),
    (
        {"curve": SQUARE, "curve_b": oval(1, 2), "pose": mb.Spatial()},
        r"two curves cannot be used with spatial bodies.*Use pose=Planar\(\)",
    ),
]


CURVES = [
    (lambda: mb.Curve([(0, 0), (0, 0), (1, 1)]), "two successive points are equal"),
    (lambda: mb.Curve([(0, 0, 1)]), "must be a function of s, or points"),
    (lambda: mb.Curve(lambda s: (s, s), 1, 0), "must be finite, and start must be below end"),
    (lambda: mb.Curve(lambda s: (s, s), 0, 1, corners=[2]), "must be from 0 to 1"),
    (lambda: mb.Curve(lambda s: 1 / "s", 0, 1), "the law raises"),
]


CALLS = [(make, f"Curve: .*{why}") for make, why in CURVES]
CALLS += [(partial(body_on, **options), f"CurveContact 'on': .*{why}") for options, why in CONTACTS]


@pytest.mark.parametrize(("call", "fault"), CALLS)
def test_faults_of_contacts_and_curves(call, fault):
    refused(fault, call)


@pytest.mark.parametrize("x", [2.0, -3.0])
def test_an_open_curve_goes_on_straight_beyond_its_ends(x):
    """A bead that slides down the tangent of y = x^2 at x = 1 or -1, with the acceleration g sin(63.4 deg)."""
    run = mb.simulate(on_a_parabola(1, 1.0, x, [0.0, 1.0]))
    along = abs(x) - 0.4 * np.array([0.0, 0.5])
    assert_allclose(np.abs(run["bead.x"]), along, atol=1e-9)
    assert_allclose(run["bead.y"], 2 * along - 1, atol=1e-9)
