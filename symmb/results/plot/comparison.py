"""The picture of a comparison: bounds over time, and error against runs and run time."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from symmb._types import Array, Axes, Figure, Mask
from symmb.results.plot.bounds import Band, PlottedBounds, draw_bounds
from symmb.results.plot.colours import colour_of
from symmb.results.plot.drawn import MOST_PANELS
from symmb.results.plot.layout import (
    DASHES,
    DIAGRAM_HEIGHT,
    DPI,
    HEAD_HEIGHT,
    LEAST_ERROR,
    MARKERS,
    ROW_HEIGHT,
    axes_in,
    cyclic,
    labels,
    legends,
    n_rows,
    new_figure,
    new_panels,
    outputs_of,
    own_legend,
    panels_over_time,
    plain,
    root,
    style_axes,
)
from symmb.results.plot.style import OWN, Style


def plot_comparison(
    t: Array,
    names: Sequence[str],
    reference: Band,
    curves: Sequence[PlottedBounds],
    *,
    measured: Mask,
    uncertainty: Array,
    units: Sequence[str] = (),
    chosen: Sequence[int] | None = None,
    title: str = "",
    style: Style = OWN,
) -> Figure:
    """Draw bounds over time in the upper panels, and the rms error against runs and against run time below.

    Parameters
    ----------
    t : (n_t,)              times [s]
    names : n_y names       names of the outputs
    curves                  settings to draw. Each family is one curve of the error diagram. The bounds over time are
                            those of the most accurate setting of the family
    measured : (n_y,)       True for outputs in the mean of the rms errors
    uncertainty : (n_y,)    uncertainty of the reference, in the norm of the error. Errors below the mean uncertainty
                            are drawn at this mean, with hollow markers
    units : n_y units       '' if not known
    chosen : columns        columns of the outputs to draw; default: the outputs with the largest errors
    style : options         axes of the caller, one for each output, for bounds over time; or a single axes for the
                            errors against run time, if no outputs are chosen. Labels and colours, one for each family
    """
    families: dict[str, list[PlottedBounds]] = {}
    for curve in curves:
        families.setdefault(curve.family, []).append(curve)
    best = [min(group, key=lambda curve: largest_error(curve, measured)) for group in families.values()]
    if style.ax is not None:
        panels = axes_in(style.owner, style.ax)
        if chosen is None and len(panels) == 1:
            _draw_errors(panels, list(families.values()), measured, uncertainty, style)
            return root(panels[0])
        shown, own_names, own_units = outputs_of(names, units, chosen)
        figure, panels = panels_over_time(style, t, own_names, own_units)
        draw_bounds(panels, t, shown, reference, best, units, style)
        legends(figure, panels, style)
        return figure
    shown = hardest_outputs(curves, measured) if chosen is None else [*chosen]
    n_legend = -(-(len(families) + 1) // 3)
    heights = [HEAD_HEIGHT + 0.2 * n_legend + ROW_HEIGHT * n_rows(len(shown)), DIAGRAM_HEIGHT]
    figure = new_figure(sum(heights))
    above, below = figure.subfigures(2, 1, height_ratios=heights, squeeze=False)[:, 0]
    texts = labels(names, units)
    panels = new_panels(above, t, [texts[i] for i in shown])
    draw_bounds(panels, t, shown, reference, best, units, style)
    legends(above, panels, style)
    is_part = chosen is None and len(shown) < len(names)
    part = f"the {len(shown)} of {len(names)} outputs with the largest errors" if is_part else ""
    above.suptitle(plain(": ".join(filter(None, [title, part]))), fontsize=10)
    _draw_errors(list(below.subplots(1, 2, sharey=True)), list(families.values()), measured, uncertainty, style)
    return figure


def _draw_errors(
    panels: Sequence[Axes],
    families: Sequence[Sequence[PlottedBounds]],
    measured: Mask,
    uncertainty: Array,
    style: Style,
) -> None:
    """Draw errors against runs and against run time in two panels; in one panel, only against run time."""
    colours = style.colours([colour_of(group[0].family) for group in families])
    texts = style.labels([group[0].family for group in families])
    known = uncertainty[measured & np.isfinite(uncertainty)]
    floor = max(float(known.mean()) if known.size else 0.0, LEAST_ERROR)
    settings = [sorted(group, key=lambda curve: curve.evaluations) for group in families]
    measures = [("run time [s], warm", [[own.seconds for own in group] for group in settings])]
    if len(panels) > 1:
        measures.insert(0, ("runs", [[float(own.evaluations) for own in group] for group in settings]))
    for axes, (label, costs) in zip(panels, measures, strict=True):
        numbers: list[tuple[float, float, str, str]] = []
        axes.set(xscale="log", yscale="log")
        for k, (group, cost) in enumerate(zip(settings, costs, strict=True)):
            pairs = [(x, largest_error(own, measured), own) for x, own in zip(cost, group, strict=True)]
            points = [(x, y, own.evaluations) for x, y, own in pairs if y < np.inf and x > 0]
            if points:
                _draw_family(axes, [(x, y) for x, y, _ in points], floor, k, colours[k], texts[k])
                numbers += [(x, max(y, floor), str(n), colours[k]) for x, y, n in points]
        if floor > LEAST_ERROR:
            told = "reference's uncertainty\n(hollow: error not above it)"
            axes.axhline(floor, color="#6b7280", linewidth=0.9, linestyle=":", label=told)
        axes.set_xlabel(label if len(panels) > 1 else f"{label}; the numbers count runs", fontsize=8.5)
        axes.grid(which="major", color="#e3e7eb", linewidth=0.8)
        axes.margins(0.06, 0.1)
        if all(y == floor for _, y, _, _ in numbers):  # default margins are relative to the height, which is 0 here
            axes.set_autoscaley_on(False)
            axes.set_ylim(0.1 * floor, 10.0 * floor)
        if len(panels) == 1:
            write_numbers(axes, numbers)
        style_axes(axes)
    panels[0].set_ylabel("rms error / width, mean over outputs", fontsize=8.5)
    axes = panels[-1]
    if style.ax is not None:
        own_legend(axes, style)
    elif style.legend is not False and axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=8, frameon=False)


def _draw_family(
    axes: Axes, points: Sequence[tuple[float, float]], floor: float, k: int, colour: Any, label: str | None
) -> None:
    """Draw errors (run time, error) of family number k as a line with markers. Errors below the floor are hollow."""
    look: dict[str, Any] = {"color": colour, "linestyle": cyclic(DASHES, k), "linewidth": 1.2}
    marker: dict[str, Any] = {"marker": cyclic(MARKERS, k), "markersize": 6}
    axes.plot([x for x, _ in points], [max(y, floor) for _, y in points], **look)
    axes.plot([], [], **look, **marker, label=label)
    for x, y in points:
        face = "white" if y < floor else colour
        axes.plot(x, max(y, floor), color=colour, **marker, markerfacecolor=face, zorder=3)


def write_numbers(axes: Axes, numbers: Sequence[tuple[float, float, str, str]], clear: float = 16.0) -> None:
    """Write each number beside its point (x, y, text, colour), at the corner farthest from points and numbers.

    Numbers do not touch if their distance is at least `clear` [point].
    """
    from matplotlib.patheffects import withStroke

    place = np.array([axes.transData.transform((x, y)) for x, y, _, _ in numbers]).reshape(-1, 2) * 72.0 / DPI
    taken = list(place)
    for at, (x, y, text, colour) in zip(place, numbers, strict=True):
        others = np.array([point for point in taken if point is not at])
        offsets = [np.array((right * (5.0 + 2.2 * len(text)), up * 8.0)) for up in (1, -1) for right in (1, -1)]
        gaps = [min(np.hypot(*(others - at - offset).T), default=np.inf) for offset in offsets]
        best = offsets[int(np.argmax(np.minimum(gaps, clear)))]
        taken.append(at + best)
        look: dict[str, Any] = {"color": colour, "fontsize": 7.5, "ha": "center", "va": "center", "zorder": 2.5}
        look["path_effects"] = [withStroke(linewidth=2, foreground="white")]
        axes.annotate(text, (x, y), tuple(best), textcoords="offset points", **look)


def largest_error(curve: PlottedBounds, measured: Mask) -> float:
    """Mean of the rms errors of the measured outputs; infinite if the mean is nan."""
    error = np.nan_to_num(curve.error[measured], nan=np.inf, posinf=np.inf)
    return float(error.mean()) if error.size else 0.0


def hardest_outputs(curves: Sequence[PlottedBounds], measured: Mask) -> list[int]:
    """Columns of the outputs with the largest median errors, in the order of the outputs."""
    if len(measured) <= MOST_PANELS or not curves:
        return list(range(min(len(measured), MOST_PANELS)))
    median = np.median([np.nan_to_num(curve.error, nan=np.inf, posinf=np.inf) for curve in curves], axis=0)
    return sorted(np.argsort(np.where(measured, -median, 1.0), kind="stable")[:MOST_PANELS].tolist())
