"""Stills. A still is one picture of an exhibit. matplotlib paints it from back to front."""

from collections.abc import Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from symmb._magnitudes import NOTHING
from symmb._types import Array
from symmb.results.plot import COLOURS as OF_BODIES
from symmb.show.drawing.bodies import SOLID
from symmb.show.drawing.exhibit import Exhibit, convex_hull
from symmb.show.drawing.forms import COLOURS, NOMINAL
from symmb.show.drawing.outlines import Outline, Painter
from symmb.show.drawing.shapes import Drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STILLS = (".png", ".svg")
"""Formats of stills."""
_WIDTH = 7.0
"""Width of a still [inch]."""
_EQUALS = "\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}"


def still(exhibit: Exhibit, file: BinaryIO, suffix: str) -> None:
    """Write the exhibit's picture."""
    figure, axes = canvas(exhibit, [exhibit.picture], dpi=150)
    paint(axes, exhibit, exhibit.picture)
    figure.savefig(file, format=suffix[1:])


def canvas(exhibit: Exhibit, pictures: Sequence[int], dpi: float) -> "tuple[Figure, Axes]":
    """An empty figure and its axes, with room for some pictures of the exhibit."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    low, high = _limits(exhibit, pictures)
    width, height = high - low
    ratio = min(max(height / width, 0.45), 1.1)  # otherwise a long mechanism would be too small
    figure = Figure(figsize=(_WIDTH, _WIDTH * ratio), dpi=dpi)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    half = max(width, height / ratio) / 2
    middle = (low + high) / 2
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half * ratio, middle[1] + half * ratio)
    axes.set_axis_off()
    return figure, axes


def _limits(exhibit: Exhibit, pictures: Sequence[int]) -> tuple[Array, Array]:
    """Smallest and largest coordinates (2,) in the camera's plane over some pictures [m]."""
    camera = exhibit.drawing.camera
    corners = [
        outline.points
        for drawing in (exhibit.drawing, *(ghost.drawing for ghost in exhibit.ghosts))
        for k in {min(k, len(drawing.t) - 1) for k in pictures}
        for outline in Painter(drawing, k, camera).outlines()
        if outline.shape.kind != SOLID
    ]
    if exhibit.region is not None:
        corners.append(exhibit.region.sweep @ camera[:2, :2].T)
    if not corners:
        return np.full(2, -1.0), np.ones(2)
    every = np.vstack(corners)
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.06 * max((high - low).max(), 8 * exhibit.drawing.unit)
    lines = sum(len(_lines(ghost.label)) for ghost in exhibit.ghosts)
    head = margin * (bool(exhibit.ghosts) + 0.5 * max(lines - len(exhibit.ghosts), 0))
    return low - margin - [0, 2.2 * margin], high + margin + [0, head]  # arrows of axes and gravity are at the bottom


def paint(axes: "Axes", exhibit: Exhibit, k: int) -> None:
    """Paint picture k."""
    from matplotlib.collections import PolyCollection

    drawing, camera, region = exhibit.drawing, exhibit.drawing.camera, exhibit.region
    if region is not None and len(region.sweep):
        triangles = list((region.sweep @ camera[:2, :2].T).reshape(-1, 3, 2))
        look = {"facecolor": COLOURS["region"], "edgecolor": COLOURS["region"], "zorder": 0}
        axes.add_collection(PolyCollection(triangles, **look))
    for order, outline in enumerate(Painter(drawing, k, camera).outlines()):
        if outline.shape.kind != SOLID:
            _paint(axes, outline, _colour(outline), 0.3 if outline.shape.faint else 1.0, 1 + order * 1e-4)
    for ghost in exhibit.ghosts:
        for outline in Painter(ghost.drawing, min(k, len(ghost.drawing.t) - 1), camera).outlines():
            if outline.shape.colour not in NOMINAL and not outline.shape.faint:
                _paint(axes, outline, ghost.tint, 0.4, 0.5)
    if region is not None:
        seen = region.points[k] @ camera[:2].T
        axes.plot(*seen.T, ".", color=COLOURS["trace"], markersize=3, zorder=3)
    _furnish(axes, drawing, k)
    lines = [(ghost.tint, line) for ghost in exhibit.ghosts for line in _lines(ghost.label)]
    for i, (tint, line) in enumerate(lines):
        at, style = (0, -24 - 11 * i), {"color": tint, "fontsize": 8, "parse_math": False}
        axes.annotate(line, (0.02, 0.975), at, "axes fraction", "offset points", **style)


