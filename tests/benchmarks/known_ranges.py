"""Bounds of functions whose ranges are known: misses without a word, needless doubts, and runs.

    PYTHONPATH=. python tests/benchmarks/known_ranges.py [seeds] [--tolerance 1e-2] [--kinks] [--parameters 3]

`seeds` is a range such as 0-4, on which estimators are tuned; 5-9 are for reports. `--kinks` takes functions of one
parameter with a kink, 340 of each seed. A miss is a value outside `outer` by more than MISS of the width. It is silent
if the bounds have no doubts. For each kind of function and all of them: silent misses, misses with a doubt, doubts
about bounds that are right, medians of runs, of the error over the width and of the estimate over the error.
"""

import argparse
import warnings
from collections import defaultdict
from typing import NamedTuple

import numpy as np
from _known_ranges import KINDS, KINKS, Case, cases

import symmb as mb

MISS, MISS_AT_KINKS = 2e-2, 1e-2
"""Share of the width that counts as missed, of all functions and of those with a kink. Widths are root mean squares
over time."""


class Outcome(NamedTuple):
    """Bounds of a case: what `outer` misses and the error of the bounds, over the width; doubts, runs, estimate."""

    missed: float
    error: float
    doubts: tuple[str, ...]
    runs: int
    estimate: float


def outcome_of(case: Case, method: mb.PolynomialChaos) -> Outcome:
    """The bounds of a method beside the known range."""
    names = [f"x{i}" for i in range(case.d)]
    simulator = mb.FunctionSimulator(
        lambda **p: case.f(np.array([list(p.values())]))[0],
        dict.fromkeys(names, 0.0),
        np.arange(case.n_t, dtype=float),
        ["y"],
    )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mb.SymmbWarning)
            bounds = mb.propagate(simulator, method, mb.Box(**dict.fromkeys(names, (-1.0, 1.0))))
    except mb.SymmbError as error:
        return Outcome(np.nan, np.nan, (str(error).splitlines()[0],), 0, np.nan)
    width = np.sqrt(np.mean(np.square(case.upper - case.lower)))
    (low, high), estimate = bounds.outer, bounds.estimate
    missed = np.maximum(low[:, 0] - case.lower, case.upper - high[:, 0]).max()
    error = np.maximum(np.abs(bounds.lower[:, 0] - case.lower), np.abs(bounds.upper[:, 0] - case.upper))
    share = np.sqrt(np.mean(np.square([error, estimate[:, 0]]), axis=1)) / width
    return Outcome(max(missed, 0.0) / width, float(share[0]), bounds.doubts, bounds.evaluations, float(share[1]))


def line(kind: str, outcomes: list[Outcome], miss: float = MISS) -> str:
    """A line of the table."""
    missed = np.array([o.missed > miss for o in outcomes])
    doubtful = np.array([bool(o.doubts) for o in outcomes])
    right = np.array([o.error <= miss for o in outcomes])
    known = [o for o in outcomes if o.runs]
    runs, error = (np.median([o[k] for o in known]) for k in (3, 1))
    ratio = np.median([o.estimate / max(o.error, 1e-12) for o in known])
    return (
        f"{kind:12s}{len(outcomes):6d}{(missed & ~doubtful).sum():8d}{(missed & doubtful).sum():8d}"
        f"{(doubtful & right).sum():8d}{runs:8.0f}{error:10.1e}{ratio:10.1e}"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("seeds", nargs="?", default="0-4")
    parser.add_argument("--tolerance", type=float, default=1e-2)
    parser.add_argument("--kinks", action="store_true")
    parser.add_argument("--parameters", type=int, default=20, help="most parameters of a function")
    given = parser.parse_args()
    first, _, last = given.seeds.partition("-")
    method, kinds = mb.PolynomialChaos(tolerance=given.tolerance), KINKS if given.kinks else KINDS
    miss = MISS_AT_KINKS if given.kinks else MISS
    outcomes = defaultdict(list)
    for seed in range(int(first), int(last or first) + 1):
        for case in cases(seed, kinds):
            if case.d > given.parameters:
                continue
            outcome = outcome_of(case, method)
            outcomes[case.kind].append(outcome)
            told = f" ({outcome.doubts[0][:60]})" if outcome.doubts else ""
            print(f"{case.name:40s}{outcome.missed:9.1e}{outcome.error:9.1e}{outcome.runs:6d}{told}", flush=True)
    print(f"{'':12s}{'cases':>6s}{'silent':>8s}{'missed':>8s}{'needless':>8s}{'runs':>8s}{'error':>10s}{'ratio':>10s}")
    for kind, some in outcomes.items():
        print(line(kind, some, miss))
    print(line("all", [o for some in outcomes.values() for o in some], miss))
