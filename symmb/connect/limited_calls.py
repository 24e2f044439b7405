"""Calls of a function in a forked process: it may end there, and is ended when a call takes too long."""

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

_TICK = 0.2
"""Time between looks whether a process has ended [s]. Processes that it has started may keep its pipe open."""


class _Worker:
    """A forked process for calls of a thread, and this process' end of the pipe to it."""

    def __init__(self, pid: int, pipe: Connection) -> None:
        self.pid, self.pipe, self.thread = pid, pipe, threading.current_thread()
        self.caller: Callable[[], LimitedCalls | None] = lambda: None
        self.status: int | None = None

    @property
    def is_unused(self) -> bool:
        """Whether nobody will call again: the thread has ended, or what this thread has called is gone."""
        own = self.thread is threading.current_thread()
        return not self.thread.is_alive() or (own and self.caller() is None)

    def replies(self, seconds: float | None) -> bool:
        """Whether a reply arrives in time. It raises EOFError if the process ends without one."""
        deadline = inf if seconds is None else time.monotonic() + seconds
        while not self.pipe.poll(max(min(_TICK, deadline - time.monotonic()), 0.0)):
            if self.has_ended(os.WNOHANG) and not self.pipe.poll():
                raise EOFError
            if time.monotonic() >= deadline:
                return False
        return True

    def has_ended(self, options: int = 0) -> bool:
        """Whether the process has ended. Without options it is waited for."""
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
        """How the process ended, if that is known."""
        if self.status is None:
            return ""
        return f" by {signal_name(-self.status)}" if self.status < 0 else f" with exit status {self.status}"

    def end(self) -> None:
        with _LOCK:
            if self not in _WORKERS:  # another thread ends it, and its pipe may have the number of another file
                return
            _WORKERS.remove(self)
            self.pipe.close()
        end_groups(self.pid)
        self.has_ended()


_WORKERS: set[_Worker] = set()
_LOCK = threading.Lock()
"""Of pipes: a process that is forked while another thread opens or closes one would keep it open."""
_OWN = threading.local()
"""Workers of this thread, by the keys of what they call, which outlive a copy that was sent to this process."""


class LimitedCalls:
    """A function whose calls do no harm here. Each thread has a process for them, which it keeps.

    The process is a copy of this one at its first call: what the function changes elsewhere, this one does not see.

    Parameters
    ----------
    f : function of named values
    seconds : longest time of a call; None: no limit
    subject : what the function is called in messages
    base : where the function makes folders, if not where temporary files are
    key : that of the process, by default a new one
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
            raise DeclarationError(f"Calls of {subject} in their own process need a system that can fork processes.")
        self.f, self.seconds, self.subject, self.base = f, seconds, subject, base
        self.key = key or uuid.uuid4().hex

    def __reduce__(self) -> tuple[Any, ...]:
        return LimitedCalls, (self.f, self.seconds, self.subject, self.base, self.key)

    def __call__(self, values: dict[str, Any]) -> Any:
        """The result of f(**values). It raises SimulationError if it takes too long, raises, or ends its process."""
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
        except BaseException:  # also an interrupt: the next call must not get this result
            worker.end()
            raise
        if fault:
            raise SimulationError(fault)
        return result

    def end_process(self) -> None:
        """End the process of this thread. The next call gets a new one."""
        worker = vars(_OWN).get(self.key)
        if worker is not None:
            worker.end()

    def begin(self) -> _Worker:
        """The process of this thread, which removes what this one leaves behind, whatever ends it."""
        own: dict[str, _Worker] = vars(_OWN)
        worker = own.get(self.key)
        if worker is None or worker not in _WORKERS:
            for other in [other for other in list(_WORKERS) if other.is_unused]:
                other.end()
            worker = own[self.key] = _fork(self.f, self.base)
        worker.caller = weakref.ref(self)
        return worker


def fault_text(error: BaseException) -> str:
    """The fault of a run in one line: SimulationErrors are sentences, and of others the kind is told."""
    text = text_of(error)
    return text.removeprefix(f"{type(error).__name__}: ") if isinstance(error, SimulationError) else text


def end_calls_of(threads: Collection[threading.Thread]) -> None:
    """End the processes of calls that some threads make."""
    end_groups(*(worker.pid for worker in list(_WORKERS) if worker.thread in threads))


def signal_name(number: int) -> str:
    """The name of a signal. Those of real time have none."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _fork(f: Callable[..., Any], base: Path | None) -> _Worker:
    with deferred_interrupts(), _LOCK, warnings.catch_warnings():
        mine, theirs = Pipe()
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks beside threads: the child calls f alone
        pid = os.fork()
        if pid == 0:
            try:
                mine.close()  # or else its end would never show
                _serve(f, theirs)
            finally:
                os._exit(0)
        theirs.close()
        worker = _Worker(pid, mine)
        _WORKERS.add(worker)
        note_group(pid, base)
    return worker


def _serve(f: Callable[..., Any], pipe: Connection) -> None:
    """Call f for what arrives, until the parent is gone."""
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
            pipe.send((f"what the function returned cannot be sent: {text_of(error)}", None))


def _end_with_parent(pipe: Connection, parent: int) -> None:
    """End this process and what it has started when the parent is gone, whatever f is doing."""
    poll = select.poll()
    poll.register(pipe, 0)  # of no events but the end of the connection
    poll.poll()
    outlive(parent)


@atexit.register
def _end_all() -> None:
    for worker in list(_WORKERS):
        worker.end()


def _forget() -> None:
    """Let go of the parent's workers, in a process that was forked."""
    global _LOCK
    _LOCK = threading.Lock()  # a thread of the parent may have had it
    for worker in _WORKERS:
        worker.pipe.close()
    _WORKERS.clear()
    vars(_OWN).clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
