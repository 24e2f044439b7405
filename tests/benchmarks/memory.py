"""Peak memory and time of a million Monte Carlo samples of the double pendulum's bounds, 12 outputs at 1001 times.

The peer keeps trajectories: the memory of as many is told by that of a few, and so is the time of NumPy's extremes.
"""

# ruff: noqa: E402, I001  (pinned before NumPy starts its threads)
import resource
import time

from _timing import pin

pin()
import numpy as np
from models.double_pendulum import scene

import symmb as mb
from symmb.bound.reductions import bounded
from symmb import DAESimulator

SAMPLES = 1_000_000
FEW = 2_000


def peak() -> float:
    """Largest resident memory so far [GB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


pendulum = scene()
simulator = DAESimulator(pendulum, mb.DormandPrince(rtol=2e-6))
simulator.threads = 1
print(f"{'samples':>24s}{'seconds':>12s}{'runs/s':>12s}{'peak [GB]':>12s}")
print(f"{'before':>24s}{'':12s}{'':12s}{peak():12.3f}")
for samples in (10_000, 100_000, SAMPLES):
    begin = time.process_time()
    bounded(mb.MonteCarlo(samples), simulator, pendulum.box)
    seconds = time.process_time() - begin
    print(f"{samples:24d}{seconds:12.2f}{samples / seconds:12.0f}{peak():12.3f}", flush=True)
P = pendulum.box.from_unit(np.random.default_rng(0).uniform(-1.0, 1.0, (FEW, 2)))
begin = time.process_time()
Y = simulator.run(P).Y
lower, upper = Y.min(axis=0), Y.max(axis=0)
seconds = time.process_time() - begin
print(f"{f'{FEW}, trajectories kept':>24s}{seconds:12.2f}{FEW / seconds:12.0f}{Y.nbytes / 1e9:12.3f}"
      f"   ({Y.nbytes / FEW * SAMPLES / 1e9:.0f} GB for {SAMPLES})")  # fmt: skip
