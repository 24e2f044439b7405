"""The rank of the constraint rows at the start, and the joints with dependent rows."""

from collections.abc import Iterator, Mapping
from typing import cast

import casadi as ca
import numpy as np

from symmb._errors import AssemblyError
from symmb._magnitudes import SLIGHT
from symmb._types import Array, Indices
from symmb.equations.model import DAE
from symmb.equations.start.residual_limits import SOLVED
from symmb.equations.start.scales import above_zero, evaluate_at_rest, jacobian_at_rest, own_scales, resting, row_sizes
from symmb.equations.start.sparse_rows import LARGE, least_step, pivot_columns

_AS_INDEPENDENT = 0.3
"""Chosen rows suffice if their smallest singular value, divided by the smallest one of all rows, is above this ratio.
The ratio stays above 0.5 in planar loops of spatial bodies, and decreases to 0 in Bricard's mechanism.
test_redundancy.py"""


def independent_rows_and_columns(
    A: Array, sizes: Array | None = None, rank: int | None = None
) -> tuple[Indices, Indices]:
    """Indices of independent rows and of as many pivot columns, from pivoted QR of the scaled matrix.

    `sizes` (m,) are the sizes of the rows, by default their norms. If `rank` is None, the rank is computed.
    """
    if not A.size:
        return np.arange(0, dtype=np.intp), np.arange(0, dtype=np.intp)
    scaled = A / above_zero(np.linalg.norm(A, axis=1) if sizes is None else sizes)[:, None]
    if min(A.shape) > LARGE and (columns := pivot_columns(scaled)) is not None:
        return np.arange(len(A), dtype=np.intp), columns
    if rank is None:
        rank = int(np.linalg.matrix_rank(scaled, tol=SOLVED * max(A.shape)))
    rows = np.arange(len(A), dtype=np.intp) if rank == len(A) else _pivots(scaled.T, rank)
    return rows, _pivots(scaled[rows], rank)


def strong_rows(A: Array, weakest: float) -> Indices:
    """Indices of independent rows of A (norms up to 1), as many as A has singular values above `weakest`."""
    if not A.size:
        return np.arange(0, dtype=np.intp)
    sigma = np.linalg.svd(A, compute_uv=False)
    return _pivots(A.T, int((sigma > max(weakest, SOLVED * max(A.shape))).sum()))


def _pivots(B: Array, rank: int) -> Indices:
    """Indices of independent columns of B in ascending order, by Gram-Schmidt with pivoting.

    The import of SciPy's pivoted QR takes longer than a study of a small scene.
    """
    remainder, pivots = B.copy(), []
    for _ in range(rank):
        k = int(np.einsum("ij,ij->j", remainder, remainder).argmax())
        pivots.append(k)
        q = remainder[:, k] / np.linalg.norm(remainder[:, k])
        remainder -= np.outer(q, q @ remainder)
        remainder[:, k] = 0.0
    return np.sort(np.array(pivots, dtype=np.intp))


def vanishing_combinations(G: Array, rank: int) -> Array:
    """Orthonormal combinations (n_r, n_r - rank) of the rows of G that vanish."""
    return np.linalg.svd(G)[0][:, rank:]


def redundant_names(G: Array, rank: int, rows: Mapping[str, slice]) -> tuple[str, ...]:
    """Names of the constraints with dependent rows in G. The rows are divided by their sizes."""
    involved = np.abs(vanishing_combinations(G, rank)).max(axis=1, initial=0.0) > SLIGHT
    return tuple(name for name, where in rows.items() if involved[where].any())


def independent_rows(dae: DAE, q: Array, t0: float, sizes: Array) -> Indices:
    """Indices of independent rows of the velocity Jacobian at the start.

    The Jacobian is measured in the DAE's scales, and its rows in `sizes` (n_r,). Raises AssemblyError at a singular
    position: rows depend on each other at q (n_q,), but not close to q.
    """
    G = jacobian_at_rest(dae, q, t0) * dae.displacement_scales
    rows, _ = independent_rows_and_columns(G, sizes)
    if len(rows) == dae.n_r:
        return rows
    for position in _positions(dae, q, t0, sizes, len(rows)):
        there = jacobian_at_rest(dae, position, t0) * dae.displacement_scales
        rank = len(independent_rows_and_columns(there, sizes)[0])
        if rank > len(rows):
            names = ", ".join(map(repr, redundant_names(G / sizes[:, None], len(rows), dae.rows)))
            raise AssemblyError(
                "The start is a singular position, from which the motion can continue in more than one way. The rows "
                f"of {names} depend on each other: the rank of the {dae.n_r} constraint rows is {len(rows)} at the "
                f"start, but {rank} close to the start. Start away from this position."
            )
    return rows


