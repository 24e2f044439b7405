"""Motions known in closed form: swings, spins, rolling, orbits, beads, joints with known kinematics."""

import casadi as ca
import numpy as np
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk

import symmb as mb

GROUND = mb.Ground()
TIMES = np.linspace(0.0, 3.0, 61)
TIGHT = mb.CVODES(rtol=1e-12, atol=1e-12)
PROJECTED = mb.CVODES(rtol=1e-12, atol=1e-12, stabilization=mb.Projection())


def test_a_pendulum_swings_by_the_elliptic_sine():
    """sin(theta / 2) = k sn(K - w t) for a release at rest from 2.5 rad."""
    rod = mb.Body("rod", 2.0, 0.3, mb.Planar())
    system = mb.System(rod, mb.Revolute("hinge", GROUND.point(0, 0), rod.point(0, 0.5)), mb.Gravity(0, -9.81))
    run = mb.simulate(mb.Scene(system, {"rod.theta": 2.5}, TIMES), TIGHT)
    w, k = np.sqrt(2.0 * 9.81 * 0.5 / (0.3 + 2.0 * 0.25)), np.sin(1.25)
    sn, *_ = ellipj(ellipk(k**2) - w * TIMES, k**2)
    assert_allclose(run["rod.theta"], 2 * np.arcsin(k * sn), atol=1e-8)


def test_a_torque_free_symmetric_body_precesses():
    """In body axes the spin's cross part turns at (A - C) / A w_z; in the world the momentum stands still."""
    A, C, wz, w0 = 0.4, 0.7, 5.0, 1.2
    body = mb.Body("body", 1.0, (A, A, C), mb.Spatial())
    run = mb.simulate(mb.Scene(mb.System(body), {"body.omega": (w0, 0, wz)}, TIMES), TIGHT)
    rate = (A - C) / A * wz
    assert_allclose(run["body.omega_x"], w0 * np.cos(rate * TIMES), atol=1e-9)
    assert_allclose(run["body.omega_y"], -w0 * np.sin(rate * TIMES), atol=1e-9)
    momentum = run(body.rotation @ (ca.DM([A, A, C]) * body.omega))
    assert_allclose(momentum, np.broadcast_to([A * w0, 0, C * wz], momentum.shape), atol=1e-8)
    assert_allclose(np.linalg.norm(run.q[:, 3:], axis=1), 1, atol=1e-9)


def test_a_hoop_rolls_down_a_slope():
    """Rolling without slip on a slope of 0.4 rad: a = g sin(0.4) / (1 + J / m r^2), and the friction that it takes."""
    m, r, J, slope = 1.5, 0.2, 0.04, 0.4
    hoop = mb.Body("hoop", m, J, mb.Planar())
    gravity = mb.Gravity(9.81 * np.sin(slope), -9.81 * np.cos(slope))
    floor = mb.Motion("floor", hoop.y, r)
    roll = mb.VelocityConstraint("roll", (hoop.vx + r * hoop.omega,))
    run = mb.simulate(mb.Scene(mb.System(hoop, gravity, floor, roll), times=TIMES), TIGHT)
    a = 9.81 * np.sin(slope) / (1 + J / (m * r**2))
    assert_allclose(run["hoop.x"], a * TIMES**2 / 2, rtol=1e-9, atol=1e-9)
    assert_allclose(run["hoop.theta"], -run["hoop.x"] / r, rtol=1e-9, atol=1e-9)
    assert_allclose(run["roll.lam[0]"], J * a / r**2, atol=1e-9)
    assert_allclose(run["floor.lam[0]"], -m * 9.81 * np.cos(slope), atol=1e-9)
    assert run.energy_drift < 1e-9


def test_a_skate_runs_in_a_circle():
    """Blade under the centre of mass: spin and speed stay, the track is a circle of radius v / w."""
    skate = mb.Body("skate", 1.0, 0.1, mb.Planar())
    blade = mb.VelocityConstraint("blade", (-ca.sin(skate.theta) * skate.vx + ca.cos(skate.theta) * skate.vy,))
    run = mb.simulate(mb.Scene(mb.System(skate, blade), {"skate.vx": 2.0, "skate.omega": 4.0}, TIMES), TIGHT)
    assert_allclose(run["skate.x"], 0.5 * np.sin(4 * TIMES), atol=1e-9)
    assert_allclose(run["skate.y"], 0.5 * (1 - np.cos(4 * TIMES)), atol=1e-9)
    assert_allclose(run["skate.vy"][0], 0, atol=1e-15)


