"""Polynomial chaos that chooses its runs and estimates its own error.

Tensor grids serve few parameters, sparse grids many.
"""

from symmb.bounds.adaptive.adaptive_bounds import adaptive_bounds
from symmb.bounds.adaptive.check_runs import count_shapes, evenly_spread_points, quasi_random_points, select_dispersed
from symmb.bounds.adaptive.constants import (
    CHEAP_RUNS,
    FEW_SHAPES,
    FEWEST_BOXES,
    INHERITED_SHARE,
    MANY_VALUES,
    RANGE_WORK,
    SMALLEST_HALF_WIDTH,
    SPARSE_PROBES,
    TENSOR_PARAMETERS,
)
from symmb.bounds.adaptive.monotone import monotone_bounds
from symmb.bounds.adaptive.runs import EstimatedRange, Runs, relative_errors, relative_rms, typical_error
from symmb.bounds.adaptive.screening import screen
