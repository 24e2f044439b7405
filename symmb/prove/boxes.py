"""The whole box: in parts where and when the remainder grows, joined at the end."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from symmb._types import Array, Mask
from symmb.prove.curves import TimeStep
from symmb.prove.ellipses import Choice, Control
from symmb.prove.errors import ProofError
from symmb.prove.flow import integrated
from symmb.prove.front import half, slowest
from symmb.prove.march import Course, Place, march
from symmb.prove.outputs import output_bounds
from symmb.prove.problem import Problem
from symmb.prove.rounding import LARGEST_ZERO
from symmb.prove.start import nominal_front

_EARLY_REMAINDER = 1e-7
"""Remainder over the width of the states in the whole box at which parts are halved, as long as half of them are left.

What polynomials of a large part lack is not got back, and steps of large parts take many times longer. With all parts
spent early, the double pendulum, 5 %, order 8, was proved for 5 s with 1e-5, for 9 s with 1e-7, and for 3 s with 1e-8.
"""
_LEAST_GROWTH = 2.0
"""Least growth of a remainder between two halvings: what is kept from before does not become less by more of them."""
_LOST_REMAINDER = 1e-3
"""Remainder over the width of the states at which a part is lost: it soon grows by itself, as its square.

The other half of the parts are for those that are lost first. They are halved where the remainder was small.
"""
_VISIBLE_WIDTH, _VISIBLE_OF_MOTION = 1e-6, 0.1
"""Widths over the size of an output, and over how far it moves with the parameters, that are worth a caution."""
_VISIBLE_OF_TERMS = 1e-9
"""The same over the terms that make an output: where they cancel, their small remainders are left."""
_SPREADS_OF_ELLIPSES = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""How far parameters move on the ellipses that are tried where there are no states, over their middles."""
_SHARP_WITHOUT_STATES = 1e-12
"""Share of the width by which bounds may be off there: there are few of them."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of the box and its course so far, with the share that it is of the whole box."""

    problem: Problem
    course: Course
    share: float = 1.0

    @cached_property
    def small(self) -> float:
        """Remainder over the width of the states up to which it is halved early."""
        begin = self.course.checkpoint
        return max(_EARLY_REMAINDER / self.share, 0.0 if begin is None else _LEAST_GROWTH * begin.front.share())

    def halves(self, order: int) -> "list[_Part]":
        """Both halves, in the variable whose coefficients decay the least at the end.

        They go on from the checkpoint. If that is the start, or if there is none, they begin again: the start of a half
        has a smaller remainder. ProofError if there are parameters without a start.
        """
        end, at = self.course.end, self.course.checkpoint
        variable = slowest(nominal_front(self.problem, order) if end is None else end.front.x)
        if at is None or not at.front.t:
            parts = [self.problem.over(variable, side) for side in (-1, 1)]
            return [_Part(part, Course.empty(part), 0.5 * self.share) for part in parts]
        return [
            _Part(
                self.problem.over(variable, side),
                self.course.back_to(
                    Place(half(at.front, variable, side), at.control, at.problem.over(variable, side)),
                    self.problem.times,
                ),
                0.5 * self.share,
            )
            for side in (-1, 1)
        ]


