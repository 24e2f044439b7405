"""A comparison as arrays with named dimensions."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from symmb._labelled import BOUND, Labelled, Named, known, over_outputs, texts, unit_text
from symmb._types import Array
from symmb.bound.bounds import box_coordinates
from symmb.equations.model import Box
from symmb.study.reference import Reference
from symmb.study.row import Row


def labelled(record: Mapping[str, Any], rows: Sequence[Row], reference: Reference, box: Box) -> Labelled:
    """Bounds of all methods, their cost and their scores. If a method estimates no error, the values are nan.

    Parameters
    ----------
    record                 all entries of a file
    rows, reference, box   of the Comparison
    """
    names, units = record["names"], record["units"]
    shape = len(record["t"]), len(names)
    coordinates, unit_of = over_outputs(record["t"], names, units, "value", "reference", "estimate", "inner")
    coordinates |= {
        "bound": (("bound",), texts(BOUND)),
        **box_coordinates(box),
        "method": (("method",), texts([row.name for row in rows])),
        "kind": (("method",), texts([row.kind for row in rows])),
    }
    series, pair = ("time", "output"), ("bound", "time", "output")
    costs = (("evaluations", int), ("failed", int), ("run_seconds", float))
    scores = {
        name: np.reshape([getattr(row.score, name) for row in rows], (len(rows), shape[1])).astype(float)
        for name in ("error", "over", "under", "coverage")
    }
    variables: dict[str, Named] = {
        "value": (("method", *pair), np.reshape([[row.lower, row.upper] for row in rows], (len(rows), 2, *shape))),
        "reference": (pair, np.stack([reference.lower, reference.upper])),
        "uncertainty": (("output",), reference.uncertainty),
        **{name: (("method",), np.array([getattr(row, name) for row in rows], dtype=kind)) for name, kind in costs},
        "estimate": (("method", *series), _filled([row.estimate for row in rows], shape)),
        "inner": (("method", *pair), _filled([row.inner and np.stack(row.inner) for row in rows], (2, *shape))),
        **{name: (("method", "output"), own) for name, own in scores.items()},
        "solver_error": (("output",), record["solver_error"]),
    }
    attributes = {
        "scene": record["scene"],
        **{name: record[name] or None for name in ("solver", "reason")},
        "reference_method": reference.method,
        "units": unit_text(names, units),
        "doubts": "\n".join(record["doubts"]) or None,
    }
    return Labelled(coordinates, known(variables), attributes, unit_of | {"run_seconds": "s"})


def _filled(arrays: Sequence[Array | None], shape: tuple[int, ...]) -> Array | None:
    """Arrays stacked in one array. Missing arrays are nan; None if all are missing."""
    if all(array is None for array in arrays):
        return None
    return np.stack([np.full(shape, np.nan) if array is None else array for array in arrays])
