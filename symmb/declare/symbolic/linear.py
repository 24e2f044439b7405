"""Symbolic solution of M a + G' lam = f, G a = g in range space. Bodies without mass get inertia from constraints."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import casadi as ca
import numpy as np

from symmb._magnitudes import NOTHING, SMALL
from symmb._types import Array
from symmb.declare.symbolic.batch import pattern
from symmb.declare.symbolic.geometry import is_zero


class MassBlocks:
    """Inverse of a regular block-diagonal matrix, block by block.

    The block of a flexible body is an arrow matrix with a diagonal modal part. The modal part is eliminated first, so
    the factors stay sparse.
    """

    def __init__(self, M: ca.SX, sizes: Sequence[int]) -> None:
        self._blocks: list[tuple[slice, ca.SX | Callable[[ca.SX], ca.SX]]] = []
        at = 0
        for n in sizes:
            block = ca.sparsify(M[at : at + n, at : at + n])
            if block.sparsity().is_diag():
                inverse = ca.sparsify(ca.diag(1 / ca.diag(block)))
            else:
                inverse = ca.sparsify(ca.inv_minor(block)) if n <= 6 else symmetric_solver(block)
            self._blocks.append((slice(at, at + n), inverse))
            at += n

    def __call__(self, f: ca.SX) -> ca.SX:
        """The product M^-1 f (n_v,)."""
        parts = [inverse(f[at, :]) if callable(inverse) else inverse @ f[at, :] for at, inverse in self._blocks]
        return ca.vertcat(*parts)

    def right(self, G: ca.SX) -> ca.SX:
        """The product G M^-1 (n_c, n_v)."""
        parts = []
        for at, inverse in self._blocks:
            rows = G[:, at]
            if isinstance(inverse, ca.SX):
                parts.append(rows @ inverse)
                continue
            parts.append(ca.SX(*rows.shape))
            for i in range(rows.shape[0]):
                if not is_zero(rows[i, :]):
                    parts[-1][i, :] = inverse(rows[i, :].T).T
        return ca.sparsify(ca.horzcat(*parts))


def is_singular(M: ca.SX, sizes: Sequence[int]) -> bool:
    """Whether a block of a block-diagonal matrix is structurally singular."""
    starts = [sum(sizes[:k]) for k in range(len(sizes))]
    blocks = [ca.sparsify(M[at : at + n, at : at + n]) for at, n in zip(starts, sizes, strict=True)]
    return any(ca.sprank(block) < block.shape[0] for block in blocks)


def symmetric_solver(S: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """Solver of S z = r for a sparse positive definite S (n, n), by LDL' with a fill-reducing order."""
    # Only one triangle is used, because an entry that cancels to 0 in one triangle may be rounding in the other.
    D, L, order = ca.ldl(ca.triu2symm(ca.triu(ca.sparsify(S))), True)
    return lambda r: ca.densify(ca.ldl_solve(ca.densify(r), D, L, order))


_LIFT = 1e-10
"""Fraction of the diagonal that is added to a singular matrix: far above the rounding of its factors, and far below its
nonzero eigenvalues. One refinement squares the relative error. tests/symbolic/test_linear.py"""


def singular_solver(S: ca.SX, nullity: int, usual: ca.SX | None = None) -> Callable[[ca.SX], ca.SX]:
    """Solver of S z = r for a semidefinite S (n, n), which is treated as a matrix of rank n - nullity.

    Inverse iteration gives vanishing combinations of rows, which are removed from right sides and solutions. Rows
    are scaled by the diagonal, so units have no effect. Rows that vanish at some states are scaled by their `usual`
    relative sizes (n,), by default equal.
    """
    size = _row_sizes(ca.diag(S), usual)
    scaled = ca.sparsify(ca.diag(1 / size) @ S @ ca.diag(1 / size))
    lifted = symmetric_solver(scaled + _LIFT * ca.SX.eye(S.shape[0]))
    N = _vanishing(lifted, S.shape[0], nullity)

    def regular_part(r: ca.SX) -> ca.SX:
        return r - N @ (N.T @ r)

    def solve(r: ca.SX) -> ca.SX:
        right = regular_part(r / size)
        z = regular_part(lifted(right))
        return ca.densify((z + regular_part(lifted(regular_part(right - scaled @ z)))) / size)

    return solve


