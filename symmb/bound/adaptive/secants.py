"""Kinks, cusps and events between the runs of one parameter: intersections of secants, and halved intervals."""

from itertools import product

import numpy as np

from symmb._limits import windows
from symmb._types import Array, Indices, Mask
from symmb.bound.adaptive.check_points import SAFETY
from symmb.bound.adaptive.runs import Runs, relative_errors, relative_rms
from symmb.bound.adaptive.surrogate import EstimatedRange, Evidence
from symmb.bound.polynomials import Expansion
from symmb.bound.polynomials.ranges import Piecewise

LEAST_SHARE_BESIDE_CUSP = 0.2
"""Smallest distance of a vertex from the ends of an interval, divided by the length of the interval. The limit applies
if slopes increase towards the vertex, as at cusps."""


def secant_extremes(points: Array, Y: Array, noise: Array) -> tuple[Array, Array]:
    """Places (2, n_t, n_y, 1) of possible minima and maxima, and their largest distance beyond responses (2, n_t, n_y).

    One secant passes through the two runs on the left of an interval, the other through the two runs on its right. The
    secants bound a response that is convex or concave between these runs. At an end of the box, or if the slope in the
    interval is not between the slopes of the secants, each secant may continue to the other side.

    Parameters
    ----------
    points : (N, 1)         of the unit box, three or more
    Y : (N, n_t, n_y)       responses at the points
    noise : (n_y,)          of the responses; it is subtracted from slopes
    """
    _, order = np.unique(points[:, 0].round(9), return_index=True)  # over shorter distances, slopes are only rounding
    x = points[order, 0]
    n_t, n_y = Y.shape[1:]
    places, beyond = np.empty((2, n_t, n_y, 1)), np.empty((2, n_t, n_y))
    for window in windows(n_t, 32 * n_y * len(x)):  # arrays of 0.3 MB stay in the processor's cache
        for side, sign in enumerate((1.0, -1.0)):
            values, at = _lowest(x, sign * Y[order, window], noise)
            least = (sign * Y[:, window]).min(axis=0)
            which = values.argmin(axis=0)[None]
            beyond[side, window] = np.maximum(least - np.take_along_axis(values, which, axis=0)[0], 0.0)
            places[side, window, :, 0] = np.take_along_axis(at, which, axis=0)[0]
    return places, beyond


def _lowest(x: Array, y: Array, noise: Array) -> tuple[Array, Array]:
    """The largest excess that secants through responses y (N, ...) allow between points x (N,), and its place."""
    h = np.diff(x)[:, None, None]
    slope = np.diff(y, axis=0) / h
    # Noise at both ends changes the slope of a secant by up to 2 noise / h. Only the remainder is used as slope.
    sure = np.sign(slope) * np.maximum(np.abs(slope) - 2 * noise / h, 0.0)
    (before, growth_before), (after, growth_after) = _outer(sure), (each[::-1] for each in _outer(sure[::-1]))
    left, right = before * growth_before, after * growth_after
    # If the slope of an interval is between the neighbouring slopes, the response is convex or concave. It then has a
    # minimum inside only if the neighbouring slopes have opposite signs. At an end of the box, there is one secant.
    bends = (np.minimum(left, right) <= slope) & (slope <= np.maximum(left, right))
    bends[[0, -1]] = False
    is_valley = bends & (left < 0) & (right > 0)
    crossing = np.divide(slope - right, left - right, out=np.full_like(slope, 0.5), where=is_valley)
    least = np.minimum(np.maximum(growth_before, growth_after) - 1, LEAST_SHARE_BESIDE_CUSP)
    u = np.where(is_valley, np.clip(crossing, least, 1 - least), 0.5)
    of_left, of_right = h * np.where(is_valley, [u, 1 - u], 1.0)
    value = np.minimum(y[:-1] + np.minimum(left, 0.0) * of_left, y[1:] - np.maximum(right, 0.0) * of_right)
    value[bends & ~is_valley] = np.inf
    depth = np.maximum(np.minimum(y[:-1], y[1:]) - value, 0.0)
    return np.minimum(y[:-1], y[1:]) - SAFETY * depth, x[:-1, None, None] + u * h


