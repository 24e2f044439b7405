"""Reports of results. A report is one HTML file, which can be opened offline and printed.

This package depends on results. `Bounds.report` and `Comparison.report` therefore load it when they are called.
"""

from symmb._doors import open_door

open_door(__name__)
