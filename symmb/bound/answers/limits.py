"""Checks of limits: satisfied, violated, or not decided by the bounds."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from textwrap import shorten
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from symmb._doubt import concerned
from symmb._errors import DeclarationError
from symmb._labelled import ByOutput, Labelled, Result, over_outputs, texts
from symmb._magnitudes import LAST_DIGITS, SAME
from symmb._names import normal_keys
from symmb._options import is_real, numbers_of, require_name, shown
from symmb._table import aligned, at_time, over_times, time_text
from symmb._types import Array
from symmb._units import number_in, typeset
from symmb.bound.answers.envelope import Envelope
from symmb.bound.answers.further_runs import FurtherRun, closest_run
from symmb.bound.answers.result_file import box_entries, inner_entries
from symmb.bound.responses import SIDES, RunsUsedUpError, WorstCase
from symmb.results import plot
from symmb.results.files import NOT_KEPT, TIMES, Record, Saved, attributes, entries, entry, to_jsonable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Limits = Mapping[str, tuple[float | str | None, float | str | None] | tuple[float | None, float | None, str]]
"""Limits (low, high) of outputs by name, with or without units, such as ("75 deg/s", None). One end may be None."""
WARNED = "See the warnings"
_MOVE = "For a decision, move the limit by more than this number."
_UNCERTAIN_ERRORS, _NEAR_WIDTHS = 2.0, 0.5
"""Further runs decide limits that are closer to the bounds than this multiple of the estimated error. If many runs take
little time, this fraction of the width is added. Smaller values miss more extremes. Larger values take more runs."""
_WORDS = {True: "satisfied", False: "violated", None: "undecided"}


def _suffix(unit: str) -> str:
    """A unit for use after numbers; empty for a number without unit."""
    return f" {typeset(unit)}".rstrip()


def limit_text(output: str, unit: str, low: float, high: float) -> str:
    """A limit as an inequality, with its unit."""
    if not np.isfinite(high):
        return f"{low:g}{_suffix(unit)} <= {output}"
    return f"{f'{low:g} <= ' if np.isfinite(low) else ''}{output} <= {high:g}{_suffix(unit)}"


class _Decision(NamedTuple):
    """The result for a limit, its reason, the margin (n_t,), and the further run that comes closest to the limit."""

    kept: bool | None
    why: str
    margin: Array
    further: FurtherRun | None = None


@dataclass(frozen=True, eq=False)
class KeptLimit:
    """The limit of one output.

    Attributes
    ----------
    output, unit : str
    low, high : float          limits, infinite if there is no limit; files contain nan instead
    kept : True, False, None   whether all responses are inside; None if the bounds do not decide this
    why : str                  a sentence: the reason, or how to decide the limit
    margin : (n_t,)            distance of the bounds from the closer limit, negative beyond the limit; or the distance
                               of further runs, if this is larger
    row : int                  index of the time of the smallest margin
    further : FurtherRun       the further run that comes closest to the limit, or None if none was made or the check
                               was read from a file
    width : float              largest width of the bounds
    between : float            time of the smallest margin [s] if it is between two output times; otherwise nan
    """

    output: str
    unit: str
    low: float = field(metadata=entry(lambda record, name: float(np.fmax(record.number(name), -np.inf))))
    high: float = field(metadata=entry(lambda record, name: float(np.fmin(record.number(name), np.inf))))
    kept: bool | None = field(metadata=NOT_KEPT)
    why: str
    margin: Array = field(metadata=entry(lambda record, name, n: np.fmax(record.with_nan(name, n), -np.inf), "t"))
    row: int = field(metadata=entry(lambda record, name: range(record.length("t"))[record.whole(name)]))
    further: FurtherRun | None = field(default=None, metadata=NOT_KEPT)
    width: float = 0.0
    between: float = field(default=np.nan, metadata=entry(lambda record, name: record.number(name)))

    @property
    def share(self) -> float:
        """The margin m relative to the width w, m / (|m| + w), from -1 to 1, which compares limits of any units."""
        least = float(self.margin.min())
        return least / (abs(least) + self.width) if least and np.isfinite(least) else float(np.sign(least))

    def time(self, t: Array) -> float:
        """The time of the smallest margin [s], from the output times t (n_t,)."""
        return float(t[self.row] if np.isnan(self.between) else self.between)

    @property
    def text(self) -> str:
        """The limit as an inequality, with its unit."""
        return limit_text(self.output, self.unit, self.low, self.high)


@dataclass(frozen=True, eq=False, repr=False)
class LimitCheck(plot.OverTimeBesideGiven, Result, ByOutput, Saved):
    """The results of a check of limits. `print` shows the results. `plot` draws the bounds of the outputs and the
    limits.

    `save` writes a file, and `load` reads it.

    Attributes
    ----------
    t : (n_t,)
        times [s]
    method : str
    limits : tuple of KeptLimit
    bounds : Bounds
        the checked bounds; after `load` the part of them that `plot` draws
    worst : WorstCase
        the run that comes closest to a limit, or is farthest beyond a limit; None if not known
    remarks : tuple of str
        remarks in sentences, such as on nominal values outside of the box

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> t = np.linspace(0.0, 1.0, 3)
    >>> decay = mb.FunctionSimulator(lambda k: np.exp(-k * t), {"k": 1.0}, t, ["x"])
    >>> check = mb.propagate(decay, box=mb.Box(k=(0.5, 2.0))).check({"x": (0.1, None)})
    >>> check.kept, check["x"].text
    (True, '0.1 <= x')
    """

    t: Array = field(metadata=TIMES)
    method: str
    limits: tuple[KeptLimit, ...] = field(metadata=NOT_KEPT)
    bounds: Envelope = field(metadata=NOT_KEPT)
    worst: WorstCase | None = field(metadata=NOT_KEPT)
    remarks: tuple[str, ...] = ()

    _left = (0, 1, 2)
    _most = None

    @property
    def names(self) -> tuple[str, ...]:
        """The outputs with limits."""
        return tuple(limit.output for limit in self.limits)

    @property
    def kept(self) -> bool | None:
        """True if all limits are satisfied, False if one is violated, None if this is not decided."""
        results = [limit.kept for limit in self.limits]
        return False if False in results else None if None in results else True

    @property
    def margin(self) -> Array:
        """(n_t,) distance of the bounds from the limit with the smallest relative margin, negative beyond the limit."""
        return closest(self.limits).margin

    def __getitem__(self, output: str) -> KeptLimit:
        """The limit of an output."""
        return self.limits[self.names.index(require_name("LimitCheck", "limit of", output, self.names))]

    def _head(self) -> str:
        return f"Limits by {self.method}: {_WORDS[self.kept]}"

    def _rows(self, names: Sequence[str] = ()) -> list[list[str]]:
        rows = [["limit", "result", "why", "smallest margin", "at [s]"]]
        for limit in self.limits:
            least, _ = self._least(limit)
            margin = f"{least:.4g}{_suffix(limit.unit)}"
            time = time_text(self.t, limit.row, limit.margin) if np.isnan(limit.between) else f"{limit.between:.6g}"
            rows.append([limit.text, _WORDS[limit.kept], limit.why, margin, time])
        return over_times(rows, self.t)

    def _least(self, limit: KeptLimit) -> tuple[float, float]:
        """The smallest margin of a limit, and its time [s]."""
        return float(limit.margin[limit.row]), limit.time(self.t)

    def to_json(self) -> dict[str, dict[str, Any]]:
        """For each limit: the result, the reason, the smallest margin, its time, and the ends (None if infinite)."""
        results = {}
        for limit in self.limits:
            margin, time = self._least(limit)
            result = {"result": _WORDS[limit.kept], "why": limit.why, "margin": margin, "time": time}
            results[limit.output] = to_jsonable(result | {"low": limit.low, "high": limit.high})
        return results

    def _record(self) -> dict[str, Any]:
        own = self.bounds
        return entries(self) | {
            "limits": [entries(limit) | {"result": _WORDS[limit.kept]} for limit in self.limits],
            "bounds": entries(own) | inner_entries(own.inner) | box_entries(own.box),
            "worst": self.worst and entries(self.worst),
        }

    @classmethod
    def _of_record(cls, record: Record) -> "LimitCheck":
        own, kept = attributes(cls, record), {word: kept for kept, word in _WORDS.items()}
        limits = tuple(
            KeptLimit(**attributes(KeptLimit, each), kept=kept[each.text("result", *kept)])
            for each in record.records("limits")
        )
        bounds = Envelope(**attributes(Envelope, record.record("bounds")))
        worst = WorstCase.of_record(record.record("worst")) if "worst" in record else None
        return cls(**own, limits=limits, bounds=bounds, worst=worst)

    def __str__(self) -> str:
        more = [f"worst case: {self.worst}"] if self.worst else []
        more += [f"remark: {remark}" for remark in self.remarks]
        return "\n  ".join([self._head(), *aligned(self._rows(), self._left), *more])

    def _figure(self, columns: list[int] | None, style: plot.Style) -> "Figure":
        some = self.limits if columns is None else [self.limits[k] for k in columns]
        figure = self.bounds._figure([self.bounds._column(limit.output) for limit in some], style)
        plot.add_limits(figure, style.ax, [(limit.low, limit.high) for limit in some])
        return figure

    def _labelled(self) -> Labelled:
        coordinates, units = over_outputs(self.t, self.names, [limit.unit for limit in self.limits])
        variables: dict[str, Any] = {
            "margin": (("time", "output"), np.stack([limit.margin for limit in self.limits], axis=1)),
            "low": (("output",), np.array([limit.low for limit in self.limits])),
            "high": (("output",), np.array([limit.high for limit in self.limits])),
            "result": (("output",), texts([_WORDS[limit.kept] for limit in self.limits])),
        }
        return Labelled(coordinates, variables, {"method": self.method}, units)


def other_side(bounds: Envelope, limit: KeptLimit, side: str) -> str:
    """A sentence if bounds also exceed the other end of a violated limit, not the given side; otherwise empty."""
    k = bounds.names.index(limit.output)
    excess = limit.low - bounds.lower[:, k] if side == "upper" else bounds.upper[:, k] - limit.high
    row, verb = int(excess.argmax()), "fall below" if side == "upper" else "exceed"
    error = 0.0 if bounds.estimate is None else float(bounds.estimate[row, k])
    if limit.kept is not False or not excess[row] > max(rounding_of(bounds, k), error):
        return ""
    unit = _suffix(limit.unit)
    end = limit.low if side == "upper" else limit.high
    at = "" if limit.output in bounds.figures else at_time(bounds.t, row)
    return f"In other cases {limit.output} may {verb} its limit of {end:.6g}{unit} by {excess[row]:.3g}{unit}{at}."


def between_text(run: FurtherRun) -> str:
    """Words for the time of a run's extreme between output times; empty if it is at an output time."""
    return "" if np.isnan(run.between) else f" between two output times, at {run.between:.4g} s"


