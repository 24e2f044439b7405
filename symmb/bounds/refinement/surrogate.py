"""The surrogate in a box: a hierarchical interpolant, continued through runs beside its nodes, and its error."""

from collections.abc import Container, Iterable
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.stats import t as student

from symmb._types import Array
from symmb.bounds.adaptive import (
    FEWEST_BOXES,
    RANGE_WORK,
    TENSOR_PARAMETERS,
    evenly_spread_points,
    quasi_random_points,
    relative_rms,
)
from symmb.bounds.refinement.constants import (
    COMPARED,
    COMPARED_POINTS,
    CONFIDENCE,
    DENSE,
    NODE_SHARE,
    NUGGET,
    PRIOR_WEIGHT,
    RANGE,
    SURPRISE,
)
from symmb.bounds.refinement.hierarchy import Hierarchy, newton_values
from symmb.bounds.time_windows import average_over_window
from symmb.codegen import with_compiler
from symmb.nodes import Grid, Index, below
from symmb.polynomials import Expansion, MultiIndices
from symmb.polynomials.ranges import HIGHEST_DEGREE, Exact, dense_extremes


class LeafRange(NamedTuple):
    """Minima and maxima (n_t, n_y), their places (2, n_t, n_y, d), and expected errors (2, n_t, n_y)."""

    lower: Array
    upper: Array
    places: Array
    errors: Array


