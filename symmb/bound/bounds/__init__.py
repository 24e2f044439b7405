"""Methods that bound responses over a box of parameters, and their results.

- `propagation` computes bounds of a simulator by a method. `registry` lists the methods. Each method has a file with
  its name. Methods that use extremes of runs are in `sampling`. Polynomial chaos that chooses its own runs is in
  `adaptive`.
- `result` has the bounds, `envelope` has their curves, and `doubts` and `check_runs` have the warnings about bounds.
- `answers` computes results from bounds: `limits`, `worst_case`, `contributions` and `probabilities`. `answers` uses
the polynomials or runs in `responses`.
"""

from symmb.bound.bounds.box_runs import parameter_samples
from symmb.bound.bounds.contributions import Contributions
from symmb.bound.bounds.doubts import checked, doubted, far_intervals, idle_parameters
from symmb.bound.bounds.laws import Laws
from symmb.bound.bounds.limits import (
    WARNED,
    KeptLimit,
    LimitCheck,
    Limits,
    limit_pairs,
    limit_text,
    other_side,
    unit_suffix,
)
from symmb.bound.bounds.method import Method, bounded, possible_values, units_of
from symmb.bound.bounds.optimization import Optimization
from symmb.bound.bounds.polynomial_chaos import PolynomialChaos
from symmb.bound.bounds.propagation import finished, propagate
from symmb.bound.bounds.reductions import gathered
from symmb.bound.bounds.registry import METHODS, method_of, read_method
from symmb.bound.bounds.regression import fitted
from symmb.bound.bounds.result import Bounds
from symmb.bound.bounds.result_file import INNER, Kind, box_coordinates, box_entries, box_of, inner_entries, kind_of
from symmb.bound.bounds.sampling import MonteCarlo, Scanning, Vertex
from symmb.bound.bounds.statistical import Statistics, laws_within, rejects_of, statistics_of
from symmb.bound.bounds.study import Extremes, Study
from symmb.bound.bounds.worst_case import SIDES, Sample, WorstCase, row_of, worst_rows