def test_a_planet_runs_on_kepler_s_ellipse():
    """Force mu / r^2 as a law of the coordinates; eccentricity 0.4, semi-axis 1, from the near end."""
    mu, e = 1.7, 0.4
    planet = mb.Body("planet", 1.0, pose=mb.Particle())
    r3 = (planet.x**2 + planet.y**2) ** 1.5
    pull = mb.Force("pull", planet.point(0, 0), (-mu * planet.x / r3, -mu * planet.y / r3))
    start = {"planet.x": 1 - e, "planet.vy": np.sqrt(mu * (1 + e) / (1 - e))}
    run = mb.simulate(mb.Scene(mb.System(planet, pull), start, TIMES), TIGHT)
    n = np.sqrt(mu)
    anomaly = np.array([brentq(lambda E, t=t: E - e * np.sin(E) - n * t, -1, 10, xtol=1e-14) for t in TIMES])
    assert_allclose(run["planet.x"], np.cos(anomaly) - e, atol=1e-9)
    assert_allclose(run["planet.y"], np.sqrt(1 - e**2) * np.sin(anomaly), atol=1e-9)


def test_a_bead_runs_out_on_a_turning_wire():
    """A wire that turns at w in the plane: r = r0 cosh(w t), and the force across it is 2 m w r'."""
    w, r0, m = 1.3, 0.2, 0.6
    wire = mb.Body("wire", 1.0, 1.0, mb.Planar())
    bead = mb.Body("bead", m, 0.0, mb.Particle())
    system = mb.System(
        wire, bead,
        mb.Revolute("hinge", GROUND.point(0, 0), wire.point(0, 0)),
        mb.Motion("turn", wire.theta, w * mb.t),
        mb.PointOnLine("thread", wire.point(0, 0), bead.point(0, 0), axis=(1, 0, 0)),
    )  # fmt: skip
    run = mb.simulate(mb.Scene(system, {"bead.x": r0, "bead.vx": 0.0}, TIMES), PROJECTED)
    assert_allclose(np.hypot(run["bead.x"], run["bead.y"]), r0 * np.cosh(w * TIMES), atol=1e-8)
    force, _ = run.reaction("thread")
    across = np.stack([-np.sin(w * TIMES), np.cos(w * TIMES)], axis=1)
    assert_allclose((force[:, :2] * across).sum(axis=1), 2 * m * w**2 * r0 * np.sinh(w * TIMES), atol=1e-6)
    assert run.energy_drift < 1e-8


def test_a_hooke_joint_does_not_turn_evenly():
    """Shafts at an angle beta, the first driven evenly: tan(out) = tan(in) / cos(beta)."""
    beta = 0.6
    first, second = (mb.Body(name, 1.0, (0.1, 0.1, 0.1), mb.Spatial()) for name in ("first", "second"))
    tilted = (np.cos(beta), np.sin(beta), 0)
    hinge_in = mb.Revolute("in", GROUND.point(-1, 0), first.point(-1, 0), axis=(1, 0, 0))
    bearing = mb.PointOnLine("out", GROUND.point(0, 0), second.point(0.5, 0), axis=tilted)
    cross = mb.Universal("cross", first.point(0, 0), second.point(0, 0), axis=(0, 1, 0), axis_b=(0, 0, 1))
    drive = mb.Motion("drive", hinge_in.angle, 3.0 * mb.t)
    z = second.rotation[:, 2]
    out = ca.atan2(z[0] * np.sin(beta) - z[1] * np.cos(beta), z[2])
    guess = {"second.rotation": mb.rotation((0, 0, 1), beta)}
    system = mb.System(first, second, hinge_in, bearing, cross, drive)
    run = mb.simulate(mb.Scene(system, {"first.x": 0.0}, TIMES, {"out": out}, guess=guess), PROJECTED)
    # The cross arm on the first shaft lies in the plane of the shafts at the start: the output runs ahead first.
    expected = np.unwrap(np.arctan2(np.sin(3 * TIMES) / np.cos(beta), np.cos(3 * TIMES)))
    assert_allclose(np.unwrap(run["out"]), expected, atol=1e-8)
    assert abs(expected[-1]) > 2 * np.pi


def test_a_damped_oscillator_driven_at_its_base():
    """m x'' = -k (x - u) - c (x' - u'), u = a sin(w t): the base is a massless body on a drive."""
    m, k, c, a, w = 2.0, 50.0, 1.5, 0.1, 4.0
    base, mass = mb.Body("base", 0.0, pose=mb.Particle()), mb.Body("mass", m, pose=mb.Particle())
    system = mb.System(
        base, mass,
        mb.Motion("drive", base.x, a * ca.sin(w * mb.t)),
        mb.Force("pull", mass.point(0, 0), (-k * (mass.x - base.x) - c * (mass.vx - base.vx), 0)),
    )  # fmt: skip
    run = mb.simulate(mb.Scene(system, times=TIMES), TIGHT)
    transfer = (k + 1j * w * c) / (k - m * w**2 + 1j * w * c)
    steady = a * transfer
    # x = Im(steady e^{iwt}) + decaying part that makes x(0) = x'(0) = 0
    d, f = c / (2 * m), np.sqrt(k / m - (c / (2 * m)) ** 2)
    x0, v0 = -steady.imag, -(1j * w * steady).imag
    decay = np.exp(-d * TIMES) * (x0 * np.cos(f * TIMES) + (v0 + d * x0) / f * np.sin(f * TIMES))
    assert_allclose(run["mass.x"], (steady * np.exp(1j * w * TIMES)).imag + decay, atol=1e-9)
