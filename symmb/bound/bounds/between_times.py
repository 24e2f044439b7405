"""Limits between output times: the runs that come close to a limit are repeated at many times."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from symmb._magnitudes import SAME
from symmb._types import Array
from symmb.bound.bounds.envelope import Envelope
from symmb.bound.bounds.further_runs import FurtherRun, attaining_points, rows_of_runs
from symmb.bound.bounds.limits import KeptLimit, rounding_of, unit_told
from symmb.bound.bounds.worst_case import SIDES
from symmb.bound.nodes import corners

_RISE_SAFETY = 2.0
"""Safety factor on the rise between two output times. Runs that are not repeated may rise more, and a curve may rise
more than a parabola."""
_REPEATED = 8
"""Largest number of runs of the study that are repeated for one end of a limit."""
_MOST_CORNERS = 64
"""Largest number of corners at which runs are made, because a corner may be worst only between two output times."""


def with_repeats(bounds: Envelope, limits: Sequence[KeptLimit]) -> tuple[list[KeptLimit], list[str]]:
    """The limits, violated if a run is beyond them between output times, and remarks on limits that may be violated.

    For scenes, the nominal run and the runs closest to a limit are repeated at many times. For other simulators,
    parabolas through three neighbouring times estimate the bounds between them. Scalar outputs have no times.
    """
    open_ones = [limit for limit in limits if limit.kept is not False and limit.output not in bounds.figures]
    repeats, points = None, np.zeros((0, 0))
    if open_ones and bounds.study is not None:
        points = np.concatenate([_first(bounds), *(part for limit in open_ones for part in _repeated(bounds, limit))])
        repeats = bounds.study.at_many_times(points)
    results, remarks = [], list[str]()
    for limit in limits:
        k, rise = bounds.names.index(limit.output), 0.0
        if limit in open_ones:
            if repeats is not None:
                times, Y = repeats
                limit, rise = _by_runs(bounds, limit, points, times, Y[:, :, k])
            elif len(bounds.t) > 2:
                rise = _by_parabolas(bounds, limit)
        results.append(limit)
        if rise:
            remarks.append(
                f"Between two output times {limit.output} may come closer to its limit by about {rise:.2g}"
                f"{unit_told(bounds, k)}, and exceed the limit. Use more times, or bound mb.maximum or mb.minimum of "
                f"{limit.output}."
            )
    return results, remarks


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


def _by_runs(bounds: Envelope, limit: KeptLimit, points: Array, times: Array, values: Array) -> tuple[KeptLimit, float]:
    """The limit after runs with values (n, many) at points (n, d), and the rise between output times; 0 if small."""
    inside = np.nan_to_num(np.minimum(values - limit.low, limit.high - values), nan=np.inf)
    run, moment = np.unravel_index(inside.argmin(), inside.shape)
    least, every = float(inside[run, moment]), (len(times) - 1) // (len(bounds.t) - 1)
    if least >= -rounding_of(bounds, bounds.names.index(limit.output)):
        rise = float(inside[:, ::every].min()) - least
        return limit, rise if rise > limit.margin.min() / _RISE_SAFETY else 0.0
    margin = limit.margin.copy()
    row = int(np.abs(bounds.t - times[moment]).argmin())
    margin[row] = min(margin[row], least)
    between = f" between two output times, at {times[moment]:.4g} s" if moment % every else ""
    why = f"A run is beyond the limit{between}."
    side, own = SIDES[int(values[run, moment] > limit.high)], values[run, ::every].copy()
    own[row] = values[run, moment]  # so that this run is the worst case at the output time beside
    before = (limit.further.runs, limit.further.failed) if limit.further else (0, 0)
    further = FurtherRun(side, points[run], own, -least, np.inf, *before, False)
    return replace(limit, kept=False, why=why, margin=margin, row=int(margin.argmin()), further=further), 0.0


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
