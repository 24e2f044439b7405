"""The page of a drawing: one HTML file with the viewer and all numbers. It needs no network."""

import base64
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files as resources
from string import Template
from typing import Any

import numpy as np

from symmb._types import Array
from symmb.bound.responses import SIDES
from symmb.results.plot import COLOURS as OF_BODIES
from symmb.show.drawing.exhibit import Exhibit
from symmb.show.drawing.forms import COLOURS, IN_WORLD, LIGHT, NOMINAL, directions, parts
from symmb.show.drawing.shapes import Drawing, Shape
from symmb.show.drawing.survey import Driven

_SPEEDS = [1e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0]
"""Speeds that a page offers, relative to real time."""
LIVE_TEXTS = "head", "style", "panel", "more"
"""Names of the texts in viewer.html that a live page adds."""


class _Numbers:
    """All numbers of a page. Equal arrays are stored once. An offset and a number of rows identify an array."""

    def __init__(self) -> None:
        self._offsets: dict[bytes, int] = {}
        self.spare = self._size = 0

    def room(self, count: int) -> int:
        """The offset of numbers that a live page computes. They come before the stored numbers."""
        self.spare = self._size = self._size + count
        return self._size - count

    def __call__(self, values: Array) -> list[int]:
        data = np.asarray(values, dtype="<f8").tobytes()
        offset = self._offsets.setdefault(data, self._size)
        self._size += len(data) // 8 if offset == self._size else 0
        return [offset, len(values)]

    def text(self) -> str:
        return base64.b64encode(b"".join(self._offsets)).decode()


@dataclass(frozen=True, eq=False)
class Live:
    """What a live page adds to a page.

    Attributes
    ----------
    driven : the numbers of the drawing that the page computes, besides n_y outputs
    data : further data
    texts : texts by the names of `LIVE_TEXTS` in viewer.html
    """

    driven: Sequence[Driven]
    n_y: int
    data: Mapping[str, Any]
    texts: Mapping[str, str]


def page(exhibit: Exhibit, live: Live | None = None) -> str:
    """The text of the page."""
    numbers = _Numbers()
    drawing, bounds, region = exhibit.drawing, exhibit.bounds, exhibit.region
    columns = [] if live is None else _columns(live, len(drawing.t), numbers)
    given = {} if live is None else {side: [numbers.room(len(drawing.t) * live.n_y), len(drawing.t)] for side in SIDES}
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
    if live is not None:
        for k, run in enumerate(runs):
            for driven, column in zip((None, *live.driven), columns, strict=True):
                of, name = (run, "values") if driven is None else (run[driven.part[0]][driven.part[1]], driven.part[2])
                of[name] = [column["at"][k], column["rows"]]
        data |= {"bounds": given, "live": {**live.data, "columns": columns}}
    data |= {"numbers": numbers.text(), "spare": numbers.spare}
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
        **{name: "" if live is None else live.texts[name] for name in LIVE_TEXTS},
    )


def _columns(live: Live, n: int, numbers: _Numbers) -> list[dict[str, Any]]:
    """Where the outputs of a run are written to, for the nominal run and the worst case: first the values of curves."""
    columns, first = list[dict[str, Any]](), 0
    for width, moves in [(live.n_y, True), *((d.expression.numel(), d.moves) for d in live.driven)]:
        rows = n if moves else 1
        at = [numbers.room(rows * width) for _ in range(2)]
        columns.append({"at": at, "rows": rows, "column": first, "width": width})
        first += width
    return columns


def bare(drawing: Drawing, driven: Sequence[Driven]) -> Drawing:
    """A drawing without the numbers that a live page computes, except those of the first picture."""
    parts = {name: list(getattr(drawing, name)) for name in ("frames", "places", "shapes")}
    for kind, i, name in (one.part for one in driven):
        value = getattr(parts[kind][i], name)
        if name != "base" and value is not None:
            parts[kind][i] = replace(parts[kind][i], **{name: value[:1]})
    return replace(drawing, values=drawing.values[:1], **{name: tuple(own) for name, own in parts.items()})


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
