"""The seconds that a study takes beyond its runs."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from symmb._threads import threads_as_before
from symmb._types import Array

LEAST_SECONDS, SECONDS_OF_RUNS = 1.0, 3.0
"""Seconds that a study may take beyond its runs, unless more are asked for: nobody notices the first, and runs that
take long are worth as much thought."""
OWN_SHARE = 0.1
"""Least share of the seconds that pass which runs of this program take on processors: those of other programs leave
less, and only a machine with ten times as much work as processors leaves as little."""


class Clock:
    """A clock that stands while runs are made.

    Seconds of runs and beyond them are those that pass, or those of all threads of this program on their processors if
    these are less: other programs do not count. Runs that other programs make take the seconds that pass.

    Attributes
    ----------
    seconds : those that are allowed; None: LEAST_SECONDS, and SECONDS_OF_RUNS times those of the runs
    is_cut : whether the study was told that it is late
    """

    def __init__(self, seconds: float | None) -> None:
        self.seconds, self.is_cut = seconds, False
        self._begin, self._of_runs = _now(), 0.0

    @property
    def is_late(self) -> bool:
        """Whether no seconds are left. A study that asks it ends when it is so."""
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
    """Seconds that have passed, and those of this program's threads on their processors (2,)."""
    return np.array([time.perf_counter(), time.process_time()])
