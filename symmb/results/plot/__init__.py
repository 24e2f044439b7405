"""Pictures of numbers, drawn with matplotlib from plain arrays.

The plot methods of results use these functions.
"""

from symmb.results.plot.bounds import Band, PlottedBounds, add_limits, family, plot_bounds
from symmb.results.plot.colours import COLOURS, colour_of
from symmb.results.plot.comparison import plot_comparison
from symmb.results.plot.contributions import plot_contributions
from symmb.results.plot.curves import RunLines, plot_family, plot_fit, plot_trajectory
from symmb.results.plot.drawn import OverTime, OverTimeBesideGiven, ThreeDiagrams
from symmb.results.plot.layout import MOST_PANELS, PICTURES, columns_of, finish, labels, narrow_png, png, rounding, save
from symmb.results.plot.root_locus import plot_root_locus
from symmb.results.plot.stability import plot_stability
from symmb.results.plot.style import Style
