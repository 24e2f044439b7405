"""Ride and wheel hop of a double wishbone suspension against its energies along kinematics by intersecting circles."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import fsolve

import symmb as mb
from models import double_wishbone

G, CENTER = 9.81, np.array([0.75, 0.31])
STEP = 1e-3
WEIGHTS = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}  # fourth-order differences


def positions(z, p):
    """Chassis, both arms and wheel, rows (x, y, angle), for the chassis' height and the turning of the lower arm."""
    height, turning = z
    points = {k: np.array([p[f"{k}_x"], p[f"{k}_y"]]) for k in ("lower", "upper", "knuckle", "top", "mount")}
    arm, other, rigid = (points[b] - points[a] for a, b in (("lower", "knuckle"), ("upper", "top"), ("knuckle", "top")))
    angle = np.arctan2(arm[1], arm[0]) + turning
    along = np.array([np.cos(angle), np.sin(angle)])
    up = np.array([0.0, height])
    inner, hinge, mount = (points[k] + up for k in ("lower", "upper", "mount"))
    end = inner + np.linalg.norm(arm) * along
    # the upper ball lies on circles about the upper hinge and the lower ball, outside of the line between them
    r, s, line = np.linalg.norm(other), np.linalg.norm(rigid), end - hinge
    d = np.linalg.norm(line)
    a = (r**2 - s**2 + d**2) / (2 * d)
    normal = np.array([-line[1], line[0]]) / d
    ball = hinge + a * line / d + np.sqrt(r**2 - a**2) * normal
    before, now = (np.arctan2(v[1], v[0]) for v in (rigid, ball - end))
    tilt = now - before
    turn = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])
    wheel = end + turn @ (CENTER - points["knuckle"])
    upper_angle = np.arctan2(*(ball - hinge)[::-1])
    rows = [(*up, 0.0), (*(inner + end) / 2, angle), (*(hinge + ball) / 2, upper_angle), (*wheel, tilt)]
    return np.array(rows), np.linalg.norm(inner + p["seat"] * along - mount)


def potential(z, p):
    rows, strut = positions(z, p)
    masses = np.array([p["sprung"], 6.0, 3.0, p["unsprung"]])
    springs = p["stiffness"] * (strut - p["length"]) ** 2 + p["tyre"] * (p["radius"] - rows[3, 1]) ** 2
    return G * masses @ rows[:, 1] + springs / 2


def slopes(f, z):
    """(2, ...) derivatives by differences."""
    return np.array([sum(w * f(z + k * STEP * e) for k, w in WEIGHTS.items()) / STEP for e in np.eye(2)])


@pytest.mark.parametrize("changes", [{}, {"lower_y": 0.215, "seat": 0.29, "tyre": 190e3, "upper_y": 0.46}])
def test_ride_and_wheel_hop(changes):
    scene = double_wishbone.scene()
    lin = mb.linearize(scene, parameters={"damping": 0.0, **changes})
    assert not lin.doubts
    p = {**scene.system.parameters, **changes}
    z = fsolve(lambda z: slopes(lambda y: potential(y, p), z), [0.0, 0.0], xtol=1e-12)
    J = slopes(lambda y: positions(y, p)[0], z)
    inertias = np.array([[m, m, J] for m, J in ((p["sprung"], 0), (6.0, 0.08), (3.0, 0.02), (p["unsprung"], 0.9))])
    M = np.einsum("iab,jab,ab->ij", J, J, inertias)
    K = slopes(lambda y: slopes(lambda x: potential(x, p), y), z)
    expected = np.sqrt(eigh((K + K.T) / 2, M, eigvals_only=True))
    np.testing.assert_allclose(2 * np.pi * lin.frequencies, expected, rtol=1e-6)
    assert 0.8 < lin.frequencies[0] < 2.0 < 8.0 < lin.frequencies[1] < 16.0  # ride, wheel hop


def test_bounds_of_the_frequencies():
    """The nominal frequencies lie inside, and the tyre matters for wheel hop alone."""
    scene = double_wishbone.scene()
    bounds = mb.propagate(mb.ModalSimulator(scene), mb.Vertex(), mb.Box(tyre=(200e3, 220e3)))
    lin = mb.linearize(scene)
    assert lin.stability == "asymptotically stable"
    shares = (bounds.upper - bounds.lower)[0, :2] / lin.frequencies
    assert shares[0] < 0.03 < 0.04 < shares[1]