def lasting_rows(dae: DAE, q: Array, t0: float, rows: Indices, general: Array) -> tuple[Indices, tuple[int, int]]:
    """Rows to keep, and two numbers of vanishing combinations: of these rows, and of their position rows.

    The given independent rows are kept if they stay as independent as all rows along the possible motion from q (n_q,).
    If they do not, only rows that are superfluous at all positions are removed, so that few combinations vanish.
    `general` (n_r, n_v) are sizes of the entries of the Jacobian. The size of a row is the same at all positions,
    because the row may vanish at some position.
    """
    scales, rank = own_scales(dae, q, t0), len(rows)
    if not rank:
        return rows, (0, 0)
    usual = np.linalg.norm(general * scales, axis=1)
    # With 15 long steps, a mechanism with one degree of freedom makes two turns forward and back.
    at = [q, *_positions(dae, q, t0, usual, rank, walks=2, steps=15, distance=0.3)]
    walked = np.stack([jacobian_at_rest(dae, position, t0) * scales for position in at])
    walked /= row_sizes(walked, general * scales)[:, None]
    # Bricard's mechanism: rows that are independent at the start become dependent later, so all positions are compared.
    if all(_least(G[rows], rank) > _AS_INDEPENDENT * _least(G, rank) for G in walked):
        return rows, (0, 0)
    vanishing = np.array([vanishing_combinations(G, rank) for G in walked])
    sufficient = np.setdiff1d(np.arange(dae.n_r), _superfluous(vanishing))
    of_positions = sufficient[sufficient < dae.n_c]
    of_rank, _ = independent_rows_and_columns(walked[0, of_positions], np.ones(len(of_positions)))
    return sufficient, (len(sufficient) - rank, len(of_positions) - len(of_rank))


def _superfluous(N: Array) -> list[int]:
    """Rows that can be removed together, from orthonormal combinations (n, n_r, k) that vanish at n positions.

    Removal reduces the smallest singular value at most by the smallest singular value of the removed part of the
    combinations.
    """
    rows: list[int] = []
    rest = N
    while len(rows) < N.shape[2]:
        lengths = np.linalg.norm(rest, axis=2).min(axis=0)
        row = int(np.argmax(lengths))
        # A row is superfluous only if its part of the vanishing combinations is large at all positions.
        if not np.linalg.svd(N[:, [*rows, row]], compute_uv=False)[:, -1].min() > _AS_INDEPENDENT:
            break
        rows.append(row)
        along = rest[:, row] / np.linalg.norm(rest[:, row], axis=1, keepdims=True)
        rest = rest - (rest @ along[:, :, None]) * along[:, None]
    return rows


def _least(G: Array, rank: int) -> float:
    """The smallest nonzero singular value of a matrix of this rank."""
    return float(np.linalg.svd(G, compute_uv=False)[rank - 1])


def _positions(
    dae: DAE, q: Array, t0: float, sizes: Array, rank: int, walks: int = 3, steps: int = 1, distance: float = 0.02
) -> Iterator[Array]:
    """Positions that satisfy the constraints, on random walks from q (n_q,) with steps of a distance [rad, fraction of
    the size].

    `rank` is the rank of all rows in their sizes (n_r,). The rows of drives do not restrict the walks, because drives
    move the system.
    """
    # Rows of drives require velocities even for a system at rest.
    symbols = ca.SX.sym("q", dae.n_q), ca.SX.sym("p", len(dae.p_nominal)), ca.SX.sym("t")
    rates = ca.sparsify(cast(ca.Function, dae.Phi_dot)(*resting(dae, *symbols[:2]), *symbols[1:]))
    held, scale = np.setdiff1d(np.arange(dae.n_r), rates.row()), own_scales(dae, q, t0)
    own, of_positions = above_zero(sizes)[held, None], int((held < dae.n_c).sum())

    def rows_at(position: Array) -> Array:
        return jacobian_at_rest(dae, position, t0)[held] * scale / own

    if len(held) < dae.n_r:
        rank = len(independent_rows_and_columns(rows_at(q), np.ones(len(held)))[0])
    random = np.random.default_rng(0)
    for _ in range(walks):
        position, step = q, np.zeros(dae.n_v)
        for _ in range(steps):
            free = np.linalg.svd(rows_at(position))[2][rank:]
            if not len(free):
                return
            # Each step mostly follows the step before. Without this persistence, a walk would stay near its start.
            step = (3.0 * (free @ step) + random.normal(size=len(free))) @ free
            step /= np.abs(step).max()
            position = np.asarray(dae.retract(position, distance * scale * step)).ravel()
            for _ in range(5 if of_positions else 0):
                r = evaluate_at_rest(cast(ca.Function, dae.Phi), dae, position, t0).ravel()[held[:of_positions]]
                back = least_step(rows_at(position)[:of_positions], -r / own[:of_positions, 0])
                position = np.asarray(dae.retract(position, scale * back)).ravel()
            yield position
