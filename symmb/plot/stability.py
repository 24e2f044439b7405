"""The picture of a stability study: error against run time, drift over time, errors under stress."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from symmb._types import Array, Figure, GivenAxes
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


def plot_stability(
    t: Array,
    points: Mapping[str, Sequence[tuple[float, float]]],
    drift: Mapping[str, Array],
    stress: Mapping[str, Mapping[str, float]],
    *,
    title: str = "",
    ax: GivenAxes = None,
) -> Figure:
    """Error against run time, drift of positions over time, and errors under stress.

    Parameters
    ----------
    points : solver -> (run time [s], error) of each setting; none where errors are not known
    drift : solver -> (n_t,) of one setting
    stress : solver -> what was done to the scene -> error
    ax : the caller's axes     up to three, one for each of these diagrams in this order
    """
    figure, panels = three_diagrams("Stability.plot", ax, 0.8)
    for k, name in enumerate(points):
        marker, label = cyclic(MARKERS, k), plain(name)
        style: dict[str, Any] = {"color": colour_of(name), "linestyle": cyclic(DASHES, k), "linewidth": 1.1}
        seconds, errors = np.reshape(points[name], (-1, 2)).T
        panels[0].loglog(seconds, np.clip(errors, LEAST_ERROR, LARGEST_ERROR), marker=marker, label=label, **style)
        panels[0].set(xlabel="run time [s]", ylabel="error [share of the motion]")
        for axes in panels[1:2]:  # the caller may have fewer axes
            axes.semilogy(t, np.maximum(drift[name], LEAST_ERROR), label=label, **style)
            axes.set(xlabel="time [s]", ylabel="largest violation of a position row [m, rad]")
        for axes in panels[2:]:
            values = np.clip(list(stress[name].values()), LEAST_ERROR, LARGEST_ERROR)
            axes.semilogx(values, list(stress[name]), marker, c=style["color"], label=label)
            axes.set(xlabel="error under stress [share of the motion]")
    finish_diagrams(figure, panels, ax, title, 4)
    return figure
