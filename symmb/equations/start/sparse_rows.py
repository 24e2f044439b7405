"""Sparse factors for the rows of large scenes: pivot columns, and least-norm solutions."""

from collections import defaultdict
from collections.abc import Callable
from heapq import heapify, heappop, heappush

import casadi as ca
import numpy as np

from symmb._types import Array, Indices
from symmb.equations.start.residual_limits import SOLVED

LARGE = 150
"""From this number of rows or columns on, sparse factors are faster than dense factors. tests/benchmarks/scaling.py"""


def pivot_columns(A: Array, smallest_pivot: float = 1e-5, pivot_threshold: float = 0.3) -> Indices | None:
    """Indices of the m pivot columns of the unit rows of A (m, n), in ascending order.

    Each step of Gaussian elimination takes the row with the fewest entries. The pivot has at least the fraction
    `pivot_threshold` of the largest entry of its row: larger fractions are more stable, but cause more fill-in. Returns
    None if a pivot is below `smallest_pivot` or above its reciprocal. By default, pivots have about six correct digits.
    """
    rows = {i: {int(k): float(row[k]) for k in np.flatnonzero(row)} for i, row in enumerate(A)}
    holders: dict[int, set[int]] = defaultdict(set)
    for i, row in rows.items():
        for k in row:
            holders[k].add(i)
    queue = [(len(row), i) for i, row in rows.items()]
    heapify(queue)
    pivots = []
    while rows:
        count, i = heappop(queue)
        if count != len(rows.get(i, ())):
            continue
        row = rows.pop(i)
        for k in row:
            holders[k].remove(i)
        largest = max(map(abs, row.values()), default=0.0)
        if not smallest_pivot < largest < 1 / smallest_pivot:
            return None
        candidates = [k for k, a in row.items() if abs(a) >= pivot_threshold * largest]
        # Markowitz: among stable pivots, the column with the fewest entries causes the least fill-in.
        pivot = min(candidates, key=lambda k: (len(holders[k]), -abs(row[k])))
        pivots.append(pivot)
        for j in holders.pop(pivot):
            other = rows[j]
            factor = other.pop(pivot) / row[pivot]
            for k, a in row.items():
                if k != pivot:
                    if k not in other:
                        holders[k].add(j)
                    other[k] = other.get(k, 0.0) - factor * a
            heappush(queue, (len(other), j))
    return np.sort(np.array(pivots, dtype=np.intp))


def normal_solver(A: Array, rank_tolerance: float = 1e-11) -> Callable[[Array], Array] | None:
    """Solver of A A' z = r for a large sparse matrix A (m, n); None if the rows are not independent.

    The rows count as independent if the ratio of the smallest to the largest pivot of A A' is above `rank_tolerance`.
    By default, a solution has about five correct digits, and one step of iterative refinement doubles this number.
    """
    if not LARGE < A.shape[0] <= A.shape[1]:
        return None
    i, k = np.nonzero(A)
    rows = ca.DM.triplet(i.tolist(), k.tolist(), ca.DM(A[i, k]), A.shape[0], A.shape[1])
    D, L, order = ca.ldl(ca.mtimes(rows, rows.T), True)
    pivots = D.full()
    if not pivots.min() > rank_tolerance * pivots.max():
        return None

    def solve(r: Array) -> Array:
        z = ca.ldl_solve(ca.DM(r), D, L, order)
        rest = ca.DM(r) - ca.mtimes(rows, ca.mtimes(rows.T, z))
        return (z + ca.ldl_solve(rest, D, L, order)).full().ravel()

    return solve


def least_step(A: Array, r: Array) -> Array:
    """The least-norm step (n,) with A step = r; the least-squares step if rows of A (m, n) depend on each other."""
    if (solve := normal_solver(A)) is not None:
        return np.asarray(A.T @ solve(r), dtype=np.float64)
    return np.asarray(np.linalg.lstsq(A, r, rcond=SOLVED)[0], dtype=np.float64)
