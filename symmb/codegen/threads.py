"""Threads for compiled work."""

import ctypes
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from symmb.codegen.c_source import c_number

A = TypeVar("A")
R = TypeVar("R")


def cores() -> int:
    """Processors that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def side_by_side(work: Callable[[A], R], arguments: Sequence[A]) -> list[R]:
    """Results for all arguments. The first is computed in this thread, while others start."""
    first, *others = arguments
    if not others:
        return [work(first)]
    with ThreadPoolExecutor(len(others)) as pool:
        running = [pool.submit(work, argument) for argument in others]
        return [work(first), *(run.result() for run in running)]


def on_threads(work: Callable[[ctypes.c_long], object], n: int, seconds: float) -> None:
    """Call `work` once on each of several threads, with a common counter of n small pieces of work.

    An interrupt moves the counter to the end, so that threads take no more pieces. Work that takes a moment, as its
    seconds in one thread tell, is done in this thread.
    """
    counter = ctypes.c_long(0)
    if seconds <= _MOMENT:
        work(counter)
        return
    count = max(1, min(cores(), n // _FEWEST))
    with ThreadPoolExecutor(count) as pool:
        try:
            for run in [pool.submit(work, counter) for _ in range(count)]:
                run.result()
        except BaseException:
            counter.value = _STOPPED
            raise


_FEWEST = 128
"""Pieces of work for each additional thread: fewer take less time than the start of a thread."""
_MOMENT = 0.1
"""Seconds for which an interrupt may wait."""
_STOPPED = int(c_number("polynomial_ranges", "STOPPED"))
