"""The parts that all live pages have: their data, and the file with the viewer, the panel and the worker."""

import base64
import zlib
from collections.abc import Collection, Mapping, Sequence
from importlib.resources import files as resources
from pathlib import Path
from typing import Any

import numpy as np

from symmb._types import Array
from symmb._units import typeset
from symmb.results.files import replacement, require_suffix
from symmb.show.drawing import UPPER, Drawing, Driven, Exhibit, Ghost, Live, Page, bare, page
from symmb.show.live.wasm import levels

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; worker-src blob:; "
    "img-src data:"
)
"""What the page may load: nothing from a network."""


def require_page(path: str | Path | None) -> None:
    """Raise DeclarationError if a path is given that does not end in .html."""
    if path is not None:
        require_suffix(path, ".html")


def page_data(
    outputs: Sequence[str],
    units: Sequence[str],
    figures: Collection[str],
    limits: Mapping[str, tuple[float, float]],
    parameters: Sequence[Mapping[str, Any]],
    times: Array,
    wasm: bytes,
) -> dict[str, Any]:
    """The data that all live pages have. Values are in the units of parameters and outputs.

    Parameters
    ----------
    outputs, units : n_y names of the outputs, and their units
    figures        : names of the scalar outputs
    limits         : (low, high) by output
    parameters     : the parameters with the ends of their sliders
    times          : (n_t,) [s]
    wasm           : the module
    """
    grids = levels(len(parameters))
    return {
        "parameters": parameters,
        "outputs": [
            {"name": name, "unit": typeset(unit), "scalar": name in figures}
            for name, unit in zip(outputs, units, strict=True)
        ],
        "limits": [
            {"output": outputs.index(name), "low": json_number(low), "high": json_number(high)}
            for name, (low, high) in limits.items()
        ],
        "n_t": len(times),
        "n_y": len(outputs),
        "times": times.tolist(),
        "most_varied": len(grids),
        "levels": [[len(grid.row) for grid in own] for own in grids],
        "axes": [[[grid.axis(k) for k in range(grid.d)] for grid in own] for own in grids],
        "wasm": base64.b64encode(zlib.compress(wasm, 9)).decode(),
    }


def json_number(value: float) -> float | None:
    """A number for JSON, which has no infinite numbers."""
    return float(value) if np.isfinite(value) else None


def written(
    drawing: Drawing,
    driven: Sequence[Driven],
    data: Mapping[str, Any],
    path: str | Path | None,
    styles: Sequence[str] = ("live.css",),
) -> Page | None:
    """Write the page into a file; without a path, return the page. `driven` are the numbers that a run computes."""
    folder = resources("symmb.show.live")
    names = (*styles, "panel.html", "live.js", "worker.js")
    *looks, panel, script, worker = ((folder / name).read_text(encoding="utf-8") for name in names)
    added = {
        "head": f'\n<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
        "style": "\n" + "".join(looks),
        "panel": f"\n{panel}",
        "more": f'\n<script type="text/plain" id="worker">\n{worker}</script>\n<script>\n{script}</script>',
    }
    still = bare(drawing, driven)
    text = page(Exhibit(still, (Ghost("worst case", UPPER, still),)), Live(driven, data["n_y"], data, added))
    if path is None:
        return Page(drawing.name, text)
    with replacement(path) as file:
        file.write(text.encode())
    return None
