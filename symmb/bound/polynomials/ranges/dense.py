"""Extremes of tensor polynomials of a few parameters by a dense grid of samples and Newton's method."""

import ctypes
from functools import cache

import numpy as np

from symmb._limits import windows
from symmb._types import Array
from symmb.bound.polynomials.legendre import MultiIndices
from symmb.run.codegen import c_fields, c_number, c_source, load, on_threads

MOST_PARAMETERS = int(c_number("dense_search", "DIRECTIONS"))
HIGHEST_DEGREE = int(c_number("dense_search", "HIGHEST_DEGREE"))
"""Limits of the number of parameters, and of the degree along each. Branch and bound searches other polynomials."""
SAMPLES_PER_DEGREE = 4
"""Number of samples for each degree along a parameter. They find the lowest of several minima if it is clearly the
lowest."""
_WAVY_DEGREE = 8
"""Above this degree, all minima along a parameter may be similar. The parameter then has twice as many samples, and
Newton's method starts in each of `_PIECES` parts. tests/polynomials/test_ranges.py"""
_PIECES = int(c_number("dense_search", "PIECES"))


class _Grid(ctypes.Structure):
    """Grid of c/dense_search.h."""

    _fields_ = c_fields(
        (ctypes.c_long * MOST_PARAMETERS, "n K"),
        (ctypes.c_void_p * MOST_PARAMETERS, "x values single"),
        (ctypes.c_void_p, "factors rows"),
        (ctypes.c_long, "pieces"),
        (ctypes.c_double, "reach"),
    )


def dense_extremes(alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array, Array, Array]:
    """Attained minima and maxima (m,), and their points (m, d), of polynomials on a full tensor of degrees.

    `alpha` (n_b, d) contains all multi-indices up to some degrees, in any order. `coefficients` (n_b, m) are for
    Legendre polynomials.
    """
    d, m = alpha.shape[1], coefficients.shape[1]
    degrees = alpha.max(axis=0)
    # The parameter with the highest degree is last, because the innermost loop in C is along the last parameter.
    order = np.argsort(degrees, kind="stable")
    rows = np.ascontiguousarray(np.lexsort(alpha[:, order[::-1]].T), dtype=np.int32)
    wavy = degrees.max() > _WAVY_DEGREE
    per_degree = [SAMPLES_PER_DEGREE] * (d - 1) + [2 * SAMPLES_PER_DEGREE if wavy else SAMPLES_PER_DEGREE]
    tables = [_samples(1, SAMPLES_PER_DEGREE)] * (MOST_PARAMETERS - d)
    tables += [_samples(int(degrees[k]) + 1, s) for k, s in zip(order, per_degree, strict=True)]
    grid = _Grid(pieces=_PIECES if wavy else 1, reach=_reach(per_degree))
    for k, (x, values, single) in enumerate(tables):
        grid.n[k], grid.K[k] = values.shape[1], len(x)
        grid.x[k], grid.values[k], grid.single[k] = x.ctypes.data, values.ctypes.data, single.ctypes.data
    grid.factors, grid.rows = _FACTORS.ctypes.data, rows.ctypes.data
    extremes, places = np.empty((2, m)), np.empty((2, m, d))
    for window in windows(m, 8):  # 8 numbers for each polynomial in addition to its coefficients
        extremes[:, window], points = _searched(grid, coefficients[:, window])
        places[:, window, order] = points[:, MOST_PARAMETERS - d :].swapaxes(1, 2)
    return extremes[0], extremes[1], places[0], places[1]


def _searched(grid: _Grid, coefficients: Array) -> tuple[Array, Array]:
    """Minima and maxima (2, m), and their points (2, MOST_PARAMETERS, m) in the order of the tables."""
    C, m = np.ascontiguousarray(coefficients, dtype=float), coefficients.shape[1]
    extremes, points = np.empty((2, m)), np.empty((2, MOST_PARAMETERS, m))
    pointers = [ctypes.c_void_p(a.ctypes.data) for a in (C, extremes, points)]
    library = load(_SOURCE, "dense")

    def work(next_polynomial: ctypes.c_long) -> None:
        if not library.dense(ctypes.byref(grid), ctypes.byref(next_polynomial), ctypes.c_long(m), *pointers):
            raise MemoryError("not enough memory to search ranges")

    on_threads(work, m, 2e-7 * C.size)  # upper limit of the time [s], for one parameter at the highest degree
    return extremes, points


def _reach(per_degree: list[int]) -> float:
    """Largest difference between an extreme and the best sample near it, divided by the range of values."""
    # With x_i = cos(theta_i), a polynomial of degrees n_i is trigonometric in the angles. Its second derivative along v
    # is at most (sum n_i |v_i|)^2 times its size (Bernstein). The range is at most 1 / prod cos(h_i) times the range of
    # samples at distances of 2 h_i / n_i (Ehlich and Zeller 1964).
    h = np.pi / 2 / np.array(per_degree)
    return float(h.sum() ** 2 / 4 / np.cos(h).prod())


@cache
def _samples(n: int, per_degree: int) -> tuple[Array, Array, np.ndarray]:
    """Samples of one parameter, and the n Legendre polynomials there in double and in single precision."""
    intervals = max(per_degree * (n - 1), 12)  # for low degrees, more samples take no more time
    x: Array = np.cos(np.pi * np.arange(intervals + 1) / intervals) if n > 1 else np.zeros(1)
    values = np.ascontiguousarray(np.polynomial.legendre.legvander(x, n - 1), dtype=float)
    return x, values, values.astype(np.float32)


_DEGREES = np.arange(HIGHEST_DEGREE + 1.0)
_FACTORS = np.stack([(2 * _DEGREES + 1) / (_DEGREES + 1), _DEGREES / (_DEGREES + 1)], axis=1)
_SOURCE = c_source("lanes", "dense_search")
