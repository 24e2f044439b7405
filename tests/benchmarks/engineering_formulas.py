"""Bounds of formulas of engineers, of series that are nearly monotone, and of functions of few directions, beside their
true ranges.

    PYTHONPATH=. python tests/benchmarks/engineering_formulas.py [seeds] [formulas | series | directions] [tolerance]

`seeds` is a range such as 0-9. Each seed has every formula once, with its own intervals and times. Errors are the
largest ones over time, as shares of the largest width. A case is missed if its error is above MISS, silently if nothing
doubts it; a doubt is needless where the error is below. A study should end within 1 s and three times the seconds of
its runs.
"""

import sys
import time
import warnings
from typing import NamedTuple

import numpy as np
from _directions import directions
from _engineering import Case, cases, monotone_series

import symmb as mb

MISS = 2e-2
"""Error over the width that counts as a miss."""


class Outcome(NamedTuple):
    """The largest error over the largest width, that beyond `outer`, doubts, runs, seconds, and those of the runs."""

    error: float
    missed: float
    doubts: tuple[str, ...]
    runs: int
    seconds: float
    of_runs: float

    @property
    def is_late(self) -> bool:
        """Whether the study takes longer than it should."""
        return self.seconds - self.of_runs > 1 + 3 * self.of_runs


def outcome_of(case: Case, method: mb.PolynomialChaos) -> Outcome:
    """Bounds of a case beside its true range."""
    spent = 0.0

    def response(**p: float) -> np.ndarray:
        nonlocal spent
        begin = time.perf_counter()
        values = np.broadcast_to(case.f(case.t, **p), case.t.shape)[:, None]
        spent += time.perf_counter() - begin
        return values

    middle = {name: sum(ends) / 2 for name, ends in case.box.items()}
    simulator = mb.FunctionSimulator(response, middle, case.t, ["y"])
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.SymmbWarning)
        bounds = mb.propagate(simulator, method, mb.Box(**case.box))
    seconds = time.perf_counter() - begin
    width = (case.upper - case.lower).max()
    error = np.maximum(np.abs(bounds.lower[:, 0] - case.lower), np.abs(bounds.upper[:, 0] - case.upper)).max()
    missed = np.maximum(bounds.outer[0][:, 0] - case.lower, case.upper - bounds.outer[1][:, 0]).max()
    return Outcome(
        float(error / width), max(float(missed), 0.0) / width, bounds.doubts, bounds.evaluations, seconds, spent
    )


if __name__ == "__main__":
    first, _, last = (sys.argv[1] if len(sys.argv) > 1 else "0-4").partition("-")
    make = {"series": monotone_series, "directions": directions}.get("".join(sys.argv[2:3]), cases)
    method = mb.PolynomialChaos(tolerance=float(sys.argv[3]) if len(sys.argv) > 3 else 1e-2)
    outcomes: list[Outcome] = []
    for seed in range(int(first), int(last or first) + 1):
        for case in make(seed):
            o = outcome_of(case, method)
            outcomes.append(o)
            mark = "late " if o.is_late else ""
            mark += "SILENT" if o.error > MISS and not o.doubts else ""
            row = f"{seed:4d} {case.name:55s}{o.runs:6d}{o.seconds:8.2f} s{o.error:9.1e}{o.missed:9.1e}"
            print(f"{row}  {mark} {', '.join(o.doubts)[:60]}", flush=True)
    bad, doubted = np.array([o.error > MISS for o in outcomes]), np.array([bool(o.doubts) for o in outcomes])
    print(
        f"{len(outcomes)} cases: silent {(bad & ~doubted).sum()}, missed with a doubt {(bad & doubted).sum()}, "
        f"needless doubts {(doubted & ~bad).sum()}, late {sum(o.is_late for o in outcomes)}, "
        f"runs {np.median([o.runs for o in outcomes]):.0f} (at most {max(o.runs for o in outcomes)})"
    )
