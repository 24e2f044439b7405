"""The progress of long work, shown by tqdm in terminals and notebooks as one line that is updated."""

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import TracebackType
from typing import Any, ClassVar

_PATIENCE, _PERIOD = 1.0, 0.2
"""Time before the bar appears, and time between two updates of the bar [s]. Short work shows no bar."""
_UNKNOWN = "{desc} [{elapsed}]"
_KNOWN = "{{desc}} |{{bar:12}}| {{n_fmt}} of {{total_fmt}} {} [{{elapsed}}, {{remaining}} left, {{rate_fmt}}]"
"""Formats of a bar: the first if the number of runs is unknown, the second if the number is known."""

_REACHED = ", estimated error "
"""The separator between the name of a method and the error that the method has reached."""


class Progress:
    """A context that shows how much of the work is done, the speed, and the remaining time.

    Each call passes the label of the work, the number of finished runs and the number of all runs. The clock also runs
    between two calls, for example while equations are derived and compiled. Nested work has no bar of its own.
    """

    _outermost: ClassVar["Progress | None"] = None

    def __init__(self, label: str, unit: str = "runs") -> None:
        self._text, self._done, self._total, self._unit = label, 0, 0, unit
        self._stream = sys.stderr  # solvers redirect sys.stderr temporarily
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self.is_shown = self._stream is not None and (_in_notebook() or self._stream.isatty())

    def __call__(self, label: str, done: int, total: int) -> None:
        self._text, self._done, self._total = label, done, total

    def __enter__(self) -> "Progress":
        if self.is_shown and not os.environ.get("TQDM_DISABLE") and Progress._outermost is None:
            Progress._outermost = self
            with suppress(RuntimeError):  # the thread may fail to start
                self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._thread.is_alive():
            self._end.set()
            self._thread.join()
        if Progress._outermost is self:
            Progress._outermost = None

    def _watch(self) -> None:
        if self._end.wait(_PATIENCE):
            return
        bar, label = None, ""
        while True:
            text, done, total = self._text, self._done, self._total
            if bar is None or text.partition(_REACHED)[0] != label or done < bar.n:  # the rate of other work differs
                if bar is not None:
                    bar.close()
                bar, label = _new_bar(self._stream, done, self._unit), text.partition(_REACHED)[0]
            bar.total, bar.bar_format = total or None, _KNOWN.format(self._unit) if total else _UNKNOWN
            bar.set_description_str(text, refresh=False)
            bar.n = done
            bar.refresh()
            if self._end.wait(_PERIOD):
                bar.close()
                return


@contextmanager
def shown(
    progress: Callable[[str, int, int], None] | None, label: str, unit: str = "runs"
) -> Iterator[Callable[[str, int, int], None] | None]:
    """The function that receives the progress: the caller's own function, or a bar in a terminal or notebook."""
    if progress is not None:
        yield progress
        return
    with Progress(label, unit) as own:
        yield own if own.is_shown else None


class RunProgress:
    """Progress of one method: the finished runs, all runs, and the error that the method has reached."""

    def __init__(self, show: Callable[[str, int, int], None], label: str) -> None:
        self._show, self._label, self._reached = show, label, ""

    def estimate(self, error: float) -> None:
        """Note the estimated error."""
        self._reached = f"{_REACHED}{error:.0e}"

    def __call__(self, done: int, total: int) -> None:
        self._show(self._label + self._reached, done, total)


@contextmanager
def shown_runs(
    progress: Callable[[int, int], None] | None, label: str, unit: str = "runs"
) -> Iterator[Callable[[int, int], None] | None]:
    """Progress of a single method. The method reports its runs, or other units of work, without a label."""
    if progress is not None:
        yield progress
        return
    with shown(None, label, unit) as bar:
        yield bar and RunProgress(bar, label)


def _new_bar(stream: Any, done: int, unit: str) -> Any:
    from tqdm import tqdm

    file = _CellLine.of_cell() if _in_notebook() else stream
    tqdm.set_lock(threading.RLock())  # tqdm's own lock is shared with other processes, which show no bars
    tqdm.monitor_interval = 0
    return tqdm(file=file, initial=done, leave=False, dynamic_ncols=True, unit=f" {unit}", disable=False)


class _CellLine:
    """A file with a last line that is shown below a cell of a notebook. All bars of the cell share the file.

    Exported notebooks show all lines of the standard error, one below the other. So this line is empty at the end.
    """

    _last: ClassVar["tuple[int, _CellLine] | None"] = None

    def __init__(self) -> None:
        self._handle: Any = None

    @classmethod
    def of_cell(cls) -> "_CellLine":
        """The `_CellLine` of the cell that runs now."""
        number = sys.modules["IPython"].get_ipython().execution_count
        if cls._last is None or cls._last[0] != number:
            cls._last = number, cls()
        return cls._last[1]

    def write(self, text: str) -> None:
        """Replace the line."""
        data = {"text/plain": text.strip()}
        if self._handle is None:
            self._handle = sys.modules["IPython"].display.display(data, raw=True, display_id=True)
        else:
            self._handle.update(data, raw=True)

    def flush(self) -> None:
        """Do nothing, because no text is buffered."""


def _in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    module = sys.modules.get("IPython")
    shell = module.get_ipython() if module is not None and hasattr(module, "get_ipython") else None
    return hasattr(shell, "kernel")
