"""Events of runs, and what contacts and joints that open and close must fulfil at the start."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symmb._options import number_text
from symmb._types import Array
from symmb.codegen import BLAMED, CLOSES, IMPACT, OPENS, Contacts
from symmb.events.joint_laws import JointLaws, arguments_of, evaluate_padded
from symmb.mechanics import RESTITUTION
from symmb.model import DAE, Impacts

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

    def _arguments(self, x: Array, p: Array, t: Array) -> tuple[Array, ...]:
        return arguments_of(self._dae, x, p, t)

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
