"""Bounds of outputs with cusps, kinks, jumps and limits side by side, over two parameters, against a dense grid.

    PYTHONPATH=. python tests/benchmarks/cusps.py SEEDS [TOLERANCE ...]

SEEDS is a range such as 100-119. Each seed draws two to four outputs over 40 times. An output is silent if `outer`
misses more than MISS and the tolerance of the width (rms over time) without a warning. A warning is needless if the
error is below RIGHT.
"""

import sys
import warnings
from collections.abc import Callable

import numpy as np

import symmb as mb
from symmb._types import Array

MISS, RIGHT = 2e-2, 1e-2
LINE = np.linspace(-1, 1, 321)
"""Places of the grid along each parameter."""


def outputs(rng: np.random.Generator, t: Array) -> tuple[list[str], Callable[[Array, Array], Array]]:
    """Kinds of random outputs, and their values (..., n_t, n_y) for parameters (...)."""
    kinds = rng.choice(["cusp", "jump", "kink", "smooth", "limited"], size=int(rng.integers(2, 5))).tolist()
    places, slopes = rng.uniform(-0.45, 0.45, len(kinds)), rng.normal(size=(len(kinds), 2))
    phases, powers = rng.uniform(0, 6, len(kinds)), rng.uniform(0.3, 1.2, len(kinds))
    moves = rng.choice([0.0, 1.0], size=len(kinds))

    def values(a: Array, b: Array) -> Array:
        a, b = a[..., None], b[..., None]
        columns = []
        for kind, place, (first, second), phase, power, moved in zip(
            kinds, places, slopes, phases, powers, moves, strict=True
        ):
            u = first * a + second * b * np.cos(0.5 * moved * t + phase) - place
            columns.append(
                {
                    "cusp": np.abs(u) ** power,
                    "jump": (u > 0) + 0.2 * u,
                    "kink": np.abs(u) + 0.3 * b,
                    "smooth": np.sin(u + a),
                    "limited": np.clip(u, -0.2, 0.3) + 0.05 * a,
                }[kind]
            )
        return np.stack(columns, axis=-1)

    return kinds, values


def rms(a: Array) -> Array:
    return np.sqrt(np.mean(np.square(a), axis=0))


if __name__ == "__main__":
    first, last = map(int, sys.argv[1].split("-"))
    tolerances = [float(each) for each in sys.argv[2:]] or [0.1, 0.01]
    t, counts, runs = np.linspace(0, 2, 40), {"silent": 0, "needless": 0, "outputs": 0}, []
    for seed in range(first, last + 1):
        kinds, values = outputs(np.random.default_rng(seed), t)
        grid = [values(np.full(len(LINE), a), LINE) for a in LINE]
        lower, upper = (
            np.min([each.min(axis=0) for each in grid], axis=0),
            np.max([g.max(axis=0) for g in grid], axis=0),
        )
        names = [f"y{k}" for k in range(len(kinds))]
        simulator = mb.FunctionSimulator(lambda a, b, f=values: f(np.array(a), np.array(b)), {"a": 0, "b": 0}, t, names)
        for tolerance in tolerances:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                method = mb.PolynomialChaos(tolerance=tolerance)
                bounds = mb.propagate(simulator, method, mb.Box(a=(-1, 1), b=(-1, 1)))
            (low, high), told, width = bounds.outer, bounds.doubtful(), rms(upper - lower)
            missed = rms(np.maximum(np.maximum(low - lower, upper - high), 0.0)) / width
            errors = rms(np.maximum(np.abs(bounds.lower - lower), np.abs(bounds.upper - upper))) / width
            runs.append(bounds.evaluations)
            for name, kind, miss, error in zip(names, kinds, missed, errors, strict=True):
                found = (
                    "silent"
                    if miss > max(MISS, tolerance) and name not in told
                    else "needless" * bool(name in told and error < RIGHT)
                )
                counts["outputs"] += 1
                if found:
                    counts[found] += 1
                    print(f"seed {seed}, tolerance {tolerance:g}: {kind} {found}, missed {miss:.2%}, error {error:.2%}")
    print(", ".join(f"{number} {name}" for name, number in counts.items()), f"{np.median(runs):g} runs in the median")
