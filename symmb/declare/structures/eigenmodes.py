"""The lowest natural modes of a structure by inverse iteration, which is accurate for stiff parts, too."""

from collections.abc import Callable
from typing import Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import FACTORS, NOTHING, ROUNDING, SAME
from symmb._types import Array, Indices
from symmb.declare.structures.mass_samples import Sparse

MECHANISM = (
    "matrix gives no strain energy for motions that are not rigid. Fix loose parts, or choose interfaces or a clamped "
    "node that hold the body: one node with rotations, or three nodes that are not on a line."
)
BEYOND_DOUBLES = "beyond the range of doubles. Check the units of materials and sections."
INDEFINITE = "the mass matrix is not positive definite. Check its signs and the order of its rows."

_DENSE, _DENSE_RATIO, _SPARE = 400, 4, 6
"""Computing all modes is faster for up to 400 degrees of freedom, or if more than a fourth of the modes are needed:
Lanczos' method then stores more than d / 2 vectors. Six additional modes detect missed lower modes."""
_ABOVE, _EQUAL = 1e-8, 1e-7
"""Relative differences of λ. Beyond _ABOVE, a mode is higher than another mode. Up to _EQUAL, frequencies are equal."""
_LARGEST = 1e150
"""Largest ratio of mass and stiffness [s^2], and of two stiffnesses. Eigenvalue solvers square them."""


def factorized(K: Sparse) -> Callable[[Array], Array]:
    """The function f -> K⁻¹ f for f (d,) or (d, m). Raises DeclarationError unless K is positive definite."""
    scale = stiffness_scale(K)
    lu, pivots = _pivots(K, scale)
    if lu is None or pivots.min(initial=1.0) <= FACTORS:
        raise DeclarationError(f"FiniteElements: the stiffness {MECHANISM}")

    def solve(f: Array) -> Array:
        column = scale if f.ndim == 1 else scale[:, None]
        return column * lu.solve(np.ascontiguousarray(column * f))

    return solve


def definite(M: Sparse, K: Sparse) -> bool:
    """Whether M is positive for the most flexible displacements of K, up to rounding."""
    scale = stiffness_scale(K)
    stiff = (K.multiply(scale[:, None])).multiply(scale)
    massive = (M.multiply(scale[:, None])).multiply(scale)
    _, pivots = _pivots(massive + SAME * abs(massive).max() * stiff, np.ones(len(scale)))
    return bool(M.diagonal().min() >= 0 and pivots.min() > -FACTORS * np.abs(pivots).max())


def stiffness_scale(K: Sparse) -> Array:
    """Units (d,) in which the degrees of freedom have similar stiffness; 1 for degrees of freedom without stiffness."""
    stiffness = K.diagonal()
    return 1 / np.sqrt(np.maximum(stiffness, ROUNDING * stiffness.max(initial=NOTHING)))


