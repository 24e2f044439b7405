"""Modes along a straight line of parameters. From one point to the next, modes are identified by their shapes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from symmb._types import Array, Indices
from symmb.run.linear.eigenvalues import Eigenvalues

_ALIKE = 0.9
"""Shapes with a larger overlap belong to the same mode. The overlap with other modes is then below 0.1."""


@dataclass(frozen=True, eq=False)
class Followed:
    """Modes at the end of a line of parameters.

    Attributes
    ----------
    values : (n,) complex      eigenvalues in the order of the modes at the start; nan for modes that have ended [1/s]
    errors : (n,)              errors of the eigenvalues because of rounding [1/s]
    places : (n,)              numbers of the modes among the eigenvalues at the end; -1 for modes that have ended
    crossings : set of pairs   numbers of two modes with frequencies that cross on the line
    veerings : set of pairs    numbers of two modes that exchange their shapes within the shortest step
    """

    values: Array
    errors: Array
    places: Indices
    crossings: set[tuple[int, int]]
    veerings: set[tuple[int, int]]


def followed(at: Callable[[float], tuple[Eigenvalues, Array]], start: tuple[Eigenvalues, Array]) -> Followed:
    """Follow all oscillations along a line of parameters, from the fraction 0 to 1 of the line.

    `at` returns eigenvalues and shapes (n_z, n) at a fraction of the line. Steps are halved until the shapes of each
    mode at both ends of a step overlap by `_ALIKE`, and no two frequencies change their order. If two frequencies
    change their order within the shortest step, but shapes remain similar, the frequencies cross.
    """
    from scipy.optimize import linear_sum_assignment

    eigen, shapes = start
    place = np.flatnonzero(eigen.oscillating)
    n, share, step = len(place), 0.0, 1.0
    modes = np.arange(n)
    crossings: set[tuple[int, int]] = set()
    veerings: set[tuple[int, int]] = set()
    while share < 1.0:
        step = min(step, 1.0 - share)
        new, new_shapes = at(share + step)
        candidates = np.flatnonzero(new.oscillating)
        overlap = _overlaps(shapes[:, place], new_shapes[:, candidates])
        rows, columns = linear_sum_assignment(-overlap)
        alike, following = overlap[rows, columns], candidates[columns]
        swapped = _swapped(np.abs(eigen.values[place[rows]]), np.abs(new.values[following]))
        # Smallest similarity of two modes if each is the only mode at its point.
        least = _ALIKE if len(place) + len(candidates) > 2 else 0.5
        # Shortest step, divided by the line. If two frequencies change their order within this step, they cross.
        if step > 2.0**-10 and (len(rows) < len(place) or alike.min(initial=1.0) < least or swapped):
            step /= 2
            continue
        turned = set(modes[rows[alike < _ALIKE]].tolist())
        crossings |= {(int(modes[rows[i]]), int(modes[rows[j]])) for i, j in swapped}
        veerings |= {(i, j) for i in turned for j in turned if i < j}
        modes, place, eigen, shapes = modes[rows], following, new, new_shapes
        share, step = share + step, 2 * step
    values: Array = np.full(n, np.nan, dtype=complex)
    errors, places = np.zeros(n), np.full(n, -1, dtype=np.intp)
    values[modes], errors[modes], places[modes] = eigen.values[place], eigen.errors[place], place
    values = np.where(np.abs(values.real) <= errors, 1j * values.imag, values)
    return Followed(values, errors, places, crossings, veerings)


def _swapped(before: Array, after: Array) -> list[tuple[int, int]]:
    """Pairs of numbers of modes with frequencies that change their order."""
    signs = [np.sign(values[:, None] - values) for values in (before, after)]
    return [(int(i), int(j)) for i, j in np.argwhere(np.triu(signs[0] * signs[1] < 0, 1))]


def _overlaps(one: Array, other: Array) -> Array:
    """Modal assurance criterion (n, m) of shapes in n and m columns (Allemang & Brown 1982)."""
    norms = np.linalg.norm(one, axis=0)[:, None] * np.linalg.norm(other, axis=0)[None]
    return (np.abs(one.conj().T @ other) / np.maximum(norms, 1e-300)) ** 2
