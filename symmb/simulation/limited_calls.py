"""Calls of a function that end in time: in a forked process, which is ended when a call takes too long."""

import atexit
import os
import signal
import threading
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

from symmb._cleanup import end_group, lead_group, note_group
from symmb._errors import DeclarationError, SimulationError, text_of
from symmb._interrupts import deferred_interrupts


@dataclass(frozen=True)
class _Worker:
    """A forked process, and this process' end of the pipe to it."""

    pid: int
    pipe: Connection

    def end(self) -> None:
        _WORKERS.discard(self)
        self.pipe.close()
        end_group(self.pid)
        with suppress(ChildProcessError):
            os.waitpid(self.pid, 0)


_WORKERS: set[_Worker] = set()


class LimitedCalls:
    """A function whose calls end after some seconds. Each thread has a process for its calls, which it keeps.

    The process is a copy of this one at its first call: what the function changes elsewhere, this one does not see.
    """

    def __init__(self, f: Callable[..., Any], seconds: float) -> None:
        if not hasattr(os, "fork"):
            raise DeclarationError("A timeout of functions needs a system that can fork processes.")
        self.f, self.seconds = f, seconds
        self._own = threading.local()

    def __reduce__(self) -> tuple[Any, ...]:
        return LimitedCalls, (self.f, self.seconds)

    def __call__(self, values: dict[str, float]) -> Any:
        """The result of f(**values).

        Raises
        ------
        SimulationError     if it takes too long, raises, or ends its process
        """
        worker: _Worker | None = getattr(self._own, "worker", None)
        if worker is None or worker not in _WORKERS:
            worker = self._own.worker = _fork(self.f)
        try:
            worker.pipe.send(values)
            if not worker.pipe.poll(self.seconds):
                worker.end()
                raise SimulationError(f"timed out: the function had not returned after {self.seconds:g} s")
            fault, result = worker.pipe.recv()
        except (EOFError, ConnectionError):
            status = _status(worker)
            raise SimulationError(f"the function ended its process{status}") from None
        except BaseException:  # an interrupt: the next call must not get this result
            worker.end()
            raise
        if fault:
            raise SimulationError(fault)
        return result


def _status(worker: _Worker) -> str:
    """How a process ended that is no longer there."""
    with suppress(ChildProcessError):
        code = os.waitstatus_to_exitcode(os.waitpid(worker.pid, 0)[1])
        worker.end()
        return f" by {signal.Signals(-code).name}" if code < 0 else f" with exit status {code}"
    worker.end()
    return ""


def _fork(f: Callable[..., Any]) -> _Worker:
    mine, theirs = Pipe()
    with deferred_interrupts(), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks beside threads: the child calls f alone
        pid = os.fork()
        if pid == 0:
            try:
                _serve(f, theirs, mine)
            finally:
                os._exit(0)
        theirs.close()
        worker = _Worker(pid, mine)
        _WORKERS.add(worker)
        note_group(pid)
    return worker


def _serve(f: Callable[..., Any], pipe: Connection, parents: Connection) -> None:
    """Call f for what arrives, until the parent is gone."""
    for connection in (parents, *(worker.pipe for worker in _WORKERS)):  # or else that end would never show
        connection.close()
    lead_group()
    while True:
        try:
            values = pipe.recv()
        except EOFError:
            return
        try:
            reply = "", f(**values)
        except BaseException as error:
            reply = text_of(error), None
        try:
            pipe.send(reply)
        except (TypeError, AttributeError, ValueError) as error:
            pipe.send((f"what the function returned cannot be sent: {text_of(error)}", None))


@atexit.register
def _end_all() -> None:
    for worker in list(_WORKERS):
        worker.end()
