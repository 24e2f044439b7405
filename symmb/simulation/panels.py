"""Curves over time as polynomials of degree 5 between three times each, from values and rates there."""

from dataclasses import dataclass, fields
from functools import cached_property
from math import comb

import numpy as np

from symmb._types import Array, Indices, Mask

DEGREE = 5
_POINTS, _ZOOMS, _BISECTIONS = 17, 8, 60
_EXACT, _ROUGH = 3e-8, 0.03
"""Misfit of an exact polynomial over the size of its curve, and the share of the error of a cubic one, to the power of
3/2, that this one may have."""


def _basis(x: Array) -> Array:
    """Bernstein polynomials (..., 6) at x (...)."""
    return np.stack([comb(DEGREE, k) * x**k * (1 - x) ** (DEGREE - k) for k in range(DEGREE + 1)], axis=-1)


def _slopes(x: float) -> Array:
    """Rates (6,) of the Bernstein polynomials at x."""
    lower = np.array([comb(DEGREE - 1, k) * x**k * (1 - x) ** (DEGREE - 1 - k) for k in range(DEGREE)])
    return DEGREE * (np.append(0.0, lower) - np.append(lower, 0.0))


_FROM_NODES = np.linalg.inv(
    np.array([row for x in (0.0, 0.5, 1.0) for row in (_basis(np.array(x)), _slopes(x))])
).T
_GRID = np.linspace(0.0, 1.0, _POINTS)
_ON_GRID = _basis(_GRID).T


def values_at(B: Array, x: Array) -> Array:
    """Values (...) of polynomials B (..., 6) at x (...)."""
    return np.einsum("...k,...k->...", _basis(x), B)


def highest(B: Array) -> tuple[Array, Array]:
    """Where polynomials B (n, 6) are largest in [0, 1], and their values there."""
    low, high = np.zeros(len(B)), np.ones(len(B))
    for _ in range(_ZOOMS):
        x = low[:, None] + (high - low)[:, None] * _GRID
        best = values_at(B[:, None, :], x).argmax(axis=1)
        rows = np.arange(len(B))
        low, high = x[rows, np.maximum(best - 1, 0)], x[rows, np.minimum(best + 1, _POINTS - 1)]
    x = (low + high) / 2
    ends = np.stack([np.zeros(len(B)), x, np.ones(len(B))], axis=1)
    values = values_at(B[:, None, :], ends)
    best = values.argmax(axis=1)
    return ends[np.arange(len(B)), best], values[np.arange(len(B)), best]


@dataclass(frozen=True, eq=False)
class Panels:
    """Pieces of curves of samples, in any order.

    Attributes
    ----------
    sample : (n,)              numbers of the samples
    begin, end : (n,)          [s]
    nodes : (n, 3, n_c, 2)     values of n_c curves at the begin, middle and end, and their rates
    """

    sample: Indices
    begin: Array
    end: Array
    nodes: Array

    def __len__(self) -> int:
        return len(self.sample)

    def of(self, some: Mask | Indices) -> "Panels":
        """Some of them."""
        return Panels(*(getattr(self, f.name)[some] for f in fields(self)))

    def sorted_with(self, others: "Panels") -> "Panels":
        """All of them, sample after sample in order of time."""
        both = Panels(*(np.concatenate([getattr(self, f.name), getattr(others, f.name)]) for f in fields(self)))
        return both.of(np.lexsort((both.begin, both.sample)))

    @property
    def width(self) -> Array:
        """(n,) [s]."""
        return self.end - self.begin

    @cached_property
    def _scaled(self) -> Array:
        """The nodes, with rates times the width."""
        nodes = self.nodes.copy()
        nodes[..., 1] *= self.width[:, None, None]
        return nodes

    @cached_property
    def misfit(self) -> Array:
        """(n, n_c) about how far values in the middle are off what the ends tell, as far as it is not smooth."""
        (e0, d0), (em, dm), (e1, d1) = (np.moveaxis(self._scaled[:, k], -1, 0) for k in range(3))
        return np.abs(dm / 2 - 0.75 * (e1 - e0) + (d0 + d1) / 8)

    @cached_property
    def _cubic_misfit(self) -> Array:
        (e0, d0), (em, _), (e1, d1) = (np.moveaxis(self._scaled[:, k], -1, 0) for k in range(3))
        return np.abs(em - (e0 + e1) / 2 - (d0 - d1) / 8)

    def is_exact(self, size: Array) -> Mask:
        """(n, n_c) whether polynomials stand for curves of sizes (n, n_c)."""
        rough = _ROUGH * self._cubic_misfit**1.5
        return np.asarray((self.misfit <= _EXACT * size) & (rough <= _EXACT * size**1.5))

    def bernstein(self, curve: int, exact: Mask) -> Array:
        """Coefficients (n, 6) of a curve; those that are not exact are straight from the begin to the end."""
        B = self._scaled[:, :, curve].reshape(-1, DEGREE + 1) @ _FROM_NODES
        ends = self.nodes[~exact][:, [0, 2], curve, 0]
        B[~exact] = ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * np.linspace(0.0, 1.0, DEGREE + 1)
        return B

    def bends(self) -> Array:
        """(n, n_c) where lines from both ends meet [s]: a kink stands close to it. nan where they do not."""
        (e0, d0), _, (e1, d1) = (np.moveaxis(self._scaled[:, k], -1, 0) for k in range(3))
        with np.errstate(all="ignore"):
            x = (e1 - e0 - d1) / (d0 - d1)
        return np.where((x > 0) & (x < 1), self.begin[:, None] + x * self.width[:, None], np.nan)


def first_passage(B: Array, before: float, tolerance: Array) -> tuple[int, float] | None:
    """Number of the polynomial B (n, 6), one after the other, and the place in [0, 1] where they first become 0 or less,
    from above `tolerance` (n,). A value that reaches up to the tolerance counts.

    `before` is the value before the first one. None if there is no such place.
    """
    previous = np.append(before, B[:-1, -1])
    for k in np.flatnonzero((B.min(axis=1) <= tolerance) | (B[:, 0] <= tolerance)):
        if previous[k] > tolerance[k] >= B[k, 0]:
            return int(k), 0.0
        least = float(highest(-B[[k]])[0][0])
        x = np.unique(np.append(_GRID, least))
        g = _basis(x) @ B[k]
        passed = np.flatnonzero((g[1:] <= tolerance[k]) & (g[:-1] > tolerance[k]))
        if not passed.size:
            continue
        j = int(passed[0]) + 1
        beyond = j if g[j] <= 0 else j + 1 if j + 1 < len(g) and g[j + 1] <= 0 else None
        if beyond is None:
            return int(k), float(x[j])
        low, high = x[beyond - 1], x[beyond]
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            low, high = (middle, high) if values_at(B[k], middle) > 0 else (low, middle)
        return int(k), float(high)
    return None