def vanishing_rows(G: ca.SX, nullity: int, usual: ca.SX | None = None) -> ca.SX:
    """Combinations (n_r, nullity) of the rows of G that vanish at states with rank n_r - nullity.

    Rows that vanish at some states are scaled by their `usual` relative sizes (n_r,), by default equal.
    """
    size = _row_sizes(ca.sum2(G * G), usual)
    rows = ca.sparsify(ca.diag(1 / size) @ G)
    lifted = symmetric_solver(ca.sparsify(rows @ rows.T) + _LIFT * ca.SX.eye(G.shape[0]))
    return ca.diag(1 / size) @ _vanishing(lifted, G.shape[0], nullity)


def least_multipliers(G: ca.SX, force: ca.SX, units: ca.SX) -> ca.SX:
    """Least-norm multipliers lam (n_r,) with G' lam = force (n_v,), for G of any rank, if a solution exists.

    The norm is computed from the multipliers divided by their `units` (n_r,).
    """
    G = ca.sparsify(ca.diag(units) @ G)
    size = ca.sqrt(ca.sum1(G * G).T + NOTHING)  # not 0 for velocities without rows
    columns = ca.sparsify(G @ ca.diag(1 / size))
    S, right = ca.sparsify(columns.T @ columns), force / size
    lifted = symmetric_solver(S + _LIFT * ca.SX.eye(S.shape[0]))
    z = lifted(right)
    return ca.densify(units * (columns @ (z + lifted(right - S @ z))))


