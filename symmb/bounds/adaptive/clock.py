"""The seconds that a study takes beyond its runs."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from symmb._threads import threads_as_before
from symmb.bounds.adaptive.constants import LEAST_SECONDS, SECONDS_OF_RUNS


class Clock:
    """A clock that stands while runs are made.

    Seconds beyond the runs are those of this thread on its processor: other programs do not count.

    Attributes
    ----------
    seconds : those that are allowed; None: LEAST_SECONDS, and SECONDS_OF_RUNS times those of the runs
    is_cut : whether the study was told that it is late
    """

    def __init__(self, seconds: float | None) -> None:
        self.seconds, self.is_cut = seconds, False
        self._begin, self._of_runs = time.thread_time(), 0.0

    @property
    def is_late(self) -> bool:
        """Whether no seconds are left. A study that asks it ends when it is so."""
        allowed = LEAST_SECONDS + SECONDS_OF_RUNS * self._of_runs if self.seconds is None else self.seconds
        self.is_cut |= time.thread_time() - self._begin > allowed
        return self.is_cut

    @contextmanager
    def of_runs(self) -> Iterator[None]:
        """A context for runs, which may use all threads of linear algebra."""
        begin, on_processor = time.perf_counter(), time.thread_time()
        with threads_as_before():
            yield
        self._of_runs += time.perf_counter() - begin
        self._begin += time.thread_time() - on_processor
