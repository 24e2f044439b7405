"""The first switch that a step passes: the search of c/switches.h on NumPy arrays."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from symmb._types import Array, Indices
from symmb.schemes.embedded_pair import interpolated, interpolated_change
from symmb.schemes.roots import roots

LEAST_PART = 2.0**-40
"""Share of a step: shorter parts are judged by their ends."""
MOST_PARTS = 64
"""Open parts of a step at once: nothing is known behind them."""
LONG_PART = 2.0**-6
"""Share of a step in which parts are judged by their ends if there are so many: a step must not become too short."""
_SLIGHT = 1e-3
"""Share of a switch's rounding that counts as 0 within a step: that of a narrow pulse exceeds its height."""
_SLOPE_OFF = 16 * np.sqrt(3) / 9
"""A slope is off that of the cubic by so many times the largest distance of states."""

Values = Callable[[Array, Array, Indices], Array]
"""States x (n, k), shares (k,), lanes (k,) -> values (m, k)."""
Bounds = Callable[[Array, Array, Array, Indices], tuple[Array, Array, Array]]
"""Boxes (4 n, k) of `ranges_along`, begins and ends as shares (k,), lanes (k,) -> (m, k): least values, least and
largest changes over the part."""


class _Parts(NamedTuple):
    """Parts of steps of L lanes that nothing is open in but what their ends tell, lane after lane and in order.

    Attributes
    ----------
    lane, low, high : (k,)   lanes, and ends as shares of their steps
    begin, end : (m, k)      values at the ends
    known : (L,)             share of the step up to which parts are known
    """

    lane: Indices
    low: Array
    high: Array
    begin: Array
    end: Array
    known: Array


def _parts(x: Array, F: Array, values: Values, bounds: Bounds, begin: Array, rounding: Array) -> _Parts:
    """Halve steps from x (n, L) with interpolants F (7, n, L) until ranges along them leave nothing open.

    Values (m,) begin (m, L) may fall below 0 by rounding (m, 1) and rise again.
    """
    L = x.shape[1]
    known, lane, low, high = np.ones(L), np.arange(L, dtype=np.intp), np.zeros(L), np.ones(L)
    off = np.abs(F[3]) / 16 + 0.1875 * (np.abs(F[4]) + np.abs(F[5])) + 0.25 * np.abs(F[6])
    x_low, dx_low, u_low = x, interpolated_change(F, np.zeros(L)), begin
    x_high, dx_high = interpolated(x, F, high), interpolated_change(F, high)
    u_high = values(x_high, high, lane)
    found: list[tuple[Any, ...]] = [(lane[:0], low[:0], high[:0], begin[:, :0], begin[:, :0])]
    while lane.size:
        share = high - low
        box = _box(x_low, share * dx_low, x_high, share * dx_high, share**4 * off[:, lane])
        least, fall, rise = bounds(box, low, high, lane)
        lost = np.where(share < 1, _SLIGHT * rounding, 0.0)  # a whole step near a switch is looked at in halves
        start = u_low + lost
        between = (u_high >= 0) & (start >= 0) & (start * rise - (u_high + lost) * fall > -fall * rise)
        told = (least > np.where(u_high < 0, 0.0, -lost)) | between | (fall >= 0) | (rise <= 0)
        open_ = ~told.all(axis=0) & (share > LEAST_PART)
        rows = np.flatnonzero(open_)
        crowded = lane[rows[_number_in_lane(lane[rows], L) == MOST_PARTS]]
        open_ &= ~(np.isin(lane, crowded) & (low < LONG_PART))
        done = ~open_
        found.append((lane[done], low[done], high[done], u_low[:, done], u_high[:, done]))
        passed = done & ((u_low >= 0) & (u_high < 0)).any(axis=0)
        np.minimum.at(known, lane[passed], high[passed])  # what is behind a pass does not matter
        rows = np.flatnonzero(open_ & (low < known[lane]))
        beyond = np.flatnonzero(_number_in_lane(lane[rows], L) == MOST_PARTS)
        np.minimum.at(known, lane[rows[beyond]], low[rows[beyond]])
        rows = rows[low[rows] < known[lane[rows]]]
        middle, of = (low[rows] + high[rows]) / 2, lane[rows]
        F_middle = F[:, :, of]
        x_middle, dx_middle = interpolated(x[:, of], F_middle, middle), interpolated_change(F_middle, middle)
        u_middle = values(x_middle, middle, of)
        order = np.arange(2 * len(rows)).reshape(2, -1).T.ravel()  # both halves of each part in order

        def halves(first: Any, second: Any, order: Indices = order) -> Any:
            return np.concatenate([first, second], axis=-1)[..., order]

        lane, low, high = halves(of, of), halves(low[rows], middle), halves(middle, high[rows])
        x_low, x_high = halves(x_low[:, rows], x_middle), halves(x_middle, x_high[:, rows])
        dx_low, dx_high = halves(dx_low[:, rows], dx_middle), halves(dx_middle, dx_high[:, rows])
        u_low, u_high = halves(u_low[:, rows], u_middle), halves(u_middle, u_high[:, rows])
    joined: Any = (np.concatenate(part, axis=-1) for part in zip(*found, strict=True))
    lane, low, high, u_low, u_high = joined
    order = np.lexsort((low, lane))
    order = order[low[order] < known[lane[order]]]
    return _Parts(lane[order], low[order], high[order], u_low[:, order], u_high[:, order], known)


