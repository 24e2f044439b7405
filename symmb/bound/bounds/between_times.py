"""Limits of curves between output times, where scalar outputs give the lowest and highest values of runs."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from symmb._magnitudes import SAME
from symmb._types import Array
from symmb.bound.bounds.direct_search import direct_search
from symmb.bound.bounds.envelope import Envelope
from symmb.bound.bounds.further_runs import FurtherRun, attaining_points, rows_of_runs
from symmb.bound.bounds.limits import KeptLimit, by_further_run, rounding_of, unit_told
from symmb.bound.bounds.worst_case import SIDES
from symmb.bound.nodes import corners

_RISE_SAFETY = 2.0
"""Safety factor on the rise between two output times. The curve may rise more than the parabola."""
_REPEATED = 8
"""Largest number of runs of the study that are repeated for one end of a limit."""
_MOST_CORNERS = 64
"""Largest number of corners at which runs are made, because a corner may be worst only between two output times."""
_STARTS, _MOST_RUNS = 6, 300
"""Number of runs from which a search for closer runs starts, and largest number of its runs."""


def with_peaks(bounds: Envelope, limits: Sequence[KeptLimit]) -> tuple[list[KeptLimit], list[str]]:
    """The limits after an examination of the curves between output times, and remarks on limits that may be violated.

    The nominal run of a scene, the corners and the runs closest to a limit are repeated with the lowest and highest
    values over time. If one of them comes closer to the limit than the bounds, further runs search for the closest one.
    For other simulators, parabolas through three neighbouring times estimate the bounds between them. Scalar outputs
    have no times.
    """
    curves = [limit for limit in limits if limit.output not in bounds.figures and len(bounds.t) > 1]
    names, study = tuple(limit.output for limit in curves), bounds.study
    if not curves or study is None or not study.has_lanes:
        told = [_remark(bounds, limit) for limit in curves if limit.kept is not False and len(bounds.t) > 2]
        return list(limits), [remark for remark in told if remark]
    points = np.concatenate([_first(bounds), *(part for limit in curves for part in _repeated(bounds, limit))])
    extremes, examined, remarks = study.extremes(names, points), dict[str, KeptLimit](), list[str]()
    for j, limit in enumerate(curves):
        searches = [_Excess(bounds, limit, side, names) for side in SIDES]
        for search, own in zip(searches, extremes[..., j], strict=True):
            search.add(points, own)
            limit = search.examined(limit, points)
        examined[limit.output] = limit
        less = min(searches, key=lambda search: search.largest)
        if less.largest > rounding_of(bounds, bounds.names.index(limit.output)):
            remarks.append(less.remark())
    return [examined.get(limit.output, limit) for limit in limits], remarks


class _Excess:
    """The excess of the highest or lowest values of runs over one end of a limit, which is negative inside.

    The run with the largest excess is stored.
    """

    def __init__(self, bounds: Envelope, limit: KeptLimit, side: str, names: tuple[str, ...]) -> None:
        self._bounds, self._side, self._names = bounds, side, names
        self._number, self._k = names.index(limit.output), bounds.names.index(limit.output)
        self._sign, self._end = (-1.0, limit.low) if side == "lower" else (1.0, limit.high)
        self.runs, self.failed, self.largest = 0, 0, -np.inf
        self.place, self.values = np.zeros(0), np.zeros(0)

    def __call__(self, points: Array) -> Array:
        """Excess (N,) at points (N, d); minus infinity for failed runs."""
        assert self._bounds.study is not None
        own = self._bounds.study.extremes(self._names, points)[SIDES.index(self._side), :, self._number]
        return self.add(points, own)

    def add(self, points: Array, own: Array) -> Array:
        """Excess (N,) of runs with the extremes (N,) at points (N, d)."""
        excess = np.nan_to_num(self._sign * (own - self._end), nan=-np.inf)
        i = int(excess.argmax())
        if excess[i] > self.largest:
            self.largest, self.place = float(excess[i]), points[i]
        self.values = excess
        self.runs, self.failed = self.runs + len(points), self.failed + int(np.isnan(own).sum())
        return excess

    def examined(self, limit: KeptLimit, points: Array) -> KeptLimit:
        """The limit after a search from the best of the points (n, d), if these come closer than the bounds."""
        if not np.isfinite(self._end):
            return limit
        bounds, k = self._bounds, self._k
        rounding, estimate = rounding_of(bounds, k), bounds.estimate
        bound = self._sign * ((bounds.lower if self._side == "lower" else bounds.upper)[:, k] - self._end)
        row = int(bound.argmax())
        known = float(bound[row]) + (0.0 if estimate is None else float(estimate[row, k]))
        if limit.kept is False:
            known = max(known, -float(limit.margin.min()))
        if self.largest <= (known if limit.kept is False else min(known, 0.0)) + rounding:
            return limit
        error = np.inf
        if limit.kept is not False and self.largest <= rounding:
            starts = points[np.argsort(-self.values, kind="stable")[:_STARTS]]
            error = direct_search(self, starts, _MOST_RUNS, rounding).error
        further, time = self._further_run(error)
        kept, why = self._decided(limit, further, time, rounding)
        margin = limit.margin.copy()
        margin[further.row] = min(margin[further.row], -self.largest)
        between = np.nan if time in bounds.t else time
        return replace(limit, kept=kept, why=why, margin=margin, row=further.row, further=further, between=between)

    def remark(self) -> str:
        """A sentence on this end of a limit, if the other end is exceeded by more."""
        name, verb = self._bounds.names[self._k], "fall below" if self._side == "lower" else "exceed"
        unit = unit_told(self._bounds, self._k)
        return f"In other cases {name} may {verb} its limit of {self._end:.6g}{unit} by {self.largest:.3g}{unit}."

    def _decided(self, limit: KeptLimit, further: FurtherRun, time: float, rounding: float) -> tuple[bool | None, str]:
        """The result of the limit and its reason, from the run that comes closest to it, at a time."""
        if limit.kept is False:
            return False, limit.why
        if self.largest > rounding:
            between = "" if time in self._bounds.t else f" between two output times, at {time:.4g} s"
            return False, f"A run is beyond the limit{between}."
        if limit.kept is None:
            return None, limit.why
        unit = unit_told(self._bounds, self._k)
        found = by_further_run(further, self._end, limit.margin, rounding, unit)
        if found is not None:
            return found.kept, found.why
        close = (
            f"Between output times, {self.runs} runs stay {-self.largest:.3g}{unit} inside. Other runs may be closer."
        )
        return None, f"{close} Limit mb.maximum or mb.minimum of {limit.output}."

    def _further_run(self, error: float) -> tuple[FurtherRun, float]:
        """The run with the largest excess, and the time of its extreme [s]."""
        bounds, study = self._bounds, self._bounds.study
        assert study is not None
        times, Y = study.at_many_times(self.place)
        values = Y[:, [name for name in bounds.names if name not in bounds.figures].index(bounds.names[self._k])]
        every = (len(times) - 1) // (len(bounds.t) - 1)
        moment = int(np.nan_to_num(self._sign * values, nan=-np.inf).argmax())
        at_times, row = values[::every].copy(), int(np.abs(bounds.t - times[moment]).argmin())
        at_times[row] = self._end + self._sign * self.largest  # so that this run is the worst case at this time
        further = FurtherRun(
            self._side, self.place, at_times, self.largest, error, self.runs, self.failed, is_flat=False
        )
        return further, float(times[moment])


def _first(bounds: Envelope) -> Array:
    """Points (n, d) of the unit box: nominal parameters in the box, and the corners if they are few."""
    box = bounds.box
    assert box is not None
    nominal = [] if bounds._left_out else [[bounds.nominal_parameters[name] for name in box.names]]
    ends = corners(len(box)) if 2 ** len(box) <= _MOST_CORNERS else np.zeros((0, len(box)))
    return np.concatenate([box.to_unit(np.reshape(nominal, (-1, len(box)))), ends])


def _repeated(bounds: Envelope, limit: KeptLimit) -> Iterator[Array]:
    """Points (n, d) of the unit box: the closest further run, and the runs of the study closest to the ends."""
    k = bounds.names.index(limit.output)
    if limit.further is not None:
        yield limit.further.place[None]
    margins = bounds.lower[:, k] - limit.low, limit.high - bounds.upper[:, k]
    for side, own in zip(SIDES, margins, strict=True):
        if np.isfinite(own).all():
            rows = rows_of_runs(bounds, k, side, np.argsort(own, kind="stable"))
            yield attaining_points(bounds, k, side, rows[:_REPEATED])


def _remark(bounds: Envelope, limit: KeptLimit) -> str:
    """A remark on a limit that the bounds may exceed between two output times, by parabolas; otherwise empty."""
    rise = _by_parabolas(bounds, limit)
    if not rise:
        return ""
    unit = unit_told(bounds, bounds.names.index(limit.output))
    return (
        f"Between two output times {limit.output} may come closer to its limit by about {rise:.2g}{unit}, and exceed "
        f"the limit. Use more times, or bound mb.maximum or mb.minimum of {limit.output}."
    )


def _by_parabolas(bounds: Envelope, limit: KeptLimit) -> float:
    """The largest rise of the bounds between two output times by parabolas; 0 if the rises are small."""
    k = bounds.names.index(limit.output)
    margins = np.maximum([bounds.lower[:, k] - limit.low, limit.high - bounds.upper[:, k]], 0.0)
    rises = [(_rise(bounds.t, -own), own[1:-1]) for own in margins if np.isfinite(own).all()]
    return max((float(rise[rise > own / _RISE_SAFETY].max(initial=0.0)) for rise, own in rises), default=0.0)


def _rise(t: Array, y: Array) -> Array:
    """Rise (n_t - 2,) above each inner value of the parabola through it and its neighbours; 0 without a peak."""
    left, right = np.diff(y)[:-1] / np.diff(t)[:-1], np.diff(y)[1:] / np.diff(t)[1:]
    before, after = np.diff(t)[:-1], np.diff(t)[1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (left * after + right * before) / (before + after)
        rise = slope**2 * (before + after) / (4 * (left - right))
    least = SAME * np.abs(y).max()
    flat = np.pad((np.abs(left) * before <= least) & (np.abs(right) * after <= least), 1)  # the output saturates
    peaks = (left >= 0) & (right <= 0) & (left > right) & ~(flat[:-2] | flat[1:-1] | flat[2:])
    return np.where(peaks, rise, 0.0)
