"""The state after an event: impulses, contacts that close and contacts that open."""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._options import number_text
from symmb._types import Array, Indices, Mask
from symmb.mechanics import RESTITUTION
from symmb.model import DAE, Impacts
from symmb.symbolic import batch

ROUNDING = float(np.finfo(float).eps)
SMALL = 1e-12
"""Share of the terms of a sum below which the sum is zero but for rounding."""
_MOST_IMPACTS = 1000
"""Impacts at one instant. Impacts that lose energy die away long before. tests/events/test_impacts.py"""
_SAME_JUMP = 1e-6
"""Difference of jumps of velocity, over their size, above which the order of impacts matters."""
_PENETRATION, _SHORT_WAY = 1e-9, 1e-7
"""Negative gap at the start that is rounding: over the scene's size, or over the way that speed and acceleration of the
gap lead until the end. The gap itself may be all that is known of the size."""


@dataclass(frozen=True)
class Event:
    """An event of a run.

    Attributes
    ----------
    time : float             [s]
    name : str               of the Impact
    what : str               "impact", or "closes" and "opens" of a contact that stays closed
    before, after : float    rates of the gap [m/s, rad/s]
    work : float             of the impulse [J], what is lost being negative
    depends_on_order : bool  whether impacts of the same instant would end otherwise in another order
    """

    time: float
    name: str
    what: str
    before: float
    after: float
    work: float
    depends_on_order: bool = False


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


def evaluate_padded(f: ca.Function, *arguments: Array) -> list[Array]:
    """A Function of N samples, all arguments (N, n), padded to a power of 2: CasADi keeps one map for each number."""
    N = len(arguments[0])
    if N < 2:
        return list(batch(f, *arguments))
    rows = np.minimum(np.arange(1 << (N - 1).bit_length()), N - 1)
    return [values[:N] for values in batch(f, *[a[rows] for a in arguments])]


@dataclass
class PostImpactState:
    """States x (E, n_x) of E samples after an event, and the record of the event.

    Attributes
    ----------
    work : (E,)              of impulses [J]
    events : list of (sample, Event)
    next_contact_time : (E,) time after which a contact may close again [s]
    failures : list of (sample, reason)
    """

    x: Array
    work: Array
    events: list[tuple[int, Event]]
    next_contact_time: Array
    failures: list[tuple[int, str]]


