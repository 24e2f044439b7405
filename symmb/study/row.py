"""A row of a comparison: a method, its cost, its bounds and their score."""

from dataclasses import dataclass, field
from typing import Any

from symmb._errors import WithWarnings
from symmb._labelled import Counted
from symmb._types import Array
from symmb.bound.answers import INNER, inner_entries, kind_of
from symmb.results.files import NOT_KEPT, Record, attributes, entries, entry
from symmb.study.metrics import Score, Yardstick

LONG_RUN = 10.0
"""Run time [s] above which a method runs only once, because one measurement is then accurate enough."""
_OPTIONAL = ("estimate", "inner_lower", "inner_upper", "failure", "failed_region", "caution", "doubts")
"""Entries that a file contains only if the method has them."""


@dataclass(frozen=True)
class Row(Counted, WithWarnings):
    """A method that ran.

    Attributes
    ----------
    name : str                      text of the method
    kind : str                      "enclosure", "estimate" or "sampled"
    evaluations, failed : int       cost in runs, with derivatives; number of failed runs
    setup_seconds : float or None   time for deriving and compiling [s], the same for all methods; None if not known
    run_seconds : float             time of evaluations and bounding, without set-up [s]; nan if it is not known
    lower, upper : (n_t, n_y)
    estimate : (n_t, n_y) or None   the error that the method estimates
    inner : two (n_t, n_y) or None  lower and upper values that runs attained
    score : Score                   result of the measurement with the comparison's reference
    failure : str                   message of the first failed run
    failed_region : str             region of the failed runs in the box, in words
    caution : str                   time from which the method is not valid, and the reason
    doubts : tuple of str           warnings about the bounds, in sentences
    """

    name: str
    kind: str = field(metadata=entry(kind_of))
    evaluations: int
    failed: int
    setup_seconds: float | None
    run_seconds: float
    lower: Array = field(metadata=entry(Record.lower, "t", "names"))
    upper: Array = field(metadata=entry(Record.upper, "t", "names"))
    estimate: Array | None = field(metadata=entry(Record.size, "t", "names"))
    inner: tuple[Array, Array] | None = field(metadata=INNER)
    score: Score = field(metadata=NOT_KEPT)
    failure: str = ""
    failed_region: str = ""
    caution: str = ""
    doubts: tuple[str, ...] = ()

    def record(self) -> dict[str, Any]:
        """The row for a file. Entries that the method does not have are left out."""
        scores = {name: getattr(self.score, name) for name in ("error", "over", "under", "coverage")}
        own = entries(self) | inner_entries(self.inner) | scores
        return {name: x for name, x in own.items() if name not in _OPTIONAL or (x is not None and len(x))}

    @staticmethod
    def of_record(record: Record, yardstick: Yardstick) -> "Row":
        """The row of a file. The score is computed again from the bounds."""
        own = attributes(Row, record)
        return Row(**own, score=yardstick.score(own["lower"], own["upper"], own["estimate"]))


@dataclass(frozen=True)
class NotRun:
    """A method that could not run, and the reason."""

    name: str
    reason: str
