"""Ranges of many polynomials over the unit box: exact, Bernstein, or by interval arithmetic.

The compiled parts are in codegen/c.
"""

from symmb.bound.polynomials.ranges.branch_and_bound import range_tables
from symmb.bound.polynomials.ranges.dense import HIGHEST_DEGREE, MOST_PARAMETERS, dense_extremes
from symmb.bound.polynomials.ranges.exact import RANGE_ERROR, RANGE_WORK, Exact
from symmb.bound.polynomials.ranges.inclusion import LegendreInclusion, Range
from symmb.bound.polynomials.ranges.piecewise import (
    Piecewise,
    attained_extremes,
    in_other_coordinates,
    joined,
    last_terms,
)
