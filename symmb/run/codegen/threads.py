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
    """Number of processors for this process, but at most the number of threads that the process can start."""
    # Threads are started to find the limit, because CasADi ends Python if a thread cannot be started.
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
    """Results for all arguments, from several threads. The calling thread computes those without a thread."""
    first, *others = arguments
    if not others:
        return [work(first)]
    with ThreadPoolExecutor(len(others)) as pool:
        running = _started(pool, work, others)
        results = [work(first), *(run.result() for run in running)]
    return [*results, *map(work, others[len(running) :])]


def _started(pool: ThreadPoolExecutor, work: Callable[[A], R], arguments: Sequence[A]) -> list["Future[R]"]:
    """Futures of `work`, one for each of the first arguments, until no thread can be started."""
    running: list[Future[R]] = []
    with suppress(RuntimeError):
        for argument in arguments:
            running.append(pool.submit(work, argument))
    return running


def on_threads(work: Callable[[ctypes.c_long], object], n: int, seconds: float) -> None:
    """Call `work` once on each of several threads, with a common counter of n small pieces of work.

    `seconds` is the expected time of the work in one thread. The calling thread does short work alone.
    """
    counter = ctypes.c_long(0)
    if seconds <= 0.1:  # Python handles interrupts only after this call of C
        work(counter)
        return
    count = max(1, min(cores(), n // 128))  # fewer pieces take less time than the start of a thread
    with ThreadPoolExecutor(count) as pool:
        try:
            running = _started(pool, work, [counter] * count)
            for run in running:
                run.result()
            if not running:
                work(counter)
        except BaseException:
            counter.value = _STOPPED  # threads take no more pieces, so that the pool can be left at once
            raise


_STOPPED = int(c_number("polynomial_ranges", "STOPPED"))
