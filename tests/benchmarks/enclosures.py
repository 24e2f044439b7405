"""Proved bounds: excess of the width and time; and random equations against samples.

    PYTHONPATH=.:tests python tests/benchmarks/enclosures.py            the table
    PYTHONPATH=.:tests python tests/benchmarks/enclosures.py samples    200 random equations and the small scenes

The excess is the part of the width that is remainder, over the rest, the largest over outputs and times up to the one
given whose width is at least a hundredth of the largest.
"""

import argparse
import time
from dataclasses import replace

import casadi as ca
import numpy as np
from enclosure_samples import check, exact, ode
from enclosure_scenes import TEN, chain_of_four, duffing, pendulum, spherical_pendulum, van_der_pol

import symmb as mb
from models import andrews, double_pendulum, four_bar, slider_crank
from symmb.prove import enclose, problem_of
from symmb.run.simulation import DAESimulator

MOST = 5
"""Disputed samples of a problem that are redone in 50 digits, the worst first."""


def _double_pendulum(spread, end):
    scene = double_pendulum.scene()
    box = mb.Box.around(scene.system.parameters, spread)
    return mb.Scene(scene.system, scene.start, outputs=scene.outputs, times=np.linspace(0, end, 1 + int(20 * end)),
                    box=box, name=scene.name)  # fmt: skip


def _double_pendulum_of_eight(spread, end):
    """Two rods with uncertain lengths, masses, angles and rates at the start."""
    p = mb.Parameters(l1=1.0, l2=1.0, m1=1.0, m2=1.0, theta1=-np.pi / 4, theta2=-np.pi / 3, omega1=0.5, omega2=0.5)
    rod1 = mb.Body("rod1", mass=p.m1, inertia=p.m1 * p.l1**2 / 12)
    rod2 = mb.Body("rod2", mass=p.m2, inertia=p.m2 * p.l2**2 / 12)
    shoulder = mb.Revolute("shoulder", mb.Ground().point(0, 0), rod1.point(0, -p.l1 / 2))
    elbow = mb.Revolute("elbow", rod1.point(0, p.l1 / 2), rod2.point(0, -p.l2 / 2))
    system = mb.System(rod1, rod2, shoulder, elbow, mb.Gravity(0, 9.81), parameters=p)
    start = {"rod1.theta": p.theta1, "rod2.theta": p.theta2, "rod1.omega": p.omega1, "rod2.omega": p.omega2}
    return mb.Scene(system, start, np.linspace(0, end, 41), {"theta1": rod1.theta, "theta2": rod2.theta},
                    box=mb.Box.around(p, spread), name="double pendulum of 8")  # fmt: skip


def _loop(model, *names):
    """The cases of a model whose box has some parameters."""

    def make(spread, end):
        scene = model.scene()
        box = mb.Box.around(scene.system.parameters, spread, names=names)
        return mb.Scene(scene.system, scene.start, outputs=scene.outputs, times=np.linspace(0, end, 41), box=box,
                        name=scene.name, guess=scene.guess)  # fmt: skip

    return make


CASES = (
    (_loop(four_bar, "crank"), 0.005, 4.2, 8, 1, (1, 2, 4.2)),
    (_loop(slider_crank, "l1", "l2"), 0.005, 4.0, 8, 1, (1, 2, 4)),
    (_loop(slider_crank, "l1", "l2"), 0.02, 2.0, 10, 1, (1, 2)),
    (_loop(four_bar, "crank", "coupler", "rocker", "base"), 0.005, 2.0, 8, 1, (0.5, 1, 2)),
    (_loop(four_bar, "crank", "coupler", "rocker", "base"), 0.005, 1.0, 6, 1, (0.5, 1)),
    (_loop(four_bar, "crank", "coupler", "rocker", "base"), 0.005, 4.2, 8, 1, (2, 3, 4.2)),
    (_loop(slider_crank, "l1", "l2", "m1"), 0.005, 4.0, 6, 1, (1, 2, 4)),
    (_loop(slider_crank, "l1", "l2", "m1", "m2"), 0.005, 3.0, 5, 1, (1, 2, 3)),
    (_loop(slider_crank, "l1", "l2", "m1", "m2", "m3"), 0.005, 3.0, 5, 1, (1, 2, 3)),
    (_loop(andrews, "c0", "mom"), 0.001, 5e-3, 4, 1, (2e-3, 5e-3)),
    (_double_pendulum, 0.01, 10.0, 8, 1, (1, 3, 5, 10)),
    (_double_pendulum, 0.01, 10.0, 10, 1, (1, 3, 5, 10)),
    (_double_pendulum_of_eight, 0.01, 2.0, 4, 1, (1, 2)),
    (_double_pendulum, 0.05, 3.0, 10, 1, (1, 2, 3)),
    (_double_pendulum, 0.05, 3.0, 12, 1, (1, 2, 3)),
    (_double_pendulum, 0.05, 10.0, 8, 16, (3, 5, 7, 10)),
    (_double_pendulum, 0.05, 10.0, 8, 25, (3, 5, 7, 10)),
    (_double_pendulum, 0.05, 10.0, 10, 25, (3, 5, 7, 10)),
    (_double_pendulum, 0.05, 10.0, 8, 64, (3, 5, 7, 10)),
    (pendulum, 0.05, 10.0, 16, 1, (5, 10)),
    (van_der_pol, 0.05, 20.0, 8, 1, (10, 20)),
    (duffing, 0.05, 50.0, 6, 1, (25, 50)),
    (spherical_pendulum, 0.05, 5.0, 16, 1, (1, 3, 5)),
    (chain_of_four, 0.05, 20.0, 8, 1, (5, 10, 20)),
    (chain_of_four, 0.05, 20.0, 10, 1, (5, 10, 20)),
)