@dataclass(frozen=True)
class Enclosure:
    """Bounds (n_t, n_y) over the whole box, infinite where there are none, and how far they are proved.

    Attributes
    ----------
    remainder : (n_t, n_y) largest part of the bounds that is not the range of a polynomial
    terms : (n_y,) largest sizes of the terms that make the outputs
    until : time up to which the motion is proved, from the first one [s]
    why : what ended the proof; empty if it reached the end
    boxes : parts in which the box ended
    """

    lower: Array
    upper: Array
    remainder: Array
    terms: Array
    until: float
    why: str
    boxes: int

    @property
    def is_loose(self) -> Mask:
        """Which bounds (n_t, n_y) are mostly remainder.

        Remainders that are small beside the output, or beside how far the parameters ever move it, are left out: at
        first the parameters have had no effect, and any width is remainder. So are those of terms that
        cancel.
        """
        finite = np.isfinite(self.upper)
        width, remainder = np.where(finite, self.upper - self.lower, np.inf), np.where(finite, self.remainder, 0.0)
        moved = np.where(finite, width - 2.0 * remainder, 0.0).max(axis=0)
        size = np.where(finite, np.maximum(np.abs(self.lower), np.abs(self.upper)), 0.0)
        visible = np.maximum(_VISIBLE_WIDTH * np.maximum.accumulate(size, axis=0), _VISIBLE_OF_MOTION * moved)
        visible = np.maximum(visible, _VISIBLE_OF_TERMS * self.terms + LARGEST_ZERO)
        return np.asarray(finite & (remainder > 0.25 * width) & (2.0 * remainder > visible))


@np.errstate(all="ignore")  # what is not finite proves nothing
def enclose(
    problem: Problem, order: int, boxes: int, progress: Callable[[float], None] = lambda share: None
) -> Enclosure:
    """Bounds of the outputs over the box of a problem.

    Parameters
    ----------
    order : highest degree in each parameter
    boxes : most parts of the box
    progress : called with the share of the horizon that is done
    """
    if problem.n:
        courses = [part.course for part in _followed(problem, order, boxes, progress)]
    else:
        courses = [_of_expressions(problem, order)]
    last = min(courses, key=lambda course: course.until if course.why else np.inf)
    return Enclosure(
        np.min([course.lower for course in courses], axis=0),
        np.max([course.upper for course in courses], axis=0),
        np.max([course.remainder for course in courses], axis=0),
        np.max([course.terms for course in courses], axis=0),
        min(course.until for course in courses),
        last.why,
        len(courses),
    )


def _followed(problem: Problem, order: int, boxes: int, progress: Callable[[float], None]) -> list[_Part]:
    """The parts in which the box ends, with their courses."""
    horizon = float(problem.times[-1]) or 1.0
    parts = [_Part(problem, Course.empty(problem))]

    def follow(part: _Part, largest: float) -> None:
        """Go on with a part until its remainder is too large, or to the end, and tell the progress."""
        done = sum(other.share * other.course.until for other in parts if other is not part)
        march(part.problem, order, part.course, part.small, max(part.small, largest),
              lambda t: progress((done + part.share * t) / horizon))  # fmt: skip

    for most, largest in ((boxes // 2, 0.0), (boxes, _LOST_REMAINDER), (boxes, np.inf)):
        for part in parts:
            if not part.course.why:
                follow(part, largest)
        while len(parts) < most and (lost := [part for part in parts if part.problem.d and not part.course.is_done]):
            first = min(lost, key=lambda part: part.course.until)  # those that lose first are halved first
            try:
                halves = first.halves(order)
            except ProofError:  # more parts do not prove what does not exist
                break
            parts.remove(first)
            for part in halves:
                parts.append(part)
                follow(part, largest)
    return parts


def _of_expressions(problem: Problem, order: int) -> Course:
    """The course of a problem without states. Each time has the best of the bounds found on several ellipses."""
    end, terms = float(problem.times[-1]), (order + 1,) * problem.d
    course = Course.empty(problem)
    none = integrated(np.zeros((0, *terms)), np.zeros((0, 1, *terms)), end or 1.0)
    whole = TimeStep(problem, 0.0, end or 1.0, none, none, none.c[None])
    for spread in _SPREADS_OF_ELLIPSES:
        control = Control(Choice((spread, spread)), end)
        lower, upper, rest, _ = output_bounds(whole, np.zeros(0), problem.times, control, _SHARP_WITHOUT_STATES)
        course.lower, course.upper = np.maximum(course.lower, lower), np.minimum(course.upper, upper)
        course.remainder = np.minimum(course.remainder, rest)
    course.until = end
    if not np.isfinite(course.upper).any():
        course.why = "an output cannot be shown to be smooth over the box"
    return course
