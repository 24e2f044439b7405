"""Reports: a result, its meaning and its computation, in one HTML file that opens offline and can be printed.

`Bounds.report` and `Comparison.report` load this package when they are called, because it depends on these results.
"""

from symmb.show.report.bounds_report import write_bounds
from symmb.show.report.comparison_report import write_comparison
from symmb.show.report.document import BLOCK
