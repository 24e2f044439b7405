"""Pictures of bounds over time."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from symmb._types import Array, Axes, Figure, GivenAxes
from symmb.results.plot.colours import BAND_COLOUR, RUN_COLOUR, colour_of
from symmb.results.plot.drawn import MOST_PANELS
from symmb.results.plot.layout import (
    DASHES,
    abscissa,
    along,
    axes_in,
    bars,
    cyclic,
    flatten,
    legends,
    outputs_of,
    panels_over_time,
    rounding,
)
from symmb.results.plot.style import OWN, Style

_LIMIT = "#d1495b"
"""Colour of limits."""


@dataclass(frozen=True)
class Band:
    """A filled band from `lower` to `upper`, (n_t, n_y), such as the band of the reference method in a comparison."""

    label: str
    lower: Array
    upper: Array


@dataclass(frozen=True)
class PlottedBounds:
    """Bounds of one setting of a family of methods: lower, upper (n_t, n_y), error (n_y,), run time [s]."""

    family: str
    label: str
    kind: str
    lower: Array
    upper: Array
    error: Array
    evaluations: int
    seconds: float


def family(name: str) -> str:
    """The method without the numbers that set its resolution.

    Examples
    --------
    >>> family("PolynomialChaos.paper(order=2)"), family("MonteCarlo(1000, sampler=Sobol())")
    ('PolynomialChaos.paper', 'MonteCarlo(sampler=Sobol())')
    """
    constructor, _, options = name.partition("(")
    shown = [option for option in options.removesuffix(")").split(", ") if re.search(r"[a-z]+\(|=[A-Z]", option)]
    return f"{constructor}({', '.join(shown)})" if shown else constructor


def plot_bounds(
    t: Array,
    names: Sequence[str],
    band: Band,
    *,
    units: Sequence[str] = (),
    family: str = "",
    chosen: Sequence[int] | None = None,
    outer: tuple[Array, Array] | None = None,
    inner: tuple[Array, Array] | None = None,
    nominal: Array | None = None,
    deviation: bool = False,
    timeless: Sequence[str] = (),
    style: Style = OWN,
) -> Figure:
    """Draw bounds over time, one panel for each output; see `plot_comparison` for t, names, units and style.

    Parameters
    ----------
    family                             name of the method; it selects the colour
    chosen : columns to draw           default: the first six outputs, or one for each given axes
    outer, inner : lower and upper (n_t, n_y) each, or None    bounds widened by their estimated error, and values
                                                               that runs attained
    nominal : (n_t, n_y) or None       the nominal run, drawn as a thin line
    deviation                          draw deviations from the nominal run
    timeless                           outputs with one value for all times, drawn as bars
    """
    least = rounding(np.stack([band.lower, band.upper]), units)
    shown, own_names, own_units = outputs_of(names, units, chosen, MOST_PANELS if style.ax is None else None)
    if deviation:
        own_names = [f"{name} − nominal" for name in own_names]
    is_part = chosen is None and len(shown) < len(names)
    title = f"the first {len(shown)} of {len(names)} outputs" if is_part else None
    origin = nominal if deviation and nominal is not None else np.zeros_like(band.lower)
    (colour,), (label,) = style.colours([colour_of(family)]), style.labels([band.label])
    pairs: list[tuple[tuple[Array, Array], str | None, dict[str, Any]]] = [
        ((band.lower, band.upper), None, {"linewidth": 1.1})
    ]
    if outer is not None:
        pairs.append((outer, "widened by the estimated error", {"linewidth": 1.0, "linestyle": DASHES[1]}))
    if inner is not None:
        pairs.append((inner, "attained by runs", {"linewidth": 0.8, "linestyle": DASHES[2]}))
    figure, panels = panels_over_time(style, t, own_names, own_units, title=title, room=0.2)
    for axes, i in zip(panels, shown, strict=True):
        (place,) = bars(axes, t, 1) if names[i] in timeless else (abscissa(t),)
        own = [(np.stack([end[:, i] - origin[:, i] for end in ends]), name, look) for ends, name, look in pairs]
        low, high = (along(t, end) for end in own[0][0])
        axes.fill_between(place, low, high, color=colour, alpha=0.16, linewidth=0, label=label)
        _draw_pairs(axes, place, own, colour)
        if nominal is not None:
            run = along(t, nominal[:, i] - origin[:, i])
            axes.plot(place, run, color=RUN_COLOUR, linewidth=0.7, label="nominal run")
    flatten(panels, least[shown])
    legends(figure, panels, style)
    return figure


def draw_bounds(
    panels: Sequence[Axes],
    t: Array,
    shown: Sequence[int],
    reference: Band,
    curves: Sequence[PlottedBounds],
    units: Sequence[str],
    style: Style,
) -> None:
    """Draw bounds by several methods over the reference, one panel for each output."""
    least = rounding(np.stack([reference.lower, reference.upper]), units)
    colours = style.colours([colour_of(curve.family) for curve in curves])
    texts = style.labels([f"{curve.label}, {curve.kind}" for curve in curves])
    for axes, i in zip(panels, shown, strict=True):
        is_empty = not axes.has_data()
        band = along(t, reference.lower[:, i]), along(t, reference.upper[:, i])
        axes.fill_between(abscissa(t), *band, color=BAND_COLOUR, linewidth=0, label=reference.label)
        is_timeless = curves and not np.ptp(band, axis=1).any()
        places = bars(axes, t, len(curves)) if is_timeless else [abscissa(t)] * len(curves)
        for k, (curve, place) in enumerate(zip(curves, places, strict=True)):
            look: dict[str, Any] = {"linestyle": cyclic(DASHES, k), "linewidth": 1.1, "color": colours[k]}
            low, high = along(t, curve.lower[:, i]), along(t, curve.upper[:, i])
            if is_timeless:
                axes.fill_between(place, low, high, color=colours[k], alpha=0.3, linewidth=0)
            _draw_pair(axes, place, low, high, label=texts[k], **look)
        if is_empty and np.ptp(axes.dataLim.intervaly) > least[i]:
            axes.set_ylim(*_window(reference, curves, i))
    flatten(panels, least[[*shown]])


def _draw_pairs(
    axes: Axes, x: Array, pairs: Sequence[tuple[Array, str | None, dict[str, Any]]], colour: object
) -> None:
    """Draw pairs of curves (2, n) over x. Where labelled curves touch the first pair, they are left out."""
    first = pairs[0][0]
    for own, name, look in pairs:
        if name is not None:
            with np.errstate(invalid="ignore"):  # infinite bounds
                # Curves with a smaller distance, relative to the height of the band, look like one thick line.
                own = np.where(np.abs(own - first) <= 0.015 * np.ptp(first), np.nan, own)
        _draw_pair(axes, x, *own, label=None if np.isnan(own).all() else name, color=colour, **look)


def _draw_pair(axes: Axes, x: Array, lower: Array, upper: Array, *, label: str | None, **style: Any) -> None:
    """Draw two curves of one style over x, with one label."""
    for y, text in ((lower, label), (upper, None)):
        axes.plot(x, np.broadcast_to(y, x.shape), label=text, **style)


def _window(reference: Band, curves: Sequence[PlottedBounds], i: int) -> tuple[float, float]:
    """Axis limits: the range of the reference, and half of it above and below. Larger bounds are cut off."""
    low, high = np.nanmin(reference.lower[:, i]), np.nanmax(reference.upper[:, i])
    room = 0.5 * (high - low) if high > low else max(abs(high), 1.0) * 1e-3
    lows = np.concatenate([[low], *(curve.lower[:, i] for curve in curves)])
    highs = np.concatenate([[high], *(curve.upper[:, i] for curve in curves)])
    bottom, top = max(np.nanmin(lows), low - room), min(np.nanmax(highs), high + room)
    margin = max(0.05 * (top - bottom), 1e-6 * max(abs(bottom), abs(top))) or room
    return float(bottom - margin), float(top + margin)


def add_limits(figure: Figure, ax: GivenAxes, limits: Sequence[tuple[float, float]]) -> None:
    """Draw limits (low, high) as lines, one pair for each panel of a picture, or for each of the caller's axes.

    Infinite limits are not drawn.
    """
    for axes, ends in zip(figure.axes if ax is None else axes_in("LimitCheck.plot", ax), limits, strict=False):
        for end in ends:
            if np.isfinite(end):
                axes.axhline(end, color=_LIMIT, linestyle="--", linewidth=1.2)
                style: dict[str, Any] = {"fontsize": 7, "color": _LIMIT, "ha": "right", "va": "bottom"}
                axes.annotate("limit", (1.0, end), xycoords=("axes fraction", "data"), **style)
