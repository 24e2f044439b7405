"""Interrupts of long work: a KeyboardInterrupt that has, in `partial`, what was found so far."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

Handler = Callable[[int, FrameType | None], Any]

SIGNALS = tuple(
    getattr(signal, f"SIG{name}") for name in ("INT", "TERM", "HUP", "QUIT") if hasattr(signal, f"SIG{name}")
)
"""Those that end the command line in order."""
_SWALLOW = {"casadi.py", "weakref.py", "_weakrefset.py"}
"""Files with functions that C code calls. C code ignores what they raise: CasADi reads shapes in this way, and Python
removes objects."""
_AGAIN = 1e-3
"""Time after which an interrupt that met such a function is sent again [s]."""


def carry(interrupt: KeyboardInterrupt, partial: Any) -> None:
    """Let an interrupt carry a result so far, in place of that of an inner part."""
    interrupt.partial = partial  # pyright: ignore[reportAttributeAccessIssue]


def carry_runs(interrupt: KeyboardInterrupt, runs: list[Any]) -> None:
    """Let an interrupt carry runs of an integration, from which its caller makes a result."""
    interrupt.runs = runs  # pyright: ignore[reportAttributeAccessIssue]


def runs_of(interrupt: KeyboardInterrupt) -> list[Any]:
    """The runs of an integration so far."""
    return getattr(interrupt, "runs", [])


@contextmanager
def _handlers(replaced: Callable[[Handler], Handler]) -> Iterator[dict[int, Handler]]:
    """A context in which other handlers of SIGNALS act. It knows those that act outside."""
    previous: dict[int, Handler] = {}
    if threading.current_thread() is threading.main_thread():  # only there do handlers run
        for number in SIGNALS:
            handler = signal.getsignal(number)
            if callable(handler):
                previous[number] = handler
                signal.signal(number, replaced(handler))
    try:
        yield previous
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


class _Repeated:
    """A handler that sends an interrupt again if it meets code that swallows it."""

    def __init__(self, handler: Handler) -> None:
        self.handler = handler.handler if isinstance(handler, _Repeated) else handler
        self.due = 0

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.due = 0
        while frame is not None:
            if Path(frame.f_code.co_filename).name in _SWALLOW or frame.f_code.co_name == "__del__":
                self.due = number
                threading.Timer(_AGAIN, self._again).start()
                return
            frame = frame.f_back
        self.handler(number, frame)

    def _again(self) -> None:
        if self.due:
            signal.raise_signal(self.due)

    def end(self) -> None:
        """Handle an interrupt that is still to be sent again."""
        if self.due:
            number, self.due = self.due, 0
            self.handler(number, None)


@contextmanager
def kept_interrupts() -> Iterator[None]:
    """A context, or a decorator, for work with CasADi's expressions, which would lose every tenth interrupt.

    It stands at all entrances to such work. Between them the handlers of the program act, which others ask for.
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


class Interrupts(ExitStack):
    """A context for calls that swallow interrupts, such as those of CasADi's integrators: `noticed` tells of one."""

    def __init__(self) -> None:
        super().__init__()
        self.noticed = False

    def __enter__(self) -> "Interrupts":
        self.enter_context(_handlers(self._noticing))
        return self

    def raise_with(self, runs: list[Any]) -> None:
        """KeyboardInterrupt that carries runs, if an interrupt arrived."""
        if self.noticed:
            interrupt = KeyboardInterrupt()
            carry_runs(interrupt, runs)
            raise interrupt

    def _noticing(self, handler: Handler) -> Handler:
        own = handler.handler if isinstance(handler, _Repeated) else handler

        def notice(number: int, frame: FrameType | None) -> None:
            self.noticed = True
            own(number, frame)  # what it raises may end the call at once

        return notice


@contextmanager
def deferred_interrupts() -> Iterator[None]:
    """A context for short work that must not be interrupted: an interrupt that arrives is raised at its end."""
    arrived: list[tuple[int, FrameType | None]] = []
    previous: dict[int, Handler] = {}
    try:
        with _handlers(lambda _: lambda *arguments: arrived.append(arguments)) as previous:
            yield
    finally:
        for number, frame in arrived:
            previous[number](number, frame)
