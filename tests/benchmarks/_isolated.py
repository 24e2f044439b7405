"""Work in processes of its own, so that nothing that hangs or crashes ends a benchmark."""

import multiprocessing
import time
from collections.abc import Callable, Iterable, Iterator
from multiprocessing.connection import Connection
from typing import TypeVar

T = TypeVar("T")

WORKERS = 2
"""Processes at a time."""


def outcomes(work: Callable[[int], T], numbers: Iterable[int], limit: float) -> Iterator[tuple[int, T | str]]:
    """Numbers and what the work returned for them; "hung" beyond the limit [s], "crashed" if a process died."""
    context = multiprocessing.get_context("fork")
    pending, running = list(numbers), {}
    while pending or running:
        while pending and len(running) < WORKERS:
            number = pending.pop(0)
            mine, theirs = context.Pipe(duplex=False)
            process = context.Process(target=_send, args=(work, number, theirs), daemon=True)
            process.start()
            theirs.close()
            running[number] = process, mine, time.monotonic()
        for number, (process, pipe, begin) in list(running.items()):
            try:
                if pipe.poll(0.02):
                    yield number, pipe.recv()
                elif time.monotonic() - begin > limit:
                    yield number, "hung"
                else:
                    continue
            except EOFError:
                yield number, "crashed"
            process.kill()
            process.join()
            del running[number]


def _send(work: Callable[[int], T], number: int, pipe: Connection) -> None:
    pipe.send(work(number))
