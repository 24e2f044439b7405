"""The common layout of all pictures: size, panels, legend, saving.

Figures are drawn without pyplot, so no global state changes. matplotlib loads on the first call. Notebooks show the
figures directly.
"""

import io
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from textwrap import wrap
from types import MappingProxyType
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import LAST_DIGITS, ROUNDING
from symmb._options import numbers_of, require_names, shown
from symmb._table import is_timeless
from symmb._types import Array, Axes, Figure, GivenAxes
from symmb._units import label, typeset
from symmb.results.files import replacement, require_suffix
from symmb.results.plot.style import Style

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase
    from matplotlib.legend import Legend

PICTURES = (".png", ".pdf", ".svg")
"""Formats of pictures."""
ROW_HEIGHT, HEAD_HEIGHT, DIAGRAM_HEIGHT = 1.8, 0.3, 3.8
"""Heights of a row of panels, of the title and of a diagram [inch]."""
_NARROW_LINE = 50
"""Number of characters of a line in a picture for phones."""
_LEGEND_COLUMNS = 3
DPI = 150
"""Resolution of saved pictures [1/inch]: sharp at the width of a text column."""
MARKERS = "osD^vPX*"
DASHES = ((0, ()), (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)), (0, (3, 1.5)), (0, (8, 3)))
LEAST_ERROR = 1e-16
"""Smallest drawn error, relative to the width. Smaller errors are rounding, and 0 has no logarithm."""
_RANDOM_TURNS, _ABOUT_ZERO = 0.2, 0.05
"""Values are random if their slope changes sign at more than this fraction of times; and half of the height of axes for
values that are rounding of 0."""
Others = Mapping[int, tuple[Array, str]]
"""Values and label of the horizontal axis of panels that are not over time, by the number of the panel."""
_NONE: Others = MappingProxyType({})
_LEGENDS = ((60, 8.0), (36, 8.0), (24, 7.0), (16, 6.0))
"""Pairs of characters per line and font size [point] for legends in axes of the caller. The first pair that fits is
used."""


