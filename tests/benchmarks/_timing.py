"""What the benchmarks share: pinned cores, medians, and the double pendulum's exact end."""

import os
import resource
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


def median(
    run: Callable[[], object], repeats: int = 5, calls: int = 1, clock: Callable[[], float] = time.process_time
) -> float:
    """Median seconds of a call after one that warms up; each of the repeats is the mean of several calls.

    By default those that the processor spent: on one core that nobody else uses they are those that passed, and others
    do not disturb them.
    """
    run()
    seconds = []
    for _ in range(repeats):
        begin = clock()
        for _ in range(calls):
            run()
        seconds.append((clock() - begin) / calls)
    return sorted(seconds)[repeats // 2]


def spent() -> float:
    """Processor seconds of this process and of the finished ones that it started, such as compilers."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime
