"""Bounds over one parameter of random scenes with impacts, against 8,001 runs.

    PYTHONPATH=. python tests/benchmarks/one_parameter_impacts.py [--seeds 0-4] [--tolerance 1e-2]

For each scene: the worst error of an output over its width, the estimate over the error, the share of times at which
the bounds miss the true range by more than the estimate and 1 % of the width (silent), the share of times with a
needless doubt (the true error is less than half of the estimate), runs, and processor seconds of `propagate`.
"""

import argparse
import time
import warnings
from collections.abc import Callable, Iterator

import numpy as np
from everyday_machines import NEEDLESS, SILENT, doubtful_times, windowed

import symmb as mb
from symmb.bound.responses.time_windows import rms

RUNS = 8001
Made = tuple[str, mb.Scene]


def _scene(name: str, rng: np.random.Generator, p: mb.Parameters, system: mb.System, **details: object) -> Made:
    """The scene with a box of one random parameter, 1 to 20 % on each side."""
    varied = str(rng.choice(list(p)))
    percent = float(rng.choice([1.0, 3.0, 10.0, 20.0]))
    box = mb.Box.around({varied: system.parameters[varied]}, f"{percent}%")
    return f"{name}, {varied} {percent:g} %", mb.Scene(system, box=box, **details)  # pyright: ignore[reportArgumentType]


def drop(rng: np.random.Generator) -> Made:
    """A ball that bounces on a floor."""
    p = mb.Parameters(e=rng.uniform(0.3, 0.8), height=rng.uniform(0.3, 2.0), g=9.81)
    ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    system = mb.System(ball, mb.Gravity(0, -p.g), mb.Impact("floor", ball.y, p.e), parameters=p)
    times, outputs = np.linspace(0, rng.uniform(1, 3), 301), {"y": ball.y, "rate": ball.vy}
    return _scene("drop", rng, p, system, start={"ball.y": p.height}, times=times, outputs=outputs)


def walls(rng: np.random.Generator) -> Made:
    """A mass on a spring between two walls."""
    p = mb.Parameters(
        stiffness=rng.uniform(5, 40), gap=rng.uniform(0.1, 0.3), e=rng.uniform(0.3, 0.8), speed=rng.uniform(1, 3)
    )
    ground, mass = mb.Ground(), mb.Body("mass", mass=1.0, pose=mb.Particle())
    spring = mb.Bushing("spring", ground.point(0, 0), mass.point(0, 0), (p.stiffness, p.stiffness, 0), (0.1, 0.1, 0))
    low, high = mb.Impact("low", mass.x + p.gap, p.e), mb.Impact("high", p.gap - mass.x, p.e)
    system = mb.System(mass, spring, low, high, parameters=p)
    times, outputs = np.linspace(0, 2, 301), {"x": mass.x, "rate": mass.vx}
    return _scene("walls", rng, p, system, start={"mass.vx": p.speed}, times=times, outputs=outputs)


def pendulum(rng: np.random.Generator) -> Made:
    """A pendulum that strikes a wall beside its hinge."""
    p = mb.Parameters(length=rng.uniform(0.5, 1.5), e=rng.uniform(0.4, 0.8), angle=rng.uniform(0.3, 1.2), g=9.81)
    ground = mb.Ground()
    bob = mb.Body("bob", mass=1.0, inertia=0.01, com=(p.length, 0))
    hinge = mb.Revolute("hinge", ground.point(0, 0), bob.point(0, 0))
    wall = mb.Impact("wall", hinge.angle + np.pi / 2 + 0.1, p.e)
    system = mb.System(bob, hinge, mb.Gravity(0, -p.g), wall, parameters=p)
    start = {"hinge.angle": p.angle - np.pi / 2}
    tip = bob.point(p.length, 0)
    times, outputs = np.linspace(0, 3, 301), {"x": tip.x, "angle": hinge.angle, "rate": hinge.angle_rate}
    return _scene("pendulum", rng, p, system, start=start, times=times, outputs=outputs)


def stack(rng: np.random.Generator) -> Made:
    """Two balls, one above the other, that fall on a floor."""
    p = mb.Parameters(
        e=rng.uniform(0.5, 0.8), low=rng.uniform(0.5, 1.0), gap=rng.uniform(0.05, 0.5), mass=rng.uniform(0.1, 2)
    )
    first, second = mb.Body("first", mass=1.0, pose=mb.Particle()), mb.Body("second", mass=p.mass, pose=mb.Particle())
    floor, between = mb.Impact("floor", first.y, p.e), mb.Impact("between", second.y - first.y, p.e)
    system = mb.System(first, second, mb.Gravity(0, -9.81), floor, between, parameters=p)
    start = {"first.y": p.low, "second.y": p.low + p.gap}
    times, outputs = np.linspace(0, 1.2, 301), {"first": first.y, "second": second.y, "rate": second.vy}
    return _scene("stack", rng, p, system, start=start, times=times, outputs=outputs)


FAMILIES: tuple[Callable[[np.random.Generator], Made], ...] = (drop, walls, pendulum, stack)


def scenes(seed: int) -> Iterator[Made]:
    """Three scenes of each family."""
    for k, family in enumerate(FAMILIES):
        for j in range(3):
            yield family(np.random.default_rng([seed, k, j]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="0-4")
    parser.add_argument("--tolerance", type=float, default=1e-2)
    options = parser.parse_args()
    warnings.simplefilter("ignore", mb.SymmbWarning)
    first, last = map(int, options.seeds.split("-"))
    table = []
    for seed in range(first, last + 1):
        for name, scene in scenes(seed):
            simulator = mb.prepare(scene)
            truth = mb.propagate(simulator, mb.Scanning(RUNS), scene.box)
            begin = time.process_time()
            bounds = mb.propagate(simulator, mb.PolynomialChaos(tolerance=options.tolerance), scene.box)
            seconds = time.process_time() - begin
            low, high = np.minimum(truth.lower, bounds.inner[0]), np.maximum(truth.upper, bounds.inner[1])
            width, doubted = rms(high - low), doubtful_times(bounds)
            deviation = np.maximum(np.abs(bounds.lower - low), np.abs(bounds.upper - high))
            beyond = np.maximum(bounds.outer[0] - low, high - bounds.outer[1])
            silent = (beyond > SILENT * width) & ~doubted
            needless = doubted & (windowed(deviation) < NEEDLESS * windowed(bounds.estimate))
            errors, estimates = (
                np.divide(rms(a), width, out=np.zeros_like(width), where=width > 0)
                for a in (deviation, bounds.estimate)
            )
            true, told = errors.max(), estimates[errors.argmax()]
            table.append((true, told / max(true, 1e-12), silent.mean(), needless.mean(), bounds.evaluations, seconds))
            print(
                f"{seed} {name:24s} {bounds.evaluations:5d} runs {seconds:5.2f} s  error {true:.1e}  told {told:.1e}  "
                f"silent {100 * silent.mean():4.1f} %  needless {100 * needless.mean():4.1f} %  {bounds.range_of}",
                flush=True,
            )
    error, ratio, silent, needless, runs, seconds = np.array(table).T
    print(
        f"{len(table)} scenes: error {np.median(error):.1e}, worst {error.max():.1e}; estimate over error "
        f"{np.median(ratio):.1f}; silent {100 * silent.mean():.2f} % of times, needless {100 * needless.mean():.2f} %; "
        f"runs {np.median(runs):.0f}, most {runs.max():.0f}; {np.median(seconds):.2f} s, most {seconds.max():.2f} s"
    )


if __name__ == "__main__":
    main()