def closest(limits: Sequence[KeptLimit]) -> KeptLimit:
    """The limit with the smallest relative margin."""
    return min(limits, key=lambda limit: limit.share)


def limit_pairs(
    owner: str, limits: Limits | None, names: Sequence[str], units: Sequence[str] = (), needed: bool = True
) -> dict[str, tuple[float, float]]:
    """Limits (low, high) by output, as numbers in its unit; infinite if there is no limit.

    Unless limits are needed, None and {} are accepted as well.
    """
    if not needed and (limits is None or (isinstance(limits, Mapping) and not limits)):
        return {}
    if not isinstance(limits, Mapping) or not limits:
        raise DeclarationError(
            f"{owner}: limits must be a dictionary of pairs (low, high), such as "
            f'{{"x": (None, 0.3)}}, got {shown(limits)}.'
        )
    limits = normal_keys(owner, limits)
    for name in limits:
        require_name(owner, "output", name, names)
    known = dict(zip(names, units, strict=True)) if units else {}
    return {name: _ends(owner, name, pair, known.get(name, "")) for name, pair in limits.items()}


def kept_limit(bounds: Envelope, output: str, low: float, high: float) -> KeptLimit:
    """The checked limit of an output."""
    k = bounds.names.index(output)
    unit, found = bounds.units[k] if bounds.units else "", _decision(bounds, k, low, high)
    if not (found.kept and bounds.kind == "enclosure"):
        found = _by_nominal_run(bounds._with_nominal() if found.kept is None else bounds, k, low, high, found)
    with np.errstate(over="ignore", invalid="ignore"):
        width = float(np.fmax.reduce(bounds.upper[:, k] - bounds.lower[:, k], initial=0.0))
    kept, why, margin, further = found
    row = further.row if further and np.isfinite(further.error) else int(margin.argmin())
    between = further.between if further and row == further.row else np.nan
    return KeptLimit(output, unit, low, high, kept, why, margin, row, further, width, between)


