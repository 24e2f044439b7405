"""Scalar outputs ("figures") from polynomial curves of many samples."""

from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import NamedTuple, cast

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.run.simulation.panels import GRID, ON_GRID, Panels, highest, values_at

TOUCHED = 1e-9
"""Margin, divided by its largest value in a run. A condition is touched if its margin falls below this value."""
_BISECTIONS, _ROUNDING = 50, 1e-14
_SQUARE = np.array([[comb(5, i) * comb(5, j) / comb(10, i + j) / 11 for j in range(6)] for i in range(6)])
"""The integrals of products of two Bernstein polynomials of degree 5."""


class Rule(NamedTuple):
    """The rule that gives a scalar output from curves. `expression` and `margin` are numbers of curves, or -1."""

    name: str
    kind: str
    expression: int
    margin: int
    is_strict: bool
    window: tuple[float, float]
    per_second: float = 1.0
    level: float | None = None
    over_runs: bool = False

    def over(self, values: Array, runs: int = 1) -> Array:
        """The scalar output (m,) of m groups of n runs, from the values (m, n) of the runs. A study has `runs` runs."""
        if self.over_runs:
            return np.quantile(values, cast(float, self.level), axis=1)
        if self.kind == "probability":
            from scipy.special import ndtr  # this import takes longer than a run

            # Kernel estimate of a distribution. The width of the kernel is a tenth of the standard deviation for 1000
            # runs, so that it increases the variance by 1 %.
            width = values.std(axis=1, keepdims=True) / runs ** (1 / 3)
            return ndtr(-values / np.where(width > 0, width, TOUCHED)).mean(axis=1)
        mean = values.mean(axis=1)
        return np.sqrt(mean) if self.kind == "rms" else mean

    @property
    def sign(self) -> float:
        """The factor of the expression: -1 for minima, so that they become maxima; otherwise 1."""
        return -1.0 if self.kind in ("minimum", "probability") else 1.0

    @property
    def is_event(self) -> bool:
        """Whether the scalar output has a condition, which may never hold."""
        return self.kind in ("first_time", "value_at")

    @property
    def end(self) -> float | None:
        """The last time that `first_time` can give, in its unit; None for other scalar outputs."""
        return self.window[1] * self.per_second if self.kind == "first_time" else None

    def inside(self, panels: Panels) -> Mask:
        """Mask (n,) of panels in the time window of the scalar output."""
        middle = (panels.begin + panels.end) / 2
        return np.asarray((middle > self.window[0]) & (middle < self.window[1]))


