"""What a study may compute in addition to its runs."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from symmb._threads import threads_as_before
from symmb._work import work_done

LEAST_WORK, WORK_OF_RUN, WORK_IN_LANES = 3e9, 2e7, 8e6
"""Work that a study may do, and further work for each of its runs, also for those side by side in lanes [ns]. Three
seconds are short for users. With 6e6 in lanes, one of 24 everyday machines ends with a warning. With 1e6, elements that
act in a small part of the box take half the time, with the same warnings (tests/benchmarks/unseen_elements.py)."""


class Clock:
    """A clock that stops during runs. Without a limit of time, it counts work, so that results do not depend on time.

    Attributes
    ----------
    seconds : allowed seconds of wall time; None: LEAST_WORK, and WORK_OF_RUN or WORK_IN_LANES for each run
    is_cut : whether `is_late` has been true
    """

    def __init__(self, seconds: float | None) -> None:
        self.seconds, self.is_cut = seconds, False
        self._begin, self._work = time.perf_counter(), work_done()

    def restart(self) -> None:
        """Start again, because another study begins. Given seconds are for all studies."""
        if self.seconds is None:
            self.is_cut, self._work = False, work_done()

    @property
    def allowed(self) -> str:
        """The allowed time, in words."""
        return "about 3 s, and 8 to 20 ms for each run" if self.seconds is None else f"the given {self.seconds:g} s"

    @property
    def is_late(self) -> bool:
        """Whether nothing is left. A study that calls this method stops if the result is True."""
        if self.seconds is None:
            self.is_cut |= work_done() - self._work > LEAST_WORK
        else:
            self.is_cut |= time.perf_counter() - self._begin > self.seconds
        return self.is_cut

    @contextmanager
    def of_runs(self, number: int = 0, in_lanes: bool = False) -> Iterator[None]:
        """A context for a number of runs, which may use all threads of linear algebra."""
        begin, work = time.perf_counter(), work_done()
        with threads_as_before():
            yield
        self._begin += time.perf_counter() - begin
        self._work += work_done() - work + number * (WORK_IN_LANES if in_lanes else WORK_OF_RUN)
