"""The picture of measured values and a fitted run."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from symmb._types import Array
from symmb.plot.colours import COLOURS, RUN_COLOUR
from symmb.plot.layout import legends, panels_over_time

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from symmb.plot.layout import GivenAxes


def plot_fit(series: Sequence[tuple[str, Array, Array, Array]], ax: "GivenAxes | None" = None) -> "Figure":
    """One panel an output: its name, times [s], measured values and those of the fitted run, each (n,).

    See `plot_comparison` for ax.
    """
    whole, names = np.concatenate([t for _, t, _, _ in series]), [name for name, *_ in series]
    figure, panels = panels_over_time("Calibration.plot", ax, np.array([whole.min(), whole.max()]), names, [])
    for axes, (_, t, data, fitted) in zip(panels, series, strict=True):
        order = np.argsort(t)
        axes.plot(t, data, ".", color=RUN_COLOUR, markersize=4, label="data")
        axes.plot(t[order], fitted[order], color=COLOURS[0], linewidth=1.2, label="fitted run")
    legends(figure, panels, ax)
    return figure
