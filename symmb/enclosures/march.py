"""Steps over the horizon, with their control."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from symmb._types import Array
from symmb.enclosures import chebyshev as ch
from symmb.enclosures.curves import TimeStep
from symmb.enclosures.ellipses import Choice, Control
from symmb.enclosures.errors import ProofError
from symmb.enclosures.flow import frame, motion
from symmb.enclosures.front import Front, entering, leaving, well_conditioned
from symmb.enclosures.outputs import output_bounds
from symmb.enclosures.problem import Problem
from symmb.enclosures.rounding import above
from symmb.enclosures.schedule import Phase, grain_of
from symmb.enclosures.start import first_front
from symmb.enclosures.step import SINGULAR, Proof, is_regular, prove
from symmb.enclosures.switching import holds, off_while_switching
from symmb.enclosures.transitions import drifted, mapped

TIME_TERMS, FRAME_TERMS = 20, 11
"""Terms of the motion and of the frame in time."""
_RESOLVED, _UNRESOLVED = 1e-14, 1e-12
"""Last coefficients in time over the sizes of the states: those aimed at, and those with which a step is too long."""
_SHORTEST = 2.0**-4
"""Shortest step that is tried in vain, over the one aimed at."""
_MUCH_SHORTER = 0.3
"""A step over one that is too long for the motion."""
_FIRST = 50
"""Horizon over the first step that is tried."""
_LOST, _CRAWL = 1e-2, 2.0**-6
"""Remainder over the width of the states, and step over the longest one, with which a proof ends soon anyway."""
_NEAR = 8
"""Shortest step that ends at a change of states, over the unit of times."""
_AT = 4
"""Distance of output times from an instant that are at it, over the error of the instant."""
_RESOLVING = 2.0**-10
"""Parts of a step, over the step, down to which it is shown that no law of time switches in them."""


@dataclass(frozen=True, eq=False)
class Place:
    """A front, what is adapted from step to step there, and the problem in the phase that goes on there."""

    front: Front
    control: Control
    problem: Problem


@dataclass(eq=False)
class Course:
    """What is proved over a part of the box: bounds (n_t, n_y), infinite where there are none.

    Attributes
    ----------
    remainder : (n_t, n_y) part of the bounds that is not the range of a polynomial
    terms : (n_y,) largest sizes of the terms that make the outputs
    until : time up to which the motion is proved, from the first one [s]
    why : what ended the proof; empty if it can go on
    end : the last place; None before the start
    checkpoint : the last place where the remainder was small, or the first one
    stored : output times up to there
    """

    lower: Array
    upper: Array
    remainder: Array
    terms: Array
    until: float = 0.0
    why: str = ""
    end: Place | None = None
    checkpoint: Place | None = None
    stored: int = 0

    @classmethod
    def empty(cls, problem: Problem) -> "Course":
        """Nothing is proved."""
        shape = len(problem.times), problem.outputs.numel_out(0)
        return cls(np.full(shape, -np.inf), np.full(shape, np.inf), np.full(shape, np.inf), np.zeros(shape[1]))

    @property
    def is_done(self) -> bool:
        """Whether all output times have bounds, as far as outputs are smooth."""
        return self.stored == len(self.lower)

    @property
    def is_switched(self) -> bool:
        """Whether a law of time that switches ended the proof."""
        return bool(self.why) and self.end is not None and self.why == self.end.problem.why_switch

    def back_to(self, place: Place, times: Array) -> "Course":
        """The course up to the time of a place, from which it goes on there; times (n_t,) are those of the outputs."""
        stored = min(self.stored, int(np.searchsorted(times, place.front.t, side="right")))
        later = (np.arange(len(times)) >= stored)[:, None]
        lower, upper, remainder = (
            np.where(later, none, known)
            for none, known in ((-np.inf, self.lower), (np.inf, self.upper), (np.inf, self.remainder))
        )
        return Course(lower, upper, remainder, self.terms, place.front.t, "", place, place, stored)


def march(
    problem: Problem, order: int, course: Course, small: float, largest: float, progress: Callable[[float], None]
) -> None:
    """Go on with a course over one box from its last place, or from the start.

    Parameters
    ----------
    order : highest degree in each parameter
    small : remainder, over the width of the states, up to which a place is a checkpoint
    largest : the same above which the march stops
    progress : called with the time that is reached
    """
    end = float(problem.times[-1])
    if course.end is None:
        try:
            front = first_front(problem, order)
        except ProofError as error:
            course.why = f"the start cannot be proved, because {error}"
            return
        course.end = course.checkpoint = Place(front, Control(Choice(), (end or 1.0) / _FIRST), problem)
    place, longest = course.end, 0.0
    while not course.is_done:
        try:
            place, h = _next_place(course, place, grain_of(end))
        except ProofError as error:
            course.why = str(error)
            return
        course.end, course.until = place, place.front.t
        progress(course.until)
        share, longest = place.front.share(), max(longest, h)
        if share <= small:
            course.checkpoint = place
        if share > largest:
            return
        if share > _LOST and place.control.h < _CRAWL * longest:
            course.why = "the deviations from the polynomials grow too fast"
            return


def _next_place(course: Course, place: Place, grain: float) -> tuple[Place, float]:
    """The place behind a proved step, and how long the step is. The course stores bounds of the outputs."""
    problem, front, control = place.problem, place.front, replace(place.control)
    phase = problem.phase or Phase(problem.rates)
    is_in_window = front.t >= phase.stop
    usual, left = control.h, _left(problem, front.t, phase, grain)
    control.h = min(usual, left)
    step, proof = _step(problem, front, grain, control)
    beside = off_while_switching(step, proof, phase.window) if is_in_window else np.zeros(problem.n)
    front, times = leaving(step, proof.end), problem.times
    late = _late(problem, front.t)
    until = front.t if late is None else front.t - _AT * late  # at an instant, outputs have the new values
    behind = int(np.searchsorted(times, until, side="right"))
    if behind > course.stored:
        part = slice(course.stored, behind)
        found = output_bounds(step, proof.W, times[part], control, beside=beside)
        course.lower[part], course.upper[part], course.remainder[part], terms = found
        course.terms, course.stored = np.maximum(course.terms, terms), behind
    if left < usual:
        control.h = usual
    if is_in_window:
        if front.t < phase.resume:
            raise ProofError(phase.why)
        front, problem = replace(front, x_error=above(front.x_error + beside)), problem.after_switch()
    elif front.t < phase.stop and not course.is_done:
        front, problem = _changed(problem, front, grain)
    return Place(front, control, problem), step.h


def _left(problem: Problem, t: float, phase: Phase, grain: float) -> float:
    """Time to the next one at which a step must end, which may be infinite [s].

    Raises
    ------
    ProofError         if a proof cannot go over the switch that is next, or over an instant while laws switch
    """
    is_in_window, change = t >= phase.stop, problem.change
    if is_in_window and phase.window is None:
        raise ProofError(phase.why)
    end = phase.resume if is_in_window else phase.stop
    if change is None:
        return end - t
    if is_in_window and change.late is not None and change.time <= phase.resume:
        raise ProofError(f"values are sampled while {phase.why}")
    is_ahead = change.late is not None or change.time > t + _NEAR * grain
    return (min(end, change.time) if is_ahead else end) - t


def _late(problem: Problem, t: float) -> float | None:
    """The error of an instant at a time; None if there is none."""
    change = problem.change
    return None if change is None or t != change.time else change.late


def _changed(problem: Problem, front: Front, grain: float) -> tuple[Front, Problem]:
    """The front and the problem behind a change of states, if it is due."""
    change, late = problem.change, _late(problem, front.t)
    if change is None or (late is None and (change.late is not None or change.time > front.t + _NEAR * grain)):
        return front, problem
    if late is not None:
        front = drifted(problem, front, late)
    front, problem = mapped(problem, front, change.states), problem.after_change(front.t)
    return (front if late is None else drifted(problem, front, late)), problem


def _step(problem: Problem, front: Front, grain: float, control: Control) -> tuple[TimeStep, Proof]:
    """A proved step that begins at a front, and its proof.

    What was adapted to earlier steps may be bad for this one, and its frame may differ too much over the box: before it
    is given up, it is tried with the first choice, and with an orthogonal frame.
    """
    aim = control.h
    try:
        return _shortened(problem, well_conditioned(front, problem.scales), grain, control)
    except ProofError:
        control.choice, control.h = Choice(), aim
    try:
        return _shortened(problem, well_conditioned(front, problem.scales), grain, control)
    except ProofError:
        control.choice, control.h = Choice(), aim
        return _shortened(problem, well_conditioned(front, problem.scales, 0.0), grain, control)


def _shortened(problem: Problem, front: Front, grain: float, control: Control) -> tuple[TimeStep, Proof]:
    """The same, as long as it can be proved with what is adapted so far."""
    h = aim = control.h
    reason, change = "", problem.change
    while h >= _SHORTEST * aim and h > 4 * grain:
        if change is None or change.late is None or h != change.time - front.t:
            h = float(np.floor(h / grain)) * grain
        try:
            x = motion(problem, front.x, front.t, h, TIME_TERMS)
        except ProofError as error:
            reason, aim = str(error), _MUCH_SHORTER * h
            h = aim
            continue
        tail = _tail(problem, x.c)
        h_resolved = h * float(np.clip((_RESOLVED / max(tail, 1e-30)) ** (1.0 / TIME_TERMS), _MUCH_SHORTER, 1.5))
        if tail > _UNRESOLVED:
            aim = h = h_resolved
            continue
        step = None
        try:
            B, C = frame(problem, x.c, front.B, front.t, h, FRAME_TERMS)
            step = TimeStep(problem, front.t, h, x, B, C)
            _require_valid(step)
            proof = prove(step, entering(front, step), control)
            control.h = h_resolved
            return step, proof
        except ProofError as error:
            reason, h = str(error), 0.5 * h
            if step is not None and not is_regular(step, np.zeros(problem.n), Choice().patches):
                reason = SINGULAR
    raise ProofError(reason or "the motion changes too fast for the shortest step")


def _require_valid(step: TimeStep) -> None:
    """ProofError unless no law of time switches in a step, for all parameters, before the window of a switch."""
    phase, tape = step.problem.phase, step.problem.valid_tape
    if phase is None or tape is None:
        return
    end = min(step.t0 + step.h, phase.stop)
    if end > step.t0 and not holds(tape, step.problem, step.t0, end, _RESOLVING * step.h):
        raise ProofError(phase.why)


def _tail(problem: Problem, x: Array) -> float:
    """The last two coefficients in time, over the sizes of the states."""
    modulus = ch.sums(x[:, -2:], x.ndim - 2).max(axis=1)
    size = np.maximum(problem.scales, ch.sums(x, x.ndim - 1))
    return float((modulus / size).max(initial=0.0))
