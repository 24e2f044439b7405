"""Eigenvalues of real matrices, and their errors because of rounding."""

from dataclasses import dataclass
from typing import cast

import numpy as np

from symmb._types import Array, Indices, Mask

_ROUNDING = 1e-13
"""Relative error of the entries of a matrix, a few hundred rounding errors, from the equations of motion."""
_LARGE = 1e100
"""Entry [1/s] above which a matrix is scaled, because sums of squares overflow above 1e154."""


@dataclass(frozen=True, eq=False)
class Eigenvalues:
    """Eigenvalues of a real matrix, sorted by size. In a conjugate pair, the positive imaginary part is first.

    Attributes
    ----------
    values : (n,) complex      [1/s]; the values of free motions, which no force opposes, are exactly 0
    vectors : (n, n) complex   eigenvectors in columns
    errors : (n,)              estimated errors of the values: rounding times the condition of each value [1/s]
    """

    values: Array
    vectors: Array
    errors: Array

    @property
    def oscillating(self) -> Mask:
        """Mask (n,) of the values with a positive imaginary part."""
        return self.values.imag > self.errors

    @property
    def damped(self) -> Array:
        """The values (n,). A real part that is a rounding error is set to 0."""
        return np.where(np.abs(self.values.real) <= self.errors, 1j * self.values.imag, self.values)

    def __getitem__(self, which: Indices) -> "Eigenvalues":
        return Eigenvalues(self.values[which], self.vectors[:, which], self.errors[which])


def eigenvalues(A: Array) -> Eigenvalues:
    """The eigenvalues of A (n, n).

    The null space of A is split off until the remaining matrix is regular (Golub & Van Loan, Matrix Computations,
    section 7.6.5). After this, chains of free motions, such as a position and its rate, have eigenvalues 0. Without
    this step, these eigenvalues would be as large as the square root of a rounding error.
    """
    from scipy.linalg import get_lapack_funcs

    largest = np.abs(A).max(axis=1, keepdims=True, initial=0.0)
    # Balancing would magnify rounding errors. Numbers below the smallest normal number have lost digits.
    A = np.where(np.abs(A) <= np.maximum(_ROUNDING * largest, np.finfo(float).tiny), 0.0, A)
    if not A.size:
        return Eigenvalues(np.zeros(0, complex), np.zeros((0, 0), complex), np.zeros(0))
    (gebal,) = get_lapack_funcs(("gebal",), (A,))  # SciPy's matrix_balance warns of factors above 1e18
    balanced, _, _, scale, _ = gebal(A, scale=1, permute=0)
    largest = float(np.abs(balanced).max())
    unit = 2.0 ** (np.frexp(largest)[1] - 1) if largest > _LARGE else 1.0
    balanced = balanced / unit
    found = _without_null_space(balanced, _ROUNDING * float(np.linalg.norm(balanced)))
    found = Eigenvalues(unit * found.values, found.vectors, unit * found.errors)
    found = found[np.argsort(np.abs(found.values), kind="stable")]  # pairs of LAPACK are exactly conjugate
    vectors = scale[:, None] * found.vectors
    return Eigenvalues(found.values, vectors / np.abs(vectors).max(axis=0), found.errors)  # squares must not overflow


def _without_null_space(A: Array, rounding: float) -> Eigenvalues:
    """The eigenvalues of A. The null space is split off; entries of A have errors of size `rounding`."""
    n = len(A)
    if not n:
        return Eigenvalues(np.zeros(0, complex), np.zeros((0, 0), complex), np.zeros(0))
    _, sizes, rows = np.linalg.svd(A)
    null, others = rows[sizes <= n * rounding].T, rows[sizes > n * rounding].T
    if not null.size:
        return _regular(A, rounding)
    rest = _without_null_space(others.T @ A @ others, rounding)
    zero, lifted = np.zeros(null.shape[1]), (others @ rest.vectors).astype(complex)
    moving = rest.values != 0
    lifted[:, moving] += null @ (null.T @ A @ lifted[:, moving] / rest.values[moving])
    vectors = np.hstack([null, lifted])
    values = np.concatenate([zero, rest.values])
    return Eigenvalues(values, vectors / np.linalg.norm(vectors, axis=0), np.concatenate([zero, rest.errors]))


def _regular(A: Array, rounding: float) -> Eigenvalues:
    """The eigenvalues of a regular matrix A. Its entries have errors of size `rounding`.

    The condition of an eigenvalue is |x| |y| / |y' x| for its right and left eigenvectors x and y. A double eigenvalue
    changes by the square root of a change of A (Golub & Van Loan, Matrix Computations, sections 7.2.2 and 7.2.3).
    """
    from scipy.linalg import eig

    unit = 2.0 ** np.frexp(np.abs(A).max())[1]  # LAPACK returns wrong values for entries above 1e138
    values, y, x = cast(tuple[Array, ...], eig(A / unit, left=True, right=True))
    overlap = np.abs(np.einsum("ij,ij->j", y.conj(), x))
    condition = np.minimum(1 / np.maximum(overlap, 1e-300), _ROUNDING**-0.5)
    return Eigenvalues(unit * values, x, rounding * condition)
