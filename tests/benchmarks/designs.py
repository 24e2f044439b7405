"""Random designs at the boundary of failed runs, against an optimiser that knows the closed forms.

    PYTHONPATH=. python tests/benchmarks/designs.py [--seed 0] [--number 20]

The worst case of a convex parabola of two or three parameters is minimised. Runs fail on one side of a plane, inside
of a ball or outside of a ball. The minimum without failures is on the side of failed runs. Half of the cases have
tolerances. The worst cases of parabolas, planes and outsides of balls are at corners of the tolerances.
"""

import argparse
import itertools
import warnings

import numpy as np
from scipy.optimize import differential_evolution

import symmb as mb


def case(rng):
    """A simulator, the half widths of its parameters, and a function: design -> worst value, infinite if runs fail."""
    d = int(rng.integers(2, 4))
    names, half = [*"xyz"[:d]], rng.uniform(0.01, 0.06, d) * (rng.random() < 0.5)
    A = np.linalg.qr(rng.standard_normal((d, d)))[0] * np.sqrt(rng.uniform(1, 10, d))
    H, place = A @ A.T, rng.uniform(0.3, 0.7, d)
    normal = rng.standard_normal(d)
    normal /= np.linalg.norm(normal)
    kind, radius = ("plane", "inside", "outside")[rng.integers(3)], rng.uniform(0.3, 0.6)
    depth = rng.uniform(0.05, 0.9) * radius if kind == "inside" else rng.uniform(0.05, 0.3)
    # The distance from the boundary at the minimum is the depth.
    centre = place + normal * {"plane": -depth, "inside": -(radius - depth), "outside": -(radius + depth)}[kind]

    def depths(X):
        apart = X - centre
        if kind == "plane":
            return apart @ normal
        return (np.linalg.norm(apart, axis=-1) - radius) * (1 if kind == "outside" else -1)

    def response(**values):
        x = np.array([*values.values()])
        if depths(x) > 0:
            raise ValueError("No assembly.")
        return [[1.0 + (x - place) @ H @ (x - place)]]

    signs = np.array([*itertools.product((-1.0, 1.0), repeat=d)])

    def worst(x):
        X = x + half * signs
        nearest = np.clip(centre, x - half, x + half)
        if (depths(X) > 0).any() or (kind == "inside" and depths(nearest) > 0):
            return np.inf
        return 1.0 + max(e @ H @ e for e in X - place)

    nominal = dict(zip(names, np.full(d, 0.5).tolist(), strict=True))
    return mb.FunctionSimulator(response, nominal, [0.0], ["y"]), half, worst, f"{d} parameters, {kind}"


def outcome(rng):
    """Relative excess of the value of a design over the best value, number of runs, and words about the case."""
    simulator, half, worst, words = case(rng)
    ranges = dict.fromkeys(simulator.parameters, (0.0, 1.0))
    box = (
        mb.Box.plus_minus(simulator.parameters, **dict(zip(ranges, half.tolist(), strict=True))) if half.any() else None
    )
    guess = differential_evolution(
        lambda x: min(worst(x), 1e6), [*ranges.values()], seed=1, tol=1e-10, maxiter=400, popsize=20, polish=False
    )
    words += ", with tolerances" if half.any() else ""
    try:
        found = mb.design(simulator, ranges, ("y", "upper"), box=box)
    except mb.PropagationError as error:
        return np.inf, 0, f"{words}: {error}"
    own = worst(np.array([*found.values.values()]))
    return own / guess.fun - 1, found.runs, words + (", SOME RUNS FAIL" if np.isinf(own) else "")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--number", type=int, default=20)
    asked = parser.parse_args()
    warnings.simplefilter("ignore", mb.SymmbWarning)
    excesses, runs = [], []
    for k in range(asked.number):
        excess, n, words = outcome(np.random.default_rng([asked.seed, k]))
        excesses.append(excess)
        runs.append(n)
        print(f"{k}: {excess:.2%} above the best value, {n} runs, {words}", flush=True)
    over = np.array(excesses) > 0.01
    print(f"{over.sum()} of {len(over)} designs are more than 1 % above the best value, {np.median(runs):.0f} runs")
