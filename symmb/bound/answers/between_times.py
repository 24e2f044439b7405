"""Checks of limits between output times. Scalar outputs give the lowest and highest values of runs."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from symmb._magnitudes import SAME
from symmb._types import Array
from symmb.bound.answers.envelope import Envelope
from symmb.bound.answers.further_runs import Excess, attaining_points, rows_of_runs
from symmb.bound.answers.limits import KeptLimit, between_text, by_further_run, rounding_of, unit_suffix
from symmb.bound.nodes import corners
from symmb.bound.responses import SIDES
from symmb.bound.searches import direct_search

_RISE_SAFETY = 2.0
"""Safety factor on the rise between two output times, because the curve may rise more than the parabola."""
_REPEATED = 8
"""Largest number of runs of the study that are repeated for one end of a limit."""
_MOST_CORNERS = 64
"""Largest number of corners at which runs are made. Between output times, another corner may be the worst."""
_STARTS, _MOST_RUNS = 6, 300
"""Number of runs from which a search for closer runs starts, and largest number of its runs."""


def with_peaks(bounds: Envelope, limits: Sequence[KeptLimit]) -> tuple[list[KeptLimit], list[str]]:
    """The limits after a check of the curves between output times, and remarks on limits that may be violated.

    For a scene, the nominal run, the corners and the runs closest to a limit are repeated. These runs give the lowest
    and highest values over time. If one of these runs is closer to the limit than the bounds, further runs search for
    the closest run. For other simulators, parabolas through three neighbouring times estimate the bounds between the
    times. Scalar outputs have no times.
    """
    curves = [limit for limit in limits if limit.output not in bounds.figures and len(bounds.t) > 1]
    names, study = tuple(limit.output for limit in curves), bounds.study
    if not curves or study is None or not study.has_lanes:
        told = [_remark(bounds, limit) for limit in curves if limit.kept is not False and len(bounds.t) > 2]
        return list(limits), [remark for remark in told if remark]
    points = np.concatenate([_first(bounds), *(part for limit in curves for part in _repeated(bounds, limit))])
    extremes, examined, remarks = study.extremes(names, points), dict[str, KeptLimit](), list[str]()
    for j, limit in enumerate(curves):
        k, ends = bounds.names.index(limit.output), (limit.low, limit.high)
        found = [Excess(bounds, k, side, end) for side, end in zip(SIDES, ends, strict=True)]
        for excess, own in zip(found, extremes[..., j], strict=True):
            excess.add(points, own)
            limit = _examined(bounds, limit, k, excess, points)
        examined[limit.output] = limit
        n = int(np.argmin([excess.largest for excess in found]))
        if found[n].largest > rounding_of(bounds, k):
            verb, unit = ("fall below", "exceed")[n], unit_suffix(bounds, k)
            remarks.append(
                f"In other cases {limit.output} may {verb} its limit of {ends[n]:.6g}{unit} by "
                f"{found[n].largest:.3g}{unit}."
            )
    return [examined.get(limit.output, limit) for limit in limits], remarks


def _examined(bounds: Envelope, limit: KeptLimit, k: int, excess: Excess, points: Array) -> KeptLimit:
    """The limit of output k. If a run at points (n, d) is the closest so far, a search starts."""
    is_lower, rounding = excess.side == "lower", rounding_of(bounds, k)
    inside = bounds.lower[:, k] - limit.low if is_lower else limit.high - bounds.upper[:, k]
    if not np.isfinite(inside).all():
        return limit
    row = int(inside.argmin())
    known = -float(inside[row])
    if limit.kept is not False and bounds.estimate is not None:  # a violated limit is stated by its worst run instead
        known += float(bounds.estimate[row, k])
    if limit.further and limit.further.side == excess.side:
        known = max(known, limit.further.beyond)
    if limit.kept is False:
        known = max(known, -float(limit.margin.min()))
    if excess.largest <= (known if limit.kept is False else min(known, 0.0)) + rounding:
        return limit
    error = np.inf
    if limit.kept is not False and excess.largest <= rounding:
        starts = points[np.argsort(-excess.first, kind="stable")[:_STARTS]]
        error = direct_search(excess, starts, _MOST_RUNS, rounding).error
    further, unit = excess.further_run(error), unit_suffix(bounds, k)
    kept, why = limit.kept, limit.why
    if kept is not False and excess.largest > rounding:
        kept, why = False, f"A run is beyond the limit{between_text(further)}."
    elif kept:
        found = by_further_run(further, limit.low if is_lower else limit.high, limit.margin, rounding, unit)
        close = f"{excess.runs} runs stay {-excess.largest:.3g}{unit} inside the limit, but others may be closer."
        kept, why = (found.kept, found.why) if found else (None, f"{close} Use limits of mb.maximum or mb.minimum.")
    margin = limit.margin.copy()
    margin[further.row] = min(margin[further.row], -excess.largest)
    return replace(limit, kept=kept, why=why, margin=margin, row=further.row, further=further, between=further.between)


def _first(bounds: Envelope) -> Array:
    """Points (n, d) of the unit box: nominal parameters in the box, and the corners if there are few."""
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
    unit = unit_suffix(bounds, bounds.names.index(limit.output))
    return (
        f"Between two output times {limit.output} may come closer to its limit by about {rise:.2g}{unit}, and exceed "
        f"the limit. Use more times, or bound mb.maximum or mb.minimum of {limit.output}."
    )


def _by_parabolas(bounds: Envelope, limit: KeptLimit) -> float:
    """The largest rise of the bounds between two output times by parabolas; 0 if the rises are small."""
    k = bounds.names.index(limit.output)
    margins = np.maximum([bounds.lower[:, k] - limit.low, limit.high - bounds.upper[:, k]], 0.0)
    error = np.zeros(len(bounds.t)) if bounds.estimate is None else bounds.estimate[:, k]
    rises = [(_rise(bounds.t, -own, error), own[1:-1]) for own in margins if np.isfinite(own).all()]
    return max((float(rise[rise > own / _RISE_SAFETY].max(initial=0.0)) for rise, own in rises), default=0.0)


def _rise(t: Array, y: Array, error: Array) -> Array:
    """Rise (n_t - 2,) of parabolas through three neighbouring values above the middle value; 0 without a peak.

    Values (n_t,) that differ by less than their errors (n_t,) are no peak, because the output may saturate there.
    """
    left, right = np.diff(y)[:-1] / np.diff(t)[:-1], np.diff(y)[1:] / np.diff(t)[1:]
    before, after = np.diff(t)[:-1], np.diff(t)[1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (left * after + right * before) / (before + after)
        rise = slope**2 * (before + after) / (4 * (left - right))
    least = np.maximum(SAME * np.abs(y).max(), error[1:-1])
    flat = np.pad((np.abs(left) * before <= least) & (np.abs(right) * after <= least), 1)
    peaks = (left >= 0) & (right <= 0) & (left > right) & ~(flat[:-2] | flat[1:-1] | flat[2:])
    return np.where(peaks, rise, 0.0)
