"""Hierarchical interpolants on nested nodes: surpluses of a downward closed set of indices, and those ahead of it.

The Newton polynomial h_k of a parameter is 0 at its first k nodes and 1 at the next one. With h_a(x) = h_a1(x_1) ...
the interpolant is s(x) = sum w_a h_a(x). The surplus w_a is the error of the interpolant of all smaller indices at node
a, and does not change when others are added.

References
----------
Gerstner and Griebel, Computing 71 (2003), dimension-adaptive tensor-product quadrature.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.linalg import solve_triangular

from symmb._types import Array
from symmb.bounds.adaptive import relative_errors
from symmb.bounds.refinement.constants import DECAY_POWER, LEAST_DECAY, MIXED_SHARE, PRIOR_WEIGHT, SPAN
from symmb.nodes import Grid, Index, below, line
from symmb.polynomials import MultiIndices


class Hierarchy:
    """An interpolant that grows in the unit box.

    Attributes
    ----------
    grid : the set of indices, and its nodes
    surpluses : (N, n_t, n_y)
    predicted : the size that was predicted of each surplus when its node was run, without the factor of its kind
    """

    def __init__(self, d: int, shape: tuple[int, int]) -> None:
        self.d, self.grid = d, Grid(d)
        self.surpluses = np.empty((0, *shape))
        self.predicted: dict[Index, float] = {}
        self._sizes = np.empty((0, shape[1]))
        self._unscaled: dict[Index, float] = {}

    def add(self, nodes: list[Index], Y: Array) -> None:
        """More indices, in the order of their degree, and the responses (k, n_t, n_y) at their nodes."""
        before = self.grid.alpha
        self.grid.add(set(nodes))
        alpha = self.grid.alpha[len(before) :]
        self.predicted |= {index: self._unscaled[index] for index in nodes if index in self._unscaled}
        points = line(int(alpha.max(initial=0)) + 1)[alpha]
        rest = Y - np.tensordot(newton_values(before, points), self.surpluses, axes=1)
        triangle = newton_values(alpha, points)
        new = solve_triangular(triangle, rest.reshape(len(Y), -1), lower=True, unit_diagonal=True).reshape(Y.shape)
        self.surpluses = np.concatenate([self.surpluses, new])
        self._sizes = np.concatenate([self._sizes, relative_errors(new, np.ones(Y.shape[2]))])

    def values(self, points: Array) -> Array:
        """Responses (n, n_t, n_y) at points (n, d)."""
        return np.tensordot(newton_values(self.grid.alpha, points), self.surpluses, axes=1)

    def sizes(self, widths: Array, noise: Array, of_all: bool = False) -> dict[Index, float]:
        """Sizes of surpluses over the widths (n_y,), of the output where this is largest; noise does not count.

        Those of all outputs are root mean squares.
        """
        squares = np.maximum(np.square(self._sizes) - np.square(2 * noise), 0.0) / np.square(widths)
        squares = squares[:, np.isfinite(widths)]
        squares = squares.mean(axis=1) if of_all and squares.size else squares.max(axis=1, initial=0.0)
        return dict(zip(self.grid.row, np.sqrt(squares).tolist(), strict=True))

    def profiles(self, sizes: dict[Index, float], share: float = MIXED_SHARE) -> list[list[float]]:
        """Sizes along each axis by level: a level is two degrees, one of which may vanish by symmetry.

        They are at least a share of the largest ones of products of this degree: the axis may miss what is beside it.
        """
        alpha, size = self.grid.alpha, np.array(list(sizes.values()))
        profiles = []
        for i in range(self.d):
            largest = np.zeros(int(alpha[:, i].max()) + 1)
            is_axis = alpha[:, i] == alpha.sum(axis=1)
            np.maximum.at(largest, alpha[:, i], np.where(is_axis, size, share * size))
            along = largest.tolist()
            profile = [1.0, *(max(along[k : k + 2]) for k in range(1, len(along), 2))]
            if len(along) == 3:  # only a slope and a bend are known: the next level is that of the bend and its decay
                profile.append(along[2] * slowness([1.0, *along[1:]]) ** DECAY_POWER)
            profiles.append(profile)
        return profiles

    def ahead(self, sizes: dict[Index, float], least: int) -> dict[Index, float]:
        """Predicted sizes of indices ahead of the set, at least so many, and those ahead of these if they are fewer.

        Along an axis the decay goes on. A product of parameters is expected to be as large as its factors together,
        relative to the width, and no larger than its neighbours let expect. How far such predictions were off in this
        study, for each number of parameters and degree, is a factor on them.
        """
        profiles, off, known = self.profiles(sizes), self._ratios(sizes), dict(sizes)
        grid, found = Grid(self.d), dict[Index, float]()
        grid.add(set(self.grid.row))
        while len(found) < least or not found:
            layer = grid.ahead()
            self._unscaled |= (raw := {index: self._predicted(index, known, profiles) for index in layer})
            new = {index: off(index) * size for index, size in raw.items()}
            grid.add(layer)
            known |= new
            found |= new
        return found

    def _predicted(self, index: Index, known: dict[Index, float], profiles: list[list[float]]) -> float:
        involved = [i for i, k in enumerate(index) if k]
        candidates = []
        for i in involved:
            smaller = (*index[:i], index[i] - 1, *index[i + 1 :])
            level, before = (index[i] + 1) // 2, index[i] // 2
            if len(involved) == 1 and before == 0:
                return 1.0
            factor = 1.0 if level == before else _at(profiles[i], level) / max(_at(profiles[i], before), 1e-300)
            candidates.append(_of_level(smaller, known) * factor)
        return min(candidates)

    def _ratios(self, sizes: dict[Index, float]) -> Callable[[Index], float]:
        """Factors on predictions: root mean square ratios of surpluses over those predicted, by kind of index."""
        observed: dict[tuple[int, int], list[float]] = {}
        for index, predicted in self.predicted.items():
            if predicted > 0:
                observed.setdefault(_kind(index), []).append((sizes[index] / predicted) ** 2)

        @cache
        def factor(kind: tuple[int, int]) -> float:
            squares = observed.get(kind)
            if kind[0] == 1:
                return 1.0
            if not squares:
                return factor((kind[0] - 1, kind[1] - 1))
            return float(np.sqrt((PRIOR_WEIGHT + sum(squares)) / (PRIOR_WEIGHT + len(squares))))

        return lambda index: factor(_kind(index))


def _kind(index: Index) -> tuple[int, int]:
    """The number of parameters, and the degree."""
    return sum(k > 0 for k in index), sum(index)


def _at(profile: list[float], level: int) -> float:
    """The size at a level, by the decay of those before where it is not known."""
    if level < len(profile):
        return profile[level]
    decay = slowness(profile) ** DECAY_POWER if len(profile) > 2 else 1.0
    return profile[-1] * decay ** (level - len(profile) + 1)


def slowness(profile: list[float]) -> float:
    """Mean decay from level to level of the last ones: nodes within a halving of angles are of unequal worth."""
    span = min(SPAN, len(profile) - 2)
    size, before = profile[-1], profile[-1 - span]
    return min(max(size / before, LEAST_DECAY**span), 1.0) ** (1 / span) if before > 0 else LEAST_DECAY


def _of_level(index: Index, known: dict[Index, float]) -> float:
    """The largest size of known indices of the same levels that are not larger."""
    sizes, pending = [], [index]
    while pending:
        one = pending.pop()
        sizes.append(known[one])
        pending += [b for b in below(one) if all((k + 1) // 2 == (j + 1) // 2 for k, j in zip(b, index, strict=True))]
    return max(sizes)


def newton_values(alpha: MultiIndices, points: Array) -> Array:
    """Values (n, N) of the products of Newton polynomials alpha (N, d) at points (n, d)."""
    values = np.ones((len(points), len(alpha)))
    for k, degrees in enumerate(alpha.T):
        involved = np.flatnonzero(degrees)
        if involved.size:
            values[:, involved] *= _newton(points[:, k], int(degrees.max()))[:, degrees[involved]]
    return values


def _newton(x: Array, degree: int) -> Array:
    """Newton polynomials (n, degree + 1) at points (n,)."""
    nodes, values = line(degree + 1), np.ones((len(x), degree + 1))
    for k in range(1, degree + 1):
        values[:, k] = values[:, k - 1] * (x - nodes[k - 1])
    return values / _scales(degree)


@cache
def _scales(degree: int) -> Array:
    nodes = line(degree + 1)
    return np.array([np.prod(nodes[k] - nodes[:k]) for k in range(degree + 1)])
