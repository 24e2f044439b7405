"""Pictures from plain arrays: bounds over time, error against run time, trajectories.

Figures are drawn without pyplot, so nothing global is touched; matplotlib loads on the first call.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from symmb._types import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase

_PANELS = 6
"""Most outputs whose bounds are drawn."""
_WIDTH = 10.0
"""Width of a figure [inch]; the heights below too."""
_ROW = 1.8
_HEAD = 0.3
_DIAGRAM = 3.8
_DPI = 150
_COLOURS = ("#0b6fb8", "#d1495b", "#2e8b57", "#e08e00", "#7a4fb5", "#4b5563", "#00929c", "#9c5a2d")
"""Told apart also by those who do not tell red from green: line style and marker differ as well."""
_MARKERS = "osD^vPX*"
_DASHES = ((0, ()), (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)), (0, (3, 1.5)), (0, (8, 3)))
_BAND = "#c9d3dd"
_ROUNDING = 1e-16
"""The least error that is drawn, as a share of the width."""
_NONSENSE = 10.0
"""The largest error that is drawn, as a share of the motion."""
_CLEAR = 16.0
"""Distance from which on a number stands free [point]."""


@dataclass(frozen=True)
class Band:
    """What is filled, the reference of a comparison for one: lower, upper (n_t, n_y)."""

    label: str
    lower: Array
    upper: Array


@dataclass(frozen=True)
class Curve:
    """Bounds by one setting of one family of methods: lower, upper (n_t, n_y), error (n_y,), run time [s]."""

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


def plot_comparison(
    t: Array,
    names: Sequence[str],
    reference: Band,
    curves: Sequence[Curve],
    *,
    measured: npt.NDArray[np.bool_],
    uncertainty: Array,
    title: str = "",
    path: str | Path | None = None,
) -> "Figure":
    """Bounds over time above, mean error against run time below.

    Parameters
    ----------
    t : (n_t,)              times [s]
    names : n_y names       of the outputs
    curves                  the settings to draw; a family is one curve of the error diagram, and its most
                            accurate setting stands for it above
    measured : (n_y,)       which outputs count in the mean error
    uncertainty : (n_y,)    the reference's, in the norm of the error; mean errors below its mean are drawn
                            there, hollow
    path : optional         where to write the picture; the suffix decides the format
    """
    families: dict[str, list[Curve]] = {}
    for curve in curves:
        families.setdefault(curve.family, []).append(curve)
    shown = _hardest(curves, measured)
    n_legend = -(-(len(families) + 1) // 3)
    heights = [_HEAD + 0.2 * n_legend + _ROW * _rows(len(shown)), _DIAGRAM]
    figure = _figure(sum(heights))
    above, below = figure.subfigures(2, 1, height_ratios=heights, squeeze=False)[:, 0]
    best = [min(group, key=lambda curve: _error(curve, measured)) for group in families.values()]
    _draw_bounds(above, t, names, shown, reference, best, title)
    _draw_errors(below.subplots(), list(families.values()), measured, uncertainty)
    return _saved(figure, path)


def labels(names: Sequence[str], units: Sequence[str]) -> tuple[str, ...]:
    """Names with their units in brackets, where there are any."""
    units = units or [""] * len(names)
    return tuple(f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True))


def plot_trajectory(
    t: Array, values: Array, names: Sequence[str], path: str | Path | None = None, *, title: str = ""
) -> "Figure":
    """Values (n_t, n_y) over times t (n_t,) [s], one panel an output; see `plot_comparison` for path."""
    figure = _figure(_HEAD + _ROW * _rows(len(names)))
    for i, axes in enumerate(_panels(figure, t, names)):
        axes.plot(_abscissa(t), _along(t, values[:, i]), color=_COLOURS[0], linewidth=1.2)
    figure.suptitle(title, fontsize=10)
    return _saved(figure, path)


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
    shown = names[:_PANELS]
    figure = _figure(_HEAD + 0.2 + _ROW * _rows(len(shown)))
    pairs = (
        ((band.lower, band.upper), None, {"linewidth": 1.1, "color": _COLOURS[0]}),
        (outer, "widened by the estimated error", {"linewidth": 1.0, "linestyle": _DASHES[1], "color": _COLOURS[1]}),
        (inner, "attained by runs", {"linewidth": 1.0, "linestyle": _DASHES[2], "color": _COLOURS[5]}),
    )
    panels = _panels(figure, t, shown)
    for i, axes in enumerate(panels):
        filled = _along(t, band.lower[:, i]), _along(t, band.upper[:, i])
        axes.fill_between(_abscissa(t), *filled, color=_BAND, linewidth=0, label=band.label)
        for pair, label, style in pairs:
            for k, values in enumerate(pair or ()):
                axes.plot(_abscissa(t), _along(t, values[:, i]), label=label if k == 0 else None, **style)
    _legend(figure, panels)
    if len(shown) < len(names):
        figure.suptitle(f"the first {len(shown)} of {len(names)} outputs", fontsize=10)
    return _saved(figure, path)


def plot_stability(
    t: Array,
    points: Mapping[str, Sequence[tuple[float, float]]],
    drift: Mapping[str, Array],
    stress: Mapping[str, Mapping[str, float]],
    path: str | Path | None = None,
    *,
    title: str = "",
) -> "Figure":
    """Error against run time, drift of positions over time, and errors under stress; see `plot_comparison` for path.

    Parameters
    ----------
    points : solver -> (run time [s], error) of each setting
    drift : solver -> (n_t,) of one setting
    stress : solver -> what was done to the scene -> error
    """
    figure = _figure(_DIAGRAM + 0.8)
    left, right, under = figure.subplots(1, 3)
    for k, name in enumerate(points):
        style = {"color": _of(_COLOURS, k), "linestyle": _of(_DASHES, k // len(_COLOURS)), "linewidth": 1.1}
        seconds, errors = zip(*points[name], strict=True)
        left.loglog(seconds, np.clip(errors, _ROUNDING, _NONSENSE), marker=_of(_MARKERS, k), label=name, **style)
        right.semilogy(t, np.maximum(drift[name], _ROUNDING), **style)
        some = stress.get(name, {})
        under.semilogx(
            np.clip(list(some.values()), _ROUNDING, _NONSENSE), list(some), _of(_MARKERS, k), c=style["color"]
        )
    left.set(xlabel="run time [s]", ylabel="error [share of the motion]")
    right.set(xlabel="time [s]", ylabel="largest violation of a position row")
    under.set(xlabel="error under stress")
    for axes in (left, right, under):
        _dress(axes)
        axes.grid(alpha=0.25)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    figure.suptitle(title, fontsize=10)
    return _saved(figure, path)


def _draw_bounds(
    figure: "FigureBase",
    t: Array,
    names: Sequence[str],
    shown: Sequence[int],
    reference: Band,
    curves: Sequence[Curve],
    title: str,
) -> None:
    panels = _panels(figure, t, [names[i] for i in shown])
    for axes, i in zip(panels, shown, strict=True):
        band = _along(t, reference.lower[:, i]), _along(t, reference.upper[:, i])
        axes.fill_between(_abscissa(t), *band, color=_BAND, linewidth=0, label=reference.label)
        for k, curve in enumerate(curves):
            style: dict[str, Any] = {
                "color": _of(_COLOURS, k),
                "linestyle": _of(_DASHES, k),
                "linewidth": 1.1,
            }
            label = f"{curve.label}, {curve.kind}"
            axes.plot(_abscissa(t), _along(t, curve.lower[:, i]), label=label, **style)
            axes.plot(_abscissa(t), _along(t, curve.upper[:, i]), **style)
        axes.set_ylim(*_window(reference, curves, i))
    _legend(figure, panels)
    part = f"the {len(shown)} of {len(names)} outputs with the largest errors" if len(shown) < len(names) else ""
    figure.suptitle(": ".join(filter(None, [title, part])), fontsize=10)


def _legend(figure: "FigureBase", panels: Sequence["Axes"]) -> None:
    """One legend of all panels, which is that of the first."""
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8, frameon=False)


def _draw_errors(
    axes: "Axes", families: Sequence[Sequence[Curve]], measured: npt.NDArray[np.bool_], uncertainty: Array
) -> None:
    known = uncertainty[measured & np.isfinite(uncertainty)]
    floor = max(float(known.mean()) if known.size else 0.0, _ROUNDING)
    axes.set(xscale="log", yscale="log")
    numbers: list[tuple[float, float, str, str]] = []
    for k, group in enumerate(families):
        settings = sorted(group, key=lambda curve: curve.evaluations)
        points = [(curve.seconds, _error(curve, measured), curve.evaluations) for curve in settings]
        points = [(x, y, n) for x, y, n in points if y < np.inf]
        if not points:
            continue
        colour, marker = _of(_COLOURS, k), {"marker": _of(_MARKERS, k), "markersize": 6}
        style: dict[str, Any] = {"color": colour, "linestyle": _of(_DASHES, k), "linewidth": 1.2}
        axes.plot([x for x, _, _ in points], [max(y, floor) for _, y, _ in points], **style)
        axes.plot([], [], **style, **marker, label=group[0].family)
        for x, y, n in points:
            face = "white" if y < floor else colour
            axes.plot(x, max(y, floor), color=colour, **marker, markerfacecolor=face, zorder=3)
            numbers.append((x, max(y, floor), str(n), colour))
    if floor > _ROUNDING:
        label = "reference's uncertainty\n(hollow: error not above it)"
        axes.axhline(floor, color="#6b7280", linewidth=0.9, linestyle=":", label=label)
    axes.set_xlabel("run time [s], warm; the numbers count runs", fontsize=8.5)
    axes.set_ylabel("mean error, share of the width", fontsize=8.5)
    axes.grid(which="major", color="#e3e7eb", linewidth=0.8)
    axes.margins(0.06, 0.1)
    if all(y == floor for _, y, _, _ in numbers):  # margins are a share of the height, of which there is none
        axes.set_autoscaley_on(False)
        axes.set_ylim(0.1 * floor, 10.0 * floor)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=8, frameon=False)
    _write_numbers(axes, numbers)
    _dress(axes)


def _write_numbers(axes: "Axes", numbers: Sequence[tuple[float, float, str, str]]) -> None:
    """Each number beside its point (x, y, text, colour), at the corner farthest from points and numbers."""
    from matplotlib.patheffects import withStroke

    place = np.array([axes.transData.transform((x, y)) for x, y, _, _ in numbers]).reshape(-1, 2) * 72.0 / _DPI
    taken = list(place)
    for at, (x, y, text, colour) in zip(place, numbers, strict=True):
        others = np.array([point for point in taken if point is not at])
        offsets = [np.array((right * (5.0 + 2.2 * len(text)), up * 8.0)) for up in (1, -1) for right in (1, -1)]
        gaps = [min(np.hypot(*(others - at - offset).T), default=np.inf) for offset in offsets]
        best = offsets[int(np.argmax(np.minimum(gaps, _CLEAR)))]
        taken.append(at + best)
        axes.annotate(
            text,
            (x, y),
            tuple(best),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=7.5,
            color=colour,
            path_effects=[withStroke(linewidth=2, foreground="white")],
            zorder=2.5,
        )


def _figure(height: float) -> "Figure":
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH, height), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _saved(figure: "Figure", path: str | Path | None) -> "Figure":
    if path is not None:
        figure.savefig(path)
    return figure


def _panels(figure: "FigureBase", t: Array, names: Sequence[str]) -> list["Axes"]:
    """One named panel an output, on a common time axis."""
    n_columns = _columns(len(names))
    grid = figure.subplots(_rows(len(names)), n_columns, sharex=True, squeeze=False).ravel()
    for axes in grid[len(names) :]:
        axes.set_visible(False)
    for i, (axes, name) in enumerate(zip(grid, names, strict=False)):
        axes.set_title(name, fontsize=9, loc="left", fontweight="bold", pad=3)
        axes.set_xlim(*_abscissa(t)[[0, -1]])
        if len(t) == 1:
            axes.set_xticks(t)
        axes.grid(color="#e3e7eb", linewidth=0.6)
        axes.ticklabel_format(useOffset=False)
        _dress(axes)
        if i + n_columns >= len(names):
            axes.set_xlabel("time [s]", fontsize=8)
            axes.tick_params(labelbottom=True)
    return list(grid[: len(names)])


def _abscissa(t: Array) -> Array:
    """The times; a single one is drawn as a stretch."""
    return t if len(t) > 1 else t + np.array([-0.5, 0.5])


def _along(t: Array, values: Array) -> Array:
    """Values (n_t,) at the abscissa of the times t (n_t,)."""
    return np.broadcast_to(values, _abscissa(t).shape)


def _dress(axes: "Axes") -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)


def _columns(n: int) -> int:
    return 1 if n == 1 else 2 if n in (2, 4) else 3


def _rows(n: int) -> int:
    return -(-n // _columns(n))


def _of(styles: Sequence[Any], k: int) -> Any:
    return styles[k % len(styles)]


def _error(curve: Curve, measured: npt.NDArray[np.bool_]) -> float:
    """Mean error over the outputs that count; infinite where it is not a number."""
    error = _or_infinite(curve.error[measured])
    return float(error.mean()) if error.size else 0.0


def _or_infinite(error: Array) -> Array:
    return np.where(np.isnan(error), np.inf, error)


def _hardest(curves: Sequence[Curve], measured: npt.NDArray[np.bool_]) -> list[int]:
    """The outputs to draw, in their order: those with the largest median error."""
    if len(measured) <= _PANELS or not curves:
        return list(range(min(len(measured), _PANELS)))
    median = np.median([_or_infinite(curve.error) for curve in curves], axis=0)
    return sorted(np.argsort(np.where(measured, -median, 1.0), kind="stable")[:_PANELS].tolist())


def _window(reference: Band, curves: Sequence[Curve], i: int) -> tuple[float, float]:
    """Limits that show the reference and half its range on either side; wilder bounds leave the panel."""
    low, high = np.nanmin(reference.lower[:, i]), np.nanmax(reference.upper[:, i])
    room = 0.5 * (high - low) if high > low else max(abs(high), 1.0) * 1e-3
    lows = np.concatenate([[low], *(curve.lower[:, i] for curve in curves)])
    highs = np.concatenate([[high], *(curve.upper[:, i] for curve in curves)])
    bottom, top = max(np.nanmin(lows), low - room), min(np.nanmax(highs), high + room)
    margin = max(0.05 * (top - bottom), 1e-6 * max(abs(bottom), abs(top))) or room
    return float(bottom - margin), float(top + margin)
