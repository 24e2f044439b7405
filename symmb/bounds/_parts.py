"""Many independent polynomials dealt to threads, for compiled loops."""

import ctypes
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

_FEWEST = 128
"""Polynomials for which a thread pays."""


def on_threads(work: Callable[[ctypes.c_long], object], m: int) -> None:
    """Call work once on each of several threads, with the counter by which they deal themselves m polynomials."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    dealt, threads = ctypes.c_long(0), min(cores, m // _FEWEST)
    if threads < 2:
        work(dealt)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, [dealt] * threads))
