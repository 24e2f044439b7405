"""Pictures of the contributions of parameters to widths."""

from collections.abc import Sequence

import numpy as np

from symmb._types import Array, Figure
from symmb.results.plot.colours import COLOURS
from symmb.results.plot.drawn import MOST_PANELS
from symmb.results.plot.layout import (
    DASHES,
    abscissa,
    along,
    bars,
    cyclic,
    legends,
    outputs_of,
    panels_over_time,
    plain,
)
from symmb.results.plot.style import OWN, Style

_OF_ALL = "all parameters together"


def plot_contributions(
    t: Array,
    names: Sequence[str],
    parameters: Sequence[str],
    width: Array,
    alone: Array,
    saved: Array,
    *,
    units: Sequence[str] = (),
    chosen: Sequence[int] | None = None,
    row: int | None = None,
    style: Style = OWN,
) -> Figure:
    """Draw the widths of bounds due to each parameter alone (n_t, n_y, n_p), together with the total width (n_t, n_y),
    as lines. Each output has a panel. For one time (number `row`, or the only time), draw bars of `alone` and `saved`.
    """
    columns, names, units = outputs_of(names, units, chosen, MOST_PANELS if style.ax is None else None)
    row = 0 if len(t) == 1 else row
    abscissae = t if row is None else np.zeros(1)
    titles = names if row is not None else [f"width of {name}" for name in names]
    figure, panels = panels_over_time(style, abscissae, titles, units)
    own = [*parameters] if row is None else ["this parameter alone", "saved if it were known"]
    colours, texts = style.colours([cyclic(COLOURS, k) for k in range(len(own))]), style.labels(own)
    for axes, k in zip(panels, columns, strict=True):
        if row is None:
            (place,) = (abscissa(t),) if np.ptp(width[:, k]) else bars(axes, t, 1)
            axes.plot(place, along(t, width[:, k]), color="black", linewidth=1.4, label=_OF_ALL)
            for p, (colour, text) in enumerate(zip(colours, texts, strict=True)):
                dashes = cyclic(DASHES, p // len(COLOURS))
                axes.plot(place, along(t, alone[:, k, p]), color=colour, linewidth=1.2, linestyle=dashes, label=text)
            axes.set_ylim(bottom=0.0)
            continue
        at = np.arange(len(parameters))
        axes.bar(at - 0.2, alone[row, k], 0.38, color=colours[0], label=texts[0])
        axes.bar(at + 0.2, saved[row, k], 0.38, color=colours[1], label=texts[1])
        axes.axhline(width[row, k], color="black", linewidth=1.1, label=_OF_ALL)
        axes.set_xlim(-0.6, len(at) - 0.4)
        axes.set_xticks(at, [*map(plain, parameters)])
        axes.set_xlabel("")
    legends(figure, panels, style)
    return figure
