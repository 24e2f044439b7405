"""Chebyshev polynomials at Chebyshev nodes, with bounds of rounding, interpolation and aliasing errors.

A polynomial is an array of the coefficients of T_k0(s) T_k1(x1) ... T_kd(xd), with an axis for each variable.
"""

import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from symmb._types import Array
from symmb.prove.rounding import U, above, of_sum

TENSOR_PARAMETERS = 2
"""Largest number of parameters with a tensor basis. The size of such a basis grows exponentially with this number. For
more parameters, the total degree of polynomials is limited."""
ENTRY_ERROR = 8 * U
"""Error of a matrix entry: the cosine of an angle up to pi / 2 that has the relative error 3 U."""


@cache
def _cosines(m: int) -> Array:
    """cos(pi r / (2 m)) for r = 0, ..., 4 m - 1, from angles up to pi / 2."""
    r = np.arange(4 * m)
    r = np.where(r > 2 * m, 4 * m - r, r)
    folded = np.where(r > m, 2 * m - r, r)
    values = np.where(folded == m, 0.0, np.cos(np.pi * folded / (2 * m)))
    return np.where(r > m, -values, values)


@cache
def nodes(m: int) -> Array:
    """(m,) Chebyshev nodes of the first kind, cos((2 j + 1) pi / (2 m))."""
    return _cosines(m)[1 : 2 * m : 2]


@cache
def values_at_nodes(m: int, n: int) -> Array:
    """(m, n) values of T_0, ..., T_(n-1) at m nodes."""
    return _cosines(m)[np.outer(2 * np.arange(m) + 1, np.arange(n)) % (4 * m)]


@cache
def coefficients_from_nodes(m: int) -> Array:
    """(m, m) matrix from values at m nodes to the coefficients of the interpolating polynomial."""
    matrix = 2.0 / m * values_at_nodes(m, m).T
    matrix[0] /= 2
    return matrix


@cache
def integral(n: int) -> Array:
    """(n + 1, n) matrix from the coefficients of a polynomial to those of its integral, which is 0 at -1."""
    matrix = np.zeros((n + 1, n))
    for k in range(n):
        matrix[k + 1, k] = 1.0 if k == 0 else 0.5 / (k + 1)
        if k > 1:
            matrix[k - 1, k] = -0.5 / (k - 1)
    matrix[0] = -((-1.0) ** np.arange(1, n + 1)) @ matrix[1:]
    return matrix


def along(matrices: Sequence[Array | None], c: Array) -> Array:
    """Apply one matrix along each of the last axes of the coefficients c. None: the axis stays as it is."""
    first = c.ndim - len(matrices)
    for axis, matrix in enumerate(matrices, first):
        if matrix is None:
            continue
        if axis == c.ndim - 1:
            c = c @ matrix.T
        elif matrix.dtype == c.dtype:
            shape = c.shape
            flat = matrix @ c.reshape(*shape[: axis + 1], math.prod(shape[axis + 1 :]))
            c = flat.reshape(*shape[:axis], len(matrix), *shape[axis + 1 :])
        else:
            c = np.moveaxis(np.tensordot(matrix, c, (1, axis)), 0, axis)
    return c


def at_nodes(c: Array, counts: Sequence[int]) -> Array:
    """Values (..., m0, ..., md) of polynomials (..., n0, ..., nd) at nodes, without bounds of the errors."""
    lengths = c.shape[c.ndim - len(counts) :]
    return along([values_at_nodes(m, n) for m, n in zip(counts, lengths, strict=True)], c)


def sums(c: Array, variables: int) -> Array:
    """Sums of moduli over the last axes. They bound polynomials on [-1, 1]^d, because |T_k| <= 1 there."""
    return above(np.abs(c).sum(axis=tuple(range(c.ndim - variables, c.ndim))))


def rounding_of(lengths: Sequence[int], entry: float = ENTRY_ERROR) -> float:
    """Error of `along`, relative to the sum of moduli. Matrix entries are at most 1, with errors up to `entry`."""
    return above(math.prod(1.0 + above(entry + of_sum(n + 2)) for n in lengths) - 1.0 + U)


def values(c: Array, counts: Sequence[int]) -> tuple[Array, Array]:
    """Values (..., m0, ..., md) of polynomials (..., n0, ..., nd) at nodes, and bounds (...) of the errors.

    Constant terms are added last, so that they have the rounding error of only one sum.
    """
    d = len(counts)
    lengths = c.shape[c.ndim - d :]
    zero = (..., *(0,) * d)
    rest = c.copy()
    rest[zero] = 0.0
    values = at_nodes(rest, counts)
    error = sums(rest, d) * rounding_of(lengths)
    values = values + c[zero][(..., *(None,) * d)]
    return values, above(error + U * largest(values, d))


