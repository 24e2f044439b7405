"""Events of runs."""

from collections.abc import Sequence
from dataclasses import dataclass

from symmb._types import Array
from symmb.run.codegen import BLAMED, CLOSES, IMPACT, OPENS, Contacts

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
    """Events of each of N samples, from rows (k, 14) in the order of `symmb.run.codegen.EVENT`."""
    found: list[list[Event]] = [[] for _ in range(N)]
    for sample, k, what, time, before, after, work, ordered, *L in rows[rows[:, 2] != BLAMED].tolist():
        impulse = L[: contacts.impulses_of(int(k), int(what))]
        event = Event(time, contacts.names[int(k)], _WHAT[what], before, after, work, bool(ordered), tuple(impulse))
        found[int(sample)].append(event)
    return [tuple(events) for events in found]


def event_doubts(events: Sequence[Event]) -> tuple[str, ...]:
    """Warnings about events: simultaneous impacts whose result depends on their order."""
    doubtful = [event for event in events if event.depends_on_order]
    if not doubtful:
        return ()
    time = doubtful[0].time
    names = ", ".join(repr(name) for name in dict.fromkeys(event.name for event in doubtful if event.time == time))
    return (
        f"The impacts of {names} at t = {time:g} s happen at one instant, and the motion after them depends on their "
        "order. They are taken in rounds, in the order of declaration.",
    )
