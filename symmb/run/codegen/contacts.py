"""Contacts of samples: data for c/impacts.h, and the record of events."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from symmb._options import number_text
from symmb._types import Array
from symmb.declare.symbolic import batch_padded
from symmb.run.codegen.c_source import c_number

MOST_IMPULSES = int(c_number("impacts", "MOST_IMPULSES"))
EVENT = ("sample", "contact", "what", "time", "before", "after", "work", "ordered", *("impulse",) * MOST_IMPULSES)
"""Names of the numbers of an event. `before` and `after` are rates of the gap, or of the margin of a joint's condition.
`ordered`: the order of impacts matters. Impulses are along the gap, or belong to the rows of the joint."""
IMPACT, CLOSES, OPENS, BLAMED = range(4)
"""Kinds of events. A contact is BLAMED if it causes a failure."""
CROWD = int(c_number("impacts", "CROWD"))


@dataclass(frozen=True)
class Contacts:
    """Contacts of a model, and joints that open and close. Gaps and margins of conditions are the last switches.

    Attributes
    ----------
    names : n str              names of the contacts, and, for each event of a joint, the name of the joint
    closed : int               numbers of the states that are 1 for closed contacts
    n_q, n_v : int             numbers of coordinates and velocities, the first entries of a state
    with_work : bool           whether the last state is the work along the motion
    length, energy : float     sizes of the motion
    displacements : n_v float  sizes of displacements along v
    joints : lists of int      name in c/impacts.h -> data of the events of joints that open and close
    n_rows : int               number of rows of all joints
    start : Function           (x, p, t, span) -> x at the start of a run of length `span` [s], with the conditions that
                               hold there; faults (m,), which are 0 or 1; and a number (m,) for the text of each fault
    fault_texts : m pairs      the text before and the text after the number of a fault; the second is empty if there
                               is no number. The first fault of a sample is reported
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
    start: ca.Function = field(repr=False)
    fault_texts: tuple[tuple[str, str], ...] = field(repr=False)

    def impulses_of(self, number: int, what: int) -> int:
        """Number of impulses of an event of kind `what` at the contact or joint `number`."""
        if number < len(self.closed):
            return int(what == IMPACT)
        return self.joints["count_row"][number - len(self.closed)] if what == CLOSES else 0

    def started(self, times: Array, x0: Array, p: Array) -> tuple[Array, dict[int, str]]:
        """States (N, n_x) at the start of a run, nan for samples that cannot start, and faults by sample number."""
        n, n_p = self.start.numel_in(0), self.start.numel_in(1)
        horizon = times[0], times[-1] - times[0]
        at = x0[:, :n], p[:, :n_p], *(np.full((len(p), 1), time) for time in horizon)
        x, found, numbers = batch_padded(self.start, *at)
        faulty = (found > 0.5) & np.isfinite(x0).all(axis=1, keepdims=True)
        first = [(i, int(faulty[i].argmax())) for i in np.flatnonzero(faulty.any(axis=1)).tolist()]
        faults = {i: self._fault_text(k, float(numbers[i, k])) for i, k in first}
        x0 = np.hstack([x, x0[:, n:]])
        x0[list(faults)] = np.nan
        return x0, faults

    def _fault_text(self, fault: int, number: float) -> str:
        text, behind = self.fault_texts[fault]
        return f"{text}{number_text(number)}{behind}" if behind else text
