"""Piecewise polynomials that approximate responses over the box, and their ranges over parts and faces of the box."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.bound.polynomials.expansion import Expansion
from symmb.bound.polynomials.legendre import MultiIndices, basis_values, in_other_coordinates, with_fixed
from symmb.bound.polynomials.ranges.dense import HIGHEST_DEGREE, MOST_PARAMETERS, dense_extremes
from symmb.bound.polynomials.ranges.exact import RANGE_ERROR, RANGE_WORK, Exact
from symmb.run.codegen import with_compiler


def attained_extremes(alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array, Array, Array]:
    """Minima and maxima (m,), and their points (m, d), of polynomials with Legendre coefficients (n_b, m)."""
    # For few parameters and full tensors, samples in vector lanes are the fastest search. Otherwise, branch and bound
    # is used.
    d, degrees = alpha.shape[1], alpha.max(axis=0, initial=0)
    if d == 0:
        point = np.zeros((coefficients.shape[1], 0))
        return coefficients[0], coefficients[0], point, point

    def searched() -> tuple[Array, Array, Array, Array]:
        found = Exact(RANGE_ERROR, min(300, RANGE_WORK // len(alpha) + 1)).attained(alpha, coefficients)
        return found.lower, found.upper, found.at_lower, found.at_upper

    if d > MOST_PARAMETERS or degrees.max() > HIGHEST_DEGREE or len(alpha) < np.prod(degrees + 1):
        return searched()
    return with_compiler(partial(dense_extremes, alpha, coefficients), searched)


@dataclass(frozen=True, eq=False)
class Piecewise:
    """Polynomials that approximate responses over the box [-1, 1]^d.

    Attributes
    ----------
    centres, halves : (k, d)       centres and half widths of the parts
    expansions : k Expansions      in coordinates of the parts, with all degrees below each degree
    error : (n_t, n_y)             expected error of the polynomials at any point
    exact : bool                   True: bounds are the range of the polynomials; False: they may be wider
    """

    centres: Array
    halves: Array
    expansions: tuple[Expansion, ...]
    error: Array
    exact: bool = True

    @classmethod
    def whole(cls, expansion: Expansion, error: Array, exact: bool = True) -> "Piecewise":
        """One polynomial on the whole box."""
        d = expansion.alpha.shape[1]
        return cls(np.zeros((1, d)), np.ones((1, d)), (expansion,), error, exact)

    def changed(self, change: Callable[[Expansion], Expansion], error: Array) -> "Piecewise":
        """Polynomials on the same parts, with changed expansions and a new error (n_t, n_y)."""
        return replace(self, expansions=tuple(map(change, self.expansions)), error=error)

    def part(self, rows: slice | Indices | Sequence[int], outputs: slice | Sequence[int]) -> "Piecewise":
        """The polynomials of some outputs at some times."""

        def of(values: Array) -> Array:
            return values[..., rows, :][..., outputs]

        return self.changed(lambda own: replace(own, coefficients=of(own.coefficients)), of(self.error))

    def beside_fixed(self, names: Sequence[str], varied: Mask) -> "Piecewise":
        """The same polynomials over a box with more parameters (names), which are fixed where the mask is False."""
        d, k = len(names), len(self.centres)
        centres, halves = np.zeros((k, d)), np.ones((k, d))
        centres[:, varied], halves[:, varied] = self.centres, self.halves

        def lifted(own: Expansion) -> Expansion:
            alpha = np.zeros((len(own.alpha), d), dtype=own.alpha.dtype)
            alpha[:, varied] = own.alpha
            return replace(own, alpha=alpha, parameters=tuple(names))

        return replace(self.changed(lifted, self.error), centres=centres, halves=halves)

    def values(self, points: Array) -> Array:
        """Responses (N, n_t, n_y) at points (N, d)."""
        if len(self.expansions) == 1:
            return self.expansions[0].values((points - self.centres[0]) / self.halves[0])
        home = np.abs((points[:, None] - self.centres) / self.halves).max(axis=2).argmin(axis=1)
        values = np.empty((len(points), *self.error.shape))
        for k in np.unique(home):
            own = home == k
            values[own] = self.expansions[k].values((points[own] - self.centres[k]) / self.halves[k])
        return values

    def range(self, lower: Array, upper: Array) -> tuple[Array, Array, Array]:
        """Minima and maxima (n_t, n_y), and their points (2, n_t, n_y, d), over lower <= x <= upper, each (d,).

        Parameters with equal ends are fixed.
        """
        found = [self._part_range(*part) for part in self._parts(lower, upper)]
        lows, highs, places = (np.stack(each) for each in zip(*found, strict=True))
        best = np.stack([lows.argmin(axis=0), highs.argmax(axis=0)])
        return lows.min(axis=0), highs.max(axis=0), np.take_along_axis(places, best[None, ..., None], axis=0)[0]

    def acting(self, floor: Array) -> Mask:
        """Mask (d,) of parameters that may change a response by more than its floor (n_y,). Parameters without terms
        are included. If an error is infinite, all parameters are included."""
        acts, has_terms = np.zeros((2, self.centres.shape[1]), dtype=bool)
        for own in self.expansions:
            for i, degrees in enumerate(own.alpha.T):
                terms = own.coefficients[degrees > 0]
                has_terms[i] |= len(terms) > 0
                acts[i] = acts[i] or bool((np.abs(terms).sum(axis=0) > floor).any())
        return acts | ~has_terms | bool(np.isinf(self.error).any())

    def _parts(self, lower: Array, upper: Array) -> Iterator[tuple[int, Array, Array]]:
        """The numbers of the parts that intersect a box, and the ends of the intersections."""
        for k, (centre, half) in enumerate(zip(self.centres, self.halves, strict=True)):
            low, high = np.maximum(lower, centre - half), np.minimum(upper, centre + half)
            if (np.where(lower < upper, low < high, low <= high)).all():
                yield k, low, high

    def _part_range(self, k: int, lower: Array, upper: Array) -> tuple[Array, Array, Array]:
        """Minima, maxima and their points over a box inside of part k."""
        own, centre, half = self.expansions[k], (lower + upper) / 2, (upper - lower) / 2
        shape, free = own.coefficients.shape[1:], half > 0
        alpha, c = own.alpha, own.coefficients.reshape(len(own.alpha), -1)
        moves, scales = (centre - self.centres[k]) / self.halves[k], half / self.halves[k]
        alpha, c = with_fixed(alpha, c, ~free, moves[~free])
        for i, (move, scale) in enumerate(zip(moves[free], scales[free], strict=True)):
            if (move, scale) != (0.0, 1.0):  # the polynomial in coordinates of the box
                alpha, c = in_other_coordinates(alpha, c, i, move, scale)
        low, high, *at = attained_extremes(alpha, c)
        places = np.empty((2, *shape, len(free)))
        places[:] = centre
        places[..., free] += half[free] * np.stack(at).reshape(2, *shape, -1)
        return low.reshape(shape), high.reshape(shape), places

    def ranges(self, points: Array, free: Mask) -> tuple[Array, Array]:
        """Minima and maxima (N, n_t, n_y) over the free parameters (d,). Others keep their values at points (N, d)."""
        low, high = np.full((2, len(points), *self.error.shape), [[[[np.inf]]], [[[-np.inf]]]])
        for centre, half, own in zip(self.centres, self.halves, self.expansions, strict=True):
            x = (points[:, ~free] - centre[~free]) / half[~free]
            inside = (np.abs(x) <= 1).all(axis=1)
            if not inside.any():
                continue
            alpha, which = np.unique(own.alpha[:, free], axis=0, return_inverse=True)
            fixed = basis_values(own.alpha[:, ~free], x[inside])
            sums = np.empty((len(alpha), len(fixed), *self.error.shape))
            for j in range(len(alpha)):
                rows = which.ravel() == j
                sums[j] = np.tensordot(fixed[:, rows], own.coefficients[rows], axes=1)
            found = attained_extremes(alpha, sums.reshape(len(alpha), -1))
            low[inside] = np.minimum(low[inside], found[0].reshape(sums.shape[1:]))
            high[inside] = np.maximum(high[inside], found[1].reshape(sums.shape[1:]))
        return low, high


def joined(parts: Sequence[Piecewise | None], n_t: int) -> Piecewise | None:
    """One polynomial on the whole box for all outputs, from the polynomials of single outputs; None if there are none.

    The error of outputs without a polynomial is infinite. A scalar output has the same values at all n_t times.
    """
    known = {k: part.expansions[0] for k, part in enumerate(parts) if part}
    if not known:
        return None
    alpha, which = np.unique(np.concatenate([own.alpha for own in known.values()]), axis=0, return_inverse=True)
    coefficients, error, first = np.zeros((len(alpha), n_t, len(parts))), np.full((n_t, len(parts)), np.inf), 0
    for k, own in known.items():
        coefficients[which.ravel()[first : first + len(own.alpha)], :, k] = own.coefficients[..., 0]
        first += len(own.alpha)
    for k, part in enumerate(parts):
        if part:
            error[:, k] = part.error[:, 0]
    return Piecewise.whole(Expansion(alpha, coefficients, next(iter(known.values())).parameters), error)


def last_terms(own: Expansion) -> Array:
    """Sizes (n_t, n_y) of the terms with the highest degree in any parameter. Missing terms are usually not larger."""
    highest = own.alpha.max(axis=0, initial=0)
    is_last = ((own.alpha == highest) & (highest > 0)).any(axis=1)
    return np.abs(own.coefficients[is_last]).sum(axis=0)
