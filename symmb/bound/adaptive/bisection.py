"""Bounds over one parameter of responses with events, from runs at the middle of intervals that may hold an extreme."""

import numpy as np

from symmb._limits import windows
from symmb._types import Array, Indices, Mask
from symmb.bound.adaptive.check_points import SAFETY
from symmb.bound.adaptive.evidence import Evidence
from symmb.bound.adaptive.runs import Runs, relative_errors, relative_rms
from symmb.bound.adaptive.surrogate import EstimatedRange
from symmb.bound.polynomials import Expansion
from symmb.bound.polynomials.ranges import Piecewise

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
