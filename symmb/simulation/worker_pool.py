"""Processes that make runs for the command line."""

import time
from concurrent.futures import ProcessPoolExecutor

from symmb._cleanup import end_with_parent

_GRACE = 0.5
"""Time for processes to end what they have started [s]."""


class WorkerPool(ProcessPoolExecutor):
    """Processes of symmb's own: they end with this one, and leave nothing behind.

    Parameters
    ----------
    workers : how many
    """

    def __init__(self, workers: int) -> None:
        super().__init__(workers, initializer=end_with_parent)


def stop(pool: ProcessPoolExecutor) -> None:
    """End the processes of a pool, whatever they do."""
    processes = list((pool._processes or {}).values())
    pool.shutdown(wait=False)
    for process in processes:
        process.terminate()
    deadline = time.monotonic() + _GRACE
    for process in processes:
        process.join(max(deadline - time.monotonic(), 0.0))
        process.kill()  # it may be in compiled code, which notices no signals
