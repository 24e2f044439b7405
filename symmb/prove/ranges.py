"""Proved ranges of polynomials on [-1, 1]^d, by Bernstein coefficients. Cells are halved until the ranges are sharp."""

import itertools
import math
from fractions import Fraction
from functools import cache

import numpy as np

from symmb._types import Array
from symmb.prove.chebyshev import along
from symmb.prove.rounding import U, above

_MOST_COEFFICIENTS_AT_ONCE = 2**20
"""Largest number of coefficients of cells in memory (8 MB). The search ends above this number. If the maximum is
on a curve or a surface, the number of cells doubles until the cells are as small as the tolerance.
"""
_MOST_HALVINGS = 80
"""Largest number of halvings of a cell. The sides of a cell of two parameters are then 2^-40 of those of the box."""


def ranges(c: Array, tolerance: float, other_errors: Array | float = 0.0) -> tuple[Array, Array]:
    """Bounds (m,) of polynomials with Chebyshev coefficients (m, n1, ..., nd).

    The excess is at most `tolerance` times the range, plus `other_errors` (m,), plus rounding. It is larger if too many
    cells are needed.

    The largest Bernstein coefficient of a polynomial is at least its maximum, and the coefficients at the corners are
    values of the polynomial. A cell is finished if its largest coefficient exceeds the largest known value by at most
    the tolerance.

    Source: Garloff, J. Comput. Appl. Math. 1985; Farouki, Comput. Aided Geom. Design 29 (2012), sections 5-7.
    """
    if c.ndim == 1:
        return c.copy(), c.copy()
    lengths = c.shape[1:]
    b = along([_to_bernstein(n - 1) for n in lengths], c)
    relative = sum(n + 4 for n in lengths) * U
    errors = above(along([np.abs(_to_bernstein(n - 1)) for n in lengths], np.abs(c)).reshape(len(c), -1).max(axis=1))
    errors = errors * relative
    corners = _corners(b)
    width = corners.max(axis=1) - corners.min(axis=1)
    tolerances = tolerance * width + other_errors + errors
    upper, lower = _maxima(b, tolerances), -_maxima(-b, tolerances)
    # each halving rounds the coefficients, which are convex combinations of earlier ones: errors add up
    halving = _MOST_HALVINGS * sum(n + 2 for n in lengths) * U * np.abs(b).reshape(len(b), -1).max(axis=1)
    return lower - above(errors + halving), upper + above(errors + halving)


def _maxima(b: Array, tolerances: Array) -> Array:
    """Upper bounds (m,) of polynomials with Bernstein coefficients (m, n1, ..., nd)."""
    best = _corners(b).max(axis=1)
    top = best.copy()
    most = max(_MOST_COEFFICIENTS_AT_ONCE // math.prod(b.shape[1:]), 2)
    pending = [(np.arange(len(b)), b, 0)]
    while pending:
        owner, cells, depth = pending.pop()
        bound = cells.reshape(len(cells), -1).max(axis=1)
        np.maximum.at(best, owner, _corners(cells).max(axis=1))
        done = bound <= best[owner] + tolerances[owner]
        if depth == _MOST_HALVINGS:
            done[:] = True
        np.maximum.at(top, owner[done], bound[done])
        owner, cells = owner[~done], cells[~done]
        if not len(owner):
            continue
        if 2 * len(owner) > most:
            if owner[0] == owner[-1]:
                np.maximum.at(top, owner, bound[~done])
            else:  # all cells of a polynomial stay together
                first = owner < owner[len(owner) // 2]
                first = first if first.any() else owner <= owner[0]
                pending += [(owner[part], cells[part], depth) for part in (first, ~first)]
            continue
        steepest = np.stack([np.abs(np.diff(cells, axis=axis)).reshape(len(cells), -1).max(axis=1, initial=0.0)
                             for axis in range(1, cells.ndim)])  # fmt: skip
        axis_of = steepest.argmax(axis=0)
        halves = [_halved(cells[axis_of == axis], axis + 1) for axis in range(len(steepest))]
        owners = np.concatenate([np.tile(owner[axis_of == axis], 2) for axis in range(len(steepest))])
        order = np.argsort(owners, kind="stable")
        pending.append((owners[order], np.concatenate(halves)[order], depth + 1))
    return np.maximum(top, best)


def _halved(cells: Array, axis: int) -> Array:
    """Bernstein coefficients of the lower halves, then of the upper halves, by de Casteljau's algorithm."""
    moved = np.moveaxis(cells, axis, -1)
    matrix = _halving(moved.shape[-1])
    return np.concatenate([np.moveaxis(moved @ part.T, -1, axis) for part in matrix])


@cache
def _halving(n: int) -> tuple[Array, Array]:
    """(n, n) matrices from Bernstein coefficients to those of the lower and of the upper half."""
    lower = np.array([[math.comb(i, j) / 2.0**i if j <= i else 0.0 for j in range(n)] for i in range(n)])
    return lower, lower[::-1, ::-1].copy()


def _corners(b: Array) -> Array:
    """Values (m, 2^d) of the polynomials at the corners of the cell."""
    ends = itertools.product((0, -1), repeat=b.ndim - 1)
    return np.stack([b[(slice(None), *end)] for end in ends], axis=1)


@cache
def _to_bernstein(n: int) -> Array:
    """(n + 1, n + 1) matrix from Chebyshev coefficients to Bernstein coefficients on [-1, 1], from exact fractions.

    T_k has the Bernstein coefficients (-1)^(k - j) C(2 k, 2 j) / C(k, j) of degree k. They are raised to degree n.
    """
    matrix = np.zeros((n + 1, n + 1))
    for k in range(n + 1):
        own = [Fraction((-1) ** (k - j) * math.comb(2 * k, 2 * j), math.comb(k, j)) for j in range(k + 1)]
        for i in range(n + 1):
            terms = range(max(0, i - n + k), min(k, i) + 1)
            total = sum((own[j] * math.comb(k, j) * math.comb(n - k, i - j) for j in terms), Fraction(0))
            matrix[i, k] = float(total / math.comb(n, i))
    return matrix


def cut(c: Array, share: Array) -> tuple[Array, Array]:
    """Polynomials (m, n1, ..., nd) without their highest orders, and bounds (m,) of the removed terms.

    The highest orders are removed from each axis as long as their sum is at most `share` (m,).
    """
    lost = np.zeros(len(c))
    for axis in range(1, c.ndim):
        sums = np.abs(c).sum(axis=tuple(i for i in range(1, c.ndim) if i != axis))
        tails = np.cumsum(sums[:, ::-1], axis=1)[:, ::-1]
        keep = max(1, int((tails > share[:, None]).sum(axis=1).max(initial=1)))
        lost = lost + (tails[:, keep] if keep < tails.shape[1] else 0.0)
        c = c.take(np.arange(keep), axis=axis)
    return c, above(lost)
