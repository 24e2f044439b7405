"""Runs of random driven loops of bodies in space with redundant rows, in both coordinates, against closed forms.

Each line that differs is printed, then the counts.

    PYTHONPATH=.:tests python tests/benchmarks/driven_mechanisms.py [first seed] [number]
"""

import sys
import warnings
from collections import Counter

import numpy as np
from _isolated import outcomes
from driven_loops import driven_loop

import symmb as mb

SAME, LIMIT = 1e-6, 120.0
"""Allowed difference over the largest value of each output or 1, and seconds a loop may take."""


def judged(seed: int) -> list[str]:
    """What is said of each kind of run of a loop."""
    warnings.simplefilter("ignore")
    loop = driven_loop(seed)
    return [
        f"{loop.kind}, {coordinates}, {solver!r}: {_verdict(loop.scene(coordinates), solver, loop.known)}"
        for coordinates in ("body", "joint")
        for solver in (None, mb.DormandPrince())
    ]


def _verdict(scene: mb.Scene, solver: mb.DormandPrince | None, known: np.ndarray) -> str:
    try:
        run = mb.simulate(scene, solver)
    except Exception as error:  # a foreign exception is a fault
        return f"FAILED {type(error).__name__}: {error}"[:200]
    difference = float((np.abs(run.values - known) / np.maximum(np.abs(known).max(axis=0), 1.0)).max())
    if difference > SAME:
        return f"{'doubted' if run.doubts else 'SILENT'} {difference:.1e}"
    return "right" if not run.doubts else f"right, doubted: {run.doubts}"[:200]


def main(first: int = 0, number: int = 200) -> None:
    """Judge the loops of some seeds and print what differs."""
    counts: Counter[str] = Counter()
    for seed, outcome in outcomes(judged, range(first, first + number), LIMIT):
        for line in [outcome] if isinstance(outcome, str) else outcome:
            what, _, verdict = line.partition(": ")
            counts[f"{what}: {verdict.split()[0].rstrip(',') if verdict else ''}"] += 1
            if verdict != "right":
                print(seed, line, flush=True)
    for what, count in sorted(counts.items()):
        print(f"{count:6d}  {what}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
