"""Shapes, ropes, cams and grooves against integrations by SciPy: 30 random ones each, with lift-off and return.

    python tests/benchmarks/contact_shapes.py [names] [--count 30]

The forces are written again in NumPy, with feet by geometry of their own. SciPy's DOP853 stops where a gap opens or
closes, and goes on from there. It ends with status 1 if a motion is off by more than 1e-7, or if the energy of one
without damping and friction drifts by more than 1e-8 of the largest kinetic energy.
"""

import argparse
import sys
import time

import casadi as ca
import numpy as np
from _contact_references import Law, coulomb, cross, hertz, marched, nearest, particles, rounded, turned, two_bodies
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.optimize import brentq

import symmb as mb

TOLERANCE, DRIFT = 1e-7, 1e-8


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
        rng,
        lambda a, b, w: mb.CircleContact("c", a, b, ra, rb, w.law, w.friction, inside),
        rounded(shape),
        law,
        at,
        aim,
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
    return two_bodies(rng, make, rounded(shape), law, at, aim)


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


def polar(r0, a, n):
    """r(s) = r0 + a cos(n s): for NumPy and for CasADi."""

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
    return two_bodies(rng, make, rounded(lambda d: [(*foot(d), r)]), law, at, aim)


def spline(rng):
    """A roller beside a cam of points."""
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
    return two_bodies(rng, make, rounded(lambda d: [(*foot(d), r)]), law, at)


def polygon(rng):
    """A roller beside a polygon, whose corners are convex, or in one, whose corners are concave."""
    inside, n, r = rng.uniform() < 0.5, int(rng.integers(3, 6)), 0.1
    w = (np.arange(n) + rng.uniform(-0.2, 0.2, n)) * 2 * np.pi / n
    size = 0.6 if inside else 0.3
    points = size * np.array([np.cos(w), np.sin(w)]).T
    sides = list(zip(points, np.roll(points, -1, axis=0), strict=True))

    def foot(d, p, q):
        along = (q - p) / np.hypot(*(q - p))
        s, n = (d - p) @ along, np.array([-along[1], along[0]]) * (1 if inside else -1)
        if 0 < s < np.hypot(*(q - p)):
            return (d - p) @ n, n
        e = d - (p if s <= 0 else q)
        return np.hypot(*e), e / np.hypot(*e)

    curve, law = mb.Curve(points, closed=True, corners=range(n)), Law(rng.uniform() < 0.5)

    def shape(d):
        near = [(*foot(d, *side), r) for side in sides]
        return near if inside else [min(near, key=lambda one: abs(one[0]))]

    at = rng.uniform(-0.1, 0.1, 2) if inside else 0.5 * turned(rng.uniform(0, 6.28), np.array([1.0, 0]))
    aim = rng.uniform(-0.6, 0.6, 2) if inside else None
    make = lambda p, q, w: mb.CurveContact("c", p, curve, q, r, w.law, w.friction, inside)  # noqa: E731
    return two_bodies(rng, make, rounded(shape), law, at, aim)


def on_ground(rng, curve, c, low, high):
    """A ball thrown over a ground with two ends, on which it bounces and rolls."""
    r, law, m = 0.06, Law(rng.uniform() < 0.5), 1.0
    foot, J = nearest(c, low, high, False, 1), 0.4 * m * r * r
    ball = mb.Body("b", m, J, mb.Planar())
    contact = mb.CurveContact("c", mb.Ground().point(0, 0), curve, ball.point(0, 0), r, law.law, law.friction)

    def rates(t, y):
        h, n = foot(y[:2])
        e = -h * n
        v = y[3:5] + y[5] * np.array([-e[1], e[0]])
        f = law.force(h - r, v @ n, n, v - (v @ n) * n)
        return np.array([*y[3:], *(f / m + [0, -5.0]), cross(e, f) / J])

    start = np.array([rng.uniform(-1, -0.5), 0.4, 0, rng.uniform(0.5, 2.5), rng.uniform(-1, 1), rng.uniform(-3, 3)])
    scene, times = free_body(ball, [contact], start, 1.0)
    return scene, marched(rates, lambda y: [foot(y[:2])[0] - r], start, times)


def free_body(body, elements, start, end):
    """The scene of a planar body, and its times."""
    names, times = ["x", "y", "theta", "vx", "vy", "omega"], np.linspace(0, end, 5)
    values = {f"b.{n}": v for n, v in zip(names, start.tolist(), strict=True)}
    system = mb.System(body, *elements, mb.Gravity(0, -5.0))
    return mb.Scene(system, values, times, {n: getattr(body, n) for n in names}), times


