"""What an expansion leaves out, estimated from how its last coefficients fall off."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import cast

import numpy as np

from symmb._types import Array, Indices
from symmb.polynomials import MultiIndices

_WINDOW = 0.02
"""Share of the times over which coefficients are averaged: they pass through zero as the response swings."""
_FRONTS = 4
"""Pairs of degrees that tell how coefficients fall off."""
_DECAY, _FAST = 0.6, 0.8
"""Power of the decay seen: 1 trusts that the next coefficients fall off as much, 0 that they do not at all. On tensor
grids it is 1 less the decay over the second, if that is more: what falls off fast goes on like that."""
_NEAR_NODES = 0.4
"""Over the degree, counted as 4 at most: share of the largest error that is expected even at nodes, since extremes are
found only near to where they are."""


@dataclass(frozen=True, eq=False)
class Tails:
    """Expected error of interpolants on a grid, at points of the box, for every time and output.

    In direction i coefficients are taken two degrees together, and those that would come next to fall off by somewhat
    less than they did; on tensor grids than where they did least, as lines of other grids are too different for that.
    On a tensor grid the error vanishes, but for a share, at the nodes, as (1 - x^2) U(x) does. What is not mixed with
    direction i yet is expected to be mixed as strongly as what is.

    Attributes
    ----------
    directions : (d, n_t, n_y)      largest error from each direction
    falls : (d, n_t, n_y)           by how much its coefficients fall off in two degrees, at most 1
    mixed : (n_t, n_y)              error from products that are missing
    degrees : (d,) or None          of a tensor grid; None for other grids, whose errors are the same everywhere
    """

    directions: Array
    falls: Array
    mixed: Array
    degrees: Indices | None

    @classmethod
    def of(cls, alpha: MultiIndices, coefficients: Array) -> "Tails":
        """From multi-indices (N, d), a set with all smaller ones, and Legendre coefficients (N, n_t, n_y)."""
        d = alpha.shape[1]
        degrees = alpha.max(axis=0)
        tensor = len(alpha) == int(np.prod(degrees + 1))

        def sizes(*groups: Indices) -> Array:
            parts = (coefficients[rows] for rows in groups)
            return np.sqrt(smooth(np.stack([np.einsum("iab,iab->ab", part, part) for part in parts])))

        directions, falls = np.zeros((2, d, *coefficients.shape[1:]))
        mixed = np.zeros(coefficients.shape[1:])
        for i, (fronts, absent, products) in enumerate(_groups(tuple(map(tuple, alpha.tolist())), 1 if tensor else 0)):
            each = sizes(*fronts)
            ratios = _ratio(each[:-1], each[1:])
            falls[i] = np.max(ratios, axis=0) if tensor else ratios[0]
            power = np.maximum(1 - falls[i] / _FAST, _DECAY) if tensor else _DECAY
            directions[i] = each[0] * falls[i] ** power
            if absent.size:
                part, whole, left = sizes(*products, absent)
                mixed += np.square(left * _ratio(part, whole))
        return cls(directions, falls, np.sqrt(mixed), degrees if tensor else None)

    def at(self, x: Array) -> Array:
        """Expected error (n_t, n_y) at points x (n_t, n_y, d), or (d,) for all times and outputs."""
        if self.degrees is None:
            return self.least
        shares = (_between_nodes(x[..., i], n) for i, n in enumerate(self.degrees.tolist()))
        return sum((e * share for e, share in zip(self.directions, shares, strict=True)), self.least)

    @cached_property
    def least(self) -> Array:
        """Expected error (n_t, n_y) wherever the extremes are."""
        if self.degrees is None:
            return self.directions.sum(axis=0) + self.mixed
        return np.tensordot(_near_nodes(self.degrees), self.directions, axes=1)


def _between_nodes(x: Array, degree: int) -> Array:
    """|sin(degree a) sin(a)| for x = cos(a), of a degree that is a power of 2: 0 at the nodes, at most 1."""
    cosine, sine = x, np.sqrt(np.maximum(1.0 - x * x, 0.0))
    product = sine
    while degree > 1:
        cosine, product, degree = 2 * cosine * cosine - 1, 2 * product * cosine, degree // 2
    return np.abs(product * sine)


def _near_nodes(degrees: Indices) -> Array:
    return _NEAR_NODES / np.clip(degrees, 1, 4)


def smooth(powers: Array) -> Array:
    """Means over a window of times of powers (..., n_t, n_y)."""
    n_t = powers.shape[-2]
    half = int(_WINDOW * n_t / 2)
    if not half:
        return powers
    ends = [(0, 0)] * (powers.ndim - 2) + [(half + 1, half), (0, 0)]
    sums = np.cumsum(np.pad(powers, ends, mode="edge"), axis=-2)
    means = (sums[..., 2 * half + 1 :, :] - sums[..., : -2 * half - 1, :]) / (2 * half + 1)
    return np.maximum(means, 0.0)


def _ratio(a: Array, b: Array) -> Array:
    """a / b, at most 1."""
    return np.divide(a, b, out=np.ones_like(a), where=a < b)


_Groups = list[tuple[list[Indices], Indices, tuple[Indices, Indices]]]


@lru_cache(maxsize=32)
def _groups(indices: tuple[tuple[int, ...], ...], least: int) -> _Groups:
    """`_fronts` and `_products` of each direction."""
    alpha = np.array(indices)
    return [(*_fronts(alpha, i, least), _products(alpha, i)) for i in range(alpha.shape[1])]


def _fronts(alpha: MultiIndices, i: int, least: int) -> tuple[list[Indices], Indices]:
    """Rows of the two highest degrees in direction i, of the two below, and so on; and of what is not mixed with it.

    Degrees below the least are left out.
    """
    _, line = np.unique(np.delete(alpha, i, axis=1), axis=0, return_inverse=True)
    line = line.ravel()
    top = np.zeros(int(line.max()) + 1, dtype=np.intp)
    np.maximum.at(top, line, alpha[:, i])
    wide = np.where(top[line] > 2, 2, 1)  # of degree 2 there is but one coefficient above the slope
    front = (top[line] - alpha[:, i]) // wide
    rows = (np.flatnonzero((top[line] > 0) & (alpha[:, i] >= least) & (front == k)) for k in range(_FRONTS))
    return [some for some in rows if some.size], np.flatnonzero((top[line] == 0) & (alpha.sum(axis=1) > 0))


def _products(alpha: MultiIndices, i: int) -> tuple[Indices, Indices]:
    """Rows of products of x_i with others, and of these without it; of x_i and all x_j if there are none."""
    rows = {cast(tuple[int, ...], tuple(a)): k for k, a in enumerate(alpha.tolist())}
    first, base = [], []
    for a, k in rows.items():
        if a[i] == 1 and sum(a) > 1:
            first.append(k)
            base.append(rows[(*a[:i], 0, *a[i + 1 :])])
    if not first:
        base = np.flatnonzero(alpha.sum(axis=1) == 1).tolist()
        first = [k for k in base if alpha[k, i]]
    return np.array(first, dtype=np.intp), np.array(base, dtype=np.intp)
