"""The whole box: in parts where and when the remainder grows, joined at the end."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from symmb._types import Array, Mask
from symmb.enclosures.expressions import expression_bounds
from symmb.enclosures.front import Front, half
from symmb.enclosures.march import Course, march
from symmb.enclosures.problem import Problem

_LARGE = 1e-5
"""Remainder over the width of the states in the whole box above which a part is halved, if another one is allowed.

A part that is halved keeps its remainder. It is halved early, as what polynomials of a large part lack is not got back.
"""
_VISIBLE, _SMALL = 1e-6, 0.1
"""Widths over the size of an output, and over how far it moves with the parameters, that are worth a caution."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of the box, the front from which its motion goes on, and bounds up to there.

    Attributes
    ----------
    share : of the whole box
    earlier : None before the start
    """

    problem: Problem
    share: float = 1.0
    begin: Front | None = None
    earlier: Course | None = None

    @property
    def since(self) -> float:
        """Time [s] from which on the motion is not yet proved."""
        return 0.0 if self.begin is None else self.begin.t

    def halves(self, front: Front, course: Course) -> "list[_Part]":
        """Both halves, from a front of the course."""
        variable = front.slowest()
        return [
            _Part(self.problem.over(variable, side), 0.5 * self.share, half(front, variable, side), course)
            for side in (-1, 1)
        ]


@dataclass(frozen=True)
class Enclosure:
    """Bounds (n_t, n_y) over the whole box, infinite where there are none, and how far they are proved.

    Attributes
    ----------
    remainder : (n_t, n_y) largest part of the bounds that is not the range of a polynomial
    until : time up to which the motion is proved, from the first one [s]
    why : what ended the proof; empty if it reached the end
    boxes : parts in which the box ended
    """

    lower: Array
    upper: Array
    remainder: Array
    until: float
    why: str
    boxes: int

    @property
    def is_loose(self) -> Mask:
        """Which bounds (n_t, n_y) are mostly remainder.

        Remainders that are small beside the output, or beside how far the parameters ever move it, are left out: at
        first the parameters have had no effect, and any width is remainder.
        """
        width, finite = self.upper - self.lower, np.isfinite(self.upper)
        moved = np.where(finite, width - 2.0 * self.remainder, 0.0).max(axis=0)
        size = np.where(finite, np.maximum(np.abs(self.lower), np.abs(self.upper)), 0.0)
        visible = np.maximum(_VISIBLE * np.maximum.accumulate(size, axis=0), _SMALL * moved)
        return np.asarray(finite & (self.remainder > 0.25 * width) & (2.0 * self.remainder > visible))


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
    if not problem.n:
        course = expression_bounds(problem, order)
        return Enclosure(course.lower, course.upper, course.remainder, course.until, course.why, 1)
    horizon = float(problem.times[-1]) or 1.0
    waiting, courses, count, done = [_Part(problem)], [], 1, 0.0

    def follow(part: _Part, largest: float, done: float) -> Course:
        """The course of a part, whose progress is told."""
        return march(part.problem, order, part.begin, part.earlier and part.earlier.control, largest,
                     lambda t: progress(done + part.share * (t - part.since) / horizon))  # fmt: skip

    while waiting:
        part = min(waiting, key=lambda part: part.since)  # those that lose first are halved first
        waiting.remove(part)
        more = count < boxes and problem.d > 0
        course = follow(part, _LARGE / part.share if more else np.inf, done)
        if part.earlier is not None:
            course.keep(part.earlier, problem.times <= part.since)
        at = course.checkpoint
        if course.why and more and at is not None:
            waiting += part.halves(at, course)
            count += 1
            done += part.share * (at.t - part.since) / horizon
        else:
            courses.append(course)
            done += part.share * (horizon - part.since) / horizon
    last = min(courses, key=lambda course: course.until if course.why else np.inf)
    return Enclosure(
        np.min([course.lower for course in courses], axis=0),
        np.max([course.upper for course in courses], axis=0),
        np.max([course.remainder for course in courses], axis=0),
        min(course.until for course in courses),
        last.why,
        count,
    )
