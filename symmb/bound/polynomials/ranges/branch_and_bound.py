"""Tables and calls of branch and bound in compiled C, c/polynomial_ranges.h."""

import ctypes
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from symmb._types import Array, Indices
from symmb._work import count_work
from symmb.bound.polynomials.chebyshev import LowerSet, halving
from symmb.bound.polynomials.legendre import MultiIndices
from symmb.run.codegen import c_fields, c_number, c_source, load, on_threads

_FULL_MATRIX_TERMS = 64
"""Up to this number of coefficients, a product with one full matrix is the fastest change of basis."""
_LANES = int(c_number("polynomial_ranges", "W"))


class _Basis(ctypes.Structure):
    """Basis of c/polynomial_ranges.h."""

    _fields_ = c_fields(
        (ctypes.c_long, "d n n_low padded order n_samples n_sums"),
        (ctypes.c_void_p, "linear square pairs parent factor fibres first weights halving samples"),
    )


class _Search(ctypes.Structure):
    """Search of c/polynomial_ranges.h."""

    _fields_ = c_fields(
        (ctypes.c_void_p, "basis"),
        (ctypes.c_double, "tolerance"),
        (ctypes.c_long, "budget depth proves"),
        (ctypes.c_void_p, "stack values powers x z slope local terms changed next"),
    )


@dataclass(frozen=True, eq=False)
class _Tables:
    """A Basis, the arrays to which it points, and a matrix (n_b, padded) from Legendre coefficients, if few."""

    basis: _Basis
    arrays: tuple[np.ndarray, ...]
    change: Array | None


def compiled_ranges(
    alpha: MultiIndices, legendre: Array, tolerance: float, budget: int, proves: bool = True
) -> tuple[Array, ...]:
    """Bounds, points and gaps of polynomials with Legendre coefficients (n_b, m), as in ``Extremes``.

    Without `proves`, the bounds are the values at the points if the budget is used up.
    """
    products = LowerSet.of(alpha)
    tables = _tables(products)
    b, change, (n_given, m) = tables.basis, tables.change, legendre.shape
    # C changes a small basis. NumPy's threads would use processor time while they wait for the threads below.
    C = np.ascontiguousarray(legendre, dtype=float)
    if change is None:
        C = np.zeros((m, b.padded))
        C[:, : b.n] = products.from_legendre(legendre).T
    depth = 64 * b.d  # after 64 halvings of a parameter, the size of a box is only rounding
    ranges, points, gaps = np.empty((2, m)), np.empty((2, m, b.d)), np.empty((2, m))
    of, to, *rest = (None if a is None else ctypes.c_void_p(a.ctypes.data) for a in (C, change, ranges, points, gaps))
    library = load(_SOURCE, "ranges")

    def work(next_polynomial: ctypes.c_long) -> None:
        boxes = depth * (b.padded + 2 * b.d + 2), b.padded, b.d * (b.order + 1), b.d, b.d
        scratch = b.n_sums, 4 * b.d, 2 * (b.order + 1), b.padded
        own = [np.zeros(size) for size in (*boxes, *scratch)]
        addresses = *(a.ctypes.data for a in own), ctypes.addressof(next_polynomial)
        search = _Search(ctypes.addressof(b), tolerance, budget, depth, proves, *addresses)
        library.ranges(ctypes.byref(search), ctypes.c_long(m), of, to, ctypes.c_long(n_given), *rest)

    # Time for seven to nine parameters, within a factor of three (tests/benchmarks/everyday_machines.py).
    count_work(150.0 * b.d * legendre.size)
    on_threads(work, m, 2.5e-5 * legendre.size)  # [s] with many parameters and a budget of thousands of boxes
    return *ranges, *points, *gaps


def range_tables(alpha: MultiIndices) -> tuple[tuple[_Basis, tuple[np.ndarray, ...]], Indices]:
    """The Basis of c/polynomial_ranges.h, its arrays, and the numbers of the given products in its order."""
    products = LowerSet.of(alpha)
    tables = _tables(products)
    return (tables.basis, tables.arrays), products.given


@lru_cache(maxsize=64)
def _tables(products: LowerSet) -> _Tables:
    """The tables of a lower set. All polynomials on the set use the same tables."""
    alpha, number = products.alpha, products.number
    n, d = alpha.shape
    order, degree = int(alpha.max()), alpha.sum(axis=1)
    unit = np.eye(d, dtype=np.intp)
    linear, square = ([number.get(tuple(row), n) for row in j * unit] for j in (1, 2))
    pairs = [number.get(tuple(unit[i] + unit[j]), n) for i in range(d) for j in range(i)]
    long = [f[f[:, 1] < n] if f.shape[1] > 1 else f[:0] for f in products.fibres]
    fibres = np.concatenate([np.pad(f, ((0, 0), (0, order + 1 - f.shape[1])), constant_values=n) for f in long])
    last = d - 1 - (alpha[:, ::-1] > 0).argmax(axis=1)
    lesser = alpha.copy()
    lesser[np.arange(n), last] = 0
    whole = (
        linear,
        square,
        pairs,
        [number[tuple(row)] for row in lesser.tolist()],
        last * (order + 1) + alpha[np.arange(n), last],
        fibres,
        np.cumsum([0, *map(len, long)]),
    )
    x = np.cos(np.pi * np.arange(2 * order + 1) / max(2 * order, 1))
    samples = np.column_stack([x, np.polynomial.chebyshev.chebvander(x, order)])
    # Rows end with at least one zero, which stands for all products outside of the set. The slope of T_j is at most
    # j^2. Linear terms are left out, because all other terms are compared with them.
    padded, sums = _LANES * (n // _LANES + 1), _LANES * (d // _LANES + 1)
    weights = np.zeros((padded, sums))
    weights[:n, :d] = np.where(degree[:, None] == 1, 0, alpha**2)
    weights[:n, d] = degree > 2
    change = None
    if len(products.given) <= _FULL_MATRIX_TERMS:
        change = np.zeros((len(products.given), padded))
        change[:, :n] = products.from_legendre(np.eye(len(change))).T
    arrays = (
        *(np.ascontiguousarray(a, dtype=np.int32) for a in whole),
        *(np.ascontiguousarray(a, dtype=float) for a in (weights, halving(order), samples)),
    )
    sizes = d, n, int((degree <= 2).sum()), padded, order, len(x), sums
    return _Tables(_Basis(*sizes, *(a.ctypes.data for a in arrays)), arrays, change)


_SOURCE = c_source("polynomial_ranges")
