"""Bounds of the outputs during the time window in which motions pass a switch, for all parameters of the box."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np

from symmb._types import Array, Mask
from symmb.prove.ellipses import Control
from symmb.prove.outputs import OutputBounds, output_bounds
from symmb.prove.passes import reach_of
from symmb.prove.rounding import above
from symmb.prove.terms import restricted, sums_of_orders
from symmb.prove.time_step import TimeStep

Steps = Sequence[tuple[TimeStep, Array]]
"""Consecutive proved steps, and bounds (n,) of |w| in each step."""


@dataclass(frozen=True, eq=False)
class Part:
    """A part of the box, with the motions before and after the pass.

    `times` are the coefficients (N + 1, ...) of the time of the pass, with an error [s].
    """

    old: Steps
    new: Steps
    times: Array
    error: float

    @cached_property
    def span(self) -> tuple[float, float]:
        """Bounds of the times of passes [s]."""
        middle, reach = float(self.times.flat[0]), reach_of(self.old[0][0].problem, self.times) + self.error
        return middle - reach, middle + reach

    @property
    def length(self) -> float:
        """Time between the first and the last pass of all parameters of the part [s]."""
        first, last = self.span
        return last - first

    def has(self, times: Array) -> Mask:
        """Mask (n_t,) of the times (n_t,) at which passes are possible."""
        first, last = self.span
        return (times >= first) & (times <= last)

    def halves(self) -> "list[Part]":
        """Both halves in the variable with the largest effect on the times."""
        problem = self.old[0][0].problem
        variable = int(np.argmax([own[1:].sum() for own in sums_of_orders(problem, self.times[None])]))
        found = []
        for side in (-1, 1):
            times, lost = restricted(problem, self.times[None], 1, variable, side)
            old, new = ([(half_step(step, variable, side), w) for step, w in steps] for steps in (self.old, self.new))
            found.append(Part(old, new, times[0], float(above(self.error + lost[0]))))
        return found


def half_step(step: TimeStep, variable: int, side: int) -> TimeStep:
    """The step over half of the range of a variable. The ellipses of the half are inside those of the whole range."""
    c, lost = restricted(step.problem, step.x.c, 2, variable, side)
    each = lost.reshape(*lost.shape, *(1,) * step.problem.axes)
    rounded = each + (0.0 if step.x.rounded is None else step.x.rounded)
    x = replace(step.x, c=c, error=above(step.x.error + lost.sum(axis=1)), rounded=above(rounded))
    return replace(step, x=x, problem=step.problem.over(variable, side))


def bounds_about_pass(whole: Part, times: Array, control: Control) -> OutputBounds:
    """Bounds at times (n_t,): of the old motion before the pass, of the new motion after it, and of both during it.

    Parts of the box that may pass at one of the times are halved, until there are 40 parts, or each part passes within
    0.2 % of the time of the whole pass. Each part joins only the bounds of its possible motions.
    """
    found, is_between = _joined(whole, times, control), whole.has(times)
    if not (is_between.any() and whole.times.ndim):
        return found
    parts, between = [whole], times[is_between]
    while len(parts) < 40:
        largest = max(parts, key=lambda part: part.length if part.has(between).any() else 0.0)
        if largest.length <= max(2e-3 * whole.length, 4.0 * largest.error):
            break
        parts.remove(largest)
        parts += largest.halves()
    found.put(is_between, reduce(OutputBounds.joined, (_joined(part, between, control) for part in parts)))
    return found


def _joined(part: Part, times: Array, control: Control) -> OutputBounds:
    """Bounds of a part of the box at times (n_t,). They contain all motions that are possible at each time."""
    first, last = part.span
    old = _outputs(part.old, times, times <= last, control)
    return old.joined(_outputs(part.new, times, times >= first, control))


def _outputs(steps: Steps, times: Array, wanted: Mask, control: Control) -> OutputBounds:
    """Bounds at the wanted times. At other times the bounds are empty."""
    bounds = OutputBounds.nothing(len(times), steps[0][0].problem.outputs.numel_out(0))
    for k, (step, w) in enumerate(steps):
        here = wanted & (times <= step.t0 + step.h) & ((times > step.t0) | (k == 0))
        if here.any():
            bounds.put(here, output_bounds(step, w, times[here], replace(control)))
    return bounds
