"""What the benchmarks share: pinned cores, medians, and the double pendulum's exact end."""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

CORES = sorted(os.sched_getaffinity(0))
END = (0.504901167089, 0.911557923320)
"""Angles of the double pendulum's rods at 10 s [rad]."""


def pin(cores: int = 1) -> None:
    """Keep this thread, and those it starts from now on, on so many cores."""
    os.sched_setaffinity(0, CORES[-cores:])


def median(run: Callable[[], object], repeats: int = 5, calls: int = 1) -> float:
    """Median seconds of a call after one that warms up; each of the repeats is the mean of several calls."""
    run()
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        for _ in range(calls):
            run()
        seconds.append((time.perf_counter() - begin) / calls)
    return sorted(seconds)[repeats // 2]
