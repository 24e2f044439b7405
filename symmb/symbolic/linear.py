"""Symbolic solution of M a + G' lam = f, G a = g in range space; constraints lend inertia to bodies without mass."""

from collections.abc import Callable, Sequence

import casadi as ca

from symmb.symbolic.geometry import is_zero


def invert_blocks(M: ca.SX, sizes: Sequence[int]) -> ca.SX | None:
    """Inverse of a block-diagonal matrix block by block; None if a block is singular by structure."""
    blocks, at = [], 0
    for n in sizes:
        block = ca.sparsify(M[at : at + n, at : at + n])
        at += n
        if block.sparsity().is_diag():
            diagonal = ca.diag(block)
            if any(is_zero(diagonal[i]) for i in range(n)):
                return None
            blocks.append(ca.diag(1 / diagonal))
        elif ca.sprank(block) < n:
            return None
        else:
            blocks.append(ca.sparsify(ca.inv_minor(block)))
    return ca.diagcat(*blocks)


def symmetric_solver(S: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """Solver of S z = r for a positive definite S (n, n), sparse, by LDL' with a fill-reducing order."""
    # One triangle stands for both: an entry that cancels to 0 in one may be a rounding error in the other.
    D, L, order = ca.ldl(ca.triu2symm(ca.triu(ca.sparsify(S))), True)
    return lambda r: ca.densify(ca.ldl_solve(ca.densify(r), D, L, order))


def general_solver(A: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """Solver of A z = r for a regular A (n, n), sparse; orthogonal factors need no pivots, which would differ from
    sample to sample."""
    factors = ca.qr_sparse(A)
    return lambda r: ca.densify(ca.qr_solve(ca.densify(r), *factors))


def saddle_solver(M: ca.SX, G: ca.SX, sizes: Sequence[int]) -> Callable[[ca.SX, ca.SX], tuple[ca.SX, ca.SX]]:
    """Solver of the saddle-point system of constrained motion; its factorisation is formed once and shared.

    Range space: S = G M^-1 G' is formed sparse and factorised by LDL' with a fill-reducing order. With a structurally
    singular mass block (a massless body) M + w G'G takes the place of M, w the mean mass.

    Parameters
    ----------
    M : (n_v, n_v) SX, block-diagonal with blocks of the given sizes
    G : (n_c, n_v) SX, may have no rows

    Returns
    -------
    callable (f (n_v,), g (n_c,)) -> (a (n_v,), lam (n_c,))
    """
    n_c = G.shape[0]
    inverse = invert_blocks(M, sizes)
    if inverse is None:
        # (M + w G'G) a + G' lam = f + w G'g has the same solution, and no unit of length or mass makes it worse.
        starts = [sum(sizes[:k]) for k in range(len(sizes)) if sizes[k]]
        weight = sum((M[k, k] for k in starts), ca.SX(0)) / len(starts)
        heavier = symmetric_solver(M + weight * G.T @ G)
        back = ca.horzcat(*[heavier(G[i, :].T) for i in range(n_c)])
        multipliers = symmetric_solver(G @ back)

        def solve_heavier(f: ca.SX, g: ca.SX) -> tuple[ca.SX, ca.SX]:
            a = heavier(f + weight * G.T @ g)
            lam = multipliers(G @ a - g)
            return a - back @ lam, lam

        return solve_heavier
    if n_c == 0:
        return lambda f, g: (inverse @ f, ca.SX(0, 1))
    W = ca.sparsify(G @ inverse)
    multipliers = symmetric_solver(W @ G.T)

    def solve(f: ca.SX, g: ca.SX) -> tuple[ca.SX, ca.SX]:
        lam = multipliers(W @ f - g)
        return inverse @ f - W.T @ lam, lam

    return solve
