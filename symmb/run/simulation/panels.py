"""Curves over time as polynomials of degree 5, which interpolate values and rates at three times."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from math import comb

import numpy as np

from symmb._types import Array, Indices, Mask

_DEGREE = 5
GRID = np.linspace(0.0, 1.0, 17)
"""Times in a panel (0 to 1) at which polynomials are evaluated first."""
_EXACT, _ROUGH = 3e-8, 0.03
"""Largest misfit of an exact polynomial: divided by the size of its curve, and divided by the misfit of a cubic
polynomial to the power of 3/2."""


def _basis(x: Array) -> Array:
    """Bernstein polynomials (..., 6) at x (...)."""
    return np.stack([comb(_DEGREE, k) * x**k * (1 - x) ** (_DEGREE - k) for k in range(_DEGREE + 1)], axis=-1)


def _slopes(x: float) -> Array:
    """Derivatives (6,) of the Bernstein polynomials at x."""
    lower = [comb(_DEGREE - 1, k) * x**k * (1 - x) ** (_DEGREE - 1 - k) for k in range(_DEGREE)]
    return _DEGREE * (np.array([0.0, *lower]) - np.array([*lower, 0.0]))


_FROM_NODES = np.linalg.inv([row for x in (0.0, 0.5, 1.0) for row in (_basis(np.array(x)), _slopes(x))]).T
ON_GRID = _basis(GRID).T


def values_at(B: Array, x: Array) -> Array:
    """Values (...) of polynomials B (..., 6) at x (...)."""
    return np.asarray((_basis(x) * B).sum(axis=-1))


def highest(B: Array) -> tuple[Array, Array]:
    """The points (n,) of the maxima of polynomials B (n, 6) on [0, 1], and the maxima (n,)."""
    low, high, rows = np.zeros(len(B)), np.ones(len(B)), np.arange(len(B))
    # Number of refinements of a maximum, each by a factor of 8.
    for _ in range(8):
        x = low[:, None] + (high - low)[:, None] * GRID
        best = values_at(B[:, None, :], x).argmax(axis=1)
        low, high = x[rows, np.maximum(best - 1, 0)], x[rows, np.minimum(best + 1, len(GRID) - 1)]
    x = (low + high) / 2
    return x, values_at(B, x)


@dataclass(frozen=True, eq=False)
class Panels:
    """Curves of samples in short intervals of time.

    Attributes
    ----------
    sample : (n,)              numbers of the samples
    begin, end : (n,)          first and last time of each panel [s]
    nodes : (n_c, 2, 3, n)     values of n_c curves and their rates, each at the start, middle and end
    """

    sample: Indices
    begin: Array
    end: Array
    nodes: Array

    def of(self, some: Mask | Indices | slice) -> "Panels":
        """The panels with the given numbers, or in the given mask or slice."""
        return Panels(*(getattr(self, f.name)[..., some] for f in fields(self)))

    @classmethod
    def joined(cls, parts: list["Panels"]) -> "Panels":
        """The panels of all parts, sorted by sample, then by time."""
        whole = cls(*(np.concatenate([getattr(part, f.name) for part in parts], axis=-1) for f in fields(cls)))
        return whole if len(parts) == 1 else whole.of(np.lexsort((whole.begin, whole.sample)))

    @property
    def width(self) -> Array:
        """Widths (n,) of the panels [s]."""
        return self.end - self.begin

    @cached_property
    def _ends(self) -> list[Array]:
        """Six arrays (n_c, n): values, and rates times the width, at the three nodes."""
        return [part for k in range(3) for part in (self.nodes[:, 0, k], self.nodes[:, 1, k] * self.width)]

    @cached_property
    def misfit(self) -> Array:
        """Estimated errors (n_c, n): differences between the rate in the middle and the rate predicted by the ends."""
        e0, d0, _, dm, e1, d1 = self._ends
        return np.abs(dm / 2 - 0.75 * (e1 - e0) + (d0 + d1) / 8)

    def is_exact(self, sizes: Array) -> Mask:
        """Mask (n_c, n) of panels in which polynomials are exact. `sizes` (N, n_c) are sizes of the curves."""
        e0, d0, em, _, e1, d1 = self._ends
        size, cubic = sizes.T[:, self.sample], np.abs(em - (e0 + e1) / 2 - (d0 - d1) / 8)
        most = (_EXACT / _ROUGH) ** 2 * size * size * size
        return np.asarray((self.misfit <= _EXACT * size) & (cubic * cubic * cubic <= most))

    def bernstein(self, curve: int, exact: Mask | None = None) -> Array:
        """Bernstein coefficients (n, 6) of a curve. Panels that are not exact become straight lines."""
        B = np.stack([part[curve] for part in self._ends], axis=1) @ _FROM_NODES
        if exact is not None and not exact[curve].all():
            rough = ~exact[curve]
            low, high = self.nodes[curve, 0, 0, rough], self.nodes[curve, 0, 2, rough]
            B[rough] = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, _DEGREE + 1)
        return np.asarray(B, dtype=float)

    def bends(self) -> Array:
        """Times (n_c, n) at which the tangents at both ends intersect [s], near a kink; nan without intersection."""
        e0, d0, _, _, e1, d1 = self._ends
        with np.errstate(all="ignore"):
            x = (e1 - e0 - d1) / (d0 - d1)
        return np.where((x > 0) & (x < 1), self.begin + x * self.width, np.nan)


def panel_nodes(begin: Array, end: Array) -> tuple[Array, Array, Array]:
    """The times of panels at which curves are known."""
    return begin, (begin + end) / 2, end


def distinct(times: Array, distance: float, kept: Sequence[float] = ()) -> Array:
    """Sorted times that are more than a distance apart. The ends and the times `kept` have priority."""
    times = np.unique(times)
    if np.diff(times).min() > distance:
        return times
    priority = np.isin(times, [*kept, times[0], times[-1]])
    chosen = [0]
    for k in range(1, len(times)):
        if times[k] - times[chosen[-1]] > distance or (priority[k] and priority[chosen[-1]]):
            chosen.append(k)
        elif priority[k]:
            chosen[-1] = k
    return times[chosen]


def with_stop(panels: Panels, stops: Sequence[Array]) -> Mask:
    """Mask (n,) of panels that contain a stop of their sample."""
    has = np.zeros(len(panels.sample), dtype=bool)
    for i, own in enumerate(stops):
        if own.size:
            mine = panels.sample == i
            counts = np.searchsorted(np.sort(own), [panels.begin[mine], panels.end[mine]])
            has[mine] = counts[0] < counts[1]
    return has
