"""The picture of a stability study: error against run time, drift over time, errors under stress."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from symmb._types import Array
from symmb.plot.layout import (
    COLOURS,
    DASHES,
    DIAGRAM_HEIGHT,
    LARGEST_ERROR,
    LEAST_ERROR,
    MARKERS,
    cyclic,
    new_figure,
    plain,
    save,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_stability(
    t: Array,
    points: Mapping[str, Sequence[tuple[float, float]]],
    drift: Mapping[str, Array],
    stress: Mapping[str, Mapping[str, float]],
    path: str | Path | None = None,
    *,
    title: str = "",
) -> "Figure":
    """Error against run time, drift of positions over time, and errors under stress; see `plot_comparison` for path.

    Parameters
    ----------
    points : solver -> (run time [s], error) of each setting; none where errors are not known
    drift : solver -> (n_t,) of one setting
    stress : solver -> what was done to the scene -> error
    """
    figure = new_figure(DIAGRAM_HEIGHT + 0.8)
    left, right, under = figure.subplots(1, 3)
    for k, name in enumerate(points):
        style = {"color": cyclic(COLOURS, k), "linestyle": cyclic(DASHES, k // len(COLOURS)), "linewidth": 1.1}
        seconds, errors = np.reshape(points[name], (-1, 2)).T
        left.loglog(
            seconds, np.clip(errors, LEAST_ERROR, LARGEST_ERROR), marker=cyclic(MARKERS, k), label=name, **style
        )
        right.semilogy(t, np.maximum(drift[name], LEAST_ERROR), **style)
        some = stress.get(name, {})
        under.semilogx(
            np.clip(list(some.values()), LEAST_ERROR, LARGEST_ERROR), list(some), cyclic(MARKERS, k), c=style["color"]
        )
    left.set(xlabel="run time [s]", ylabel="error [share of the motion]")
    right.set(xlabel="time [s]", ylabel="largest violation of a position row")
    under.set(xlabel="error under stress")
    for axes in (left, right, under):
        style_axes(axes)
        axes.grid(alpha=0.25)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    figure.suptitle(plain(title), fontsize=10)
    return save(figure, path)
