"""A row of a comparison: a method, its cost, its bounds and their score."""

from dataclasses import dataclass
from typing import Any

from symmb._types import Array
from symmb.bounds import kind_of
from symmb.files import Record
from symmb.study.metrics import Score, Yardstick

LONG = 10.0
"""Time above which a method runs once [s]: its run time is known well enough."""


@dataclass(frozen=True)
class Row:
    """A method that ran.

    Attributes
    ----------
    name : str                      the constructor's text
    kind : str                      "enclosure", "estimate" or "sampled"
    evaluations, failed : int       cost in runs, derivatives included; how many runs failed
    setup_seconds : float or None   deriving and compiling [s], the same for all methods; None if not known
    run_seconds : float             evaluations and bounding, warm [s]
    lower, upper : (n_t, n_y)
    estimate : (n_t, n_y) or None   the method's own estimate of its error
    inner : two (n_t, n_y) or None  lower and upper attained by actual runs
    score : Score                   measured with the comparison's reference
    failure : str                   message of the first failed run
    failed_region : str             where the failed runs lie in the box, in words
    caution : str                   from when on the method is not valid, and why
    doubts : tuple of str           what cannot be trusted about these bounds, in sentences
    """

    name: str
    kind: str
    evaluations: int
    failed: int
    setup_seconds: float | None
    run_seconds: float
    lower: Array
    upper: Array
    estimate: Array | None
    inner: tuple[Array, Array] | None
    score: Score
    failure: str = ""
    failed_region: str = ""
    caution: str = ""
    doubts: tuple[str, ...] = ()

    def record(self) -> dict[str, Any]:
        """The row for a file."""
        inner_lower, inner_upper = self.inner or (None, None)
        optional = {
            "estimate": self.estimate,
            "inner_lower": inner_lower,
            "inner_upper": inner_upper,
            **{name: getattr(self, name) or None for name in ("failure", "failed_region", "caution", "doubts")},
        }
        plain = ("name", "kind", "evaluations", "failed", "setup_seconds", "run_seconds", "lower", "upper")
        return {
            **{name: getattr(self, name) for name in plain},
            **{name: getattr(self.score, name) for name in ("error", "over", "under", "coverage")},
            **{name: value for name, value in optional.items() if value is not None},
        }

    @staticmethod
    def of_record(record: Record, yardstick: Yardstick) -> "Row":
        """The row of a file. Its score is computed again from the bounds."""
        shape = yardstick.lower.shape
        lower, upper = record.pair("lower", "upper", *shape)
        estimate = record.size("estimate", *shape) if "estimate" in record else None
        return Row(
            name=record.text("name"),
            kind=kind_of(record),
            evaluations=record.whole("evaluations"),
            failed=record.whole("failed"),
            setup_seconds=record.known("setup_seconds"),
            run_seconds=record.number("run_seconds"),
            lower=lower,
            upper=upper,
            estimate=estimate,
            inner=record.pair("inner_lower", "inner_upper", *shape) if "inner_lower" in record else None,
            score=yardstick.score(lower, upper, estimate),
            **{name: record.text(name, default="") for name in ("failure", "failed_region", "caution")},
            doubts=record.texts("doubts", default=()),
        )


@dataclass(frozen=True)
class NotRun:
    """A method that could not run, and why."""

    name: str
    reason: str