def _by_nominal_run(bounds: Envelope, k: int, low: float, high: float, found: _Decision) -> _Decision:
    """Violated if the nominal parameters are in the box and the nominal run is beyond the limit; otherwise `found`."""
    if bounds.nominal is None or bounds.box is None or bounds._left_out:
        return found
    margin = np.minimum(bounds.nominal[:, k] - low, high - bounds.nominal[:, k])
    if not margin.min() < -rounding_of(bounds, k):
        return found
    further = found.further if found.kept is False else None
    return _Decision(False, "The nominal run is beyond the limit.", np.minimum(found.margin, margin), further)


def unit_suffix(bounds: Envelope, k: int) -> str:
    """The unit of output k, for use after numbers; empty for a number without unit."""
    return _suffix(bounds.units[k]) if bounds.units else ""


def rounding_of(bounds: Envelope, k: int) -> float:
    """Error of output k in a run, caused by rounding or noise."""
    rounding = float(SAME * bounds.scale[k])
    return rounding if bounds.noise is None else max(rounding, float(bounds.noise[k]))


def _doubt(bounds: Envelope, output: str) -> str:
    """The first warning about an output, other than a large estimated error; '' if there is none."""
    if doubts := [doubt for doubt in bounds.run_doubts if concerned(doubt, [output])]:
        return doubts[0]
    return "Runs failed." if bounds.failed else f"The bounds are {bounds.caution}." if bounds.caution else ""


