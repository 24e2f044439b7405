"""Contacts of shapes and ropes against integrations by SciPy: 30 random ones each, with lift-off and return.

    python tests/benchmarks/contact_shapes.py [names] [--count 30]

The forces are written again in NumPy, with feet by geometry of their own. SciPy's DOP853 stops where a gap opens or
closes, and goes on from there.
"""

import argparse
import sys
import time

import numpy as np
from scipy.integrate import solve_ivp

import symmb as mb

TOLERANCE, SOLVER = 1e-7, mb.DormandPrince(rtol=1e-12)
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
            run = solve_ivp(rates, (t, end), y, "DOP853", rtol=1e-13, atol=1e-15, events=events, max_step=2e-3)
            y, at = run.y[:, -1], run.t[-1]
            if run.status == 1:  # past the event by a little
                on = solve_ivp(rates, (at, min(at + 1e-7, end)), y, "DOP853", rtol=1e-13, atol=1e-15)
                y, at = on.y[:, -1], on.t[-1]
            t = at
        found.append(y)
    return np.array(found)


def planar(shape, law, m, J):
    """Rates and gaps of two planar bodies a, b; `shape(offset) -> [(height, normal, radius)]` in the axes of a.

    The point of b is its centre. y = x_a, y_a, theta_a, x_b, y_b, theta_b and their rates.
    """

    def touching(y):
        return [(h - r, turned(y[2], n), h) for h, n, r in shape(turned(-y[2], y[3:5] - y[:2]))]

    def rates(t, y):
        out = np.concatenate([y[6:], np.zeros(6)])
        for gap, n, h in touching(y):
            foot = y[3:5] - h * n
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


def circle(rng):
    inside = rng.uniform() < 0.5
    ra, rb = (rng.uniform(0.4, 0.6), rng.uniform(0.1, 0.3)) if inside else rng.uniform(0.1, 0.3, 2)
    law = Law(rng.uniform() < 0.5)

    def shape(d):
        dist = np.hypot(*d)
        return [(ra - dist, -d / dist, rb) if inside else (dist - ra, d / dist, rb)]

    at = rng.uniform(-0.1, 0.1, 2) if inside else (ra + rb) * 1.1 * turned(rng.uniform(0, 6.28), np.array([1.0, 0]))
    aim = rng.uniform(-0.5, 0.5, 2) if inside else None
    return two_bodies(
        rng, lambda a, b, w: mb.CircleContact("c", a, b, ra, rb, w.law, w.friction, inside), shape, law, at, aim
    )


def slot(rng):
    inside = rng.uniform() < 0.6
    ra, rb, length = (0.12, 0.1, rng.uniform(0.1, 0.4)) if inside else (0.1, 0.15, rng.uniform(0.2, 0.5))
    u, law = turned(rng.uniform(0, 6.28), np.array([1.0, 0])), Law(rng.uniform() < 0.5)

    def shape(d):
        e = d - np.clip(d @ u, 0, length) * u
        dist = max(np.hypot(*e), 1e-9)
        return [(ra - dist, -e / dist, rb) if inside else (dist - ra, e / dist, rb)]

    middle = length / 2 * u
    at = middle if inside else middle + (length / 2 + ra + rb) * 1.1 * turned(rng.uniform(0, 6.28), np.array([1.0, 0]))
    aim = middle + rng.uniform(-0.5, 0.5, 2) if inside else middle
    make = lambda a, b, w: mb.SlotContact("c", a, b, tuple(3 * u), length, ra, rb, w.law, w.friction, inside)  # noqa: E731
    return two_bodies(rng, make, shape, law, at, aim)


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


def sphere(rng):
    inside = rng.uniform() < 0.4
    ra, rb = (0.6, 0.2) if inside else rng.uniform(0.1, 0.3, 2)
    law = Law(rng.uniform() < 0.5)

    def touching(d):
        dist = np.linalg.norm(d)
        return [(ra - dist - rb, -d / dist) if inside else (dist - ra - rb, d / dist)]

    n = rng.normal(size=3)
    n /= np.linalg.norm(n)
    start = np.zeros(12)
    start[3:6] = n * (0.1 if inside else 1.1 * (ra + rb))
    start[9:] = -n * rng.uniform(0.5, 1.5) + rng.uniform(-0.3, 0.3, 3)
    make = lambda a, b: mb.SphereContact("c", a, b, ra, rb, law.law, law.friction, inside)  # noqa: E731
    return particles(rng, law, True, touching, make, start)


