"""Functions of some parameters whose ranges are known: the cases that `known_ranges.py` runs.

A function takes points X (N, d) of the box -1 ... 1 and gives (N, n_t) values at n_t times; a scalar has one time.
Ranges are closed forms, or the best of corners, Sobol points and local searches from the best of these.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from symmb._types import Array

Function = Callable[[Array], Array]
"""X (N, d) -> (N, n_t)."""
POINTS, STARTS, STARTS_OF_TIMES = 1 << 14, 12, 3
"""Points at which a range without a closed form is searched; local searches for each end of it, and where there are
many times."""
UQ_SHARE = 0.5
"""Least share of the usual box of a test function that a case takes."""


@dataclass(frozen=True, eq=False)
class Case:
    """A function, its kind, and its range: lower and upper (n_t,)."""

    name: str
    kind: str
    d: int
    f: Function
    lower: Array
    upper: Array

    @property
    def n_t(self) -> int:
        """Number of times."""
        return len(self.lower)


def cases(seed: int, kinds: "Kinds | None" = None) -> Iterator[Case]:
    """The cases of a seed: 74 of KINDS, 340 of KINKS."""
    rng = np.random.default_rng(seed)
    for kind, number, make in kinds or KINDS:
        for k in range(number):
            name, d, f, extremes = make(rng, k)
            lower, upper = searched(f, d, rng) if extremes is None else extremes
            yield Case(f"{kind} {seed}.{k}: {name}", kind, d, f, np.atleast_1d(lower), np.atleast_1d(upper))


def searched(f: Function, d: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """The range of a function that is continuous, or whose values at many points fill its range."""
    corners = rng.choice([-1.0, 1.0], (4096, d)) if d > 12 else np.indices((2,) * d).reshape(d, -1).T * 2.0 - 1.0
    sobol = 2 * qmc.Sobol(d, seed=rng).random(POINTS) - 1
    mixed = np.where(rng.uniform(size=(POINTS // 4, d)) < 0.7, np.sign(sobol[: POINTS // 4]), sobol[: POINTS // 4])
    X = np.concatenate([corners, sobol, mixed])
    Y = f(X)
    ends = []
    for sign in (1.0, -1.0):
        values = np.where(np.isfinite(Y), sign * Y, np.inf)
        ends.append(np.array([_descended(f, X, values[:, t], sign, t) for t in range(Y.shape[1])]) * sign)
    return ends[0], ends[1]


def _descended(f: Function, X: Array, values: Array, sign: float, t: int) -> float:
    """The least of values (N,) at points X, after searches from the best points."""
    d, starts = X.shape[1], STARTS if f(X[:1]).size == 1 else STARTS_OF_TIMES
    best = np.argsort(values)[: starts if len(np.unique(values)) > 2 else 0]
    if not best.size:
        return float(values.min())
    step = 1e-6 * np.vstack([np.zeros(d), np.eye(d), -np.eye(d)])

    def with_slope(x: Array) -> tuple[float, Array]:
        y = sign * f(x + step)[:, t]
        return float(np.nan_to_num(y[0], nan=1e9)), np.nan_to_num((y[1 : d + 1] - y[d + 1 :]) / 2e-6)

    runs = (
        minimize(with_slope, 0.999999 * X[i], jac=True, bounds=[(-1, 1)] * d, options={"maxiter": 40}) for i in best
    )
    return min(float(values[best[0]]), *(float(run.fun) for run in runs))


Made = tuple[str, int, Function, tuple[Array, Array] | tuple[float, float] | None]
"""Name, number of parameters, function, and its range if that has a closed form."""


def _scalar(f: Callable[[Array], Array]) -> Function:
    return lambda X: f(X)[:, None]


def bump(rng: np.random.Generator, k: int) -> Made:
    """A Gaussian bump somewhere in the box, every other one on a slope."""
    d, sigma = 1 + k % 3, rng.uniform(0.3, 0.5)
    at, slope = rng.uniform(-1, 1, d), 0.3 * (k % 2) * rng.uniform(-1, 1, d)

    def f(X: Array) -> Array:
        return np.exp(-np.square(X - at).sum(axis=1) / (2 * sigma**2)) + X @ slope

    return f"sigma {sigma:.2f}, {d} parameters", d, _scalar(f), None


def step(rng: np.random.Generator, k: int) -> Made:
    """A plane at which the value jumps, or a corner behind which it does."""
    d = int(rng.integers(2, 11))
    if k % 2:
        share = rng.uniform(0.02, 0.1)
        corner, depth = rng.choice([-1.0, 1.0], d), 2 * share ** (1 / d)
        return f"corner, {d}", d, _scalar(lambda X: np.where((X * corner > 1 - depth).all(axis=1), 1.0, 0.0)), (0, 1)
    a, b = rng.normal(size=d), rng.uniform(-0.5, 0.5)
    return f"plane, {d}", d, _scalar(lambda X: np.where(X @ a > b * np.abs(a).sum() / d**0.5, 1.0, 0.0)), (0.0, 1.0)


def oscillation(rng: np.random.Generator, k: int) -> Made:
    """Up to 80 rad over the box."""
    d, radians, phase = 1 + k % 2, rng.uniform(20, 80), rng.uniform(0, 6)
    weight = 0.3 * (d - 1)

    def f(X: Array) -> Array:
        return np.sin(radians / 2 * X[:, 0] + phase) * (1 + weight * X[:, -1] * (d - 1))

    return f"{radians:.0f} rad, {d}", d, _scalar(f), (-1 - weight, 1 + weight) if d == 1 else None


def kink(rng: np.random.Generator, k: int) -> Made:
    """|a x - b|, or the larger of two planes."""
    d = int(rng.integers(1, 7))
    a, c, b = rng.normal(size=d), rng.normal(size=d), rng.uniform(-0.6, 0.6)
    reach = np.abs(a).sum()
    if k % 2:
        least = max(0.0, abs(b) - reach)
        return f"|plane|, {d}", d, _scalar(lambda X: np.abs(X @ a - b)), (least, reach + abs(b))
    return f"two planes, {d}", d, _scalar(lambda X: np.maximum(X @ a, X @ c - b)), None


def resonance(rng: np.random.Generator, k: int) -> Made:
    """Amplitude of a driven oscillator over its frequency, and over its damping."""
    d, damping, width, middle = 1 + k % 2, 10 ** rng.uniform(-2, -1), rng.uniform(0.1, 0.5), rng.uniform(0.8, 1.2)

    def f(X: Array) -> Array:
        r, zeta = middle + width * X[:, 0], damping * (1 + 0.3 * X[:, -1] * (d - 1))
        return 1 / np.sqrt(np.square(1 - r * r) + np.square(2 * zeta * r))

    return f"damping {damping:.3f}, {d}", d, _scalar(f), None


def genz(rng: np.random.Generator, k: int) -> Made:
    """The families of Genz (1984) in up to ten parameters."""
    d = int(rng.integers(2, 11))
    a, w = rng.uniform(0.2, 1, d), rng.uniform(0, 1, d)
    a *= (4.5, 3.6, 1.5, 3.5, 4.0, 2.0)[k % 6] / a.sum() * (1 if k % 6 in (0, 2, 5) else d**0.5)

    def u(X: Array) -> Array:
        return (X + 1) / 2

    families: tuple[tuple[str, Callable[[Array], Array]], ...] = (
        ("oscillatory", lambda X: np.cos(2 * np.pi * w[0] + u(X) @ a)),
        ("product peak", lambda X: 1 / (1 + np.square(a * (u(X) - w))).prod(axis=1)),
        ("corner peak", lambda X: (1 + u(X) @ a) ** -(d + 1.0)),
        ("Gaussian", lambda X: np.exp(-np.square(a * (u(X) - w)).sum(axis=1))),
        ("continuous", lambda X: np.exp(-np.abs(u(X) - w) @ a)),
        ("discontinuous", lambda X: np.where((u(X)[:, :2] > w[:2]).any(axis=1), 0.0, np.exp(u(X) @ a))),
    )
    name, f = families[k % 6]
    return f"{name}, {d}", d, _scalar(f), (0.0, float(np.exp(w[:2] @ a[:2] + a[2:].sum()))) if k % 6 == 5 else None


def pulse(rng: np.random.Generator, k: int) -> Made:
    """A smooth motion with a bump at 2 to 4 % of the times in a part of the box."""
    d, n_t = 1 + k % 2, 101
    t, at, sigma = np.linspace(0, 10, n_t), rng.uniform(-1, 1, d), rng.uniform(0.3, 0.5)
    when, length, height = rng.uniform(2, 8), rng.uniform(0.1, 0.2), rng.uniform(1, 3)

    def f(X: Array) -> Array:
        there = np.exp(-np.square(X - at).sum(axis=1) / (2 * sigma**2))
        return np.sin(t + 0.3 * X[:, :1]) + height * there[:, None] * np.exp(-np.square((t - when) / length))

    return f"at {when:.1f} s, {d}", d, f, None


def trajectory(rng: np.random.Generator, k: int) -> Made:
    """A damped oscillation of uncertain frequency, amplitude and damping."""
    d, n_t = 1 + k % 3, 51
    t, omega, zeta = np.linspace(0, 10, n_t), rng.uniform(1, 3), rng.uniform(0.02, 0.1)
    spread = rng.uniform(0.02, 0.15, 3)

    def f(X: Array) -> Array:
        X = np.hstack([X, np.zeros((len(X), 3 - d))]) * spread
        rate = omega * (1 + X[:, :1])
        return (1 + X[:, 1:2]) * np.exp(-zeta * (1 + X[:, 2:]) * t * rate) * np.cos(rate * t)

    return f"{omega:.1f} rad/s, {d}", d, f, None


def noise(rng: np.random.Generator, k: int) -> Made:
    """A smooth function with errors of 1e-8 ... 1e-2 of its width that look random."""
    d, level = 1 + k % 4, 10.0 ** rng.uniform(-8, -2)
    a, frequencies = rng.uniform(0.3, 1, d), rng.uniform(1e3, 1e4, d)

    def smooth(X: Array) -> Array:
        return np.exp(0.8 * X @ a / a.sum()) * np.cos(0.7 * X[:, 0])

    def f(X: Array) -> Array:
        return smooth(X) + level * (2 * np.modf(np.abs(1e4 * np.sin(X @ frequencies)))[0] - 1)

    return f"{level:.0e}, {d}", d, _scalar(f), tuple(searched(_scalar(smooth), d, rng))


def gap(rng: np.random.Generator, k: int) -> Made:
    """A smooth function that is not defined in a ball or behind a plane."""
    d = 2 + k % 2
    at, radius, a = rng.uniform(-1, 1, d), rng.uniform(0.2, 0.5), rng.normal(size=d)

    def f(X: Array) -> Array:
        y = np.exp(0.5 * X @ a / np.abs(a).sum()) + 0.3 * X[:, 0] ** 2
        lost = np.square(X - at).sum(axis=1) < radius**2 if k % 2 else X @ a > 0.7 * np.abs(a).sum()
        return np.where(lost, np.nan, y)

    return f"{'ball' if k % 2 else 'corner'}, {d}", d, _scalar(f), None


def ridge(rng: np.random.Generator, k: int) -> Made:
    """cos(1 + 3.5 a x) in 6 to 20 parameters, every other one with a second direction of 5 %."""
    d = (6, 10, 20)[k % 3]
    a, b = 0.7 ** rng.permutation(d), rng.normal(size=d)
    b /= np.linalg.norm(b)

    def f(X: Array) -> Array:
        return np.cos(1 + 3.5 * X @ a) + 0.05 * (k % 2) * np.sin(2 * X @ b)

    return f"{d}{', two directions' if k % 2 else ''}", d, _scalar(f), None if k % 2 else (-1.0, 1.0)


def uq(rng: np.random.Generator, k: int) -> Made:
    """Test functions of uncertainty quantification, on parts of their usual boxes."""
    name, low, high, f = UQ[k % len(UQ)]
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    share = rng.uniform(UQ_SHARE, 1, len(low))
    middle = (low + high) / 2 + rng.uniform(-1, 1, len(low)) * (1 - share) * (high - low) / 2
    return name, len(low), _scalar(lambda X: f((middle + share * (high - low) / 2 * X).T)), None


def _borehole(x: Array) -> Array:
    rw, r, Tu, Hu, Tl, Hl, L, Kw = x
    log = np.log(r / rw)
    return 2 * np.pi * Tu * (Hu - Hl) / (log * (1 + 2 * L * Tu / (log * rw**2 * Kw) + Tu / Tl))


def _circuit(x: Array) -> Array:
    Rb1, Rb2, Rf, Rc1, Rc2, beta = x
    Vb1, load = 12 * Rb2 / (Rb1 + Rb2), beta * (Rc2 + 9)
    return (Vb1 + 0.74) * load / (load + Rf) + 11.35 * Rf / (load + Rf) + 0.74 * Rf * load / ((load + Rf) * Rc1)


def _piston(x: Array) -> Array:
    M, S, V0, k, P0, Ta, T0 = x
    A = P0 * S + 19.62 * M - k * V0 / S
    V = S / (2 * k) * (np.sqrt(A**2 + 4 * k * P0 * V0 * Ta / T0) - A)
    return 2 * np.pi * np.sqrt(M / (k + S**2 * P0 * V0 * Ta / (T0 * V**2)))


def _wing(x: Array) -> Array:
    Sw, Wfw, A, sweep, q, taper, tc, Nz, Wdg, Wp = x
    c = np.cos(np.deg2rad(sweep))
    return (
        0.036 * Sw**0.758 * Wfw**0.0035 * (A / c**2) ** 0.6 * q**0.006 * taper**0.04 * (100 * tc / c) ** -0.3
        * (Nz * Wdg) ** 0.49 + Sw * Wp
    )  # fmt: skip


def _robot(x: Array) -> Array:
    angles, lengths = np.cumsum(x[:4], axis=0), x[4:]
    return np.hypot((lengths * np.cos(angles)).sum(axis=0), (lengths * np.sin(angles)).sum(axis=0))


def _ishigami(x: Array) -> Array:
    return np.sin(x[0]) + 7 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])


def _friedman(x: Array) -> Array:
    return 10 * np.sin(np.pi * x[0] * x[1]) + 20 * (x[2] - 0.5) ** 2 + 10 * x[3] + 5 * x[4]


def _sobol_g(x: Array) -> Array:
    a = np.arange(len(x))[:, None]
    return ((np.abs(4 * x - 2) + a) / (1 + a)).prod(axis=0)


def _morris(x: Array) -> Array:
    w = 2 * (x - 0.5)
    w[[2, 4, 6]] = 2 * (1.1 * x[[2, 4, 6]] / (x[[2, 4, 6]] + 0.1) - 0.5)
    first = 20 * w[:10].sum(axis=0) + ((-1.0) ** np.arange(10, 20)) @ w[10:]
    pairs = -15 * (np.square(w[:6].sum(axis=0)) - np.square(w[:6]).sum(axis=0)) / 2
    return first + pairs


UQ: tuple[tuple[str, tuple[float, ...], tuple[float, ...], Callable[[Array], Array]], ...] = (
    ("borehole, 8", (0.05, 100, 63070, 990, 63.1, 700, 1120, 9855), (0.15, 5e4, 115600, 1110, 116, 820, 1680, 12045),
     _borehole),
    ("circuit, 6", (50, 25, 0.5, 1.2, 0.25, 50), (150, 70, 3, 2.5, 1.2, 300), _circuit),
    ("piston, 7", (30, 0.005, 0.002, 1000, 9e4, 290, 340), (60, 0.02, 0.01, 5000, 1.1e5, 296, 360), _piston),
    ("wing, 10", (150, 220, 6, -10, 16, 0.5, 0.08, 2.5, 1700, 0.025), (200, 300, 10, 10, 45, 1, 0.18, 6, 2500, 0.08),
     _wing),
    ("robot arm, 8", (0,) * 8, (np.pi / 2,) * 4 + (1,) * 4, _robot),
    ("Ishigami, 3", (-np.pi,) * 3, (np.pi,) * 3, _ishigami),
    ("Friedman, 5", (0,) * 5, (1,) * 5, _friedman),
    ("Sobol g, 12", (0,) * 12, (1,) * 12, _sobol_g),
    ("Morris, 20", (0,) * 20, (1,) * 20, _morris),
)  # fmt: skip
"""Name, ends of the usual box, and function of (d, N). Surjanovic and Bingham, Virtual Library of Simulation
Experiments (2013); Morris (1991); Sobol (1998)."""


def sums(rng: np.random.Generator, k: int) -> Made:
    """Sums of functions of one parameter each: |x - c|, or sin(a x + b) over up to a period, in 4 to 10 parameters."""
    d = int(rng.integers(4, 11))
    c, w = rng.uniform(-0.7, 0.7, d), rng.uniform(0.3, 1, d)
    if k % 2 == 0:
        reach = float(w @ (1 + np.abs(c)))
        return f"kinks, {d}", d, _scalar(lambda X: np.abs(X - c) @ w), (0.0, reach)
    a = rng.uniform(1, np.pi, d)
    x = np.linspace(-1, 1, 20001)[:, None]
    parts = w * np.sin(a * x + 2 * c)
    ends = float(parts.min(axis=0).sum()), float(parts.max(axis=0).sum())
    return f"sines, {d}", d, _scalar(lambda X: np.sin(a * X + 2 * c) @ w), ends


def _of_one(f: Callable[[Array], Array], kinks: Array) -> tuple[int, Function, tuple[float, float]]:
    """A function of one parameter, smooth between its kinks, with its range."""
    Y = f(np.concatenate([np.linspace(-1, 1, 20001), kinks[np.abs(kinks) <= 1]]))
    return 1, f, (float(Y.min()), float(Y.max()))


def v(rng: np.random.Generator, _: int) -> Made:
    """k |x - c| + s x."""
    c, k, s = rng.uniform(-0.8, 0.8), rng.normal(), 0.5 * rng.normal()
    return f"{k:.2f} |x - {c:.2f}| + {s:.2f} x", *_of_one(lambda x: k * np.abs(x - c) + s * x, np.array([c]))


def hockey_stick(rng: np.random.Generator, _: int) -> Made:
    """k max(x - c, 0) + s x, or turned round."""
    c, k, s, side = rng.uniform(-0.8, 0.8), rng.normal(), 0.3 * rng.normal(), rng.choice([-1, 1])
    return f"behind {c:.2f}", *_of_one(lambda x: k * np.maximum(side * (x - c), 0) + s * x, np.array([c]))


def clip(rng: np.random.Generator, _: int) -> Made:
    """A line between two limits, on a slope."""
    low, high = np.sort(rng.uniform(-0.9, 0.9, 2))
    k, s = rng.normal(), 0.3 * rng.normal()
    return f"{low:.2f} ... {high:.2f}", *_of_one(lambda x: k * np.clip(x, low, high) + s * x, np.array([low, high]))


def v_and_sine(rng: np.random.Generator, _: int) -> Made:
    """A V on a sine."""
    c, k, a, w, b = rng.uniform(-0.8, 0.8), rng.normal(), 0.4 * rng.normal(), rng.uniform(1, 6), rng.uniform(0, 6)
    return f"at {c:.2f}, {w:.1f} rad", *_of_one(lambda x: k * np.abs(x - c) + a * np.sin(w * x + b), np.array([c]))


def cusp(rng: np.random.Generator, _: int) -> Made:
    """|x - c|^p + s x, p = 0.5 ... 0.7, upwards or downwards."""
    c, s, p, sign = rng.uniform(-0.8, 0.8), 0.5 * rng.normal(), rng.uniform(0.5, 0.7), rng.choice([-1, 1])
    return f"at {c:.2f}, power {p:.2f}", *_of_one(lambda x: sign * np.abs(x - c) ** p + s * x, np.array([c]))


Kinds = tuple[tuple[str, int, Callable[[np.random.Generator, int], Made]], ...]
"""Kinds of functions, how many of a seed, and what makes them."""
KINDS: Kinds = (
    ("bump", 9, bump),
    ("step", 6, step),
    ("oscillation", 4, oscillation),
    ("kink", 6, kink),
    ("resonance", 4, resonance),
    ("Genz", 6, genz),
    ("pulse", 4, pulse),
    ("trajectory", 6, trajectory),
    ("noise", 4, noise),
    ("gap", 4, gap),
    ("ridge", 6, ridge),
    ("UQ", 9, uq),
    ("sum", 6, sums),
)
KINKS: Kinds = tuple(
    (name, 68, make)
    for name, make in (
        ("V", v),
        ("hockey stick", hockey_stick),
        ("clip", clip),
        ("V + sine", v_and_sine),
        ("cusp", cusp),
    )
)
"""Functions of one parameter with one kink, or two."""