class Surrogate:
    """s(x) = sum over the set of w_a h_a(x) + sum over indices ahead of it of c_a h_a(x).

    The second sum vanishes at all nodes. It goes through the other runs with the least sum of (c_a / p_a)^2, where p_a
    are the predicted sizes. As coefficients that are normal with these deviations it has a standard deviation sigma(x),
    which is 0 at all runs, in units tau (n_t, n_y). Each of the other runs tells tau, by its error without it.

    Attributes
    ----------
    ahead, sizes : (F, d) indices ahead, and (F,) their sizes, over the widths
    scale : tau (n_t, n_y)
    confidence : standard deviations below which an error is expected to be
    """

    def __init__(self, hierarchy: Hierarchy, widths: Array, noise: Array, points: Array, Y: Array) -> None:
        self.hierarchy, self.points = hierarchy, points
        known = hierarchy.sizes(widths, noise)
        predicted = hierarchy.ahead(known, 2 * len(points) + 1)
        largest = sorted(predicted, key=lambda a: (-predicted[a], a))[: max(4 * len(points), 8 * hierarchy.d)]
        self._grid = Grid(hierarchy.d)
        self._grid.row = dict(hierarchy.grid.row)
        self._grid.add(closed(largest, predicted))
        self.ahead = self._grid.alpha[len(known) :]
        self.sizes = np.maximum([predicted[tuple(a)] for a in self.ahead.tolist()], 1e-9)
        n_c, errors = len(points), Y - hierarchy.values(points)
        if n_c:  # errors far above the predicted ones may come from any index
            least = relative_rms(np.sqrt(np.square(errors).mean(axis=0)), widths)
            if least > SURPRISE * np.sqrt(np.square(self._weighted(points)).sum(axis=1).mean()):
                self.sizes = np.maximum(self.sizes, least / len(self.sizes) ** 0.5)
        H = self._weighted(points)
        G = H @ H.T
        G[np.diag_indices(n_c)] *= 1 + NUGGET
        G[np.diag_indices(n_c)] += 1e-24
        self._factor = cho_factor(G, lower=True) if n_c else None
        self.coefficients, squares = np.zeros((len(H.T), *Y.shape[1:])), PRIOR_WEIGHT * self._prior(known)
        if self._factor is not None:
            solved = cho_solve(self._factor, np.hstack([errors.reshape(n_c, -1), np.eye(n_c)]))
            weights, alone = solved[:, :-n_c].reshape(errors.shape), np.diag(solved[:, -n_c:])
            self.coefficients = np.tensordot(self.sizes[:, None] * H.T, weights, axes=1)
            squares = squares + average_over_window((np.square(weights) / alone[:, None, None]).sum(axis=0))
        self.scale = np.sqrt(squares / (PRIOR_WEIGHT + n_c))
        self.confidence = float(student.ppf(CONFIDENCE, max(n_c, 1)))

    def _prior(self, known: dict[Index, float]) -> Array:
        """Squares of tau from the surpluses that nothing follows in the set."""
        grid = self.hierarchy.grid
        above = {b for a in grid.row for b in below(a)}
        last = [k for a, k in grid.row.items() if a not in above]
        total = sum(known[a] ** 2 for a in grid.row if a not in above)
        sum_of_squares = average_over_window(np.square(self.hierarchy.surpluses[last]).sum(axis=0))
        return sum_of_squares / total if total > 0 else np.zeros_like(sum_of_squares)

    def _weighted(self, points: Array) -> Array:
        return newton_values(self.ahead, points) * self.sizes

    def deviation(self, points: Array) -> Array:
        """sigma (n,) at points (n, d), in units of tau."""
        H = self._weighted(points)
        variance = np.square(H).sum(axis=1)
        if self._factor is not None:
            solved = solve_triangular(self._factor[0], self._weighted(self.points) @ H.T, lower=True)
            variance = variance - np.square(solved).sum(axis=0)
        return np.sqrt(np.maximum(variance, 0.0))

    def values(self, points: Array) -> Array:
        """Responses (n, n_t, n_y) at points (n, d)."""
        further = np.tensordot(newton_values(self.ahead, points), self.coefficients, axes=1)
        return np.asarray(self.hierarchy.values(points) + further, dtype=float)

    @cached_property
    def expected(self) -> Array:
        """Expected error (n_t, n_y) anywhere."""
        return self.confidence * self.scale * self.typical

    @cached_property
    def typical(self) -> float:
        """Root mean square of sigma over the box."""
        points = quasi_random_points(64, self.hierarchy.d)
        return float(np.sqrt(np.square(self.deviation(points)).mean()))

    def expansion(self, Y: Array, names: tuple[str, ...]) -> Expansion:
        """In Legendre polynomials, from the responses Y (N, n_t, n_y) at the nodes."""
        nodes = self._grid.nodes[len(Y) :]
        values = np.concatenate([Y, self.values(nodes)])
        coefficients = self._grid.coefficients(values.reshape(len(values), -1))
        return Expansion(self._grid.alpha, coefficients.reshape(values.shape), names)

    def range(self, expansion: Expansion) -> LeafRange:
        """The range of the surrogate's expansion, and how far the response may exceed it."""
        shape = expansion.coefficients.shape[1:]
        lower, upper, *at = _extremes(expansion.alpha, expansion.coefficients.reshape(len(expansion.alpha), -1))
        places = np.stack(at).reshape(2, *shape, -1)
        errors = np.stack([self._error(x, sign) for x, sign in zip(places, (-1, 1), strict=True)])
        return LeafRange(lower.reshape(shape), upper.reshape(shape), places, errors)

    def _error(self, places: Array, sign: int) -> Array:
        """How far the response may exceed an extreme (n_t, n_y) of the surrogate at places (n_t, n_y, d).

        It is the largest of s(z) + confidence tau sigma(z) over s(x), at the place x, at points z with one parameter
        changed, and at some anywhere in the box: where the surrogate falls steeply from x it is small.
        """
        (n_t, n_y, d), alpha = places.shape, self._grid.alpha
        step = max(1, -(-n_t * n_y * (2 * d + 1) // COMPARED))
        times = np.unique(np.append(np.arange(0, n_t, step), n_t - 1))
        x, unit = places[times].reshape(-1, d), np.eye(d)
        spread = self.confidence * self.scale[times].ravel()
        of_set = np.concatenate([self.hierarchy.surpluses, self.coefficients])[:, times].reshape(len(alpha), -1)
        here = newton_values(alpha, x)
        error = spread * self.deviation(x)
        error = np.maximum(error, NODE_SHARE * spread * self.typical)
        for axis in unit:
            for factor in (1.0, 2.0):
                z = x - factor * axis * x
                loss = sign * np.einsum("qb,bq->q", here - newton_values(alpha, z), of_set)
                error = np.maximum(error, spread * self.deviation(z) - np.maximum(loss, 0.0))
        somewhere = evenly_spread_points(COMPARED_POINTS, d)
        deviation, values = self.deviation(somewhere), newton_values(alpha, somewhere) @ of_set
        loss = sign * (np.einsum("qb,bq->q", here, of_set) - values)
        error = np.maximum(error, (spread * deviation[:, None] - np.maximum(loss, 0.0)).max(axis=0))
        error = error.reshape(len(times), n_y)
        if step == 1:
            return error
        behind = np.searchsorted(times, np.arange(n_t))
        before = np.searchsorted(times, np.arange(n_t), side="right") - 1
        return np.maximum(error[before], error[behind])


def closed(indices: Iterable[Index], found: Container[Index]) -> set[Index]:
    """With the smaller indices that are ahead as well."""
    together, pending = set[Index](), list(indices)
    while pending:
        one = pending.pop()
        if one not in together:
            together.add(one)
            pending += [b for b in below(one) if b in found]
    return together


def _extremes(alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array, Array, Array]:
    """Minima and maxima (m,), and their places (m, d), of polynomials with Legendre coefficients (n_b, m)."""
    d, degrees = alpha.shape[1], alpha.max(axis=0)
    full = int(np.prod(degrees + 1))

    def by_boxes() -> tuple[Array, Array, Array, Array]:
        found = Exact(10 * RANGE, max(FEWEST_BOXES, RANGE_WORK // 4 // len(alpha))).attained(alpha, coefficients)
        return found.lower, found.upper, found.at_lower, found.at_upper

    if d > TENSOR_PARAMETERS or full > DENSE or degrees.max() > HIGHEST_DEGREE:
        return by_boxes()
    tensor = np.indices(tuple(degrees + 1)).reshape(d, -1).T
    padded = np.zeros((full, coefficients.shape[1]))
    padded[np.ravel_multi_index(tuple(alpha.T), tuple(degrees + 1))] = coefficients
    return with_compiler(partial(dense_extremes, tensor, padded), by_boxes)
