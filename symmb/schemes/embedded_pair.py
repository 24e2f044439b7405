"""The pair of Dormand and Prince, order 8: its formulas, and the control of step sizes.

The formulas take NumPy arrays and CasADi expressions alike. Lanes are columns: x (n_x, L), t and h (L,). The C of
`codegen` does the same steps, with the numbers of `STEP_CONTROL`.

References
----------
Hairer, Norsett, Wanner (1993), Solving Ordinary Differential Equations I, sections II.4 to II.6, code DOP853.
"""

from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.schemes.dop853 import A, B, C, D, E

Value = Any
"""A NumPy array or a CasADi expression."""
Rates = Callable[[Value, Value], Value]
"""(x, t) -> x'"""

STEP_CONTROL = SimpleNamespace(
    SAFETY=0.9,  # of the step that the error allows
    EXPONENT=1 / 8,  # of the error, for a method of order 8 whose error estimate is of order 7
    MEMORY=0.04,  # weight of the error before, beta of DOP853: it keeps the step from swinging
    SHRINK_LEAST=0.2,  # least factor of a step that is rejected
    CHANGE_LEAST=0.333,
    CHANGE_MOST=6.0,  # bounds of the factor of a step that is accepted
    ERROR_LEAST=1e-4,  # smaller errors count as this in the memory
    SHORTEST=1e-14,  # of the horizon: shorter steps are lost in rounding
    MOST_MISSED=300.0,  # tolerances: smooth motions miss 5 to 30, up to 250 at rtol 1e-13. tests/benchmarks/lanes.py
)
"""The constants of the step control, those of the code DOP853. tests/codegen/test_fallback.py compares C and NumPy."""
ROUNDED_STEP = 1e-6
"""Share of the time below which the rounding of its end changes the length of a step."""
MOST_STEPS = 1_000_000
"""Steps of a run: more take minutes in C, and hours in Python."""


def stages(rates: Rates, x: Value, slope: Value, t: Value, h: Value) -> tuple[list[Value], Value]:
    """Slopes of the 12 stages, the first of which is given, and x at the end of the step."""
    k = [slope]
    for weights, share in zip(A[1:12], C[1:12], strict=True):
        k.append(rates(x + h * _sum(weights, k), t + share * h))
    return k, x + h * _sum(B, k)


def error_estimates(k: Sequence[Value], h: Value) -> list[Value]:
    """Errors of the step, of orders 3 and 5."""
    return [h * _sum(weights, k) for weights in E]


def interpolant(
    rates: Rates, x: Value, x_new: Value, k: Sequence[Value], t: Value, h: Value
) -> tuple[list[Value], Value]:
    """Seven coefficients for `interpolated`, and by how much the interpolant misses the state of its last stage.

    k are 13 slopes, the last at the end of the step. The errors of a step do not show those of its interpolant. Where
    equations are stiff, its stages may be far off in a step that is accepted.
    """
    k, stage = list(k), x
    for weights, share in zip(A[13:], C[13:], strict=True):
        stage = x + h * _sum(weights, k)
        k.append(rates(stage, t + share * h))
    d = x_new - x
    F = [d, h * k[0] - d, 2 * d - h * (k[12] + k[0]), *(h * _sum(weights, k) for weights in D)]
    return F, stage - interpolated(x, F, C[15])


def interpolated(x: Value, F: Value, theta: Value) -> Value:
    """States at shares theta of a step that begins at x."""
    r = 1 - theta
    return x + theta * (F[0] + r * (F[1] + theta * (F[2] + r * (F[3] + theta * (F[4] + r * (F[5] + theta * F[6]))))))


def interpolated_change(F: Array, theta: Array) -> Array:
    """Slopes over the step at shares theta of it."""
    y, slope = F[6], np.zeros_like(F[6])
    for j in range(5, -1, -1):
        factor, rises = (theta, 1) if j % 2 else (1 - theta, -1)
        y, slope = F[j] + factor * y, factor * slope + rises * y
    return theta * slope + y


def error_norm(x: Array, x_new: Array, errors: Sequence[Array], rtol: float, atol: Array | float) -> Array:
    """The norm of DOP853 (L,): a step is good enough up to 1. NaN where a state or rate is not finite."""
    scale = 1.0 / (atol + rtol * np.maximum(np.abs(x), np.abs(x_new)))
    sum3, sum5 = (np.square(error * scale).sum(axis=0) for error in errors)
    denominator = sum5 + 0.01 * sum3
    return np.where(denominator > 0.0, sum5 / np.sqrt(denominator * len(x)), denominator)


def interpolation_error(x: Array, x_new: Array, missed: Array, rtol: float, atol: Array | float) -> Array:
    """What an interpolant misses (n_x, L) over what it may miss, in each lane (L,): it is good enough up to 1."""
    scale = 1.0 / (atol + rtol * np.maximum(np.abs(x), np.abs(x_new)))
    squares = np.square(missed * scale).sum(axis=0)
    return np.sqrt(squares / max(len(x), 1)) / STEP_CONTROL.MOST_MISSED  # bodies that are all welded have no states


