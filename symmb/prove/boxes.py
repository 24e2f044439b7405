"""The enclosure over the whole box. The box is divided if remainders grow, and the bounds of the parts are joined."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial, reduce

import numpy as np

from symmb._magnitudes import ROUNDING, SAME, SLIGHT
from symmb._types import Array, Executor, Mask
from symmb.connect import LostTask, finished
from symmb.prove.clock import with_clock
from symmb.prove.ellipses import Choice, Control
from symmb.prove.errors import ProofError
from symmb.prove.front import half, roughest
from symmb.prove.march import Course, Place, march
from symmb.prove.orders import with_orders
from symmb.prove.outputs import OutputBounds, output_bounds
from symmb.prove.pass_outputs import half_step
from symmb.prove.problem import Problem
from symmb.prove.rounding import LARGEST_ZERO, require_rounding_to_nearest
from symmb.prove.start import constant_step, nominal_front

_EARLY_REMAINDER = 1e-7
"""Parts are halved where their remainder, relative to the width of the states in the whole box, was last smaller than
this. The remainder of a large part does not become smaller later."""
_PATIENCE = 6.0
"""Number of attempts at steps beyond those that pay, until a part is halved."""
_GAIN = 0.02
"""Fraction of the horizon by which the proof of a half must reach beyond that of the part, or it is not halved again.
Many parts do not pass a singular position either."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of the box with its course.

    `share` is its fraction of the whole box. Its proof must reach `least` [s] for further halvings.
    """

    problem: Problem
    course: Course
    share: float = 1.0
    least: float = 0.0

    @cached_property
    def small(self) -> float:
        """Places are checkpoints if their remainder, relative to the width of the states, is smaller than this."""
        begin = self.course.checkpoint
        # a halving does not reduce the earlier remainder, so it must double before the next halving
        return max(_EARLY_REMAINDER / self.share, 0.0 if begin is None else 2.0 * begin.front.share())

    def halves(self, order: int) -> "list[_Part]":
        """Both halves. The box is halved in the variable that reduces the highest orders at the end most.

        The halves continue from a checkpoint after the start. Without such a checkpoint they start again, because the
        start of a half has a smaller remainder. ProofError is raised if the scene cannot start for some parameters.
        """
        end, at = self.course.end, self.course.checkpoint
        variable = roughest(self.problem, nominal_front(self.problem, order) if end is None else end.front.x)
        parts, least = [], self.course.until
        # without a proved start, halves of halves rarely start either; a start with a large remainder is not lost
        least += _GAIN * (float(self.problem.times[-1]) or 1.0) if least or self.course.why else 0.0
        for side in (-1, 1):
            part = self.problem.over(variable, side)
            course = Course.empty(part)
            if at is not None and at.front.t:
                control = replace(at.control, lost=0.0)
                place = Place(half(self.problem, at.front, variable, side), control, at.problem.over(variable, side))
                course = self.course.back_to(place, part.times)
                if course.steps is not None:
                    course.steps = [(half_step(step, variable, side), w) for step, w in course.steps]
            parts.append(_Part(part, course, 0.5 * self.share, least))
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
    problem: Problem,
    order: int,
    boxes: int,
    executor: Executor | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Enclosure:
    """Bounds of the outputs over the box of a problem.

    Parameters
    ----------
    order : highest degree in each parameter
    boxes : largest number of parts of the box
    executor : executor of the parts, as in `finished`; None: the calling thread
    progress : called with the proved fraction of the horizon
    """
    require_rounding_to_nearest()
    if problem.n:
        problem, order = with_orders(problem, order)
        problem = with_clock(problem)
        courses = [part.course for part in _followed(problem, order, boxes, executor, progress)]
    else:
        courses = [_of_expressions(problem, order)]
    last = min(courses, key=lambda course: course.until if course.why else np.inf)
    bounds = reduce(OutputBounds.joined, (course.bounds for course in courses))
    return Enclosure(*bounds, min(course.until for course in courses), last.why, len(courses),
                     tuple(order // weight for weight in problem.weights or (1,) * problem.d))  # fmt: skip


def _followed(
    problem: Problem, order: int, boxes: int, executor: Executor | None, progress: Callable[[float], None]
) -> list[_Part]:
    """The parts of the box at the end, with their courses.

    Steps of a part become short if its remainder is large. If they are more than twice as many as the motion needs,
    the part is halved, because two halves with long steps take less time. A part whose proof is lost is halved too.
    Parts whose proofs reach hardly farther than the proof before the last halving are not halved.
    """
    parts, horizon = [_Part(problem, Course.empty(problem))], float(problem.times[-1]) or 1.0

    def follow(which: list[_Part], patience: float) -> None:
        """Continue some parts to the end, or until they are to be halved, and report the progress."""

        def tell(part: _Part, t: float) -> None:
            progress(sum(own.share * (t if own is part else own.course.until) for own in parts) / horizon)

        run = partial(_continued, order, patience, tell if executor is None else None)
        for k, course in finished(run, list(which), executor):
            if isinstance(course, LostTask):
                course = replace(which[k].course, why=course.reason)
            parts[parts.index(which[k])] = replace(which[k], course=course)
            tell(which[k], course.until)

    follow(parts, _PATIENCE if boxes > 1 else np.inf)
    while room := boxes - len(parts):
        lost = [part for part in parts if not part.course.is_done and problem.d and part.course.until >= part.least]
        halves = list[_Part]()
        # the enclosure ends with the part whose proof ends first
        for part in sorted(lost, key=lambda part: part.course.until)[:room]:
            try:
                own = part.halves(order)
            except ProofError:  # without a start for all parameters, more parts do not help
                continue
            parts.remove(part)
            halves += own
        if not halves:
            break
        parts += halves
        follow(halves, _PATIENCE)
    follow([part for part in parts if not part.course.is_done and not part.course.why], np.inf)
    return parts


def _continued(order: int, patience: float, tell: Callable[[_Part, float], None] | None, part: _Part) -> Course:
    """The course of a part, continued to the end or until the patience is lost."""
    require_rounding_to_nearest()  # a part may be proved in another process
    march(part.problem, order, part.course, part.small, patience, lambda t: tell(part, t) if tell else None)
    return part.course


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
