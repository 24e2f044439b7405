"""Methods that bound responses over a box of parameters, and their results.

The method that chooses its own runs is in `bounds.adaptive`.
"""

from symmb.bounds.contributions import Contributions
from symmb.bounds.doubts import checked, doubted
from symmb.bounds.limits import KeptLimit, LimitCheck, Limits, limit_pairs
from symmb.bounds.method import Method, parameter_samples, units_of
from symmb.bounds.optimization import Optimization
from symmb.bounds.polynomial_chaos import PolynomialChaos
from symmb.bounds.propagation import finished, propagate
from symmb.bounds.reductions import gathered
from symmb.bounds.registry import METHODS, method_of, read_method
from symmb.bounds.result import Bounds
from symmb.bounds.result_file import INNER, box_coordinates, box_entries, box_of, inner_entries, kind_of
from symmb.bounds.sampling import MonteCarlo, Scanning, Vertex
from symmb.bounds.study import Study
from symmb.bounds.time_windows import ROUNDING
from symmb.bounds.worst_case import SIDES, Sample, WorstCase, row_of, worst_rows