def table() -> None:
    print(f"{'scene':20} {'spread':>6} {'order':>5} {'boxes':>5} {'seconds':>8}  excess at times")
    for make, spread, end, order, boxes, times in CASES:
        scene = make(spread=spread, end=end).with_times(np.linspace(0, end, 41 if end < 1 else 1 + int(20 * end)))
        begin = time.process_time()
        problem = problem_of("benchmark", DAESimulator(scene), scene.box)
        found = enclose(problem, order, boxes)
        seconds = time.process_time() - begin
        width = found.upper - found.lower
        largest = np.where(np.isfinite(width), width, 0.0).max(axis=0)
        with np.errstate(all="ignore"):
            excess = 2 * found.remainder / (width - 2 * found.remainder)
        excess[width < 1e-2 * largest] = 0.0
        excess[~np.isfinite(width)] = np.inf
        parts = "  ".join(f"{t:g} s: {excess[problem.times <= t].max():.1e}" for t in times)
        end_of = f"  proved up to {found.until:.2f} s: {found.why}" if found.why else ""
        print(f"{scene.name:20} {spread:6} {order:5} {found.boxes:5} {seconds:8.1f}  {parts}{end_of}", flush=True)


def _random(seed: int):
    """Two or three states, two parameters, random smooth rates over intervals of random width."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 4))
    c = rng.uniform(-1.0, 1.0, (n, 9))

    def f(x, p, t):
        a, b, z = x[0], x[1], x[n - 1]
        features = [a, b, a * z, ca.sin(a + p[0]), ca.exp(-(b**2)), p[1] * z, a / (2 + ca.cos(b)), ca.cos(2 * t) * p[0],
                    ca.sqrt(1 + z**2)]  # fmt: skip
        return [sum(k * g for k, g in zip(row, features, strict=True)) for row in c]

    box = [(0.5, 0.5 + 10 ** rng.uniform(-3, -0.3)), (1.0, 1.0 + 10 ** rng.uniform(-3, -0.3))]
    return ode(f, lambda p: [0.5 * p[0], -0.3 + 0.2 * p[1], 0.1][:n], box, np.linspace(0, 1.5, 7))


def samples(count: int, equations: int) -> None:
    """Samples of the scenes and of random equations; those outside by more than their own errors in 50 digits."""
    total, lost, farthest, wrong = 0, 0, (-np.inf, ""), 0
    for k in range(equations + len(TEN)):
        if k < len(TEN):
            scene = TEN[k]()
            name, problem, order = scene.name, problem_of("benchmark", DAESimulator(scene), scene.box), 5
        else:
            name, problem, order = f"random equations {k}", _random(k), 3 + k % 5
        found = enclose(problem, order, 1)
        result = check(problem, found, count, seed=k)
        total, lost, farthest = total + count, lost + bool(found.why), max(farthest, (result.beyond, name))
        if k < len(TEN) or len(result.disputed):
            print(
                f"{name}: outside {result.outside:.1e}, less own errors {result.beyond:.1e} (own errors up to "
                f"{result.own:.1e}), filled {result.filled:.3f}, {len(result.disputed)} disputed"
                + (f"; proved up to {found.until:.2f} s: {found.why}" if found.why else ""),
                flush=True,
            )
        for p in result.disputed[:MOST]:
            times = np.flatnonzero(np.isfinite(found.upper).any(axis=1)).max() + 1
            Y = exact(replace(problem, times=problem.times[:times]), p)
            known, lower, upper = np.isfinite(found.upper[:times]), found.lower[:times], found.upper[:times]
            violation = max((lower - Y)[known].max(), (Y - upper)[known].max())
            wrong += violation > 0
            print(f"  in 50 digits outside by {float(violation):.1e}", flush=True)
        if k % 20 == 19:
            print(f"{total} samples", flush=True)
    print(
        f"{total} samples of {equations + len(TEN)} problems, {lost} of them lost before the end: outside by more than "
        f"their own errors at most {farthest[0]:.1e} of an output's size ({farthest[1]}); {wrong} wrong in 50 digits"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="?", default="table", choices=("table", "samples"))
    parser.add_argument("--count", type=int, default=5000, help="samples of each problem")
    parser.add_argument("--equations", type=int, default=200, help="random equations")
    options = parser.parse_args()
    table() if options.what == "table" else samples(options.count, options.equations)
