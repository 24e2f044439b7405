"""The picture of a trajectory."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from symmb._types import Array
from symmb.plot.layout import (
    COLOURS,
    HEAD_HEIGHT,
    ROW_HEIGHT,
    abscissa,
    along,
    n_rows,
    new_figure,
    new_panels,
    plain,
    save,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_trajectory(
    t: Array, values: Array, names: Sequence[str], path: str | Path | None = None, *, title: str = ""
) -> "Figure":
    """Values (n_t, n_y) over times t (n_t,) [s], one panel an output; see `plot_comparison` for path."""
    figure = new_figure(HEAD_HEIGHT + ROW_HEIGHT * n_rows(len(names)))
    for i, axes in enumerate(new_panels(figure, t, names)):
        axes.plot(abscissa(t), along(t, values[:, i]), color=COLOURS[0], linewidth=1.2)
    figure.suptitle(plain(title), fontsize=10)
    return save(figure, path)
