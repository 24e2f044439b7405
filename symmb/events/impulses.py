"""The state after an event on arrays of many samples: impulses, contacts and joints that close and that open.

It is the work of c/impacts.h.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symmb._options import number_text
from symmb._types import Array, Indices, Mask
from symmb.codegen import BLAMED, CLOSES, IMPACT, OPENS, ROUNDING, Contacts, FailureCode, PostImpact, c_number
from symmb.events.joint_laws import JointLaws, arguments_of, evaluate_padded
from symmb.mechanics import RESTITUTION
from symmb.model import DAE, Impacts

_SAME_JUMP, _SMALL = c_number("impacts", "SAME_JUMP"), c_number("switches", "SMALL")
_MOST_IMPACTS, _ROUNDS = int(c_number("impacts", "MOST_IMPACTS")), int(c_number("impacts", "ROUNDS"))
PENETRATION, SHORT_WAY = 1e-9, 1e-7
"""Negative gap at the start that is rounding: over the scene's size, or over the way that speed and acceleration of the
gap lead until the end. The gap itself may be all that is known of the size."""


_WHAT = {IMPACT: "impact", CLOSES: "closes", OPENS: "opens"}


@dataclass(frozen=True)
class Event:
    """An event of a run.

    Attributes
    ----------
    time : float
        [s]
    name : str
        of the Impact, or of the joint
    what : str
        "impact", or "closes" and "opens" of a contact that stays closed, or of a joint
    before, after : float
        rates of the gap [m/s, rad/s], or of the margin by which the condition of a joint is not met: falling, below 0
    work : float
        of the impulse [J], what is lost being negative
    depends_on_order : bool
        whether impacts of the same instant would end otherwise in another order
    impulse : tuple of float
        along the gap, or of the rows of a joint that closes, in the order and with the signs of their multipliers
        [N s, N m s]; empty for joints and contacts that open. Joints that close at one instant share an impact

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", 1.0, pose=mb.Particle())
    >>> floor = mb.Impact("floor", gap=ball.y, restitution=0.8)
    >>> scene = mb.Scene(mb.System(ball, floor, mb.Gravity(0, -10.0)), {"ball.y": 1.25}, [0.0, 1.0])
    >>> (event,) = mb.simulate(scene).events
    >>> event.name, event.what, round(event.time, 6), round(event.after, 6)
    ('floor', 'impact', 0.5, 4.0)
    """

    time: float
    name: str
    what: str
    before: float
    after: float
    work: float
    depends_on_order: bool = False
    impulse: tuple[float, ...] = ()


def events_of(rows: Array, contacts: Contacts, N: int) -> list[tuple[Event, ...]]:
    """Events of each of N samples, from rows (k, 14) as `symmb.codegen.EVENT` tells."""
    found: list[list[Event]] = [[] for _ in range(N)]
    for sample, k, what, time, before, after, work, ordered, *L in rows[rows[:, 2] != BLAMED].tolist():
        impulse = L[: contacts.impulses_of(int(k), int(what))]
        event = Event(time, contacts.names[int(k)], _WHAT[what], before, after, work, bool(ordered), tuple(impulse))
        found[int(sample)].append(event)
    return [tuple(events) for events in found]


def event_doubts(events: Sequence[Event]) -> tuple[str, ...]:
    """What is doubtful about events: simultaneous impacts whose result depends on their order."""
    doubtful = [event for event in events if event.depends_on_order]
    if not doubtful:
        return ()
    time = doubtful[0].time
    names = ", ".join(repr(name) for name in dict.fromkeys(event.name for event in doubtful if event.time == time))
    return (
        f"The impacts of {names} at t = {time:g} s happen at one instant, and the motion after them depends on their "
        "order. They are taken in the order of declaration.",
    )


class ImpactLaws:
    """The laws of impact of a DAE, see `symmb.codegen.ContactLaws`."""

    def __init__(self, dae: DAE, impacts: Impacts, moving: JointLaws | None = None) -> None:
        self._dae, self._impacts, self._moving = dae, impacts, moving
        self._cuts = [dae.n_q, dae.n_q + dae.n_v]
        self._flags = self._cuts[1] + impacts.closed

    def _arguments(self, x: Array, p: Array, t: Array) -> tuple[Array, ...]:
        return arguments_of(self._dae, x, p, t)

    def _closed(self, x: Array) -> Mask:
        """Which contacts are closed, (N, n)."""
        return np.asarray(x[:, self._flags] > 0.5)

    def forces(self, x: Array, p: Array, t: Array) -> Array:
        """Forces in closed contacts, raised by their rounding (N, n): a pull above it opens the contact."""
        force, _, size, inertia = evaluate_padded(self._impacts.forces, *self._arguments(x, p, t))
        return force + _SMALL * size * inertia

    def start_faults(self, x: Array, p: Array, t: Array, span: float) -> dict[int, str]:
        """Faults of samples at the start of a run of some span [s]: gaps below 0, restitutions out of their range."""
        at = self._arguments(x, p, t)
        started = np.isfinite(x).all(axis=1, keepdims=True)
        gap, rate, _ = evaluate_padded(self._impacts.gaps, *at)
        way = np.abs(rate) * span + evaluate_padded(self._impacts.forces, *at)[2] * span**2 / 2
        rounding = np.maximum(PENETRATION * self._dae.scales.length, SHORT_WAY * way)
        e = evaluate_padded(self._impacts.impulses, *at)[3]
        faults = {}
        for i, k in np.argwhere(started & ~((e >= 0) & (e <= 1))).tolist():
            faults[i] = f"Impact {self._impacts.names[k]!r}: {RESTITUTION.format(number_text(float(e[i, k])))}"
        for i, k in np.argwhere(started & ~(gap >= -rounding)).tolist():
            name = self._impacts.names[k]
            faults[i] = f"Impact {name!r}: the gap is {gap[i, k]:g} at the start; start with a gap from 0 on"
        return faults if self._moving is None else faults | self._moving.start_faults(x, p, t)

    def started(self, x: Array, p: Array, t: Array) -> Array:
        """States at the start, which tell of conditions that hold there."""
        return x.copy() if self._moving is None else self._moving.started(x, p, t)

    def __call__(self, x: Array, p: Array, t: Array, contact: Indices) -> PostImpact:
        """After an event.

        Parameters
        ----------
        x : (N, n_x)           states right before
        p, t : (N, n_p), (N,)
        contact : (N,) indices the one whose gap has just closed, or behind them the event of a joint whose condition
            has changed, or behind these the contact whose force has just come to 0, or -1
        """
        impacts, n = self._impacts, len(self._impacts.names)
        n_all = n if self._moving is None else n + self._moving.count
        after = PostImpact(x, n_all)
        every, passed = np.arange(n), np.where(contact < n_all, contact - n, -1)
        contact = np.where(contact >= n_all, contact - n_all + n, np.where(contact < n, contact, -1))
        rounds = 1 if self._moving is None else _ROUNDS
        while True:  # impulses let clutches slip, which the next round finds
            if self._moving is not None:
                x, passed = self._moving(after, p, t, passed, n), np.full(len(x), -1)
            if not n:
                return after
            closed_before = self._closed(x)
            at = self._arguments(x, p, t)
            gap, rate, reach = evaluate_padded(impacts.gaps, *at)
            rounding = 8 * ROUNDING * (self._dae.scales.length + reach)
            force, _, size, inertia = evaluate_padded(impacts.forces, *at)
            pulled = (contact >= n)[:, None] & (force + _SMALL * size * inertia < 0)
            released = (contact[:, None] == n + every) | pulled
            touching = closed_before | (gap <= rounding) | (contact[:, None] == every)
            # Slower rates count as rest: such a rebound rises no higher than the rounding of positions.
            fastest = np.where(touching, np.abs(rate), 0.0).max(axis=1, keepdims=True)
            resting_rate = np.maximum(np.sqrt(2 * rounding * size), _SMALL * fastest)
            rounds, count = rounds - 1, len(after.rows)
            rate, movable = self._apply_impulses(after, at, rate, touching, resting_rate)
            if not rounds or len(after.rows) == count:
                break
        slow = touching & movable & (np.abs(rate) <= resting_rate)  # what joints hold needs no force of a contact
        acceleration, dependent = self._close_contacts(after.x, p, t, slow, closed_before & released)
        closed_after = self._closed(after.x)
        after.fail(dependent[:, None], closed_after, t, FailureCode.DEPENDENT)
        for what, changed in ((CLOSES, closed_after & ~closed_before), (OPENS, closed_before & ~closed_after)):
            for i, k in np.argwhere(changed).tolist():
                after.note(i, k, what, float(t[i]))
        flying = touching & ~closed_after & (rate > resting_rate) & (acceleration < 0)
        flight = np.where(flying, 2 * rate / np.where(flying, -acceleration, 1.0), np.inf)
        after.soon[:], after.lift[:, :n] = 1.5 * flight.min(axis=1), rounding * (slow & ~closed_after)
        return after

    def _apply_impulses(
        self, after: PostImpact, at: tuple[Array, ...], rate: Array, touching: Mask, resting_rate: Array
    ) -> tuple[Array, Mask]:
        """Impacts one after the other until no gap that is 0 closes.

        Returns the rates (E, n) of the gaps, and which of them the constraints let move.
        """
        dae, t = self._dae, at[-1][:, 0]
        n, n_v = len(self._impacts.names), dae.n_v
        W, B, at_rest, e = evaluate_padded(self._impacts.impulses, *at)
        W, B = W.reshape(-1, n, n_v), B.reshape(-1, n_v, n)
        D = W @ B
        own = np.einsum("ekk->ek", D)
        movable = own * dae.scales.energy > _SMALL * np.square(W * dae.displacement_scales).sum(axis=2)
        law = D, at_rest, e, movable, resting_rate
        rates, impulse, strokes = self._in_turn(rate, touching, *law)
        jump = (B @ impulse[:, :, None])[:, :, 0]
        ambiguous = (touching & (rate < -resting_rate)).sum(axis=1) > 1
        if ambiguous.any():
            _, other, _ = self._in_turn(rate, touching, *law, last_first=True)
            change = np.abs((B @ (other - impulse)[:, :, None])[:, :, 0]).max(axis=1)
            ambiguous &= change > _SAME_JUMP * np.abs(jump).max(axis=1)
        for i, j, u, w, work, P in strokes:
            after.work[i] += work
            after.note(i, j, IMPACT, float(t[i]), u, w, work, ambiguous[i], P)
        hit = touching & (rates < -resting_rate)
        after.fail(hit & ~movable, hit & ~movable, t, FailureCode.IMMOVABLE)
        after.fail(hit, touching, t, FailureCode.UNENDING)
        after.x[:, self._cuts[0] : self._cuts[1]] += jump
        return rates, movable

    def _in_turn(
        self,
        rate: Array,
        touching: Mask,
        D: Array,
        at_rest: Array,
        e: Array,
        movable: Mask,
        resting_rate: Array,
        last_first: bool = False,
    ) -> tuple[Array, Array, list[tuple[int, int, float, float, float, float]]]:
        """Impacts in the order of the contacts, or from the last to the first.

        Returns
        -------
        rates of the gaps (E, n), impulses (E, n), and all impacts (sample, contact, rate, rate after, work, impulse)
        """
        rate, impulse = rate.copy(), np.zeros(rate.shape)
        own, strokes = np.einsum("ekk->ek", D), []
        for _ in range(_MOST_IMPACTS):
            hit = touching & movable & (rate < -resting_rate)
            some = np.flatnonzero(hit.any(axis=1))
            if not some.size:
                break
            k = hit.shape[1] - 1 - hit[some, ::-1].argmax(axis=1) if last_first else hit[some].argmax(axis=1)
            u = rate[some, k]
            w = -e[some, k] * u
            P = (w - u) / own[some, k]
            work = P * ((u + w) / 2 - at_rest[some, k])
            rate[some] += D[some, :, k] * P[:, None]
            rate[some, k] = w
            impulse[some, k] += P
            parts = (some, k, u, w, work, P)
            strokes += zip(*(part.tolist() for part in parts), strict=True)
        return rate, impulse, strokes

    def _close_contacts(self, x: Array, p: Array, t: Array, slow: Mask, released: Mask) -> tuple[Array, Mask]:
        """Close the slow contacts with pushing forces. Returns accelerations of gaps (E, n), and dependent contacts."""
        f, closed = self._impacts.forces, slow & ~released
        acceleration = np.zeros(slow.shape)
        dependent: Mask = np.zeros(len(x), dtype=bool)
        for _ in range(3 * slow.shape[1] + 3):
            x[:, self._flags] = closed
            force, acceleration, size, inertia = evaluate_padded(f, *self._arguments(x, p, t))
            dependent = np.asarray(~np.isfinite(force).all(axis=1))
            pull = np.where(closed, force / inertia / np.where(size > 0, size, 1.0), 0.0)
            opens = np.asarray(pull == pull.min(axis=1, keepdims=True)) & (pull < -_SMALL)
            closes = slow & ~closed & (acceleration < -_SMALL * size) & ~opens.any(axis=1, keepdims=True)
            if not (opens | closes).any():
                break
            closed = (closed & ~opens) | closes
        q, v = evaluate_padded(self._impacts.project, *self._arguments(x, p, t))
        projected = self._closed(x).any(axis=1) & ~dependent
        x[projected, : self._cuts[1]] = np.hstack([q, v])[projected]
        return acceleration, dependent
