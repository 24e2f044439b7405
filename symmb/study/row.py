"""A row of a comparison: a method, its cost, its bounds and their score."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from symmb._types import Array
from symmb.study.metrics import Score, Yardstick


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
    failure : str                   message of the first failed run; files do not contain it
    caution : str                   from when on the method is not valid, and why
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
    caution: str = ""

    def to_plain(self) -> dict[str, Any]:
        """The row in the JSON layout, with arrays."""
        plain: dict[str, Any] = {
            "name": self.name,
            "kind": self.kind,
            "evaluations": self.evaluations,
            "failed": self.failed,
            "setup_seconds": self.setup_seconds,
            "run_seconds": self.run_seconds,
            "error": self.score.error,
            "over": self.score.over,
            "under": self.score.under,
            "coverage": self.score.coverage,
            "lower": self.lower,
            "upper": self.upper,
        }
        if self.estimate is not None:
            plain["estimate"] = self.estimate
        if self.caution:
            plain["caution"] = self.caution
        if self.inner is not None:
            plain["inner_lower"], plain["inner_upper"] = self.inner
        return plain

    @staticmethod
    def from_plain(plain: Mapping[str, Any], yardstick: Yardstick) -> "Row":
        """Rebuild a row. Its score is computed again from the bounds."""
        lower, upper = _array(plain["lower"]), _array(plain["upper"])
        estimate = _array(plain["estimate"]) if "estimate" in plain else None
        inner = (_array(plain["inner_lower"]), _array(plain["inner_upper"])) if "inner_lower" in plain else None
        return Row(
            name=plain["name"],
            kind=plain["kind"],
            evaluations=plain["evaluations"],
            failed=plain["failed"],
            setup_seconds=plain["setup_seconds"],
            run_seconds=plain["run_seconds"],
            lower=lower,
            upper=upper,
            estimate=estimate,
            inner=inner,
            score=yardstick.score(lower, upper, estimate),
            caution=plain.get("caution", ""),
        )


@dataclass(frozen=True)
class NotRun:
    """A method that could not run, and why."""

    name: str
    reason: str


def _array(values: list[Any]) -> Array:
    return np.array(values, dtype=float)