def track(rng):
    """A wavy ground from an expression."""
    a, k = rng.uniform(0.02, 0.08), rng.uniform(2, 5)

    def c(s):
        wave = a * np.sin(k * s)
        return np.array([s, wave]), np.array([1 + 0 * s, a * k * np.cos(k * s)]), np.array([0 * s, -k * k * wave])

    return on_ground(rng, mb.Curve(lambda s: (s, a * ca.sin(k * s)), -1.5, 1.5), c, -1.5, 1.5)


def ground(rng):
    """A ground through points, by an open spline."""
    points = np.column_stack([np.linspace(-1.5, 1.5, 9), rng.uniform(-0.05, 0.05, 9)])
    u = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    f = CubicSpline(u, points)
    return on_ground(rng, mb.Curve(points), lambda s: tuple(f(s, k).T for k in range(3)), 0, u[-1])


def lift(rng):
    """A follower on a cam by a table of its lift, with a spring that drives the cam: one degree of freedom."""
    x = np.concatenate([[-4.0], np.sort(rng.uniform(-3.5, 3.5, 6)), [4.0]])
    y, m, J, k = rng.uniform(0, 0.05, 8), 0.5, 0.01, rng.uniform(0.5, 2)
    law = PchipInterpolator(x, y)
    pieces = [law.derivative(n) for n in (1, 2)]

    def rates(t, s):
        slope, bend = (float(f(s[0])) for f in pieces)
        torque = -k * s[0] - m * slope * (9.81 + bend * s[1] ** 2)
        return np.array([s[1], torque / (J + m * slope**2)])

    disc, rod, base = mb.Body("disc", 1.0, J), mb.Body("rod", m, 0.1), mb.Ground()
    shaft = mb.Revolute("shaft", base.point(0, 0), disc.point(0, 0))
    guide = mb.Prismatic("guide", base.point(0, 0), rod.point(0, 0), (0, 1, 0))
    follower = mb.CamFollower("cam", shaft, guide, mb.Table(x, y), unilateral=False)
    spring = mb.TorsionSpring("spring", base, disc, k)
    system = mb.System(disc, rod, shaft, guide, follower, spring, mb.Gravity(0, -9.81))
    start, times = np.array([rng.uniform(-2, 2), rng.uniform(-2, 2)]), np.linspace(0, 1.0, 5)
    scene = mb.Scene(
        system, {"shaft.angle": start[0], "shaft.angle_rate": start[1]}, times, {"a": shaft.angle, "y": rod.y}
    )
    known = marched(rates, lambda s: s[0] - x, start, times)[:, 0]
    return scene, np.column_stack([known, law(known)])


def groove(rng):
    """A bead held in a groove, by its equation of motion along the curve."""
    n, r0 = int(rng.integers(1, 4)), 0.5
    c, curve = polar(r0, rng.uniform(0.1, 0.6) * r0 / (n * n + 1), n)
    bead = mb.Body("b", 1.0, pose=mb.Particle())
    wire = mb.PointOnCurve("wire", mb.Ground().point(0, 0), bead.point(0, 0), curve)

    def rates(t, y):
        _, d, dd = c(y[0])
        return np.array([y[1], (-5.0 * d[1] - d @ dd * y[1] ** 2) / (d @ d)])

    start, times = np.array([rng.uniform(0.3, 2.8), rng.uniform(-4, 4)]), np.linspace(0, 1, 5)
    place, along, _ = c(start[0])
    scene = mb.Scene(
        mb.System(bead, wire, mb.Gravity(0, -5.0)),
        {"b.x": place[0], "b.vx": along[0] * start[1]},
        times,
        {"x": bead.x, "y": bead.y},
        guess={"b.y": place[1]},
    )
    known = marched(rates, lambda y: [], start, times)[:, 0]
    return scene, np.array([c(s)[0] for s in known])


