"""Limits at the lowest of several peaks, which is in a crease between them, against SciPy's SLSQP.

    PYTHONPATH=.:tests python tests/benchmarks/creases.py [100-130]

The peaks of a curve are convex functions of four to ten parameters, so that the smallest of their maxima over the box
is a convex problem. Limits are at 0.3, 1 and 3 % of the width on both sides of it.
"""

import sys
import warnings

import casadi as ca
import numpy as np
from scipy.optimize import minimize

import symmb as mb

DISTANCES = (-0.03, -0.01, -0.003, 0.003, 0.01, 0.03)
STARTS = 8


def scene_of(slopes: np.ndarray, bends: np.ndarray) -> mb.Scene:
    """A curve with the peaks 5 + slopes x + (bends x)^2, one after the other."""
    n, d = slopes.shape
    names = [f"p{k}" for k in range(d)]
    p = mb.Parameters(**dict.fromkeys(names, 0.0))
    x = ca.vertcat(*(getattr(p, name) for name in names))
    peaks = ca.vertsplit(5.0 + ca.mtimes(ca.DM(slopes), x) + ca.mtimes(ca.DM(bends), x) ** 2)
    hills = [
        ca.if_else(ca.logic_and(mb.t >= i, mb.t < i + 1), peak * ca.sin(np.pi * (mb.t - i)) ** 2, 0.0)
        for i, peak in enumerate(peaks)
    ]
    still = mb.System(mb.Body("bob", 1.0, pose=mb.Particle()), parameters=p)
    box = mb.Box(**dict.fromkeys(names, (-1.0, 1.0)))
    return mb.Scene(still, {}, np.linspace(0, n, 10 * n + 1), {"peak": mb.maximum(sum(hills))}, box)


def lowest_peak(slopes: np.ndarray, bends: np.ndarray, rng: np.random.Generator) -> float:
    d = slopes.shape[1]

    def peaks(x):
        return 5.0 + slopes @ x + (bends @ x) ** 2

    found = [
        minimize(
            lambda z: z[-1],
            np.append(rng.uniform(-1, 1, d), 8.0),
            method="SLSQP",
            bounds=[(-1, 1)] * d + [(None, None)],
            constraints={"type": "ineq", "fun": lambda z: z[-1] - peaks(z[:-1])},
            options={"ftol": 1e-10, "maxiter": 500},
        ).x[:-1]
        for _ in range(STARTS)
    ]
    return min(float(peaks(np.clip(x, -1, 1)).max()) for x in found)


def main(seeds: range) -> None:
    counts = {True: 0, False: 0, None: 0}
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, d = int(rng.integers(2, 4)), int(rng.integers(4, 11))
        slopes = rng.normal(size=(n, d)) * np.exp(rng.normal(size=(n, d)) / 2)
        slopes = 0.1 * (slopes - 0.9 * slopes.mean(axis=0))
        bends = 0.12 * rng.normal(size=(n, d)) * (rng.uniform() < 0.6)
        lowest = lowest_peak(slopes, bends, rng)
        bounds = mb.propagate(scene_of(slopes, bends))
        width = float((bounds.upper - bounds.lower).max())
        told = [bounds.check({"peak": (lowest + each * width, None)})["peak"].kept for each in DISTANCES]
        right = [None if kept is None else kept == (each < 0) for kept, each in zip(told, DISTANCES, strict=True)]
        for each in right:
            counts[each] += 1
        print(f"seed {seed}: {n} peaks, {d} parameters, {bounds.evaluations} runs: {right}", flush=True)
    print(f"{counts[True]} limits right, {counts[False]} wrong, {counts[None]} undecided")


if __name__ == "__main__":
    first, last = map(int, (sys.argv[1] if len(sys.argv) > 1 else "0-10").split("-"))
    warnings.simplefilter("ignore", mb.SymmbWarning)
    main(range(first, last))
