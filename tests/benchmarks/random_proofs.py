"""Proved bounds of random scenes against runs: python tests/benchmarks/random_proofs.py [SCENES] [SEED].

Each scene is an open chain of two or three bodies that hang on the ground or fly freely, with a start in coordinates of
bodies or of joints, uncertain parameters, pulses of time in half of them, and outputs of which one may have no
remainder. It prints the scenes whose bounds 200 runs leave by more than their own errors, those of an output that is
refused without its name, and the share of output times that are proved.
"""

import sys
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
import symmb as mb

INSIDE = 1e-9
"""Error of runs over the size of an output."""


@dataclass(frozen=True)
class Case:
    """A random scene, and its output without a remainder."""

    scene: mb.Scene
    refused: str


def random_case(seed: int) -> Case:
    """A random open chain."""
    rng = np.random.default_rng(seed)
    n = 1 + int(rng.random() < 0.7)
    flies = n > 1 and bool(rng.random() < 0.6)
    p = mb.Parameters(mass=rng.uniform(0.5, 2.0), tilt=rng.uniform(0.2, 1.2), push=rng.uniform(1.0, 4.0))
    bodies = [
        mb.Body(f"b{k}", p.mass if k == n - 1 else rng.uniform(0.5, 2.0), rng.uniform(0.05, 0.2)) for k in range(n)
    ]
    arms = rng.uniform(0.3, 0.7, n)
    joints = [
        mb.Revolute(f"j{k}", bodies[k - 1].point(arms[k - 1], 0), bodies[k].point(-arms[k], 0)) for k in range(1, n)
    ]
    if not flies:
        joints.insert(0, mb.Revolute("j0", mb.Ground().point(0, 0), bodies[0].point(-arms[0], 0)))
    begin, end = rng.uniform(-1.0, 1.0), 0.4
    law = p.push * ca.sin(5 * mb.t)
    if rng.random() < 0.5:
        switch = begin + rng.uniform(0.2, 0.8) * end
        law += ca.if_else(ca.logic_and(mb.t > switch, mb.t < switch + 0.02), 10 * p.push, 0)
    force = mb.Force("push", bodies[-1].point(arms[-1], 0), (law, 0))
    system = mb.System(*bodies, *joints, mb.Gravity(0, -9.81), force, parameters=p)
    start: dict[str, object] = {"b0.theta": p.tilt}
    if n > 1 and rng.random() < 0.5:
        start |= {
            "b0.omega": rng.uniform(-2, 2),
            f"j{n - 1}.angle": rng.uniform(-1, 1),
            f"j{n - 1}.angle_rate": -p.tilt,
        }
    if flies and rng.random() < 0.5:
        start |= {"b0.vx": rng.uniform(-1, 1), "b0.y": rng.uniform(-1, 1)}
    last, refused = bodies[-1], ""
    outputs = {
        "x": last.x,
        "theta": last.theta,
        "speed": last.vx**2 + last.vy**2,
        "pull": system.reaction(f"j{n - 1}").fx,
    }
    if rng.random() < 0.5:
        refused = "steps"
        outputs["steps"] = ca.floor(3 * last.theta) + last.x
    names = rng.choice(["mass", "tilt", "push"], int(rng.integers(1, 3)), replace=False).tolist()
    box = mb.Box.around(p, rng.uniform(0.002, 0.02), names=names)
    times = np.linspace(begin, begin + end, 9)
    return Case(mb.Scene(system, start, times, outputs, box=box), refused)


@dataclass(frozen=True)
class Found:
    """How far runs are outside (over the size of the output), what is wrong, and the share of times proved."""

    outside: float
    fault: str
    proved: float


def check(case: Case, order: int = 4, samples: int = 200) -> Found:
    """Bounds of a case against runs."""
    scene = case.scene
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.SymmbWarning)
        bounds = mb.propagate(scene, mb.TaylorModel(order=order))
        runs = mb.propagate(scene, mb.MonteCarlo(samples), solver=mb.DormandPrince(rtol=1e-12))
    size = np.maximum(np.abs(runs.upper).max(axis=0), 1e-3)
    off = np.maximum(bounds.lower - runs.lower, runs.upper - bounds.upper) / size
    finite, told = np.isfinite(bounds.upper), " ".join(bounds.doubts)
    names = list(scene.outputs)
    fault = ""
    if case.refused:
        k = names.index(case.refused)
        if finite[:, k].any() or f"infinite for {case.refused}" not in told:
            fault = f"{case.refused} is not refused by name: {told}"
        finite = np.delete(finite, k, axis=1)
    if not finite[0].all() or not (finite.all() or told):
        fault = fault or f"not proved: {told}"
    return Found(float(off.max()), fault, float(finite.mean()))


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 1000
    begin, proved, wrong = time.perf_counter(), [], 0
    for number in range(first, first + count):
        found = check(random_case(number))
        proved.append(found.proved)
        if found.outside > INSIDE or found.fault:
            wrong += 1
            print(f"seed {number}: outside by {found.outside:.1e} {found.fault}", flush=True)
    print(
        f"{count} scenes in {time.perf_counter() - begin:.0f} s: {wrong} wrong, {np.mean(proved):.0%} of times proved"
    )