def _decision(bounds: Envelope, k: int, low: float, high: float) -> _Decision:
    """The decision on a limit of output k."""
    lower, upper = bounds.lower[:, k], bounds.upper[:, k]
    margin, rounding = np.fmin(lower - low, high - upper), rounding_of(bounds, k)  # nan if bound and limit are infinite
    if lack := bounds._without_value(k):
        return _Decision(None, lack, margin)
    unit = unit_suffix(bounds, k)
    attained = bounds.inner or ((bounds.lower, bounds.upper) if bounds.kind == "sampled" else None)
    beyond = -np.inf if attained is None else max((low - attained[0][:, k]).max(), (attained[1][:, k] - high).max())
    if beyond > rounding:
        why = f"In a run, {bounds.names[k]} never happens." if beyond == np.inf else "A run is beyond the limit."
        return _Decision(False, why, margin)
    if doubt := _doubt(bounds, bounds.names[k]):
        return _Decision(None, f"{WARNED}: {shorten(doubt, 60, placeholder=' ...')}", margin)
    if beyond > 0:
        why = f"A run is beyond the limit, but only by rounding or noise of {rounding:.2g}{unit}. {_MOVE}"
        return _Decision(None, why, margin)
    if bounds.kind == "sampled":
        why = f"All {bounds.evaluations} runs satisfy the limit. PolynomialChaos() also estimates values between runs."
        return _Decision(None, why, margin)
    if bounds.kind == "enclosure":
        if (margin >= 0).all():
            return _Decision(True, "It is proved that no response violates the limit at the output times.", margin)
        if ((lower > high) | (upper < low)).any():
            return _Decision(False, "There is a time at which all responses are beyond the limit.", margin)
        why = "The proved bounds are beyond the limit, but may be wider than the responses. Use more boxes."
        return _Decision(None, why, margin)
    if bounds.estimate is None:
        return _Decision(None, "The bounds have no estimated error. Use PolynomialChaos().", margin)
    sides = [_side_decision(bounds, k, *end) for end in zip(SIDES, (low, high), strict=True) if np.isfinite(end[1])]
    worst = min(sides, key=lambda side: ((False, None, True).index(side.kept), side.margin.min()))
    return worst._replace(margin=np.min([side.margin for side in sides], axis=0))


def _side_decision(bounds: Envelope, k: int, side: str, limit: float) -> _Decision:
    """The decision on the lower or the upper limit, from its margin and the estimated error at each time.

    If the margin is about as small as this error, further runs search for a violation.
    """
    assert bounds.estimate is not None
    margin = bounds.lower[:, k] - limit if side == "lower" else limit - bounds.upper[:, k]
    estimate, rounding, further = bounds.estimate[:, k], rounding_of(bounds, k), None
    unit = unit_suffix(bounds, k)
    near = _UNCERTAIN_ERRORS * estimate
    if bounds.study is not None and bounds.study.has_lanes:
        near = near + _NEAR_WIDTHS * (bounds.upper - bounds.lower)[:, k].max()
    if bounds.study is not None and (margin < near).any():
        with suppress(RunsUsedUpError):
            further = closest_run(bounds, k, side, limit, np.argsort(margin, kind="stable"), rounding)
        if further and (found := by_further_run(further, limit, margin, rounding, unit)):
            # Few runs of a black box are near one local extreme. Bounds with a warning may lack a larger one.
            own = [doubt for doubt in bounds.doubts if concerned(doubt, [bounds.names[k]])]
            if not (found.kept and own) or further.is_flat or bounds.study.has_lanes:
                return found
            return found._replace(kept=None, why=f"{WARNED}: {shorten(own[0], 60, placeholder=' ...')}")
    if (margin < -np.maximum(estimate, rounding)).any():
        error = estimate[(margin + estimate).argmin()]
        why = f"The bounds are beyond the limit by more than their estimated error of {error:.2g}{unit}."
        return _Decision(False, why, margin, further)
    if (margin >= estimate).all():
        error = estimate[margin.argmin()]
        return _Decision(True, f"The margin exceeds the estimated error of {error:.2g}{unit}.", margin, further)
    error, remedy = estimate[(margin - estimate).argmin()], "Use a smaller PolynomialChaos(tolerance=...)."
    if bounds.next_run is not None:
        remedy = "Add a run at the parameters Bounds.next_run."
    return _Decision(
        None, f"The estimated error of {error:.2g}{unit} is larger than the margin. {remedy}", margin, further
    )


