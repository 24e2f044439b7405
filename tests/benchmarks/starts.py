"""Seconds of starts beside those of the runs that they belong to, of many samples, with a process busy on every core.

    starts.py [samples, 10000]

A start is a run that ends after a billionth of the time. The six-link arm starts from angles of its joints, Andrews'
mechanism and the Stewart platform from few coordinates, by Newton's method. Seconds pass on the clock and are spent by
the processor: threads that fight for cores take more of both.
"""

import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
from _timing import CORES, median, spent
from joint_coordinates import arm

import symmb as mb
from models import andrews

BASE, TOP, HEIGHT, LEG = 1.0, 0.6, 1.2, 0.5  # [m]
SPREAD, SHORT = 1e-3, 1e-9
"""Of the samples around the nominal parameters, and the share of the time after which a start ends."""


def ring(radius: float, spread: float) -> np.ndarray:
    """Three pairs of points on a circle, (6, 3)."""
    angles = np.radians([120 * (i // 2) + (spread if i % 2 else -spread) for i in range(6)])
    return radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])


def stewart() -> mb.Scene:
    """A platform on six legs with springs, each of two bodies: universal, prismatic and spherical joints."""
    p = mb.Parameters(mass=50.0, leg=2.0, stiffness=2e4, top=TOP)
    platform = mb.Body("platform", p.mass, (5.0, 5.0, 9.0), mb.Spatial())
    elements: list = [platform, mb.Gravity(0, 0, -9.81)]
    guess = {}
    for i, (foot, head) in enumerate(zip(ring(BASE, 50.0), ring(1.0, 20.0), strict=True)):
        along = np.array([0, 0, HEIGHT]) + TOP * head - foot
        length = np.linalg.norm(along)
        along /= length
        normal = np.array([-along[1], along[0], 0]) / np.hypot(*along[:2])
        inertia = (p.leg * LEG**2 / 12, p.leg * LEG**2 / 12, 1e-3)
        lower, upper = (mb.Body(f"{part}{i}", p.leg, inertia, mb.Spatial()) for part in ("lower", "upper"))
        base, hip = mb.Ground().point(*foot), platform.point(*(p.top * x for x in head))
        tip, toe = upper.point(0, 0, LEG / 2), lower.point(0, 0, -LEG / 2)
        elements += [
            lower,
            upper,
            mb.Universal(f"foot{i}", base, toe, axis=tuple(normal), axis_b=(-normal[1], normal[0], 0)),
            mb.Prismatic(f"slide{i}", lower.point(0, 0, 0), upper.point(0, 0, 0)),
            mb.Spherical(f"head{i}", tip, hip),
            mb.SpringDamper(f"spring{i}", base, hip, p.stiffness, length=float(length)),
        ]
        turn = mb.rotation((float(normal[0]), float(normal[1]), 0), float(np.arccos(along[2])))
        for body, place in ((lower, foot + LEG / 2 * along), (upper, foot + (length - LEG / 2) * along)):
            guess |= {f"{body.name}.{x}": float(r) for x, r in zip("xyz", place, strict=True)}
            guess[f"{body.name}.rotation"] = turn
    start = {
        "platform.x": 0.05,
        "platform.y": 0.0,
        "platform.z": HEIGHT,
        "platform.rotation": mb.rotation((0, 0, 1), 0),
    }
    outputs = {"x": platform.x, "z": platform.z}
    return mb.Scene(
        mb.System(*elements, parameters=p), start, [0.0, 1.0], outputs, guess=guess, name="Stewart platform"
    )


def run_seconds(simulator: mb.DAESimulator, samples: int) -> tuple[float, float]:
    """Seconds of runs that pass, and those that the processor spends."""
    nominal = np.array(list(simulator.parameters.values()))
    P = nominal * (1 + SPREAD * np.random.default_rng(0).uniform(-1, 1, (samples, len(nominal))))
    assert simulator.run(P[:8]).ok.all()
    return tuple(median(lambda: simulator.run(P).extremes(), 3, clock=clock) for clock in (time.perf_counter, spent))


def main() -> None:
    samples = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in CORES]
    try:
        for scene in (replace(arm(6, "joint"), name="arm of 6"), andrews.scene(), stewart()):
            begin, end = scene.times[0], scene.times[-1]
            solver = mb.DormandPrince()
            whole = mb.DAESimulator(scene.with_times([begin, end]), solver)
            short = mb.DAESimulator(scene.with_times([begin, begin + SHORT * (end - begin)]), solver)
            (wall, cpu), (wall_start, cpu_start) = (run_seconds(simulator, samples) for simulator in (whole, short))
            print(
                f"{scene.name:18} {whole.coordinates:6} runs {wall:8.2f} s, of the processor {cpu:8.2f} s; starts "
                f"{100 * wall_start / wall:5.1f} % and {100 * cpu_start / cpu:5.1f} %",
                flush=True,
            )
    finally:
        for process in busy:
            process.kill()
            process.wait()


if __name__ == "__main__":
    main()
