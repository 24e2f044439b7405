"""Interrupts of long work. The attribute `partial` of a KeyboardInterrupt has the results so far."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType, FunctionType
from typing import Any

Handler = Callable[[int, FrameType | None], Any]

SIGNALS = tuple(
    getattr(signal, f"SIG{name}") for name in ("INT", "TERM", "HUP", "QUIT") if hasattr(signal, f"SIG{name}")
)
"""Signals at which the command line cleans up and ends."""
_SWALLOW = {"casadi.py", "weakref.py", "_weakrefset.py", "transforms.py"}
"""Files with functions that C code calls. C code ignores or replaces exceptions in these functions. CasADi calls them
to read shapes, Python to remove objects, and Matplotlib to read the boxes of drawings."""


def carry(interrupt: KeyboardInterrupt, partial: Any) -> None:
    """Attach the result so far to an interrupt, instead of the result of an inner part of the work."""
    interrupt.partial = partial  # pyright: ignore[reportAttributeAccessIssue]


def carry_runs(interrupt: KeyboardInterrupt, runs: list[Any]) -> None:
    """Attach runs of an integration to an interrupt. The caller makes a result from these runs."""
    interrupt.runs = runs  # pyright: ignore[reportAttributeAccessIssue]


def runs_of(interrupt: KeyboardInterrupt) -> list[Any]:
    """The runs that `carry_runs` has attached to an interrupt; an empty list without runs."""
    return getattr(interrupt, "runs", [])


@contextmanager
def _handlers(replaced: Callable[[Handler], Handler]) -> Iterator[dict[int, Handler]]:
    """A context in which other handlers of SIGNALS are active. It yields the former handlers by signal."""
    previous: dict[int, Handler] = {}
    interrupt = None
    try:
        if threading.current_thread() is threading.main_thread():  # handlers run in the main thread only
            for number in SIGNALS:
                handler = signal.getsignal(number)
                if callable(handler):
                    previous[number] = handler
                    signal.signal(number, replaced(handler))
        yield previous
    finally:
        while True:  # an interrupt at this time must not leave handlers of this context
            try:
                for number, handler in previous.items():
                    signal.signal(number, handler)
                break
            except BaseException as error:
                interrupt = error
        if interrupt is not None:
            raise interrupt


class _Repeated:
    """A handler that sends an interrupt again if the interrupted code would ignore the exception."""

    def __init__(self, handler: Handler) -> None:
        self.handler = handler.handler if isinstance(handler, _Repeated) else handler
        self.due, self._lock = 0, threading.Lock()

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.due = 0
        while frame is not None:
            if Path(frame.f_code.co_filename).name in _SWALLOW or frame.f_code.co_name == "__del__":
                self.due = number
                threading.Timer(1e-3, self._again).start()
                return
            frame = frame.f_back
        self.handler(number, frame)

    def _again(self) -> None:
        with self._lock:  # `end` waits until the signal is sent
            number, self.due = self.due, 0
            if number:
                signal.raise_signal(number)

    def end(self) -> None:
        """Handle an interrupt that has not been sent again yet."""
        with self._lock:
            number, self.due = self.due, 0
        if number:
            self.handler(number, None)


@contextmanager
def kept_interrupts() -> Iterator[None]:
    """A context or decorator for work with CasADi, which otherwise loses one of ten interrupts.

    All functions that start such work use this context, and so do all methods of results. Elsewhere, the signal
    handlers of the caller are active.
    """
    if isinstance(signal.getsignal(signal.SIGINT), _Repeated):
        yield
        return
    made: list[_Repeated] = []

    def repeated(handler: Handler) -> Handler:
        made.append(_Repeated(handler))
        return made[-1]

    try:
        with _handlers(repeated):
            yield
    finally:
        for each in made:
            each.end()


def keep_interrupts(kind: type) -> None:
    """Decorate the public methods of a class, and those of its bases in this package, with `kept_interrupts`."""
    package = __name__.partition(".")[0]
    for base in kind.__mro__:
        for name, method in list(vars(base).items()) if base.__module__.partition(".")[0] == package else ():
            is_of_class = isinstance(method, classmethod)
            function = method.__func__ if is_of_class else method
            is_public = name == "__call__" or not name.startswith("_")
            if is_public and isinstance(function, FunctionType) and not hasattr(function, "__wrapped__"):
                kept = kept_interrupts()(function)
                setattr(base, name, classmethod(kept) if is_of_class else kept)


class Interrupts(ExitStack):
    """A context for calls that ignore interrupts (CasADi's integrators). `noticed` is True after an interrupt."""

    def __init__(self) -> None:
        super().__init__()
        self.noticed = False

    def __enter__(self) -> "Interrupts":
        self.enter_context(_handlers(self._noticing))
        return self

    def raise_with(self, runs: list[Any]) -> None:
        """Raise a KeyboardInterrupt with the runs, if an interrupt arrived."""
        if self.noticed:
            interrupt = KeyboardInterrupt()
            carry_runs(interrupt, runs)
            raise interrupt

    def _noticing(self, handler: Handler) -> Handler:
        own = handler.handler if isinstance(handler, _Repeated) else handler

        def notice(number: int, frame: FrameType | None) -> None:
            self.noticed = True
            own(number, frame)  # an exception of this handler may end the call at once

        return notice


@contextmanager
def deferred_interrupts() -> Iterator[None]:
    """A context for short work without interrupts. An interrupt during this work is handled at the end."""
    arrived: list[tuple[int, FrameType | None]] = []
    previous: dict[int, Handler] = {}
    try:
        with _handlers(lambda _: lambda *arguments: arrived.append(arguments)) as previous:
            yield
    finally:
        for number, frame in arrived:
            previous[number](number, frame)
