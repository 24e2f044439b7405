"""Evaluation of CasADi Functions for many samples at once, with arrays that are not copied into CasADi's matrices."""

from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache

import casadi as ca
import numpy as np

from symmb._types import Array, Indices, Mask


@lru_cache(maxsize=256)
def _mapped(f: ca.Function, n: int, threads: int) -> ca.Function:
    return f.map(n, "thread", threads) if threads > 1 else f.map(n)


@lru_cache(maxsize=256)
def _sizes(f: ca.Function) -> tuple[list[int], list[int]]:
    """Numbers of nonzero entries of each input and of each output."""
    return [f.numel_in(i) for i in range(f.n_in())], [f.nnz_out(i) for i in range(f.n_out())]


@lru_cache(maxsize=256)
def _layout(f: ca.Function, i: int) -> tuple[int, int, Indices | None]:
    """Rows and columns of output i, and the indices of its entries in dense column-major form (None if dense)."""
    sparsity = f.sparsity_out(i)
    where = None if sparsity.is_dense() else np.array(sparsity.find(), dtype=np.intp)
    return sparsity.size1(), sparsity.size2(), where


def batch(f: ca.Function, *arguments: Array, threads: int = 1) -> tuple[Array, ...]:
    """Evaluate f for N samples. Outputs are dense: (N, m) for columns and (N, m, k) for matrices.

    The inputs of f are vectors. Arguments are (N, n) arrays, or (n,) arrays for all samples; the last arguments may be
    left out. `threads` is the number of CasADi's threads. Raises RuntimeError if f fails for a sample.
    """
    return tuple(_shaped(f, i, values) for i, values in enumerate(_results(f, arguments, threads)))


def batch_padded(f: ca.Function, *arguments: Array) -> tuple[Array, ...]:
    """`batch` with arguments (N, n) padded to a power of 2, because CasADi stores a map for each N."""
    N = len(arguments[0])
    if N < 2:
        return batch(f, *arguments)
    rows = np.minimum(np.arange(1 << (N - 1).bit_length()), N - 1)
    return tuple(values[:N] for values in batch(f, *[a[rows] for a in arguments]))


def evaluated(f: ca.Function, *arguments: Array) -> Array:
    """The first result of f, dense (m, k), for one set of arguments."""
    values = batch(f, *arguments)[0]
    return values.T if f.size2_out(0) == 1 else values[0]


def pattern(sparsity: ca.Sparsity) -> Mask:
    """Mask (m, k) of the structural entries of a matrix."""
    there = np.zeros(sparsity.shape, dtype=bool)
    there[tuple(np.array(sparsity.get_triplet(), dtype=np.intp))] = True
    return there


def nonzeros(f: ca.Function, *arguments: Array) -> Array:
    """The structural entries (N, n) of the first result of f, in the order of its sparsity pattern."""
    return _results(f, arguments, 1)[0]


def _results(f: ca.Function, arguments: Sequence[Array], threads: int) -> list[Array]:
    """The structural entries (N, n) of each output."""
    N = max((len(a) for a in arguments if a.ndim == 2), default=1)
    widths, counts = _sizes(f)
    results = [np.zeros((N, count)) for count in counts]
    shapes = [(N, width) for width in widths[: len(arguments)]]
    arrays = [a if a.shape == shape else np.broadcast_to(a, shape) for a, shape in zip(arguments, shapes, strict=True)]
    _evaluate(_mapped(f, N, threads) if N > 1 else f, arrays, results)
    return results


def so_far(f: ca.Function, *arguments: Array) -> tuple[Array, ...]:
    """The results of `batch` for one sample; nan for entries that f has not written before a failure."""
    results = [np.full((1, f.nnz_out(i)), np.nan) for i in range(f.n_out())]
    with suppress(RuntimeError):
        _evaluate(f, arguments, results)
    return tuple(_shaped(f, i, values) for i, values in enumerate(results))


def _evaluate(f: ca.Function, arguments: Sequence[Array], results: list[Array]) -> None:
    """Evaluate f and write into `results`. The arrays are contiguous, in the order of the nonzeros."""
    buffer, evaluate = f.buffer()
    inputs: list[Array] = [np.ascontiguousarray(a, dtype=float) for a in arguments]  # the buffer stores only addresses
    for i, a in enumerate(inputs):
        if a.size:
            buffer.set_arg(i, memoryview(a.reshape(-1)))  # pyright: ignore[reportCallIssue, reportArgumentType]
    for i, values in enumerate(results):
        if values.size:
            buffer.set_res(i, memoryview(values.reshape(-1)))  # pyright: ignore[reportCallIssue, reportArgumentType]
    evaluate()
    if buffer.ret():
        raise RuntimeError(f"evaluation of {f.name()!r} failed")


def _shaped(f: ca.Function, i: int, values: Array) -> Array:
    rows, columns, where = _layout(f, i)
    if where is not None:
        dense = np.zeros((len(values), rows * columns))
        dense[:, where] = values
        values = dense
    return values if columns == 1 else values.reshape(len(values), columns, rows).swapaxes(1, 2)
