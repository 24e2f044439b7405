"""Interrupts of long work: a KeyboardInterrupt that has, in `partial`, what was found so far."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any


def carry(interrupt: KeyboardInterrupt, partial: Any) -> None:
    """Let an interrupt carry a result so far, in place of that of an inner part."""
    interrupt.partial = partial  # pyright: ignore[reportAttributeAccessIssue]


def partial_of(interrupt: KeyboardInterrupt) -> Any:
    """The result so far; None if there is none."""
    return getattr(interrupt, "partial", None)


def carry_runs(interrupt: KeyboardInterrupt, runs: list[Any]) -> None:
    """Let an interrupt carry runs of an integration, from which its caller makes a result."""
    interrupt.runs = runs  # pyright: ignore[reportAttributeAccessIssue]


def runs_of(interrupt: KeyboardInterrupt) -> list[Any]:
    """The runs of an integration so far."""
    return getattr(interrupt, "runs", [])


class Interrupts:
    """A context for calls that swallow interrupts, such as those of CasADi's integrators.

    Attributes
    ----------
    noticed : bool      whether SIGINT or SIGTERM arrived
    """

    def __init__(self) -> None:
        self.noticed = False
        self._previous: dict[int, Callable[[int, FrameType | None], Any]] = {}

    def __enter__(self) -> "Interrupts":
        if threading.current_thread() is threading.main_thread():  # only there do handlers run
            for number in (signal.SIGINT, signal.SIGTERM):
                handler = signal.getsignal(number)
                if callable(handler):
                    self._previous[number] = handler
                    signal.signal(number, self._notice)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)
        self._previous = {}

    def raise_with(self, runs: list[Any]) -> None:
        """KeyboardInterrupt that carries runs, if an interrupt arrived."""
        if self.noticed:
            interrupt = KeyboardInterrupt()
            carry_runs(interrupt, runs)
            raise interrupt

    def _notice(self, number: int, frame: FrameType | None) -> None:
        self.noticed = True
        self._previous[number](number, frame)  # what it raises may end the call at once


@contextmanager
def deferred_interrupts() -> Iterator[None]:
    """A context for short work that must not be interrupted: an interrupt that arrives is raised at its end."""
    arrived: list[tuple[int, FrameType | None]] = []
    previous: dict[int, Callable[[int, FrameType | None], Any]] = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            handler = signal.getsignal(number)
            if callable(handler):
                previous[number] = handler
                signal.signal(number, lambda *arguments: arrived.append(arguments))
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
        for number, frame in arrived:
            previous[number](number, frame)
