"""The expansion of a response surface, for its moments."""

from collections.abc import Callable

import numpy as np

from symmb._types import Array
from symmb.bounds.adaptive.check_runs import quasi_random_points
from symmb.bounds.adaptive.constants import EXPANSION_SHARE, EXPANSION_SIZE
from symmb.bounds.adaptive.continuation import extrapolated_sizes, largest
from symmb.bounds.adaptive.runs import Runs
from symmb.nodes import Grid
from symmb.polynomials import Expansion


def surface_expansion(surface: Callable[[Array], Array], runs: Runs) -> Expansion | None:
    """Interpolant of a surface (N, d) -> (N, n_t n_y) on a sparse grid; None if it is not close to the surface."""
    d = len(runs.box)
    # Degree 2 does not tell x^3 from x.
    grid, step = Grid(d), {tuple(4 * (i == j) for j in range(d)) for i in range(d)}
    points = quasi_random_points(4 * d, d)
    expected = surface(points)
    while True:
        grid.add(grid.missing(step))
        coefficients = grid.coefficients(surface(grid.nodes))
        expansion = Expansion(grid.alpha, coefficients.reshape(-1, *runs.shape), runs.box.names)
        errors = np.abs(expansion.values(points).reshape(expected.shape) - expected)
        widths = np.where(np.ptp(expected, axis=0) > 0, np.ptp(expected, axis=0), np.inf)
        if (errors / widths).max() <= EXPANSION_SHARE:
            return expansion
        if len(grid.row) >= EXPANSION_SIZE:
            return None
        sizes = extrapolated_sizes(grid, np.abs(coefficients / widths).max(axis=1))
        step = largest(sizes, len(grid.row) // 4)
