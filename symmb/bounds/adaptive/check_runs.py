"""Runs at extremes of interpolants: where they tell most, and what errors they let expect elsewhere."""

import numpy as np

from symmb._types import Array
from symmb.bounds.adaptive.truncation_error import smooth

TRUST = 0.6
"""Least share of its estimated error that an interpolant keeps when check runs see less."""
_SAFETY = 2.5
"""What the errors seen by check runs are multiplied with: they are those at a few of the extremes."""
_CANDIDATES = 150
"""Extremes among which check runs are chosen."""


def spread(places: Array, weights: Array, number: int) -> Array:
    """So many of the places (2, n_t, n_y, d), where most of the weight (2, n_t, n_y) is, not close to each other."""
    points, weights = places.reshape(-1, places.shape[-1]), weights.ravel()
    first = max(len(weights) - 20 * _CANDIDATES, 0)
    heaviest = np.flatnonzero(weights >= np.partition(weights, first)[first])
    heaviest = heaviest[np.argsort(weights[heaviest], kind="stable")]  # the same order on every processor
    chosen = heaviest[:: max(1, len(heaviest) // _CANDIDATES)]
    points, weights = points[chosen], weights[chosen]
    near = np.exp(-sum(np.square(np.subtract.outer(x, x)) for x in points.T) * 2 / points.shape[1])
    picked: list[int] = []
    while len(picked) < number and weights.any():
        picked.append(int(np.argmax((near @ weights) * (weights > 0))))
        weights = weights * (1 - near[picked[-1]])
    return points[picked]


def generic(number: int, d: int) -> Array:
    """So many points (number, d) of the box that no symmetry singles out, nearer to corners than to the middle."""
    ratio = 2.0
    for _ in range(60):
        ratio = (1 + ratio) ** (
            1 / (d + 1)
        )  # the root of x^(d + 1) = x + 1, whose powers have no relations (Roberts 2018)
    x = 2 * np.modf(0.5 + np.outer(np.arange(1, number + 1), ratio ** -np.arange(1.0, d + 1)))[0] - 1
    return np.asarray(np.sign(x) * np.sqrt(0.25 + 0.7 * np.abs(x)))


def seen(errors: Array) -> Array:
    """Errors (n_t, n_y) to be expected elsewhere from those at check runs (C, n_t, n_y)."""
    return _SAFETY * np.sqrt(smooth(np.square(errors).max(axis=0)))
