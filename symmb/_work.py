"""Computing work, estimated from the sizes of arrays. Unlike a time, it does not depend on the load of the machine."""

import threading

_done = threading.local()


def count_work(nanoseconds: float) -> None:
    """Add work of this thread: about this time on one core of 2025 [ns]."""
    _done.work = work_done() + nanoseconds


def work_done() -> float:
    """All work of this thread so far [ns]."""
    return getattr(_done, "work", 0.0)
