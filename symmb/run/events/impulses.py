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
        time of the event [s]
    name : str
        name of the Impact, or of the joint
    what : str
        "impact", or "closes" and "opens" for a joint or for a contact that remains closed for some time
    before, after : float
        rate of the gap [m/s, rad/s] before and after the event. For a joint: rate of the margin of its condition. The
        condition is met if the margin is not above 0
    work : float
        work of the impulse [J]; negative if energy is lost
    depends_on_order : bool
        whether another order of the impacts at this instant would give another result
    impulse : tuple of float
        impulse along the gap [N s, N m s], or impulses of the rows of a joint that closes, with the order and signs of
        their multipliers; empty if a joint or contact opens. Joints that close at one instant have one common impact

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
    """Warnings about simultaneous impacts, if the motion after them depends on their order."""
    doubtful = [event for event in events if event.depends_on_order]
    if not doubtful:
        return ()
    time = doubtful[0].time
    names = ", ".join(repr(name) for name in dict.fromkeys(event.name for event in doubtful if event.time == time))
    return (
        f"The impacts of {names} at t = {time:g} s are simultaneous, and the motion after them depends on their "
        "order. symmb computes them one after another, in the order of declaration.",
    )
