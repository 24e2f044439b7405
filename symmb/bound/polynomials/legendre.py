"""Legendre polynomials on [-1, 1]^d with the uniform density 2^-d: values, norms, ranges, multi-indices.

phi_n is eqs. (15)-(17) of Wang and Yang (2021), normalised to phi_n(1) = 1. The mean square of phi_n is 1/(2n+1), eq.
(18) with W = 1/2. Polynomials of several parameters are products, eq. (22). The rows of ``alpha`` (n_b, d) are the
degrees of the products.
"""

from collections.abc import Container, Iterable
from functools import cache

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre

from symmb._types import Array, Mask

MultiIndices = npt.NDArray[np.intp]
Index = tuple[int, ...]


def below(index: Index) -> list[Index]:
    """The indices in which one degree is smaller by 1."""
    return [(*index[:i], k - 1, *index[i + 1 :]) for i, k in enumerate(index) if k]


def with_lower(indices: Iterable[Index], known: Container[Index] = ()) -> set[Index]:
    """The given indices and all smaller indices, except known indices. All indices below known ones must be known."""
    found: set[Index] = set()
    pending = list(indices)
    while pending:
        index = pending.pop()
        if index not in known and index not in found:
            found.add(index)
            pending.extend(below(index))
    return found


def basis_values(alpha: MultiIndices, points: Array) -> Array:
    """Values (N, n_b) of the polynomials ``alpha`` (n_b, d) at points (N, d)."""
    # For a few points, as in most calls, NumPy's legvander takes ten times as long.
    table = np.ones((int(alpha.max(initial=1)) + 1, points.shape[1], len(points)))
    x = table[1] = points.T
    for n in range(2, len(table)):
        table[n] = (table[n - 1] * x * (2 * n - 1) - table[n - 2] * (n - 1)) / n
    values = np.ones((len(alpha), len(points)))
    for k, degrees in enumerate(alpha.T):
        # With many parameters, most degrees are 0. Without these factors of 1, the products take a tenth of the time.
        some = np.flatnonzero(degrees)
        if 2 * len(some) > len(degrees):
            values *= table[degrees, k]
        else:
            values[some] *= table[degrees[some], k]
    return values.T


def mean_squares(alpha: MultiIndices) -> Array:
    """Mean squares (n_b,) over the box, eq. (31)."""
    return 1.0 / np.prod(2.0 * alpha + 1.0, axis=1, dtype=float)


@cache
def univariate_minimum(n: int) -> float:
    """Minimum of phi_n over [-1, 1], eq. (24): -1 for odd n, the lowest stationary value for even n > 0."""
    if n == 0:
        return 1.0
    if n % 2:
        return -1.0
    series = legendre.Legendre.basis(n)
    return float(series(np.real(series.deriv().roots())).min())


def basis_ranges(alpha: MultiIndices) -> tuple[Array, Array]:
    """Exact ranges (n_b,), (n_b,) of the products over the box."""
    low, high = np.ones(len(alpha)), np.ones(len(alpha))
    for k in range(alpha.shape[1]):
        minimum = np.array([univariate_minimum(int(n)) for n in alpha[:, k]])
        ends = np.stack([low * minimum, low, high * minimum, high])
        low, high = ends.min(axis=0), ends.max(axis=0)
    return low, high


def total_degree(d: int, order: int) -> MultiIndices:
    """Multi-indices (n_b, d) with sum at most ``order``, sorted by their sum. n_b = C(d + order, d), eq. (21)."""
    return np.array([row for degree in range(order + 1) for row in homogeneous(d, degree)], dtype=np.intp)


def homogeneous(d: int, degree: int) -> list[tuple[int, ...]]:
    """Multi-indices of d entries with sum ``degree``, in decreasing order of the first entry."""
    if d == 1:
        return [(degree,)]
    return [(first, *rest) for first in range(degree, -1, -1) for rest in homogeneous(d - 1, degree - first)]


def tensor_degree(d: int, order: int) -> MultiIndices:
    """Multi-indices ((order + 1)^d, d) with every entry at most ``order``."""
    return np.indices((order + 1,) * d).reshape(d, -1).T


def in_other_coordinates(
    alpha: MultiIndices, coefficients: Array, i: int, centre: float | Array, half: float | Array
) -> tuple[MultiIndices, Array]:
    """Multi-indices (n_b, d) and coefficients (n_b, m) with centre + half x as parameter i.

    For coefficients (n_b, k, m), `centre` and `half` are (k,).
    """
    # Columns of the matrix are the Legendre coefficients of P_j(centre + half x), which has degree j at most.
    degree = int(alpha[:, i].max())
    x, P = np.polynomial.legendre.leggauss(degree + 1)[0], np.polynomial.legendre.legvander
    points = np.asarray(centre)[..., None] + np.asarray(half)[..., None] * x
    matrix = np.linalg.solve(P(x, degree), P(points, degree))
    others, which = np.unique(np.delete(alpha, i, axis=1), axis=0, return_inverse=True)
    table = np.zeros((len(others), degree + 1, *coefficients.shape[1:]))
    table[which.ravel(), alpha[:, i]] = coefficients
    changed = np.einsum("...ab,ob...m->oa...m", matrix, table, optimize=True)
    return alpha, changed[which.ravel(), alpha[:, i]]


def with_fixed(alpha: MultiIndices, coefficients: Array, fixed: Mask, x: Array) -> tuple[MultiIndices, Array]:
    """Multi-indices and coefficients (n_b, m) without the parameters of a mask (d,), which have the values x (n,)."""
    if not fixed.any():
        return alpha, coefficients
    others, which = np.unique(alpha[:, ~fixed], axis=0, return_inverse=True)
    terms = basis_values(alpha[:, fixed], x[None])[0][:, None] * coefficients
    order = np.argsort(which.ravel(), kind="stable")
    return others, np.add.reduceat(terms[order], np.searchsorted(which.ravel()[order], np.arange(len(others))))
