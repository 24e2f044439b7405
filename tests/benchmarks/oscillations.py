"""Bounds of oscillators over many periods, against random runs and all corners.

    PYTHONPATH=. python tests/benchmarks/oscillations.py [SEEDS ...]

Each seed draws a spring, a pendulum, two masses, a driven or a stopped oscillator, with or without damping, one to four
uncertain parameters and 10 to 400 periods. For each output: how far runs are beyond the bounds, how far the bounds are
beyond the runs, and the estimate, each the rms over time in percent of the width. Runs are a lower limit of the truth.
"""

import sys
import time
import warnings

import casadi as ca
import numpy as np

import symmb as mb

KINDS = {"spring": 0.3, "asymmetric": 0.2, "pendulum": 0.2, "stop": 0.1, "two masses": 0.1, "driven": 0.1}
SILENT = 0.5
"""Percent of the width, beyond the estimate, that count as missed in silence."""


def scene(rng: np.random.Generator) -> mb.Scene:
    """A random oscillator."""
    kind = str(rng.choice([*KINDS], p=[*KINDS.values()]))
    periods, spread, start = 10 * 40 ** rng.random(), 0.01 * 10 ** rng.random(), rng.uniform(0.05, 0.4)
    damping = rng.choice([0.0, 0.02 * 10 ** rng.random()])
    p = mb.Parameters(m=rng.uniform(0.5, 2), k=rng.uniform(50, 200), b=rng.uniform(0.1, 1), c=damping)
    names = rng.permutation([n for n in p if p[n] > 0])[: rng.integers(1, 5)]
    if kind == "pendulum":
        rod = mb.Body("rod", p.m, p.m * p.b**2 / 12)
        pin = mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(0, p.b / 2))
        parts = [rod, pin, mb.Torque("drag", rod, -0.1 * p.c * rod.omega), mb.Gravity(0, -p.k / 10)]
        period = 2 * np.pi * np.sqrt(2 * p["b"] / 3 / (p["k"] / 10))
        at, outputs = {"pin.angle": 5 * start}, {"x": pin.angle, "v": rod.omega}
    else:
        ball = mb.Body("ball", p.m, pose=mb.Particle())
        x, v = ball.x, ball.vx
        force = -p.k * x - p.c * v
        parts, at, outputs = [ball], {"ball.x": start}, {"x": x, "v": v, "energy": p.m * v**2 / 2 + p.k * x**2 / 2}
        if kind == "two masses":
            other = mb.Body("other", p.m, pose=mb.Particle())
            pull = 0.3 * p.k * (other.x - x)
            parts += [other, mb.Force("pull", other.point(0, 0), (-p.k * other.x - pull, 0))]
            force += pull
        added = {
            "spring": -2 * p.k * p.b * x**3,
            "asymmetric": -p.k * p.b * x**2,
            "stop": -20 * p.k * ca.fmax(x - 0.9 * start, 0),
            "driven": 0.3 * p.k * start * ca.cos(0.7 * np.sqrt(p["k"] / p["m"]) * mb.t),
        }
        parts.append(mb.Force("force", ball.point(0, 0), (force + added.get(kind, 0.0), 0)))
        period = 2 * np.pi * np.sqrt(p["m"] / p["k"])
    times = np.linspace(0.0, periods * period, int(periods * rng.uniform(12, 40)))
    box = mb.Box.around({str(n): p[str(n)] for n in names}, spread)
    return mb.Scene(mb.System(*parts, parameters=p), at, times, outputs, box=box, name=kind)


def main() -> None:
    warnings.simplefilter("ignore", mb.SymmbWarning)
    first, _, last = (sys.argv[1] if len(sys.argv) > 1 else "0-19").partition("-")
    counts, silent, needless = [], 0, 0
    for seed in range(int(first), int(last or first) + 1):
        drawn = scene(np.random.default_rng(seed))
        simulator, begin = mb.prepare(drawn), time.process_time()
        bounds = mb.propagate(simulator, mb.PolynomialChaos(), drawn.box)
        seconds = time.process_time() - begin
        runs = [mb.propagate(simulator, method, drawn.box) for method in (mb.MonteCarlo(3000), mb.Vertex())]
        lower, upper = np.min([b.lower for b in runs], axis=0), np.max([b.upper for b in runs], axis=0)

        def percent(values: np.ndarray, width: np.ndarray = upper - lower) -> np.ndarray:
            size = np.sqrt(np.square(width).mean(axis=0))
            part = np.sqrt(np.square(values).mean(axis=0))
            return 100 * np.divide(part, size, out=np.zeros_like(size), where=size > 0)

        missed = np.maximum(np.maximum(bounds.lower - lower, upper - bounds.upper), 0.0)
        beyond, told = np.maximum(np.maximum(lower - bounds.lower, bounds.upper - upper), 0.0), bounds.estimate
        is_silent = percent(np.maximum(missed - told, 0.0)) > SILENT
        is_needless = (percent(told) > 10) & (percent(np.maximum(missed, beyond)) < 5)
        silent, needless = silent + is_silent.sum(), needless + is_needless.sum()
        counts.append(bounds.evaluations)
        texts = (" ".join(f"{x:.2f}" for x in percent(each)) for each in (missed, beyond, told))
        cycles = f"{len(drawn.box)} parameters, {len(drawn.times)} times"
        words = " | ".join(texts) + (" SILENT" if is_silent.any() else "") + (" needless" if is_needless.any() else "")
        print(
            f"{seed} {drawn.name}: {cycles}, {bounds.evaluations} runs, {seconds:.1f} s, {bounds.range_of}: {words}",
            flush=True,
        )
    print(
        f"{len(counts)} oscillators: {np.median(counts):.0f} runs in the median, "
        f"{silent} silent, {needless} needless outputs"
    )


if __name__ == "__main__":
    main()
