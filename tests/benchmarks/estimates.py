"""Estimated errors of `PolynomialChaos()` against true ones, over scenes from one to six parameters.

    estimates.py [tuned | reported]

For each scene and tolerance: runs; the errors of the bounds and of the outer bounds (rms over time, of the widest-off
output, as a share of the width); at how many (output, time) the estimate is at least the true error, or both are below
the reference's own uncertainty; and medians of estimate and error where the error is certain.
"""

import sys
import time

import numpy as np
from _suite import CASES, reference_of, simulator_of

import symmb as mb
from symmb.bound.reductions import bounded

TOLERANCES = (1e-1, 1e-2, 1e-3)
MOST = 1500


def rms(a: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(a**2, axis=0))


if __name__ == "__main__":
    wanted = {"tuned": (True,), "reported": (False,)}.get(sys.argv[1] if len(sys.argv) > 1 else "", (True, False))
    print(f"{'scene':24s}{'d':>3s}{'tolerance':>11s}{'runs':>6s}{'seconds':>9s}{'error':>9s}{'outer':>9s}{'estimate':>10s}"
          f"{'covered':>9s}{'certain':>9s}{'ratio of medians':>18s}")  # fmt: skip
    for case in CASES:
        if case.tuned not in wanted:
            continue
        simulator, box = simulator_of(case)
        lower, upper, change = reference_of(case, simulator, box)
        width = rms(upper - lower)
        width = np.where(width > 1e-9 * rms(np.maximum(np.abs(lower), np.abs(upper))), width, np.inf)
        for tolerance in TOLERANCES:
            begin = time.perf_counter()
            found = bounded(mb.PolynomialChaos(tolerance=tolerance, budget=MOST), simulator, box)
            seconds = time.perf_counter() - begin
            error = np.maximum(np.abs(found.lower - lower), np.abs(found.upper - upper))
            doubt = np.maximum(change, 1e-5 * np.where(np.isfinite(width), width, 1.0))
            covered = (found.estimate + doubt >= error).mean()
            certain = error > 3 * doubt
            medians = [np.median((a / width)[certain]) if certain.any() else np.nan for a in (found.estimate, error)]
            share = [(rms(a) / width).max() for a in (error, found.estimate)]
            outer = (rms(np.maximum(np.abs(found.outer[0] - lower), np.abs(found.outer[1] - upper))) / width).max()
            print(f"{case.name:24s}{len(box):3d}{tolerance:11g}{found.evaluations:6d}{seconds:9.3f}{share[0]:9.1e}"
                  f"{outer:9.1e}{share[1]:10.1e}{covered:9.1%}{certain.mean():9.0%}{medians[0] / medians[1]:18.1f}",
                  flush=True)  # fmt: skip
