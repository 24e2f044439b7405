"""Points of check runs, such as the point with the largest expected error, and the safety factors of measured errors.

`inflated_error` multiplies a measured error by these factors.
"""

from itertools import count

import numpy as np

from symmb._types import Array
from symmb.bound.nodes import corners
from symmb.bound.responses import WINDOW, average_over_window

SAFETY = 2.5
"""Safety factor on measured errors and on the standard deviation of noise, because errors elsewhere may be larger. A
smaller factor misses more errors. A larger factor takes more runs."""
FIELD_SAFETY = 1.6
"""SAFETY for rounds near extremes of outputs with many functions of time. It is smaller, because check runs show errors
at many times. With 2.5, 24 everyday machines take 1.08 times the runs, and miss 0.05 % fewer values in silence."""
CANDIDATES = 150
"""Number of extremes from which check points are chosen. It is limited because all pairs are compared. Searches on
surfaces start from the same number of points. Larger numbers take more time and miss fewer extremes."""
WORTHWHILE = 0.3
"""An output adds check points to those of other outputs if its weight exceeds this fraction of the largest weight.
Smaller fractions take more runs."""
FEW_TIMES = 8
"""Largest number of times of an output with a response surface, because the extremes of each time require searches."""
FEW_SHAPES, SHAPE_SHARE = 3, 1e-2
"""Largest number of independent functions of time in an output whose runs say little, and smallest ratio of the size of
a function to the largest size. Larger values take more check runs. (tests/answers/test_answers.py)"""
PROBES = 6
"""Number of quasi-random check points. Symmetric responses may be equal at all nodes, because nodes are at the centre,
the ends and the halves. More points find narrower peaks."""
PATIENCE = 30
"""Largest number of runs per parameter, on a grid that does not converge and at corners. Larger numbers take more runs
and miss fewer extremes."""
ALL_CORNERS = 10
"""Largest number of parameters with runs at all corners, if runs are computed together. More would take seconds."""
MOST_CORNERS = 32
"""Largest number of corners if no other information shows where a response varies. Larger numbers take more runs and
miss fewer extremes."""


def select_dispersed(places: Array, weights: Array, number: int, taken: Array | None = None) -> Array:
    """At most `number` of the places (2, n_t, n_y, d), with large weights and not close together, as an array (n, d).

    Each choice maximises the weight in its neighbourhood, sum_j exp(-2 |x - x_j|^2 / d) w_j. The weights of neighbours
    are then reduced. If places (m, d) are `taken` already, weights near these places are reduced first. The choice then
    ends if the weight is below the fraction WORTHWHILE of the largest initial weight.
    """
    points, weights = places.reshape(-1, places.shape[-1]), weights.ravel()
    # All pairs are compared, so there are few candidates. Places with the largest weights are mostly at neighbouring
    # times of one extreme. A stride over many places includes other extremes.
    heaviest = np.arange(len(weights))
    if len(weights) > 20 * CANDIDATES:  # a partition takes less time than a complete sort
        heaviest = np.flatnonzero(weights >= np.partition(weights, -20 * CANDIDATES)[-20 * CANDIDATES])
    heaviest = heaviest[np.argsort(-weights[heaviest], kind="stable")][: 20 * CANDIDATES]
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
    """Kernel exp(-2 |a - b|^2 / d) of points (n, d) and (m, d), an array (n, m)."""
    squares = sum(np.square(np.subtract.outer(x, y)) for x, y in zip(a.T, b.T, strict=True))
    return np.asarray(np.exp(-squares * 2 / a.shape[1]))


def quasi_random_points(number: int, d: int) -> Array:
    """Points (number, d) of the unit box without symmetry, closer to the corners than to the centre.

    The points are x = sign(u) sqrt(0.25 + 0.7 |u|) for evenly spread points u.
    """
    u = evenly_spread_points(number, d)
    return np.asarray(np.sign(u) * np.sqrt(0.25 + 0.7 * np.abs(u)))


def evenly_spread_points(number: int, d: int) -> Array:
    """Points (number, d) of the unit box from Roberts' quasi-random sequence.

    The coordinates are multiples of powers of 1 / r, modulo 1, with r^(d + 1) = r + 1. (Roberts 2018, The unreasonable
    effectiveness of quasirandom sequences)
    """
    ratio = 2.0
    for _ in range(60):  # the fixed-point iteration converges to all digits
        ratio = (1 + ratio) ** (1 / (d + 1))
    return 2 * np.modf(0.5 + np.outer(np.arange(1, number + 1), ratio ** -np.arange(1.0, d + 1)))[0] - 1


def screening_corners(d: int) -> Array:
    """Corners (N, d) of the unit box: the rows of a Hadamard matrix by Paley's construction.

    For up to eleven parameters there are 12 corners. These corners contain each combination of signs of any three
    parameters. (Plackett and Burman 1946, The design of optimum multifactorial experiments)
    """
    prime = next(q for q in count(11, 4) if q >= d and all(q % k for k in range(3, q, 2)))
    signs = np.full(prime, -1.0)
    signs[np.square(np.arange(1, prime)) % prime] = 1.0
    cyclic = signs[np.subtract.outer(np.arange(prime), np.arange(prime)) % prime]
    return np.concatenate([np.ones((1, prime)), cyclic])[:MOST_CORNERS, :d]


def corner_design(d: int) -> Array:
    """Corners (N, d) of the unit box: all, or with more than ALL_CORNERS parameters a subset of resolution V.

    The subset contains all sign combinations of any four parameters. The first r parameters have all combinations. The
    sign of each other parameter is a product of signs of these r. No sum of four or fewer vectors of factors may vanish
    modulo 2. (Box and Hunter 1961, The 2^(k-p) fractional factorial designs)
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
    """Points (N, d) for responses about which nothing else is known: corners, and PROBES points inside.

    If there are few corners, all corners are used, because a kink may affect one corner only.
    """
    ends = corners(d) if 2**d <= MOST_CORNERS else screening_corners(d)
    return np.concatenate([ends, quasi_random_points(2 + PROBES, d)[2:]])


def has_few_shapes(Y: Array) -> bool:
    """Whether responses Y (N, n_t, 1) have few independent functions of time beside their mean.

    Values at many times may follow a single function. Such values contain no more information than one number. Some
    runs and twice as many times suffice.
    """
    some = Y[: round(1 / WINDOW), :: max(1, Y.shape[1] // round(2 / WINDOW)), 0]
    deviations = some - some.mean(axis=0)
    squares = np.linalg.eigvalsh(deviations @ deviations.T)
    return int((squares > SHAPE_SHARE**2 * squares[-1]).sum()) <= FEW_SHAPES


def inflated_error(squares: Array, safety: float = SAFETY) -> Array:
    """Expected errors (n_t, n_y) at other points, from the largest squared errors at check runs and a factor.

    Errors are averaged over a window, but are at least the errors of check runs, because pulses may be short.
    """
    return np.sqrt(np.maximum(safety**2 * average_over_window(squares), squares))
