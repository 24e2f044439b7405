"""Coefficients of sums of interpolants on tensor grids, and sums of squares of coefficients, in compiled C."""

import ctypes
import itertools
import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from symmb._limits import windows
from symmb._types import Array, Indices
from symmb.run.codegen import c_fields, c_source, load, on_threads, with_compiler

Tensor = tuple[Indices, list[Array], int]
"""Rows of the nodes of a tensor grid, a matrix for each parameter, and the factor of the interpolant in the sum."""

_FEW_NUMBERS = 2**16
"""Up to this number of values or squared coefficients, NumPy is used, because compilation takes longer."""


class _Tensors(ctypes.Structure):
    """Tensors of c/tensor_fit.h."""

    _fields_ = c_fields(
        (ctypes.c_long, "count n largest"), (ctypes.c_void_p, "factors first_row rows first_axis lengths matrices fits")
    )
    arrays: tuple[np.ndarray, ...]
    """The arrays to which the pointers point."""


def transform_axes(matrices: Sequence[Array], Y: Array) -> Array:
    """(A_1 x ... x A_d) Y, the Kronecker product of d matrices (n_k, n_k) applied to Y (n_1 ... n_d, m).

    The cost is d products with small matrices, instead of one product with a matrix of n_1 ... n_d rows.
    """
    block, before = Y, 1
    for A in matrices:
        if len(A) > 1:
            block = A @ block.reshape(before, len(A), -1)
        before *= len(A)
    return block.reshape(before, math.prod(Y.shape) // before)


def interpolants(tensors: list[Tensor], blocks: Sequence[Array], rows: Indices) -> Array:
    """Coefficients (N, m) from blocks of values (.., m). `rows` (N,) are the rows of all blocks for the nodes."""
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
    basis = packed(tensors, len(rows))
    # Addresses of rows are used, because blocks from rounds of runs are too large to copy.
    blocks = [np.ascontiguousarray(Y, dtype=float) for Y in blocks]
    at = np.concatenate([Y.ctypes.data + Y.strides[0] * np.arange(len(Y)) for Y in blocks])[rows]
    m = blocks[0].shape[1]
    C = np.empty((len(rows), m))
    pointers = [ctypes.c_void_p(a.ctypes.data) for a in (at, C)]
    library = load(_SOURCE, "fit", "squares")

    def work(next_response: ctypes.c_long) -> None:
        if not library.fit(ctypes.byref(basis), ctypes.byref(next_response), ctypes.c_long(m), *pointers):
            raise MemoryError("not enough memory to fit an expansion")

    on_threads(work, m, 1e-7 * C.size)  # upper limit of the time [s], for degrees up to 64
    return C


def packed(tensors: list[Tensor], n: int) -> _Tensors:
    """The Tensors of c/tensor_fit.h for n nodes. A matrix of several grids is stored once."""
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
    basis = _Tensors(len(tensors), n, max(len(each) for each in rows), *(a.ctypes.data for a in arrays))
    basis.arrays = arrays
    return basis


def _compiled_squares(coefficients: Array, groups: Sequence[Indices]) -> Array:
    C, first = np.ascontiguousarray(coefficients, dtype=float), _ends([len(rows) for rows in groups])
    rows, m = np.concatenate(groups).astype(int), ctypes.c_long(coefficients[0].size)
    sums = np.empty((len(groups), *coefficients.shape[1:]))
    of, begin, numbers, to = (ctypes.c_void_p(a.ctypes.data) for a in (C, first, rows, sums))
    library, count = load(_SOURCE, "fit", "squares"), ctypes.c_long(len(groups))
    library.squares(m, of, count, begin, numbers, to)  # this takes less time than the start of a thread
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