def by_further_run(further: FurtherRun, limit: float, margin: Array, rounding: float, unit: str) -> _Decision | None:
    """The decision by the further run that is closest to a limit; None if the search was not completed.

    The limit is violated if the run is beyond the limit. The limit is satisfied if the run is farther inside than the
    error of the search, or if the output is constant exactly at the limit.
    """
    inside, error = -further.beyond, max(further.error, rounding)
    own = limit - further.values if further.side == "upper" else further.values - limit
    if inside < -rounding:
        why = f"A further run is beyond the limit{between_text(further)}."
        return _Decision(False, why, np.fmin(margin, own), further)
    if further.failed:
        why = f"{further.failed} of {further.runs} further runs near the limit failed."
        return _Decision(None, why, margin, further)
    if further.is_flat and np.isfinite(error) and abs(inside) <= LAST_DIGITS * abs(limit):
        why = f"Most of {further.runs} further runs attain the limit exactly. No run is beyond the limit."
        return _Decision(True, why, np.fmin(np.maximum(margin, 0.0), own), further)
    if inside <= rounding:
        why = f"A further run reaches the limit, up to rounding or noise of {rounding:.2g}{unit}. {_MOVE}"
        return _Decision(None, why, margin, further)
    if not np.isfinite(error):
        return None
    kept, is_larger = (True, "is larger") if inside > error else (None, "is not larger")
    least = f"The closest of {further.runs} further runs is {inside:.3g}{unit} inside the limit."
    why = f"{least} This margin {is_larger} than the error of the search, {error:.2g}{unit}."
    return _Decision(kept, why, np.fmin(np.maximum(margin, inside), own), further)


def _ends(owner: str, name: str, pair: object, unit: str) -> tuple[float, float]:
    """The limit (low, high) of an output, as numbers in its unit; infinite if there is no limit."""
    own = f"{owner}: the limit of {name!r}"
    ends = [
        number_in(own, f"output {name!r}", end, unit) if isinstance(end, str | tuple) else end
        for end in _pair(own, pair)
    ]
    numbers = [numbers_of(end) if is_real(end) else None for end in ends]  # None beyond the range of doubles
    if not all(end is None or (x is not None and not np.isnan(x)) for end, x in zip(ends, numbers, strict=True)):
        raise DeclarationError(f"{own}: both ends must be numbers or None, got {shown(ends)}.")
    low, high = (default if end is None else float(end) for end, default in zip(ends, (-np.inf, np.inf), strict=True))
    if low > high:
        raise DeclarationError(f"{owner}: the lower limit of {name!r}, {low:g}, is above the upper limit, {high:g}.")
    if not np.isfinite([low, high]).any():
        raise DeclarationError(f"{owner}: one end of the limit of {name!r} must be finite, got {shown(ends)}.")
    return low, high


def _pair(own: str, pair: object) -> Sequence[Any]:
    """The two ends of a limit as given. A unit after the two ends applies to both."""
    if isinstance(pair, list | tuple) and len(pair) == 3 and isinstance(pair[2], str):
        pair = tuple(end if end is None else (end, pair[2]) for end in pair[:2])
    if not isinstance(pair, list | tuple) or len(pair) != 2 or all(end is None for end in pair):
        raise DeclarationError(f"{own} must be a pair (low, high) with at most one None, got {shown(pair)}.")
    return pair


_ORDER = False, None, True
"""Results of a limit. The first result that occurs in a combination is the result for all combinations."""


def joined_limits(bounds: Envelope, found: Sequence[Sequence[KeptLimit]]) -> list[KeptLimit]:
    """For each limit, the result of the combination that is worst."""
    limits = list[KeptLimit]()
    for own in zip(*found, strict=True):
        k = min(range(len(own)), key=lambda n: (_ORDER.index(own[n].kept), own[n].share))
        limit, box, part = own[k], bounds.box, bounds.parts[k].box
        if limit.kept and bounds.lost:
            limit = replace(limit, kept=None, why="Some combinations of choices have no bounds.")
        if limit.further is not None and box is not None and part is not None:
            place = box.to_unit(part.from_unit(limit.further.place[None]))[0]
            limit = replace(limit, further=replace(limit.further, place=place))
        limits.append(limit)
    return limits
