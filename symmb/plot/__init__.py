"""Pictures of numbers, drawn with matplotlib from plain arrays.

Results of the rooms above draw themselves with these functions.
"""

from symmb.plot.bounds import Band, PlottedBounds, add_limits, family, plot_bounds
from symmb.plot.colours import COLOURS, colour_of
from symmb.plot.comparison import plot_comparison
from symmb.plot.contributions import plot_contributions
from symmb.plot.curves import plot_family, plot_fit, plot_trajectory
from symmb.plot.drawn import OverTime, OverTimeBesideGiven, ThreeDiagrams
from symmb.plot.layout import MOST_PANELS, PICTURES, columns_of, finish, labels, narrow_png, png, save
from symmb.plot.root_locus import plot_root_locus
from symmb.plot.stability import plot_stability
from symmb.plot.style import Style
