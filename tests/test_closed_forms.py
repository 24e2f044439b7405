"""Shipped scenes against closed forms and against other equations of the same motion."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

import symmb as mb
from models import cubic, half_car, heavy_top, rolling_disc, spherical_pendulum
from symmb import IntervalArithmetic, PolynomialChaos, propagate

G = 9.81


def test_cubic_has_its_range():
    exact = propagate(cubic.scene(), PolynomialChaos(order=3))
    assert exact.lower == pytest.approx(0.0, abs=1e-6)
    assert exact.upper == pytest.approx(4 / 27, abs=1e-6)
    natural = propagate(cubic.scene(), IntervalArithmetic())
    assert (natural.lower.item(), natural.upper.item()) == pytest.approx((-2.0, 2.0))


@pytest.mark.parametrize("solver", [None, mb.StateSpace()])
def test_spherical_pendulum_follows_its_angles(solver):
    theta, phi_dot = 1.2, 1.5
    momentum = phi_dot * np.sin(theta) ** 2
    times = np.linspace(0.0, 5.0, 51)

    def rates(_, y):
        return [y[1], momentum**2 * np.cos(y[0]) / np.sin(y[0]) ** 3 - G * np.sin(y[0]), momentum / np.sin(y[0]) ** 2]

    y = solve_ivp(rates, (0, 5), [theta, 0.0, 0.0], t_eval=times, rtol=1e-12, atol=1e-12).y
    run = mb.simulate(spherical_pendulum.scene(theta=theta, phi_dot=phi_dot), solver, times=times)
    assert np.abs(run["x"] - np.sin(y[0]) * np.cos(y[2])).max() < 1e-6
    assert np.abs(run["y"] - np.sin(y[0]) * np.sin(y[2])).max() < 1e-6
    assert np.abs(run["theta"] - y[0]).max() < 1e-6
    speed2 = y[1] ** 2 + (momentum / np.sin(y[0])) ** 2
    assert np.abs(run["pull"] - (speed2 + G * np.cos(y[0]))).max() < 1e-5


@pytest.mark.parametrize("branch", [0, 1])
def test_heavy_top_precesses_steadily(branch):
    A, C, omega3, theta = 0.5, 0.1, 100.0, 0.6
    fast_and_slow = np.roots([A * np.cos(theta), -C * omega3, G * 0.5])
    phi_dot = fast_and_slow[branch]
    times = np.linspace(0.0, 1.0, 21)
    run = mb.simulate(heavy_top.scene(theta=theta, phi_dot=phi_dot, omega3=omega3), times=times)
    assert np.abs(run["theta"] - theta).max() < 1e-6
    assert np.abs(run["e3_x"] - np.sin(theta) * np.sin(phi_dot * times)).max() < 1e-5
    assert np.abs(run["omega3"] - omega3).max() < 1e-6


def test_disc_rolls_on_a_circle():
    alpha, precession, radius = 1.2, 2.0, 0.5
    spin = rolling_disc.steady_spin(alpha, precession)
    times = np.linspace(0.0, 5.0, 51)
    run = mb.simulate(rolling_disc.scene(alpha=alpha, precession=precession), times=times)
    # The centre goes along x at first and turns with the precession: a circle through the origin about (0, offset).
    offset = -radius * spin / precession
    assert np.abs(run["x"] - offset * np.sin(precession * times)).max() < 1e-5
    assert np.abs(run["y"] - offset * (1 - np.cos(precession * times))).max() < 1e-5
    assert np.abs(run["alpha"] - alpha).max() < 1e-6
    assert np.abs(run["spin"] - spin).max() < 1e-6
    assert np.abs(run["load"] - G).max() < 1e-5


def test_disc_wobbles_as_its_rates_of_angular_momentum_say():
    """Rates about the centre in the frame (u, h, n) of the disc: u up the disc's plane, h level, n the axis."""
    alpha, precession, spin, R = 1.1, 1.0, -4.0, 0.5
    A, C = R**2 / 4, R**2 / 2  # for 1 kg
    times = np.linspace(0.0, 5.0, 51)

    def rates(_, y):
        tilt, u, h, n = y
        turn = u / np.tan(tilt)  # of the frame about n
        return [
            -h,
            h * (A * turn - C * n) / A,
            ((C + R**2) * u * n + G * R * np.cos(tilt) - A * turn * u) / (A + R**2),
            -(R**2) * u * h / (C + R**2),
        ]

    start = [alpha, precession * np.sin(alpha), 0.0, spin]
    y = solve_ivp(rates, (0, 5), start, t_eval=times, rtol=1e-12, atol=1e-12).y
    run = mb.simulate(rolling_disc.scene(alpha=alpha, precession=precession, spin=spin), times=times)
    assert np.ptp(y[0]) > 0.1
    assert np.abs(run["alpha"] - y[0]).max() < 1e-6
    assert np.abs(run["spin"] - y[3]).max() < 1e-6


def test_half_car_over_a_bump():
    """Equations written by hand in the state (x, y, theta, front x and y, rear x and y), integrated by SciPy."""
    run = mb.simulate(half_car.scene(), mb.DormandPrince(rtol=1e-9))
    mass, inertia, axle, g, tyre, radius = 690.0, 1200.0, 40.0, 9.81, 190e3, half_car.RADIUS
    bump = PchipInterpolator(0.6 * np.linspace(0, 1, 9), 0.08 * np.sin(np.pi * np.linspace(0, 1, 9)) ** 2)
    K, C = np.diag([300e3, 22e3]), np.diag([3e3, 1.6e3])

    def rates(t, state):
        q, v = state[:7], state[7:]
        c, s = np.cos(q[2]), np.sin(q[2])
        R, turned = np.array([[c, -s], [s, c]]), np.array([[-s, -c], [c, -s]])
        a = np.array([0, -g, 0, 0, -g, 0, -g])
        for k, (along, behind) in enumerate(((1.3, 0.0), (-1.3, half_car.WHEELBASE))):
            wheel, speed = q[3 + 2 * k : 5 + 2 * k], v[3 + 2 * k : 5 + 2 * k]
            arm = wheel - q[:2]
            d = R.T @ arm - [along, -0.3]
            d_dot = R.T @ (speed - v[:2]) + turned.T @ arm * v[2]
            force = -R @ (K @ d + C @ d_dot)  # on the wheel
            at = 10.0 * t - behind
            inside = 0 < at < 0.6
            depth = radius - wheel[1] + (float(bump(at)) if inside else 0.0)
            rate = -speed[1] + (10.0 * float(bump(at, 1)) if inside else 0.0)
            road = max(0.0, tyre * depth + 100.0 * rate) if depth > 0 else 0.0
            a[3 + 2 * k : 5 + 2 * k] += (force + [0, road]) / axle
            a[:2] -= force / mass
            a[2] -= (arm[0] * force[1] - arm[1] * force[0]) / inertia
        return np.hstack([v, a])

    start = np.hstack([run.q[0][[0, 1, 2, 3, 4, 6, 7]], np.zeros(7)])
    known = solve_ivp(rates, (0, 1.5), start, "DOP853", run.t, rtol=1e-9, atol=1e-10, max_step=2e-3).y
    assert_allclose(run["bounce"], known[1] - known[1, 0], atol=1e-6)
    assert_allclose(run["pitch"], known[2], atol=1e-6)
    assert_allclose(run["front.y"], known[4], atol=1e-6)
    assert (run["front_lift"].max() > 0.05) and (run["rear_lift"].max() > 0.05)
