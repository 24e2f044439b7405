"""Check runs: points that show most of an interpolant's error, and the expected error elsewhere."""

from itertools import count

import numpy as np

from symmb._types import Array, Indices
from symmb.bound.bounds.time_windows import WINDOW, average_over_window
from symmb.bound.nodes import corners

SAFETY = 2.5
"""Factor on errors that runs show, and on the deviation of noise: those elsewhere may be larger. Less misses more, more
takes more runs."""
CANDIDATES = 150
"""Extremes among which check points are selected, as all pairs are compared, and points from which searches of
surfaces start: more take time, fewer miss extremes."""
WORTHWHILE = 0.3
"""Weight over the largest one from which an output chooses a place beside those of others: less takes more runs."""
FEW_SHAPES, SHAPE_SHARE = 3, 1e-2
"""Shapes of time that hide as much as single numbers do, and their least share of the largest one: more of the first
takes more check runs, more of the second as well."""
SHAPE_RUNS = round(1 / WINDOW)
"""Most runs of which shapes are counted, and half the number of times: a window has two."""
PROBES = 6
"""Quasi-random check points. Nodes lie at middles, ends and halves, where symmetric responses may be alike. More find
narrower bumps."""
PATIENCE = 30
"""Runs for each parameter at which what does not converge is given up, as are corners: more take runs, fewer miss."""
ALL_CORNERS = 10
"""Most parameters of which all corners are run where runs share their steps: more take seconds."""
MOST_CORNERS = 32
"""Most corners that are run because nothing else tells where a response varies: more take runs, fewer miss."""


def select_dispersed(places: Array, weights: Array, number: int, taken: Array | None = None) -> Array:
    """At most so many places (n, d), of places (2, n_t, n_y, d), with large weights, that are not close to each other.

    Each choice maximises the weight in its neighbourhood, sum_j exp(-2 |x - x_j|^2 / d) w_j, and takes this weight from
    its neighbours. Places that others have taken (m, d) do so before, and choices end at a share WORTHWHILE of the
    largest weight without them.
    """
    points, weights = places.reshape(-1, places.shape[-1]), weights.ravel()
    heaviest = np.argsort(-weights, kind="stable")[: 20 * CANDIDATES]
    candidates = heaviest[:: max(1, len(heaviest) // CANDIDATES)]
    points, weights = points[candidates], weights[candidates]
    nearness, least = _nearness(points, points), 0.0
    if taken is not None and len(taken):
        least = WORTHWHILE * (nearness @ weights).max(initial=0.0)
        weights = weights * (1 - _nearness(points, taken)).prod(axis=1)
    selected: list[int] = []
    while len(selected) < number and weights.any():
        around = (nearness @ weights) * (weights > 0)
        best = int(np.argmax(around))
        if around[best] < least:
            break
        selected.append(best)
        weights = weights * (1 - nearness[best])
    return points[selected]


def _nearness(a: Array, b: Array) -> Array:
    """exp(-2 |a - b|^2 / d) of points (n, d) and (m, d), (n, m)."""
    squares = sum(np.square(np.subtract.outer(x, y)) for x, y in zip(a.T, b.T, strict=True))
    return np.asarray(np.exp(-squares * 2 / a.shape[1]))


def quasi_random_points(number: int, d: int) -> Array:
    """Points (number, d) of the unit box without symmetry, nearer to corners than to the middle.

    They are x = sign(u) sqrt(0.25 + 0.7 |u|) of evenly spread points u.
    """
    u = evenly_spread_points(number, d)
    return np.asarray(np.sign(u) * np.sqrt(0.25 + 0.7 * np.abs(u)))


def evenly_spread_points(number: int, d: int) -> Array:
    """Points (number, d) of the unit box by Roberts' sequence.

    They are the multiples of the powers of 1 / r modulo 1, with r^(d + 1) = r + 1. (Roberts 2018, The unreasonable
    effectiveness of quasirandom sequences)
    """
    ratio = 2.0
    for _ in range(60):  # the fixed-point iteration converges to all digits
        ratio = (1 + ratio) ** (1 / (d + 1))
    return 2 * np.modf(0.5 + np.outer(np.arange(1, number + 1), ratio ** -np.arange(1.0, d + 1)))[0] - 1


def screening_corners(d: int) -> Array:
    """Corners (N, d) of the unit box: the rows of a Hadamard matrix that Paley's construction gives.

    For up to eleven parameters there are 12 corners. Among them is each combination of the signs of any three
    parameters. (Plackett and Burman 1946, The design of optimum multifactorial experiments)
    """
    prime = next(q for q in count(11, 4) if q >= d and all(q % k for k in range(3, q, 2)))
    signs = np.full(prime, -1.0)
    signs[np.square(np.arange(1, prime)) % prime] = 1.0
    cyclic = signs[np.subtract.outer(np.arange(prime), np.arange(prime)) % prime]
    return np.concatenate([np.ones((1, prime)), cyclic])[:MOST_CORNERS, :d]


def corner_design(d: int) -> Array:
    """All corners of the unit box, or, of more than ALL_CORNERS parameters, a share of them in which any four have all
    combinations of their signs (resolution V).

    Parameters beyond the first r, which have all combinations, take products of their signs. No sum of four or fewer of
    the vectors of factors may vanish modulo 2. (Box and Hunter 1961, The 2^(k-p) fractional factorial designs)
    """
    if d <= ALL_CORNERS:
        return corners(d)
    for r in count(1):
        columns, sums = list[int](), [{0}, {0}, {0}, {0}]  # sums of as many columns at most
        for column in (*(1 << k for k in range(r)), *range(1 << r)):
            if column not in sums[3]:
                columns.append(column)
                for n in (3, 2, 1):
                    sums[n] |= {column ^ other for other in sums[n - 1]}
        if len(columns) >= d:
            return np.stack(
                [corners(r)[:, [c >> k & 1 == 1 for k in range(r)]].prod(axis=1) for c in columns[:d]], axis=1
            )
    raise AssertionError


def screening_points(d: int) -> Array:
    """Points (N, d) where nothing else tells where responses vary: corners, and PROBES points between.

    Few corners are all of them: a kink may act in one only.
    """
    ends = corners(d) if 2**d <= MOST_CORNERS else screening_corners(d)
    return np.concatenate([ends, quasi_random_points(2 + PROBES, d)[2:]])


def count_shapes(Y: Array) -> Indices:
    """How many independent functions of time (...) deviations Y (..., N, m) from the mean of responses are made of.

    What few shapes hide, few numbers would: all times together may show no more than one. Shapes count from a share
    SHAPE_SHARE of the largest one on.
    """
    squares = np.linalg.eigvalsh(Y @ Y.swapaxes(-1, -2))
    return np.asarray((squares > SHAPE_SHARE**2 * squares[..., -1:]).sum(axis=-1))


def inflated_error(squares: Array, safety: float = SAFETY) -> Array:
    """Errors (n_t, n_y) to expect elsewhere from the largest squares of errors at check runs, by a factor.

    They are averages over a window, but at least what a check run showed: a pulse is shorter than a window.
    """
    return np.sqrt(np.maximum(safety**2 * average_over_window(squares), squares))
