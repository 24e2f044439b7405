"""Contacts of samples: their data for c/impacts.h, and the record of what happens at them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from symmb._types import Array
from symmb.codegen.c_source import c_number

MOST_IMPULSES = int(c_number("impacts", "MOST_IMPULSES"))
EVENT = ("sample", "contact", "what", "time", "before", "after", "work", "ordered", *("impulse",) * MOST_IMPULSES)
"""What the numbers of an event are: rates of the gap, or of the margin of a joint's condition, before and after, work,
whether the order of impacts matters, and the impulse along the gap, or of each row of the joint."""
IMPACT, CLOSES, OPENS, BLAMED = range(4)
"""What events are. Contacts are blamed for a failure."""
CROWD = int(c_number("impacts", "CROWD"))


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
