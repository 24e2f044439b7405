"""The picture of several curves for each output."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from symmb._types import Array
from symmb.plot.colours import COLOURS
from symmb.plot.layout import abscissa, along, flatten, legends, outputs_of, panels_over_time, rounding

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from symmb.plot.layout import GivenAxes


def plot_family(
    t: Array,
    curves: Array,
    names: Sequence[str],
    curve_names: Sequence[str],
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

    columns, own_names, own_units = outputs_of(names, units, chosen)
    N = len(curves)
    few = N <= len(COLOURS)
    shades = COLOURS if few else [colormaps["viridis"](0.9 * k / (N - 1)) for k in range(N)]
    named = {*range(N)} if few else {0, N // 2, N - 1}
    figure, panels = panels_over_time(owner, ax, t, own_names, own_units, title=title)
    for axes, i in zip(panels, columns, strict=True):
        for k in range(N):
            label = curve_names[k] if k in named else None
            axes.plot(abscissa(t), along(t, curves[k, :, i]), color=shades[k], linewidth=1.2, label=label)
    flatten(panels, rounding(curves, units)[columns])
    legends(figure, panels[:1], ax)
    return figure
