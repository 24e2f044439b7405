"""A line on the terminal that shows the progress of long work."""

import shutil
import sys
import time
from threading import Event, Thread
from types import TracebackType

_PATIENCE, _PERIOD = 1.0, 0.2
"""Time before the line appears, so that short work shows none, and time between two updates of it [s]."""


class Progress:
    """A context that keeps one line of stderr up to date. It writes nothing if stderr is not a terminal."""

    def __init__(self, label: str) -> None:
        self._text = label
        self._start = time.monotonic()
        self._stream = sys.stderr  # solvers redirect it for a moment
        self._done = Event()
        self._thread = Thread(target=self._watch, daemon=True)

    def __call__(self, label: str, done: int, total: int) -> None:
        """Set the text to the label of the work, the runs that are done and all its runs."""
        self._text = f"{label}: {done} of {total} runs"

    def __enter__(self) -> "Progress":
        if self._stream.isatty():
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._thread.is_alive():
            self._done.set()
            self._thread.join()

    def _watch(self) -> None:
        if self._done.wait(_PATIENCE):
            return
        while not self._done.wait(_PERIOD):
            width = shutil.get_terminal_size().columns - 1
            line = f"{time.monotonic() - self._start:5.0f} s  {self._text}"
            self._stream.write("\r" + line[:width].ljust(width))
            self._stream.flush()
        self._stream.write("\r\x1b[K")
        self._stream.flush()
