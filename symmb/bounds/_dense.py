"""Extremes of tensor polynomials of a few parameters as a dense grid of samples and Newton's method find them."""

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

from symmb._types import Array
from symmb.bounds._legendre import MultiIndices
from symmb.codegen.build import load
from symmb.codegen.engine import header

MOST_PARAMETERS = 3
HIGHEST_DEGREE = 64
_SAMPLES = 8
"""Samples beyond two for each degree: enough to start from the deepest of several valleys, unless they are as deep."""


class _Grid(ctypes.Structure):
    """Grid of dense.h."""

    _fields_ = [
        ("n", ctypes.c_long * MOST_PARAMETERS),
        ("K", ctypes.c_long * MOST_PARAMETERS),
        ("x", ctypes.c_void_p * MOST_PARAMETERS),
        ("values", ctypes.c_void_p * MOST_PARAMETERS),
    ]


def dense_extremes(alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array, Array, Array]:
    """Attained minima and maxima (m,), and their points (m, d), of polynomials on a full tensor of degrees.

    Parameters
    ----------
    alpha : (n_b, d)             all multi-indices up to some degrees, in any order, d at most 3
    coefficients : (n_b, m)      Legendre coefficients
    """
    d, m = alpha.shape[1], coefficients.shape[1]
    shape = tuple(int(k) + 1 for k in alpha.max(axis=0))
    lanes = -(-m // 8) * 8
    C = np.zeros((*shape, lanes))
    C[(*alpha.T, slice(0, m))] = coefficients
    tables = [_samples(n) for n in (*shape, *(1,) * (MOST_PARAMETERS - d))]
    grid = _Grid()
    for k, (x, values) in enumerate(tables):
        grid.n[k], grid.K[k] = values.shape[1], len(x)
        grid.x[k], grid.values[k] = x.ctypes.data, values.ctypes.data
    found, points = np.empty((2, lanes)), np.empty((2, MOST_PARAMETERS, lanes))
    pointers = (ctypes.c_void_p(a.ctypes.data) for a in (C, found, points))
    load(_SOURCE).dense(ctypes.byref(grid), ctypes.c_long(lanes), *pointers)
    at_lower, at_upper = (points[side, :d, :m].T for side in (0, 1))
    return found[0, :m], found[1, :m], at_lower, at_upper


@cache
def _samples(n: int) -> tuple[Array, Array]:
    """Samples of one parameter and the n Legendre polynomials there."""
    intervals = 2 * (n - 1) + _SAMPLES
    x: Array = np.cos(np.pi * np.arange(intervals + 1) / intervals) if n > 1 else np.zeros(1)
    return x, np.ascontiguousarray(np.polynomial.legendre.legvander(x, n - 1), dtype=float)


_SOURCE = "\n".join(
    ["#include <stdlib.h>", header("lanes"), (Path(__file__).parent / "dense.h").read_text(encoding="utf-8")]
)
