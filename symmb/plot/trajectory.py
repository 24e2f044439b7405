"""The picture of a trajectory."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from symmb._types import Array
from symmb.plot.colours import COLOURS, RUN_COLOUR
from symmb.plot.layout import (
    HEAD_HEIGHT,
    ROW_HEIGHT,
    abscissa,
    along,
    cyclic,
    flatten,
    given_panels,
    labels,
    n_rows,
    new_figure,
    new_panels,
    own_legend,
    plain,
    root,
    rounding,
    save,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from symmb.plot.layout import GivenAxes


def plot_trajectory(
    t: Array,
    values: Array,
    names: Sequence[str],
    path: str | Path | None = None,
    *,
    units: Sequence[str] = (),
    chosen: Sequence[int] | None = None,
    title: str = "",
    ax: "GivenAxes | None" = None,
) -> "Figure":
    """Values (n_t, n_y) over times t (n_t,) [s], one panel an output; see `plot_comparison` for names,
    units, chosen, path and ax.

    In a single one of the caller's axes all outputs are drawn, each with a colour of its own.
    """
    columns = [*range(len(names))] if chosen is None else [*chosen]
    least = rounding(values, units)[columns]
    names, units = [names[i] for i in columns], [units[i] for i in columns] if units else []
    if ax is None:
        figure = new_figure(HEAD_HEIGHT + ROW_HEIGHT * n_rows(len(names)))
        panels = new_panels(figure, t, labels(names, units))
        figure.suptitle(plain(title), fontsize=10)
    else:
        panels = given_panels("Trajectory.plot", ax, t, names, units, overlay=True)
        figure = root(panels[0])
    several = len(panels) > 1 and panels[0] is panels[1]
    for k, (axes, i) in enumerate(zip(panels, columns, strict=True)):
        colour = cyclic(COLOURS, k) if several else RUN_COLOUR
        axes.plot(abscissa(t), along(t, values[:, i]), color=colour, linewidth=1.2, label=names[k])
    flatten(panels, np.full(len(panels), least.max()) if several else least)
    if several:
        own_legend(panels[0])
    return save(figure, path)
