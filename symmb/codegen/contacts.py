"""Contacts of samples: their data for c/impacts.h, and the record of what happens at them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.codegen.c_source import c_number
from symmb.codegen.failures import FailureCode

MOST_IMPULSES = int(c_number("impacts", "MOST_IMPULSES"))
EVENT = ("sample", "contact", "what", "time", "before", "after", "work", "ordered", *("impulse",) * MOST_IMPULSES)
"""What the numbers of an event are: rates of the gap, or of the margin of a joint's condition, before and after, work,
whether the order of impacts matters, and the impulse along the gap, or of each row of the joint."""
IMPACT, CLOSES, OPENS, BLAMED = range(4)
"""What events are. Contacts are blamed for a failure."""
ROUNDING, _CROWD_SPAN, _CONTACT_STEP = (
    c_number("impacts", name) for name in ("ROUNDING", "CROWD_SPAN", "CONTACT_STEP")
)
CROWD, _MOST_EVENTS = (int(c_number("impacts", name)) for name in ("CROWD", "MOST_EVENTS"))


class PostImpact:
    """N samples after an event.

    Attributes
    ----------
    x : (N, n_x)             states
    work : (N,)              of impulses [J]
    rows : list              events, see `EVENT`
    failure : (N,)           FailureCode, -1 without
    soon : (N,)              time after which a contact may close again [s]
    lift : (N, n)            raises gaps that open so slowly that rounding may turn them back [m], 0 for joints
    """

    def __init__(self, x: Array, n: int) -> None:
        N = len(x)
        self.x, self.work, self.failure = x.copy(), np.zeros(N), np.full(N, -1)
        self.soon, self.lift = np.full(N, np.inf), np.zeros((N, n))
        self.rows: list[tuple[float, ...]] = []

    def note(self, sample: int, contact: int, what: int, t: float, *numbers: float) -> None:
        """An event, with its rates, its work, whether its order matters, and its impulses."""
        row = sample, contact, what, t, *numbers
        self.rows.append((*row, *(0.0,) * (len(EVENT) - len(row))))

    def fail(self, reasons: Mask, blamed: Mask, t: Array, why: FailureCode) -> None:
        """Samples with reasons (N, k) fail by contacts (N, n) at times (N,), if they have not."""
        fails = np.logical_or.reduce(reasons, axis=1) & (self.failure < 0)
        for i, k in np.argwhere(fails[:, None] & blamed).tolist():
            self.note(i, k, BLAMED, float(t[i]))
        self.failure[fails] = why


class ContactLaws(Protocol):
    """The laws of contacts, and of joints that open and close, for N samples.

    These have states x (N, n_x), parameters p (N, n_p) and times t (N,) [s].
    """

    def start_faults(self, x: Array, p: Array, t: Array, span: float) -> dict[int, str]:
        """Texts about samples that cannot start a run of some span [s]."""
        ...

    def started(self, x: Array, p: Array, t: Array) -> Array:
        """States at the start, which tell of conditions that hold there."""
        ...

    def forces(self, x: Array, p: Array, t: Array) -> Array:
        """Forces in closed contacts, raised by their rounding (N, n)."""
        ...

    def __call__(self, x: Array, p: Array, t: Array, contact: Indices) -> PostImpact:
        """Samples after events (N,): contacts that close, joints, n + contacts that open, -1 where none is known."""
        ...


@dataclass(frozen=True)
class Contacts:
    """Contacts of a model, and joints that open and close. Gaps and margins of conditions are the last switches.

    Attributes
    ----------
    names : n str              of the contacts, and of the joints for each of their events
    closed : int               numbers of the states that are 1 for closed contacts
    n_q, n_v : int             numbers of coordinates and velocities, with which a state begins
    with_work : bool           whether the last state is the work along the motion
    length, energy : float     sizes of the motion
    displacements : n_v float  sizes of displacements along v
    joints : lists of int      of the events of joints that open and close, by their names in c/impacts.h
    n_rows : int               number of rows of all joints
    laws : ContactLaws         what events do, on arrays, and faults at the start
    """

    names: tuple[str, ...]
    closed: tuple[int, ...]
    n_q: int
    n_v: int
    with_work: bool
    length: float
    energy: float
    displacements: tuple[float, ...]
    joints: Mapping[str, tuple[int, ...]]
    n_rows: int
    laws: ContactLaws = field(repr=False)

    def impulses_of(self, number: int, what: int) -> int:
        """How many impulses an event of this number and kind has."""
        if number < len(self.closed):
            return int(what == IMPACT)
        return self.joints["count_row"][number - len(self.closed)] if what == CLOSES else 0

    def started(self, times: Array, x0: Array, p: Array) -> tuple[Array, dict[int, str]]:
        """States at the start of a run over the times, nan for samples that cannot start, and texts about these."""
        faults = self.laws.start_faults(x0, p, np.full(len(p), times[0]), float(times[-1] - times[0]))
        x0 = self.laws.started(x0, p, np.full(len(p), times[0]))
        x0[list(faults)] = np.nan
        return x0, faults


class ContactEvents:
    """Events of samples under way, each with steps of its own.

    Attributes
    ----------
    rows : list of (k, 8)    see `EVENT`
    """

    def __init__(self, contacts: Contacts, t: Array, span: float) -> None:
        self._contacts, self._span, self.rows = contacts, span, [np.empty((0, len(EVENT)))]
        self._crowd_start, self._crowd, self._count = t.copy(), np.zeros(len(t), int), np.zeros(len(t), int)

    def meet(self, samples: Indices, x: Array, p: Array, t: Array, behind: Array, contact: Indices) -> PostImpact:
        """Samples (N,) after events at states x (N, n_x), which may end with the work.

        Laws of time have the values that they have `behind` the times t (N,) of the events.
        """
        after = self._contacts.laws(x, p, behind, contact)
        if self._contacts.with_work:
            after.x[:, -1] += after.work
        rows = np.array(after.rows).reshape(-1, len(EVENT))
        rows[:, EVENT.index("time")] = t[rows[:, 0].astype(np.intp)]
        rows[:, 0] = samples[rows[:, 0].astype(np.intp)]
        self.rows.append(rows)
        after.soon = np.maximum(after.soon, _CONTACT_STEP * self._span)
        moved = t - self._crowd_start[samples] > _CROWD_SPAN * self._span
        self._crowd_start[samples] = np.where(moved, t, self._crowd_start[samples])
        self._crowd[samples] = np.where(moved, 0, self._crowd[samples] + 1)
        self._count[samples] += 1
        endless = (self._crowd[samples] > CROWD) | (self._count[samples] > _MOST_EVENTS)
        after.failure[endless & (after.failure < 0)] = FailureCode.ENDLESS
        return after
