"""Bounds of a model that symmb did not derive: a Python function replaces the scene.

SciPy integrates van der Pol's oscillator. The damping and the start value have intervals.

`python examples/black_box.py FOLDER` draws the bounds into FOLDER.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import symmb as mb

TIMES = np.linspace(0.0, 10.0, 101)


def van_der_pol(mu: float, x0: float) -> np.ndarray:
    """Displacement and velocity of the oscillator, (n_t, 2)."""
    run = solve_ivp(
        lambda t, y: (y[1], mu * (1 - y[0] ** 2) * y[1] - y[0]), (0, 10), (x0, 0.0), "DOP853", TIMES, rtol=1e-9
    )
    return run.y.T


oscillator = mb.FunctionSimulator(van_der_pol, parameters={"mu": 1.0, "x0": 0.5}, times=TIMES, outputs=["x", "v"])
box = mb.Box(mu=(0.9, 1.1), x0=(0.45, 0.55))
chaos = mb.propagate(oscillator, mb.PolynomialChaos(), box)
sampled = mb.propagate(oscillator, mb.Scanning(9), box)

assert chaos.kind == "estimate" and sampled.kind == "sampled"
# The outer bounds contain all samples. The width of the bounds is at most 5 % larger than the range of the samples.
assert (chaos.outer[0] <= sampled.lower + 1e-6).all() and (sampled.upper <= chaos.outer[1] + 1e-6).all()
width = (sampled.upper - sampled.lower).max(axis=0)
assert ((chaos.upper - chaos.lower).max(axis=0) < 1.05 * width).all()

if __name__ == "__main__":
    print(chaos)
    for i, name in enumerate(chaos.names):
        print(f"{name}: the bounds are widest at {TIMES[(chaos.upper - chaos.lower)[:, i].argmax()]:.1f} s")
    if len(sys.argv) > 1:
        chaos.plot(Path(sys.argv[1]) / "black_box.png")
