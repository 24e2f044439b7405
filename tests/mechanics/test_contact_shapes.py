"""Shapes in contact, two random motions of each, against integrations by SciPy; and curves that touch each other."""

import casadi as ca
import contact_shapes
import numpy as np
import pytest
from conftest import but_long
from faults import refused
from numpy.testing import assert_allclose

import symmb as mb

GROUND, FINE = mb.Ground(), mb.DormandPrince(rtol=1e-11)
RAIL = mb.Curve(lambda s: (s, 0 * s), -1, 1)
SQUARE = mb.Curve([(1, 0), (0, 1), (-1, 0), (0, -1)], closed=True, corners=range(4))


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


def oval(a, b):
    return mb.Curve(lambda s: (a * ca.cos(s), b * ca.sin(s)), 0, 2 * np.pi, closed=True)


def body_on(curve, curve_b, start, times=None, law=None, gravity=10.0, **more):
    """A body of 1 kg and 0.1 kg m^2 with an outline, against the curve of the ground."""
    body = mb.Body("body", 1.0, 0.1, mb.Planar())
    law = law or mb.KelvinVoigt(1e4)
    contact = mb.CurveContact("on", GROUND.point(0, 0), curve, body.point(0, 0), 0.0, law, curve_b=curve_b, **more)
    system = mb.System(body, contact, mb.Gravity(0, -gravity))
    return mb.Scene(system, start, times) if times else mb.Scene(system, guess=start, equilibrium=True)


OVALS = oval(1.0, 0.5), oval(0.3, 0.2)
CORNERED = mb.Curve([(0.5, 0), (0, 0.5), (-0.5, 0), (0, -0.5)], closed=True, corners=range(4)), OVALS[1]


@pytest.mark.parametrize(
    ("curves", "aside"),
    [(OVALS, 1e-12), *(pytest.param(curves, 1e-9, marks=pytest.mark.long) for curves in (CORNERED, CORNERED[::-1]))],
    ids=["an oval", "a corner", "a corner that moves"],
)
def test_an_oval_rebounds(curves, aside):
    """Along their axes, from another or straight from a corner: half a vibration of m and k, and back."""
    k = 1e6
    turn = np.pi / np.sqrt(k)
    times = [0.0, 0.1, 0.1 + turn / 2, 0.1 + turn, 0.2 + turn]
    start = {"body.y": 0.5 + 0.2 + 0.1, "body.vy": -1.0}
    run = mb.simulate(body_on(*curves, start, times, mb.KelvinVoigt(k), 0.0), FINE)
    assert_allclose(run["body.y"], [0.8, 0.7, 0.7 - 1 / np.sqrt(k), 0.7, 0.8], atol=1e-9)
    assert_allclose(run["body.x"], 0, atol=aside)


def test_an_oval_in_a_corner_touches_two_sides():
    """By symmetry each side carries m g / sqrt(2); the height of its middle is sqrt(2) times its support."""
    a, b, k = 0.3, 0.2, 1e4
    rest = mb.simulate(body_on(SQUARE, oval(a, b), {"body.y": -0.64}, inside=True))
    depth = 10.0 / np.sqrt(2) / k
    assert_allclose(rest["body.y"], np.sqrt(2) * (np.hypot(a, b) / np.sqrt(2) - depth) - 1, atol=1e-9)


@pytest.mark.parametrize(
    ("curve", "curve_b", "inside", "fault"),
    [
        (oval(0.5, 0.5), oval(0.4, 0.2), True, "bends more tightly than the circle"),
        (RAIL, RAIL, False, "a straight part of one curve may touch the other curve at several points"),
        (SQUARE, SQUARE, False, "only one of two curves may have corners"),
        (oval(0.5, 0.4), "oval", False, "expected a curve, got 'oval'"),
    ],
)
def test_faults_of_two_curves(curve, curve_b, inside, fault):
    refused(f"CurveContact 'on': .*{fault}", body_on, curve, curve_b, {"body.y": 1.0}, inside=inside)


def test_two_curves_stay_in_a_plane():
    body = mb.Body("body", 1.0, np.eye(3), mb.Spatial())
    on = mb.CurveContact("on", GROUND.point(0, 0), SQUARE, body.point(0, 0), 0, mb.KelvinVoigt(1.0), curve_b=oval(1, 2))
    refused(r"two curves cannot be used with spatial bodies.*Use pose=Planar\(\)", mb.System, body, on)
