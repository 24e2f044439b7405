"""Random motions with figures, and the same by SciPy: dense output between events, searched and refined there."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

import symmb as mb

SPAN = 3.0
_POINTS = 4001


@dataclass(frozen=True)
class Motion:
    """A particle in the plane, y = (x, y, vx, vy), with parameters k and c.

    Attributes
    ----------
    scene : figures by name -> Scene
    rates : (t, y, k, c) -> y'
    start : (4,)
    gap : y -> its sign changes where rates bend, or where `bounce` acts; None without
    bounce : (y, k, c) -> y behind an impact; None without
    curves : pairs of an expression and its values (t, y, k, c), for rows y (4, n)
    """

    name: str
    scene: Callable[[dict[str, Any]], mb.Scene]
    rates: Callable[..., Any]
    start: np.ndarray
    curves: tuple[tuple[ca.SX, Callable[..., Any]], ...]
    gap: Callable[..., Any] | None = None
    bounce: Callable[..., Any] | None = None

    def segments(self, k, c, rtol=1e-12):
        """Pieces (begin, end, dense output) between events."""
        t, y, pieces, side = 0.0, np.array(self.start), [], 1.0
        while t < SPAN:
            events = None
            if self.gap is not None:

                def event(t, y, k, c):
                    return self.gap(y)

                event.terminal, event.direction = True, -side
                events = [event]
            exact = {"method": "DOP853", "rtol": rtol, "atol": 1e-13, "max_step": 0.1}
            run = solve_ivp(self.rates, (t, SPAN), y, dense_output=True, events=events, args=(k, c), **exact)
            pieces.append((t, run.t[-1], run.sol))
            t, y = run.t[-1], run.y[:, -1]
            if run.status == 1:
                if self.bounce is not None:
                    y = self.bounce(y, k, c)
                else:
                    side = -side
        return pieces


def _dense(curve, pieces, k, c, window):
    """Places (n,) and values of a curve over a window, piece by piece, with functions of time."""
    for begin, end, sol in pieces:
        low, high = max(begin, window[0]), min(end, window[1])
        if low < high:
            t = np.linspace(low, high, max(50, int(_POINTS * (high - low) / SPAN)))
            yield t, curve(t, sol(t), k, c), lambda t, sol=sol: float(curve(t, sol(t), k, c))


def highest(curve, pieces, k, c, window):
    """The largest value of a curve."""
    best = -np.inf
    for t, values, f in _dense(curve, pieces, k, c, window):
        i = int(values.argmax())
        best = max(best, values[i])
        if 0 < i < len(t) - 1:
            ends = (t[i - 1], t[i + 1])
            found = minimize_scalar(lambda t, f=f: -f(t), bounds=ends, method="bounded", options={"xatol": 1e-12})
            best = max(best, -found.fun)
    return best


def passage(curve, pieces, k, c, window):
    """When a curve first becomes 0 or less, and the piece; nan if it does not. A kink at 0 counts."""
    scale = max(np.abs(values).max() for _, values, _ in _dense(curve, pieces, k, c, (0.0, SPAN)))
    for t, values, f in _dense(curve, pieces, k, c, window):
        if values[0] <= 0 and values[0] > -1e-9 * scale and len(values) > 1 and values[1] > values[0]:
            values[0] = 1e-30  # behind an impact
        below = np.flatnonzero(values <= 1e-10 * scale)
        if not below.size:
            continue
        i = int(below[0])
        if i == 0 or values[i] > 0 or values[i - 1] <= 0:
            return float(t[i])
        return float(brentq(f, t[i - 1], t[i], xtol=1e-14))
    return np.nan


def at(curve, pieces, k, c, time):
    """The value of a curve at a time, before a jump."""
    sol = next(sol for begin, end, sol in pieces if time <= end + 1e-12)
    return float(curve(time, sol(time), k, c))


def mean(curve, pieces, k, c, window):
    """The mean of a curve."""
    x, w = np.polynomial.legendre.leggauss(12)
    total = 0.0
    for begin, end, sol in pieces:
        low, high = max(begin, window[0]), min(end, window[1])
        if low < high:
            ends = np.linspace(low, high, 101)
            t = (ends[:-1, None] + ends[1:, None]) / 2 + np.diff(ends)[:, None] / 2 * x
            values = curve(t.ravel(), sol(t.ravel()), k, c).reshape(t.shape)
            total += float((values @ w * np.diff(ends) / 2).sum())
    return total / (window[1] - window[0])


KINDS = "maximum", "minimum", "final", "mean", "first_time", "value_at"


@dataclass(frozen=True)
class Drawn:
    """A figure of a motion: what symmb is given, and its value (k, c) -> number by SciPy."""

    figure: Any
    value: Callable[..., float]


def figure(motion, kind, random):
    """A random figure of a kind. Conditions hold in the nominal run."""
    pieces = motion.segments(1.0, 1.0)
    window = (0.0, SPAN)
    if random.random() < 0.5:
        window = tuple(float(v) for v in np.round(np.sort(random.uniform(0, SPAN, 2)) + [0, 0.3], 2))
        window = (window[0], min(window[1], SPAN))
    (sx, curve), (other, g) = (motion.curves[i] for i in random.permutation(len(motion.curves))[:2])
    own = None if window == (0.0, SPAN) else window
    if kind in ("maximum", "minimum", "final", "mean"):
        values = {
            "maximum": lambda pieces, k, c: highest(curve, pieces, k, c, window),
            "minimum": lambda pieces, k, c: -highest(lambda *a: -curve(*a), pieces, k, c, window),
            "final": lambda pieces, k, c: at(curve, pieces, k, c, window[1]),
            "mean": lambda pieces, k, c: mean(curve, pieces, k, c, window),
        }
        return Drawn(getattr(mb, kind)(sx, window=own), values[kind])
    low, high = (s * highest(lambda *a, s=s: s * g(*a), pieces, 1.0, 1.0, window) for s in (-1.0, 1.0))
    level, sign = low + (high - low) * random.uniform(0.2, 0.8), random.choice([-1.0, 1.0])
    condition = other <= level if sign > 0 else other >= level

    def time(pieces, k, c):
        return passage(lambda t, y, k, c: sign * (g(t, y, k, c) - level), pieces, k, c, window)

    if kind == "first_time":
        return Drawn(mb.first_time(condition, window=own), time)
    return Drawn(mb.value_at(sx, condition, window=own), lambda parts, k, c: at(curve, parts, k, c, time(parts, k, c)))


def motion(name, random):
    """A random motion of a kind: "oscillator", "throw", "bounce", "floor"."""
    a, w, d = random.uniform(0.5, 1.5), random.uniform(3, 8), random.uniform(0.1, 0.6)
    p = mb.Parameters(k=1.0, c=1.0)
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    x, y, vx, vy = ball.x, ball.y, ball.vx, ball.vy
    curves = [(symbol, lambda t, y, k, c, i=i: y[i]) for symbol, i in ((x, 0), (y, 1), (vy, 3))]
    curves.append((x * x + y * y, lambda t, y, k, c: y[0] ** 2 + y[1] ** 2))

    def push(y):
        """That of a floor."""
        return ca.if_else(y < 0, -400.0 * y, 0) if isinstance(y, ca.SX) else np.where(y < 0, -400.0 * y, 0.0)

    def law(t, x, y, vx, vy, k, c):
        """The acceleration, in symbols and in numbers."""
        if name == "oscillator":
            return -10 * k * x - 4 * x**3 - d * vx + 3 * np.sin(w * t), -12 * c * y + 2 * x * y
        if name == "throw":
            speed = np.sqrt(vx**2 + vy**2 + 1e-6)
            return -d * k * speed * vx, -9.81 * c - d * k * speed * vy
        return -d * vx, -9.81 * c + (-0.3 * d * vy if name == "bounce" else k * push(y) - d * vy)

    start = np.array({"oscillator": [a, 0.2, 0.0, 1.0], "throw": [0.0, a, 3.0, 4.0]}.get(name, [0.0, a, 1.0, 0.0]))
    extra, bounce, gap = [], None, (lambda s: s[1]) if name in ("bounce", "floor") else None
    if name == "bounce":
        extra, bounce = [mb.Impact("floor", y, 0.9 * p.k)], lambda s, k, c: np.array([s[0], 0.0, s[2], -0.9 * k * s[3]])
    if name == "floor":
        curves.append((p.k * push(y), lambda t, y, k, c: k * push(y[1])))
    force = mb.Force("force", ball.point(0, 0), law(mb.t, x, y, vx, vy, p.k, p.c))
    system = mb.System(ball, force, *extra, parameters=p)
    keys = ("ball.x", "ball.y", "ball.vx", "ball.vy")

    def scene(figures):
        box = mb.Box(k=(0.95, 1.05), c=(0.95, 1.05))
        return mb.Scene(system, dict(zip(keys, start.tolist(), strict=True)), [0.0, SPAN], figures, box)

    return Motion(name, scene, lambda t, s, k, c: [s[2], s[3], *law(t, *s, k, c)], start, tuple(curves), gap, bounce)


MOTIONS = "oscillator", "throw", "bounce", "floor"
