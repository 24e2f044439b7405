"""Maps u(w) given by R(u, w) = 0: Newton's method for many samples at once, and Taylor coefficients of the maps.

The matrices of all samples have the same sparsity pattern, so all samples have the same block-triangular form.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from symmb._magnitudes import SAME, SMALL
from symmb._types import Array, Indices, Mask
from symmb.declare.symbolic import batch, jet_function, nonzeros

LAST_DIGITS = 4e-15
"""Relative change of the unknowns that changes the residual by rounding only."""


@dataclass(frozen=True, eq=False)
class _Block:
    """Equations that determine an equal number of unknowns after the unknowns of earlier blocks are known.

    `own` are the indices of the matrix entries at (`i`, `j`) of the block. `others` are the indices of the remaining
    entries in its rows. These entries multiply the unknowns with the indices `unknowns`, and `sums` (n, k) adds the
    products by row.
    """

    rows: Indices
    columns: Indices
    own: Indices
    i: Indices
    j: Indices
    others: Indices
    unknowns: Indices
    sums: Array

    def solve(self, A: Array, r: Array) -> Array:
        """Unknowns (N, k) for entries A (N, n_entries) and right sides r (N, k)."""
        k = len(self.rows)
        if k == 1:
            a = A[:, self.own]
            return np.divide(r, a, out=np.zeros_like(r), where=a != 0)
        if k > 100:  # large blocks are sparse; smaller ones are faster with dense factors of all samples together
            return np.array([self._by_sparse_factors(a, b) for a, b in zip(A[:, self.own], r, strict=True)])
        matrices = np.zeros((len(A), k, k))
        matrices[:, self.i, self.j] = A[:, self.own]
        try:
            return np.asarray(np.linalg.solve(matrices, r[:, :, None])[:, :, 0], dtype=np.float64)
        except np.linalg.LinAlgError:  # a singular sample must not affect other samples
            return np.array([_least_squares(a, b) for a, b in zip(matrices, r, strict=True)])

    def _by_sparse_factors(self, entries: Array, r: Array) -> Array:
        from scipy.sparse import csc_array  # this import takes longer than a study of a small scene
        from scipy.sparse.linalg import splu

        matrix = csc_array((entries, (self.i, self.j)), (len(r), len(r)))
        try:
            return np.asarray(splu(matrix).solve(r), dtype=np.float64)
        except RuntimeError:  # singular
            return _least_squares(matrix.toarray(), r)


def _least_squares(A: Array, r: Array) -> Array:
    return np.asarray(np.linalg.lstsq(A, r, rcond=None)[0], dtype=np.float64)


class _BlockSolver:
    """Solver of A x = r by the block-triangular form of the sparsity pattern of A (n, n)."""

    def __init__(self, sparsity: ca.Sparsity) -> None:
        n = self._n = sparsity.size1()
        row, column = (np.array(indices, dtype=np.intp) for indices in sparsity.get_triplet())
        self._row = row
        self._blocks: list[_Block] = []
        if not n:
            return
        if ca.sprank(ca.DM(sparsity, 1)) == n:
            _, rows, columns, starts, *_ = sparsity.btf()
        else:  # structurally singular
            rows, columns, starts = [*range(n)], [*range(n)], [0, n]
        place = np.argsort(np.array(columns, dtype=np.intp))
        in_row = np.argsort(np.array(rows, dtype=np.intp))
        of_row = np.searchsorted(starts, in_row[row], side="right") - 1
        counts = np.bincount(of_row, minlength=len(starts) - 1)
        by_block = np.split(np.argsort(of_row, kind="stable"), np.cumsum(counts)[:-1])
        for begin, end, entries in zip(starts[:-1], starts[1:], by_block, strict=True):
            inside = place[column[entries]] >= begin
            own, others = entries[inside], entries[~inside]
            sums = np.zeros((len(others), end - begin))
            sums[np.arange(len(others)), in_row[row[others]] - begin] = 1.0
            self._blocks.append(
                _Block(
                    rows=np.array(rows[begin:end], dtype=np.intp),
                    columns=np.array(columns[begin:end], dtype=np.intp),
                    own=own,
                    i=in_row[row[own]] - begin,
                    j=place[column[own]] - begin,
                    others=others,
                    unknowns=column[others],
                    sums=sums,
                )
            )

    def solve(self, A: Array, r: Array) -> Array:
        """Solutions x (N, n) of N linear systems: matrices with entries A (N, n_entries), and right sides r (N, n)."""
        x = np.zeros_like(r)
        for block in self._blocks:
            right = r[:, block.rows]
            if len(block.others):
                right = right - (A[:, block.others] * x[:, block.unknowns]) @ block.sums
            x[:, block.columns] = block.solve(A, right)
        return x

    def row_sizes(self, A: Array) -> Array:
        """Sums of absolute entries of each row, (N, n)."""
        sizes = np.zeros((self._n, len(A)))
        np.add.at(sizes, self._row, np.abs(A).T)
        return sizes.T


@dataclass(frozen=True)
class ImplicitMap:
    """The solution u (m,) of m equations R(u, w) = 0 near a known solution."""

    residual: ca.Function
    jacobian: ca.Function

    @classmethod
    def of(cls, residual: ca.SX, u: ca.SX, w: ca.SX) -> "ImplicitMap":
        """The map for a residual (m,), an SX of the unknowns u (m,) and the arguments w (n_w,)."""
        # With more symbols, the search for common subexpressions takes longer than it saves.
        options = {"cse": len(ca.symvar(residual)) <= 40}
        return cls(
            ca.Function("residual", [u, w], [ca.densify(residual)], options),
            ca.Function("jacobian", [u, w], [ca.jacobian(residual, u)], options),
        )

    def solve(self, w: Array, iterations: int = 30) -> tuple[Array, Mask]:
        """Solutions (N, m) for arguments w (N, n_w) by Newton's method from u = 0, and whether it converged (N,)."""
        m = self.residual.numel_in(0)
        u = np.zeros((len(w), m))
        active = np.arange(len(w))
        ok = np.zeros(len(w), dtype=bool)
        for _ in range(iterations):
            r, J = batch(self.residual, u[active], w[active])[0], nonzeros(self.jacobian, u[active], w[active])
            finite = np.isfinite(r).all(axis=1) & np.isfinite(J).all(axis=1)
            active, r, J = active[finite], r[finite], J[finite]
            if not active.size:
                break
            step = self._blocks.solve(J, r)
            u[active] -= step
            # Quadratic convergence: a step below 1e-9 leaves an error at rounding level.
            done = np.abs(step).max(axis=1, initial=0.0) <= SAME * np.maximum(
                np.abs(u[active]).max(axis=1, initial=0.0), SMALL
            )
            # Close to singular positions, rounding of the residual causes steps that never become small.
            done = done | (np.abs(r) <= LAST_DIGITS * self._blocks.row_sizes(J)).all(axis=1)
            ok[active[done]] = True
            active = active[~done]
            if not active.size:
                break
        return u, ok

    @cached_property
    def _blocks(self) -> _BlockSolver:
        return _BlockSolver(self.jacobian.sparsity_out(0))

    def jets(self, u0: Array, w: Sequence[Array]) -> list[Array]:
        """Taylor coefficients u_0, ..., u_k along the curves with coefficients w_0, ..., w_k, each (N, n_w)."""
        order = len(w) - 1
        coefficients = jet_function(self.residual, order + 1)
        J = nonzeros(self.jacobian, u0, w[0])
        u = [u0, *(np.zeros_like(u0) for _ in range(order))]
        for j in range(1, order + 1):  # coefficient j of R is linear in u_j with the Jacobian of order 0
            u[j] = -self._blocks.solve(J, batch(coefficients, *u, *w)[j])
        return u
