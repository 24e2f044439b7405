"""Branch and bound of c/polynomial_ranges.h in NumPy, for use without a compiler, all polynomials together."""

from dataclasses import dataclass

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.polynomials.chebyshev import halving
from symmb.polynomials.ranges.terms import Terms

CHUNK = 2**18
"""Coefficients of a part: 2 MB, the size of a core's cache."""


@dataclass(frozen=True, eq=False)
class _Boxes:
    """Coefficients (N, n_padded) in local coordinates, centres and half widths (N, d), numbers of the polynomials (N,).

    A half width of 0 is that of a parameter fixed at the end of its range.
    """

    C: Array
    centre: Array
    half: Array
    owner: Indices

    def __getitem__(self, rows: Mask | Indices | slice) -> "_Boxes":
        return _Boxes(self.C[rows], self.centre[rows], self.half[rows], self.owner[rows])


@np.errstate(invalid="ignore")
def array_ranges(terms: Terms, legendre: Array, tolerance: float, budget: int) -> tuple[Array, ...]:
    """Bounds, points and gaps of polynomials with Legendre coefficients (n_b, m), as in ``Extremes``."""
    C = terms.coefficients(legendre)
    floor = 1e-13 * np.abs(C).max(axis=1)
    at_lower = np.where(C[:, terms.linear] > 0, -1.0, 1.0)
    points = np.stack([at_lower, -at_lower])
    y = np.stack([np.einsum("mn,mn->m", C[:, : len(terms.products.alpha)], _products(terms, x)) for x in points])
    swap = y[0] > y[1]
    points[:, swap], y[:, swap] = points[::-1, swap], y[::-1, swap]
    lower, at_lower, gap = _minima(terms, C, points[0], y[0], y[1], tolerance, floor, budget)
    upper, at_upper, other = _minima(terms, -C, points[1], -y[1], -y[0], tolerance, floor, budget)
    return lower, -upper, at_lower, at_upper, gap, other


