"""The picture of measured values and a fitted run."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from symmb._types import Array
from symmb.plot.colours import COLOURS, RUN_COLOUR
from symmb.plot.layout import HEAD_HEIGHT, ROW_HEIGHT, n_rows, new_figure, new_panels, save, shared_legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_fit(series: Sequence[tuple[str, Array, Array, Array]], path: str | Path | None = None) -> "Figure":
    """One panel an output: its name, times [s], measured values and those of the fitted run, each (n,)."""
    figure = new_figure(HEAD_HEIGHT + ROW_HEIGHT * n_rows(len(series)))
    whole = np.concatenate([t for _, t, _, _ in series])
    panels = new_panels(figure, np.array([whole.min(), whole.max()]), [name for name, *_ in series])
    for axes, (_, t, data, fitted) in zip(panels, series, strict=True):
        order = np.argsort(t)
        axes.plot(t, data, ".", color=RUN_COLOUR, markersize=4, label="data")
        axes.plot(t[order], fitted[order], color=COLOURS[0], linewidth=1.2, label="fitted run")
    shared_legend(figure, panels)
    return save(figure, path)
