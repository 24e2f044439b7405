"""Reports of results. A report is one HTML file, which can be opened offline and printed.

This package depends on results. `Bounds.report` and `Comparison.report` therefore load it when they are called.
"""

from symmb.show.report.bounds_report import write_bounds
from symmb.show.report.comparison_report import write_comparison
from symmb.show.report.document import BLOCK
