"""The location of events within a step: a gap closes, or the force in a closed contact falls to 0."""

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.events.impulses import SMALL, ImpactLaws, evaluate_padded
from symmb.model import DAE, Impacts
from symmb.schemes import interpolated, parts, roots
from symmb.symbolic import common, ranges_along

_TOUCHING = 1e-2
"""Share of a step up to which gaps must be known at least: a step that is cut to less makes no progress."""
_PARTS = 6
"""Equal parts of a step, in each of which the force in a closed contact may change sign once: its range over a part of
a step is that of a linear system, too wide to tell more. tests/events/test_impacts.py"""


class Steps(NamedTuple):
    """N steps: from states x (N, n_x) at t (N,) by h (N,), coefficients of the interpolant F, parameters p (N, n_p)."""

    x: Array
    p: Array
    t: Array
    h: Array
    F: Array

    def some(self, rows: Indices) -> "Steps":
        """Those of the given numbers."""
        return Steps(*(part[rows] for part in self))

    def at(self, theta: Array) -> Array:
        """States (N, n_x) at shares theta (N,) of the steps."""
        return interpolated(self.x, np.moveaxis(self.F, 2, 0), theta[:, None])


class Located(NamedTuple):
    """The first event of each of N steps.

    Attributes
    ----------
    theta : (N,)               its time as a share of the step, 1 without an event
    closing : (N,) indices     the contact that closes, -1 if none does
    released : (N, n)          contacts that open
    known : (N,)               share of the step behind which gaps are not known
    """

    theta: Array
    closing: Indices
    released: Mask
    known: Array

    @property
    def has_event(self) -> Mask:
        """Whether a step has an event, (N,)."""
        return np.asarray((self.closing >= 0) | self.released.any(axis=1))


