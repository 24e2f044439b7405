"""Runs at corners and between, where nothing else tells where responses vary."""

import numpy as np

from symmb.bounds.adaptive.check_runs import count_shapes, quasi_random_points, screening_corners
from symmb.bounds.adaptive.constants import FEW_SHAPES, SCREENING_PROBES, SPARSE_PROBES
from symmb.bounds.adaptive.runs import Runs
from symmb.bounds.time_windows import rests_for_a_time


def may_hide(runs: Runs) -> bool:
    """Whether runs tell as little as those of a few numbers: their responses have few shapes, or none for some time."""
    return count_shapes(runs.nodes, runs.rms_widths()) <= FEW_SHAPES or rests_for_a_time(*runs.extremes, runs.noise)


def screen(runs: Runs, most: int) -> None:
    """Check runs, so many at most."""
    d = len(runs.box)
    points = quasi_random_points(SPARSE_PROBES + SCREENING_PROBES, d)[SPARSE_PROBES:]
    runs.check(np.concatenate([screening_corners(d), points])[: max(most, 0)])
