"""Proofs of random motions with drag that pass v = 0, against 10,000 runs each.

    PYTHONPATH=.:tests python tests/benchmarks/drag_proofs.py [--seed 0] [--number 6] [--runs 10000]

Pendulums and bodies that are thrown up, with three uncertain parameters: drag by abs(v) v, rounded as
v sqrt(v^2 + e^2), with tanh(v / e), with whole powers of abs(v), and along the speed in two directions. It prints how
far runs are outside of their bounds over the size of the output, which must be rounding, and at how many of the times
motions are proved.
"""

import argparse
import time
import warnings

import casadi as ca
import numpy as np

import symmb as mb

INSIDE = 1e-9
"""Error of runs over the size of an output."""


def laws(e):
    """Drag over its factor, of the speed along one axis."""
    return {
        "abs(v) v": lambda v: ca.fabs(v) * v,
        "v sqrt(v^2 + e^2)": lambda v: v * ca.sqrt(v**2 + e**2),
        "v^2 tanh(v / e)": lambda v: v**2 * ca.tanh(v / e),
        "abs(v)^2 v": lambda v: v * ca.fabs(v) ** 2,
        "sign(v) v^4": lambda v: ca.sign(v) * v**4,
    }


def scene_of(seed):
    """A random scene and its name: a pendulum, or a body that is thrown up, perhaps askew."""
    rng = np.random.default_rng(seed)
    e, kind = rng.uniform(0.1, 0.5), int(rng.integers(0, 3))
    name, law = list(laws(e).items())[seed % 5]
    p = mb.Parameters(m=rng.uniform(0.5, 2), c=rng.uniform(0.02, 0.3), v0=rng.uniform(1, 3) * rng.choice([-1, 1]))
    size = {"step": ca.fabs(p.c - 0.1)}
    if kind == 0:
        body = mb.Body("b", p.m, 0.1)
        hinge = mb.Revolute("h", mb.Ground().point(0, 0), body.point(-0.5, 0))
        system = mb.System(
            body, hinge, mb.Actuator("d", hinge, -p.c * law(hinge.angle_rate)), mb.Gravity(0, -9.81), parameters=p
        )
        start = {"h.angle": -np.pi / 2 + rng.uniform(-1, 1), "h.angle_rate": p.v0}
        outputs = {"x": hinge.angle, "v": hinge.angle_rate}
    else:
        body = mb.Body("b", p.m, pose=mb.Particle())
        drag = [law(v) for v in (body.vx, body.vy)]
        if kind == 2:
            name = "along the speed"
            speed = ca.sqrt(body.vx**2 + body.vy**2)
            drag = [speed * body.vx, speed * body.vy]
        system = mb.System(
            body, mb.Gravity(0, -9.81), mb.Force("d", body.point(0, 0), [-p.c * d for d in drag]), parameters=p
        )
        start = {"b.vx": p.v0, "b.vy": rng.uniform(2, 6)}
        outputs = {"x": body.x, "y": body.y, "v": body.vy}
    box = mb.Box.around(p, rng.uniform(0.005, 0.02))
    return name, mb.Scene(system, start, np.linspace(0.0, 1.0, 21), outputs | size, box)


def judged(scene, runs, seed):
    """How far runs are outside, and the share of times at which each output is proved."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.SymmbWarning)
        bounds = mb.propagate(scene, mb.TaylorModel(order=6, boxes=4))
        simulator = mb.DAESimulator(scene, mb.DormandPrince(rtol=1e-11))
    low, high = np.array(scene.box.bounds).T
    P = np.random.default_rng(seed).uniform(low, high, (runs, len(low)))
    P[:8] = [[(low, high)[k >> j & 1][j] for j in range(3)] for k in range(8)]
    Y = simulator.run(P).Y
    size = np.maximum(np.abs(Y).max(axis=(0, 1)), 1e-3)
    off = np.maximum(bounds.lower - Y.min(axis=0), Y.max(axis=0) - bounds.upper) / size
    return float(off.max()), np.isfinite(bounds.upper).mean(axis=0), bounds.doubts


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for option, default in (("seed", 0), ("number", 6), ("runs", 10_000)):
        parser.add_argument(f"--{option}", type=int, default=default)
    given = parser.parse_args()
    for seed in range(given.seed, given.seed + given.number):
        begin, (name, scene) = time.process_time(), scene_of(seed)
        off, proved, doubts = judged(scene, given.runs, seed)
        mark = "OUTSIDE" if off > INSIDE else "inside"
        shares = " ".join(f"{share:.0%}" for share in proved)
        print(
            f"{seed} {name}: {mark} by {off:.0e}, proved {shares}, {time.process_time() - begin:.0f} s",
            *doubts,
            flush=True,
        )
