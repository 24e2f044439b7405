"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .doubts import (
    doubts_of_checks as doubts_of_checks,
    doubts_of_runs as doubts_of_runs,
    far_intervals as far_intervals,
    idle_parameters as idle_parameters,
    with_doubts as with_doubts,
)
from .propagation import finished as finished, propagate as propagate
from .study import Extremes as Extremes, Study as Study
