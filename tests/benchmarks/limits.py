"""Limits inside and outside of the true ranges of everyday machines: satisfied, violated, undecided, or wrong.

    PYTHONPATH=. python tests/benchmarks/limits.py [MACHINES ...] [--seeds 0-2] [--number 13] [--truth FOLDER]

For each machine, limits of random outputs at the shares SHARES of the width inside and outside of the true range.
Seeds choose the machines, as in `everyday_machines.py`, and the limits. A violated limit outside is no error if a run
is beyond it.
"""

import argparse
import time
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from everyday_machines import MACHINES, kept_truth

import symmb as mb

SHARES = 0.003, 0.01, 0.03, 0.1
"""Distances of limits from the true range, over the largest width."""


def outcome(limit, is_outside):
    """Whether a limit that is outside of the true range, or inside, is right, undecided or wrong."""
    if limit.kept is None:
        return "undecided"
    if limit.kept is False and is_outside and "run is beyond" in limit.why:
        return "right: the true range is wider"
    return "right" if limit.kept == is_outside else "WRONG"


def limits_of(bounds, lower, upper, number, rng):
    """Names, shares, whether they are outside, and pairs of random limits, from a true range (n_t, n_y)."""
    lower, upper = np.minimum(lower, bounds.inner[0]), np.maximum(upper, bounds.inner[1])
    for _ in range(number):
        k, share = int(rng.integers(len(bounds.names))), float(rng.choice(SHARES))
        is_outside, is_upper = bool(rng.integers(2)), bool(rng.integers(2))
        shift = share * (upper - lower)[:, k].max() * (1 if is_outside else -1)
        pair = (None, upper[:, k].max() + shift) if is_upper else (lower[:, k].min() - shift, None)
        if shift:
            yield bounds.names[k], share, is_outside, pair


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machines", nargs="*", metavar="MACHINES", help=", ".join(MACHINES))
    parser.add_argument("--seeds", default="0")
    parser.add_argument("--number", type=int, default=13)
    parser.add_argument("--truth", type=Path, default=Path("build/true_ranges"))
    options = parser.parse_args()
    warnings.simplefilter("ignore", mb.SymmbWarning)
    first, _, last = options.seeds.partition("-")
    counts, seconds, runs = {share: Counter() for share in SHARES}, [], []
    for seed in range(int(first), int(last or first) + 1):
        for number, name in enumerate(options.machines or MACHINES):
            scene = MACHINES[name](np.random.default_rng(seed) if seed else None)
            truth = kept_truth(options.truth, f"{name} {seed}", scene)
            bounds = mb.propagate(scene, mb.PolynomialChaos())
            rng = np.random.default_rng([seed, number])
            for output, share, is_outside, pair in limits_of(bounds, *truth, options.number, rng):
                begin = time.process_time()
                limit = bounds.check({output: pair})[output]
                seconds.append(time.process_time() - begin)
                runs.append(limit.further.runs if limit.further else 0)
                result = outcome(limit, is_outside)
                counts[share][result] += 1
                if result != "right":
                    where = f"{share:g} {'out' if is_outside else 'in'}side"
                    print(f"{name} {seed}: {limit.text} ({where}) {result}: {limit.why}", flush=True)
            print(f"{name} {seed}: {bounds.evaluations} runs, then {np.mean(runs[-options.number :]):.0f}", flush=True)
    for share, count in counts.items():
        print(f"{100 * share:g} % of the width: {dict(count)}")
    print(f"runs {np.median(runs):.0f} in the median, at most {max(runs)}; ", end="")
    print(f"seconds {np.median(seconds):.2f}, {max(seconds):.2f}")
