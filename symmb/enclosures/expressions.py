"""Bounds of a scene without states: ranges of expressions of parameters and time."""

import numpy as np

from symmb.enclosures.curves import TimeStep
from symmb.enclosures.ellipses import Choice, Control
from symmb.enclosures.flow import integrated
from symmb.enclosures.march import Course
from symmb.enclosures.outputs import output_bounds
from symmb.enclosures.problem import Problem

_SPREADS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""How far parameters move on the ellipses that are tried, over their middles."""
_SHARP = 1e-12
"""Share of the width by which bounds may be off: there are few of them."""


def expression_bounds(problem: Problem, order: int) -> Course:
    """The course of a problem without states. Each time has the best of the bounds found on several ellipses."""
    d, end = problem.d, float(problem.times[-1])
    course = Course.empty(problem)
    terms = (order + 1,) * d
    none = integrated(np.zeros((0, *terms)), np.zeros((0, 1, *terms)), end or 1.0)
    whole = TimeStep(problem, 0.0, end or 1.0, none, none, none.c[None])
    for spread in _SPREADS:
        lower, upper, rest, _ = output_bounds(
            whole, np.zeros(0), problem.times, Control(Choice((spread, spread)), end), _SHARP
        )
        course.lower, course.upper = np.maximum(course.lower, lower), np.minimum(course.upper, upper)
        course.remainder = np.minimum(course.remainder, rest)
    course.until = end
    if not np.isfinite(course.upper).any():
        course.why = "an output cannot be shown to be smooth over the box"
    return course
