"""Bounds from tables of random runs, for functions that no test uses. The seed chooses functions and runs.

Each of the ten kinds has tables with 60 to 500 runs. A table is `good` if the error at both ends is below 3 % of the
true width, `told` if only the estimate covers the error, and `silent` otherwise. `needless` estimates are above 10 % of
the width, although the error is below 3 % of it and below a tenth of the estimate.

    PYTHONPATH=.:tests/benchmarks python tests/benchmarks/recorded_runs.py [--seed 0] [--tables 4]
"""

import argparse
import time
import warnings
from collections.abc import Callable

import numpy as np
from _known_ranges import searched

import symmb as mb
from symmb._types import Array

Made = tuple[int, Callable[[Array], Array]]
KINDS = "ridge", "waves", "kinks", "step", "peak", "noise", "rational", "product", "powers", "motion"
"""Functions of X (N, d) in the box -1 ... 1."""


def function(kind: str, rng: np.random.Generator) -> Made:
    d = int(rng.integers(2, 13))
    a, b = rng.normal(size=(2, d))
    a /= np.abs(a).sum()
    few = min(d, int(rng.integers(2, 4)))
    at, rate = rng.uniform(-0.7, 0.7, d), rng.uniform(0.5, 3)
    t = np.linspace(0, 2, 21)
    return {
        "ridge": (d, lambda X: np.tanh(rate * (X @ a + 0.2))),
        "waves": (few, lambda X: np.sin(rate * X[:, :1] + X[:, 1:2]) + 0.5 * np.cos(2 * X[:, -1:])),
        "kinks": (d, lambda X: np.abs(X - at) @ a + 0.5 * X @ b),
        "step": (few, lambda X: np.where(X @ a[:few] > 0.1 * at[0], 1.0, 0.0) + 0.3 * X[:, 0]),
        "peak": (few, lambda X: np.exp(-np.square(X - at[:few]).sum(axis=1) / (2 * (0.3 + 0.1 * rate) ** 2))),
        "noise": (d, lambda X: X @ b + 0.5 * np.square(X) @ a),
        "rational": (d, lambda X: (1 + X @ np.abs(a)) / (1.5 + 0.5 * X[:, 0] + 0.5 * X[:, 1] * X[:, -1])),
        "product": (d, lambda X: np.prod((1.5 + X) ** a, axis=1)),
        "powers": (d, lambda X: 1e9 * np.prod(10 ** (0.5 * rate * a * X), axis=1)),
        "motion": (
            3,
            lambda X: np.exp(-(0.3 + 0.1 * X[:, :1]) * t) * np.cos(rate * (1.5 + 0.1 * X[:, 1:2]) * t + 0.1 * X[:, 2:]),
        ),
    }[kind]


def main(seed: int, tables: int) -> None:
    total = dict.fromkeys(("good", "told", "silent", "needless"), 0)
    for number, kind in enumerate(KINDS):
        counts, begin = dict.fromkeys(total, 0), time.process_time()
        for k in range(tables):
            rng = np.random.default_rng([seed, number, k])
            d, f = function(kind, rng)
            n = int(60 * (500 / 60) ** rng.uniform())
            X = rng.uniform(-1, 1, (n, d))
            Y = f(X).reshape(n, -1)
            ends = searched(lambda x, f=f: f(x).reshape(len(x), -1), d, rng)
            width = float(np.sqrt(np.square(ends[1] - ends[0]).mean()))
            if kind == "noise":  # 2 % of the width
                Y = Y + 0.02 / 4 * width * rng.normal(size=Y.shape)
            names = [f"x{i}" for i in range(d)]
            runs = mb.RecordedRuns(X, Y, names, np.arange(Y.shape[1]), ["y"])
            bounds = mb.propagate(runs, box=mb.Box(**dict.fromkeys(names, (-1.0, 1.0))))
            errors = [np.sqrt(np.square(own - end).mean()) for own, end in zip(bounds["y"], ends, strict=True)]
            error, told = max(errors) / width, float(np.sqrt(np.square(bounds.estimate).mean())) / width
            how = "good" if error <= 0.03 else "told" if error <= told else "silent"
            counts[how] += 1
            counts["needless"] += int(error < 0.03 and told > max(0.1, 10 * error))
            if how == "silent":
                print(f"    {kind} {k}: {d} parameters, {n} runs, error {error:.1%}, told {told:.1%}", flush=True)
        total = {name: total[name] + counts[name] for name in total}
        print(f"{kind:9s}", counts, f"{time.process_time() - begin:.0f} s", flush=True)
    print("all      ", total)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tables", type=int, default=4)
    options = parser.parse_args()
    warnings.simplefilter("ignore", mb.SymmbWarning)
    main(options.seed, options.tables)
