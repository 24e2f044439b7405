"""Runs a second of a Monte Carlo study: the paper's double pendulum as declared, 10 s, 12 outputs, 1001 times.

The peers compute trajectories and keep no bounds. Every line shows its error in the angles at 10 s at the nominal
parameters, at most 1e-6 rad but where it says otherwise; and the largest over samples of the
box, against a solution at 1e-13. Seconds are the processor's, but those that pass where two threads are compared.
"""

# ruff: noqa: E402, I001  (pinned before NumPy starts its threads)
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from _timing import END, median, pin

pin()
import numpy as np
from _casadi import idas, minimal, redundant, runge_kutta
from models.double_pendulum import scene

import symmb as mb
from symmb.bound.reductions import bounded
from symmb import DAESimulator

try:
    from _exudyn import tree
except ImportError:
    tree = None

SAMPLES = 10_000
TOLERANCES = [f * 10.0**k for k in range(-4, -9, -1) for f in (5, 4, 3, 2.5, 2, 1.5, 1)]

pendulum = scene()
exact_simulator = DAESimulator(pendulum, mb.DormandPrince(rtol=1e-13))
columns = [exact_simulator.outputs.index(name) for name in ("theta1", "theta2")]
some = np.vstack([[1.0, 1.0], pendulum.box.from_unit(np.random.default_rng(1).uniform(-1, 1, (39, 2)))])
ends = exact_simulator.run(some).Y[:, -1, columns]
starts, _ = exact_simulator.start.states(some)
angles = np.array([2, 5])  # of the states; they turn the other way round


def errors(found: np.ndarray) -> tuple[float, float]:
    """Of the nominal run, and the largest of all, from angles (n, 2) of the first n samples."""
    return float(np.abs(found[0] - END).max()), float(np.abs(found - ends[: len(found)]).max())


def loosest(ends_at: Callable[[float], np.ndarray], choices: list[float]) -> tuple[float, float, float]:
    """The largest tolerance with a nominal error of at most 1e-6, and its errors."""
    for rtol in choices:
        nominal, largest = errors(ends_at(rtol))
        if nominal <= 1e-6:
            return rtol, nominal, largest
    raise SystemExit("No tolerance is accurate enough.")


def compiled_ends(simulator: DAESimulator) -> np.ndarray:
    """Angles (n, 2) at the end, the nominal run alone: beside others it would take the shortest step of all."""
    return np.vstack([simulator.run(some[:1]).Y[:, -1, columns], simulator.run(some[1:]).Y[:, -1, columns]])


def show(name: str, setting: str, seconds_a_run: float, found: tuple[float, float]) -> float:
    rate, ratio = 1 / seconds_a_run, seconds_a_run / first[0]
    print(f"{name:34s}{setting:>18s}{found[0]:11.1e}{found[1]:11.1e}{rate:11.0f}{ratio:11.1f}", flush=True)
    return seconds_a_run


print(f"{'':34s}{'':18s}{'error':>11s}{'largest':>11s}{'runs/s':>11s}{'times as':>11s}")
print(f"{'':34s}{'setting':>18s}{'[rad]':>11s}{'of 40':>11s}{'':11s}{'long':>11s}")

rtol, *found = loosest(lambda r: compiled_ends(DAESimulator(pendulum, mb.DormandPrince(rtol=r))), TOLERANCES)
simulator = DAESimulator(pendulum, mb.DormandPrince(rtol=rtol))
method = mb.MonteCarlo(SAMPLES)
simulator.threads = 1


def bounds() -> mb.Bounds:
    return bounded(method, simulator, pendulum.box)


first = [median(bounds) / SAMPLES]
show("symmb, bounds, 1 thread", f"rtol {rtol:.1e}", first[0], found)
pin(2)
passed = median(bounds, clock=time.perf_counter) / SAMPLES
simulator.threads = 2
two = median(bounds, clock=time.perf_counter) / SAMPLES
simulator.threads = 1
pin()
show("symmb, 1 thread, seconds passed", f"rtol {rtol:.1e}", passed, found)
show("symmb, 2 threads, seconds passed", f"rtol {rtol:.1e}", two, found)
usual = DAESimulator(pendulum)
usual.threads = 1
seconds = median(lambda: bounded(method, usual, pendulum.box)) / SAMPLES
show("symmb, bounds, default", f"rtol {usual.solver.rtol:.0e}", seconds, errors(compiled_ends(usual)))

dae, times = simulator.dae, simulator.times


def idas_ends(rtol: float) -> np.ndarray:
    run = idas(dae, times, rtol)
    return np.array([-np.asarray(run(x0, p))[angles, -1] for x0, p in zip(starts[:4], some[:4], strict=True)])


rtol, *found = loosest(idas_ends, [1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8, 3e-9, 1e-9])
run = idas(dae, times, rtol)
seconds = median(lambda: [run(x0, p) for x0, p in zip(starts[:12], some[:12], strict=True)]) / 12
show("casadi idas, redundant, index 1", f"rtol {rtol:.0e}", seconds, found)

with tempfile.TemporaryDirectory() as folder:
    turned = np.vstack([np.full((1, 40), np.pi / 4), np.full((1, 40), np.pi / 3), np.zeros((2, 40))])
    for name, model, x0 in (("redundant", redundant(dae), starts.T), ("minimal", minimal(), turned)):
        run, _ = runge_kutta(*model, 0.01, 1000, len(some), Path(folder))
        seconds = median(lambda: run(x0, some.T)) / len(some)  # noqa: B023
        last = run(x0, some.T)[:, -1]
        show(
            f"casadi RK4 in C, {name}",
            "1000 steps",
            seconds,
            errors(-last[:, angles] if name == "redundant" else last[:, angles]),
        )

if tree is None:
    print("exudyn cannot be imported: pip install exudyn")
else:
    found = errors(np.array([tree(*p)[-1] for p in some[:8]]))
    show("exudyn, kinematic tree, RK44", "1000 steps", median(lambda: [tree(*p) for p in some[:40]]) / 40, found)
print(f"\n{SAMPLES} samples; two threads {passed / two:.2f} times as fast as one, if nobody else uses the cores")
