"""Calls of a function in a forked process. The function may crash, and a call that takes too long is ended."""

import atexit
import os
import select
import signal
import threading
import time
import uuid
import warnings
import weakref
from collections.abc import Callable, Collection
from math import inf
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from symmb._cleanup import end_groups, lead_group, note_group, outlive
from symmb._errors import DeclarationError, SimulationError, text_of
from symmb._interrupts import deferred_interrupts


class _Worker:
    """A forked process for the calls of one thread, and the end of its pipe in the parent."""

    def __init__(self, pid: int, pipe: Connection) -> None:
        self.pid, self.pipe, self.thread = pid, pipe, threading.current_thread()
        self.caller: Callable[[], LimitedCalls | None] = lambda: None
        self.status: int | None = None

    @property
    def is_unused(self) -> bool:
        """Whether no more calls can follow: the thread has ended, or the called object no longer exists."""
        own = self.thread is threading.current_thread()
        return not self.thread.is_alive() or (own and self.caller() is None)

    def replies(self, seconds: float | None) -> bool:
        """Whether a reply arrives in time. EOFError is raised if the process ends without a reply."""
        deadline = inf if seconds is None else time.monotonic() + seconds
        # Time between checks whether a process has ended [s]. Processes that it has started may keep its pipe open.
        while not self.pipe.poll(max(min(0.2, deadline - time.monotonic()), 0.0)):
            # A process may reply and end between the two checks, so the pipe is polled once more.
            if self.has_ended(os.WNOHANG) and not self.pipe.poll():
                raise EOFError
            if time.monotonic() >= deadline:
                return False
        return True

    def has_ended(self, options: int = 0) -> bool:
        """Whether the process has ended. By default, this function waits for the end."""
        if self.status is None:
            try:
                pid, status = os.waitpid(self.pid, options)
            except ChildProcessError:  # another part of the program has waited for it
                return True
            if pid == 0:
                return False
            self.status = os.waitstatus_to_exitcode(status)
        return True

    @property
    def end_text(self) -> str:
        """Words that say how the process ended, if this is known."""
        if self.status is None:
            return ""
        return f" by {signal_name(-self.status)}" if self.status < 0 else f" with exit status {self.status}"

    def end(self) -> None:
        with _LOCK:
            if self not in _WORKERS:  # another thread has already ended the process and closed its pipe
                return
            _WORKERS.remove(self)
            self.pipe.close()
        end_groups(self.pid)
        self.has_ended()


_WORKERS: set[_Worker] = set()
_LOCK = threading.Lock()
"""The lock of pipes. A process that is forked while another thread opens or closes a pipe would keep the pipe open."""
_OWN = threading.local()
"""Workers of this thread by key. A `LimitedCalls` that was pickled and loaded in this process finds its worker here."""


