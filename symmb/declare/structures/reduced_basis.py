"""A few shapes that span the modes of a structure with parameters, for all their values in a box."""

from collections.abc import Callable, Sequence

import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array
from symmb.declare.structures.eigenmodes import MECHANISM, lowest
from symmb.declare.structures.mass_samples import Sparse

TOLERANCE = 1e-5
"""Share of the strain energy of any mode in the box that the shapes may leave out, which is the error of deflections
under loads at interfaces, and relative excess of squared frequencies over those of the modes."""
SAFETY = 2.0
"""Factor of the stated error over the largest one at the points tried."""
_ADDED = 0.3
"""Share of the largest strain energy left out from which a shape is added."""
_NOISE = 1e-13
"""Share of strain energy left out that is rounding."""
_GROWTH = 4
"""Times the number of modes, up to which shapes are added."""

Solve = Callable[[Sparse, Sparse], tuple[Array, Array]]


def spanning(
    matrices: Sequence[tuple[Sparse, Sparse]], places: Sequence[str], solve: Solve, rigid: Array, axes: Sparse
) -> tuple[Array, Array, float]:
    """λ (n,) and X (d, n), the modes of the first of some structures in a span of the modes of all, and the error.

    Greedy: what the shapes so far leave out of the modes is added where it is largest. `solve` gives the wanted λ and X
    of the stiffness and mass matrix of a structure, and `places` say what a message calls each. `rigid` and `axes` are
    as of `lowest`.
    """
    K, M = matrices[0]
    values, X = solve(K, M)
    if len(matrices) == 1 or not len(values):
        return values, X, 0.0
    B = X / np.sqrt(values)
    others = zip(matrices[1:], places[1:], strict=True)
    wanted = [(values, B), *(_wanted(solve, pair, place) for pair, place in others)]
    most = min(_GROWTH * B.shape[1], K.shape[0] - rigid.shape[1])
    while True:
        lost = [_lost(B, *some, pair, rigid) for some, pair in zip(wanted, matrices, strict=True)]
        error, directions = max(lost, key=lambda pair: pair[0])
        if error <= TOLERANCE or not directions.size or B.shape[1] + directions.shape[1] > most:
            break
        B = _independent(np.hstack([B, _without(directions, rigid, M)]), K)
    values, Y = lowest(B.T @ (K @ B), B.T @ (M @ B), B.T @ (axes @ B), np.zeros((B.shape[1], 0)))
    return values, B @ Y, SAFETY * error


def _wanted(solve: Solve, matrices: tuple[Sparse, Sparse], place: str) -> tuple[Array, Array]:
    """λ (n,) and shapes (d, n) with Yᵀ K Y = 1."""
    K, M = matrices
    try:
        if K.diagonal().min() < 0:
            raise DeclarationError(f"FiniteElements: the stiffness {MECHANISM}")
        values, X = solve(K, M)
    except DeclarationError as error:
        raise DeclarationError(f"{error} This is at {place}.") from None
    return values, X / np.sqrt(values)


def _lost(B: Array, values: Array, Y: Array, matrices: tuple[Sparse, Sparse], rigid: Array) -> tuple[float, Array]:
    """The error of the span of B against λ (n,) and Y (d, n), and what it leaves out of Y."""
    from scipy.linalg import eigh

    K, M = matrices
    if not len(values):
        return 0.0, Y
    KB, MB = K @ B, M @ _without(B, rigid, M)
    residual = Y - B @ np.linalg.solve(B.T @ KB, KB.T @ Y)
    shares, V = np.linalg.eigh(residual.T @ (K @ residual))
    # Frequencies below those of the wanted shapes are nearer to those of the whole structure.
    found = eigh(B.T @ KB, B.T @ MB, eigvals_only=True)[: len(values)]
    excess = float((found / values[: len(found)] - 1).max())
    return max(float(shares[-1]), excess), residual @ V[:, shares > max(_ADDED * shares[-1], _NOISE)]


def _without(X: Array, rigid: Array, M: Sparse) -> Array:
    """Shapes without rigid motion."""
    if not rigid.size:
        return X
    momentum = M @ rigid
    return X - rigid @ np.linalg.solve(rigid.T @ momentum, momentum.T @ X)


def _independent(B: Array, K: Sparse) -> Array:
    """Other columns that span what those of B do, with Bᵀ K B = 1."""
    for _ in range(2):
        energies, V = np.linalg.eigh(B.T @ (K @ B))
        B = B @ (V / np.sqrt(energies))
    return B
