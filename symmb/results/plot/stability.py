"""The picture of a stability study: error against run time, drift over time, errors under stress."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from symmb._types import Array, Figure
from symmb.results.plot.colours import colour_of
from symmb.results.plot.layout import DASHES, LEAST_ERROR, MARKERS, cyclic, finish_diagrams, three_diagrams
from symmb.results.plot.style import OWN, Style


def plot_stability(
    t: Array,
    points: Mapping[str, Sequence[tuple[float, float]]],
    drift: Mapping[str, Array],
    stress: Mapping[str, Mapping[str, float]],
    *,
    title: str = "",
    style: Style = OWN,
) -> Figure:
    """Draw error against run time, drift of positions over time, and errors under stress.

    Parameters
    ----------
    points : solver -> (run time [s], error) of each setting; empty if errors are not known
    drift : solver -> drift (n_t,) of one setting
    stress : solver -> name of a variant of the scene -> error
    style : options            with up to three axes of the caller, in this order of diagrams
    """
    figure, panels = three_diagrams(style, 0.8)
    largest = 10.0  # a run with a larger error does not resemble the motion
    colours, texts = style.colours([*map(colour_of, points)]), style.labels([*points])
    for k, name in enumerate(points):
        marker, label = cyclic(MARKERS, k), texts[k]
        look: dict[str, Any] = {"color": colours[k], "linestyle": cyclic(DASHES, k), "linewidth": 1.1}
        seconds, errors = np.reshape(points[name], (-1, 2)).T
        panels[0].loglog(seconds, np.clip(errors, LEAST_ERROR, largest), marker=marker, label=label, **look)
        panels[0].set(xlabel="run time [s]", ylabel="error, relative to the motion")
        for axes in panels[1:2]:  # the caller may have fewer axes
            axes.semilogy(t, np.maximum(drift[name], LEAST_ERROR), label=label, **look)
            axes.set(xlabel="time [s]", ylabel="largest violation of a position constraint [m, rad]")
        for axes in panels[2:]:
            values = np.clip(list(stress[name].values()), LEAST_ERROR, largest)
            axes.semilogx(values, list(stress[name]), marker, c=look["color"], label=label)
            axes.set(xlabel="error under stress, relative to the motion")
    finish_diagrams(figure, panels, style, title, 4)
    return figure
