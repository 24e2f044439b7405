"""The picture of a trajectory."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from symmb._types import Array
from symmb.plot.colours import COLOURS, RUN_COLOUR
from symmb.plot.layout import abscissa, along, cyclic, flatten, outputs_of, own_legend, panels_over_time, rounding

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from symmb.plot.layout import GivenAxes


def plot_trajectory(
    t: Array,
    values: Array,
    names: Sequence[str],
    *,
    units: Sequence[str] = (),
    chosen: Sequence[int] | None = None,
    title: str = "",
    ax: "GivenAxes | None" = None,
) -> "Figure":
    """Values (n_t, n_y) over times t (n_t,) [s], one panel an output; see `plot_comparison` for names,
    units, chosen and ax.

    In a single one of the caller's axes all outputs are drawn, each with a colour of its own.
    """
    columns, own_names, own_units = outputs_of(names, units, chosen)
    least = rounding(values, units)[columns]
    figure, panels = panels_over_time("Trajectory.plot", ax, t, own_names, own_units, title=title, overlay=True)
    several = len(panels) > 1 and panels[0] is panels[1]
    for k, (axes, i) in enumerate(zip(panels, columns, strict=True)):
        colour = cyclic(COLOURS, k) if several else RUN_COLOUR
        axes.plot(abscissa(t), along(t, values[:, i]), color=colour, linewidth=1.2, label=own_names[k])
    flatten(panels, np.full(len(panels), least.max()) if several else least)
    if several:
        own_legend(panels[0])
    return figure
