"""Bounds of the outputs while the parameters of the box pass a switch one after the other."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from symmb._types import Array, Mask
from symmb.prove import chebyshev as ch
from symmb.prove.curves import TimeStep
from symmb.prove.ellipses import Control
from symmb.prove.front import restricted
from symmb.prove.outputs import output_bounds
from symmb.prove.passes import reach_of
from symmb.prove.rounding import above

_MOST_PARTS, _SHORTEST_PASS = 40, 2e-3
"""Most parts of the box, and the least time within which the parameters of a part pass, over that of the whole box."""

Steps = Sequence[tuple[TimeStep, Array]]
"""Proved steps one after the other, and bounds (n,) of |w| in each."""
Found = list[Array]
"""Lower and upper bounds and remainders (n_t, n_y), and the sizes of terms (n_y,)."""


@dataclass(frozen=True, eq=False)
class Part:
    """A part of the box: both motions over it, and the times (N + 1, ...) at which it passes, with an error."""

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
        """Time within which all of it passes [s]."""
        first, last = self.span
        return last - first

    def has(self, times: Array) -> Mask:
        """Whether passes may be at times (n_t,)."""
        first, last = self.span
        return (times >= first) & (times <= last)

    def halves(self) -> "list[Part]":
        """Both halves in the variable that moves the times most."""
        moved = [ch.sums(np.delete(self.times, 0, axis=j), self.times.ndim) for j in range(self.times.ndim)]
        variable = int(np.argmax(moved))
        found = []
        for side in (-1, 1):
            times, lost = restricted(self.times[None], 1, variable, side)
            old, new = ([(_half(step, variable, side), w) for step, w in steps] for steps in (self.old, self.new))
            found.append(Part(old, new, times[0], float(above(self.error + lost[0]))))
        return found


def _half(step: TimeStep, variable: int, side: int) -> TimeStep:
    """The step over half of the range of a variable, inside of whose ellipses those of the half are."""
    c, lost = restricted(step.x.c, 2, variable, side)
    each = lost.reshape(*lost.shape, *(1,) * step.problem.d)
    rounded = each + (0.0 if step.x.rounded is None else step.x.rounded)
    x = replace(step.x, c=c, error=above(step.x.error + lost.sum(axis=1)), rounded=above(rounded))
    return replace(step, x=x, problem=step.problem.over(variable, side))


def bounds_about_pass(whole: Part, times: Array, control: Control) -> Found:
    """Bounds at times (n_t,): of the old motion before the pass, of the new one behind, and of both between.

    Parts of the box in which the pass may be at one of the times are halved.
    """
    found, is_between = _joined(whole, times, control), whole.has(times)
    if not (is_between.any() and whole.times.ndim):
        return found
    parts, between = [whole], times[is_between]
    while len(parts) < _MOST_PARTS:
        largest = max(parts, key=lambda part: part.length if part.has(between).any() else 0.0)
        if largest.length <= max(_SHORTEST_PASS * whole.length, 4.0 * largest.error):
            break
        parts.remove(largest)
        parts += largest.halves()
    each = [_joined(part, between, control) for part in parts]
    for k, joined in enumerate((np.min, np.max, np.max)):
        found[k][is_between] = joined([bounds[k] for bounds in each], axis=0)
    return found


def _joined(part: Part, times: Array, control: Control) -> Found:
    first, last = part.span
    old = _outputs(part.old, times, times <= last, control)
    new = _outputs(part.new, times, times >= first, control)
    return [joined(a, b) for joined, a, b in zip((np.minimum, *(np.maximum,) * 3), old, new, strict=True)]


def _outputs(steps: Steps, times: Array, wanted: Mask, control: Control) -> Found:
    """Bounds at some of the times, and those of the empty set at others."""
    n_y = steps[0][0].problem.outputs.numel_out(0)
    found = [np.full((len(times), n_y), value) for value in (np.inf, -np.inf, 0.0)] + [np.zeros(n_y)]
    for k, (step, w) in enumerate(steps):
        here = wanted & (times <= step.t0 + step.h) & ((times > step.t0) | (k == 0))
        if here.any():
            *bounds, terms = output_bounds(step, w, times[here], replace(control))
            for own, values in zip(found, bounds, strict=False):
                own[here] = values
            found[-1] = np.maximum(found[-1], terms)
    return found
