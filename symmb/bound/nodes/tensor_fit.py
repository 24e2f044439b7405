"""Coefficients of sums of interpolants on tensor grids, and sums of squares of coefficients, in compiled C."""

import ctypes
import itertools
from collections.abc import Sequence
from functools import partial

import numpy as np

from symmb._limits import windows
from symmb._types import Array, Indices
from symmb.bound.nodes.tensor_transform import transform_axes
from symmb.run.codegen import c_source, load, on_threads, with_compiler

Tensor = tuple[Indices, list[Array], int]
"""Rows of the nodes of a tensor grid, a matrix for each parameter, and the factor of its interpolant in the sum."""

_FEW_NUMBERS = 2**16
"""Number of values, or of squared coefficients, up to which NumPy is used: compilation takes longer."""


_SECONDS_PER_COEFFICIENT = 1e-7
"""Largest time for a coefficient of degrees up to 64 [s]."""


class _Tensors(ctypes.Structure):
    """Tensors of c/tensor_fit.h."""

    _fields_ = [
        *((name, ctypes.c_long) for name in ("count", "n", "largest")),
        *((name, ctypes.c_void_p) for name in ("factors", "first_row", "rows", "first_axis")),
        *((name, ctypes.c_void_p) for name in ("lengths", "matrices", "fits")),
    ]
    arrays: tuple[np.ndarray, ...]
    """The arrays to which the pointers point."""


def interpolants(tensors: list[Tensor], blocks: Sequence[Array], rows: Indices) -> Array:
    """Coefficients (N, m) from blocks of values (.., m). `rows` (N,) are the rows of all blocks at the nodes."""
    in_arrays = partial(_array_interpolants, tensors, blocks, rows)
    if blocks[0].shape[1] * len(rows) <= _FEW_NUMBERS:
        return in_arrays()
    return with_compiler(partial(_compiled_interpolants, tensors, blocks, rows), in_arrays)


def group_squares(coefficients: Array, groups: Sequence[Indices]) -> Array:
    """Sums of squares (k, ...) of coefficients (N, ...) over each of k groups of rows."""
    in_arrays = partial(_array_squares, coefficients, groups)
    if coefficients.size <= _FEW_NUMBERS:
        return in_arrays()
    return with_compiler(partial(_compiled_squares, coefficients, groups), in_arrays)


def _compiled_interpolants(tensors: list[Tensor], blocks: Sequence[Array], rows: Indices) -> Array:
    basis = _packed(tensors, len(rows))
    blocks = [np.ascontiguousarray(Y, dtype=float) for Y in blocks]
    at = np.concatenate([Y.ctypes.data + Y.strides[0] * np.arange(len(Y)) for Y in blocks])[rows]  # addresses
    m = blocks[0].shape[1]
    C = np.empty((len(rows), m))
    pointers = [ctypes.c_void_p(a.ctypes.data) for a in (at, C)]
    library = load(_SOURCE, "fit", "squares")

    def work(next_response: ctypes.c_long) -> None:
        if not library.fit(ctypes.byref(basis), ctypes.byref(next_response), ctypes.c_long(m), *pointers):
            raise MemoryError("not enough memory to fit an expansion")

    on_threads(work, m, _SECONDS_PER_COEFFICIENT * C.size)
    return C


def _packed(tensors: list[Tensor], n: int) -> _Tensors:
    """The tensors of n nodes for C. A matrix that several grids share is stored once."""
    rows, fits, factors = zip(*tensors, strict=True)
    axes = [[A for A in each if len(A) > 1] for each in fits]
    used = list(itertools.chain(*axes))
    matrices = {id(A): A for A in used}
    starts = dict(zip(matrices, _ends([A.size for A in matrices.values()])[:-1].tolist(), strict=True))
    arrays = (
        np.array(factors, dtype=float),
        _ends([len(each) for each in rows]),
        np.concatenate(rows).astype(np.int32),
        _ends([len(each) for each in axes]),
        np.array([len(A) for A in used], dtype=int),
        np.array([starts[id(A)] for A in used], dtype=int),
        np.concatenate([np.empty(0), *(A.ravel() for A in matrices.values())]),
    )
    packed = _Tensors(len(tensors), n, max(len(each) for each in rows), *(a.ctypes.data for a in arrays))
    packed.arrays = arrays
    return packed


def _compiled_squares(coefficients: Array, groups: Sequence[Indices]) -> Array:
    C, first = np.ascontiguousarray(coefficients, dtype=float), _ends([len(rows) for rows in groups])
    rows, m = np.concatenate(groups).astype(int), ctypes.c_long(coefficients[0].size)
    sums = np.empty((len(groups), *coefficients.shape[1:]))
    of, begin, numbers, to = (ctypes.c_void_p(a.ctypes.data) for a in (C, first, rows, sums))
    library, count = load(_SOURCE, "fit", "squares"), ctypes.c_long(len(groups))
    library.squares(m, of, count, begin, numbers, to)  # in less time than the start of a thread
    return sums


def _array_interpolants(tensors: list[Tensor], blocks: Sequence[Array], rows: Indices) -> Array:
    """The coefficients of interpolants, without a compiler."""
    coefficients = np.zeros((len(rows), blocks[0].shape[1]))
    for window in windows(coefficients.shape[1], len(rows)):
        values = np.concatenate([Y[:, window] for Y in blocks])[rows]
        for some, fits, factor in tensors:
            coefficients[some, window] += factor * transform_axes(fits, values[some])
    return coefficients


def _array_squares(coefficients: Array, groups: Sequence[Indices]) -> Array:
    """The sums of squares of groups, without a compiler."""
    C = coefficients.reshape(len(coefficients), -1)
    sums = np.empty((len(groups), C.shape[1]))
    for each, rows in zip(sums, groups, strict=True):
        for window in windows(C.shape[1], len(rows)):
            part = C[rows, window]
            each[window] = np.einsum("ij,ij->j", part, part)
    return sums.reshape(-1, *coefficients.shape[1:])


def _ends(sizes: list[int]) -> Indices:
    """Starts of consecutive parts with these sizes, and the end of the last part."""
    return np.array([0, *itertools.accumulate(sizes)], dtype=int)


_SOURCE = c_source("lanes", "tensor_fit")
