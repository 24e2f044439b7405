"""Runs at extremes of interpolants: where they tell most, and what errors they let expect elsewhere."""

import numpy as np

from symmb._types import Array
from symmb.bounds._tails import smooth

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


def seen(errors: Array) -> Array:
    """Errors (n_t, n_y) to be expected elsewhere from those at check runs (C, n_t, n_y)."""
    return _SAFETY * np.sqrt(smooth(np.square(errors).max(axis=0)))