def new_figure(height: float) -> Figure:
    """A figure that notebooks show directly."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    vars(figure)["_repr_png_"] = partial(_shown, figure)
    return figure


def png(figure: Figure) -> bytes:
    """The figure as a PNG file."""
    file = io.BytesIO()
    _write(figure, file, "png")
    return file.getvalue()


def _write(figure: Figure, file: IO[bytes], kind: str) -> None:
    try:
        figure.savefig(file, format=kind)
    except OverflowError:  # differences of the numbers are beyond the range of doubles
        raise DeclarationError("The picture has numbers that are too large.") from None


def narrow_png(figure: Figure) -> bytes:
    """A figure with one panel as a PNG file, legible at the width of a phone. The legend gets the space it needs."""
    width, height = 4.2, 2.4  # of the panel without its legend [inch]
    figure.set_size_inches(width, height)
    for axes in figure.axes:
        _entitle(axes, "\n".join(wrap(axes.get_title(loc="left"), _NARROW_LINE)))
    below = sum(_fitted(figure, legend) for legend in [*figure.legends])
    figure.set_size_inches(width, height + below)
    return png(figure)


def _fitted(figure: Figure, legend: "Legend") -> float:
    """Reduce the columns and the line length until the legend fits into the figure. Return its height [inch]."""
    canvas: Any = figure.canvas
    handles = legend.legend_handles
    texts = ["\n".join(wrap(text.get_text(), _NARROW_LINE)) for text in legend.get_texts()]
    columns, extent = _LEGEND_COLUMNS, legend.get_window_extent(canvas.get_renderer())
    while extent.width > figure.bbox.width and columns > 1:
        legend.remove()
        columns -= 1
        legend = _add_legend(figure, handles, texts, columns)
        extent = legend.get_window_extent(canvas.get_renderer())
    return extent.height / figure.dpi


def _shown(figure: Figure) -> tuple[bytes, dict[str, int]]:
    width, height = 80 * figure.get_size_inches()  # pixels for an inch in a notebook
    return png(figure), {"width": round(width), "height": round(height)}


def save(figure: Figure, path: str | Path | None) -> Figure:
    """Write the figure to a path, if a path is given. The suffix selects the format."""
    if path is not None:
        suffix = require_suffix(path, *PICTURES)
        from matplotlib import rc_context

        # Type 42 is TrueType. Journals refuse type 3, which is matplotlib's default.
        with replacement(path) as file, rc_context({"pdf.fonttype": 42}):
            _write(figure, file, suffix[1:])
    return figure


def finish(
    figure: Figure,
    owner: str,
    path: str | Path | None,
    ax: GivenAxes = None,
    figsize: tuple[float, float] | None = None,
    title: str | None = None,
) -> Figure:
    """The picture of a result, with the size [inch] and the title that the caller requests; see `save` for path.

    DeclarationError is raised if the size or the title is not valid, or if the picture is in axes of the caller.
    """
    for name, given in (("figsize", figsize), ("title", title)):
        if given is not None and ax is not None:
            raise DeclarationError(f"{owner}: {name} is for new figures. Leave it out, or leave out ax.")
    if title is not None and not isinstance(title, str):
        raise DeclarationError(f"{owner}: title must be a text, got {shown(title)}.")
    if figsize is not None:
        sides = numbers_of(figsize)
        # Larger pictures need more than a gigabyte.
        if sides is None or sides.shape != (2,) or not ((1 <= sides) & (sides <= 50)).all():
            expected = "a width and a height from 1 to 50 inches, such as (8, 5)"
            raise DeclarationError(f"{owner}: figsize must be {expected}, got {shown(figsize)}.")
        figure.set_size_inches(*sides.tolist())
    if title is not None:
        parts = [part for part in (figure, *figure.subfigs) if part.get_suptitle()] or [figure]
        parts[0].suptitle(plain(title), fontsize=10)
    return save(figure, path)


def rounding(values: Array, units: Sequence[str] = ()) -> Array:
    """Largest spreads (n_y,) that count as rounding, of outputs (..., n_y).

    Spreads are relative to the largest value of the output, and to the largest value of all outputs of its unit. Values
    are rounding of 0 if they change at random over time, and are tiny compared with other outputs or with 1.
    """
    size = np.nan_to_num(np.abs(values), posinf=0.0).max(axis=tuple(range(np.ndim(values) - 1)), initial=0.0)
    change = np.sign(np.diff(np.nan_to_num(values, posinf=0.0, neginf=0.0), axis=-2))
    turns = change[..., 1:, :] * change[..., :-1, :] < 0
    is_noise = turns.sum(axis=tuple(range(turns.ndim - 1))) > _RANDOM_TURNS * turns[..., :1].size
    is_noise &= size <= max(LAST_DIGITS, ROUNDING * size.max(initial=0.0))
    alike = [max(s for s, other in zip(size, units, strict=True) if other == unit) if unit else 0.0 for unit in units]
    return np.where(is_noise, 2.0 * size, np.maximum(ROUNDING * size, LAST_DIGITS * np.array(alike or 0.0)))


def flatten(panels: Sequence[Axes], least: Array) -> None:
    """Widen the axes of outputs whose spread is rounding, at most `least` (n,), so that the curves look flat."""
    for axes, spread in zip(panels, least.tolist(), strict=True):
        low, high = axes.dataLim.intervaly
        if 0 < high - low <= spread:
            # the room depends on the value and its rounding; for rounding of 0 it is that of matplotlib for zeros
            room = _ABOUT_ZERO if max(-low, high) <= spread else max(0.05 * abs(low + high) / 2, 50.0 * spread)
            axes.update_datalim([(axes.dataLim.x0, low - room), (axes.dataLim.x0, high + room)])
            axes.autoscale_view(scalex=False)


def columns_of(owner: str, outputs: str | Sequence[str] | None, names: Sequence[str]) -> list[int] | None:
    """Columns of the outputs to draw, by name; None if no outputs are given."""
    if outputs is None:
        return None
    if not isinstance(outputs, str | list | tuple) or not all(isinstance(name, str) for name in outputs):
        raise DeclarationError(f"{owner}: outputs must be a name or a list of names, got {shown(outputs)}.")
    wanted = require_names(owner, "output", [outputs] if isinstance(outputs, str) else outputs, names)
    if not wanted:
        raise DeclarationError(f"{owner}: outputs is empty. Give at least one name, or leave outputs out.")
    return [names.index(name) for name in wanted]


def new_panels(figure: "FigureBase", t: Array, titles: Sequence[str], others: Others = _NONE) -> list[Axes]:
    """One panel with a title for each output. The panels have a common time axis if there are no `others`."""
    columns = n_columns(len(titles))
    grid = figure.subplots(n_rows(len(titles)), columns, sharex=not others, squeeze=False).ravel()
    for axes in grid[len(titles) :]:
        axes.set_visible(False)
    for i, (axes, title) in enumerate(zip(grid, titles, strict=False)):
        _entitle(axes, plain(title))
        place, text = others.get(i, (t, _time_label(t)))
        _along(axes, place)
        axes.grid(color="#e3e7eb", linewidth=0.6)
        axes.ticklabel_format(useOffset=False)
        style_axes(axes)
        if others or i + columns >= len(titles):
            axes.set_xlabel(text, fontsize=8)
            axes.tick_params(labelbottom=True)
    return list(grid[: len(titles)])


def _entitle(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=9, loc="left", fontweight="bold", pad=3)


def given_panels(
    owner: str,
    ax: GivenAxes,
    t: Array,
    names: Sequence[str],
    units: Sequence[str],
    *,
    overlay: bool = False,
    others: Others = _NONE,
) -> list[Axes]:
    """The caller's axes, one for each output, with labels. A single axes is repeated if outputs may share axes."""
    panels = axes_in(owner, ax)
    if overlay and len(panels) == 1:
        panels *= len(names)
    if len(panels) != len(names):
        raise DeclarationError(
            f"{owner}: {len(names)} outputs ({', '.join(names[:6])}{', ...' * (len(names) > 6)}) need "
            f"{len(names)} axes, got {len(panels)}. Choose outputs by outputs=[...]."
        )
    texts = labels(names, units)
    for axes in dict.fromkeys(panels):
        own = [k for k, panel in enumerate(panels) if panel is axes]
        place, text = others.get(own[0], (t, _time_label(t)))
        if not axes.has_data():
            _along(axes, place)
        axes.set_xlabel(text)
        shared = {units[k] if units else "" for k in own}
        unit = shared.pop() if len(shared) == 1 else ""
        common = f"[{typeset(unit)}]" if unit else ""
        axes.set_ylabel(plain(texts[own[0]] if len(own) == 1 else common))
    return panels


