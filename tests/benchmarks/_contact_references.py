"""Motions with contacts by SciPy: forces and feet in NumPy alone, integrated from contact to contact."""

import numpy as np
from scipy.integrate import solve_ivp

import symmb as mb

K, MU, SPEED, CHI = 1e5, 0.3, 0.05, 0.05


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def turned(angle, v):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1]])


def hertz(depth, rate, chi):
    return K * depth**1.5 * max(1 + chi * rate, 0.0) if depth > 0 else 0.0


def coulomb(slip):
    w = slip / SPEED
    size = np.sqrt(w @ w + 1e-8)
    return -MU * np.tanh(4 * size) / size * w


class Law:
    """Hertz with losses and friction, or without either."""

    def __init__(self, lossy):
        self.lossy, self.chi = lossy, CHI if lossy else 0.0
        e = 1 - self.chi / 1.5
        self.law = mb.HuntCrossley(K, e, 1.0)
        self.friction = mb.Coulomb(MU, SPEED) if lossy else None

    def force(self, gap, rate, normal, slip):
        f = hertz(-gap, -rate, self.chi)
        return f * normal + (f * coulomb(slip) if self.lossy else 0.0)


def marched(rates, gaps, y, times):
    """States at times (n_t, n): integrated from gap to gap."""
    events = []
    for k in range(len(gaps(y))):
        event = lambda t, y, k=k: gaps(y)[k]  # noqa: E731
        event.terminal = True
        events.append(event)
    t, found = times[0], [y]
    for end in times[1:]:
        while t < end:
            run = solve_ivp(rates, (t, end), y, "DOP853", rtol=1e-13, atol=1e-15, events=events, max_step=4e-3)
            y, at = run.y[:, -1], run.t[-1]
            if run.status == 1:  # past the event by a little
                on = solve_ivp(rates, (at, min(at + 1e-7, end)), y, "DOP853", rtol=1e-13, atol=1e-15)
                y, at = on.y[:, -1], on.t[-1]
            t = at
        found.append(y)
    return np.array(found)


def rounded(shape):
    """The shape of a circle: `shape(offset) -> [(height of its centre, normal, radius)]`."""
    return lambda d, angle: [(h - r, n, d - h * n) for h, n, r in shape(d)]


def planar(shape, law, m, J):
    """Rates and gaps of two planar bodies; `shape(offset, angle) -> [(gap, normal, foot)]` of b in the axes of a.

    y = x_a, y_a, theta_a, x_b, y_b, theta_b and their rates.
    """

    def touching(y):
        found = shape(turned(-y[2], y[3:5] - y[:2]), y[5] - y[2])
        return [(gap, turned(y[2], n), y[:2] + turned(y[2], foot)) for gap, n, foot in found]

    def rates(t, y):
        out = np.concatenate([y[6:], np.zeros(6)])
        for gap, n, foot in touching(y):
            v = [
                y[i + 6 : i + 8] + y[i + 8] * np.array([-(foot - y[i : i + 2])[1], (foot - y[i : i + 2])[0]])
                for i in (0, 3)
            ]
            slip = v[1] - v[0]
            f = law.force(gap, slip @ n, n, slip - (slip @ n) * n)
            for i, sign in ((0, -1), (3, 1)):
                out[i + 6 : i + 8] += sign * f / m
                out[i + 8] += sign * cross(foot - y[i : i + 2], f) / J
        return out

    return rates, lambda y: [gap for gap, _, _ in touching(y)]


def two_bodies(rng, make, shape, law, b_at, aim=None, end=1.0):
    """A scene of two planar bodies, b flying to a from b_at, and its reference."""
    m, J = rng.uniform(0.5, 2), rng.uniform(0.05, 0.2)
    a, b = (mb.Body(name, m, J, mb.Planar()) for name in "ab")
    start = np.zeros(12)
    start[3:5] = b_at
    aim = np.zeros(2) if aim is None else aim
    toward = aim - b_at
    start[9:11] = toward / max(np.linalg.norm(toward), 0.2) * rng.uniform(0.5, 1.5) + rng.uniform(-0.2, 0.2, 2)
    start[[8, 11]] = rng.uniform(-1.5, 1.5, 2)
    names = [f"{n}.{c}" for n in "ab" for c in ("x", "y", "theta")] + [
        f"{n}.{c}" for n in "ab" for c in ("vx", "vy", "omega")
    ]
    times = np.linspace(0, end, 5)
    system = mb.System(a, b, make(a.point(0, 0), b.point(0, 0), law))
    scene = mb.Scene(
        system,
        dict(zip(names, start.tolist(), strict=True)),
        times,
        {n: getattr(a if n[0] == "a" else b, n[2:]) for n in names},
    )
    return scene, marched(*planar(shape, law, m, J), start, times)


def particles(rng, law, a_moves, touching, make, start, end=1.0):
    """One or two particles in space: y = r_a, r_b, v_a, v_b, with r_a = v_a = 0 where a is the ground."""
    m = rng.uniform(0.5, 2, 2)
    a = mb.Body("a", m[0], pose=mb.Particle()) if a_moves else mb.Ground()
    b = mb.Body("b", m[1], pose=mb.Particle())
    g = np.array([0, 0, -3.0 if not a_moves else 0.0])

    def rates(t, y):
        out = np.concatenate([y[6:], np.zeros(6)])
        out[9:] = g
        for gap, n in touching(y[3:6] - y[:3]):
            v = y[9:] - y[6:9]
            f = law.force(gap, v @ n, n, v - (v @ n) * n)
            out[9:] += f / m[1]
            out[6:9] -= f / m[0] if a_moves else 0
        return out

    times = np.linspace(0, end, 5)
    bodies = [a, b] if a_moves else [b]
    names = [f"b.{c}" for c in ("x", "y", "z", "vx", "vy", "vz")]
    values = dict(zip(names, [*start[3:6], *start[9:]], strict=True))
    system = (
        mb.System(*bodies, make(a.point(0, 0, 0), b.point(0, 0, 0)), mb.Gravity(*g))
        if not a_moves
        else mb.System(*bodies, make(a.point(0, 0, 0), b.point(0, 0, 0)))
    )
    scene = mb.Scene(system, values, times, {n: getattr(b, n[2:]) for n in names})
    known = marched(rates, lambda y: [gap for gap, _ in touching(y[3:6] - y[:3])], start, times)
    return scene, known[:, [3, 4, 5, 9, 10, 11]]


def nearest(c, low, high, closed, side):
    """d -> height and normal on the curve c(s) -> place, first, second derivative, (2, n) each; ends are points."""
    samples = np.linspace(low, high, 400)
    places = c(samples)[0]

    def foot(d):
        s = samples[((places - d[:, None]) ** 2).sum(axis=0).argmin()]
        for _ in range(30):
            x, u, w = (part[:, 0] for part in c(np.array([s])))
            slope = u @ u - (d - x) @ w
            step = (d - x) @ u / (slope if slope > 0.1 * (u @ u) else u @ u)
            new = s + step if closed else min(max(s + step, low), high)
            s, step = new, abs(new - s)
            if step < 1e-8 * (high - low):  # its square is left
                break
        x, u, _ = (part[:, 0] for part in c(np.array([s])))
        e = d - x
        if not closed and (s <= low or s >= high):
            return np.hypot(*e), e / np.hypot(*e)
        n = side * np.array([-u[1], u[0]]) / np.hypot(*u)
        return e @ n, n

    return foot
