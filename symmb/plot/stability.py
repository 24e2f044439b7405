"""The picture of a stability study: error against run time, drift over time, errors under stress."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from symmb._types import Array
from symmb.plot.colours import colour_of
from symmb.plot.layout import (
    DASHES,
    LARGEST_ERROR,
    LEAST_ERROR,
    MARKERS,
    cyclic,
    finish_diagrams,
    plain,
    three_diagrams,
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
    *,
    title: str = "",
    ax: "GivenAxes | None" = None,
) -> "Figure":
    """Error against run time, drift of positions over time, and errors under stress.

    Parameters
    ----------
    points : solver -> (run time [s], error) of each setting; none where errors are not known
    drift : solver -> (n_t,) of one setting
    stress : solver -> what was done to the scene -> error
    ax : the caller's axes     up to three, one for each of these diagrams in this order
    """
    figure, panels = three_diagrams("Stability.plot", ax, 0.8)
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
    finish_diagrams(figure, panels, ax, title, 4)
    return figure


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
