"""Proofs with many uncertain numbers.

    export PYTHONPATH=.:tests OPENBLAS_NUM_THREADS=1
    python tests/benchmarks/verified_integration.py [NAME ...]             problems of tests/verified_problems.py
    python tests/benchmarks/verified_integration.py random SYSTEMS POINTS [FIRST SEED]

For each problem it prints the verdict, the time of the processor, and the widths of the bounds at the end, over those
of 2000 runs. The random systems are state spaces, planar trees and planar loops with three to twelve uncertain numbers.
Points of their boxes are integrated by SciPy with a relative tolerance of 1e-13. The motions of trees and loops follow
from Lagrange's equations in `planar_lagrangian`, without symmb. Systems with points outside of the bounds are printed.
"""

import sys
import time
import warnings
from collections import Counter

import numpy as np
from enclosure_samples import check
from planar_lagrangian import random_mechanism
from verified_problems import laub_loomis, lotka_volterra, quadrotor, random_system, robertson, van_der_pols

import symmb as mb
from symmb.prove import enclose, problem_of
from symmb.run.simulation import DAESimulator


def between(name, low, high, begin=0.0, end=np.inf):
    """A condition: an output is between two numbers at the times from `begin` to `end`."""

    def holds(bounds, times):
        lower, upper = bounds[name]
        wanted = (times >= begin) & (times <= end)
        return bool((lower[wanted] >= low).all() and (upper[wanted] <= high).all())

    return holds


def width_below(name, most):
    """A condition: the width of an output at the end is below a number."""
    return lambda bounds, times: float(np.subtract(*bounds[name][::-1])[-1]) < most


INF = np.inf
CASES = {
    **{
        f"ROBE25 {k}": (lambda b=b, c=c: robertson(b, c), mb.TaylorModel(), [width_below("sum", 1e-5)])
        for k, (b, c) in enumerate([(1e2, 1e3), (1e3, 1e5), (1e3, 1e7)], 1)
    },
    "LOVO21": (lotka_volterra, mb.TaylorModel(order=6), []),
    "CVDP23": (van_der_pols, mb.TaylorModel(), [between("y1", -INF, 2.75), between("y2", -INF, 2.75)]),
    **{
        f"LALO20 {spread}": (lambda spread=spread: laub_loomis(spread), mb.TaylorModel(), [between("x4", -INF, most)])
        for spread, most in ((0.01, 4.5), (0.05, 4.5), (0.1, 5.0))
    },
    "QUAD20": (
        quadrotor,
        mb.TaylorModel(),
        [
            between("height", -INF, 1.4),
            between("height", 0.9, INF, begin=1.0),
            between("height", 0.98, 1.02, begin=5.0),
        ],
    ),
}


def random(systems: int, points: int, first: int = 0) -> None:
    """Random state spaces, trees and loops against points of their boxes."""
    begin, outside = time.perf_counter(), 0
    number, done = Counter[str](), Counter[str]()
    for seed in range(first, first + systems):
        if seed % 10 < 7:
            kind, problem, motion_of = "state spaces", random_system(seed), None
        else:
            kind = "loops" if seed % 2 else "trees"
            scene, motion_of = random_mechanism(seed)
            problem = problem_of("method", DAESimulator(scene), scene.box)
        found = enclose(problem, 2 + seed % 3, 1)
        result = check(problem, found, points, seed, motion_of)
        outside += len(result.disputed)
        number[kind], done[kind] = number[kind] + 1, done[kind] + (not found.why)
        if len(result.disputed):
            print(f"system {seed}: {len(result.disputed)} points outside by up to {result.beyond:.1e}", flush=True)
        if seed % 10 == 9:
            told = ", ".join(f"{done[kind]} of {number[kind]} {kind}" for kind in number)
            print(f"{time.perf_counter() - begin:.0f} s, proved to the end: {told}", flush=True)
    print(f"{systems * points} points of {systems} systems: {outside} outside")


def main() -> None:
    """Prove the named problems, or all."""
    if sys.argv[1:2] == ["random"]:
        return random(*map(int, sys.argv[2:5]))
    wanted = sys.argv[1:] or [*CASES]
    print(f"{'problem':12} {'verdict':12} {'CPU s':>7}  widths at the end (over those of runs)")
    for name, (make, method, conditions) in CASES.items():
        if not any(name.startswith(own) for own in wanted):
            continue
        scene, begin = make(), time.process_time()
        with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
            bounds = mb.propagate(scene, method)
            seconds = time.process_time() - begin
            runs = mb.propagate(scene, mb.MonteCarlo(2000), solver=mb.CVODES(stiff=True, rtol=1e-9))
        width, sampled = (bounds.upper - bounds.lower)[-1], (runs.upper - runs.lower)[-1]
        is_proved = np.isfinite(bounds.upper).all()
        verdict = (
            "not proved"
            if not is_proved
            else "holds"
            if all(own(bounds, scene.times) for own in conditions)
            else "too wide"
        )
        outside = np.maximum(bounds.lower - runs.lower, runs.upper - bounds.upper).max()
        verdict = verdict if outside < 1e-6 else f"WRONG {outside:.1e}"
        with np.errstate(all="ignore"):
            parts = ", ".join(
                f"{own} {a:.5g} ({a / b:.3g})" for own, a, b in zip(scene.outputs, width, sampled, strict=True)
            )
        print(f"{name:12} {verdict:12} {seconds:7.1f}  {parts}", *bounds.doubts[:1], *bounds.remarks[:1], flush=True)


if __name__ == "__main__":
    main()
