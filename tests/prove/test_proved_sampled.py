"""Proofs of mechanisms with sampled controllers against closed forms, and SciPy from instant to instant."""

import numpy as np
import pytest
from enclosure_samples import require_sharp
from scipy.integrate import solve_ivp

import symmb as mb


@pytest.mark.parametrize("begin", [0.0, -0.7, 1.3])
def test_a_brake_with_a_held_force(begin):
    """At an instant, outputs have the new value: both outputs at and between instants are compared."""
    p = mb.Parameters(k=2.0, v=8.0)
    cart = mb.Body("cart", 1.0, pose=mb.Particle())
    brake = mb.Sampled("brake", period=0.1, law=-p.k * cart.vx)
    push, times = mb.Force("push", cart.point(0, 0), (brake.value, 0)), np.linspace(0, 1, 21)
    system, box = mb.System(cart, brake, push, parameters=p), mb.Box(k=(1.9, 2.1), v=(7.9, 8.1))
    outputs = {"v": cart.vx, "x": cart.x, "force": brake.value}
    scene = mb.Scene(system, {"cart.vx": p.v}, begin + times, outputs, box=box)
    runs = []
    for k in np.linspace(1.9, 2.1, 21):
        for v in (7.9, 8.0, 8.1):
            number = np.floor(times / 0.1 + 1e-9)
            late, rest = times - 0.1 * number, (1 - 0.1 * k) ** number
            x = v * (1 - rest) / k * (1 - 0.05 * k)  # the sum of v_i T (1 - k T / 2) with v_i = v (1 - k T)^i
            runs.append(
                np.stack([v * rest * (1 - k * late), x + v * rest * (late - k * late**2 / 2), -k * v * rest], 1)
            )
    require_sharp(mb.propagate(scene, mb.TaylorModel(order=5)), runs, 1e-10, 1e-7)


def test_a_pendulum_with_two_controllers_of_different_periods():
    """A law of angle, rate and time, and one that sums up the angle, of its own last value."""
    p = mb.Parameters(k=20.0, angle=0.5)
    arm = mb.Body("arm", 1.0, 0.1)
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), arm.point(-0.5, 0), axis=(0, 0, 1))
    sum_of = mb.Sampled("sum", period=0.15, law=lambda held: held - arm.theta)
    pd = mb.Sampled("pd", period=0.1, law=-p.k * arm.theta - 3.0 * arm.omega + mb.t + sum_of.value)
    system = mb.System(arm, hinge, sum_of, pd, mb.Torque("motor", arm, pd.value), mb.Gravity(0, -9.81), parameters=p)
    times = np.linspace(0, 0.9, 10)
    scene = mb.Scene(system, {"arm.theta": p.angle, "arm.omega": 0.0}, times,
                     {"angle": arm.theta, "rate": arm.omega, "torque": pd.value, "sum": sum_of.value},
                     box=mb.Box(k=(19.9, 20.1), angle=(0.495, 0.505)))  # fmt: skip
    runs = []
    for k in (19.9, 20.0, 20.1):
        for angle in (0.495, 0.5, 0.505):
            z, held, sum_, rows = np.array([angle, 0.0]), 0.0, 0.0, []
            for n in range(19):  # instants of either are multiples of 0.05 s
                if n % 3 == 0:
                    sum_ = sum_ - z[0]
                if n % 2 == 0:
                    held = -k * z[0] - 3.0 * z[1] + 0.05 * n + sum_
                    rows.append([*z, held, sum_])
                z = solve_ivp(lambda t, z, u=held: [z[1], (u - 9.81 * 0.5 * np.cos(z[0])) / 0.35], (0, 0.05), z,
                              method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]  # fmt: skip
            runs.append(rows)
    require_sharp(mb.propagate(scene, mb.TaylorModel(order=4)), runs, 1e-10, 1e-4)