def box(rng):
    half, r, law = rng.uniform(0.2, 0.5, 3), rng.uniform(0.05, 0.2), Law(rng.uniform() < 0.5)

    def touching(d):
        e = d - np.clip(d, -half, half)
        dist = max(np.linalg.norm(e), 1e-12)
        return [(dist - r, e / dist)]

    start = np.zeros(12)
    start[3:6] = [*rng.uniform(-1.1, 1.1, 2) * half[:2], half[2] + r + rng.uniform(0.05, 0.2)]
    start[9:] = rng.uniform(-0.5, 0.5, 3)
    make = lambda a, b: mb.BoxContact("c", a, tuple(2 * half), b, law.law, r, friction=law.friction)  # noqa: E731
    return particles(rng, law, False, touching, make, start)


def corners(rng):
    half, law, m = rng.uniform(0.1, 0.3, 2), Law(rng.uniform() < 0.5), 1.0
    J = m / 3 * float(half @ half)
    body = mb.Body("b", m, J, mb.Planar())
    tilt = rng.uniform(-0.3, 0.3)
    n = turned(tilt, np.array([0, 1.0]))
    arms = [half * s for s in ((-1, -1), (-1, 1), (1, -1), (1, 1))]

    def touching(y):
        return [(y[:2] + turned(y[2], arm)) @ n for arm in arms]

    def rates(t, y):
        out = np.array([*y[3:], 0, -5.0, 0])
        for arm in arms:
            e = turned(y[2], arm)
            gap = (y[:2] + e) @ n
            # Friction acts at the foot of the corner on the plane.
            foot = e - gap * n
            v, at = (y[3:5] + y[5] * np.array([-p[1], p[0]]) for p in (e, foot))
            f = hertz(-gap, -(v @ n), law.chi)
            drag = f * coulomb(at - (at @ n) * n) if law.lossy else np.zeros(2)
            out[3:5] += (f * n + drag) / m
            out[5] += (cross(e, f * n) + cross(foot, drag)) / J
        return out

    start = np.array([0, half.sum() + 0.2, rng.uniform(0, 3), *rng.uniform(-0.5, 0.5, 2), rng.uniform(-2, 2)])
    names = ["x", "y", "theta", "vx", "vy", "omega"]
    times = np.linspace(0, 0.6, 4)
    contact = mb.BoxContact(
        "c", body.point(0, 0), tuple(2 * half), mb.Ground().point(0, 0), law.law, normal=tuple(n), friction=law.friction
    )
    scene = mb.Scene(
        mb.System(body, contact, mb.Gravity(0, -5.0)),
        {f"b.{n}": v for n, v in zip(names, start, strict=True)},
        times,
        {n: getattr(body, n) for n in names},
    )
    return scene, marched(rates, touching, start, times)


def rope(rng):
    k, c, m = 2e3, rng.choice([0.0, 5.0]), rng.uniform(0.5, 2)
    p, q = np.array([-1.0, 1.0]), np.array([0.0, 1.0])
    r = rng.choice([0.0, 0.2])
    load, ground = mb.Body("b", m, pose=mb.Particle()), mb.Ground()
    winch = rng.uniform(-0.2, 0.2)

    def way(x):
        """Way from p over the pulley at q to x, and the direction of its last part: tangent points are constructed."""
        if r == 0:
            return np.hypot(*(q - p)) + np.hypot(*(x - q)), (x - q) / np.hypot(*(x - q))
        tangents = []
        for point, side in ((p, 1), (x, -1)):  # clockwise round the pulley, from its top to its right
            d = point - q
            angle = np.arctan2(d[1], d[0]) - side * np.arccos(r / np.hypot(*d))
            tangents.append(angle)
        on = [q + r * np.array([np.cos(w), np.sin(w)]) for w in tangents]
        arc = (tangents[0] - tangents[1] + np.pi) % (2 * np.pi) - np.pi
        return np.hypot(*(on[0] - p)) + np.hypot(*(x - on[1])) + r * arc, (x - on[1]) / np.hypot(*(x - on[1]))

    def stretch(t, y):
        return way(y[:2])[0] - length0 - winch * t

    def rates(t, y):
        long, u = way(y[:2])
        s = long - length0 - winch * t
        pull = max(k * s + c * (u @ y[2:4] - winch), 0) if s > 0 else 0.0
        return [*y[2:4], *(-pull * u / m + np.array([0, -9.81])), 1.0]

    start = np.array([rng.uniform(0.4, 0.8), rng.uniform(0.0, 0.4), *rng.uniform(-1, 1, 2), 0.0])
    length0 = way(start[:2])[0] * rng.uniform(1.0, 1.05)
    times = np.linspace(0, 0.6, 4)
    over = (ground.point(*q), -r) if r else ground.point(*q)
    line = mb.Rope("rope", [ground.point(*p), over, load.point(0, 0)], k, length0 + winch * mb.t, c)
    scene = mb.Scene(
        mb.System(load, line, mb.Gravity(0, -9.81)),
        dict(zip(("b.x", "b.y", "b.vx", "b.vy"), start[:4], strict=True)),
        times,
        {n: getattr(load, n) for n in ("x", "y", "vx", "vy")},
    )
    return scene, marched(rates, lambda y: [stretch(y[4], y)], start, times)[:, :4]


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
            if abs(new - s) < 1e-15 * (high - low):
                break
            s = new
        x, u, _ = (part[:, 0] for part in c(np.array([s])))
        e = d - x
        if not closed and (s <= low or s >= high):
            return np.hypot(*e), e / np.hypot(*e)
        n = side * np.array([-u[1], u[0]]) / np.hypot(*u)
        return e @ n, n

    return foot


