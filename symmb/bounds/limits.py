"""Whether bounds keep limits: kept, violated, or not decided by the bounds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from textwrap import shorten
from typing import TYPE_CHECKING, Any

import numpy as np

from symmb import plot
from symmb._doubt import concerned
from symmb._errors import DeclarationError
from symmb._labelled import Labelled, Result, over_outputs, texts
from symmb._names import did_you_mean
from symmb._options import is_real, require_name, shown
from symmb._table import aligned, over_times, time_text
from symmb._types import Array
from symmb.bounds.envelope import Envelope
from symmb.bounds.time_windows import ROUNDING
from symmb.bounds.worst_case import WorstCase
from symmb.files import to_jsonable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Limits = Mapping[str, tuple[float | None, float | None]]
"""Limits (low, high) of outputs by name, of which one may be None."""
_DOUBTFUL = 3.0
"""How many times an estimated error counts that is a large share of the width."""
_WORDS = {True: "kept", False: "violated", None: "undecided"}


@dataclass(frozen=True, eq=False)
class KeptLimit:
    """The limit of one output.

    Attributes
    ----------
    output, unit : str
    low, high : float          limits, infinite where there is none
    kept : True, False, None   whether all responses are inside; None if the bounds do not decide it
    why : str                  what decides, or what would decide, in a sentence
    margin : (n_t,)            distance of the bounds from the closer limit, below 0 beyond it
    """

    output: str
    unit: str
    low: float
    high: float
    kept: bool | None
    why: str
    margin: Array

    @property
    def row(self) -> int:
        """Number of the time of the least margin."""
        return int(self.margin.argmin())

    @property
    def text(self) -> str:
        """The limit as an inequality."""
        low = f"{self.low:g} <= " if np.isfinite(self.low) else ""
        high = f" <= {self.high:g}" if np.isfinite(self.high) else ""
        return f"{low}{self.output}{high}"


@dataclass(frozen=True, eq=False, repr=False)
class LimitCheck(plot.OverTimeBesideGiven, Result):
    """Which limits are kept. `print` shows them, `plot` draws the bounds of outputs with limits, and these as lines.

    Attributes
    ----------
    t : (n_t,)                 times [s]
    method : str
    limits : tuple of KeptLimit
    draw : function            of names of outputs, and of axes or None: a figure of their bounds
    worst : WorstCase          the run that comes closest to a limit, or is farthest beyond it; None if none is known
    """

    t: Array
    method: str
    limits: tuple[KeptLimit, ...]
    draw: "Callable[[list[str], Any], Figure]"
    worst: WorstCase | None

    _left = (0, 1, 2)
    _most = None

    @property
    def names(self) -> tuple[str, ...]:
        """The outputs with limits."""
        return tuple(limit.output for limit in self.limits)

    @property
    def kept(self) -> bool | None:
        """True if all limits are kept, False if one is violated, None if that is not decided."""
        results = [limit.kept for limit in self.limits]
        return False if False in results else None if None in results else True

    @property
    def margin(self) -> Array:
        """(n_t,) the least distance of the bounds from a limit, below 0 beyond it."""
        return np.min([limit.margin for limit in self.limits], axis=0)

    def __getitem__(self, output: str) -> KeptLimit:
        """The limit of an output."""
        for limit in self.limits:
            if limit.output == output:
                return limit
        raise DeclarationError(f"No limit of {shown(output)}.{did_you_mean(output, self.names)}")

    def _head(self) -> str:
        return f"Limits by {self.method}: {_WORDS[self.kept]}"

    def _rows(self, names: Sequence[str] = ()) -> list[list[str]]:
        rows = [["limit", "result", "why", "least margin", "at [s]"]]
        for limit in self.limits:
            least, _ = self._least(limit)
            margin = f"{least:.4g}{' ' * bool(limit.unit)}{limit.unit}"
            rows.append([limit.text, _WORDS[limit.kept], limit.why, margin, time_text(self.t, limit.row, limit.margin)])
        return over_times(rows, self.t)

    def _least(self, limit: KeptLimit) -> tuple[float, float]:
        """The least margin of a limit, and its time [s]."""
        return float(limit.margin[limit.row]), float(self.t[limit.row])

    def to_json(self) -> dict[str, dict[str, Any]]:
        """The result of each output, why, its least margin with the time, and its limits, None where there is none."""
        results = {}
        for limit in self.limits:
            margin, time = self._least(limit)
            result = {"result": _WORDS[limit.kept], "why": limit.why, "margin": margin, "time": time}
            results[limit.output] = to_jsonable(result | {"low": limit.low, "high": limit.high})
        return results

    def __str__(self) -> str:
        worst = [f"  worst case: {self.worst}"] if self.worst else []
        return "\n".join([self._head(), *(f"  {line}" for line in aligned(self._rows(), self._left)), *worst])

    def _figure(self, columns: list[int] | None, ax: Any) -> "Figure":
        some = self.limits if columns is None else [self.limits[k] for k in columns]
        figure = self.draw([limit.output for limit in some], ax)
        plot.add_limits(figure, ax, [(limit.low, limit.high) for limit in some])
        return figure

    def _labelled(self) -> Labelled:
        coordinates, units = over_outputs(self.t, self.names, [limit.unit for limit in self.limits])
        kept = texts([_WORDS[limit.kept] for limit in self.limits])
        variables: dict[str, Any] = {
            "margin": (("time", "output"), np.stack([limit.margin for limit in self.limits], axis=1)),
            "low": (("output",), np.array([limit.low for limit in self.limits])),
            "high": (("output",), np.array([limit.high for limit in self.limits])),
            "result": (("output",), kept),
        }
        return Labelled(coordinates, variables, {"method": self.method}, units)


def limit_pairs(owner: str, limits: Limits, names: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Limits as numbers, infinite where there is none."""
    if not isinstance(limits, Mapping) or not limits:
        raise DeclarationError(
            f'{owner}: limits must be pairs by output, such as {{"x": (None, 0.3)}}, got {shown(limits)}.'
        )
    for name in limits:
        require_name(owner, "output", name, names)
    return {name: _ends(owner, name, pair) for name, pair in limits.items()}


