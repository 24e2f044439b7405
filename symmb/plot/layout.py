"""The common layout of all pictures: size, panels, colours, legend, saving.

Figures are drawn without pyplot, so nothing global changes. matplotlib loads on the first call.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from symmb._types import Array
from symmb.files import replacement, require_suffix

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase

PICTURES = (".png", ".pdf", ".svg")
"""Formats of pictures."""
MOST_PANELS = 6
"""Most outputs whose bounds are drawn: more panels are too small to read."""
WIDTH, ROW_HEIGHT, HEAD_HEIGHT, DIAGRAM_HEIGHT = 10.0, 1.8, 0.3, 3.8
"""Width of a figure, and heights of a row of panels, of the title and of a diagram [inch]."""
DPI = 150
"""Resolution of saved pictures [1/inch]: sharp at the width of a text column."""
COLOURS = ("#0b6fb8", "#d1495b", "#2e8b57", "#e08e00", "#7a4fb5", "#4b5563", "#00929c", "#9c5a2d")
"""Line style and marker differ as well, for readers who cannot distinguish red and green."""
MARKERS = "osD^vPX*"
DASHES = ((0, ()), (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)), (0, (3, 1.5)), (0, (8, 3)))
BAND_COLOUR = "#c9d3dd"
LEAST_ERROR, LARGEST_ERROR = 1e-16, 10.0
"""Range of drawn errors: rounding, as a share of the width, and a run that has lost the motion, as a share of it."""
NUMBER_DISTANCE = 16.0
"""Distance from which on a number does not touch others [point]."""


def new_figure(height: float) -> "Figure":
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: "Figure", path: str | Path | None) -> "Figure":
    """Write the figure to a path, if there is one. Its suffix chooses the format."""
    if path is not None:
        suffix = require_suffix(path, *PICTURES)
        with replacement(path) as file:
            figure.savefig(file, format=suffix[1:])
    return figure


def new_panels(figure: "FigureBase", t: Array, names: Sequence[str]) -> list["Axes"]:
    """One named panel an output, on a common time axis."""
    columns = n_columns(len(names))
    grid = figure.subplots(n_rows(len(names)), columns, sharex=True, squeeze=False).ravel()
    for axes in grid[len(names) :]:
        axes.set_visible(False)
    for i, (axes, name) in enumerate(zip(grid, names, strict=False)):
        axes.set_title(plain(name), fontsize=9, loc="left", fontweight="bold", pad=3)
        axes.set_xlim(*abscissa(t)[[0, -1]])
        if len(t) == 1:
            axes.set_xticks(t)
        axes.grid(color="#e3e7eb", linewidth=0.6)
        axes.ticklabel_format(useOffset=False)
        style_axes(axes)
        if i + columns >= len(names):
            axes.set_xlabel("time [s]", fontsize=8)
            axes.tick_params(labelbottom=True)
    return list(grid[: len(names)])


def plain(text: str) -> str:
    """A text whose dollar signs are not mathematics."""
    return text.replace("$", r"\$")


def abscissa(t: Array) -> Array:
    """The times; a single one is drawn as a stretch."""
    return t if len(t) > 1 else t + np.array([-0.5, 0.5])


def along(t: Array, values: Array) -> Array:
    """Values (n_t,) at the abscissa of the times t (n_t,)."""
    return np.broadcast_to(values, abscissa(t).shape)


def style_axes(axes: "Axes") -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)


def n_columns(n: int) -> int:
    return 1 if n == 1 else 2 if n in (2, 4) else 3


def n_rows(n: int) -> int:
    return -(-n // n_columns(n))


def cyclic(styles: Sequence[Any], k: int) -> Any:
    return styles[k % len(styles)]


def shared_legend(figure: "FigureBase", panels: Sequence["Axes"]) -> None:
    """One legend of all panels, which is that of the first."""
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, [*map(plain, labels)], loc="outside lower center", ncols=3, fontsize=8, frameon=False)


def labels(names: Sequence[str], units: Sequence[str]) -> tuple[str, ...]:
    """Names with their units in brackets, where there are any."""
    units = units or [""] * len(names)
    return tuple(f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True))
