"""Pictures of numbers, drawn with matplotlib from plain arrays.

Results of the rooms above draw themselves with these functions.
"""

from symmb.plot.figures import (
    Band,
    Curve,
    family,
    labels,
    plot_bounds,
    plot_comparison,
    plot_stability,
    plot_trajectory,
)
