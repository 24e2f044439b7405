"""The progress of long work, shown by tqdm: in terminals and notebooks as one line that is replaced, elsewhere not at
all."""

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import TracebackType
from typing import Any, ClassVar

_PATIENCE, _PERIOD = 1.0, 0.2
"""Time before the bar appears, so that short work shows none, and time between two updates of it [s]."""
_UNKNOWN = "{desc} [{elapsed}]"
_KNOWN = "{{desc}} |{{bar:12}}| {{n_fmt}} of {{total_fmt}} {} [{{elapsed}}, {{remaining}} left, {{rate_fmt}}]"
"""What a bar shows where the number of runs is not known, and where it is."""

_REACHED = ", estimated error "
"""What divides the name of a method from the error that it has reached."""


class Progress:
    """A context that shows how far the work is, how fast, and how long it still takes.

    A call tells the label of the work, the runs that are done and all its runs. The time goes on between two calls:
    equations are derived and compiled meanwhile. Work inside other work that is shown has no bar of its own.
    """

    _outermost: ClassVar["Progress | None"] = None

    def __init__(self, label: str, unit: str = "runs") -> None:
        self._text, self._done, self._total, self._unit = label, 0, 0, unit
        self._stream = sys.stderr  # solvers redirect it for a moment
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self.is_shown = self._stream is not None and (_in_notebook() or self._stream.isatty())

    def __call__(self, label: str, done: int, total: int) -> None:
        self._text, self._done, self._total = label, done, total

    def __enter__(self) -> "Progress":
        if self.is_shown and not os.environ.get("TQDM_DISABLE") and Progress._outermost is None:
            Progress._outermost = self
            with suppress(RuntimeError):  # no thread can be started
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
            if bar is None or text.partition(_REACHED)[0] != label or done < bar.n:  # other work has its own rate
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
    """Who gets the progress: the function that a caller gave, or a bar where people may see it."""
    if progress is not None:
        yield progress
        return
    with Progress(label, unit) as own:
        yield own if own.is_shown else None


class RunProgress:
    """Progress of one method: the finished runs and all runs, and the error that it has reached."""

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
    """The same for a single method, whose runs, or other units of work, are told without a label."""
    if progress is not None:
        yield progress
        return
    with shown(None, label, unit) as bar:
        yield bar and RunProgress(bar, label)


def _new_bar(stream: Any, done: int, unit: str) -> Any:
    from tqdm import tqdm

    file = _CellLine.of_cell() if _in_notebook() else stream
    tqdm.set_lock(threading.RLock())  # that of tqdm is shared with other processes, which draw no bars
    tqdm.monitor_interval = 0
    return tqdm(file=file, initial=done, leave=False, dynamic_ncols=True, unit=f" {unit}", disable=False)


class _CellLine:
    """A file whose last line stands below a cell of a notebook, one for all bars of the cell.

    Lines of the standard error stay in exports, one below the other. This one is empty at the end.
    """

    _last: ClassVar["tuple[int, _CellLine] | None"] = None

    def __init__(self) -> None:
        self._handle: Any = None

    @classmethod
    def of_cell(cls) -> "_CellLine":
        """That of the cell which runs."""
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
        """Nothing waits."""


def _in_notebook() -> bool:
    """Whether this is the kernel of a notebook."""
    module = sys.modules.get("IPython")
    shell = module.get_ipython() if module is not None and hasattr(module, "get_ipython") else None
    return hasattr(shell, "kernel")