def outputs_of(
    names: Sequence[str], units: Sequence[str], chosen: Sequence[int] | None, most: int | None = None
) -> tuple[list[int], list[str], list[str]]:
    """Columns of the outputs to draw, their names and their units; by default the first outputs, or all."""
    columns = [*range(len(names))][:most] if chosen is None else [*chosen]
    return columns, [names[i] for i in columns], [units[i] for i in columns] if units else []


def panels_over_time(
    style: Style,
    t: Array,
    names: Sequence[str],
    units: Sequence[str],
    *,
    title: str | None = None,
    room: float = 0.0,
    overlay: bool = False,
    others: Others = _NONE,
) -> tuple[Figure, list[Axes]]:
    """The figure and its panels: a new figure with one panel for each output and room for a legend [inch], or the
    figure of the caller's axes.

    See `given_panels` for overlay.
    """
    if style.ax is not None:
        panels = given_panels(style.owner, style.ax, t, names, units, overlay=overlay, others=others)
        return root(panels[0]), panels
    figure = new_figure(HEAD_HEIGHT + room + ROW_HEIGHT * n_rows(len(names)))
    if title is not None:
        figure.suptitle(plain(title), fontsize=10)
    return figure, new_panels(figure, t, labels(names, units), others)


def three_diagrams(style: Style, room: float) -> tuple[Figure, list[Axes]]:
    """A new figure with three diagrams and room for a legend [inch], or the figure of the caller's axes."""
    if style.ax is None:
        figure = new_figure(DIAGRAM_HEIGHT + room)
        return figure, list(figure.subplots(1, 3))
    panels = axes_in(style.owner, style.ax)
    if len(panels) > 3:
        raise DeclarationError(f"{style.owner}: there are three diagrams, got {len(panels)} axes. Pass at most three.")
    return root(panels[0]), panels


def finish_diagrams(figure: Figure, panels: Sequence[Axes], style: Style, title: str, columns: int) -> None:
    """Format diagrams, and add the title and legend of a new figure, or a legend in the caller's axes."""
    for axes in panels:
        style_axes(axes)
        axes.grid(alpha=0.25)
    legends(figure, panels[:1], style, columns)
    if style.ax is None:
        figure.suptitle(plain(title), fontsize=10)


