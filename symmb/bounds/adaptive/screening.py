"""Runs at corners and between, where nothing else tells where responses vary."""

import numpy as np

from symmb.bounds.adaptive.check_runs import count_shapes, quasi_random_points, screening_corners
from symmb.bounds.adaptive.constants import FEW_SHAPES, MOST_CORNERS, SCREENING_PROBES, SPARSE_PROBES
from symmb.bounds.adaptive.runs import Runs
from symmb.bounds.time_windows import rests_for_a_time
from symmb.nodes import grid


def may_hide(runs: Runs) -> bool:
    """Whether runs tell as little as those of a few numbers: their responses have few shapes, or none for some time."""
    return count_shapes(runs.nodes, runs.rms_widths()) <= FEW_SHAPES or rests_for_a_time(*runs.extremes, runs.noise)


def screen(runs: Runs, most: int) -> None:
    """Check runs, so many at most. Few corners are all run: a kink may act in one of them only."""
    d = len(runs.box)
    corners = grid(np.array([-1.0, 1.0]), d) if 2**d <= MOST_CORNERS else screening_corners(d)
    points = quasi_random_points(SPARSE_PROBES + SCREENING_PROBES, d)[SPARSE_PROBES:]
    runs.check(np.concatenate([corners, points])[: max(most, 0)])