def _pivots(A: Sparse, scale: Array) -> tuple[Any, Array]:
    """The factorization of the scaled A, and its pivots. Signs of pivots show definiteness if no rows are exchanged."""
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import splu

    scaled = csc_array(diags_array(scale) @ A @ diags_array(scale))
    try:
        lu = splu(scaled, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:  # exactly singular
        return None, np.zeros(1)
    return lu, lu.U.diagonal() * (1.0 if (lu.perm_r == lu.perm_c).all() else np.nan)


def lowest(
    K: Sparse, M: Sparse, axes: Sparse, rigid: Array, count: int | None = None, below: float = np.inf
) -> tuple[Array, Array]:
    """The lowest elastic modes of K x = λ M x: ascending λ (n,) and X (d, n) with Xᵀ M X = 1.

    K and M (d, d) are sparse or dense; K is singular for the rigid motions (d, r) only. `axes` (d, d) is the diagonal
    matrix with 1, 2, 3 for displacements along x, y, z and 0 for rotations, or its projection. Modes of equal frequency
    are combined into eigenvectors of `axes`, so that a mode moves along one axis if possible. Without a count, all λ
    below `below` are found.
    """
    d = K.shape[0]
    few = isinstance(K, np.ndarray) or d <= _DENSE or (count is not None and count + _SPARE > d // _DENSE_RATIO)
    values, X = _all(K, M, rigid) if few else _some(K, M, rigid, count, below)
    X = _aligned(values, X, axes)
    keep = int((values < below).sum()) if count is None else min(count, len(values))
    return values[:keep], X[:, :keep]


def _all(K: Sparse, M: Sparse, rigid: Array) -> tuple[Array, Array]:
    """All elastic modes of a small structure."""
    from scipy.linalg import LinAlgError, eigh

    scale = stiffness_scale(K)
    K, M = (A if isinstance(A, np.ndarray) else A.toarray() for A in (K, M))
    stiffness = np.diag(K)
    is_wide = stiffness[stiffness > 0].min(initial=np.inf) * _LARGEST < stiffness.max()
    K, M = scale[:, None] * K * scale, scale[:, None] * M * scale
    if is_wide or not (np.isfinite(K).all() and np.abs(M).max() < _LARGEST):
        raise DeclarationError(f"FiniteElements: the ratios of stiffness and mass are {BEYOND_DOUBLES}")
    elastic = np.eye(len(K))
    if rigid.size:
        span, _ = np.linalg.qr(M @ (rigid / scale[:, None]), mode="complete")
        elastic = span[:, rigid.shape[1] :]
    try:
        mu, Y = eigh(elastic.T @ M @ elastic, elastic.T @ K @ elastic)
    except LinAlgError:
        raise DeclarationError(f"FiniteElements: the stiffness {MECHANISM}") from None
    massive = mu > FACTORS * mu.max(initial=0)
    if (mu < -SAME * mu.max(initial=0)).any():
        raise DeclarationError(f"FiniteElements: {INDEFINITE}")
    X = _mass_orthonormal((elastic @ Y[:, massive] / np.sqrt(mu[massive]))[:, ::-1], M)
    return 1 / mu[massive][::-1], scale[:, None] * X


def _some(K: Sparse, M: Sparse, rigid: Array, count: int | None, below: float) -> tuple[Array, Array]:
    """Modes of a large structure in batches, until all modes of a batch are above the requested modes.

    Each batch is orthogonal to earlier batches. Lanczos' method may find only one mode of a multiple frequency. The
    next batch then finds the other modes of this frequency.
    """
    from scipy.sparse.linalg import LinearOperator, eigsh

    d, r = rigid.shape
    locked = determinate(rigid)
    free = np.setdiff1d(np.arange(d), locked)
    solve = factorized(K[free][:, free])
    shapes, values = _mass_orthonormal(rigid, M), np.zeros(0)

    def flexibility(f: Array) -> Array:
        # For loads in equilibrium, every statically determinate support gives the elastic displacements.
        f = f - M @ (shapes @ (shapes.T @ f))
        x = np.zeros(d)
        x[free] = solve(f[free])
        return x - shapes @ (shapes.T @ (M @ x))

    # A random start vector is not orthogonal to any mode. The fixed seed makes results reproducible.
    start = np.random.default_rng(0).standard_normal(d)
    operator = LinearOperator((d, d), matvec=flexibility, dtype=float)  # type: ignore[call-arg]
    batch = 2 * _SPARE if count is None else count + _SPARE
    while shapes.shape[1] + batch < d // 2:
        more, X = eigsh(K, batch, M, sigma=0.0, OPinv=operator, v0=flexibility(M @ start))
        values, shapes = np.concatenate([values, more]), np.hstack([shapes, X])
        if more.min() > (below if count is None else np.sort(values)[count - 1] * (1 + _ABOVE)):
            order = np.argsort(values)
            return values[order], _mass_orthonormal(shapes[:, r:][:, order], M)
        batch = _SPARE if count is not None else 2 * batch
    return _all(K, M, rigid)


def _mass_orthonormal(X: Array, M: Sparse) -> Array:
    """The columns of X, orthonormalised with respect to M, beginning with the first column."""
    from scipy.linalg import LinAlgError, cholesky, solve_triangular

    # If the Gram matrix is ill-conditioned, rounding reduces the orthonormality. The second pass restores it.
    for _ in range(2 if X.shape[1] else 0):
        try:
            upper = cholesky(X.T @ (M @ X))
        except LinAlgError:
            raise DeclarationError(f"FiniteElements: {INDEFINITE}") from None
        X = solve_triangular(upper.T, X.T, lower=True).T
    return X


def determinate(rigid: Array) -> Indices:
    """Degrees of freedom of a statically determinate support: fixing them prevents only the rigid motions."""
    from scipy.linalg import qr

    if not rigid.size:
        return np.zeros(0, dtype=int)
    _, order = qr(rigid.T, mode="r", pivoting=True)  # type: ignore[misc]
    return np.asarray(order, dtype=np.intp)[: rigid.shape[1]]


def _aligned(values: Array, X: Array, axes: Sparse) -> Array:
    """Modes in which modes of equal frequency are combined into modes along single axes, if possible."""
    X = X.copy()
    starts = np.flatnonzero(np.diff(values, prepend=-np.inf) > _EQUAL * values)
    for group in np.split(np.arange(len(values)), starts[1:]):
        if len(group) > 1:
            X[:, group] = X[:, group] @ np.linalg.eigh(X[:, group].T @ (axes @ X[:, group]))[1]
    return X
