"""The whole box: in parts where and when the remainder grows, joined at the end."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from symmb._types import Array
from symmb.enclosures.expressions import expression_bounds
from symmb.enclosures.front import Front, half
from symmb.enclosures.march import Course, march
from symmb.enclosures.problem import Problem

_LARGE = 2e-3
"""Remainder over the width of the states above which a box is halved, if another one is allowed."""


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
    done = [0.0]

    def over(part: Problem, begin: Front | None, allowed: int, share: float) -> tuple[list[Course], int]:
        """Courses over a part of the box, whose bounds are to be joined, and the boxes in which it ends."""
        since = 0.0 if begin is None else begin.t
        course = march(part, order, begin, _LARGE if allowed > 1 else np.inf,
                       lambda t: progress(done[0] + share * (t - since) / horizon))  # fmt: skip
        at = course.checkpoint
        if not course.why or allowed < 2 or at is None or course.front is None or not part.d:
            done[0] += share * (horizon - since) / horizon
            return [course], 1
        done[0] += share * (at.t - since) / horizon
        variable = course.front.slowest()
        later = part.times > at.t
        parts, count = [], 0
        for side, most in ((-1, allowed // 2), (1, allowed - allowed // 2)):
            found, ends = over(part.over(variable, side), half(at, variable, side), most, 0.5 * share)
            parts += found
            count += ends
        for found in parts:
            found.lower[~later], found.upper[~later] = course.lower[~later], course.upper[~later]
            found.remainder[~later] = course.remainder[~later]
        return parts, count

    courses, count = over(problem, None, boxes, 1.0)
    last = min(courses, key=lambda course: course.until if course.why else np.inf)
    return Enclosure(
        np.min([course.lower for course in courses], axis=0),
        np.max([course.upper for course in courses], axis=0),
        np.max([course.remainder for course in courses], axis=0),
        min(course.until for course in courses),
        last.why,
        count,
    )
