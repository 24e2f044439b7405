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
from models import andrews, stewart_platform

SPREAD, SHORT = 1e-3, 1e-9
"""Of the samples around the nominal parameters, and the share of the time after which a start ends."""


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
        for scene in (replace(arm(6, "joint"), name="arm of 6"), andrews.scene(), stewart_platform.scene()):
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
