"""Switches of many blocks of samples: the work of c/switches.h on NumPy arrays."""

from bisect import bisect_right
from collections.abc import Callable
from typing import cast

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.codegen.c_source import c_number
from symmb.codegen.contacts import Contacts
from symmb.codegen.engine import StepEnds
from symmb.schemes import first_pass, interpolated, roots

Lanes = Mask | Indices | slice
"""Columns of arrays."""
Values = Callable[[Array, Array, Array], Array]
"""x (n_x, L), c (n_c, L), t (L,) -> (n, L)."""
WIDTH = int(c_number("lanes", "WIDTH"))
"""Samples that share a step."""
_STOP_MARGIN, _REVERSAL, LATE, BEYOND = (
    c_number("switches", name) for name in ("STOP_MARGIN", "REVERSAL", "LATE", "BEYOND")
)
_LEAST = float(np.finfo(float).tiny)
_SETTLINGS, _FORCE_PARTS = (int(c_number("switches", name)) for name in ("SETTLINGS", "FORCE_PARTS"))
_FORCE_LEAST = c_number("switches", "FORCE_LEAST")


class BlockSwitches:
    """Switches of B blocks; lanes of those under way are columns, `width` for each block.

    With contacts, whose gaps are the last switches, blocks are single lanes.

    Attributes
    ----------
    stop, end : (B,)         the next switch of time, and where steps end at the latest [s]
    after, before : (B,)     times between which rates are evaluated [s]
    """

    def __init__(
        self,
        prepare: Values,
        switches: Values | None,
        bounds: Values | None,
        ends: StepEnds,
        times: Array,
        x: Array,
        p: Array,
        B: int,
        width: int = WIDTH,
        contacts: Contacts | None = None,
    ) -> None:
        self._width, self._contacts = width, contacts
        self.n_sided = len(ends.hysteresis) - (len(contacts.names) if contacts else 0)  # gaps keep their side
        by_force = contacts.joints.get("by_force", ()) if contacts else ()
        self._by_force = len(ends.hysteresis) - len(by_force) + np.flatnonzero(by_force)
        self._prepare, self._p = prepare, np.ascontiguousarray(p)
        self._switches, self._bounds = switches, bounds
        self._hysteresis = np.array(ends.hysteresis, dtype=float)[:, None]
        self._sides = np.ones((len(self._hysteresis), p.shape[1]))
        self._u = np.zeros((2 * len(self._sides), p.shape[1]))
        self._raised = np.zeros_like(self._sides)
        stops = ends.stops(x.T, p.T) if ends.stops else np.empty((p.shape[1], 0))
        self._stops = np.sort(stops.reshape(B, -1), axis=1)
        self._horizon, self._least = float(times[-1]), 1e-3 * float(np.ptp(times))
        self.after, self.before = np.full(B, -np.inf), np.full(B, np.inf)
        self.stop, self.end = np.full(B, np.inf), np.full(B, self._horizon)

    @property
    def parameters(self) -> Array:
        """Parameters and sides (n_p, L)."""
        return np.concatenate([self._p, self._sides])

    def select(self, lanes: Lanes) -> None:
        """Go on with some lanes only."""
        self._p, self._sides, self._u = self._p[:, lanes], self._sides[:, lanes], self._u[:, lanes]
        self._raised = self._raised[:, lanes]

    def find_stops(self, t: Array, blocks: Indices) -> None:
        """The next switches of time of some blocks at times t (B,)."""
        for b, now in zip(blocks.tolist(), t[blocks].tolist(), strict=True) if self._stops.size else ():
            stops = self._stops[b].tolist()
            k = bisect_right(stops, now)
            if k and stops[k - 1] == now:
                self.after[b] = now + self._margin(now)
            self.stop[b] = stop = stops[k] if k < len(stops) else np.inf
            self.before[b] = stop - self._margin(stop)
            self.end[b] = min(stop, self._horizon)

    def _margin(self, t: float) -> float:
        return _STOP_MARGIN * max(abs(t), self._least) if np.isfinite(t) else 0.0

    def settle(self, x: Array, c: Array, t: Array, lanes: Lanes) -> Array:
        """The sides of lanes at the start of a step. Where a switch is 0 its rate decides. Returns their new c."""
        m = len(self._sides)
        if self._switches is None:
            return c
        for _ in range(_SETTLINGS):  # switches may depend on the sides of others
            u = self._switches(x, c, t)
            sides = self._sides[:, lanes]
            new = np.sign(np.where(np.abs(u[:m]) > self._hysteresis, u[:m], u[m:]))
            new = np.where((new == 0) | (np.arange(m)[:, None] >= self.n_sided), sides, new)
            if (new == sides).all():
                break
            self._sides[:, lanes] = new
            c = self._prepare(x, self.parameters[:, lanes], t)
        raised = np.repeat(self._hysteresis, x.shape[1], axis=1)
        u = self._on_sides(x, c, t, self._sides[:, lanes], raised)
        lift = np.maximum(-u[self.n_sided : m], 0.0)  # of gaps that begin below 0 by rounding
        raised[self.n_sided :] += lift
        u[self.n_sided : m] += lift
        self._raised[:, lanes], self._u[:, lanes] = raised, u
        return c

    def lift(self, lanes: Lanes, lift: Array) -> None:
        """Raise gaps, and margins of joints, by `lift` (n, L)."""
        m = len(self._sides)
        for values in (self._raised, self._u):
            part = values[:, lanes]
            part[self.n_sided : m] += lift
            values[:, lanes] = part

    def _on_sides(self, x: Array, c: Array, t: Array, sides: Array, raised: Array) -> Array:
        """Switches on their sides, and their rates (2 m, L)."""
        u, m = self._switches(x, c, t) if self._switches else self._u, len(sides)
        return np.concatenate([u[:m] * sides + raised, u[m:] * sides])

    def first_pass(
        self, x: Array, x_new: Array, F: Array, c: Array, t: Array, t_new: Array, lanes: Lanes
    ) -> tuple[Array, Mask, Indices]:
        """Where steps of lanes from x at t (L,) to x_new at t_new end.

        Returns
        -------
        (b,) array       share of the step of each block, infinite without a pass
        (L,) mask        which lanes pass a switch there, if their number is not -1
        (L,) indices     its number
        """
        m, bounds_of = len(self._sides), self._bounds
        if bounds_of is None:
            return np.full(len(t) // self._width, np.inf), np.zeros(len(t), dtype=bool), np.zeros(len(t), dtype=np.intp)
        u, raised, sides, h = self._u[:, lanes].copy(), self._raised[:, lanes], self._sides[:, lanes], t_new - t
        beyond = u[:m] - raised > raised
        u[:m] -= np.where(beyond, raised, 0.0)
        self._begin, self._raised[:, lanes] = u, np.where(beyond, 0.0, raised)
        raised = self._raised[:, lanes]
        n_gaps = len(self._contacts.closed) if self._contacts else 0
        gap, fall = u[self.n_sided : self.n_sided + n_gaps], u[m + self.n_sided : m + self.n_sided + n_gaps]
        gap[(gap == 0) & (fall < 0)] = -_LEAST  # its change may be lost in rounding: it closes at once
        self._u[:, lanes] = self._on_sides(x_new, c, t_new, sides, raised)

        def values(x: Array, theta: Array, some: Indices) -> Array:
            at = t[some] + theta * h[some]
            return self._on_sides(x, c[:, some], at, sides[:, some], raised[:, some])[:m]

        def bounds(box: Array, low: Array, high: Array, some: Indices) -> tuple[Array, Array, Array]:
            times = [t[some] + low * h[some], t[some] + high * h[some], (high - low) * h[some]]
            box, up = np.concatenate([box, times]), sides[:, some] > 0
            least, largest, fall, rise = np.split(bounds_of(box, c[:, some], t[some]), 4)
            least, fall, rise = np.where(up, [least, fall, rise], [-largest, -rise, -fall])
            least[self._by_force] = np.inf  # see _first_release
            return least + raised[:, some], fall, rise

        when, which = first_pass(x, F, values, bounds, u[:m], self._hysteresis)
        if self._contacts is not None:
            self._first_release(x, F, self._p[:, lanes], t, h, values, when, which)
        first = when.reshape(-1, self._width).min(axis=1)
        return first, (when == np.repeat(first, self._width)) & np.isfinite(when), which

    def _first_release(
        self,
        x: Array,
        F: Array,
        p: Array,
        t: Array,
        h: Array,
        margins: Callable[..., Array],
        when: Array,
        which: Indices,
    ) -> None:
        """Where forces open contacts or joints before shares `when` (L,), and the number then; m + k of contact k.

        Parts of the step are halved until no parabola through three values falls below 0 between them.
        """
        contacts, m = cast(Contacts, self._contacts), len(self._sides)
        closed = x[list(contacts.closed)] > 0.5
        acts = np.concatenate([closed, np.ones((len(self._by_force), closed.shape[1]), dtype=bool)])
        numbers = np.concatenate([m + np.arange(len(closed)), self._by_force])

        def forces(theta: Array, lane: Indices) -> Array:
            at = interpolated(x[:, lane], F[:, :, lane], theta)
            own = margins(at, theta, lane)[self._by_force] if len(self._by_force) else np.empty((0, len(lane)))
            if not len(closed):
                return own
            laws = contacts.laws.forces(at.T, p[:, lane].T, t[lane] + theta * h[lane]).T
            return np.concatenate([laws[: len(closed)], own])

        lanes = np.flatnonzero(acts.any(axis=0))
        low, lane = np.repeat(np.arange(_FORCE_PARTS) / _FORCE_PARTS, len(lanes)), np.tile(lanes, _FORCE_PARTS)
        share, part = 1.0 / _FORCE_PARTS, acts[:, lane]
        while lane.size:
            start, middle, end = (forces(low + z * share, lane) for z in (0.0, 0.5, 1.0))
            falls = part & (start >= 0) & ((middle < 0) | (end < 0))
            for k, i in np.argwhere(falls).tolist():
                early = middle[k, i] < 0
                ends = (start, middle) if early else (middle, end)
                begin = low[i] + (0.0 if early else 0.5 * share)
                own = lane[i : i + 1]
                theta = roots(
                    lambda z, k=k, own=own: forces(z, own)[k],
                    np.array([begin]), np.array([begin + 0.5 * share]), *(value[k, i : i + 1] for value in ends),
                )[0]  # fmt: skip
                if theta < when[own[0]]:
                    when[own[0]], which[own[0]] = theta, numbers[k]
            part = part & ~falls & (start >= 0) & _may_fall(start, middle, end)
            again = part.any(axis=0) & (share > _FORCE_LEAST) & (low < when[lane])
            share *= 0.5
            low, lane, part = low[again], lane[again], part[:, again]
            low, lane, part = np.concatenate([low, low + share]), np.tile(lane, 2), np.tile(part, 2)

    def forget(self, lanes: Lanes) -> None:
        """The switches of lanes are again those at the begin of the step."""
        self._u[:, lanes] = self._begin

    def change_sides(
        self, end: Array, x: Array, c: Array, t: Array, h: Array, lanes: Lanes, passed: Mask, which: Indices
    ) -> tuple[Array, Mask]:
        """Change the sides of the lanes that passed a switch at the end of a step, which is x on the constraints.

        Returns
        -------
        array                  the new c
        (b, width) mask        lanes that stick: a switch turns them back from both sides
        """
        m, sides = len(self._sides), self._sides[:, lanes]
        changed = passed & (which < self.n_sided) & (which == np.arange(m)[:, None])
        falls = self._on_sides(end, c, t, sides, self._raised[:, lanes])[m:] < 0
        self._sides[:, lanes] = sides = np.where(changed, -sides, sides)
        raised = np.where(changed, self._hysteresis, self._raised[:, lanes])
        c = self._prepare(x, self.parameters[:, lanes], t)
        before = self._on_sides(end, c, t, sides, raised)
        margin = _REVERSAL * self._hysteresis  # a switch beyond it has jumped with another one: it does not come back
        sticks = changed & falls & (before[:m] < margin) & (0.1 * h * before[m:] < -margin)
        u = self._on_sides(x, c, t, sides, raised)
        # The projection moves the state, and another switch may begin to act: it is passed if it falls only.
        aim = np.where(u[m:] > 0, self._hysteresis, np.minimum(before[:m], self._hysteresis))
        lift = np.where(before[:m] > -self._hysteresis, np.maximum(aim - u[:m], 0.0), 0.0)
        self._raised[:, lanes] = raised + lift
        self._u[:, lanes] = np.concatenate([u[:m] + lift, u[m:]])
        return c, sticks.any(axis=0).reshape(-1, self._width)


def _may_fall(start: Array, middle: Array, end: Array) -> Mask:
    """Whether a parabola through three values, with twice its bend, falls below 0 between them."""
    bend = 4.0 * (start + end - 2.0 * middle)
    slope = end - start - bend
    return (bend > 0) & (slope < 0) & (slope + 2 * bend > 0) & (4.0 * bend * start < slope**2)
