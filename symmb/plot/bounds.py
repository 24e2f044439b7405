"""Pictures of bounds over time."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from symmb._types import Array
from symmb.plot.curves import Band, Curve
from symmb.plot.layout import (
    BAND_COLOUR,
    COLOURS,
    DASHES,
    HEAD_HEIGHT,
    MOST_PANELS,
    ROW_HEIGHT,
    abscissa,
    along,
    cyclic,
    n_rows,
    new_figure,
    new_panels,
    plain,
    save,
    shared_legend,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure, FigureBase


def plot_bounds(
    t: Array,
    names: Sequence[str],
    band: Band,
    *,
    outer: tuple[Array, Array] | None = None,
    inner: tuple[Array, Array] | None = None,
    path: str | Path | None = None,
) -> "Figure":
    """Bounds over time, the first outputs one panel each; see `plot_comparison` for t, names and path.

    Parameters
    ----------
    outer, inner : lower and upper (n_t, n_y) each, or None    bounds widened by their estimated error, and what
                                                               runs attained
    """
    shown = names[:MOST_PANELS]
    figure = new_figure(HEAD_HEIGHT + 0.2 + ROW_HEIGHT * n_rows(len(shown)))
    pairs = (
        ((band.lower, band.upper), None, {"linewidth": 1.1, "color": COLOURS[0]}),
        (outer, "widened by the estimated error", {"linewidth": 1.0, "linestyle": DASHES[1], "color": COLOURS[1]}),
        (inner, "attained by runs", {"linewidth": 1.0, "linestyle": DASHES[2], "color": COLOURS[5]}),
    )
    panels = new_panels(figure, t, shown)
    for i, axes in enumerate(panels):
        filled = along(t, band.lower[:, i]), along(t, band.upper[:, i])
        axes.fill_between(abscissa(t), *filled, color=BAND_COLOUR, linewidth=0, label=band.label)
        for pair, label, style in pairs:
            for k, values in enumerate(pair or ()):
                axes.plot(abscissa(t), along(t, values[:, i]), label=label if k == 0 else None, **style)
    shared_legend(figure, panels)
    if len(shown) < len(names):
        figure.suptitle(f"the first {len(shown)} of {len(names)} outputs", fontsize=10)
    return save(figure, path)


def draw_bounds(
    figure: "FigureBase",
    t: Array,
    names: Sequence[str],
    shown: Sequence[int],
    reference: Band,
    curves: Sequence[Curve],
    title: str,
) -> None:
    panels = new_panels(figure, t, [names[i] for i in shown])
    for axes, i in zip(panels, shown, strict=True):
        band = along(t, reference.lower[:, i]), along(t, reference.upper[:, i])
        axes.fill_between(abscissa(t), *band, color=BAND_COLOUR, linewidth=0, label=reference.label)
        for k, curve in enumerate(curves):
            style: dict[str, Any] = {"color": cyclic(COLOURS, k), "linestyle": cyclic(DASHES, k), "linewidth": 1.1}
            label = f"{curve.label}, {curve.kind}"
            axes.plot(abscissa(t), along(t, curve.lower[:, i]), label=label, **style)
            axes.plot(abscissa(t), along(t, curve.upper[:, i]), **style)
        axes.set_ylim(*_window(reference, curves, i))
    shared_legend(figure, panels)
    part = f"the {len(shown)} of {len(names)} outputs with the largest errors" if len(shown) < len(names) else ""
    figure.suptitle(plain(": ".join(filter(None, [title, part]))), fontsize=10)


def _window(reference: Band, curves: Sequence[Curve], i: int) -> tuple[float, float]:
    """Limits that show the reference and half its range on either side; wilder bounds leave the panel."""
    low, high = np.nanmin(reference.lower[:, i]), np.nanmax(reference.upper[:, i])
    room = 0.5 * (high - low) if high > low else max(abs(high), 1.0) * 1e-3
    lows = np.concatenate([[low], *(curve.lower[:, i] for curve in curves)])
    highs = np.concatenate([[high], *(curve.upper[:, i] for curve in curves)])
    bottom, top = max(np.nanmin(lows), low - room), min(np.nanmax(highs), high + room)
    margin = max(0.05 * (top - bottom), 1e-6 * max(abs(bottom), abs(top))) or room
    return float(bottom - margin), float(top + margin)
