"""How often methods without an error estimate are wrong in silence, and how often they are doubted in vain.

Draws closed-form responses: oscillators over long horizons, sums of waves, products, powers and bumps of 1 to 13
parameters, bounces whose times depend on the parameters, in units from 1e-20 to 1e20. All ranges are known: one
parameter by 20,001 points, sums by the sums of their ranges, monotone ones by their corners.

Prints a line a method: cases, silent misses (bounds off by more than 5 % of the width in the norm of `Score.error`
without a doubt), needless doubts (a doubt where they are off by less than 1 %), and the largest silent miss.

    PYTHONPATH=. python tests/benchmarks/method_checks.py [SEED] [CASES]
"""

import sys
import warnings
from collections.abc import Iterator

import numpy as np

import symmb as mb
from symmb.study.metrics import Yardstick

METHODS = [
    mb.PolynomialChaos.paper(2),
    mb.PolynomialChaos(order=4),
    mb.PolynomialChaos(order=8),
    mb.Vertex(),
    mb.Scanning(3),
    mb.Scanning(21),
    mb.MonteCarlo(100),
    mb.MonteCarlo(1000),
]
MOST_RUNS = 1000
GRID = np.linspace(-1.0, 1.0, 20_001)[:, None]


def case(rng: np.random.Generator) -> tuple[str, mb.FunctionSimulator, mb.Box, np.ndarray, np.ndarray]:
    """Kind, simulator, box and true bounds (n_t, 1) of a random response."""
    kind = rng.choice(["oscillator", "waves", "monotone", "bounce", "product"])
    d = 1 if kind in ("oscillator", "bounce") else int(rng.integers(1, 14))
    t = np.linspace(0.0, 5.0, 101)
    unit = 10.0 ** rng.uniform(-20, 20)
    a, shift = rng.uniform(0.1, 1.0, d), rng.uniform(-np.pi, np.pi, d)
    if kind == "oscillator":  # cos(omega t), its frequency +- some percent
        turns = 10.0 ** rng.uniform(-1, 2.5) * rng.uniform(0.01, 0.1)
        parts = [lambda x: np.cos(2 * np.pi * (3 + turns * x) * t / 5 * (1 + 0 * x) + shift[0])]
    elif kind == "bounce":  # |sin| of a phase that the parameter moves: a ball's height
        rate = 10.0 ** rng.uniform(-1, 1)
        parts = [lambda x: np.abs(np.sin(2.3 * t + rate * x * t / 5 + shift[0]))]
    elif kind == "waves":
        w = 10.0 ** rng.uniform(-1, 0.7, d)
        parts = [lambda x, i=i: a[i] * np.cos(w[i] * x + t + shift[i]) for i in range(d)]
    else:
        slope = a[:, None] * np.cos(t * rng.uniform(0.2, 2.0, d)[:, None] + shift[:, None]) / np.sqrt(d)
        parts = [lambda x, i=i: slope[i] * x for i in range(d)]
    outer = np.exp if kind == "product" else np.arctan if kind == "monotone" else lambda s: s
    lower = outer(sum(part(GRID).min(axis=0) for part in parts))
    upper = outer(sum(part(GRID).max(axis=0) for part in parts))
    names = [f"x{i}" for i in range(d)]
    simulator = mb.FunctionSimulator(
        lambda **p: unit * outer(sum(part(p[n]) for part, n in zip(parts, names, strict=True)))[:, None],
        dict.fromkeys(names, 0.0),
        t,
        ["y"],
    )
    box = mb.Box(**dict.fromkeys(names, (-1.0, 1.0)))
    return f"{kind} {d}", simulator, box, unit * lower[:, None], unit * upper[:, None]


def outcomes(seed: int, cases: int) -> Iterator[tuple[mb.Method, str, float, bool]]:
    """Method, case, error over the width, and whether it was doubted."""
    rng = np.random.default_rng(seed)
    for _ in range(cases):
        kind, simulator, box, lower, upper = case(rng)
        yardstick = Yardstick(lower, upper, np.zeros(1))
        for method in METHODS:
            if (method.planned_runs(len(box)) or 0) <= MOST_RUNS:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", mb.SymmbWarning)
                    bounds = mb.propagate(simulator, method, box)
                yield method, kind, float(yardstick.deviation(bounds.lower, bounds.upper)[0]), bool(bounds.doubts)


def main(seed: int = 1, cases: int = 40) -> None:
    found = list(outcomes(seed, cases))
    print(f"{'method':32s} cases  silent  needless  largest silent miss")
    for method in METHODS:
        own = [(kind, error, doubted) for m, kind, error, doubted in found if m == method]
        silent = [(error, kind) for kind, error, doubted in own if error > 0.05 and not doubted]
        needless = sum(error < 0.01 and doubted for _, error, doubted in own)
        worst = "{:.2f} {}".format(*max(silent)) if silent else "-"
        print(f"{method!r:32s} {len(own):5d}  {len(silent):6d}  {needless:8d}  {worst}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