def _minima(
    terms: Terms, C: Array, at: Array, best: Array, top: Array, tolerance: float, floor: Array, budget: int
) -> tuple[Array, Array, Array]:
    """Lower bounds, points and gaps. Values best (m,) are attained at points (m, d), values top (m,) somewhere."""
    m, d = at.shape
    best, at, proved = best.copy(), at.copy(), np.full(m, np.inf)
    count = np.zeros(m, dtype=np.intp)
    most = max(1, CHUNK // terms.padded)
    whole = _Boxes(C, np.zeros((m, d)), np.ones((m, d)), np.arange(m))
    stack = [whole[i : i + most] for i in range(0, m, most)]
    while stack:
        boxes, slope = _fixed(terms, stack.pop())
        bound, z = _lower_bounds(terms, boxes)
        y = np.einsum("mn,mn->m", boxes.C[:, : len(terms.products.alpha)], _products(terms, z))
        order = np.lexsort((y, boxes.owner))
        first = order[np.unique(boxes.owner[order], return_index=True)[1]]
        better = first[y[first] < best[boxes.owner[first]]]
        best[boxes.owner[better]] = y[better]
        at[boxes.owner[better]] = (boxes.centre + boxes.half * z)[better]
        count += np.bincount(boxes.owner, minlength=m)
        slack = tolerance * (top - best) + floor
        unproved = (bound < (best - slack)[boxes.owner]) & (count[boxes.owner] <= budget)
        np.minimum.at(proved, boxes.owner[~unproved], bound[~unproved])
        if unproved.any():
            halves = _halved(terms, boxes[unproved], slope[unproved].argmax(axis=1))
            stack.extend(halves[i : i + most] for i in range(0, len(halves.owner), most))
    lower = np.minimum(proved, best)
    gap = best - lower
    return lower, at, np.where(gap > tolerance * (top - best) + floor, gap, 0.0)


def _fixed(terms: Terms, boxes: _Boxes) -> tuple[_Boxes, Array]:
    """Boxes that may contain a minimum, and the variation of their slopes (N, d). Monotone parameters are fixed."""
    C, linear = boxes.C.copy(), boxes.C[:, terms.linear]
    slope = np.abs(C) @ terms.weights[1:].T
    monotone = (np.abs(linear) >= slope) & (boxes.half > 0)
    end = np.where(linear > 0, -1.0, 1.0)
    centre = np.where(monotone, boxes.centre + end * boxes.half, boxes.centre)
    half = np.where(monotone, 0.0, boxes.half)
    for k, fibres in enumerate(terms.products.fibres):
        rows = np.flatnonzero(monotone[:, k])
        own = C[rows[:, None, None], fibres] * end[rows, k, None, None] ** np.arange(fibres.shape[1])
        C[rows[:, None, None], fibres[:, 1:]] = 0.0
        C[rows[:, None], fibres[:, 0]] = own.sum(axis=2)
    inside = monotone & (np.abs(centre) < 1) & (np.abs(linear) > slope)
    undecided = np.flatnonzero(~inside.any(axis=1))
    return _Boxes(C, centre, half, boxes.owner)[undecided], np.where(half > 0, slope, -1.0)[undecided]


def _lower_bounds(terms: Terms, boxes: _Boxes) -> tuple[Array, Array]:
    """Lower bounds (N,), and the points z (N, d) of the boxes that would attain them."""
    g, h = boxes.C[:, terms.linear], 2.0 * boxes.C[:, terms.square]
    constant = boxes.C[:, 0] - np.abs(boxes.C) @ terms.weights[0] - 0.5 * h.sum(axis=1)
    near = np.where(np.abs(g) >= h, np.where(g > 0, -1.0, 1.0), 0.0)
    for i, j, product in terms.pairs:
        m, ends = boxes.C[:, product], near[:, i] * near[:, j]
        tilt = np.where(m * ends > 0, m, 0.0)
        g[:, i] += tilt * near[:, j]
        g[:, j] += tilt * near[:, i]
        h[:, [i, j]] -= 0.5 * np.abs(m - tilt)[:, None]
        constant -= tilt * ends
    inner = np.abs(g) < 2.0 * h
    z = np.where(inner, -0.5 * g / np.where(inner, h, 1.0), np.where(g > 0, -1.0, 1.0)) * (boxes.half > 0)
    return constant + (g * z + h * z * z).sum(axis=1), z


def _halved(terms: Terms, boxes: _Boxes, across: Indices) -> _Boxes:
    """Two halves of each box, along a parameter that differs from box to box."""
    C = np.stack([boxes.C, boxes.C])
    for k, fibres in enumerate(terms.products.fibres):
        rows = np.flatnonzero(across == k)
        matrix = halving(fibres.shape[1] - 1)
        signs = (-1.0) ** np.arange(len(matrix))
        own = boxes.C[rows[:, None, None], fibres]
        for side, change in enumerate((signs[:, None] * matrix * signs, matrix)):
            C[side, rows[:, None, None], fibres] = own @ change.T
    half = boxes.half.copy()
    each = np.arange(len(across))
    half[each, across] *= 0.5
    step = np.zeros_like(half)
    step[each, across] = half[each, across]
    centre = np.concatenate([boxes.centre - step, boxes.centre + step])
    return _Boxes(C.reshape(-1, C.shape[2]), centre, np.tile(half, (2, 1)), np.tile(boxes.owner, 2))


def _products(terms: Terms, points: Array) -> Array:
    """Values (N, n) of the products at points (N, d)."""
    alpha = terms.products.alpha
    values = np.ones((len(points), len(alpha)))
    for k in range(alpha.shape[1]):
        values *= np.polynomial.chebyshev.chebvander(points[:, k], int(alpha[:, k].max()))[:, alpha[:, k]]
    return values