def largest(a: Array, variables: int) -> Array:
    """Largest moduli over the last axes."""
    axes = tuple(range(a.ndim - variables, a.ndim))
    return np.maximum(a.max(axis=axes), -a.min(axis=axes)) if axes else np.abs(a)


def bound_of_samples(samples: Array, errors: Array, variables: int) -> Array:
    """Bounds (...) of interpolating polynomials. Their values (..., m0, ..., md) have errors up to `errors` (...).

    The polynomial is at most the sum of the moduli of its coefficients. It is also at most the largest value times the
    product of the Lebesgue constants 2 / pi log(m) + 1 of m nodes.

    Source: Trefethen (2013), Approximation Theory and Approximation Practice, theorem 15.2 (Brutman).
    """
    counts = samples.shape[samples.ndim - variables :]
    lebesgue = above(math.prod(2.0 / math.pi * math.log(m) + 1.0 for m in counts))
    # The sum of the coefficients is sharper for smooth values, and Lebesgue's bound for the noise of rounding.
    peak = largest(samples, variables)
    c = along([coefficients_from_nodes(m) for m in counts], samples)
    lost = above(2.0**variables * math.prod(counts) * rounding_of(counts, 2 * ENTRY_ERROR))
    return above(np.minimum(sums(c, variables) + lost * peak, lebesgue * peak) + lebesgue * errors)


def integrals_of_samples(samples: Array, errors: Array, variables: int) -> Array:
    """Bounds (2, ...) of halves of the integrals from -1 of interpolating polynomials over the first variable.

    The first bound holds for integrals to any place, and the second one to 1. Arguments are those of
    `bound_of_samples`. The sum of moduli of coefficients of half the integral is at most that of the polynomial.
    """
    counts = samples.shape[samples.ndim - variables :]
    matrices = [coefficients_from_nodes(m) for m in counts]
    c = along([0.5 * integral(counts[0]) @ matrices[0], *matrices[1:]], samples)
    rounded = rounding_of(counts, 2 * ENTRY_ERROR) + of_sum(2 * counts[0] + 6)
    lost = above(2.0**variables * math.prod(counts) * rounded)
    lebesgue = above(math.prod(2.0 / math.pi * math.log(m) + 1.0 for m in counts))
    found = np.stack([sums(c, variables), sums(c.sum(axis=c.ndim - variables), variables - 1)])
    return above(found + lost * largest(samples, variables) + lebesgue * errors)


def product_bound(C: Array, B: Array, B_error: Array, minus: Array) -> Array:
    """Bounds (n, n) of C B - minus for matrices (n, n, n0, ...) of polynomials. B has errors up to B_error (n, n).

    The product is a polynomial, so that its interpolation in enough nodes is exact.
    """
    n, k = len(C), C.ndim - 2
    counts = tuple(a + b - 1 for a, b in zip(B.shape[2:], C.shape[2:], strict=True))
    (C, C_errors), (B, B_errors) = values(C, counts), values(B, counts)
    B_errors = above(B_errors + B_error)
    C_most, B_most = largest(C, k), largest(B, k)
    found = np.einsum("ij...,jk...->ik...", C, B) - minus[(..., *(None,) * k)]
    errors = C_most @ B_errors + C_errors @ (B_most + B_errors) + of_sum(n + 2) * (C_most @ B_most + np.abs(minus))
    return bound_of_samples(found, above(errors), k)


def aliasing(rho: Sequence[float], counts: Sequence[int]) -> float:
    """Largest error of the interpolation at nodes, relative to the bound M of the function on the polyellipse.

    Let a function be analytic, and at most M, in the ellipses with parameters rho_i > 1. Its coefficients are at most
    2^j M prod rho_i^-k_i. Here j is the number of k_i > 0. If k_i >= m_i for some i, interpolation in m_i nodes
    replaces T_k by plus or minus a polynomial of lower degree (aliasing). The error is then at most twice the sum of
    the moduli of these coefficients.

    Source: Trefethen (2013), Approximation Theory and Approximation Practice, theorems 4.1 and 8.1.
    """
    left, product = 0.0, 1.0  # sums over the k outside the grid, and over all k
    for r, m in zip(rho, counts, strict=True):
        terms = 1.0 + 2.0 / (r - 1.0)
        left = left * terms + product * 2.0 * r**-m / (1.0 - 1.0 / r)
        product *= terms
    return above(2.0 * left)
