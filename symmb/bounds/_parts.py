"""Many independent polynomials dealt to threads, for compiled loops."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

_FEWEST = 1024
"""Polynomials for which a thread pays."""


def in_parts(work: Callable[[slice], object], m: int, multiple: int = 1) -> None:
    """Call work for parts of range(m), side by side; parts begin at multiples."""
    threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    size = -(-max(_FEWEST, -(-m // (4 * threads))) // multiple) * multiple  # some for each, as they differ in work
    parts = [slice(start, min(start + size, m)) for start in range(0, m, size)]
    if min(threads, len(parts)) < 2:
        for part in parts:
            work(part)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, parts))
