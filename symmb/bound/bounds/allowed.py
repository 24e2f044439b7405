"""Points of a box that satisfy its constraints."""

import numpy as np

from symmb._types import Array
from symmb.bound.nodes import Sobol
from symmb.equations.model import Box

_FIRST, _BEYOND = 2**14, 1.15
"""Number of points that are spread over a box. Points up to this factor outside are moved to the faces."""


def allowed_points(box: Box, points: Array) -> Array:
    """The points (n, d) of the unit box among given points (N, d) that are allowed."""
    return points[box.allowed(box.from_unit(points))] if box.constraints else points


def first_points(box: Box) -> Array:
    """Allowed points (n, d) spread over the unit box and over its faces and edges; empty if none is found."""
    spread = np.clip(_BEYOND * Sobol().points(_FIRST, len(box), seed=0), -1.0, 1.0)
    return np.unique(allowed_points(box, np.where(box.radius > 0, spread, 0.0)), axis=0)
