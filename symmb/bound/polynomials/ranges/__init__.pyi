"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .branch_and_bound import compiled_ranges as compiled_ranges, range_tables as range_tables
from .dense import (
    HIGHEST_DEGREE as HIGHEST_DEGREE,
    MOST_PARAMETERS as MOST_PARAMETERS,
    dense_extremes as dense_extremes,
)
from .exact import RANGE_ERROR as RANGE_ERROR, RANGE_WORK as RANGE_WORK, Exact as Exact
from .inclusion import (
    Bernstein as Bernstein,
    ChebyshevInclusion as ChebyshevInclusion,
    LegendreInclusion as LegendreInclusion,
    Range as Range,
)
from .line_search import searched_extremes as searched_extremes
from .piecewise import (
    Piecewise as Piecewise,
    attained_extremes as attained_extremes,
    joined as joined,
    last_terms as last_terms,
)
