"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .bounds import (
    Band as Band,
    PlottedBounds as PlottedBounds,
    add_limits as add_limits,
    family as family,
    plot_bounds as plot_bounds,
)
from .colours import COLOURS as COLOURS, colour_of as colour_of
from .comparison import plot_comparison as plot_comparison
from .contributions import plot_contributions as plot_contributions
from .curves import (
    RunLines as RunLines,
    plot_family as plot_family,
    plot_fit as plot_fit,
    plot_trajectory as plot_trajectory,
)
from .drawn import (
    MOST_PANELS as MOST_PANELS,
    OverTime as OverTime,
    OverTimeBesideGiven as OverTimeBesideGiven,
    ThreeDiagrams as ThreeDiagrams,
)
from .layout import (
    PICTURES as PICTURES,
    columns_of as columns_of,
    finish as finish,
    labels as labels,
    narrow_png as narrow_png,
    png as png,
    rounding as rounding,
    save as save,
)
from .root_locus import plot_root_locus as plot_root_locus
from .stability import plot_stability as plot_stability
from .style import Style as Style
