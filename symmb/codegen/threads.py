"""Threads for compiled work."""

import ctypes
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

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


def on_threads(work: Callable[[ctypes.c_long], object], n: int) -> None:
    """Call `work` once on each of several threads, with a common counter of n small pieces of work."""
    side_by_side(work, [ctypes.c_long(0)] * max(1, min(cores(), n // _FEWEST)))


_FEWEST = 128
"""Pieces of work for each additional thread: fewer take less time than the start of a thread."""