def first_pass(
    x: Array, F: Array, values: Values, bounds: Bounds, begin: Array, rounding: Array
) -> tuple[Array, Indices]:
    """The first switch that falls below 0 in each of L lanes: share of the step (L,), and its number.

    The share is infinite without one, and the number -1 where nothing is known behind the share. Parameters are those
    of `_parts`, switches (m,) being on their sides.
    """
    L = x.shape[1]
    found = _parts(x, F, values, bounds, begin, rounding)
    when, which = np.where(found.known < 1, found.known, np.inf), np.full(L, -1)
    number, part = np.nonzero(found.end < 0)
    first = part == _first_in_lane(found.lane, part, L)[found.lane[part]]
    number, part = number[first], part[first]
    lane = found.lane[part]
    every = np.arange(len(lane))

    def value(theta: Array) -> Array:
        return values(interpolated(x[:, lane], F[:, :, lane], theta), theta, lane)[number, every]

    if lane.size:
        at_low, at_high = np.maximum(found.begin[number, part], 0.0), found.end[number, part]
        theta = roots(value, found.low[part], found.high[part], at_low, at_high)
        when[lane] = np.inf
        for k in np.argsort(-theta, kind="stable"):  # the earliest comes last
            when[lane[k]], which[lane[k]] = theta[k], number[k]
    jumped = (begin < 0).any(axis=0)  # with another switch, at the begin of the step
    when[jumped], which[jumped] = np.finfo(float).eps, (begin < 0).argmax(axis=0)[jumped]
    return when, which


def _box(x: Array, dx: Array, x_end: Array, dx_end: Array, off: Array) -> Array:
    """The box (4 n, k) of parts with states and changes at their ends, states being off the cubic by `off` at most."""
    d = x_end - x
    first, last, bend = (dx - d) / 4, (d - dx_end) / 4, 0.75 * (2 * d - dx - dx_end)
    least, most = np.minimum(np.minimum(first, last), 0), np.maximum(np.maximum(first, last), 0)
    slope_off = _SLOPE_OFF * off
    return np.concatenate(
        [
            np.minimum(x, x_end) + least - off,
            np.maximum(x, x_end) + most + off,
            np.minimum(dx, dx_end) + np.minimum(bend, 0) - slope_off,
            np.maximum(dx, dx_end) + np.maximum(bend, 0) + slope_off,
        ]
    )


def _number_in_lane(lane: Indices, L: int) -> Indices:
    """The number of each entry among those of its lane; lanes are in order."""
    counts = np.bincount(lane, minlength=L)
    return np.arange(len(lane)) - (np.cumsum(counts) - counts)[lane]


def _first_in_lane(lane: Indices, part: Indices, L: int) -> Indices:
    """The first of some parts in each lane (L,)."""
    first = np.full(L, len(lane))
    np.minimum.at(first, lane[part], part)
    return first