def _outer(slope: Array) -> tuple[Array, Array]:
    """Slopes (N, ...) of the intervals to the left, and the factors (at least 1) of their increase."""
    outer, growth = np.zeros_like(slope), np.ones_like(slope)
    outer[1:] = slope[:-1]
    last, first = slope[1:-1], slope[:-2]
    grows = (last * first > 0) & (np.abs(last) > np.abs(first))
    np.divide(last, first, out=growth[2:], where=grows)
    return outer, np.minimum(growth, SAFETY)  # unequal intervals make the growth too large


def excess_beside_extremes(nodes: Array, Y: Array, noise: Array) -> Array:
    """How far responses with cusps and kinks may exceed their extremes at the nodes of a tensor grid, (n_t, n_y).

    Beside the node of an extreme, along each parameter, one secant passes through the two nodes on one side of an
    interval, and the other through the two nodes on its other side, as in `secant_extremes`. Jumps have no excess.

    Parameters
    ----------
    nodes : (N, d)          of the tensor grid
    Y : (N, n_t, n_y)       responses at the nodes
    noise : (n_y,)          of the responses; it is subtracted from differences
    """
    lines, numbers = zip(*(np.unique(x, return_inverse=True) for x in nodes.T), strict=True)
    places = [np.pad(line, 3, constant_values=np.nan) for line in lines]
    rows = np.pad(np.zeros([len(line) for line in lines], dtype=int), 3)
    rows[tuple(each + 3 for each in numbers)] = np.arange(len(nodes))
    times_and_outputs, excess = np.ogrid[: Y.shape[1], : Y.shape[2]], np.zeros(Y.shape[1:])
    for sign, axis, step in product((-1, 1), range(nodes.shape[1]), (-1, 1)):
        best = (sign * Y).argmin(axis=0)
        near = np.repeat([[each[best] + 3] for each in numbers], 6, axis=1)
        near[axis] += step * np.arange(-2, 4)[:, None, None]  # the interval follows the third node
        y, h = sign * Y[rows[tuple(near)], *times_and_outputs], np.abs(np.diff(places[axis][near[axis]], axis=0))
        far_fall, fall, _, rise, far_rise = (
            np.maximum(turn * change - 2 * noise, 0.0) / length
            for turn, change, length in zip((-1, -1, 1, 1, 1), np.diff(y, axis=0), h, strict=True)
        )
        fall, growth_before = _steeper(fall, far_fall)
        rise, growth_after = _steeper(rise, far_rise)
        crossing = np.divide(y[2] - y[3] + rise * h[2], fall + rise, out=np.zeros_like(rise), where=rise > 0)
        growth = np.maximum(growth_before, growth_after)
        least = np.minimum(growth - 1, LEAST_SHARE_BESIDE_CUSP) * h[2]
        depth = np.where(rise > 0, fall * np.clip(crossing, least, h[2] - least), 0.0)
        excess = np.fmax(excess, np.minimum(growth**2, SAFETY) * depth)  # secants bound kinks, but cusps are deeper
    return excess


def _steeper(slope: Array, before: Array) -> tuple[Array, Array]:
    """Slopes that increase by the same factor once more, and this factor (at least 1); 0 and 1 at jumps."""
    growth = np.fmax(np.divide(slope, before, out=np.ones_like(slope), where=before > 0), 1.0)
    is_jump = growth > SAFETY
    return np.where(is_jump, 0.0, slope * growth), np.where(is_jump, 1.0, growth)


SHARE_OF_LEFT = 0.5
"""Error of all intervals that are not halved, divided by the tolerance. Larger shares take more rounds with fewer
runs."""


