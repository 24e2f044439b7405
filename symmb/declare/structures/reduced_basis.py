"""A few shapes that span the modes of a structure with parameters, for all parameter values in a box."""

from collections.abc import Callable, Sequence

import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array
from symmb.declare.structures.eigenmodes import MECHANISM, lowest
from symmb.declare.structures.mass_samples import Sparse

Solve = Callable[[Sparse, Sparse], tuple[Array, Array]]


def spanning(
    matrices: Sequence[tuple[Sparse, Sparse]], places: Sequence[str], solve: Solve, rigid: Array, axes: Sparse
) -> tuple[Array, Array, float]:
    """λ (n,) and X (d, n) of the first structure in a span of the modes of all structures, and the error.

    The method is greedy: in each step, the missing parts of the modes with the largest error are added to the shapes.
    `solve` returns the wanted λ and X for a stiffness and a mass matrix. `places` are the names of the structures in
    messages. `rigid` and `axes` are explained in `lowest`.
    """
    K, M = matrices[0]
    values, X = solve(K, M)
    if len(matrices) == 1 or not len(values):
        return values, X, 0.0
    B = X / np.sqrt(values)
    others = zip(matrices[1:], places[1:], strict=True)
    wanted = [(values, B), *(_wanted(solve, pair, place) for pair, place in others)]
    most = min(4 * B.shape[1], K.shape[0] - rigid.shape[1])
    while True:
        lost = [_lost(B, *some, pair, rigid) for some, pair in zip(wanted, matrices, strict=True)]
        error, directions = max(lost, key=lambda pair: pair[0])
        # Two errors are compared, and the larger one may be 1e-5. One is the relative difference by which squared
        # frequencies are too high. The other is the fraction of a mode's strain energy that the shapes do not
        # represent: the error of deflections under loads at interfaces.
        if error <= 1e-5 or not directions.size or B.shape[1] + directions.shape[1] > most:
            break
        B = _independent(np.hstack([B, _without(directions, rigid, M)]), K)
    values, Y = lowest(B.T @ (K @ B), B.T @ (M @ B), B.T @ (axes @ B), np.zeros((B.shape[1], 0)))
    # The error between these points may be larger, so the returned error is twice the largest error.
    return values, B @ Y, 2.0 * error


def _wanted(solve: Solve, matrices: tuple[Sparse, Sparse], place: str) -> tuple[Array, Array]:
    """The wanted λ (n,) and shapes Y (d, n) with Yᵀ K Y = 1."""
    K, M = matrices
    try:
        if K.diagonal().min() < 0:
            raise DeclarationError(f"FiniteElements: the stiffness {MECHANISM}")
        values, X = solve(K, M)
    except DeclarationError as error:
        raise DeclarationError(f"{error} The parameters are {place}.") from None
    return values, X / np.sqrt(values)


def _lost(B: Array, values: Array, Y: Array, matrices: tuple[Sparse, Sparse], rigid: Array) -> tuple[float, Array]:
    """The error of the span of B compared with λ (n,) and Y (d, n), and the parts of Y outside of the span."""
    from scipy.linalg import eigh

    K, M = matrices
    if not len(values):
        return 0.0, Y
    KB, MB = K @ B, M @ _without(B, rigid, M)
    residual = Y - B @ np.linalg.solve(B.T @ KB, KB.T @ Y)
    shares, V = np.linalg.eigh(residual.T @ (K @ residual))
    # Frequencies below the wanted frequencies are closer to those of the full structure, so they are not an error.
    found = eigh(B.T @ KB, B.T @ MB, eigvals_only=True)[: len(values)]
    excess = float((found / values[: len(found)] - 1).max())
    return max(float(shares[-1]), excess), residual @ V[:, shares > max(0.3 * shares[-1], 1e-13)]


def _without(X: Array, rigid: Array, M: Sparse) -> Array:
    """Shapes X without their rigid motions."""
    if not rigid.size:
        return X
    momentum = M @ rigid
    return X - rigid @ np.linalg.solve(rigid.T @ momentum, momentum.T @ X)


def _independent(B: Array, K: Sparse) -> Array:
    """Columns with the same span as B and with Bᵀ K B = 1."""
    for _ in range(2):
        energies, V = np.linalg.eigh(B.T @ (K @ B))
        B = B @ (V / np.sqrt(energies))
    return B
