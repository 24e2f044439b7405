"""Steps over the horizon, with their control."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from symmb._types import Array, Mask
from symmb.enclosures import chebyshev as ch
from symmb.enclosures.curves import Step
from symmb.enclosures.ellipses import Choice, Control, usual_patches
from symmb.enclosures.errors import ProofError
from symmb.enclosures.flow import frame, motion
from symmb.enclosures.front import Front, entering, leaving, well_conditioned
from symmb.enclosures.outputs import output_bounds
from symmb.enclosures.problem import Problem
from symmb.enclosures.start import first_front
from symmb.enclosures.step import Proof, prove

TIME_TERMS, FRAME_TERMS = 20, 11
"""Terms of the motion and of the frame in time."""
_RESOLVED, _UNRESOLVED = 1e-14, 1e-12
"""Last coefficients in time over the sizes of the states: those aimed at, and those with which a step is too long."""
_SHORTEST = 2.0**-4
"""Shortest step that is tried in vain, over the one aimed at."""
_FIRST = 50
"""Horizon over the first step that is tried."""
_LOST, _CRAWL = 1e-2, 2.0**-6
"""Remainder over the width of the states, and step over the longest one, with which a proof ends soon anyway."""
_GRAINS = 2.0**30
"""Steps are multiples of a power of 2, that of the horizon over this: times of steps are then sums without rounding."""


@dataclass
class Course:
    """What is proved over a part of the box: bounds (n_t, n_y), infinite where there are none.

    Attributes
    ----------
    remainder : (n_t, n_y) part of the bounds that is not the range of a polynomial
    until : time up to which the motion is proved, from the first one [s]
    why : what ended the proof; empty if it reached the end
    front : the end
    checkpoint : the last front whose remainder was not too large, or the first one
    control : what is adapted from step to step
    """

    lower: Array
    upper: Array
    remainder: Array
    until: float = 0.0
    why: str = ""
    front: Front | None = None
    checkpoint: Front | None = None
    control: Control | None = None

    @classmethod
    def empty(cls, problem: Problem) -> "Course":
        """Nothing is proved."""
        shape = len(problem.times), problem.outputs.numel_out(0)
        return cls(np.full(shape, -np.inf), np.full(shape, np.inf), np.full(shape, np.inf))

    def keep(self, earlier: "Course", known: Mask) -> None:
        """Take the bounds of an earlier course at the times (n_t,) at which they are known."""
        self.lower[known], self.upper[known] = earlier.lower[known], earlier.upper[known]
        self.remainder[known] = earlier.remainder[known]


def march(
    problem: Problem,
    order: int,
    begin: Front | None,
    control: Control | None,
    largest: float,
    progress: Callable[[float], None],
) -> Course:
    """Bounds of the outputs over one box, from the start or from a front.

    Parameters
    ----------
    order : highest degree in each parameter
    begin : front to go on from; None: the start
    control : that of the course before
    largest : remainder, over the width of the states, above which the march ends
    progress : called with the time that is reached
    """
    course, times = Course.empty(problem), problem.times
    end = float(times[-1])
    grain = 2.0 ** float(np.ceil(np.log2(end or 1.0))) / _GRAINS
    usual = usual_patches(problem.d)
    first = Control(Choice(patches=(usual, usual)), (end or 1.0) / _FIRST)
    control = first if control is None else replace(control)
    course.control = control
    try:
        front = first_front(problem, order) if begin is None else begin
    except ProofError as error:
        course.why = f"the start cannot be proved, because {error}"
        return course
    longest = 0.0
    stored = int(np.searchsorted(times, front.t, side="left" if begin is None else "right"))
    course.until, course.front, course.checkpoint = front.t, front, front
    while stored < len(times):
        try:
            front = well_conditioned(front, problem.scales)
            step, proof = _step(problem, front, grain, control)
        except ProofError as error:
            course.why = str(error)
            return course
        front = leaving(step, proof.end)
        behind = int(np.searchsorted(times, front.t, side="right"))
        part = slice(stored, behind)
        if behind > stored:
            course.lower[part], course.upper[part], course.remainder[part] = output_bounds(
                step, proof.W, times[part], control.choice
            )
        stored, course.until, course.front = behind, front.t, front
        progress(front.t)
        share, longest = front.share(), max(longest, step.h)
        if share > largest:
            course.why = "the deviations from the polynomials are large"
            return course
        course.checkpoint = front
        if share > _LOST and step.h < _CRAWL * longest:
            course.why = "the deviations from the polynomials grow too fast"
            return course
    return course


def _step(problem: Problem, front: Front, grain: float, control: Control) -> tuple[Step, Proof]:
    """A proved step that begins at a front, and its proof."""
    h = aim = control.h
    reason = ""
    while h >= _SHORTEST * aim and h > 4 * grain:
        h = float(np.floor(h / grain)) * grain
        try:
            x = motion(problem, front.x, front.t, h, TIME_TERMS)
            tail = _tail(problem, x.c)
            wanted = h * float(np.clip((_RESOLVED / max(tail, 1e-30)) ** (1.0 / TIME_TERMS), 0.3, 1.5))
            if tail > _UNRESOLVED:
                aim = h = wanted
                continue
            B, C = frame(problem, x.c, front.B, front.t, h, FRAME_TERMS)
            step = Step(problem, front.t, h, x, B, C)
            proof = prove(step, entering(front, step), control)
            control.h = wanted
            return step, proof
        except ProofError as error:
            reason, h = str(error), 0.5 * h
    raise ProofError(reason or "the motion changes too fast for the shortest step")


def _tail(problem: Problem, x: Array) -> float:
    """The last two coefficients in time, over the sizes of the states."""
    modulus = ch.sums(x[:, -2:], x.ndim - 2).max(axis=1)
    size = np.maximum(problem.scales, ch.sums(x, x.ndim - 1))
    return float((modulus / size).max(initial=0.0))
