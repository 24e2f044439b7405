"""Points of a box that satisfy its constraints."""

import numpy as np

from symmb._types import Array
from symmb.bound.nodes import Sobol
from symmb.equations.model import Box, excess

_FIRST, _BEYOND = 2**14, 1.15
"""Number of points that are spread over a box. Points up to this factor outside are moved to the faces."""
FEW, _POINTS, _ROUNDS = 50, 64, 60
"""With fewer allowed points, a search looks for further ones. Numbers of its points and rounds. If it finds none, the
bounds may miss a part of the allowed points."""


def allowed_points(box: Box, points: Array) -> Array:
    """The points (n, d) of the unit box among given points (N, d) that are allowed."""
    return points[box.allowed(box.from_unit(points))] if box.constraints else points


def first_points(box: Box) -> Array:
    """Allowed points (n, d) spread over the unit box and over its faces and edges; empty if none is found."""
    spread = np.clip(_BEYOND * Sobol().points(_FIRST, len(box), seed=0), -1.0, 1.0)
    points = np.where(box.radius > 0, spread, 0.0)
    found = allowed_points(box, points)
    return np.unique(found if len(found) >= FEW else np.concatenate([found, _approached(box, points)]), axis=0)


def _approached(box: Box, points: Array) -> Array:
    """Allowed points of a small set (n, d), by differential evolution from the points (N, d) that miss it least."""
    # Storn and Price (1997). The constraints must return numbers, which say how far a point is from being allowed.
    random = np.random.default_rng(0)
    missed = excess(box.constraints, box.names, box.from_unit(points))
    best = np.argsort(missed, kind="stable")[:_POINTS]
    own, missed = points[best], missed[best]
    for _ in range(_ROUNDS):
        a, b, c = own[random.integers(len(own), size=(3, len(own)))]
        others = np.clip(np.where(random.random(own.shape) < 0.9, a + 0.7 * (b - c), own), -1.0, 1.0)
        of_others = excess(box.constraints, box.names, box.from_unit(others))
        is_better = of_others <= missed
        own[is_better], missed[is_better] = others[is_better], of_others[is_better]
    return own[missed == 0]