def axes_in(owner: str, ax: GivenAxes) -> list[Axes]:
    """Axes that a caller gave, one or several, as a list."""
    several = isinstance(ax, list | tuple) or (isinstance(ax, np.ndarray) and ax.dtype == object)
    panels = np.asarray([ax] if hasattr(ax, "fill_between") else ax if several else [], dtype=object)
    if not panels.size or not all(hasattr(axes, "fill_between") for axes in panels.flat):
        raise DeclarationError(f"{owner}: ax must be matplotlib Axes, or a list of them, got {shown(ax)}.")
    return list(panels.flat)


def root(axes: Axes) -> Figure:
    """The figure that contains the axes, also if they are in a subfigure."""
    figure: Any = axes.figure
    return figure.figure


def _along(axes: Axes, t: Array) -> None:
    axes.set_xlim(*abscissa(t)[[0, -1]])
    if len(t) == 1:
        axes.set_xticks([] if is_timeless(t) else t)


def _time_label(t: Array) -> str:
    return "" if is_timeless(t) else "time [s]"


def plain(text: str) -> str:
    """The text with dollar signs that do not start a formula."""
    return text.replace("$", r"\$")


def abscissa(t: Array) -> Array:
    """The times for an axis. A single time becomes a short interval."""
    return t if len(t) > 1 else t + np.array([-0.5, 0.5])


def along(t: Array, values: Array) -> Array:
    """Values (n_t,) for the abscissas of the times t (n_t,)."""
    return np.broadcast_to(values, abscissa(t).shape)


def bars(axes: Axes, t: Array, n: int) -> list[Array]:
    """Abscissas of n bars side by side, for values that do not depend on time. The panel shows no times."""
    for panel in axes.get_shared_x_axes().get_siblings(axes):
        panel.tick_params(labelbottom=True)
        panel.set_xlabel(_time_label(t), fontsize=8)
    axes.xaxis.set_visible(False)
    begin, end = abscissa(t)[[0, -1]]
    return [begin + (k + 0.3 + 0.4 * (abscissa(t) - begin) / (end - begin)) * (end - begin) / n for k in range(n)]


def style_axes(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.tick_params(which="minor", labelsize=6)  # logarithmic axes of less than two decades have such labels


def n_columns(n: int) -> int:
    return 1 if n == 1 else 2 if n in (2, 4) else 3


def n_rows(n: int) -> int:
    return -(-n // n_columns(n))


def cyclic(styles: Sequence[Any], k: int) -> Any:
    return styles[k % len(styles)]


def shared_legend(figure: "FigureBase", panels: Sequence[Axes], columns: int = _LEGEND_COLUMNS) -> None:
    """One legend for all panels."""
    handles = _handles(panels)
    _add_legend(figure, [*handles.values()], [*map(plain, handles)], columns)


def _handles(panels: Sequence[Axes]) -> dict[str, Any]:
    """The curve of each label of the panels."""
    both = (zip(*axes.get_legend_handles_labels(), strict=True) for axes in panels)
    return {label: handle for pairs in both for handle, label in pairs}


def _add_legend(figure: "FigureBase", handles: Sequence[Any], texts: Sequence[str], columns: int) -> "Legend":
    return figure.legend(handles, texts, loc="outside lower center", ncols=columns, fontsize=8, frameon=False)


def legends(figure: "FigureBase", panels: Sequence[Axes], style: Style, columns: int = _LEGEND_COLUMNS) -> None:
    """One legend of a new figure, or one legend in each of the caller's axes."""
    if style.ax is None:
        return None if style.legend is False else shared_legend(figure, panels, columns)
    for axes in dict.fromkeys(panels):
        own_legend(axes, style)
    return None


def own_legend(axes: Axes, style: Style) -> None:
    """Add a legend inside axes, at a free place, if there are several curves, or if it is requested."""
    handles = _handles([axes])
    if style.legend is False or len(handles) < (1 if style.legend else 2):
        return
    for width, size in _LEGENDS:
        texts = ["\n".join(wrap(plain(label), width)) for label in handles]
        look: dict[str, Any] = {"framealpha": 0.6, "edgecolor": "none", "loc": "best"}
        legend = axes.legend([*handles.values()], texts, fontsize=size, **look)
        own, room = legend.get_window_extent(), axes.bbox
        if own.width <= room.width and own.height <= room.height:
            return
    legend.remove()


def labels(names: Sequence[str], units: Sequence[str]) -> tuple[str, ...]:
    """Names, with their units in brackets if known."""
    return tuple(map(label, names, units or [""] * len(names)))
