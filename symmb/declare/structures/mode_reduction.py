"""Reduction of a structure: component mode synthesis after Craig and Bampton."""

from collections.abc import Sequence

import numpy as np

from symmb._errors import DeclarationError
from symmb._options import is_whole, numbers_of, shown
from symmb._types import Array, Indices
from symmb.declare.structures.eigenmodes import factorized, lowest, stiffness_scale
from symmb.declare.structures.mass_samples import Sparse


def reduced(
    K: Sparse, M: Sparse, rigid: Array, axes: Sparse, interface: Indices, count: int | None, below: float | None
) -> tuple[Array, Array]:
    """λ (n,) and X (d, n) with Xᵀ M X = 1, in the span of fixed-interface modes and static shapes of the interface.

    K and M (d, d) are sparse; `rigid` (d, r) and `axes` are explained in `lowest`. Static shapes of the degrees of
    freedom `interface` (b,) are exact. `count` is the total number of modes, and `below` is a bound of λ for
    fixed-interface modes.
    """
    if count == 0:
        return np.zeros(0), np.zeros((K.shape[0], 0))
    if not interface.size:
        return lowest(K, M, axes, rigid, count, np.inf if below is None else below)
    d, b = K.shape[0], interface.size
    inner = np.setdiff1d(np.arange(d), interface)
    K_ii, K_ib, M_ii = K[inner][:, inner], K[inner][:, interface].toarray(), M[inner][:, inner]
    static = -factorized(K_ii)(K_ib) if inner.size else K_ib
    # A count below the number of static shapes leaves some out. Fixed-interface modes then improve the accuracy.
    shapes = b - rigid.shape[1]
    fixed = 0 if count is None else count - shapes if count >= shapes else count
    nothing = np.zeros((inner.size, 0))
    values, inside = np.zeros(0), nothing
    if inner.size and (below is not None or fixed):
        inner_axes = axes[inner][:, inner]
        limit = (None, below) if below is not None else (fixed, np.inf)
        values, inside = lowest(K_ii, M_ii, inner_axes, nothing, *limit)
    basis = np.zeros((d, b + len(values)))
    basis[interface, :b] = np.eye(b)
    basis[np.ix_(inner, np.arange(b))] = static
    basis[np.ix_(inner, np.arange(b, b + len(values)))] = inside
    # Static shapes and fixed-interface modes are orthogonal in K.
    K_reduced = np.diag(np.concatenate([np.zeros(b), values]))
    whole = K[interface][:, interface].toarray()
    guyan = whole + K_ib.T @ static
    K_reduced[:b, :b] = (guyan + guyan.T) / 2
    motions = np.vstack([rigid[interface], np.zeros((len(values), rigid.shape[1]))])
    # With a single interface the static stiffness consists of rounding errors, and does not determine the units.
    scale = np.concatenate([stiffness_scale(whole), 1 / np.sqrt(values)])
    basis, K_reduced, motions = basis * scale, K_reduced * np.outer(scale, scale), motions / scale[:, None]
    M_reduced, axes_reduced = basis.T @ (M @ basis), basis.T @ (axes @ basis)
    values, Y = lowest(K_reduced, (M_reduced + M_reduced.T) / 2, axes_reduced, motions, count)
    return values, basis @ Y


def chosen(nodes: Sequence[int], total: int, owner: str) -> list[int]:
    """The node numbers as a list. Raises DeclarationError if a number is not valid."""
    if numbers_of(nodes) is None or np.ndim(nodes) != 1:  # pyright: ignore[reportArgumentType]
        raise DeclarationError(f"{owner}: expected a list of node numbers, got {shown(nodes)}.")
    for node in nodes:
        if not is_whole(node) or not 0 <= node < total:
            raise DeclarationError(
                f"{owner}: there is no node {node!r}. The nodes have the numbers 0 to {total - 1}. "
                "Use elements.nearest(x, y, z) to find the node at a position."
            )
    return sorted({int(node) for node in nodes})
