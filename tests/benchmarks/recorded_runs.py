"""Bounds from tables of random runs, for functions that no test uses. The seed chooses functions and runs.

Each of the ten kinds has tables with 60 to 500 runs. A table is `good` if the error at both ends is below 3 % of the
true width, `told` if only the estimate covers the error, and `silent` otherwise. `needless` estimates are above 10 % of
the width, although the error is below 3 % of it and below a tenth of the estimate.

    PYTHONPATH=.:tests:tests/methods python tests/benchmarks/recorded_runs.py [--seed 0] [--tables 4]

With `--peers`, tables of eight textbook functions show symmb beside OpenTURNS (sparse chaos by LARS), chaospy
(regression) and SALib (RBD-FAST, which has no bounds, only indices). Three rows of each table failed and are nan. The
others get the tables as they are, and then without these rows. Errors and symmb's estimates are in % of the width.
(needs openturns, chaospy and SALib; figures of seed 0)

                    runs     symmb      told OpenTURNS             chaospy               SALib
    ishigami         231       0.0       0.0      62.3      14.4       nan       4.5       nan
    borehole         395       0.5       1.6     102.6       6.5       nan       5.5       nan
    otl_circuit       71       0.2       4.2     137.2       0.5       nan       8.2       nan
    piston           400       5.3      41.9     115.9      15.6       nan      10.8       nan
    wing_weight      390       0.4       2.0     131.3       2.5       nan       2.0       nan
    sobol_g          134       5.8     100.5     100.0      27.9       nan      21.5       nan
    friedman         143       0.0       0.3     100.0       2.9       nan       0.4       nan
    morris            65      47.7     176.9      57.2      24.9       nan      43.0       nan
"""

import argparse
import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any

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


def peers(seed: int) -> None:
    from SALib.analyze import rbd_fast
    from surrogates import by_chaospy, by_openturns, range_of
    from test_recorded_runs import FUNCTIONS, decay, slider_crank, true_range

    def table(name: str, cells: Sequence[str]) -> None:
        print(f"{name:14s}{cells[0]:>6s}" + "".join(f"{cell:>10s}" for cell in cells[1:]), flush=True)

    table("", ["runs", "symmb", "told", "OpenTURNS", "", "chaospy", "", "SALib"])
    for number, f in enumerate(f for f in FUNCTIONS if f not in (decay, slider_crank)):
        rng, ends = np.random.default_rng([seed, number]), np.array(FUNCTIONS[f], dtype=float)
        n, d = int(60 * (500 / 60) ** rng.uniform()), len(ends)

        def unit(x: Array, f: Any = f, ends: Array = ends) -> Array:
            return f(ends[:, 0] + (x + 1) / 2 * (ends[:, 1] - ends[:, 0]))

        X = rng.uniform(-1, 1, (n, d))
        y = unit(X)
        true = np.array(true_range(f))[:, 0]
        y[:3] = np.nan
        names = [f"x{i}" for i in range(d)]
        bounds = mb.propagate(mb.RecordedRuns(X, y, names), box=mb.Box(**dict.fromkeys(names, (-1.0, 1.0))))

        def error(own: Any, true: Array = true) -> str:
            return f"{100 * np.abs(np.array(own) - true).max() / np.ptp(true):.1f}"

        cells = [
            str(n),
            error([bounds.lower[0, 0], bounds.upper[0, 0]]),
            f"{100 * bounds.estimate[0, 0] / np.ptp(true):.1f}",
        ]
        for make in (by_openturns, by_chaospy):
            for rows in (slice(None), slice(3, None)):
                try:
                    cells.append(error(range_of(make(X[rows], y[rows]), X[rows])))
                except Exception as failure:
                    cells.append(type(failure).__name__)
        problem = {"num_vars": d, "names": names, "bounds": [[-1, 1]] * d}
        cells.append(f"{rbd_fast.analyze(problem, X, y, num_resamples=2)['S1'][0]:.3g}")
        table(f.__name__, cells)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tables", type=int, default=4)
    parser.add_argument("--peers", action="store_true")
    options = parser.parse_args()
    warnings.simplefilter("ignore", mb.SymmbWarning)
    if options.peers:
        peers(options.seed)
    else:
        main(options.seed, options.tables)
