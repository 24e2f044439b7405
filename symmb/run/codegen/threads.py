"""Threads for compiled work."""

import ctypes
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from threading import Event, Thread
from typing import TypeVar

from symmb.run.codegen.c_source import c_number

A = TypeVar("A")
R = TypeVar("R")


def cores() -> int:
    """Processors that this process may run on, at most as many as threads can be started, which a user may limit.

    CasADi would end Python at a thread that cannot be started.
    """
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    end, threads = Event(), list[Thread]()
    try:
        with suppress(RuntimeError):
            for _ in range(count):
                thread = Thread(target=end.wait, daemon=True)
                thread.start()
                threads.append(thread)
    finally:
        end.set()
    for thread in threads:
        thread.join()
    return max(1, len(threads))


def side_by_side(work: Callable[[A], R], arguments: Sequence[A]) -> list[R]:
    """Results for all arguments. The first is computed in this thread, as are those for which no thread can start."""
    first, *others = arguments
    if not others:
        return [work(first)]
    with ThreadPoolExecutor(len(others)) as pool:
        running = _started(pool, work, others)
        results = [work(first), *(run.result() for run in running)]
    return [*results, *map(work, others[len(running) :])]


def _started(pool: ThreadPoolExecutor, work: Callable[[A], R], arguments: Sequence[A]) -> list["Future[R]"]:
    """Work on threads, for as many arguments as threads can be started."""
    running: list[Future[R]] = []
    with suppress(RuntimeError):
        for argument in arguments:
            running.append(pool.submit(work, argument))
    return running


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
            running = _started(pool, work, [counter] * count)
            for run in running:
                run.result()
            if not running:
                work(counter)
        except BaseException:
            counter.value = _STOPPED
            raise


_FEWEST = 128
"""Pieces of work for each additional thread: fewer take less time than the start of a thread."""
_MOMENT = 0.1
"""Seconds for which an interrupt may wait."""
_STOPPED = int(c_number("polynomial_ranges", "STOPPED"))
