"""Exact ranges of many polynomials at once, by branch and bound on Bernstein coefficients.

On a box the Bernstein coefficients of a polynomial enclose it, and those at the corners are values of it.
Halving the box shrinks the gap fourfold. Boxes that cannot hold the extreme, or whose gap is small enough,
are left; the others of all polynomials are halved together, so that everything is a product of stacked
arrays with small matrices.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array
from symmb.bounds._legendre import MultiIndices
from symmb.simulate import Indices

CHUNK = 2**18
"""Coefficients handled together: 2 MB, what a core's cache holds."""


@dataclass(frozen=True)
class Exact:
    """The range of each polynomial itself, for any number of parameters and any order.

    Parameters
    ----------
    tolerance : largest excess of either bound over the true extreme, as a share of the polynomial's range.
        The bounds are never narrower than the range, but for rounding.

    Raises
    ------
    DeclarationError
        If the tolerance is not between 1e-9 and 1.

    Notes
    -----
    Work grows as (order + 1)^d times the number of boxes, of which a few suffice for up to three
    parameters. The change from Legendre to Bernstein coefficients loses about 0.3 order d digits.

    Examples
    --------
    The cubic of eq. (13), expanded in eq. (25), has the range [0, 4/27]:

    >>> coefficients = np.array([[1 / 12], [-1 / 20], [-1 / 12], [1 / 20]])
    >>> low, high = Exact(tolerance=1e-6).bounds(np.arange(4)[:, None], coefficients)
    >>> bool(abs(low[0]) < 1e-6), bool(abs(high[0] - 4 / 27) < 1e-6)
    (True, True)

    References
    ----------
    Garloff, J. Comput. Appl. Math. 1985; Farouki, Comput. Aided Geom. Design 29 (2012), sections 5-7.
    """

    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        if not 1e-9 <= self.tolerance < 1:
            raise DeclarationError(f"Exact: tolerance must be between 1e-9 and 1, got {self.tolerance!r}.")

    def bounds(self, alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array]:
        """Lower and upper bounds, each (m,), of polynomials with Legendre coefficients (n_b, m)."""
        shape = tuple(alpha.max(axis=0) + 1)
        m = coefficients.shape[1]
        lower, upper = np.empty(m), np.empty(m)
        step = max(1, CHUNK // math.prod(shape))
        for start in range(0, m, step):
            part = slice(start, start + step)
            dense = np.zeros((coefficients[:, part].shape[1], *shape))
            dense[:, *alpha.T] = coefficients[:, part].T
            lower[part], upper[part] = self._ranges(dense)
        return lower, upper

    def _ranges(self, legendre: Array) -> tuple[Array, Array]:
        bernstein = _along_axes(legendre, [_legendre_to_bernstein(n - 1) for n in legendre.shape[1:]])
        values = _along_axes(legendre, [_legendre_values(n - 1) for n in legendre.shape[1:]])
        values = values.reshape(len(values), -1)
        low, high = values.min(axis=1), values.max(axis=1)
        slack = self.tolerance * (high - low) + 1e-13 * np.abs(legendre).reshape(len(legendre), -1).max(axis=1)
        return _minima(bernstein, low, slack), -_minima(-bernstein, -high, slack)


def _minima(boxes: Array, best: Array, slack: Array) -> Array:
    """Lower bounds (m,) at most ``slack`` below the minima of polynomials with Bernstein coefficients (m,
    ...).

    ``best`` (m,) are values attained by the polynomials, upper bounds of the minima.
    """
    m, d = len(boxes), boxes.ndim - 1
    corners = np.ix_(*([0, n - 1] for n in boxes.shape[1:]))
    owner = np.arange(m)
    best, proved = best.copy(), best.copy()
    while len(boxes):
        np.minimum.at(best, owner, boxes[:, *corners].reshape(len(boxes), -1).min(axis=1))
        low = boxes.reshape(len(boxes), -1).min(axis=1)
        gap = low < best[owner] - slack[owner]
        np.minimum.at(proved, owner[~gap], low[~gap])
        boxes, owner = boxes[gap], owner[gap]
        if len(boxes):
            boxes, owner = _halved(boxes, owner, d)
    return np.minimum(proved, best)


def _halved(boxes: Array, owner: Indices, d: int) -> tuple[Array, Indices]:
    """Each box cut in two across the axis along which its polynomial is most curved."""
    curvature = np.stack(
        [np.abs(np.diff(boxes, 2, axis=k + 1)).reshape(len(boxes), -1).max(axis=1, initial=0.0) for k in range(d)]
    )
    across = curvature.argmax(axis=0)
    parts, owners = [], []
    for k in range(d):
        chosen = across == k
        if chosen.any():
            group = np.moveaxis(boxes[chosen], k + 1, -1)
            for half in _halving(boxes.shape[k + 1] - 1):
                parts.append(np.moveaxis(group @ half.T, -1, k + 1))
                owners.append(owner[chosen])
    return np.concatenate(parts), np.concatenate(owners)


def _along_axes(stack: Array, matrices: list[Array]) -> Array:
    """Apply one matrix along each axis but the first."""
    for k, matrix in enumerate(matrices):
        stack = np.moveaxis(np.moveaxis(stack, k + 1, -1) @ matrix.T, -1, k + 1)
    return stack


@cache
def _legendre_to_bernstein(n: int) -> Array:
    """(n + 1, n + 1) matrix from Legendre to Bernstein coefficients, summed in integers (Farouki 2012)."""
    comb = math.comb
    return np.array(
        [
            [
                sum(
                    (-1) ** (k + i) * comb(k, i) ** 2 * comb(n - k, j - i)
                    for i in range(max(0, j + k - n), min(j, k) + 1)
                )
                / comb(n, j)
                for k in range(n + 1)
            ]
            for j in range(n + 1)
        ]
    )


@cache
def _legendre_values(n: int) -> Array:
    """(2n + 1, n + 1) values of phi_0 ... phi_n at Chebyshev extremes, for a first guess of the range."""
    x = np.cos(np.pi * np.arange(2 * n + 1) / max(2 * n, 1))
    return np.asarray(np.polynomial.legendre.legvander(x, n), dtype=float)


@cache
def _halving(n: int) -> tuple[Array, Array]:
    """Matrices of de Casteljau's halving: coefficients on the left and on the right half."""
    left = np.array([[math.comb(j, i) / 2.0**j for i in range(n + 1)] for j in range(n + 1)])
    return left, left[::-1, ::-1].copy()