def bisected_range(runs: Runs, widths: Array, tolerance: float) -> EstimatedRange:
    """The extremes of runs, and how far the response may exceed them between the runs.

    Intervals between neighbouring runs are halved until the error is within the tolerance of the widths (n_y,), or
    until no runs or no time is left.
    """
    n_before = 0
    while True:
        rows = np.flatnonzero(runs.is_attained)
        rows = rows[runs.places[rows, 0].argsort()]
        x = runs.places[rows, 0]
        estimate, of_intervals = _excess(runs, x, rows)
        error = relative_rms(estimate, widths)
        runs.tell("runs between events", "events", relative_errors(estimate, widths))
        # A middle whose run failed is not run again, so a round may have no new runs.
        if error <= tolerance or not runs.left or runs.clock.is_late or len(runs) == n_before:
            break
        n_before = len(runs)
        largest = (of_intervals / widths).max(axis=1)
        order = largest.argsort()
        is_kept = np.cumsum(np.square(largest[order])) <= (SHARE_OF_LEFT * tolerance) ** 2
        chosen = order[~is_kept][::-1][: runs.left]
        runs.at(0.5 * (x[chosen] + x[chosen + 1])[:, None])
    Y = runs.nodes[rows]
    places = np.stack([x[f(Y, axis=0)] for f in (np.argmin, np.argmax)])[..., None]

    def polynomials() -> Piecewise:
        centres, halves = 0.5 * (x[:-1] + x[1:]), 0.5 * np.diff(x)
        alpha, means, slopes = np.array([[0], [1]]), 0.5 * (Y[:-1] + Y[1:]), 0.5 * np.diff(Y, axis=0)
        lines = (Expansion(alpha, np.stack(pair), runs.box.names) for pair in zip(means, slopes, strict=True))
        jumps = np.where(_have_events(runs, rows)[..., None], 2 * np.abs(slopes), 0.0).max(axis=0)
        return Piecewise(centres[:, None], halves[:, None], tuple(lines), np.maximum(estimate, jumps))

    return EstimatedRange(
        *runs.extremes,
        Evidence.of("events", estimate),
        polynomials,
        "runs between events",
        places,
        is_enough=error <= tolerance,
    )


def _excess(runs: Runs, x: Array, rows: Indices) -> tuple[Array, Array]:
    """How far responses may exceed the extremes of runs (n_t, n_y), and its rms over time in each interval (k, n_y).

    Responses continue into an interval with the slopes of the intervals beside it. Without an event, the interval has
    one smooth part or one kink, so both continuations bound it. At an event, the response may jump from one
    continuation to the other at any place of the interval.
    """
    (n_t, n_y), h = runs.shape, np.diff(x)[:, None, None]
    events = _have_events(runs, rows)[..., None]
    estimate, squares = np.zeros((n_t, n_y)), np.zeros((len(h), n_y))
    for window in windows(n_t, 32 * n_y * len(x)):  # arrays of 0.3 MB stay in the processor's cache
        Y, has_event = runs.nodes[rows, window], events[:, window]
        # Noise at both ends changes a difference by up to twice the noise. Only the remainder is used as difference.
        change = np.diff(Y, axis=0)
        change = np.sign(change) * np.maximum(np.abs(change) - 2 * runs.noise, 0.0)
        # Across an event, the slope is not known. Then the response changes by at most as much as at the event.
        ratio = np.where(has_event[:-1], np.minimum(h[1:] / h[:-1], 1.0), h[1:] / h[:-1])
        back = np.where(has_event[1:], np.minimum(h[:-1] / h[1:], 1.0), h[:-1] / h[1:])
        largest = np.zeros(change.shape)
        for sign, extreme in zip((-1.0, 1.0), runs.extremes, strict=True):
            ends = sign * Y
            left, right = ends[:-1].copy(), ends[1:].copy()
            left[1:] += sign * change[:-1] * ratio
            right[:-1] -= sign * change[1:] * back
            left[0], right[-1] = right[0], left[-1]
            ends = np.maximum(ends[:-1], ends[1:])
            smooth = ends + SAFETY * (np.minimum(left, right) - ends)
            top = np.where(has_event, np.maximum(left, right), smooth)
            np.maximum(largest, top - sign * extreme[window], out=largest)
        estimate[window] = largest.max(axis=0)
        squares += np.square(largest).sum(axis=1)
    return estimate, np.sqrt(squares / n_t)


def _have_events(runs: Runs, rows: Indices) -> Mask:
    """Mask (k, n_t) of the intervals and times between whose ends the number of events differs or is not known."""
    assert runs.events is not None
    events = runs.events[rows]
    return (np.diff(events, axis=0) != 0) | (events[1:] < 0) | (events[:-1] < 0)
