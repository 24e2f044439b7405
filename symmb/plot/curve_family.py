"""The picture of several curves for each output."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from symmb._types import Array
from symmb.plot.colours import COLOURS
from symmb.plot.layout import (
    HEAD_HEIGHT,
    ROW_HEIGHT,
    abscissa,
    along,
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
    shared_legend,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from symmb.plot.layout import GivenAxes


def plot_family(
    t: Array,
    curves: Array,
    names: Sequence[str],
    curve_names: Sequence[str],
    path: str | Path | None = None,
    *,
    units: Sequence[str] = (),
    chosen: Sequence[int] | None = None,
    title: str = "",
    owner: str = "plot",
    ax: "GivenAxes | None" = None,
) -> "Figure":
    """Curves (N, n_t, n_y) over times t (n_t,) [s], one panel an output; see `plot_comparison` for the others.

    Up to eight curves have a colour and a name each. More are coloured from the first to the last one, and the legend
    names the first, the middle and the last.
    """
    from matplotlib import colormaps

    columns = [*range(len(names))] if chosen is None else [*chosen]
    least = rounding(curves, units)[columns]
    names, units = [names[i] for i in columns], [units[i] for i in columns] if units else []
    N = len(curves)
    few = N <= len(COLOURS)
    shades = COLOURS if few else [colormaps["viridis"](0.9 * k / (N - 1)) for k in range(N)]
    named = {*range(N)} if few else {0, N // 2, N - 1}
    if ax is None:
        figure = new_figure(HEAD_HEIGHT + ROW_HEIGHT * n_rows(len(names)))
        panels = new_panels(figure, t, labels(names, units))
        figure.suptitle(plain(title), fontsize=10)
    else:
        panels = given_panels(owner, ax, t, names, units)
        figure = root(panels[0])
    for axes, i in zip(panels, columns, strict=True):
        for k in range(N):
            label = curve_names[k] if k in named else None
            axes.plot(abscissa(t), along(t, curves[k, :, i]), color=shades[k], linewidth=1.2, label=label)
    flatten(panels, least)
    if ax is None:
        shared_legend(figure, panels)
    else:
        own_legend(panels[0])
    return save(figure, path)
