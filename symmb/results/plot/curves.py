"""Pictures of curves over time: a trajectory, several runs, and measured values beside a fitted run."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from symmb._types import Array, Axes, Figure, Indices
from symmb.results.plot.colours import COLOURS, PALETTE, RUN_COLOUR
from symmb.results.plot.layout import (
    abscissa,
    along,
    bars,
    cyclic,
    flatten,
    legends,
    outputs_of,
    panels_over_time,
    rounding,
)
from symmb.results.plot.style import OWN, Style


def plot_trajectory(
    t: Array,
    values: Array,
    names: Sequence[str],
    *,
    units: Sequence[str] = (),
    chosen: Sequence[int] | None = None,
    title: str = "",
    timeless: Collection[str] = (),
    style: Style = OWN,
) -> Figure:
    """Draw values (n_t, n_y) over times t (n_t,) [s], one panel for each output; see `plot_comparison` for names,
    units, chosen and style. Outputs in `timeless` have one value for all times, drawn as a short line.

    If the caller gives a single axes, all outputs are drawn in these axes, in different colours.
    """
    columns, own_names, own_units = outputs_of(names, units, chosen)
    least = rounding(values, units)[columns]
    figure, panels = panels_over_time(style, t, own_names, own_units, title=title, overlay=True)
    several = len(panels) > 1 and panels[0] is panels[1]
    colours = style.colours([cyclic(COLOURS, k) if several else RUN_COLOUR for k in range(len(panels))])
    texts = style.labels(own_names, apart=not several)
    for axes, i, colour, text in zip(panels, columns, colours, texts, strict=True):
        (place,) = bars(axes, t, 1) if names[i] in timeless and not several else (abscissa(t),)
        axes.plot(place, along(t, values[:, i]), color=colour, linewidth=1.2, label=text)
    flatten(panels, np.full(len(panels), least.max()) if several else least)
    if style.ax is not None or style.legend:
        legends(figure, panels, style)
    return figure


@dataclass(frozen=True)
class RunLines:
    """Positions x (N,) of runs on an axis with this `label`. The runs of each pair (name, numbers of runs) are joined
    by a line, or shown as points."""

    label: str
    x: Array
    lines: Sequence[tuple[str, Indices]]
    joined: bool = True


def plot_family(
    t: Array,
    curves: Array,
    names: Sequence[str],
    curve_names: Sequence[str],
    *,
    timeless: Collection[str] = (),
    over: RunLines | None = None,
    units: Sequence[str] = (),
    chosen: Sequence[int] | None = None,
    title: str = "",
    style: Style = OWN,
) -> Figure:
    """Draw curves (N, n_t, n_y) over times t (n_t,) [s], one panel for each output; see `plot_comparison` for more.

    Each of up to eight curves has a colour and a name. More curves have a sequence of colours, and the legend names the
    first, the middle and the last curve. Outputs in `timeless`, with one value for all times, are drawn along `over`.
    If the picture also has curves over time, several lines along `over` are dashed, and have other colours.
    """
    columns, own_names, own_units = outputs_of(names, units, chosen)
    others = {k: (np.unique(over.x), over.label) for k, name in enumerate(own_names) if over and name in timeless}
    figure, panels = panels_over_time(style, t, own_names, own_units, title=title, others=others)
    in_time = [(axes, i) for k, (axes, i) in enumerate(zip(panels, columns, strict=True)) if k not in others]
    if in_time:
        _draw_family(in_time, [(n, abscissa(t), y) for n, y in zip(curve_names, curves, strict=True)], style)
    if over and others:
        lines = [(name, over.x[runs], curves[runs, 0]) for name, runs in over.lines]
        own = [(panels[k], columns[k]) for k in others]
        look = {"marker": "o", "markersize": 4, "clip_on": False, "linestyle": "-" if over.joined else ""}
        for axes, _ in own if not over.joined else ():
            axes.locator_params("x", integer=True)
        if in_time:
            style = replace(style, label=None, color=None)
        if in_time and len(lines) > 1:
            _draw_family(own, lines, style, beside=len(curves), **look | {"linestyle": "--" if over.joined else ""})
        else:
            _draw_family(own, lines, style, **look)
    flatten(panels, rounding(curves, units)[columns])
    first = [in_time[0][0]] if in_time else []
    legends(figure, [*first, *(panels[k] for k in [*others][:1])], style)
    return figure


def _draw_family(
    panels: Sequence[tuple[Axes, int]],
    curves: Sequence[tuple[str, Array, Array]],
    style: Style,
    beside: int = 0,
    **look: Any,
) -> None:
    """Draw curves, given by name, abscissas (n,) and outputs (n, n_y). Each panel shows one output.

    The colours differ from those of `beside` curves that the picture already has.
    """
    from matplotlib import colormaps

    N = len(curves)
    few = N <= len(COLOURS)
    # More curves than COLOURS do not use the colours of the palette.
    first = beside if beside <= len(COLOURS) else 0
    sequence = colormaps["plasma" if beside else "viridis"]
    shades = [cyclic(PALETTE, first + k) if few else sequence(0.9 * k / (N - 1)) for k in range(N)]
    named = {*range(N)} if few or style.label is not None else {0, N // 2, N - 1}
    colours, texts = style.colours(shades), style.labels([name for name, *_ in curves])
    for axes, i in panels:
        for k, (_, x, y) in enumerate(curves):
            label = texts[k] if k in named else None
            axes.plot(
                x, np.broadcast_to(y[:, i], x.shape), color=colours[k], linewidth=1.2, label=label or None, **look
            )


def plot_fit(series: Sequence[tuple[str, Array, Array, Array]], units: Sequence[str], style: Style = OWN) -> Figure:
    """Draw one panel for each output: its name, times [s], measured values and values of the fitted run, each (n,).

    See `plot_comparison` for units and style.
    """
    whole, names = np.concatenate([t for _, t, _, _ in series]), [name for name, *_ in series]
    figure, panels = panels_over_time(style, np.array([whole.min(), whole.max()]), names, units)
    (colour,), (label,) = style.colours([COLOURS[0]]), style.labels(["fitted run"])
    for axes, (_, t, data, fitted) in zip(panels, series, strict=True):
        order = np.argsort(t)
        axes.plot(t, data, ".", color=RUN_COLOUR, markersize=4, label="data")
        axes.plot(t[order], fitted[order], color=colour, linewidth=1.2, label=label)
    legends(figure, panels, style)
    return figure
