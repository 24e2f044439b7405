"""The gun of models/artillery.py in numbers: builds, runs, tolerances, modes, and bounds against the 10 x 10 scan.

PYTHONPATH=. python tests/benchmarks/artillery.py
"""

# Before NumPy starts its threads: those of its small matrices get in each other's way.
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import subprocess
import sys
import tempfile
import time

import numpy as np
from _timing import median

import symmb as mb
from models import artillery as gun

SOLVER = mb.DormandPrince(rtol=1e-6)
METHODS = (mb.PolynomialChaos.paper(order=2), mb.PolynomialChaos(budget=60), mb.Taylor(order=2))
BUILD = """
import time
begin = time.perf_counter()
import symmb as mb
from models import artillery
mb.DAESimulator(artillery.scene(), mb.DormandPrince(rtol=1e-6))
print(time.perf_counter() - begin)
"""


def builds() -> None:
    """A new process each, with an empty cache and again: importing, modes, deriving, equilibrium, compiling."""
    with tempfile.TemporaryDirectory() as cache:
        for state in ("cold", "cached"):
            run = subprocess.run(
                [sys.executable, "-c", BUILD],
                env={**os.environ, "XDG_CACHE_HOME": cache},
                capture_output=True,
                text=True,
                check=True,
            )
            print(f"build, {state:7} {float(run.stdout):6.1f} s")


def runs() -> None:
    """Seconds and muzzle angle by tolerance, and of the whole cycle."""
    simulator = mb.DAESimulator(gun.scene(), SOLVER)
    vertical = simulator.outputs.index("muzzle_vertical")
    P = np.zeros((1, 2))
    for rtol in (1e-5, 1e-6, 1e-8, 1e-10):
        case = simulator.solved_by(mb.DormandPrince(rtol=rtol))
        seconds = median(lambda case=case: case.run(P).Y, clock=time.perf_counter)
        angle = np.degrees(case.run(P).Y[0, -1, vertical])
        print(f"14 ms, rtol {rtol:.0e}: {seconds:6.3f} s, muzzle {angle:.6f} deg")
    cycle = mb.simulate(gun.scene(end=1.0), SOLVER)
    print(
        f"1 s: {cycle.run_seconds:.2f} s, recoil {1e3 * cycle['recoil'].max():.1f} mm, "
        f"energy drift {cycle.energy_drift:.1e}, constraint drift {cycle.position_drift:.1e}"
    )


def modes() -> None:
    P = np.zeros((1, 2))
    for count in (10, 20, 40):
        simulator = mb.DAESimulator(gun.scene(modes=count), SOLVER)
        seconds = median(lambda simulator=simulator: simulator.run(P).Y, clock=time.perf_counter)
        angle = np.degrees(simulator.run(P).Y[0, :, simulator.outputs.index("muzzle_vertical")])
        size = simulator.dae.rhs.n_instructions()
        print(
            f"{count} modes: {size} instructions, set up {simulator.setup_seconds:.1f} s, run {seconds:.3f} s, "
            f"muzzle at 10, 12, 14 ms {angle[100]:.5f} {angle[120]:.5f} {angle[140]:.5f} deg"
        )


def bounds(end: float) -> None:
    print(f"\n0 to {end:g} s, shares of the scan's width")
    comparison = mb.compare(gun.scene(end=end), METHODS, reference=mb.Scanning(10), solver=SOLVER)
    print(comparison)
    for row in comparison.rows:
        print(f"{row.name}: {row.evaluations} evaluations, {row.run_seconds:.2f} s")
        for name, *values in zip(
            comparison.outputs, row.score.error, row.score.over, row.score.under, row.score.coverage, strict=True
        ):
            print("  {:24} error {:.4f} over {:.4f} under {:.4f} covered {:.3f}".format(name, *values))


if __name__ == "__main__":
    builds()
    runs()
    modes()
    bounds(0.014)
    bounds(1.0)
