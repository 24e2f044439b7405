"""Polynomials by least squares from runs that are spread over the box, with leave-one-out errors."""

from itertools import chain

import numpy as np

from symmb._magnitudes import SLIGHT
from symmb._threads import one_thread
from symmb._types import Array
from symmb.bound.polynomials import Expansion, HyperbolicCross, MultiIndices, basis_values
from symmb.bound.polynomials.ranges import Piecewise

_CROSS_EXPONENTS = 1.0, 0.75, 0.5
"""Exponents of hyperbolic crosses. 1 gives the total degree. Smaller exponents favor terms of few parameters."""


def fitted(points: Array, Y: Array, parameters: tuple[str, ...]) -> Piecewise:
    """Polynomials through responses Y (N, n_t, n_y) at points (N, d). The error is the rms of leave-one-out residuals.

    Each response uses the basis with the smallest leave-one-out residuals. (Blatman and Sudret, Journal of
    Computational Physics 230 (2011), section 3.3)
    """
    values = Y.reshape(len(Y), -1)
    squares, chosen = np.square(values - values.mean(axis=0)).mean(axis=0), np.full(values.shape[1], -1)
    found = [(np.zeros((1, points.shape[1]), dtype=np.intp), values.mean(axis=0)[None])]
    with one_thread():
        # Smallest number of runs for each term. Fewer runs do not determine coefficients reliably.
        for alpha in chain.from_iterable(bases(points.shape[1], len(points) // 2)):
            q, r = np.linalg.qr(basis_values(alpha, points))
            # Smallest value of 1 minus the leverage of a run. If a run alone determines a term, its residual is only
            # rounding.
            rest = np.maximum(1.0 - np.square(q).sum(axis=1), SLIGHT)
            projected = q.T @ values
            left_out = np.square((values - q @ projected) / rest[:, None]).mean(axis=0)
            better = left_out < squares
            squares, chosen = np.where(better, left_out, squares), np.where(better, len(found), chosen)
            found.append((alpha, np.linalg.solve(r, projected)))
    alpha, which = np.unique(np.concatenate([each for each, _ in found]), axis=0, return_inverse=True)
    coefficients, first = np.zeros((len(alpha), values.shape[1])), 0
    for k, (own, c) in enumerate(found):
        columns = np.flatnonzero(np.maximum(chosen, 0) == k)
        coefficients[np.ix_(which.ravel()[first : first + len(own)], columns)] = c[:, columns]
        first += len(own)
    used = (coefficients != 0).any(axis=1) | (alpha.sum(axis=1) == 0)
    expansion = Expansion(alpha[used], coefficients[used].reshape(-1, *Y.shape[1:]), parameters)
    return Piecewise.whole(expansion, np.sqrt(squares).reshape(Y.shape[1:]))


def bases(d: int, most: int) -> list[list[MultiIndices]]:
    """Sets of degrees with at most `most` terms, each set once: a list of increasing degrees for each exponent."""
    families, sizes = [list[MultiIndices]() for _ in _CROSS_EXPONENTS], set[int]()
    for family, q in zip(families, _CROSS_EXPONENTS, strict=True):
        # Highest degree. There are rarely enough runs for higher degrees.
        for degree in range(1, 17):
            if (size := HyperbolicCross(q).size(d, degree)) > most:
                break
            if size not in sizes:
                sizes.add(size)
                family.append(HyperbolicCross(q).indices(d, degree))
    return families
