"""The estimated error of an interpolant: the truncation error (from its last coefficients), and the error at events."""

import itertools
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache, reduce
from typing import NamedTuple, cast

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.bound.nodes import group_squares, line
from symmb.bound.polynomials import Expansion, MultiIndices
from symmb.bound.responses import average_over_window

SHELLS = 4
"""Number of degree shells, of two degrees each, from which the decay is measured. With fewer shells, a pair that is
small by chance has a larger effect. More shells take more time."""
DECAY_POWER, FAST_DECAY = 0.6, 0.8
"""Power of the measured decay that is assumed to continue: 1 assumes the same decay, 0 assumes no decay and takes more
runs. On tensor grids the power is 1 - decay / FAST_DECAY if this is larger, because a fast decay usually continues."""
NODE_SHARE = 0.4
"""Ratio of the expected error at nodes to the largest error, divided by the degree (at most 4). It is not 0, because
the places of extremes are only approximate. Smaller ratios miss more errors. Larger ratios take more runs."""
SMOOTH_DECAY = 0.6
"""Ratio of coefficients over two degrees above which a response is not smooth. Smaller ratios divide the box
earlier."""


@dataclass(frozen=True, eq=False)
class TruncationError:
    """Expected error of interpolants on a grid, at points of the box, for every time and output.

    In direction i the coefficients are grouped in degree shells of two degrees each, with sizes s_0 (the highest), s_1,
    ... The next shell is expected to have the size

        e_i = s_0 r^p,      r = s_0 / s_1 (sparse grids) or the largest of s_k / s_(k+1) (tensor grids),

    where p < 1 allows for a slower decay than before. On sparse grids, lines differ too much to use the largest ratio.

    On a tensor grid, only a fraction NODE_SHARE of the error remains at the nodes, where (1 - x^2) U(x) = 0. Products
    with direction i may be missing in the grid. Relative to their factors, missing products are expected to be as large
    as products in the grid. Their size is `mixed`.

    Attributes
    ----------
    directions : (d, n_t, n_y)      largest error from each direction, e_i
    slow : (d, n_t, n_y)            whether r of each direction exceeds SMOOTH_DECAY
    mixed : (n_t, n_y)              error from products that are missing
    degrees : (d,) or None          of a tensor grid; None for other grids, whose errors are the same everywhere
    """

    directions: Array
    slow: Mask
    mixed: Array
    degrees: Indices | None

    @classmethod
    def of(cls, alpha: MultiIndices, coefficients: Array, noise: Array | float = 0.0) -> "TruncationError":
        """The error for multi-indices (N, d) of a downward closed set, and Legendre coefficients (N, n_t, n_y).

        Parts of coefficients that can come from `noise` (n_y,) of runs are ignored.
        """
        degrees = alpha.max(axis=0)
        tensor = len(alpha) == int(np.prod(degrees + 1))
        directions = np.zeros((alpha.shape[1], *coefficients.shape[1:]))
        slow = np.zeros(directions.shape, dtype=bool)
        mixed = np.zeros(coefficients.shape[1:])
        groups = _groups(tuple(map(tuple, alpha.tolist())), 1 if tensor else 0)
        each_rows = [each.rows for each in groups]
        parts = [list(itertools.chain(*each_rows))] if tensor else each_rows  # one direction at a time, to save memory
        sizes = itertools.chain.from_iterable(_sizes(coefficients, noise, rows) for rows in parts)
        for i, each in enumerate(groups):
            shells = list(itertools.islice(sizes, len(each.shells)))
            ratios = [_ratio(a, b) for a, b in itertools.pairwise(shells)]
            decay = reduce(np.maximum, ratios) if tensor else ratios[0]
            power = np.maximum(1 - decay / FAST_DECAY, DECAY_POWER) if tensor else DECAY_POWER
            directions[i], slow[i] = shells[0] * decay**power, decay > SMOOTH_DECAY
            if each.unmixed.size:
                product, factor, unmixed = itertools.islice(sizes, 3)
                mixed += np.square(unmixed * _ratio(product, factor))
        return cls(directions, slow, np.sqrt(mixed), degrees if tensor else None)

    def at(self, x: Array) -> Array:
        """Expected errors (..., n_t, n_y) at points x (..., n_t, n_y, d), or at points (..., 1, 1, d) for all times."""
        if self.degrees is None:
            return self.least
        factors = (_node_polynomial(x[..., i], n) for i, n in enumerate(self.degrees.tolist()))
        return sum((e * factor for e, factor in zip(self.directions, factors, strict=True)), self.least)

    @cached_property
    def least(self) -> Array:
        """Expected error (n_t, n_y) for extremes at unknown places."""
        if self.degrees is None:
            return self.directions.sum(axis=0) + self.mixed
        return np.tensordot(NODE_SHARE / np.clip(self.degrees, 1, 4), self.directions, axes=1)


def _node_polynomial(x: Array, degree: int) -> Array:
    """The node polynomial |(x - x_0) ... (x - x_n)| of a degree, scaled to a maximum of 1. It is 0 at the nodes."""
    product, twice = np.full(x.shape, 1 / _largest_product(degree)), 2 * x
    difference = np.empty_like(product)
    for node in line(degree + 1).tolist():
        product *= np.subtract(twice, 2 * node, out=difference)  # the product of n differences is about 2^-n
    return np.abs(product, out=product)


