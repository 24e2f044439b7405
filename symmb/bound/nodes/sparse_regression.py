"""Sparse polynomials from few runs at any points: orthogonal matching pursuit with cross-validation.

(Pati, Rezaiifar and Krishnaprasad, Asilomar Conference 1993; Blatman and Sudret, Journal of Computational Physics 230
(2011), adaptive degrees and hyperbolic bases)
"""

from dataclasses import dataclass

import numpy as np

from symmb._magnitudes import ROUNDING, SAME, SLIGHT
from symmb._threads import one_thread
from symmb._types import Array, Indices
from symmb.bound.nodes.regression import bases
from symmb.bound.polynomials import MultiIndices, basis_values

GROUPS = 5
"""Number of groups of runs. Each group is left out once. More groups take more time."""
_MOST_TERMS, _MOST_CANDIDATES, _CANDIDATES_OF_RUN, _MOST_NUMBERS = 200, 1500, 10, 4_000_000
"""Largest number of terms, of candidates, of candidates for each run, and of values of candidates. Larger numbers take
more time. Responses of few runs rarely need them."""
_COMPETITIVE = 3.0
"""Polynomials of other bases count if their error in cross-validation is smaller than this multiple of the smallest
error. Their differences show the error in corners, which are far from all runs. tests/methods/test_recorded_runs.py"""
Terms = tuple[MultiIndices, Array]
"""Multi-indices (n_b, d) and coefficients (n_b, m) of m responses."""


@dataclass(frozen=True, eq=False)
class SparseFit:
    """Sparse polynomials through m responses.

    Attributes
    ----------
    terms : (n_b, d), (n_b, m)     multi-indices and coefficients of the polynomials through all runs
    error : (m,)                   root mean square of the residuals of runs that were left out
    others : list of terms         of polynomials without one group of runs, also in competitive bases
    """

    terms: Terms
    error: Array
    others: list[Terms]

    @classmethod
    def through(cls, points: Array, Y: Array) -> "SparseFit":
        """Polynomials through responses Y (N, m) at different points (N, d) of the unit box."""
        n, d = points.shape
        group = np.random.default_rng(0).permutation(n) % GROUPS  # rows of a table may have an order
        scale = float(np.abs(Y).max()) or 1.0  # squares may overflow
        responses = _compressed(Y / scale)
        most = max(min(_CANDIDATES_OF_RUN * n, _MOST_CANDIDATES, _MOST_NUMBERS // n), d + 1)
        found = list[tuple[float, MultiIndices, list[Indices]]]()
        with one_thread():
            for family in bases(d, most):
                errors = list[float]()
                for alpha in family:
                    error, chosen = _left_out(basis_values(alpha, points), responses, group)
                    found.append((error, alpha, chosen))
                    errors.append(error)
                    if len(errors) > 2 and min(errors[:-2]) <= min(errors[-2:]):
                        break
            best, alpha, chosen = min(found, key=lambda each: each[0])
            order = _pursuit(basis_values(alpha, points), responses, len(chosen[0]))
            others, squares = list[Terms](), np.zeros(Y.shape[1])
            for error, candidates, chosen in found:
                for k, rows in enumerate(chosen if error <= _COMPETITIVE**2 * best else ()):
                    others.append(_least_squares(candidates[rows], points[group != k], Y[group != k]))
                    if candidates is alpha:
                        missed = Y[group == k] - basis_values(candidates[rows], points[group == k]) @ others[-1][1]
                        squares += np.square(missed / scale).sum(axis=0)
            return cls(_least_squares(alpha[order], points, Y), scale * np.sqrt(squares / n), others)


def _least_squares(alpha: MultiIndices, points: Array, Y: Array) -> Terms:
    """Polynomials through responses Y (N, m) at points (N, d)."""
    return alpha, np.asarray(np.linalg.lstsq(basis_values(alpha, points), Y, rcond=None)[0], dtype=float)


def _compressed(Y: Array) -> Array:
    """Fewer responses (N, n) with the same inner products of runs as Y (N, m), up to slight differences."""
    u, s, _ = np.linalg.svd(Y - Y.mean(axis=0), full_matrices=False)
    kept = s > SAME * s.max(initial=0.0)
    return u[:, kept] * s[kept]


def _left_out(V: Array, Y: Array, group: Indices) -> tuple[float, list[Indices]]:
    """Sum of squares of the residuals of responses Y (N, n) left out, and the terms chosen without each group.

    V (N, n_b) are the values of the candidates. The number of terms has the smallest sum of squares.
    """
    # Terms are at most half as many as the runs. More terms are not determined reliably.
    most = min(int((np.bincount(group).sum() - np.bincount(group).max()) / 2), V.shape[1], _MOST_TERMS)
    squares, chosen = np.zeros(most), list[Indices]()
    for k in range(GROUPS):
        outside, n_b = group == k, V.shape[1]
        # The triangular factor has the same inner products as the runs, and fewer rows if there are many runs.
        factor = np.asarray(np.linalg.qr(np.hstack([V, Y])[group != k], mode="r"), dtype=float)
        order = _pursuit(factor[:, :n_b], factor[:, n_b:], most)
        q, r = np.linalg.qr(factor[:, order])
        parts = np.linalg.solve(r.T, V[outside][:, order].T).T
        rest = Y[outside][None] - np.cumsum(parts.T[:, :, None] * (q.T @ factor[:, n_b:])[:, None], axis=0)
        own = np.square(rest).sum(axis=(1, 2))
        squares[: len(own)] += own
        squares[len(own) :] += own[-1]
        chosen.append(order)
    squares = np.maximum(squares, ROUNDING**2 * np.square(Y).sum())
    n = int(squares.argmin()) + 1
    return float(squares[n - 1]), [order[:n] for order in chosen]


def _pursuit(V: Array, Y: Array, most: int) -> Indices:
    """At most `most` columns of V (N, n_b), each with the largest decrease of the residuals of Y (N, n) by least
    squares. The first column is the constant."""
    products, squares = V.T @ Y, np.square(V).sum(axis=0)
    least, Q, order = SLIGHT * squares, np.zeros((len(V), most)), [0]
    while True:
        n, q = len(order), V[:, order[-1]]
        for _ in range(2):  # the second projection removes rounding errors of the first
            q = q - Q[:, : n - 1] @ (Q[:, : n - 1].T @ q)
        Q[:, n - 1] = q = q / np.linalg.norm(q)
        along = V.T @ q
        # The parts of candidates and products that are orthogonal to all chosen columns.
        squares = squares - np.square(along)
        products -= np.outer(along, products[order[-1]] / along[order[-1]])
        gains = np.square(products).sum(axis=1)
        gains = np.divide(gains, squares, out=np.zeros_like(gains), where=squares > least)
        gains[order] = 0.0
        if n == most or not gains.max(initial=0.0) > 0.0:
            return np.array(order)
        order.append(int(gains.argmax()))