def gated_solver(S: ca.SX, gates: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """Solver of S z = r for a semidefinite S (n, n), in which rows and columns with gates (n,) of 0 are zero.

    z is 0 in these rows. Rows with a gate of 1 may depend on other rows. So a small fraction of the diagonal is added,
    and z is refined once.
    """
    gated = ca.DM([float(not gates[k].is_constant()) for k in range(gates.numel())])
    lifted = symmetric_solver(S + ca.diag(1 - gates + _LIFT * gated * ca.diag(S)))

    def solve(r: ca.SX) -> ca.SX:
        # Rows of open joints have 1 on the diagonal, so that the matrix stays regular and z is 0 there.
        z = lifted(r)
        return z + lifted(r - S @ z - (1 - gates) * z)

    return solve


def _row_sizes(squares: ca.SX, usual: ca.SX | None) -> ca.SX:
    """Sizes (n,) of rows from their squares, which may vanish, and from their relative usual sizes."""
    shares = ca.SX.ones(squares.numel()) if usual is None else usual**2
    # Rows that vanish temporarily are scaled by their usual size. Dependent rows are dependent only up to the drift of
    # a run, and a division by smaller sizes would amplify this drift. Bennett's linkage needs 1e-4: with 1e-6 its drift
    # is larger by a factor of a thousand. tests/start/test_redundancy.py
    return ca.sqrt(squares + SMALL * ca.sum1(squares) * shares / ca.sum1(shares))


def independent(rows: ca.SX, multipliers: ca.SX, vanishing: ca.SX) -> ca.SX:
    """Rows (n,) plus the part of their multipliers (n,) in the `vanishing` combinations (n, k).

    The sum is zero only if the rows are zero and the multipliers have no part in these combinations.
    """
    N = ca.horzcat(*_orthonormal(ca.horzsplit(vanishing)))
    return rows + N @ (N.T @ multipliers)


def _vanishing(lifted: Callable[[ca.SX], ca.SX], n: int, nullity: int) -> ca.SX:
    """Orthonormal vanishing combinations (n, nullity), by two steps of inverse iteration with a lifted matrix."""
    # These vectors have no symmetry, so they are not orthogonal to vanishing combinations.
    columns = [ca.SX(ca.DM(np.cos((j + 1) * np.arange(1, n + 1) ** 1.5))) for j in range(nullity)]
    # Each step multiplies the other eigenvectors by about _LIFT. After two steps only rounding errors remain.
    for _ in range(2):
        columns = _orthonormal([_LIFT * lifted(column) for column in columns])
    return ca.horzcat(*columns)


def _orthonormal(columns: Sequence[ca.SX]) -> list[ca.SX]:
    """Orthonormal columns with the same span, by the modified Gram-Schmidt method. Columns may be nearly parallel."""
    basis: list[ca.SX] = []
    for column in columns:
        # Cancellation in nearly parallel columns reduces the orthogonality. A second pass restores it.
        for _ in range(2 if basis else 1):
            column = column / ca.norm_2(column)
            for other in basis:
                column = column - other * ca.dot(other, column)
        basis.append(column / ca.norm_2(column))
    return basis


def general_solver(A: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """Solver of A z = r for a sparse regular A (n, n), by QR, without pivots that differ between samples."""
    factors = ca.qr_sparse(A)
    return lambda r: ca.densify(ca.qr_solve(ca.densify(r), *factors))


class ExplicitSolver:
    """Solver of A z = r for a regular A (n, n) and r (n, m), by determinants of small blocks.

    Blocks of equations are solved one after the other. Large blocks are halved. `at` (n, n) are values of A at one
    point. These values order the rows so that both halves are regular at this point. A positive definite A needs no
    order. A is regular, and solutions are exact, if no entry of `determinants` (k,) is 0. If the right side is 0, the
    solution may be finite although A is singular.
    """

    def __init__(self, A: ca.SX, at: Array | None = None) -> None:
        self._A, n = ca.sparsify(A), A.shape[0]
        self._blocks: list[tuple[list[int], list[int], ca.SX]] = []
        determinants = []
        if n and ca.sprank(self._A) < n:
            self.determinants = ca.SX(0)
            return
        _, rows, columns, starts, *_ = self._A.sparsity().btf() if n else (0, [], [], [0])
        for i, j in pairwise(starts):
            own, of = rows[i:j], columns[i:j]
            if at is not None:
                own = [own[k] for k in _order(at[np.ix_(own, of)])]
            inverse, parts = _halved(ca.densify(self._A[own, of]))
            self._blocks.append((own, of, inverse))
            determinants += parts
        self.determinants = ca.vertcat(ca.SX(0, 1), *determinants)

    def __call__(self, r: ca.SX) -> ca.SX:
        """The solution z (n, m); nan for a structurally singular A."""
        z = ca.SX.zeros(*r.shape) if self._blocks else ca.SX.nan(*r.shape)
        for own, of, inverse in self._blocks:
            z[of, :] = inverse @ (r[own, :] - self._A[own, :] @ z)
        return z


def _order(A: Array) -> list[int]:
    """The order of the rows in Gaussian elimination with pivoting."""
    from scipy.linalg import lu_factor

    order = list(range(len(A)))
    # LAPACK returns successive exchanges of rows, not a permutation.
    for i, j in enumerate(lu_factor(A)[1]):
        order[i], order[j] = order[j], order[i]
    return order


def _halved(A: ca.SX) -> tuple[ca.SX, list[ca.SX]]:
    """The inverse of A (n, n) and its determinants. A large A is inverted by a part and its Schur complement."""
    n = A.shape[0]
    if n <= 3:  # small blocks are inverted by their determinant
        return ca.inv_minor(A), [ca.det(A)]
    k = n // 2
    a, b, c, d = A[:k, :k], A[:k, k:], A[k:, :k], A[k:, k:]
    first, determinants = _halved(a)
    right, below = first @ b, c @ first
    last, others = _halved(d - below @ b)
    inverse = ca.blockcat([[first + right @ last @ below, -right @ last], [-last @ below, last]])
    return inverse, [*determinants, *others]


def least_factorization(G: ca.Function) -> int:
    """Lower bound of the number of operations of `saddle_solver`, from the sparsity of the factors for G (n_c, n_v)."""
    pattern = ca.DM(G.sparsity_out(0), 1)
    factor = (pattern @ pattern.T).sparsity().ldl()[0]
    return int((np.diff(factor.colind()) ** 2).sum())


def saddle_solver(
    M: ca.SX,
    G: ca.SX,
    sizes: Sequence[int],
    coupled: bool = False,
    nullity: int = 0,
    gates: ca.SX | None = None,
    usual: ca.SX | None = None,
) -> Callable[[ca.SX, ca.SX], tuple[ca.SX, ca.SX]]:
    """Solver (f (n_v,), g (n_c,)) -> (a (n_v,), lam (n_c,)) of constrained motion. The matrix is factorised once.

    Range-space method: the sparse S = G M^-1 G' is factorised by LDL' with a fill-reducing order. M (n_v, n_v) has
    diagonal blocks with the given `sizes`. If a block is structurally singular, as for a massless body, M + G'w G
    replaces M, and w is the mean mass. `coupled` means that blocks are nearly singular, as for flexible bodies with
    modes that almost contain the motion of the frame. In this case w is the effective mass of each row.

    Parameters
    ----------
    nullity : int          number of combinations of the rows of G that vanish if the constraints hold
    gates : (n_c,) SX      0 for rows of open joints, which are 0 in G, and 1 for other rows
    usual : (n_c,)         relative sizes of the rows, needed if combinations vanish; by default equal
    """
    n_c = G.shape[0]
    # Each rotor is eliminated first: this removes a velocity and a row from the matrix that is factorised.
    if gates is None and (rotors := _rotors(G, sizes)):
        return _beside_rotors(M, G, sizes, coupled, nullity, usual, rotors)

    def factorize(S: ca.SX) -> Callable[[ca.SX], ca.SX]:
        if gates is not None:
            return gated_solver(S, gates)
        return singular_solver(S, nullity, usual) if nullity else symmetric_solver(S)

    singular = is_singular(M, sizes)
    if singular or (coupled and n_c):
        # (M + G'w G) a + G' lam = f + G'w g has the same solution, and its condition does not depend on units.
        if singular:
            starts = [sum(sizes[:k]) for k in range(len(sizes)) if sizes[k]]
            weight = sum((M[k, k] for k in starts), ca.SX(0)) / len(starts)
        else:
            weight = 1 / ((G * G) @ (1 / ca.diag(M)))
        heavier = symmetric_solver(M + G.T @ (weight * G))
        back = ca.horzcat(*[heavier(G[i, :].T) for i in range(n_c)])
        multipliers = factorize(G @ back)

        def solve_heavier(f: ca.SX, g: ca.SX) -> tuple[ca.SX, ca.SX]:
            a = heavier(f + G.T @ (weight * g))
            lam = multipliers(G @ a - g)
            return a - back @ lam, lam

        return solve_heavier
    inverse = MassBlocks(M, sizes)
    if n_c == 0:
        return lambda f, g: (inverse(f), ca.SX(0, 1))
    W = inverse.right(G)
    multipliers = factorize(W @ G.T)

    def solve(f: ca.SX, g: ca.SX) -> tuple[ca.SX, ca.SX]:
        lam = multipliers(W @ f - g)
        return inverse(f) - W.T @ lam, lam

    return solve


def _rotors(G: ca.SX, sizes: Sequence[int]) -> dict[int, int]:
    """For each velocity of a rotor, by index: the row that determines it from velocities of one other block.

    A velocity of a rotor is a block of its own, and appears in only one row, with a constant factor.
    """
    there, block = pattern(G.sparsity()), np.repeat(np.arange(len(sizes)), sizes)
    found: dict[int, int] = {}
    for k in np.flatnonzero((there.sum(axis=0) == 1) & (np.array(sizes, dtype=int)[block] == 1)).tolist():
        row = int(there[:, k].argmax())
        others = set(block[there[row]].tolist()) - {block[k]}
        if row not in found.values() and len(others) == 1 and G[row, k].is_constant():
            found[k] = row
    return found


def _beside_rotors(
    M: ca.SX, G: ca.SX, sizes: Sequence[int], coupled: bool, nullity: int, usual: ca.SX | None, rotors: dict[int, int]
) -> Callable[[ca.SX, ca.SX], tuple[ca.SX, ca.SX]]:
    """`saddle_solver` without the velocities and rows of rotors. M + D' J D contains the inertia of the rotors."""
    own, rows = list(rotors), list(rotors.values())
    kept, others = ([k for k in range(n) if k not in some] for n, some in ((G.shape[1], own), (G.shape[0], rows)))
    factors = ca.vertcat(*[G[row, k] for k, row in rotors.items()])
    D, inertia = ca.diag(1 / factors) @ G[rows, kept], ca.diag(M[own, own])
    ends = np.cumsum(sizes)
    left = [n for n, end in zip(sizes, ends.tolist(), strict=True) if n != 1 or end - 1 not in rotors]
    heavier = ca.sparsify(M[kept, kept] + D.T @ ca.diag(inertia) @ D)
    usual = None if usual is None else usual[others]
    beside = saddle_solver(heavier, G[others, kept], left, coupled, nullity, usual=usual)

    def solve(f: ca.SX, g: ca.SX) -> tuple[ca.SX, ca.SX]:
        a, lam = ca.SX(*f.shape), ca.SX(*g.shape)
        asked = g[rows] / factors
        a[kept], lam[others] = beside(f[kept] - D.T @ (f[own] - inertia * asked), g[others])
        a[own] = asked - D @ a[kept]
        lam[rows] = (f[own] - inertia * a[own]) / factors
        return a, lam

    return solve