@dataclass(frozen=True, eq=False)
class Curves:
    """Curves of samples in ordered panels. `exact` (n_c, n) is a mask of exact panels.

    Panels that are not exact are at most `shortest` [s] long, or have no effect on scalar outputs.
    """

    panels: Panels
    exact: Mask
    sizes: Array
    shortest: float

    def figure(self, rule: Rule) -> Array:
        """The scalar output (N,) of each sample, nan if its condition never holds, or if the sample has no panels."""
        if rule.window not in self._inside:
            own = rule.inside(self.panels)
            inside = Curves(self.panels.of(own), self.exact[:, own], self.sizes, self.shortest)
            self._inside[rule.window] = self if own.all() else inside
        return self._inside[rule.window]._figure(rule)

    @cached_property
    def _inside(self) -> "dict[tuple[float, float], Curves]":
        """The curves in each time window so far."""
        return {}

    def _figure(self, rule: Rule) -> Array:
        panels, e = self.panels, rule.expression
        values = np.full(len(self.sizes), np.nan)
        if not panels.sample.size:
            return values
        samples, first = np.unique(panels.sample, return_index=True)
        if rule.kind == "final":
            values[samples] = panels.nodes[e, 0, 2, np.append(first[1:], len(panels.sample)) - 1]
        elif rule.kind in ("mean", "rms", "psd"):
            B = panels.bernstein(e, self.exact)
            integrals = panels.width * (((B @ _SQUARE) * B).sum(axis=1) if rule.kind == "rms" else B.mean(axis=1))
            duration = np.add.reduceat(panels.width, first)
            values[samples] = np.add.reduceat(integrals, first) / duration
            if rule.kind == "psd":
                others = panels.width * panels.bernstein(rule.margin, self.exact).mean(axis=1)
                values[samples] = values[samples] ** 2 + (np.add.reduceat(others, first) / duration) ** 2
        elif rule.kind == "percentile":
            V = panels.bernstein(e, self.exact) @ ON_GRID
            weights = np.where((GRID == 0) | (GRID == 1), 0.5, 1.0) * panels.width[:, None]
            for sample, begin, end in zip(samples, first, [*first[1:], len(V)], strict=True):
                own, weight = V[begin:end].ravel(), weights[begin:end].ravel()
                order = own.argsort()
                part = weight[order].cumsum() - weight[order] / 2
                values[sample] = np.interp(cast(float, rule.level) * weight.sum(), part, own[order])
        elif rule.kind in ("maximum", "minimum", "probability"):
            B = rule.sign * panels.bernstein(e, self.exact)
            best = np.full(len(values), -np.inf)
            np.maximum.at(best, panels.sample, B[:, [0, -1]].max(axis=1))
            higher = B.max(axis=1) > best[panels.sample] + _ROUNDING * self.sizes[panels.sample, e]
            peaks, sample, off = highest(B[higher])[1], panels.sample[higher], 4 * panels.misfit[e, higher]
            peaks[peaks <= best[sample] + off] = -np.inf  # not above an end value, except for errors
            np.maximum.at(best, sample, peaks)
            values[samples] = rule.sign * best[samples]
        else:
            place, x = self._passages(rule, samples, first)
            k = place[found := place >= 0]
            if rule.kind == "first_time":
                values[samples[found]] = (panels.begin[k] + x[found] * panels.width[k]) * rule.per_second
            else:
                at = values_at(panels.of(k).bernstein(e), x[found])
                values[samples[found]] = np.where(self.exact[e, k], at, panels.nodes[e, 0, 0, k])
        return values

    def _passages(self, rule: Rule, samples: Indices, first: Indices) -> tuple[Indices, Array]:
        """Numbers of the panels in which a condition first holds, or -1, and the times (0 to 1) in these panels.

        A condition first holds when its margin falls from above its tolerance to 0, or to a minimum within the
        tolerance. This includes a gap that an impact closes, but not a gap that is 0 at the start and opens. If a
        margin is 0 from the start on, the condition first holds when the margin falls below 0.
        """
        panels, g = self.panels, rule.margin
        B, ends = panels.bernstein(g, self.exact), panels.nodes[g]
        tolerance = TOUCHED * self.sizes[panels.sample, g]
        short = panels.width <= self.shortest
        tolerance[short] += np.abs(ends[1][:, short]).max(axis=0, initial=0.0) * panels.width[short]
        low, high, found = np.zeros(len(B)), np.zeros(len(B)), np.zeros(len(B), dtype=bool)
        comes_from_above = np.append(False, B[:-1, -1] > tolerance[:-1])
        comes_from_above[first] = False
        found |= comes_from_above & (B[:, 0] <= tolerance)
        known = -1
        for k in np.flatnonzero((B.min(axis=1) <= tolerance) & (B.max(axis=1) > tolerance) & ~found):
            if panels.sample[k] != known:  # later passages have no effect
                found[k], low[k], high[k] = _passage(B[k], tolerance[k])
                known = panels.sample[k] if found[k] else known
        # The margin may be 0 before this. A polynomial with coefficients below 0 may be positive.
        below = np.flatnonzero(B.min(axis=1) < -tolerance)
        found[below] |= (B[below] @ ON_GRID).min(axis=1) < -tolerance[below]
        value, rate = ends[:, 0, first]
        holds = value < -tolerance[first]
        holds |= (value <= tolerance[first]) & ((rate < 0) if rule.is_strict else True)
        found[first] |= holds
        high[first[holds]] = 0.0
        numbers = np.append(np.flatnonzero(found), len(found))
        place = numbers[np.searchsorted(numbers, first)]
        place = np.where((place < len(found)) & (place < np.append(first[1:], len(found))), place, -1)
        a, b, chosen = low[place], high[place], B[place]
        for _ in range(_BISECTIONS):
            middle = (a + b) / 2
            positive = values_at(chosen, middle) > 0
            a, b = np.where(positive, middle, a), np.where(positive, b, middle)
        return place, np.where(low[place] < high[place], b, high[place])


def _passage(B: Array, tolerance: float) -> tuple[bool, float, float]:
    """Whether a polynomial B (6,) falls to a tolerance, and two times (0 to 1) between which it passes 0.

    The two times are equal if the polynomial does not pass 0.
    """
    x, values = GRID, B @ ON_GRID
    if values.min() > tolerance:
        least = highest(-B[None])[0]
        x = np.unique(np.append(x, least))
        values = values_at(B, x)
    passes = np.flatnonzero((values[1:] <= tolerance) & (values[:-1] > tolerance))
    if not passes.size:
        return False, 0.0, 0.0
    j = int(passes[0]) + 1
    beyond = j if values[j] <= 0 else j + 1
    if beyond == len(x) or values[beyond] > 0:
        return True, float(x[j]), float(x[j])
    return True, float(x[beyond - 1]), float(x[beyond])
