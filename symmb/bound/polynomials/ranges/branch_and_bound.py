"""Branch and bound in compiled C, c/polynomial_ranges.h: tables for it, and the call."""

import ctypes
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from symmb._types import Array
from symmb.bound.polynomials.chebyshev import LowerSet, halving
from symmb.bound.polynomials.ranges.terms import FEW_TERMS, LANES, Terms, terms_of
from symmb.run.codegen import c_source, load, on_threads

_SECONDS_PER_COEFFICIENT = 2.5e-5
"""Time for a coefficient with many parameters and a budget of thousands of boxes [s]."""
_MOST_LEVELS = 64
"""Halvings of a parameter after which the size of a box is below rounding."""


class _Basis(ctypes.Structure):
    """Basis of c/polynomial_ranges.h."""

    _fields_ = [
        *((name, ctypes.c_long) for name in ("d", "n", "n_low", "padded", "order", "n_samples", "n_sums")),
        *((name, ctypes.c_void_p) for name in ("linear", "square", "pairs", "parent", "factor", "fibres", "first")),
        *((name, ctypes.c_void_p) for name in ("weights", "halving", "samples")),
    ]


class _Search(ctypes.Structure):
    """Search of c/polynomial_ranges.h."""

    _fields_ = [
        ("basis", ctypes.c_void_p),
        ("tolerance", ctypes.c_double),
        ("budget", ctypes.c_long),
        ("depth", ctypes.c_long),
        ("proves", ctypes.c_long),
        *(
            (name, ctypes.c_void_p)
            for name in ("stack", "values", "powers", "x", "z", "slope", "local", "terms", "changed", "next")
        ),
    ]


@dataclass(frozen=True, eq=False)
class _Tables:
    """A Basis and the arrays that it points to."""

    basis: _Basis
    arrays: tuple[np.ndarray, ...]


def compiled_ranges(
    terms: Terms, legendre: Array, tolerance: float, budget: int, proves: bool = True
) -> tuple[Array, ...]:
    """Bounds, points and gaps of polynomials with Legendre coefficients (n_b, m), as in ``Extremes``.

    Without `proves`, the result contains values at the points if the budget is used up.
    """
    tables = _tables(terms.products)
    b, (n_given, m) = tables.basis, legendre.shape
    # The basis is changed in C: the threads of NumPy's matrix product would wait actively beside those below.
    change = terms.change if n_given <= FEW_TERMS else None
    C = terms.coefficients(legendre) if change is None else np.ascontiguousarray(legendre, dtype=float)
    depth = _MOST_LEVELS * b.d
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

    on_threads(work, m, _SECONDS_PER_COEFFICIENT * legendre.size)
    return *ranges, *points, *gaps


@lru_cache(maxsize=64)
def _tables(products: LowerSet) -> _Tables:
    terms, alpha = terms_of(products), products.alpha
    n, d = alpha.shape
    order = int(alpha.max())
    long = [f[f[:, 1] < n] if f.shape[1] > 1 else f[:0] for f in products.fibres]
    fibres = np.concatenate([np.pad(f, ((0, 0), (0, order + 1 - f.shape[1])), constant_values=n) for f in long])
    last = d - 1 - (alpha[:, ::-1] > 0).argmax(axis=1)
    lesser = alpha.copy()
    lesser[np.arange(n), last] = 0
    whole = (
        terms.linear,
        terms.square,
        terms.pairs[:, 2],
        np.array([products.number[tuple(row)] for row in lesser.tolist()]),
        last * (order + 1) + alpha[np.arange(n), last],
        fibres,
        np.cumsum([0, *map(len, long)]),
    )
    x = np.cos(np.pi * np.arange(2 * order + 1) / max(2 * order, 1))
    samples = np.column_stack([x, np.polynomial.chebyshev.chebvander(x, order)])
    sums = -(-(d + 1) // LANES) * LANES
    weights = np.pad(np.roll(terms.weights, -1, axis=0).T, ((0, 0), (0, sums - d - 1)))
    arrays = (
        *(np.ascontiguousarray(a, dtype=np.int32) for a in whole),
        *(np.ascontiguousarray(a, dtype=float) for a in (weights, halving(order), samples)),
    )
    sizes = d, n, int((alpha.sum(axis=1) <= 2).sum()), terms.padded, order, len(x), sums
    return _Tables(_Basis(*sizes, *(a.ctypes.data for a in arrays)), arrays)


_SOURCE = c_source("polynomial_ranges")
