"""The page of a drawing: one HTML file with the viewer and all numbers. It needs no network."""

import base64
import html
import json
from importlib.resources import files as resources
from string import Template
from typing import Any

import numpy as np

from symmb._types import Array
from symmb.results.plot import COLOURS as OF_BODIES
from symmb.show.drawing.exhibit import Exhibit
from symmb.show.drawing.forms import COLOURS, IN_WORLD, LIGHT, NOMINAL, directions, parts
from symmb.show.drawing.shapes import Drawing, Shape

_SPEEDS = [1e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0]
"""Speeds that a page offers, relative to real time."""


class _Numbers:
    """All numbers of a page. Equal arrays are stored once. An offset and a number of rows identify an array."""

    def __init__(self) -> None:
        self._offsets: dict[bytes, int] = {}
        self._size = 0

    def __call__(self, values: Array) -> list[int]:
        data = np.asarray(values, dtype="<f8").tobytes()
        offset = self._offsets.setdefault(data, self._size)
        self._size += len(data) // 8 if offset == self._size else 0
        return [offset, len(values)]

    def text(self) -> str:
        return base64.b64encode(b"".join(self._offsets)).decode()


def page(exhibit: Exhibit) -> str:
    """The text of the page."""
    numbers = _Numbers()
    drawing, bounds, region = exhibit.drawing, exhibit.bounds, exhibit.region
    runs = [_run(own, "nominal", "", numbers) for own in exhibit.family or (drawing,)]
    runs += [_run(ghost.drawing, ghost.label, ghost.tint, numbers) for ghost in exhibit.ghosts]
    data: dict[str, Any] = {
        "palette": OF_BODIES,
        "colours": COLOURS,
        "nominal": NOMINAL,
        "light": LIGHT,
        "runs": runs,
        "speed": speed(float(np.ptp(drawing.t))),
        "picture": exhibit.picture,
        "sliders": [vars(slider) | {"values": slider.values.tolist()} for slider in exhibit.sliders],
    }
    if bounds is not None:
        data["bounds"] = {"lower": numbers(bounds.lower), "upper": numbers(bounds.upper)}
        data["mark"] = {"output": bounds.output, "time": bounds.time}
    if region is not None:
        data["region"] = {
            "name": region.name,
            "count": region.points.shape[1],
            "points": numbers(region.points),
            "sweep": numbers(region.sweep),
        }
    data["numbers"] = numbers.text()
    legend = "".join(f'<em style="color:{g.tint}">{html.escape(g.label)}</em>' for g in exhibit.ghosts)
    legend = f"<div>{legend}</div>" if legend else ""
    if drawing.notes:
        legend += f"<span>not drawn: {html.escape(', '.join(drawing.notes))}</span>"
    folder = resources("symmb.show.drawing")
    return Template((folder / "viewer.html").read_text(encoding="utf-8")).substitute(
        title=html.escape(drawing.name),
        legend=legend,
        speeds="".join(f'<option value="{s:g}">{s:g} &times;</option>' for s in _SPEEDS),
        drawing=json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"),
        viewer=(folder / "viewer.js").read_text(encoding="utf-8"),
    )


def _run(drawing: Drawing, label: str, tint: str, numbers: _Numbers) -> dict[str, Any]:
    return {
        "label": label,
        "tint": tint,
        "t": numbers(drawing.t),
        "frames": [{"name": f.name, "pose": numbers(f.pose)} for f in drawing.frames],
        "places": [
            vars(p) | {"base": numbers(p.base[None]), "shift": None if p.shift is None else numbers(p.shift)}
            for p in drawing.places
        ],
        "shapes": [_shape(s, drawing.planar, numbers) for s in drawing.shapes],
        "camera": drawing.camera.ravel().tolist(),
        "up": drawing.up.tolist(),
        "planar": drawing.planar,
        "size": drawing.size,
        "unit": drawing.unit,
        "gravity": drawing.gravity.tolist(),
        "outputs": drawing.outputs,
        "values": numbers(drawing.values),
    }


def _shape(shape: Shape, planar: bool, numbers: _Numbers) -> dict[str, Any]:
    track = directions(shape)
    own = [vars(p) | {"points": None if p.points is None else numbers(p.points)} for p in parts(shape, flat=planar)]
    return vars(shape) | {
        "size": [float(x) for x in shape.size],
        "direction": None if track is None else numbers(track),
        "in_world": shape.form in IN_WORLD,
        "parts": own,
        "present": None if shape.present is None else numbers(shape.present),
    }


def speed(duration: float, shown: float = 8.0) -> float:
    """Initial speed of the page, relative to real time. A run takes about 8 s. Runs of 4 to 16 s are in real time."""
    if shown / 2 <= duration <= 2 * shown or not duration:
        return 1.0
    return min(_SPEEDS, key=lambda speed: abs(np.log(duration / speed / shown)))