def first_step(
    rates: Rates,
    x: Array,
    slope: Array,
    t: Array,
    span: float | Array,
    rtol: float,
    atol: Array | float,
    width: int = 1,
) -> Array:
    """Lengths of first steps (G,) of groups of `width` lanes, by the algorithm of section II.4."""
    scale = 1.0 / (atol + rtol * np.abs(x))

    def largest(a: Array) -> Array:
        return np.sqrt(np.square(a * scale).sum(axis=0).reshape(-1, width).max(axis=1) / len(x))

    n0, n1 = largest(x), largest(slope)
    h0 = np.where((n0 < 1e-5) | (n1 < 1e-5), 1e-6, 0.01 * n0 / n1)
    h0 = np.where(h0 < span, h0, span)
    wide = np.repeat(h0, width)
    n2 = largest(rates(x + wide * slope, t + wide) - slope) / h0
    most = np.where(n1 > n2, n1, n2)
    h1 = np.where(most <= 1e-15, np.fmax(1e-6, h0 * 1e-3), (0.01 / most) ** (1 / 8))
    h = np.where(100.0 * h0 < h1, 100.0 * h0, h1)
    return np.where(h < span, h, span)


class StepControl:
    """Times and step sizes of G integrations, each with its own.

    Parameters
    ----------
    t : (G,) array           where they are [s]
    h : (G,) array           first steps [s]
    end : (G,) array         where steps end at the latest, which the caller may move [s]
    horizon : float          the length of the whole run [s]
    longest : float          longest step [s], 0 without a limit

    Attributes
    ----------
    live : (g,) indices      those that go on
    shortest : float         steps are not shorter [s]
    most_steps : int         an integration fails with more
    """

    def __init__(self, t: Array, h: Array, end: Array, horizon: float, longest: float = 0.0) -> None:
        self.t, self.h, self.end = t, h, end
        self.live: Indices = np.arange(len(t))
        self.steps, self.most_steps = np.zeros(len(t), dtype=int), MOST_STEPS
        self._longest, self.shortest = longest or np.inf, STEP_CONTROL.SHORTEST * horizon
        self._before = np.full(len(t), STEP_CONTROL.ERROR_LEAST)

    def propose(self) -> tuple[Array, Array]:
        """Where the next steps of `live` end, and how long they are, (g,) each."""
        t, h = self.t[self.live], np.maximum(np.minimum(self.h[self.live], self._longest), self.shortest)
        end = self.end[self.live]
        t_new = np.where(t + h >= end, end, t + h)
        return t_new, np.where((t_new == end) | (h < ROUNDED_STEP * np.abs(t)), t_new - t, h)

    def restart(self, t: Array, h: Array, which: Indices) -> None:
        """Go on from times t with first steps h, both those of the integrations `which`."""
        self.t[which], self.h[which], self._before[which] = t, h, STEP_CONTROL.ERROR_LEAST

    def judge(self, error: Array, h: Array) -> tuple[Mask, Mask, Mask]:
        """Which steps of `live` (g,) are accepted, cannot be shorter, and are one too many. Sets the next sizes."""
        s, live = STEP_CONTROL, self.live
        self.steps[live] += 1
        exhausted = self.steps[live] >= self.most_steps
        accepted = (error <= 1.0) & ~exhausted
        stuck = ~accepted & (h <= self.shortest * 1.0000001)
        grown = s.SAFETY * error ** (-s.EXPONENT + 0.2 * s.MEMORY) * self._before[live] ** s.MEMORY
        factor = np.where(accepted, grown.clip(s.CHANGE_LEAST, s.CHANGE_MOST), self._shrinking(error))
        self.h[live] = h * factor
        self._before[live] = np.where(accepted, np.fmax(error, s.ERROR_LEAST), s.ERROR_LEAST)
        return accepted, stuck, exhausted

    def reject(self, which: Indices, error: Array, h: Array) -> None:
        """Repeat accepted steps of the integrations `which` by shorter ones, for errors and lengths (k,)."""
        self.h[which], self._before[which] = h * self._shrinking(error), STEP_CONTROL.ERROR_LEAST

    @staticmethod
    def _shrinking(error: Array) -> Array:
        s = STEP_CONTROL
        return np.fmax(np.where(error < 1e300, s.SAFETY * error**-s.EXPONENT, 0.1), s.SHRINK_LEAST)


def _sum(weights: Mapping[int, float], k: Sequence[Value]) -> Value:
    (first, weight), *others = weights.items()
    total = weight * k[first]
    for j, weight in others:
        total = total + weight * k[j]
    return total
