"""Figures of random motions beside SciPy: their values in single runs, and their bounds beside dense scans.

Scans run SciPy on a grid of the box and densely on its edges, where a figure that jumps has its extremes, and search on
from the best points by simplices. A bound is wrong if it is off by
more than 1 % of the width and its estimated error does not say so.

    PYTHONPATH=tests python tests/benchmarks/figures.py [cases] [first]
"""

import itertools
import sys
import time
import warnings

import numpy as np
from figure_motions import KINDS, MOTIONS, figure, motion
from scipy.optimize import minimize

import symmb as mb

GRID, EDGE, STEPS, SHARE = 7, 41, 40, 0.01


def value(own, drawn, kc):
    """A figure by SciPy; nan where its condition does not hold."""
    k, c = np.clip(kc, 0.95, 1.05)
    return drawn.value(own.segments(k, c, rtol=1e-9), k, c)


def extremes(own, drawn):
    """Least and largest value over the box."""
    inner, edge = (np.linspace(0.95, 1.05, n) for n in (GRID, EDGE))
    sides = edge[[0, -1]]
    pairs = (*itertools.product(inner, inner), *itertools.product(edge, sides), *itertools.product(sides, edge))
    points = np.array(pairs)
    runs = [own.segments(*point, rtol=1e-9) for point in points]
    found = {}
    for name, one in drawn.items():
        try:
            values = np.array([one.value(run, *point) for run, point in zip(runs, points, strict=True)])
        except StopIteration:
            values = np.full(len(points), np.nan)
        ends = []
        for sign in (1.0, -1.0):
            if np.isnan(values).any():
                ends.append(np.nan)
                continue
            best = points[int((sign * values).argmin())]
            search = minimize(
                lambda kc, sign=sign, one=one: sign * value(own, one, kc),
                best,
                method="Nelder-Mead",
                bounds=[(0.95, 1.05)] * 2,
                options={"maxfev": STEPS, "initial_simplex": best + 0.006 * np.array([[0, 0], [1, 0], [0, 1]])},
            )
            ends.append(sign * min(search.fun, (sign * values).min()))
        found[name] = ends
    return found


def main(cases=20, first=0):
    worst, wrong = 0.0, 0
    for seed in range(first, first + cases):
        random = np.random.default_rng(seed)
        own = motion(MOTIONS[seed % len(MOTIONS)], random)
        drawn = {kind: figure(own, kind, random) for kind in KINDS}
        scanned = extremes(own, drawn)
        for name, (low, high) in scanned.items():
            if np.isnan(low):
                print(f"{seed:3d} {own.name:10s} {name:10s} does not hold everywhere")
                continue
            begin = time.perf_counter()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                bounds = mb.propagate(own.scene({name: drawn[name].figure}), mb.PolynomialChaos())
            (lower, upper), width = bounds[name], high - low
            off = max(abs(lower - low), abs(upper - high)) / width if width > 1e-6 else 0.0
            told = float(bounds.estimate.max()) / width if width > 1e-6 else 0.0
            seconds = time.perf_counter() - begin
            worst, is_wrong = max(worst, off), off > max(SHARE, told) and not bounds.failed
            wrong += is_wrong
            print(
                f"{seed:3d} {own.name:10s} {name:10s} width {width:9.3g}  off {off:8.2%}  told {told:8.2%}  "
                f"{bounds.evaluations:5d} runs  {seconds:5.1f} s{'  WRONG' if is_wrong else ''}",
                flush=True,
            )
    print(f"largest deviation {worst:.2%} of the width; {wrong} wrong")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
