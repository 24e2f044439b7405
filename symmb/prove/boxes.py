"""The enclosure over the whole box. The box is divided if remainders grow, and the bounds of the parts are joined."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np

from symmb._magnitudes import ROUNDING, SAME, SLIGHT, SMALL
from symmb._types import Array, Mask
from symmb.prove.ellipses import Choice, Control
from symmb.prove.errors import ProofError
from symmb.prove.front import half, slowest
from symmb.prove.march import Course, Place, march
from symmb.prove.orders import with_orders
from symmb.prove.outputs import OutputBounds, output_bounds
from symmb.prove.problem import Problem
from symmb.prove.rounding import LARGEST_ZERO
from symmb.prove.start import constant_step, nominal_front

_EARLY_REMAINDER = 1e-7
"""Parts are halved early if their remainder, relative to the width of the states in the whole box, is larger than this.

Early halving makes up to half of the allowed parts. The remainder of a large part does not become smaller later, and
steps of large parts take many times longer. Example: the double pendulum (5 %, order 8), with all parts made early, was
proved for 5 s with 1e-5, for 9 s with 1e-7, and for 3 s with 1e-8.
"""


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of the box with its course. `share` is its fraction of the whole box."""

    problem: Problem
    course: Course
    share: float = 1.0

    @cached_property
    def small(self) -> float:
        """Places are checkpoints if their remainder, relative to the width of the states, is smaller than this."""
        begin = self.course.checkpoint
        # a halving does not reduce the earlier remainder, so it must double before the next halving
        return max(_EARLY_REMAINDER / self.share, 0.0 if begin is None else 2.0 * begin.front.share())

    def halves(self, order: int) -> "list[_Part]":
        """Both halves. The box is halved in the variable whose coefficients decay most slowly at the end.

        The halves continue from a checkpoint after the start. Without such a checkpoint they start again, because the
        start of a half has a smaller remainder. ProofError is raised if the scene cannot start for some parameters.
        """
        end, at = self.course.end, self.course.checkpoint
        variable = slowest(self.problem, nominal_front(self.problem, order) if end is None else end.front.x)
        parts = []
        for side in (-1, 1):
            part = self.problem.over(variable, side)
            course = Course.empty(part)
            if at is not None and at.front.t:
                place = Place(half(self.problem, at.front, variable, side), at.control, at.problem.over(variable, side))
                course = self.course.back_to(place, part.times)
            parts.append(_Part(part, course, 0.5 * self.share))
        return parts


@dataclass(frozen=True)
class Enclosure:
    """Proved bounds over the whole box.

    Attributes
    ----------
    lower, upper : (n_t, n_y) bounds, infinite if they are not known
    remainder : (n_t, n_y) largest part of the bounds that is not the range of a polynomial
    terms : (n_y,) largest sizes of the terms of the outputs
    until : time after the first one up to which the motion is proved [s]
    why : reason for the end of the proof; empty if it reached the last time
    boxes : number of parts of the box at the end
    orders : (d,) highest order of each parameter in the motions
    """

    lower: Array
    upper: Array
    remainder: Array
    terms: Array
    until: float
    why: str
    boxes: int
    orders: tuple[int, ...] = ()

    @property
    def is_loose(self) -> Mask:
        """Whether the remainder is more than half of the width of the bounds (n_t, n_y).

        Remainders that are small relative to the output are ignored. Remainders below a tenth of the largest effect of
        the parameters are ignored too, because parameters have no effect at the start. If terms of the output cancel,
        remainders are compared with these terms.
        """
        finite = np.isfinite(self.upper)
        width, remainder = np.where(finite, self.upper - self.lower, np.inf), np.where(finite, self.remainder, 0.0)
        moved = np.where(finite, width - 2.0 * remainder, 0.0).max(axis=0)
        size = np.where(finite, np.maximum(np.abs(self.lower), np.abs(self.upper)), 0.0)
        visible = np.maximum(SLIGHT * np.maximum.accumulate(size, axis=0), 0.1 * moved)
        visible = np.maximum(visible, SAME * self.terms + LARGEST_ZERO)
        return np.asarray(finite & (remainder > 0.25 * width) & (2.0 * remainder > visible))


@np.errstate(all="ignore")  # bounds that are not finite are treated later
def enclose(
    problem: Problem, order: int, boxes: int, progress: Callable[[float], None] = lambda share: None
) -> Enclosure:
    """Bounds of the outputs over the box of a problem.

    Parameters
    ----------
    order : highest degree in each parameter
    boxes : largest number of parts of the box
    progress : called with the proved fraction of the horizon
    """
    if problem.n:
        problem, order = with_orders(problem, order)
        courses = [part.course for part in _followed(problem, order, boxes, progress)]
    else:
        courses = [_of_expressions(problem, order)]
    last = min(courses, key=lambda course: course.until if course.why else np.inf)
    bounds = reduce(OutputBounds.joined, (course.bounds for course in courses))
    return Enclosure(*bounds, min(course.until for course in courses), last.why, len(courses),
                     tuple(order // weight for weight in problem.weights or (1,) * problem.d))  # fmt: skip


def _followed(problem: Problem, order: int, boxes: int, progress: Callable[[float], None]) -> list[_Part]:
    """The parts of the box at the end, with their courses."""
    horizon = float(problem.times[-1]) or 1.0
    parts = [_Part(problem, Course.empty(problem))]

    def follow(part: _Part, largest: float) -> None:
        """Continue a part to the end, or until its remainder is too large, and report the progress."""
        done = sum(other.share * other.course.until for other in parts if other is not part)
        march(part.problem, order, part.course, part.small, max(part.small, largest),
              lambda t: progress((done + part.share * t) / horizon))  # fmt: skip

    # A remainder above a small fraction of the width soon ends the proof, because its square makes it grow. After half
    # of the allowed parts is used, the parts whose proofs end first are halved, at their last small remainder.
    for most, largest in ((boxes // 2, 0.0), (boxes, SMALL), (boxes, np.inf)):
        for part in parts:
            if not part.course.why:
                follow(part, largest)
        while len(parts) < most and (lost := [part for part in parts if part.problem.d and not part.course.is_done]):
            first = min(lost, key=lambda part: part.course.until)  # the enclosure ends with this part
            try:
                halves = first.halves(order)
            except ProofError:  # without a start for all parameters, more parts do not help
                break
            parts.remove(first)
            for part in halves:
                parts.append(part)
                follow(part, largest)
    return parts


def _of_expressions(problem: Problem, order: int) -> Course:
    """The course of a problem without states. At each time, it has the best bounds from several ellipses."""
    end, course = float(problem.times[-1]), Course.empty(problem)
    whole = constant_step(problem, 0.0, np.zeros((0, *(order + 1,) * problem.d)), end or 1.0)
    # motion of the parameters on the ellipses, relative to their middles
    for spread in (0.3, 1.0, 3.0, 10.0, 30.0, 100.0):
        control = Control(Choice((spread, spread)), end)
        # without states there are few bounds, so their ranges may be sharp to rounding
        lower, upper, rest, _ = output_bounds(whole, np.zeros(0), problem.times, control, ROUNDING)
        best = course.bounds
        course.bounds = best._replace(lower=np.maximum(best.lower, lower), upper=np.minimum(best.upper, upper),
                                      remainder=np.minimum(best.remainder, rest))  # fmt: skip
    course.until = end
    if not np.isfinite(course.bounds.upper).any():
        course.why = "no output can be shown to be smooth over the box"
    return course
