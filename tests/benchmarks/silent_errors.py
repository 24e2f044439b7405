"""Errors that nothing tells: smooth bumps inside the box, and creases through its centre.

    PYTHONPATH=. python tests/benchmarks/silent_errors.py [SEED] [CASES] [KIND ...]

For each kind and number of parameters: cases, silent errors (bounds, widened by the estimated error, miss more than 2 %
of the width without a warning), warnings about bounds that are right, the largest silent error, and the median of runs.
True ranges are those of fine grids, improved from their best points.
"""

import itertools
import sys
import warnings
from collections.abc import Callable, Iterator

import numpy as np
from scipy.optimize import minimize

import symmb as mb

MISS = 0.02
Case = tuple[int, Callable[[np.ndarray], np.ndarray]]


def bumps(rng: np.random.Generator) -> Iterator[Case]:
    """A Gaussian bump anywhere in the box on a slope, or on none. Its width grows with the number of parameters."""
    for k in itertools.count():
        d = 2 + k % 4
        at, width = rng.uniform(-1.0, 1.0, d), rng.uniform(0.3, 0.5) * (d / 3) ** 0.5
        slope = (k // 4 % 2) * rng.uniform(-0.3, 0.3, d)
        yield d, lambda X, at=at, w=width, s=slope: np.exp(-np.square(X - at).sum(-1) / (2 * w**2)) + X @ s


def creases(rng: np.random.Generator) -> Iterator[Case]:
    """Minima and maxima of symmetric functions: their creases pass the centre in every second case."""
    for k in itertools.count():
        d = 2 + k % 3
        centre = np.zeros(d) if k // 3 % 2 else rng.uniform(-0.3, 0.3, d)
        a, b = np.linalg.qr(rng.normal(size=(d, d)))[0][:2]
        if k // 6 % 2:
            a, b = np.eye(d)[0] + np.eye(d)[1], np.eye(d)[0] - np.eye(d)[1]
        slopes, bend, top = rng.uniform(0.6, 1.4, 2), rng.uniform(0.0, 0.3), rng.uniform(0.5, 2.0)
        kind = k // 12 % 3

        def f(X, c=centre, a=a, b=b, s=slopes, bend=bend, top=top, kind=kind):
            u, v = (X - c) @ a, (X - c) @ b
            one, other = top + bend * v**2 - s[0] * np.abs(u), top - s[1] * np.abs(v)
            return np.abs(u) + bend * v if kind == 0 else np.minimum(one, other) if kind == 1 else np.maximum(-one, u)

        yield d, f


KINDS = {"bumps": bumps, "creases": creases}


def true_range(f: Callable[[np.ndarray], np.ndarray], d: int) -> tuple[float, float]:
    """The range over the unit box, from a grid and from local searches at its best points."""
    line = np.linspace(-1.0, 1.0, {2: 301, 3: 61, 4: 25, 5: 15}[d])
    X = np.stack(np.meshgrid(*d * [line]), -1).reshape(-1, d)
    y, ends = f(X), []
    for sign in (1, -1):
        best = X[np.argsort(sign * y)[:5]]

        def value(x, sign=sign):
            return sign * float(f(x))

        ends.append(sign * min(minimize(value, x, method="Nelder-Mead", bounds=d * [(-1, 1)]).fun for x in best))
    return ends[0], ends[1]


def main(seed: int, number: int, kinds: list[str]) -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    print("kind      d  cases  silent  needless  largest  runs")
    for kind in kinds or KINDS:
        found = dict[int, list[tuple[float, bool, float, int]]]()
        for d, f in itertools.islice(KINDS[kind](np.random.default_rng([seed, len(kind)])), number):
            names = [f"x{i}" for i in range(d)]

            def run(f=f, **p):
                return [float(f(np.array([*p.values()])))]

            simulator = mb.FunctionSimulator(run, dict.fromkeys(names, 0.0), [0.0], ["y"])
            bounds = mb.propagate(
                simulator, mb.PolynomialChaos(seconds=60.0), mb.Box(**dict.fromkeys(names, (-1.0, 1.0)))
            )
            low, high = true_range(f, d)
            outer = bounds.outer[0][0, 0], bounds.outer[1][0, 0]
            missed = max(outer[0] - low, high - outer[1], 0.0) / (high - low)
            error = max(abs(bounds.lower[0, 0] - low), abs(bounds.upper[0, 0] - high)) / (high - low)
            found.setdefault(d, []).append((missed, bool(bounds.doubts), error, bounds.evaluations))
        for d, own in sorted(found.items()):
            silent = [missed for missed, doubted, _, _ in own if missed > MISS and not doubted]
            needless, runs = sum(doubted and e <= MISS for _, doubted, e, _ in own), np.median([n for *_, n in own])
            figures = f"{len(silent):6d}  {needless:8d}  {max(silent, default=0):7.2f}  {runs:4.0f}"
            print(f"{kind:8s}  {d}  {len(own):5d}  {figures}", flush=True)


if __name__ == "__main__":
    numbers = [int(each) for each in sys.argv[1:3]]
    main(*numbers, *(0, 60)[len(numbers) :], sys.argv[3:])