def _lines(label: str) -> list[str]:
    """Lines of the label of a run. All lines except the first are indented. A name and its value are in one line."""
    whole, style = label.replace(" = ", _EQUALS), {"subsequent_indent": "    ", "break_on_hyphens": False}
    lines = wrap(whole, 104, max_lines=4, placeholder=" …", **style)
    return [line.replace(_EQUALS, " = ") for line in lines]


def _cut(text: str, length: int) -> str:
    return text if len(text) <= length else text[: length - 2] + " …"


def _colour(outline: Outline) -> str:
    colour = outline.shape.colour
    return COLOURS.get(colour) or OF_BODIES[int(colour) % len(OF_BODIES)]


def _paint(axes: "Axes", outline: Outline, colour: str, alpha: float, order: float) -> None:
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Polygon

    if outline.light is not None and alpha == 1:
        shades = np.clip(outline.light[:, None] * _rgb(colour), 0, 1)
        triangles: Any = outline.points.reshape(-1, 3, 2)  # an array is drawn ten times faster than a list
        axes.add_collection(PolyCollection(triangles, facecolor=shades, edgecolor=shades, linewidth=0.3, zorder=order))
    elif outline.width:
        width = max(outline.width * _points_per_metre(axes), 0.8)
        axes.plot(*outline.points.T, color=colour, alpha=alpha, linewidth=width, solid_capstyle="round", zorder=order)
    elif len(outline.points) > 2:
        edge = tuple(0.6 * _rgb(colour)) if alpha == 1 else colour
        points = outline.points if outline.light is None else convex_hull(outline.points)
        axes.add_patch(Polygon(points, facecolor=colour, edgecolor=edge, alpha=alpha, linewidth=0.6, zorder=order))


def _points_per_metre(axes: "Axes") -> float:
    low, high = axes.get_xlim()
    return 72 * _WIDTH / (high - low)


def _rgb(colour: str) -> Array:
    return np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])


def _furnish(axes: "Axes", drawing: Drawing, k: int) -> None:
    """Write the name and the time, and draw axes, gravity and scale."""
    name = {"fontsize": 10, "fontweight": "bold", "parse_math": False}
    axes.text(0.02, 0.975, _cut(drawing.name, 65), va="top", transform=axes.transAxes, **name)
    axes.text(0.98, 0.975, f"t = {drawing.t[k]:.4g} s", fontsize=9, va="top", ha="right", transform=axes.transAxes)
    pixels = 72 * _WIDTH  # offsets are in points
    height = pixels * (axes.get_ylim()[1] - axes.get_ylim()[0]) / (axes.get_xlim()[1] - axes.get_xlim()[0])

    def arrow(x: float, direction: Array, text: str) -> None:
        size = np.linalg.norm(direction)
        start, axis = np.array([x, 44.0]), direction / max(size, NOTHING)
        tip, label = ((start + (24 * size + gap) * axis) / [pixels, height] for gap in (0, 9))
        if size > 0.15:
            foot, look = start / [pixels, height], {"color": COLOURS[text], "shrinkA": 0, "shrinkB": 0}
            axes.annotate(
                "",
                (tip[0], tip[1]),
                (foot[0], foot[1]),
                "axes fraction",
                "axes fraction",
                {"arrowstyle": "-|>", **look},
            )
            style = {"color": COLOURS[text], "fontsize": 8, "ha": "center", "va": "center"}
            axes.text(label[0], label[1], text, transform=axes.transAxes, **style)

    for column, name in zip(drawing.camera[:2].T, "xyz", strict=True):
        arrow(40.0, column, name)
    if g := float(np.linalg.norm(drawing.gravity)):
        arrow(84.0, drawing.camera[:2] @ drawing.gravity / g, "g")
    left, right = axes.get_xlim()
    most = 0.2 * (right - left)
    power = 10 ** np.floor(np.log10(most))
    length = next(f * power for f in (5, 2, 1) if f * power <= most)
    share = length / (right - left)
    axes.plot([0.97 - share, 0.97], [0.04, 0.04], color=COLOURS["scale"], linewidth=1.2, transform=axes.transAxes)
    text = f"{length:g} m" if length >= 1 else f"{1e3 * length:g} mm" if length >= 1e-3 else f"{1e6 * length:g} µm"
    axes.text(0.97 - share / 2, 0.05, text, fontsize=8, ha="center", transform=axes.transAxes)
