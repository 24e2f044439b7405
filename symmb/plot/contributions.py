"""Pictures of what parameters contribute to widths."""

from collections.abc import Sequence

import numpy as np

from symmb._types import Array, Figure
from symmb.plot.colours import COLOURS
from symmb.plot.layout import MOST_PANELS, abscissa, along, cyclic, outputs_of, panels_over_time, plain, shared_legend

_HATCHES = ("", "///", "...", "xxx")
"""Patterns that tell parameters of the same colour apart."""


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
) -> Figure:
    """Widths alone (n_t, n_y, n_p) stacked over time below that of all, (n_t, n_y), one panel an output; at the time
    of a row, or if there is one time only, bars of alone and saved.
    """
    columns, names, units = outputs_of(names, units, chosen, MOST_PANELS)
    row = 0 if len(t) == 1 else row
    abscissae = t if row is None else np.zeros(1)
    figure, panels = panels_over_time("Contributions.plot", None, abscissae, names, units)
    for axes, k in zip(panels, columns, strict=True):
        if row is None:
            colours = [cyclic(COLOURS, p) for p in range(len(parameters))]
            parts = [along(t, alone[:, k, p]) for p in range(len(parameters))]
            areas = axes.stackplot(abscissa(t), *parts, labels=[*parameters], colors=colours, alpha=0.75, linewidth=0)
            for p, area in enumerate(areas):
                area.set(hatch=cyclic(_HATCHES, p // len(COLOURS)), edgecolor="white")
            axes.plot(abscissa(t), along(t, width[:, k]), color="black", linewidth=1.1, label="width of all together")
            continue
        at = np.arange(len(parameters))
        axes.bar(at - 0.2, alone[row, k], 0.38, color=COLOURS[0], label="this parameter alone")
        axes.bar(at + 0.2, saved[row, k], 0.38, color=COLOURS[1], label="saved if it were known")
        axes.axhline(width[row, k], color="black", linewidth=1.1, label="width of all together")
        axes.set_xlim(-0.6, len(at) - 0.4)
        axes.set_xticks(at, [*map(plain, parameters)])
        axes.set_xlabel("")
    shared_legend(figure, panels)
    return figure