class LimitedCalls:
    """A function whose calls run in a separate process. Each thread uses its own process for all its calls.

    The process is a copy of this process at the first call. Later changes of variables in one process have no effect in
    the other.

    Parameters
    ----------
    f : function with keyword arguments
    seconds : longest time of a call [s]; None: no limit
    subject : name of the function in messages
    base : folder in which the function makes folders; default: the folder for temporary files
    key : key of the process; default: a new key
    """

    def __init__(
        self,
        f: Callable[..., Any],
        seconds: float | None,
        subject: str = "the function",
        base: Path | None = None,
        key: str | None = None,
    ) -> None:
        if not hasattr(os, "fork"):
            raise DeclarationError(f"Calls of {subject} in a separate process need fork. Windows has no fork.")
        self.f, self.seconds, self.subject, self.base = f, seconds, subject, base
        self.key = key or uuid.uuid4().hex

    def __reduce__(self) -> tuple[Any, ...]:
        return LimitedCalls, (self.f, self.seconds, self.subject, self.base, self.key)

    def __call__(self, values: dict[str, Any]) -> Any:
        """The result of f(**values). SimulationError is raised if f takes too long, raises, or ends its process."""
        worker = self.begin()
        try:
            worker.pipe.send(values)
            if not worker.replies(self.seconds):
                raise SimulationError(f"timed out: {self.subject} had not returned after {self.seconds:g} s")
            fault, result = worker.pipe.recv()
        except (EOFError, ConnectionError):
            worker.has_ended()
            worker.end()
            raise SimulationError(f"{self.subject} ended its process{worker.end_text}") from None
        except BaseException:  # also an interrupt: the next call must not receive this result
            worker.end()
            raise
        if fault:
            raise SimulationError(fault)
        return result

    def end_process(self) -> None:
        """End the process of this thread. The next call starts a new process."""
        worker = vars(_OWN).get(self.key)
        if worker is not None:
            worker.end()

    def begin(self) -> _Worker:
        """The worker of this thread. If the worker's process ends for any reason, its temporary folders are removed."""
        own: dict[str, _Worker] = vars(_OWN)
        worker = own.get(self.key)
        if worker is None or worker not in _WORKERS:
            for other in [other for other in list(_WORKERS) if other.is_unused]:
                other.end()
            worker = own[self.key] = _fork(self.f, self.base)
        # A weak reference: the process ends when no object can call it any more.
        worker.caller = weakref.ref(self)
        return worker


def fault_text(error: BaseException) -> str:
    """The error of a run as text in one line. If it is not a SimulationError, the text has the type too."""
    text = text_of(error)
    return text.removeprefix(f"{type(error).__name__}: ") if isinstance(error, SimulationError) else text


def end_calls_of(threads: Collection[threading.Thread]) -> None:
    """End the processes in which the calls of some threads run."""
    end_groups(*(worker.pid for worker in list(_WORKERS) if worker.thread in threads))


def signal_name(number: int) -> str:
    """The name of a signal. Real-time signals have no name."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _fork(f: Callable[..., Any], base: Path | None) -> _Worker:
    with deferred_interrupts(), _LOCK, warnings.catch_warnings():
        mine, theirs = Pipe()
        warnings.simplefilter("ignore", DeprecationWarning)  # Python warns of forks in threads: the child only calls f
        pid = os.fork()
        if pid == 0:
            try:
                mine.close()  # otherwise the end of the child could not be detected
                _serve(f, theirs)
            finally:
                os._exit(0)
        theirs.close()
        worker = _Worker(pid, mine)
        _WORKERS.add(worker)
        note_group(pid, base)
    return worker


def _serve(f: Callable[..., Any], pipe: Connection) -> None:
    """Call f for each message of the parent, until the parent has ended."""
    lead_group()
    end = threading.Thread(target=_end_with_parent, args=(pipe, os.getppid()), daemon=True)
    end.start()
    while True:
        try:
            values = pipe.recv()
        except EOFError:
            end.join()  # the parent may have left folders
            return
        try:
            reply = "", f(**values)
        except BaseException as error:
            reply = fault_text(error), None
        try:
            pipe.send(reply)
        except (TypeError, AttributeError, ValueError) as error:
            pipe.send((f"the value that the function returned cannot be sent: {text_of(error)}", None))


def _end_with_parent(pipe: Connection, parent: int) -> None:
    """Wait for the end of the parent. Then end this process and the programs that it started, even while f runs."""
    poll = select.poll()
    poll.register(pipe, 0)  # only the end of the connection is reported
    poll.poll()
    outlive(parent)


@atexit.register
def _end_all() -> None:
    for worker in list(_WORKERS):
        worker.end()


def _forget() -> None:
    """Close the parent's workers in a forked process."""
    global _LOCK
    _LOCK = threading.Lock()  # a thread of the parent may have held the old lock
    for worker in _WORKERS:
        worker.pipe.close()
    _WORKERS.clear()
    vars(_OWN).clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
