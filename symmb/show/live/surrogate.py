"""Live pages of bounds without a scene: the page evaluates the polynomials of the bounds instead of runs."""

import base64
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Indices
from symmb._units import typeset, units_of_parameters
from symmb.bound.answers import Bounds, Limits, limit_pairs
from symmb.bound.polynomials.ranges import Piecewise
from symmb.results.plot import labels
from symmb.show.drawing import Drawing, MovingFrame, Page
from symmb.show.live.live_page import page_data, require_page, written
from symmb.show.live.wasm import module

_LARGEST = 280_000
"""Largest number of characters of the polynomials and times in a page. Polynomials of more times are left out."""
_OF_A_TIME, _OF_A_VALUE = 32, 4
"""Numbers of characters of a time and its number in a page, and of the value of an output at this time."""


def live_surrogate(bounds: Bounds, path: str | Path | None = None, limits: Limits | None = None) -> Page | None:
    """Write the page of the polynomials of bounds, as ``Bounds.live``."""
    require_page(path)
    surrogate, box = bounds.surrogate, bounds.box
    if surrogate is None or box is None or not (known := np.isfinite(surrogate.error).all(axis=0)).any():
        raise DeclarationError(
            f"Bounds.live: these bounds by {bounds.method} have no scene and no polynomials. Use bounds of a scene, or "
            "bounds by PolynomialChaos()."
        )
    chosen, free = np.flatnonzero(known).tolist(), np.flatnonzero(box.lower < box.upper).tolist()
    names = [bounds.names[k] for k in chosen]
    units = [bounds.units[k] for k in chosen] if bounds.units else [""] * len(names)
    pairs = limit_pairs("Bounds.live", limits, names, units, needed=False)
    unit_of = {**units_of_parameters(bounds.nominal_parameters), **dict(zip(box.names, box.units, strict=False))}
    centre, half = box.center, box.radius
    parameters: list[dict[str, Any]] = [
        {
            "name": box.names[k],
            "unit": typeset(unit_of.get(box.names[k], "")),
            "value": float(centre[k]),
            "tolerance": float(half[k]),
            "low": float(box.lower[k]),
            "high": float(box.upper[k]),
            "most": float(half[k]),
            "in_percent": box.names[k] in box.percents,
        }
        for k in free
    ]
    own, rows = surrogate.part(slice(None), chosen), np.arange(len(bounds.t))
    of_a_time = _OF_A_TIME + _OF_A_VALUE * len(chosen)
    while len(text := _packed(own.part(rows, slice(None)))) > _LARGEST - of_a_time * len(rows) and len(rows) > 2:
        share = _LARGEST / (len(text) + of_a_time * len(rows))
        count = max(2, min(len(rows) - 1, int(0.95 * share * len(rows))))
        rows = np.unique(np.linspace(0, len(bounds.t) - 1, count).astype(int))
    t = bounds.t[rows]
    figures = names if len(t) == 1 else bounds.figures
    data = page_data(names, units, figures, pairs, parameters, t, module(len(free))) | {
        "inputs": [],
        "n_out": len(names),
        "pictures": list(range(len(t))),
        "possible": [[None, None]] * len(names),
        "note": " ".join(_notes(bounds, rows, [name for name in bounds.names if name not in names])),
        "surrogate": {
            "numbers": text,
            "parts": [
                {
                    "centre": (centre + half * middle)[free].tolist(),
                    "half": (half * scale)[free].tolist(),
                    "degrees": part.alpha[:, free].tolist(),
                }
                for middle, scale, part in zip(own.centres, own.halves, own.expansions, strict=True)
            ],
        },
    }
    drawing = Drawing(  # of nothing
        name=bounds.subject or "surrogate",
        t=t,
        frames=(MovingFrame("ground", np.eye(3, 4)[None]),),
        places=(),
        shapes=(),
        camera=np.eye(3),
        planar=True,
        up=np.array([0.0, 1.0, 0.0]),
        size=1.0,
        unit=1.0,
        gravity=np.zeros(3),
        outputs=labels(names, units),
        values=np.zeros((len(t), len(names))),
    )
    return written(drawing, (), data, path, ("live.css", "surrogate.css"))


def _notes(bounds: Bounds, rows: Indices, left_out: list[str]) -> list[str]:
    notes = [
        f"This page shows a surrogate of {bounds.evaluations} runs, and not the model: polynomials by {bounds.method}."
    ]
    if len(rows) < len(bounds.t):
        notes.append(f"It has {len(rows)} of {len(bounds.t)} times, and decides limits at these times only.")
    if left_out:
        notes.append(f"There are no polynomials for {', '.join(left_out)}.")
    return notes


def _packed(own: Piecewise) -> str:
    """Polynomials and their errors as text: first the constants of all parts, because they need all digits."""
    parts = [(part.coefficients[0], "<f8") for part in own.expansions] + [(own.error, "<f4")]
    parts += [(part.coefficients[1:], "<f4") for part in own.expansions]
    data = b"".join(np.ascontiguousarray(values, dtype=kind).tobytes() for values, kind in parts)
    return base64.b64encode(zlib.compress(data, 9)).decode()
