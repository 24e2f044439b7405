"""Solver x problem: digits reached and time, each solver at the setting that errs least within a few seconds a run.

Settings are relative tolerances from 1e-6 to 1e-12, or 1e3 to 1e6 steps. Run time is of that setting, without set-up.

    PYTHONPATH=.:tests python tests/benchmarks/digits.py [part of a problem's name ...]
"""

import sys
import time
from collections.abc import Callable

import numpy as np
from problems import Problem, all_problems

import symmb as mb
from symmb.run.integrate.solver import Solver
from symmb.study.trials import Job, run_jobs

LIMIT = 30.0
"""Seconds a trial, set-up included."""
AUGMENTED = mb.AugmentedLagrangian()
ADAPTIVE: dict[str, Callable[[float], Solver]] = {
    "DormandPrince": lambda r: mb.DormandPrince(rtol=r),
    "DormandPrince, augmented": lambda r: mb.DormandPrince(rtol=r, stabilization=AUGMENTED),
    "CVODES": lambda r: mb.CVODES(rtol=r),
    "CVODES, stiff": lambda r: mb.CVODES(rtol=r, stiff=True),
    "IDAS": lambda r: mb.IDAS(rtol=r),
    "StabilizedIndex2": lambda r: mb.StabilizedIndex2(rtol=r),
    "Rosenbrock": lambda r: mb.Rosenbrock(rtol=r),
    "NSTIFFSI2, controlled": lambda r: mb.NSTIFFSI2(step=1e9, rtol=r),
}
FIXED: dict[str, Callable[[float, int], Solver]] = {
    "RungeKutta": lambda span, n: mb.RungeKutta(steps=n),
    "NSTIFFSI2": lambda span, n: mb.NSTIFFSI2(step=span / n),
    "GeneralizedAlpha": lambda span, n: mb.GeneralizedAlpha(step=span / n),
    "HHT": lambda span, n: mb.HHT(step=span / n),
    "Newmark": lambda span, n: mb.Newmark(step=span / n),
    "BDFI3": lambda span, n: mb.BDFI3(step=span / n),
}
TOLERANCES, STEPS = (1e-6, 1e-8, 1e-10, 1e-12), (1000, 10_000, 100_000, 1_000_000)


def table(problem: Problem) -> None:
    scene = problem.make()
    span = float(scene.times[-1] - scene.times[0])
    jobs = [
        *(Job("", problem.make, name, [(r, make(r)) for r in TOLERANCES]) for name, make in ADAPTIVE.items()),
        *(Job("", problem.make, name, [(span / n, make(span, n)) for n in STEPS]) for name, make in FIXED.items()),
    ]
    best: dict[str, tuple[float, float, float, float]] = {}
    reasons: dict[str, str] = {}
    for trial in run_jobs(jobs, LIMIT, time.monotonic() + 900):
        if trial.reason:
            reasons.setdefault(trial.family, trial.reason)
            continue
        error = problem.error(trial.values)
        if trial.family not in best or error < best[trial.family][0]:
            best[trial.family] = error, trial.seconds, trial.energy, trial.setting
    print(f"\n{problem.name} ({problem.digits:.0f} digits known)")
    for name in (*ADAPTIVE, *FIXED):
        if name in best:
            error, seconds, energy, setting = best[name]
            digits = min(-np.log10(max(error, 1e-16)), problem.digits)
            print(f"  {name:26}{digits:6.1f}{1e3 * seconds:10.1f} ms  energy {energy:.0e}  at {setting:.0e}")
        else:
            print(f"  {name:26}     -  {reasons[name][:80]}")
    sys.stdout.flush()


def main() -> None:
    parts = sys.argv[1:]
    for problem in all_problems():
        if not parts or any(part in problem.name for part in parts):
            table(problem)


if __name__ == "__main__":
    main()
