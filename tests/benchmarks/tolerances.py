"""Tolerances against answers found without symmb, and limits in 10,000 runs over each box.

    PYTHONPATH=. python tests/benchmarks/tolerances.py [FIRST_SEED] [NUMBER]

Each problem is a function in closed form, with limits of random size. The factor is compared with bisection on dense
samples, the cost of an allocation with that of SciPy's `minimize` on such samples.
"""

import sys
import warnings

import numpy as np
from scipy.optimize import bisect, minimize

import symmb as mb

TURN = np.linspace(0, 2 * np.pi, 25)


def slider(P):
    crank, rod, offset = P.T[:, :, None]
    return crank * np.cos(TURN) + np.sqrt(rod**2 - (crank * np.sin(TURN) - offset) ** 2)


def four_bar(P):
    """Angle of the rocker of a four-bar whose crank turns."""
    crank, coupler, rocker, base = P.T[:, :, None]
    x, y = crank * np.cos(TURN) - base, crank * np.sin(TURN)
    r = np.hypot(x, y)
    return np.arctan2(y, -x) * -1 + np.arccos((r**2 + rocker**2 - coupler**2) / (2 * r * rocker))


def beam(P):
    force, length, stiffness = P.T
    return (force * length**3 / (3 * stiffness))[:, None]


def hill(P):
    """Largest inside of the box."""
    a, b = P.T
    return (1 - (a - 0.02) ** 2 - 0.5 * b**2 + 0.2 * a)[:, None]


def oscillation(P):
    mass, stiffness = P.T[:, :, None]
    return np.sin(np.sqrt(stiffness / mass) * np.linspace(0, 0.5, 31))


PROBLEMS = {
    "slider-crank": (slider, {"crank": 0.05, "rod": 0.15, "offset": 0.01}, 0.004),
    "four-bar": (four_bar, {"crank": 1.0, "coupler": 3.0, "rocker": 2.5, "base": 3.0}, 0.004),
    "beam": (beam, {"force": 100.0, "length": 2.0, "stiffness": 5000.0}, 0.03),
    "hill": (hill, {"a": 0.3, "b": 0.4}, 0.2),
    "oscillation": (oscillation, {"mass": 1.0, "stiffness": 9.0}, 0.03),
}


def chain(rng):
    d = int(rng.integers(2, 7))
    c = rng.choice([-1.0, 1.0], d) * rng.uniform(0.3, 2.0, d)
    return (lambda P: (P @ c)[:, None]), dict(zip([f"l{i}" for i in range(d)], rng.uniform(1, 3, d), strict=True)), 0.02


def points(d, rng):
    """Samples of the unit box: all corners, and points on edges, faces and inside."""
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * d)).reshape(d, -1).T
    inside = rng.uniform(-1, 1, (3000, d))
    sides = rng.choice([-1, 0, 1], inside.shape)
    line = np.linspace(-1, 1, 81)
    dense = np.array(np.meshgrid(line, line)).reshape(2, -1).T if d == 2 else np.zeros((0, d))
    return np.concatenate([corners, np.where(sides == 0, inside, sides), dense])


def solve(name, f, nominal, spread, rng):
    names, p = [*nominal], np.array([*nominal.values()])
    d = len(p)
    low, high = p * (1 - spread * rng.uniform(0.5, 1, d)), p * (1 + spread * rng.uniform(0.5, 1, d))
    unit = points(d, rng)

    def at(s):
        return p + np.where(unit < 0, unit * (p - low), unit * (high - p)) * s

    y = f(p[None])[0]
    t = np.arange(float(len(y)))
    reach = f(at(np.ones(d)))
    size = rng.uniform(0.4, 2.0)
    side = rng.integers(3)
    upper = y.max() + size * (reach.max() - y.max()) if side != 1 else None
    lower = y.min() - size * (y.min() - reach.min()) if side != 0 else None
    if (upper is not None and upper <= y.max() * (1 + 1e-9)) or (lower is not None and lower >= y.min() - 1e-12):
        return None
    ends = (-np.inf if lower is None else lower), (np.inf if upper is None else upper)

    def margin(s):
        with np.errstate(invalid="ignore"):
            Y = f(at(s))
        return min(Y.min() - ends[0], ends[1] - Y.max()) if np.isfinite(Y).all() else -1.0

    simulator = mb.FunctionSimulator(lambda **q: f(np.array([[q[n] for n in names]]))[0][:, None], nominal, t, ["y"])
    box = mb.Box(**dict(zip(names, zip(low, high, strict=True), strict=True)))
    limits = {"y": (lower, upper)}
    found = mb.tolerances(simulator, limits, box)
    if margin(np.full(d, 16.0)) >= 0:
        true = 16.0
    else:
        top = 1.0
        while margin(np.full(d, top)) > 0:
            top *= 1.5
        true = bisect(lambda s: margin(np.full(d, s)), 0.0, top, xtol=1e-6)
    cheap = mb.tolerances(simulator, limits, box, costs={})
    start = np.log(np.full(d, min(true, 15.9)))
    smallest = {"type": "ineq", "fun": lambda z: margin(np.exp(z)) / margin(np.zeros(d))}
    how = {"method": "SLSQP", "bounds": [(-5, np.log(16.0))] * d, "constraints": smallest, "options": {"ftol": 1e-10}}
    best = min(minimize(lambda z: np.exp(-z).sum(), start + shift, **how).fun for shift in (0.0, -0.05))
    beyond = []
    for each in (found, cheap):
        P = rng.uniform(each.box.lower, each.box.upper, (10_000, d))
        sides = rng.choice([-1, 0, 1], P.shape)
        Y = f(np.where(sides < 0, each.box.lower, np.where(sides > 0, each.box.upper, P)))
        beyond.append(max(ends[0] - Y.min(), Y.max() - ends[1], 0.0) - each.bounds.estimate.max())
    one = mb.propagate(simulator, mb.PolynomialChaos(), box).evaluations
    return found.factor / true - 1, cheap.cost / best - 1, max(beyond), one, found.evaluations, cheap.evaluations


if __name__ == "__main__":
    first, number = (int(x) for x in [*sys.argv[1:], 1, 2][:2])
    warnings.simplefilter("ignore")
    for seed in range(first, first + number):
        rng = np.random.default_rng(seed)
        problems = {**PROBLEMS, **{f"chain {k}": chain(rng) for k in range(5)}}
        for name, (f, nominal, spread) in problems.items():
            result = solve(name, f, nominal, spread, rng)
            if result is not None:
                factor, cost, beyond, *runs = result
                print(
                    f"{seed} {name:13s} factor {factor:+.2%}  cost {cost:+.2%}  beyond the estimate {beyond:.1e}  "
                    f"runs of a study, the factor, the allocation {runs}",
                    flush=True,
                )
