"""Derivatives across switches and impacts, against variational equations with saltation matrices by SciPy."""

import casadi as ca
import numpy as np
import pytest
from machines import rods
from scipy.integrate import solve_ivp

import symmb as mb

NAMES = "k", "c", "F", "a", "G", "b", "w", "e"
TIMES = np.linspace(0.0, 8.0, 30)


def drawn(seed):
    """Stiffness, damping, force beyond x = a, force after the time b, place -w of a wall, and its restitution."""
    low, high = [1.0, 0.02, -1.0, -0.3, -1.0, 1.0, 0.2, 0.5], [9.0, 0.3, 1.0, 0.3, 1.0, 6.0, 0.6, 0.95]
    return np.random.default_rng(seed).uniform(low, high)


def scene(u):
    """A mass on a spring, with a force that jumps at a place, another one that jumps at a time, and a wall."""
    p = mb.Parameters(**dict(zip(NAMES, u.tolist(), strict=True)))
    mass = mb.Body("mass", 1.0, pose=mb.Particle())
    x, v, t = mass.x, mass.vx, mb.t
    pull = -p.k * x - p.c * v + ca.if_else(x > p.a, p.F, 0) + ca.if_else(t > p.b, p.G, 0)
    law = mb.Force("law", mass.point(0, 0), (pull, 0, 0))
    wall = mb.Impact("wall", gap=x + p.w, restitution=p.e)
    return mb.Scene(mb.System(mass, law, wall, parameters=p), {"mass.x": 1.0}, TIMES, {"x": x, "v": v})


def by_saltation(u):
    """Derivatives (n_t, 2, 8) of x and v, and the number of events."""
    k, c, F, a, G, b, w, e = u
    z, t, is_far, is_late = np.array([1.0, 0.0, *np.zeros(16)]), 0.0, 1.0 > a, False
    found, count = np.zeros((len(TIMES), 2, 8)), 0

    def rates(t, z):
        x, v, S = z[0], z[1], z[2:].reshape(2, 8)
        dv = -k * S[0] - c * S[1]
        dv[0] -= x
        dv[1] -= v
        dv[2] += is_far
        dv[4] += is_late
        return np.concatenate([[v, -k * x - c * v + F * is_far + G * is_late], S[1], dv])

    def place(t, z):
        return z[0] - a if t > begin + 1e-9 else (1.0 if is_far else -1.0)

    def hit(t, z):
        return z[0] + w if t > begin + 1e-9 else 1.0

    while True:
        begin, end = t, TIMES[-1] if is_late else b
        for event, sign in ((place, 0), (hit, -1)):
            event.terminal, event.direction = True, sign
        # Short steps find two passes shortly after each other.
        options = {"rtol": 1e-12, "atol": 1e-14, "max_step": 0.02, "dense_output": True}
        run = solve_ivp(rates, (t, end), z, "DOP853", events=[place, hit], **options)
        t = run.t[-1]
        inside = (TIMES >= begin) & ((t > TIMES) | (t == TIMES[-1]))
        if inside.any():
            found[inside] = run.sol(TIMES[inside])[2:].T.reshape(-1, 2, 8)
        if t >= TIMES[-1]:
            return found, count
        count += 1
        z = run.y[:, -1].copy()
        before, S = rates(t, z)[:2], z[2:].reshape(2, 8)
        shift = np.zeros(8)  # of the time of the event
        jump = np.eye(2)
        if len(run.t_events[0]):
            shift = -(S[0] - np.eye(8)[3]) / z[1]
            is_far = not is_far
        elif len(run.t_events[1]):
            shift = -(S[0] + np.eye(8)[6]) / z[1]
            jump = np.diag([1.0, -e])
        else:
            shift, is_late = np.eye(8)[5], True
        own = np.zeros((2, 8))
        if jump[1, 1] != 1:
            own[1, 7] = -z[1]
        z[:2] = jump @ z[:2]
        after = rates(t, z)[:2]
        z[2:] = (jump @ S + own + np.outer(jump @ before - after, shift)).ravel()


@pytest.mark.parametrize("seed", range(8))
def test_derivatives_pass_switches_and_impacts(seed):
    u = drawn(seed)
    expected, count = by_saltation(u)
    off = np.abs(mb.sensitivities(scene(u)).values - expected) / np.maximum(np.abs(expected).max(axis=0), 1e-9)
    assert count >= 3 and off.max() < 1e-7


def test_a_parameter_without_effect_has_no_warning():
    """The mass of a rod does not change its fall on a stop."""
    stop = rods(1, lambda m: mb.Stop("stop", m.hinges[0], np.pi / 2 - 1.4, restitution=0.5), length=0.4, mass=2.0)
    slopes = mb.sensitivities(stop.scene("theta", np.linspace(0.0, 1.0, 51), {"rod0.theta": np.pi / 2}))
    assert np.abs(slopes["theta", "mass"]).max() < 1e-9 < np.abs(slopes["theta", "length"]).max()
