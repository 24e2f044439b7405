"""Rank of constraint rows at a consistent position, and which joints are to blame where it is short."""

from collections.abc import Mapping

import numpy as np

from symmb._types import Array, Indices

_RANK_TOLERANCE = 1e-9


def independent(A: Array) -> tuple[Indices, Indices]:
    """Indices of independent rows and of as many columns that determine them, from pivoted QR of the scaled matrix."""
    if not A.size:
        return np.arange(0, dtype=np.intp), np.arange(0, dtype=np.intp)
    import scipy.linalg  # not at import: most of a scene's life goes without it

    scale = np.linalg.norm(A, axis=1)
    scaled = A / np.where(scale > 0, scale, 1.0)[:, None]
    rank = int(np.linalg.matrix_rank(scaled, tol=_RANK_TOLERANCE * max(A.shape)))

    def pivots(B: Array) -> Indices:
        *_, order = scipy.linalg.qr(B, pivoting=True, mode="r")
        return np.sort(order[:rank]).astype(np.intp)

    rows = pivots(scaled.T)
    return rows, pivots(scaled[rows])


def redundant_names(G: Array, rows: Mapping[str, slice]) -> tuple[int, tuple[str, ...]]:
    """Rank of G, and the constraints whose rows depend on each other."""
    scale = np.linalg.norm(G, axis=1)
    scaled = G / np.where(scale > 0, scale, 1.0)[:, None]
    U, sigma, _ = np.linalg.svd(scaled)
    rank = int((sigma > _RANK_TOLERANCE * max(G.shape)).sum())
    involved = np.abs(U[:, rank:]).max(axis=1, initial=0.0) > 1e-6
    return rank, tuple(name for name, where in rows.items() if involved[where].any())
