"""Rank of constraint rows at a consistent position, and which joints are to blame where it is short."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from symmb._types import Array, Indices
from symmb.model import DAE
from symmb.symbolic import batch

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


def left_out(G: Array) -> Array:
    """Combinations (n_r, k) of rows that vanish, orthonormal."""
    U, sigma, _ = np.linalg.svd(G)
    return U[:, int((sigma > _RANK_TOLERANCE * max(G.shape)).sum()) :]


def redundant_names(G: Array, rows: Mapping[str, slice]) -> tuple[str, ...]:
    """The constraints whose rows of G depend on each other."""
    scale = np.linalg.norm(G, axis=1)
    involved = np.abs(left_out(G / np.where(scale > 0, scale, 1.0)[:, None])).max(axis=1, initial=0.0) > 1e-6
    return tuple(name for name, where in rows.items() if involved[where].any())


@dataclass(frozen=True)
class Singularity:
    """Where rows come closest to depending on each other: time [s], least over largest singular value, constraints."""

    time: float
    ratio: float
    names: tuple[str, ...]

    def __str__(self) -> str:
        joints = ", ".join(repr(name) for name in self.names)
        return f"near t = {self.time:g} s rows of {joints} nearly depend on each other ({self.ratio:.0e})"


NEARLY = 1e-2
"""Least over largest singular value of rows below which a position is said to be nearly singular."""


def singularity(dae: DAE, X: Array, p: Array, times: Array) -> Singularity | None:
    """The position closest to a singular one among states X (m, n_x), if one is close."""
    if dae.G is None or not len(X):
        return None
    cuts = [dae.n_q, dae.n_q + dae.n_v] if dae.n_s else [dae.n_q]
    G = (
        batch(dae.G, *np.split(X, cuts, axis=1), p, times[:, None])[0].reshape(len(X), -1, dae.n_v)
        * dae.displacement_scales
    )
    scale = np.linalg.norm(G, axis=2, keepdims=True)
    G /= np.where(scale > 0, scale, 1.0)
    sigma = np.linalg.svd(G, compute_uv=False)
    ratios = sigma[:, -1] / sigma[:, 0]
    k = int(np.argmin(ratios))
    if not ratios[k] < NEARLY:
        return None
    least = np.linalg.svd(G[k], full_matrices=False)[0][:, -1]
    shares = {name: float(np.abs(least[where]).max()) for name, where in dae.rows.items()}
    names = tuple(name for name, share in shares.items() if share > 0.1)
    return Singularity(float(times[k]), float(ratios[k]), names)