def tumbling(rng):
    """A box in space that falls on its corners: y = r, unit quaternion, velocity, angular velocity in body axes."""
    half, law, m = rng.uniform(0.1, 0.3, 3), Law(rng.uniform() < 0.5), 1.0
    inertia = m / 3 * ((half**2).sum() - half**2)
    n = np.array([*rng.uniform(-0.3, 0.3, 2), 1.0])
    n /= np.linalg.norm(n)
    arms = half * np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    body = mb.Body("b", m, np.diag(inertia), mb.Spatial())

    def turned_arms(y):
        w, v = y[3], y[4:7]
        return arms + 2 * np.cross(v, np.cross(v, arms) + w * arms)

    def rates(t, y):
        w, v, omega = y[3], y[4:7], y[10:]
        R = np.array([e + 2 * np.cross(v, np.cross(v, e) + w * e) for e in np.eye(3)]).T
        force, torque, spin = np.array([0, 0, -5.0 * m]), np.zeros(3), R @ omega
        for e in turned_arms(y):
            gap = (y[:3] + e) @ n
            if gap < 0:
                f = hertz(-gap, -(y[7:10] + np.cross(spin, e)) @ n, law.chi)
                at = y[7:10] + np.cross(spin, e - gap * n)
                drag = f * coulomb(at - (at @ n) * n) if law.lossy else np.zeros(3)
                force = force + f * n + drag
                torque += np.cross(e, f * n) + np.cross(e - gap * n, drag)
        turning = 0.5 * np.array([-v @ omega, *(w * omega + np.cross(v, omega))])
        return np.concatenate(
            [y[7:10], turning, force / m, (R.T @ torque - np.cross(omega, inertia * omega)) / inertia]
        )

    axis, angle = rng.normal(size=3), rng.uniform(0, 3)
    axis /= np.linalg.norm(axis)
    q, rotation = [np.cos(angle / 2), *np.sin(angle / 2) * axis], mb.rotation(tuple(axis), angle)
    start = np.array([0, 0, np.linalg.norm(half) + 0.1, *q, *rng.uniform(-0.5, 0.5, 3), *rng.uniform(-2, 2, 3)])
    times = np.linspace(0, 0.5, 4)
    contact = mb.BoxContact(
        "c", body.point(0, 0), tuple(2 * half), mb.Ground().point(0, 0), law.law, normal=tuple(n), friction=law.friction
    )
    system = mb.System(body, contact, mb.Gravity(0, 0, -5.0))
    names = ["x", "y", "z", "vx", "vy", "vz", "omega_x", "omega_y", "omega_z"]
    values = {f"b.{name}": value for name, value in zip(names, [*start[:3], *start[7:]], strict=True)}
    values["b.rotation"] = rotation
    scene = mb.Scene(system, values, times, {name: getattr(body, name) for name in ("x", "y", "z", "vx", "vy", "vz")})
    known = marched(rates, lambda y: (y[:3] + turned_arms(y)) @ n, start, times)
    return scene, known[:, [0, 1, 2, 7, 8, 9]]


def extreme(shape, n):
    """The places of an ellipse (2,), or of a polygon (n, 2), that are farthest in directions (2,) or (2, m)."""
    if shape.ndim == 2:
        return shape[(shape @ n).argmax(axis=0)].T
    return (shape**2 * n.T).T / np.hypot(*(shape * n.T).T)


def by_supports(a, b, inside):
    """The shape of b beside a, or in it: the direction in which they are farthest apart is found by supports."""
    angles, sign = np.linspace(-np.pi, np.pi, 73), -1 if inside else 1

    def shape(d, angle):
        def both(w):
            n = np.array([np.cos(w), np.sin(w)])
            return n, (d + turned(angle, extreme(b, turned(-angle, -sign * n))).T).T, extreme(a, n)

        def slope(w):
            n, z, x = both(w)
            return sign * cross(n, z - x)

        def gap(w):
            n, z, x = both(w)
            return sign * ((z - x) * n).sum(axis=0)

        w = angles[gap(angles).argmin() if inside else gap(angles).argmax()]
        w = brentq(slope, w - 0.09, w + 0.09, xtol=1e-15)
        n, z, x = both(w)
        return [(gap(w), sign * n, x if b.ndim == 2 else z - gap(w) * sign * n)]  # one of them is smooth

    return shape


