"""Rank of constraint rows at a consistent position, and which joints are to blame where it is short."""

from collections.abc import Mapping

import numpy as np

from symmb._types import Array, Indices

_RANK_TOLERANCE = 1e-9


def independent(A: Array) -> tuple[Indices, Indices]:
    """Indices of independent rows and of as many columns that determine them, from pivoted QR of the scaled matrix."""
    if not A.size:
        return np.arange(0, dtype=np.intp), np.arange(0, dtype=np.intp)
    scale = np.linalg.norm(A, axis=1)
    scaled = A / np.where(scale > 0, scale, 1.0)[:, None]
    rank = int(np.linalg.matrix_rank(scaled, tol=_RANK_TOLERANCE * max(A.shape)))
    rows = _pivots(scaled.T, rank)
    return rows, _pivots(scaled[rows], rank)


def _pivots(B: Array, rank: int) -> Indices:
    """Columns of B that are independent, in rising order: the largest one, then the rest made orthogonal to it.

    The import of SciPy's pivoted QR takes longer than a whole study of a small scene.
    """
    rest, chosen = B.copy(), []
    for _ in range(rank):
        k = int(np.einsum("ij,ij->j", rest, rest).argmax())
        chosen.append(k)
        q = rest[:, k] / np.linalg.norm(rest[:, k])
        rest -= np.outer(q, q @ rest)
        rest[:, k] = 0.0
    return np.sort(np.array(chosen, dtype=np.intp))


def redundant_names(G: Array, rows: Mapping[str, slice]) -> tuple[str, ...]:
    """The constraints whose rows of G depend on each other."""
    scale = np.linalg.norm(G, axis=1)
    scaled = G / np.where(scale > 0, scale, 1.0)[:, None]
    U, sigma, _ = np.linalg.svd(scaled)
    rank = int((sigma > _RANK_TOLERANCE * max(G.shape)).sum())
    involved = np.abs(U[:, rank:]).max(axis=1, initial=0.0) > 1e-6
    return tuple(name for name, where in rows.items() if involved[where].any())