def polar(r0, a, n):
    """r(s) = r0 + a cos(n s): for NumPy and for CasADi."""
    import casadi as ca

    def c(s):
        r, dr, ddr = r0 + a * np.cos(n * s), -a * n * np.sin(n * s), -a * n * n * np.cos(n * s)
        e, f = np.array([np.cos(s), np.sin(s)]), np.array([-np.sin(s), np.cos(s)])
        return r * e, dr * e + r * f, (ddr - r) * e + 2 * dr * f

    return c, mb.Curve(
        lambda s: ((r0 + a * ca.cos(n * s)) * ca.cos(s), (r0 + a * ca.cos(n * s)) * ca.sin(s)), 0, 2 * np.pi, True
    )


def cam(rng):
    """A roller beside or in a lobed cam; both bodies are free."""
    inside, n = rng.uniform() < 0.4, int(rng.integers(1, 4))
    r0, r = (0.7, 0.1) if inside else (0.3, rng.uniform(0.05, 0.1))
    a = rng.uniform(0.2, 0.8) * r0 / (n * n + 1) * (0.5 if inside else 1)
    c, curve = polar(r0, a, n)
    law = Law(rng.uniform() < 0.5)
    foot = nearest(c, 0, 2 * np.pi, True, 1 if inside else -1)
    at = rng.uniform(-0.2, 0.2, 2) if inside else (r0 + a + r + 0.05) * turned(rng.uniform(0, 6.28), np.array([1.0, 0]))
    aim = rng.uniform(-0.6, 0.6, 2) if inside else None
    make = lambda p, q, w: mb.CurveContact("c", p, curve, q, r, w.law, w.friction, inside)  # noqa: E731
    return two_bodies(rng, make, lambda d: [(*foot(d), r)], law, at, aim)


def spline(rng):
    """A roller beside a cam of points."""
    from scipy.interpolate import CubicSpline

    n, r = 12, 0.08
    w = np.arange(n) * 2 * np.pi / n
    points = ((0.3 + rng.uniform(-0.02, 0.02, n)) * np.array([np.cos(w), np.sin(w)])).T
    around = np.vstack([points, points[:1]])
    u = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(around, axis=0).T))])
    f = CubicSpline(u, around, bc_type="periodic")
    foot = nearest(lambda s: tuple(f(s % u[-1], k).T for k in range(3)), 0, u[-1], True, -1)
    curve, law = mb.Curve(points, closed=True), Law(rng.uniform() < 0.5)
    at = 0.5 * turned(rng.uniform(0, 6.28), np.array([1.0, 0]))
    make = lambda p, q, w: mb.CurveContact("c", p, curve, q, r, w.law, w.friction)  # noqa: E731
    return two_bodies(rng, make, lambda d: [(*foot(d), r)], law, at)


