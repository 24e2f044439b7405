"""What the runs of a study have attained so far, for a study that is interrupted."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np

from symmb._types import Array


@dataclass
class Attained:
    """Smallest and largest values (n_t, n_y) of the runs so far, and their number."""

    lower: Array
    upper: Array
    runs: int = 0


_STUDY: ContextVar[Attained | None] = ContextVar("study", default=None)


@contextmanager
def attained_by_runs(n_t: int, n_y: int) -> Iterator[Attained]:
    """What the runs of this block attain."""
    attained = Attained(np.full((n_t, n_y), np.inf), np.full((n_t, n_y), -np.inf))
    token = _STUDY.set(attained)
    try:
        yield attained
    finally:
        _STUDY.reset(token)


def note_attained(lower: Array, upper: Array, runs: int) -> None:
    """Add values (n_t, n_y) of runs to those of the study, if there is one."""
    study = _STUDY.get()
    if study is not None:
        np.minimum(study.lower, lower, out=study.lower)
        np.maximum(study.upper, upper, out=study.upper)
        study.runs += runs
