"""The picture of a stability study: error against run time, drift over time, errors under stress."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array
from symmb.plot.colours import colour_of
from symmb.plot.layout import (
    DASHES,
    DIAGRAM_HEIGHT,
    LARGEST_ERROR,
    LEAST_ERROR,
    MARKERS,
    axes_in,
    cyclic,
    new_figure,
    own_legend,
    plain,
    root,
    save,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from symmb.plot.layout import GivenAxes


def plot_stability(
    t: Array,
    points: Mapping[str, Sequence[tuple[float, float]]],
    drift: Mapping[str, Array],
    stress: Mapping[str, Mapping[str, float]],
    path: str | Path | None = None,
    *,
    title: str = "",
    ax: "GivenAxes | None" = None,
) -> "Figure":
    """Error against run time, drift of positions over time, and errors under stress; see `plot_comparison` for path.

    Parameters
    ----------
    points : solver -> (run time [s], error) of each setting; none where errors are not known
    drift : solver -> (n_t,) of one setting
    stress : solver -> what was done to the scene -> error
    ax : the caller's axes     up to three, one for each of these diagrams in this order
    """
    if ax is None:
        figure = new_figure(DIAGRAM_HEIGHT + 0.8)
        panels = list(figure.subplots(1, 3))
    else:
        panels = axes_in("Stability.plot", ax)
        figure = root(panels[0])
        if len(panels) > 3:
            raise DeclarationError(f"Stability.plot: there are three diagrams, got {len(panels)} axes.")
    over_time = {name: (t, values) for name, values in drift.items()}
    diagrams: list[tuple[Callable[..., None], Any]] = [
        (_draw_errors, points),
        (_draw_drift, over_time),
        (_draw_stress, stress),
    ]
    for axes, (draw, values) in zip(panels, diagrams, strict=False):  # the caller may have fewer axes
        for k, name in enumerate(points):
            style = {"color": colour_of(name), "linestyle": cyclic(DASHES, k), "linewidth": 1.1, "label": plain(name)}
            draw(axes, values.get(name, {}), cyclic(MARKERS, k), style)
        style_axes(axes)
        axes.grid(alpha=0.25)
    if ax is None:
        shown = panels[0].get_legend_handles_labels()
        figure.legend(*shown, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
        figure.suptitle(plain(title), fontsize=10)
    else:
        own_legend(panels[0])
    return save(figure, path)


def _draw_errors(axes: "Axes", points: Sequence[tuple[float, float]], marker: str, style: dict[str, Any]) -> None:
    seconds, errors = np.reshape(points, (-1, 2)).T
    axes.loglog(seconds, np.clip(errors, LEAST_ERROR, LARGEST_ERROR), marker=marker, **style)
    axes.set(xlabel="run time [s]", ylabel="error [share of the motion]")


def _draw_drift(axes: "Axes", drift: tuple[Array, Array], marker: str, style: dict[str, Any]) -> None:
    t, violation = drift
    axes.semilogy(t, np.maximum(violation, LEAST_ERROR), **style)
    axes.set(xlabel="time [s]", ylabel="largest violation of a position row [m, rad]")


def _draw_stress(axes: "Axes", errors: Mapping[str, float], marker: str, style: dict[str, Any]) -> None:
    values = np.clip(list(errors.values()), LEAST_ERROR, LARGEST_ERROR)
    axes.semilogx(values, list(errors), marker, c=style["color"], label=style["label"])
    axes.set(xlabel="error under stress [share of the motion]")