def kept_limit(bounds: Envelope, output: str, low: float, high: float, is_doubtful: bool) -> KeptLimit:
    """Whether an output keeps a limit; its estimated error may be a large share of the width."""
    k = bounds.names.index(output)
    lower, upper = bounds.lower[:, k], bounds.upper[:, k]
    margin = np.minimum(lower - low, high - upper)
    unit = bounds.units[k] if bounds.units else ""
    return KeptLimit(output, unit, low, high, *_decision(bounds, k, margin, low, high, is_doubtful), margin)


def _rounding(bounds: Envelope, k: int) -> float:
    """How far runs of output number k may be off by rounding or noise."""
    rounding = float(ROUNDING * np.abs([bounds.lower[:, k], bounds.upper[:, k]]).max(initial=0.0))
    return rounding if bounds.noise is None else max(rounding, float(bounds.noise[k]))


def _doubt(bounds: Envelope, output: str) -> str:
    """The first doubt about an output beside its estimated error, '' if there is none."""
    if doubts := [doubt for doubt in bounds.run_doubts if concerned(doubt, [output])]:
        return doubts[0]
    return "Runs failed." if bounds.failed else f"The bounds are {bounds.caution}." if bounds.caution else ""


def _decision(
    bounds: Envelope, k: int, margin: Array, low: float, high: float, is_doubtful: bool
) -> tuple[bool | None, str]:
    """Whether output number k keeps a limit, by a margin (n_t,), and why."""
    attained = bounds.inner or ((bounds.lower, bounds.upper) if bounds.kind == "sampled" else None)
    beyond = -np.inf if attained is None else max((low - attained[0][:, k]).max(), (attained[1][:, k] - high).max())
    rounding = _rounding(bounds, k)
    if beyond > rounding:
        return False, "A run is beyond it."
    if doubt := _doubt(bounds, bounds.names[k]):
        return None, f"See the doubts: {shorten(doubt, 60, placeholder=' ...')}"
    if beyond > 0:
        return None, f"A run is beyond it, but by no more than rounding or noise of {rounding:.1e}."
    if bounds.kind == "sampled":
        return None, f"All {bounds.evaluations} runs keep it: PolynomialChaos() estimates what is between them."
    if bounds.kind == "enclosure":
        if (margin >= 0).all():
            return True, "This is proved."
        if ((bounds.lower[:, k] > high) | (bounds.upper[:, k] < low)).any():
            return False, "All responses are beyond it at a time."
        return None, "The proved bounds are beyond it, and may be wider than the responses: more boxes decide."
    if bounds.estimate is None:
        return None, "The bounds have no estimated error: PolynomialChaos() has one."
    if is_doubtful:
        return _decision_of_doubtful(bounds.estimate[:, k].max(), margin)
    estimate = bounds.estimate[:, k]
    if (margin < -np.maximum(estimate, rounding)).any():
        error = estimate[(margin + estimate).argmin()]
        return False, f"The bounds are beyond it by more than their estimated error of {error:.1e}."
    error = estimate.max()
    if (margin >= estimate).all():
        return True, f"The estimated error is at most {error:.1e}."
    return (
        None,
        f"The estimated error is up to {error:.1e}: PolynomialChaos(tolerance=...) with a smaller number decides.",
    )


def _decision_of_doubtful(error: float, margin: Array) -> tuple[bool | None, str]:
    """The same from an estimated error that is a large share of the width: it may be off, by times and by size."""
    text = f"the estimated error is doubtful, and {_DOUBTFUL:g} times it is {_DOUBTFUL * error:.1e}"
    if (margin < -_DOUBTFUL * error).any():
        return False, f"The bounds are beyond it by more: {text}."
    if (margin >= _DOUBTFUL * error).all():
        return True, f"The bounds are inside by more: {text}."
    return None, f"The bounds are too close to it: {text}. PolynomialChaos(budget=..., seconds=...) may decide."


def _ends(owner: str, name: str, pair: object) -> tuple[float, float]:
    if not isinstance(pair, list | tuple) or len(pair) != 2 or not any(end is not None for end in pair):
        raise DeclarationError(
            f"{owner}: the limit of {name!r} must be a pair (low, high), of which one may be None, got {shown(pair)}."
        )
    for end in pair:
        if end is not None and (not is_real(end) or np.isnan(end)):
            raise DeclarationError(f"{owner}: the limit of {name!r} must be numbers or None, got {shown(pair)}.")
    low, high = (-np.inf if pair[0] is None else float(pair[0])), (np.inf if pair[1] is None else float(pair[1]))
    if low > high:
        raise DeclarationError(f"{owner}: the limits of {name!r} cross: {low:g} is above {high:g}.")
    if not np.isfinite([low, high]).any():
        raise DeclarationError(f"{owner}: one end of the limit of {name!r} must be finite, got {shown(pair)}.")
    return low, high
