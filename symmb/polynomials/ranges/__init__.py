"""Ranges of many polynomials over the unit box: exact, Bernstein, or by interval arithmetic.

The compiled parts are in codegen/c.
"""

from symmb.polynomials.ranges.dense import HIGHEST_DEGREE, MOST_PARAMETERS, dense_extremes
from symmb.polynomials.ranges.exact import Exact
from symmb.polynomials.ranges.inclusion import LegendreInclusion, Range
from symmb.polynomials.ranges.piecewise import Piecewise, attained_extremes, joined, last_terms
