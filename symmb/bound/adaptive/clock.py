"""The time that a study takes in addition to its runs."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from symmb._threads import threads_as_before
from symmb._types import Array

LEAST_SECONDS, SECONDS_OF_RUNS = 3.0, 3.0
"""Allowed time of a study in addition to its runs [s]. Three seconds are short for users. After slow runs, the study
may take a similar time as the runs."""
OWN_SHARE = 0.1
"""Smallest ratio of processor time to wall time of runs. The ratio is smaller if other programs use most processors,
for example ten times as many processes as processors."""


class Clock:
    """A clock that stops during runs.

    The clock measures wall time, or the processor time of this program's threads if this is shorter. Work of other
    programs is thus not included. For runs in other processes, the clock measures wall time.

    Attributes
    ----------
    seconds : allowed seconds; None: LEAST_SECONDS plus SECONDS_OF_RUNS times the seconds of the runs
    is_cut : whether `is_late` has been true
    """

    def __init__(self, seconds: float | None) -> None:
        self.seconds, self.is_cut = seconds, False
        self._begin, self._of_runs = _now(), 0.0

    def restart(self) -> None:
        """Start again, because another study begins. Given seconds are for all studies."""
        if self.seconds is None:
            self.is_cut, self._begin, self._of_runs = False, _now(), 0.0

    @property
    def is_late(self) -> bool:
        """Whether no time is left. A study that calls this method stops if the result is True."""
        allowed = LEAST_SECONDS + SECONDS_OF_RUNS * self._of_runs if self.seconds is None else self.seconds
        self.is_cut |= bool((_now() - self._begin).min() > allowed)
        return self.is_cut

    @contextmanager
    def of_runs(self) -> Iterator[None]:
        """A context for runs, which may use all threads of linear algebra."""
        begin = _now()
        with threads_as_before():
            yield
        passed, of_threads = of_runs = _now() - begin
        self._of_runs += passed if of_threads < OWN_SHARE * passed else min(passed, of_threads)
        self._begin += of_runs


def _now() -> Array:
    """Wall time and processor time of this program's threads, (2,) [s]."""
    return np.array([time.perf_counter(), time.process_time()])
