"""Results of tasks with the number of the task and a checksum: not every executor returns what it ran."""

import pickle
import threading
import zlib
from collections.abc import Callable, Container
from contextlib import suppress
from typing import Any

from symmb._cleanup import watch_parent
from symmb._errors import SimulationError

Numbered = tuple[int, Any]
"""A number and the item of a task."""
THREADS: dict[int, threading.Thread] = {}
"""Where tasks run, by their numbers, of this process."""


def reply(f: Callable[[Any], Any], k: int, item: Any) -> tuple[int, int, bytes]:
    """The number of a task, a checksum, and the result in bytes."""
    watch_parent()
    THREADS[k] = threading.current_thread()
    try:
        content = pickle.dumps(f(item), pickle.HIGHEST_PROTOCOL)
    finally:
        del THREADS[k]
    return k, zlib.crc32(content, k), content


def reply_to(f: Callable[[Any], Any], task: Numbered) -> tuple[int, int, bytes]:
    return reply(f, *task)


def opened(reply: Any, sent: Container[int]) -> tuple[int, Any]:
    """The number of a task that was sent, and its result."""
    with suppress(Exception):  # whatever it is, its comparison may raise
        k, checksum, content = reply
        if k in sent and zlib.crc32(content, k) == checksum:
            return k, pickle.loads(content)
    raise SimulationError("executor: it has returned something else than the results of its tasks, each once.")