def polygon(rng):
    """A roller beside a polygon, whose corners are convex, or in one, whose corners are concave."""
    inside, n, r = rng.uniform() < 0.5, int(rng.integers(3, 6)), 0.1
    w = (np.arange(n) + rng.uniform(-0.2, 0.2, n)) * 2 * np.pi / n
    size = 0.6 if inside else 0.3
    points = size * np.array([np.cos(w), np.sin(w)]).T
    feet = []
    for p, q in zip(points, np.roll(points, -1, axis=0), strict=True):

        def line(s, p=p, q=q):
            return p[:, None] + (q - p)[:, None] * s, (q - p)[:, None] + 0 * s, 0 * s + np.zeros((2, 1))

        feet.append(nearest(line, 0, 1, False, 1 if inside else -1))
    curve, law = mb.Curve(points, closed=True, corners=range(n)), Law(rng.uniform() < 0.5)

    def shape(d):
        found = [foot(d) for foot in feet]
        near = [(h, n, r) for h, n in found]
        return near if inside else [min(near, key=lambda one: abs(one[0]))]

    at = rng.uniform(-0.1, 0.1, 2) if inside else 0.5 * turned(rng.uniform(0, 6.28), np.array([1.0, 0]))
    aim = rng.uniform(-0.6, 0.6, 2) if inside else None
    make = lambda p, q, w: mb.CurveContact("c", p, curve, q, r, w.law, w.friction, inside)  # noqa: E731
    return two_bodies(rng, make, shape, law, at, aim)


def track(rng):
    """A ball thrown over a wavy ground with two ends, on which it bounces and rolls."""
    import casadi as ca

    a, k, r, law = rng.uniform(0.02, 0.08), rng.uniform(2, 5), 0.06, Law(rng.uniform() < 0.5)
    foot = nearest(
        lambda s: (
            np.array([s, a * np.sin(k * s)]),
            np.array([1 + 0 * s, a * k * np.cos(k * s)]),
            np.array([0 * s, -a * k * k * np.sin(k * s)]),
        ),
        -1.5,
        1.5,
        False,
        1,
    )
    curve = mb.Curve(lambda s: (s, a * ca.sin(k * s)), -1.5, 1.5)
    m, J = 1.0, 0.4 * r * r
    ball = mb.Body("b", m, J, mb.Planar())
    contact = mb.CurveContact("c", mb.Ground().point(0, 0), curve, ball.point(0, 0), r, law.law, law.friction)

    def rates(t, y):
        h, n = foot(y[:2])
        e = -h * n
        v = y[3:5] + y[5] * np.array([-e[1], e[0]])
        f = law.force(h - r, v @ n, n, v - (v @ n) * n)
        return np.array([*y[3:], *(f / m + [0, -5.0]), cross(e, f) / J])

    start = np.array([rng.uniform(-1, -0.5), 0.4, 0, rng.uniform(0.5, 2.5), rng.uniform(-1, 1), rng.uniform(-3, 3)])
    names, times = ["x", "y", "theta", "vx", "vy", "omega"], np.linspace(0, 1.0, 5)
    scene = mb.Scene(
        mb.System(ball, contact, mb.Gravity(0, -5.0)),
        {f"b.{n}": v for n, v in zip(names, start, strict=True)},
        times,
        {n: getattr(ball, n) for n in names},
    )
    return scene, marched(rates, lambda y: [foot(y[:2])[0] - r], start, times)


KINDS = {f.__name__: f for f in (circle, slot, sphere, box, corners, rope, cam, spline, polygon, track)}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*", default=[])
    parser.add_argument("--count", type=int, default=30)
    options = parser.parse_args()
    worst = 0.0
    for name in options.names or KINDS:
        errors, drifts, begin = [], [], time.perf_counter()
        for seed in range(options.count):
            scene, known = KINDS[name](np.random.default_rng([seed, len(name)]))
            run = mb.simulate(scene, SOLVER)
            errors.append(float((np.abs(run.values - known) / np.maximum(np.abs(known).max(axis=0), 1)).max()))
            drifts.append(run.energy_drift)
            if errors[-1] > TOLERANCE:
                print(f"  {name} {seed}: {errors[-1]:.1e}", flush=True)
        worst = max(worst, *errors)
        print(
            f"{name:10s} error {max(errors):.1e}, median {np.median(errors):.1e}; energy drift {max(drifts):.1e}; "
            f"{time.perf_counter() - begin:.0f} s",
            flush=True,
        )
    sys.exit(worst > TOLERANCE)


if __name__ == "__main__":
    main()