class ImpactLaws:
    """The laws of impact of a DAE."""

    def __init__(self, dae: DAE, impacts: Impacts) -> None:
        self._dae, self._impacts = dae, impacts
        self._cuts = [dae.n_q, dae.n_q + dae.n_v]
        self.flags = self._cuts[1] + impacts.closed

    def arguments(self, x: Array, p: Array, t: Array) -> tuple[Array, ...]:
        """States (N, n_x), parameters (N, n_p) and times (N,) as the Functions take them."""
        return (*np.split(x, self._cuts, axis=1), p, t[:, None])

    def closed(self, x: Array) -> Mask:
        """Which contacts are closed, (N, n)."""
        return np.asarray(x[:, self.flags] > 0.5)

    def start_faults(self, x: Array, p: Array, t: Array, span: float) -> list[tuple[int, str]]:
        """Faults of samples at the start of a run of some span [s]: gaps below 0, restitutions out of their range."""
        at = self.arguments(x, p, t)
        gap, rate = evaluate_padded(self._impacts.gaps, *at)
        way = np.abs(rate) * span + evaluate_padded(self._impacts.forces, *at)[2] * span**2 / 2
        rounding = np.maximum(_PENETRATION * self._dae.scales.length, _SHORT_WAY * way)
        e = evaluate_padded(self._impacts.impulses, *at)[3]
        faults = []
        for i, k in np.argwhere(~(gap >= -rounding)):
            name = self._impacts.names[k]
            faults.append(
                (int(i), f"Impact {name!r}: the gap is {gap[i, k]:g} at the start; start with a gap from 0 on")
            )
        for i, k in np.argwhere(~((e >= 0) & (e <= 1))):
            faults.append(
                (int(i), f"Impact {self._impacts.names[k]!r}: {RESTITUTION.format(number_text(float(e[i, k])))}")
            )
        return faults

    def __call__(self, x: Array, p: Array, t: Array, closing: Indices, released: Mask) -> PostImpactState:
        """After an event.

        Parameters
        ----------
        x : (E, n_x)           states right before
        p, t : (E, n_p), (E,)
        closing : (E,) indices contacts whose gaps have just closed, -1 where none
        released : (E, n)      closed contacts whose forces have just come to 0
        """
        impacts, lanes, closed_before = self._impacts, np.arange(len(x)), self.closed(x)
        at = self.arguments(x, p, t)
        gap, rate = evaluate_padded(impacts.gaps, *at)
        touching = closed_before | (gap <= 8 * ROUNDING * self._dae.scales.length)
        touching[lanes[closing >= 0], closing[closing >= 0]] = True
        # Slower rates count as rest: such a rebound rises no higher than the rounding of positions.
        resting_rate = np.sqrt(2 * ROUNDING * self._dae.scales.length * evaluate_padded(impacts.forces, *at)[2])
        resting_rate = np.maximum(
            resting_rate, SMALL * np.where(touching, np.abs(rate), 0.0).max(axis=1, keepdims=True)
        )
        after = PostImpactState(x.copy(), np.zeros(len(x)), [], np.full(len(x), np.inf), [])
        rate = self._apply_impulses(after, at, rate, touching, resting_rate)
        slow = touching & (np.abs(rate) <= resting_rate)
        acceleration, dependent = self._close_contacts(after.x, p, t, slow, released)
        closed_after = self.closed(after.x)
        for i in lanes[dependent].tolist():
            after.failures.append(
                (i, f"the contacts {self._names(closed_after[i])} that have closed depend on each other")
            )
        for what, changed in (("closes", closed_after & ~closed_before), ("opens", closed_before & ~closed_after)):
            for i, k in np.argwhere(changed).tolist():
                after.events.append((i, Event(float(t[i]), impacts.names[k], what, 0.0, 0.0, 0.0)))
        flying = touching & ~closed_after & (rate > resting_rate) & (acceleration < 0)
        flight = np.where(flying, 2 * rate / np.where(flying, -acceleration, 1.0), np.inf)
        after.next_contact_time[:] = 1.5 * flight.min(axis=1)
        return after

    def _apply_impulses(
        self, after: PostImpactState, at: tuple[Array, ...], rate: Array, touching: Mask, resting_rate: Array
    ) -> Array:
        """Impacts one after the other until no gap that is 0 closes. Returns the rates (E, n) of the gaps."""
        names, dae, times = self._impacts.names, self._dae, at[-1][:, 0].tolist()
        n, n_v = len(names), dae.n_v
        W, B, at_rest, e = evaluate_padded(self._impacts.impulses, *at)
        W, B = W.reshape(-1, n, n_v), B.reshape(-1, n_v, n)
        D = W @ B
        own = np.einsum("ekk->ek", D)
        movable = own * dae.scales.energy > SMALL * np.square(W * dae.displacement_scales).sum(axis=2)
        law = D, at_rest, e, movable, resting_rate
        rates, impulse, strokes, after.failures[:] = self._in_turn(rate, touching, *law)
        jump = (B @ impulse[:, :, None])[:, :, 0]
        ambiguous = (touching & (rate < -resting_rate)).sum(axis=1) > 1
        if ambiguous.any():
            _, other, *_ = self._in_turn(rate, touching, *law, last_first=True)
            change = np.abs((B @ (other - impulse)[:, :, None])[:, :, 0]).max(axis=1)
            ambiguous &= change > _SAME_JUMP * np.abs(jump).max(axis=1)
        for i, j, u, w, work in strokes:
            after.work[i] += work
            after.events.append((i, Event(times[i], names[j], "impact", u, w, work, bool(ambiguous[i]))))
        after.x[:, self._cuts[0] : self._cuts[1]] += jump
        return rates

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
    ) -> tuple[Array, Array, list[tuple[int, int, float, float, float]], list[tuple[int, str]]]:
        """Impacts in the order of the contacts, or from the last to the first.

        Returns
        -------
        rates of the gaps (E, n), impulses (E, n), all impacts (sample, contact, rate before, rate after, work), and
        failures (sample, reason)
        """
        names, lanes = self._impacts.names, np.arange(len(rate))
        rate, touching, impulse = rate.copy(), touching.copy(), np.zeros(rate.shape)
        own, strokes, failures = np.einsum("ekk->ek", D), [], []
        for _ in range(_MOST_IMPACTS):
            hit = touching & (rate < -resting_rate)
            immovable = hit & ~movable
            for i in lanes[immovable.any(axis=1)].tolist():
                name = names[int(immovable[i].argmax())]
                failures.append((i, f"Impact {name!r} cannot rebound: its gap closes as the constraints have it"))
                touching[i] = False
            some = lanes[(hit & touching).any(axis=1)]
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
            strokes += zip(some.tolist(), k.tolist(), u.tolist(), w.tolist(), work.tolist(), strict=True)
        else:
            for i in lanes[(touching & (rate < -resting_rate)).any(axis=1)].tolist():
                failures.append((i, f"impacts of {self._names(touching[i])} at one instant do not end"))
        return rate, impulse, strokes, failures

    def _close_contacts(self, x: Array, p: Array, t: Array, slow: Mask, released: Mask) -> tuple[Array, Mask]:
        """Close the slow contacts with pushing forces. Returns accelerations of gaps (E, n), and dependent contacts."""
        f, closed = self._impacts.forces, slow & ~released
        acceleration = np.zeros(slow.shape)
        dependent: Mask = np.zeros(len(x), dtype=bool)
        for _ in range(3 * slow.shape[1] + 3):
            x[:, self.flags] = closed
            force, acceleration, size, inertia = evaluate_padded(f, *self.arguments(x, p, t))
            dependent = np.asarray(~np.isfinite(force).all(axis=1))
            pull = np.where(closed, force / inertia / np.where(size > 0, size, 1.0), 0.0)
            opens = np.asarray(pull == pull.min(axis=1, keepdims=True)) & (pull < -SMALL)
            closes = slow & ~closed & (acceleration < -SMALL * size) & ~opens.any(axis=1, keepdims=True)
            if not (opens | closes).any():
                break
            closed = (closed & ~opens) | closes
        q, v = evaluate_padded(self._impacts.project, *self.arguments(x, p, t))
        projected = self.closed(x).any(axis=1) & ~dependent
        x[projected, : self._cuts[1]] = np.hstack([q, v])[projected]
        return acceleration, dependent

    def _names(self, which: Mask) -> str:
        return ", ".join(repr(name) for name, there in zip(self._impacts.names, which, strict=True) if there)
