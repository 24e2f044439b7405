"""The picture of a root locus: the complex plane, and frequency and damping against the parameter."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from symmb._types import Array, Axes, Figure
from symmb.results.plot.colours import COLOURS, RUN_COLOUR
from symmb.results.plot.layout import cyclic, finish_diagrams, plain, three_diagrams
from symmb.results.plot.style import OWN, Style

_OPACITY = 0.22
"""Opacity of bands, so that a band below another band stays visible."""


def plot_root_locus(
    values: Array,
    eigenvalues: Array,
    curves: Mapping[str, Array],
    bands: Mapping[str, tuple[Array, Array]],
    *,
    parameter: str = "",
    title: str = "",
    style: Style = OWN,
) -> Figure:
    """Draw eigenvalues in the complex plane, and frequency and damping against a parameter.

    Parameters
    ----------
    values : (n,) values of the parameter
    eigenvalues : (n, m) complex       all eigenvalues [1/s]
    curves : "f", "zeta", "re", "im" -> values (n, k) of k oscillations, nan if the oscillation does not exist
    bands : the same names -> lower and upper bounds (n, k); may be empty
    style : options                    with up to three axes of the caller, in this order of diagrams
    """
    figure, panels = three_diagrams(style, 0.4)
    modes = range(curves["f"].shape[1])
    colours = style.colours([cyclic(COLOURS, k) for k in modes])
    names = style.labels([f"mode {k + 1}" for k in modes])
    _draw_plane(panels[0], eigenvalues, curves, bands, [*zip(colours, names, strict=True)])
    texts = (("f", "frequency [Hz]"), ("zeta", "damping [-]"))
    for axes, (name, label) in zip(panels[1:], texts, strict=False):  # the caller may have fewer axes
        for k, curve in enumerate(curves[name].T):
            colour = colours[k]
            if name in bands:
                lower, upper = bands[name]
                axes.fill_between(values, lower[:, k], upper[:, k], color=colour, alpha=_OPACITY, linewidth=0)
            axes.plot(values, curve, color=colour, linewidth=1.2, label=names[k])
        axes.set(xlabel=plain(parameter), ylabel=label, xlim=(values[0], values[-1]))
    for axes in panels[2:]:
        axes.axhline(0.0, color=RUN_COLOUR, linewidth=0.6)
    finish_diagrams(figure, panels, style, f"{title}: from {parameter} = {values[0]:g} (o) to {values[-1]:g} (x)", 6)
    return figure


def _draw_plane(
    axes: Axes,
    eigenvalues: Array,
    curves: Mapping[str, Array],
    bands: Mapping[str, tuple[Array, Array]],
    looks: Sequence[tuple[Any, str | None]],
) -> None:
    """The upper half of the complex plane. A circle marks the first value, a cross the last value."""
    axes.axvline(0.0, color=RUN_COLOUR, linewidth=0.6)
    real = np.where((eigenvalues.imag == 0) & (eigenvalues != 0), eigenvalues.real, np.nan)
    real = real[np.isfinite(real)]
    if len(real):
        axes.plot(real, 0 * real, ".", color=RUN_COLOUR, markersize=3, clip_on=False, label="real eigenvalues")
    for k, (x, y) in enumerate(zip(curves["re"].T, curves["im"].T, strict=True)):
        colour, label = looks[k]
        if bands:
            _draw_area(axes, *(end[:, k] for name in ("re", "im") for end in bands[name]), colour=colour)
        axes.plot(x, y, color=colour, linewidth=1.2, label=label)
        for i, marker in ((0, "o"), (-1, "x")):
            axes.plot(x[i], y[i], marker, color=colour, markersize=4)
    axes.set(xlabel="real part [1/s]", ylabel="imaginary part [1/s]")
    axes.set_ylim(bottom=0.0)


def _draw_area(axes: Axes, left: Array, right: Array, low: Array, high: Array, *, colour: str) -> None:
    """Draw the area of the rectangles of all values, and of the convex hull of each pair of neighbouring rectangles."""
    from matplotlib.colors import to_rgb

    light = 1 - _OPACITY * (1 - np.array(to_rgb(colour)))  # opaque, so that overlapping areas have one colour
    sides = np.stack([left, right, right, left], axis=1), np.stack([low, low, high, high], axis=1)
    corners = np.stack(sides, axis=2)
    for one, other in pairwise(corners):
        both = np.vstack([one, other])
        if np.isfinite(both).all():
            axes.fill(*_hull(both).T, color=light, linewidth=0.5, zorder=0.5)


def _hull(points: Array) -> Array:
    """Corners of the convex hull of points (n, 2), sorted by their angle about the mean of the hull points."""
    angles = np.linspace(0, 2 * np.pi, 33)[:-1]
    farthest = (points @ np.stack([np.cos(angles), np.sin(angles)])).argmax(axis=0)
    return points[farthest]