class Location:
    """Finds events by the interpolant of a step."""

    def __init__(self, dae: DAE, impacts: Impacts, laws: ImpactLaws) -> None:
        self._impacts, self._laws = impacts, laws
        n_x = dae.n_q + dae.n_v + dae.n_s
        x, p, t = ca.SX.sym("x", n_x), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
        gap, _ = impacts.gaps(*dae.arguments(x, p, t))
        box, bounds = ranges_along(gap, x, p, t)
        self._bounds = common("bounds", [box, p], [bounds])

    def __call__(self, steps: Steps) -> Located:
        """The first events of N steps."""
        N, n = len(steps.x), len(self._impacts.names)
        closed = self._laws.closed(steps.x)
        times = _EventTimes(N, n)
        shares, known = self._shares(steps, closed)
        gap, rate = self._at_shares(self._gaps, steps, shares)
        self._closings(steps, shares, gap, rate, ~closed[:, None, :], times)
        if closed.any():
            shares = np.tile(np.linspace(0, 1, _PARTS + 1), (N, 1))
            (force,) = self._at_shares(lambda *at: [self._contact_force(*at)], steps, shares)
            at = np.argwhere(closed[:, None, :] & (force[:, :-1] >= 0) & (force[:, 1:] < 0))
            times.opens(at, self._roots(self._contact_force, steps, shares, at, force))
        return times.first(known)

    def _shares(self, steps: Steps, closed: Mask) -> tuple[Array, Array]:
        """Ends of parts (N, k) in which ends tell everything of open contacts, the last repeated, and how far (N,)."""
        N, F = len(steps.x), np.moveaxis(steps.F, 2, 0).swapaxes(1, 2)

        def values(x: Array, theta: Array, rows: Indices) -> Array:
            at = self._laws.arguments(x.T, steps.p[rows], steps.t[rows] + theta * steps.h[rows])
            return evaluate_padded(self._impacts.gaps, *at)[0].T

        def bounds(box: Array, low: Array, high: Array, rows: Indices) -> tuple[Array, Array, Array]:
            t, h = steps.t[rows], steps.h[rows]
            box = np.vstack([box, t + low * h, t + high * h, (high - low) * h])
            least, largest, fall, rise = np.split(evaluate_padded(self._bounds, box.T, steps.p[rows])[0].T, 4)
            below = largest < 0
            least, fall, rise = np.where(below, [-largest, -rise, -fall], [least, fall, rise])
            return np.where(closed[rows].T, np.inf, least), fall, rise

        begin = values(steps.x.T, np.zeros(N), np.arange(N))
        found = parts(steps.x.T, F, values, bounds, begin, np.zeros((begin.shape[0], 1)))
        counts = np.bincount(found.lane, minlength=N)
        shares = np.repeat(found.known[:, None], counts.max(initial=0) + 1, axis=1)
        number = np.arange(len(found.lane)) - np.repeat(np.cumsum(counts) - counts, counts)
        shares[found.lane, number] = found.low
        # A contact that has just opened leaves so slowly that ranges tell nothing near its start: equal parts, then.
        touching = found.known < _TOUCHING
        if touching.any():
            shares = np.pad(shares, ((0, 0), (0, max(0, _PARTS + 1 - shares.shape[1]))), mode="edge")
            equal = np.minimum(np.arange(shares.shape[1]) / _PARTS, 1.0)
            shares[touching] = equal
        return shares, np.where(touching, 1.0, found.known)

    def _at_shares(self, f: Callable[..., list[Array]], steps: Steps, shares: Array) -> list[Array]:
        """Values (N, k, n) of f at shares (N, k) of the steps."""
        rows = np.repeat(np.arange(len(shares)), shares.shape[1])
        return [a.reshape(*shares.shape, -1) for a in f(steps, rows, shares.ravel())]

    def _closings(
        self, steps: Steps, shares: Array, gap: Array, rate: Array, open_: Mask, times: "_EventTimes"
    ) -> None:
        begin, end, falls, rises = gap[:, :-1], gap[:, 1:], rate[:, :-1] < 0, rate[:, 1:] > 0
        sinks = open_ & (begin <= 0) & falls & ~rises & (end < begin)
        at = np.argwhere(sinks)
        times.closes(at, shares[at[:, 0], at[:, 1]])
        closes = open_ & (begin > 0) & (end <= 0)
        at = np.argwhere(closes)
        times.closes(at, self._roots(self._gap, steps, shares, at, gap))
        # A gap may be above 0 or below 0 in between: its value at the turning point decides.
        hops = open_ & (begin <= 0) & (end <= 0) & (rate[:, :-1] > 0) & (rate[:, 1:] < 0)
        dips = open_ & (begin > 0) & (end > 0) & falls & rises
        at = np.argwhere(hops | dips)
        if not at.size:
            return
        turn = self._roots(self._rate, steps, shares, at, rate)
        there = self._gap(steps, at[:, 0], turn)[np.arange(len(at)), at[:, 2]]
        hop = hops[tuple(at.T)]
        low = np.where(hop, turn, shares[at[:, 0], at[:, 1]])
        high = np.where(hop, shares[at[:, 0], at[:, 1] + 1], turn)
        crossed = np.where(hop, there > 0, there <= 0)
        # A hop that does not rise above 0 is rounding: it ends at its turning point.
        times.closes(at[hop & ~crossed], turn[hop & ~crossed])
        at, low, high = at[crossed], low[crossed], high[crossed]
        times.closes(at, self._between(self._gap, steps, at, low, high))

    def _gaps(self, steps: Steps, rows: Indices, theta: Array) -> list[Array]:
        return evaluate_padded(self._impacts.gaps, *self._at(steps, rows, theta))

    def _gap(self, steps: Steps, rows: Indices, theta: Array) -> Array:
        return self._gaps(steps, rows, theta)[0]

    def _rate(self, steps: Steps, rows: Indices, theta: Array) -> Array:
        return self._gaps(steps, rows, theta)[1]

    def _contact_force(self, steps: Steps, rows: Indices, theta: Array) -> Array:
        """Forces in closed contacts, raised by the rounding error: a pull above it opens the contact."""
        force, _, size, inertia = evaluate_padded(self._impacts.forces, *self._at(steps, rows, theta))
        return force + SMALL * size * inertia

    def _at(self, steps: Steps, rows: Indices, theta: Array) -> tuple[Array, ...]:
        some = steps.some(rows)
        return self._laws.arguments(some.at(theta), some.p, some.t + theta * some.h)

    def _roots(self, f: Callable[..., Array], steps: Steps, shares: Array, at: Indices, values: Array) -> Array:
        """Roots in parts of steps, at (m, 3) being step, part and contact, values those at the ends of the parts."""
        row, part, k = at.T
        ends = shares[row, part], shares[row, part + 1]
        return self._between(f, steps, at, *ends, values[row, part, k], values[row, part + 1, k])

    def _between(
        self,
        f: Callable[..., Array],
        steps: Steps,
        at: Indices,
        low: Array,
        high: Array,
        f_low: Array | None = None,
        f_high: Array | None = None,
    ) -> Array:
        """Roots between ends (m,) at which f has different signs."""

        def value(theta: Array) -> Array:
            return f(steps, at[:, 0], theta)[np.arange(len(at)), at[:, 2]]

        if not len(at):
            return np.empty(0)
        f_low = value(low) if f_low is None else f_low
        return roots(value, low, high, f_low, value(high) if f_high is None else f_high)


class _EventTimes:
    """The first event of each contact in each step."""

    def __init__(self, N: int, n: int) -> None:
        self._when = np.full((N, n), np.inf)
        self._released = np.zeros((N, n), dtype=bool)

    def closes(self, at: Indices, theta: Array) -> None:
        """Gaps that close: at (m, 3) being step, part and contact, theta (m,)."""
        np.minimum.at(self._when, (at[:, 0], at[:, 2]), theta)

    def opens(self, at: Indices, theta: Array) -> None:
        """Closed contacts whose forces fall to 0."""
        self.closes(at, theta)
        self._released[at[:, 0], at[:, 2]] = True

    def first(self, known: Array) -> Located:
        """The first of all contacts, where gaps are known up to shares (N,)."""
        theta = self._when.min(axis=1)
        is_first = np.asarray(self._when == theta[:, None]) & np.isfinite(theta)[:, None]
        closing = np.where((is_first & ~self._released).any(axis=1), (is_first & ~self._released).argmax(axis=1), -1)
        return Located(np.minimum(theta, 1.0), closing, is_first & self._released, known)