@cache
def _largest_product(degree: int) -> float:
    x = np.cos(np.linspace(0, np.pi, 64 * degree + 1))
    return float(np.abs(2 * (x[:, None] - line(degree + 1))).prod(axis=1).max())


def _ratio(a: Array, b: Array) -> Array:
    """The ratio a / b, limited to 1."""
    return np.divide(a, b, out=np.ones_like(a), where=a < b)


def _sizes(coefficients: Array, noise: Array | float, groups: list[Indices]) -> Array:
    """Square root of the sum of squares over each group of rows, averaged over a window of times, (k, n_t, n_y).

    The expected squares of noise (n_y,) are subtracted.
    """
    sizes = group_squares(coefficients, groups)
    sizes -= np.square(noise) * np.array([len(rows) for rows in groups])[:, None, None]
    np.maximum(average_over_window(sizes), 0.0, out=sizes)
    return np.sqrt(sizes, out=sizes)


class _Groups(NamedTuple):
    """Rows of the coefficients of one direction.

    Attributes
    ----------
    shells : rows of the two highest degrees in this direction, of the two degrees below, and so on
    unmixed : rows that have no product with this direction
    products : rows of products of x_i with other factors, and rows of these factors
    """

    shells: list[Indices]
    unmixed: Indices
    products: tuple[Indices, Indices]

    @property
    def rows(self) -> list[Indices]:
        """The groups of rows whose sums of squares are used. Without unmixed rows, these are only the shells."""
        return [*self.shells, *self.products, self.unmixed] if self.unmixed.size else self.shells


@lru_cache(maxsize=32)
def _groups(indices: tuple[tuple[int, ...], ...], least: int) -> list[_Groups]:
    """The groups of each direction. Shells contain no degrees below `least`."""
    alpha = np.array(indices)
    return [_Groups(*_degree_shells(alpha, i, least), _products(alpha, i)) for i in range(alpha.shape[1])]


def _degree_shells(alpha: MultiIndices, i: int, least: int) -> tuple[list[Indices], Indices]:
    _, line = np.unique(np.delete(alpha, i, axis=1), axis=0, return_inverse=True)
    line = line.ravel()
    top = np.zeros(int(line.max()) + 1, dtype=np.intp)
    np.maximum.at(top, line, alpha[:, i])
    thickness = np.where(top[line] > 2, 2, 1)  # with degree 2, only one coefficient is above the linear term
    shell = (top[line] - alpha[:, i]) // thickness
    rows = (np.flatnonzero((top[line] > 0) & (alpha[:, i] >= least) & (shell == k)) for k in range(SHELLS))
    return [some for some in rows if some.size], np.flatnonzero((top[line] == 0) & (alpha.sum(axis=1) > 0))


def _products(alpha: MultiIndices, i: int) -> tuple[Indices, Indices]:
    """Rows of products of x_i with other factors, and rows of these factors. Without products, rows of x_i and of all
    x_j."""
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


def decay_ratios(expansion: Expansion, widths: Array, least: int) -> Array:
    """Ratios (d,) of the coefficients of each direction over two degrees; 0 for directions with too low a degree.

    Let S_k be the norm of all coefficients of degrees k - 1 and k, relative to the widths (n_y,), and n the highest
    degree. The ratio is the larger of S_(n-2) / S_(n-4) and S_(n-4) / S_(n-6). The two highest degrees are left out:
    their coefficients are only half as large if the interpolant does not resolve the response.
    """
    decay = np.zeros(expansion.alpha.shape[1])
    for i, degrees in enumerate(expansion.alpha.T):
        top = degrees.max()
        if top >= least:
            shells = ((degrees > k - 2) & (degrees <= k) for k in (top - 2, top - 4, top - 6))
            a, b, c = (np.linalg.norm(expansion.coefficients[rows] / widths) for rows in shells)
            decay[i] = max(a / b if b > 0 else 0.0, b / c if c > 0 else 0.0)
    return decay


def event_errors(nodes: Array, degrees: Indices, Y: Array, events: Indices) -> Array:
    """Expected errors along each parameter (d, n_t, n_y) if events happen between nodes; nan elsewhere.

    Responses have kinks and jumps at events. Let s be the largest slope away from events. Between two nodes, an extreme
    exceeds the values at nodes by at most s times the distance of the nodes.

    Parameters
    ----------
    nodes : (N, d)              of a tensor grid with these degrees (d,)
    Y : (N, n_t, n_y)           responses at the nodes
    events : (N, n_t)           number of events up to each time; -1 if not known
    """
    # Grids list nodes by degree. Differences along an axis need the order of coordinates.
    order, axes = np.lexsort(nodes.T[::-1]), tuple(range(len(degrees)))
    shape = tuple(degrees + 1)
    Y_grid = Y[order].reshape(*shape, *Y.shape[1:])
    events_grid = events[order].reshape(*shape, -1, 1)
    is_between = np.ptp(events_grid, axis=axes) > 0
    errors = np.zeros((len(degrees), *Y.shape[1:]))
    for i, x in enumerate(nodes[order].T.reshape(len(degrees), *shape)):
        distance = np.diff(x, axis=i)[..., None, None]
        change, has_event = np.abs(np.diff(Y_grid, axis=i)), np.diff(events_grid, axis=i) != 0
        slope = np.where(has_event, 0.0, change / distance).max(axis=axes)
        widest = np.where(has_event, distance, 0.0).max(axis=axes)
        errors[i] = np.where(has_event.all(axis=axes), change.max(axis=axes), slope * widest)
    return np.where(is_between, errors, np.nan)
