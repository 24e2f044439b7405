"""Reports: a result, what it means and how it was found, in one HTML file that opens offline and prints.

`Bounds.report` and `Comparison.report` load this room, which stands above the rooms of these results.
"""

from symmb.show.report.bounds_report import write_bounds
from symmb.show.report.comparison_report import write_comparison
from symmb.show.report.document import BLOCK
