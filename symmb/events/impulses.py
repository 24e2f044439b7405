"""What happens at the instant of an event: impulses, contacts that close and contacts that open."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.mechanics import RESTITUTION
from symmb.model import DAE, Impacts
from symmb.symbolic import batch

ROUNDING = float(np.finfo(float).eps)
SMALL = 1e-12
"""Share of what a number is a sum of below which it is taken for 0."""
_MOST = 1000
"""Impacts at one instant: those that lose energy have died away long before."""


@dataclass(frozen=True)
class Event:
    """An event of a run.

    Attributes
    ----------
    time : float             [s]
    name : str               of the Impact
    what : str               "impact", or that from here on the contact stays closed, "closes", or does not, "opens"
    before, after : float    rates of the gap [m/s, rad/s]
    work : float             of the impulse [J], what is lost being negative
    """

    time: float
    name: str
    what: str
    before: float
    after: float
    work: float


def evaluated(f: ca.Function, *arguments: Array) -> list[Array]:
    """A Function for N samples, all arguments (N, n); maps are made for powers of 2 only, however N changes."""
    N = len(arguments[0])
    if N < 2:
        return list(batch(f, *arguments))
    rows = np.minimum(np.arange(1 << (N - 1).bit_length()), N - 1)
    return [values[:N] for values in batch(f, *[a[rows] for a in arguments])]


@dataclass
class Instant:
    """States x (E, n_x) of E samples after an event, and what happened.

    Attributes
    ----------
    work : (E,)              of impulses [J]
    events : list of (sample, Event)
    soon : (E,)              time after which a contact may close again [s]
    failures : list of (sample, reason)
    """

    x: Array
    work: Array
    events: list[tuple[int, Event]]
    soon: Array
    failures: list[tuple[int, str]]


class Rebounds:
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

    def start_faults(self, x: Array, p: Array, t: Array) -> list[tuple[int, str]]:
        """What keeps samples from starting: gaps below 0, and restitutions that are none."""
        at = self.arguments(x, p, t)
        gap, _ = evaluated(self._impacts.gaps, *at)
        e = evaluated(self._impacts.impulses, *at)[3]
        faults = []
        for i, k in np.argwhere(~(gap >= -1e-9 * self._dae.scales.length)):
            faults.append((int(i), f"Impact {self._impacts.names[k]!r}: the gap is {gap[i, k]:g} at the start"))
        for i, k in np.argwhere(~((e >= 0) & (e <= 1))):
            faults.append((int(i), f"Impact {self._impacts.names[k]!r}: {RESTITUTION.format(e[i, k])}"))
        return faults

    def __call__(self, x: Array, p: Array, t: Array, met: Indices, released: Mask) -> Instant:
        """After an event.

        Parameters
        ----------
        x : (E, n_x)           states right before
        p, t : (E, n_p), (E,)
        met : (E,) indices     contacts whose gaps have just closed, -1 where none
        released : (E, n)      closed contacts whose forces have just come to 0
        """
        impacts, lanes, was = self._impacts, np.arange(len(x)), self.closed(x)
        at = self.arguments(x, p, t)
        gap, rate = evaluated(impacts.gaps, *at)
        touching = was | (gap <= 8 * ROUNDING * self._dae.scales.length)
        touching[lanes[met >= 0], met[met >= 0]] = True
        # A rebound that would rise no higher than positions are rounded, and what is left of impacts of larger ones.
        rest = np.sqrt(2 * ROUNDING * self._dae.scales.length * evaluated(impacts.forces, *at)[2])
        rest = np.maximum(rest, SMALL * np.where(touching, np.abs(rate), 0.0).max(axis=1, keepdims=True))
        after = Instant(x.copy(), np.zeros(len(x)), [], np.full(len(x), np.inf), [])
        rate = self._struck(after, at, rate, touching, rest)
        slow = touching & (np.abs(rate) <= rest)
        acceleration, dependent = self._supported(after.x, p, t, slow, released)
        now = self.closed(after.x)
        for i in lanes[dependent].tolist():
            after.failures.append((i, f"the contacts {self._named(now[i])} that have closed depend on each other"))
        for what, changed in (("closes", now & ~was), ("opens", was & ~now)):
            for i, k in np.argwhere(changed).tolist():
                after.events.append((i, Event(float(t[i]), impacts.names[k], what, 0.0, 0.0, 0.0)))
        flying = touching & ~now & (rate > rest) & (acceleration < 0)
        flight = np.where(flying, 2 * rate / np.where(flying, -acceleration, 1.0), np.inf)
        after.soon[:] = 1.5 * flight.min(axis=1)
        return after

    def _struck(self, after: Instant, at: tuple[Array, ...], rate: Array, touching: Mask, rest: Array) -> Array:
        """Impacts one after the other until no gap that is 0 closes any more; rates (E, n) of the gaps then."""
        names, dae, lanes, times = self._impacts.names, self._dae, np.arange(len(rate)), at[-1][:, 0].tolist()
        n, n_v = len(names), dae.n_v
        W, B, at_rest, e = evaluated(self._impacts.impulses, *at)
        W, B = W.reshape(-1, n, n_v), B.reshape(-1, n_v, n)
        D = W @ B
        own = np.einsum("ekk->ek", D)
        movable = own * dae.scales.energy > SMALL * np.square(W * dae.displacement_scales).sum(axis=2)
        rate, touching, impulse = rate.copy(), touching.copy(), np.zeros(rate.shape)
        for _ in range(_MOST):
            hit = touching & (rate < -rest)
            held = hit & ~movable
            for i in lanes[held.any(axis=1)].tolist():
                name = names[int(held[i].argmax())]
                after.failures.append((i, f"Impact {name!r} cannot rebound: its gap closes as the constraints have it"))
                touching[i] = False
            some = lanes[(hit & touching).any(axis=1)]
            if not some.size:
                break
            k = hit[some].argmax(axis=1)
            u = rate[some, k]
            w = -e[some, k] * u
            P = (w - u) / own[some, k]
            work = P * ((u + w) / 2 - at_rest[some, k])
            rate[some] += D[some, :, k] * P[:, None]
            rate[some, k] = w
            impulse[some, k] += P
            after.work[some] += work
            for i, j, *told in zip(some.tolist(), k.tolist(), u.tolist(), w.tolist(), work.tolist(), strict=True):
                after.events.append((i, Event(times[i], names[j], "impact", *told)))
        else:
            for i in lanes[(touching & (rate < -rest)).any(axis=1)].tolist():
                after.failures.append((i, f"impacts of {self._named(touching[i])} at one instant do not end"))
        after.x[:, self._cuts[0] : self._cuts[1]] += (B @ impulse[:, :, None])[:, :, 0]
        return rate

    def _supported(self, x: Array, p: Array, t: Array, slow: Mask, released: Mask) -> tuple[Array, Mask]:
        """Close those of the slow contacts that push; accelerations of all gaps (E, n), and where contacts depend."""
        f, closed = self._impacts.forces, slow & ~released
        acceleration = np.zeros(slow.shape)
        dependent: Mask = np.zeros(len(x), dtype=bool)
        for _ in range(3 * slow.shape[1] + 3):
            x[:, self.flags] = closed
            force, acceleration, size, inertia = evaluated(f, *self.arguments(x, p, t))
            dependent = np.asarray(~np.isfinite(force).all(axis=1))
            pull = np.where(closed, force / inertia / np.where(size > 0, size, 1.0), 0.0)
            lets_go = np.asarray(pull == pull.min(axis=1, keepdims=True)) & (pull < -SMALL)
            comes = slow & ~closed & (acceleration < -SMALL * size) & ~lets_go.any(axis=1, keepdims=True)
            if not (lets_go | comes).any():
                break
            closed = (closed & ~lets_go) | comes
        q, v = evaluated(self._impacts.held, *self.arguments(x, p, t))
        holds = self.closed(x).any(axis=1) & ~dependent
        x[holds, : self._cuts[1]] = np.hstack([q, v])[holds]
        return acceleration, dependent

    def _named(self, which: Mask) -> str:
        return ", ".join(repr(name) for name, there in zip(self._impacts.names, which, strict=True) if there)
