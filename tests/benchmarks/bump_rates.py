"""How often bounds miss a bump that fills a small part of the box, in silence, by its width and the number of probes.

A Gaussian bump of height 2 stands anywhere in the box on a slope that changes by 0.6 in all. Prints a line for each
number of parameters, width (standard deviation over the half width of the box) and number of probes: cases, silent
misses by more than 2 % of the width, and the median of runs.

    PYTHONPATH=. python tests/benchmarks/bump_rates.py [SEED] [CASES]
"""

import sys
import warnings

import numpy as np

import symmb as mb

WIDTHS = {1: (0.2, 0.1), 2: (0.3, 0.2, 0.15), 3: (0.4, 0.3, 0.2), 4: (0.5, 0.4, 0.3)}
"""Widths that are tried, by the number of parameters."""
PROBES = 0, 50, 200
"""Numbers of probes that are tried."""


def missed(rng: np.random.Generator, d: int, width: float, probes: int) -> tuple[bool, bool, int]:
    """Whether a bump is missed, whether the bounds are doubted, and the runs."""
    at, slope = rng.uniform(-1.0, 1.0, d), rng.normal(size=d)
    slope *= 0.3 / np.abs(slope).sum()
    names = [f"x{i}" for i in range(d)]

    def f(**p: float) -> np.ndarray:
        x = np.array([p[name] for name in names])
        return np.array([[x @ slope + 2 * np.exp(-np.square(x - at).sum() / (2 * width**2))]])

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.SymmbWarning)
        simulator = mb.FunctionSimulator(f, dict.fromkeys(names, 0.0), np.zeros(1), ["y"])
        bounds = mb.propagate(simulator, mb.PolynomialChaos(probes=probes), mb.Box(**dict.fromkeys(names, (-1.0, 1.0))))
    top = float(f(**dict(zip(names, at, strict=True)))[0, 0])
    return top - bounds.upper[0, 0] > 0.02 * (top + 0.3), bool(bounds.doubts), bounds.evaluations


def main(seed: int = 1, cases: int = 20) -> None:
    print("parameters  width  probes  cases  silent  runs")
    for d, widths in WIDTHS.items():
        for width in widths:
            for probes in PROBES:
                rng = np.random.default_rng([seed, d])
                found = [missed(rng, d, width, probes) for _ in range(cases)]
                silent, runs = sum(m and not doubted for m, doubted, _ in found), np.median([n for *_, n in found])
                print(f"{d:10d}  {width:5g}  {probes:6d}  {cases:5d}  {silent:6d}  {runs:4.0f}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