def ovals(rng):
    """An ellipse beside another one, or in a ring or a polygon, whose corners it touches at two sides."""
    b, w = rng.uniform(0.1, 0.2, 2), (np.arange(4) + rng.uniform(-0.2, 0.2, 4)) * np.pi / 2
    circle = np.array([np.cos(w), np.sin(w)]).T
    inside, is_polygon, law = rng.uniform() < 0.5, rng.uniform() < 0.5, Law(rng.uniform() < 0.5)
    is_polygon &= inside
    a = circle * 0.6 if is_polygon else rng.uniform(0.55, 0.65, 2) if inside else b[::-1] * 1.2
    oval = lambda size: mb.Curve(lambda s: (size[0] * ca.cos(s), size[1] * ca.sin(s)), 0, 2 * np.pi, True)  # noqa: E731
    outline = mb.Curve(a, closed=True, corners=range(4)) if is_polygon else oval(a)

    def sides(d, angle):
        """Each side of a polygon by itself: in a corner two of them touch."""
        found = []
        for p, q in zip(a, np.roll(a, -1, axis=0), strict=True):
            n = np.array([(p - q)[1], (q - p)[0]]) / np.hypot(*(q - p))
            z = d + turned(angle, extreme(b, turned(-angle, -n)))
            found.append(((z - p) @ n, n, z - (z - p) @ n * n))
        return found

    shape = sides if inside and is_polygon else by_supports(a, b, inside)
    at = rng.uniform(-0.1, 0.1, 2) if inside else 0.6 * turned(rng.uniform(0, 6.28), np.array([1.0, 0]))
    aim = rng.uniform(-0.6, 0.6, 2) if inside else None
    make = lambda p, q, w: mb.CurveContact("c", p, outline, q, 0.0, w.law, w.friction, inside, oval(b))  # noqa: E731
    return two_bodies(rng, make, shape, law, at, aim)


def oval_on_polygon(rng):
    """An ellipse beside a polygon, whose sides and corners it touches, with either of them first."""
    n = int(rng.integers(3, 6))
    w, oval, law = (
        (np.arange(n) + rng.uniform(-0.2, 0.2, n)) * 2 * np.pi / n,
        rng.uniform(0.1, 0.2, 2),
        Law(rng.uniform() < 0.5),
    )
    corners = 0.3 * np.array([np.cos(w), np.sin(w)]).T
    smooth = mb.Curve(lambda s: (oval[0] * ca.cos(s), oval[1] * ca.sin(s)), 0, 2 * np.pi, True)
    both = [(corners, mb.Curve(corners, closed=True, corners=range(n))), (oval, smooth)]
    (a, curve), (b, curve_b) = both[:: rng.choice([1, -1])]
    at = 0.65 * turned(rng.uniform(0, 6.28), np.array([1.0, 0]))
    make = lambda p, q, w: mb.CurveContact("c", p, curve, q, 0.0, w.law, w.friction, False, curve_b)  # noqa: E731
    return two_bodies(rng, make, by_supports(a, b, False), law, at)


KINDS = {
    f.__name__: f
    for f in (
        *(circle, slot, sphere, box, corners, tumbling, rope),
        *(cam, spline, polygon, track, ground, lift, groove, ovals, oval_on_polygon),
    )
}


def has_losses(scene):
    """Whether some element has friction or damping."""
    elements = scene.system.elements
    return any(getattr(e, "friction", None) is not None or getattr(e, "damping", 0.0) != 0 for e in elements)


def solver_of(name):
    """A slot throws its pin to and fro so often that errors grow by ten thousand."""
    return mb.DormandPrince(rtol=1e-12 if name == "slot" else 1e-11)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*", default=[])
    parser.add_argument("--count", type=int, default=30)
    options = parser.parse_args()
    failed = False
    for name in options.names or KINDS:
        errors, drifts, begin = [], {False: [], True: []}, time.perf_counter()
        for seed in range(options.count):
            scene, known = KINDS[name](np.random.default_rng([seed, len(name)]))
            run = mb.simulate(scene, solver_of(name))
            errors.append(float((np.abs(run.values - known) / np.maximum(np.abs(known).max(axis=0), 1)).max()))
            lossy = has_losses(scene)
            drifts[lossy].append(run.energy_drift)
            if errors[-1] > TOLERANCE or (not lossy and run.energy_drift > DRIFT):
                failed = True
                print(f"  {name} {seed}: {errors[-1]:.1e}, energy {run.energy_drift:.1e}", flush=True)
        print(
            f"{name:10s} error {max(errors):.1e}, median {np.median(errors):.1e}; energy drift of "
            f"{len(drifts[False])} without losses {max(drifts[False], default=0):.1e}, "
            f"of {len(drifts[True])} with {max(drifts[True], default=0):.1e}; {time.perf_counter() - begin:.0f} s",
            flush=True,
        )
    sys.exit(failed)


if __name__ == "__main__":
    main()
