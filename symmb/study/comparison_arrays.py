"""A comparison as arrays with named dimensions."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from symmb._labelled import BOUND, Labelled, Named, over_outputs, texts, unit_text
from symmb._types import Array
from symmb.bounds import box_coordinates
from symmb.model import Box
from symmb.study.reference import Reference
from symmb.study.row import Row


def labelled(record: Mapping[str, Any], rows: Sequence[Row], reference: Reference, box: Box) -> Labelled:
    """Bounds of all methods, their cost and their scores. Estimates of methods that have none are nan.

    Parameters
    ----------
    record                 all entries of a file
    rows, reference, box   of the Comparison
    """
    t, names, units = record["t"], record["names"], record["units"]
    n_t, n_y = len(t), len(names)
    coordinates, unit_of = over_outputs(t, names, units)
    coordinates |= {
        "bound": (("bound",), texts(BOUND)),
        **box_coordinates(box),
        "method": (("method",), texts([row.name for row in rows])),
        "kind": (("method",), texts([row.kind for row in rows])),
    }
    pair = ("method", "bound", "time", "output")
    value = np.reshape([[row.lower, row.upper] for row in rows], (len(rows), 2, n_t, n_y))
    variables: dict[str, Named] = {
        "value": (pair, value),
        "reference": (pair[1:], np.stack([reference.lower, reference.upper])),
        "uncertainty": (("output",), reference.uncertainty),
    }
    for name, kind in (("evaluations", int), ("failed", int), ("run_seconds", float)):
        variables[name] = ("method",), np.array([getattr(row, name) for row in rows], dtype=kind)
    variables |= _optional(rows, (n_t, n_y))
    for name in ("error", "over", "under", "coverage"):
        values = [getattr(row.score, name) for row in rows]
        variables[name] = ("method", "output"), np.reshape(values, (len(rows), n_y)).astype(float)
    if record["solver_error"] is not None:
        variables["solver_error"] = ("output",), record["solver_error"]
    if "value" in unit_of:
        unit_of |= dict.fromkeys(("reference", "estimate", "inner"), unit_of["value"])
    attributes = {
        "scene": record["scene"],
        **{name: record[name] or None for name in ("solver", "reason")},
        "reference_method": reference.method,
        "units": unit_text(names, units),
        "doubts": "\n".join(record["doubts"]) or None,
    }
    return Labelled(coordinates, variables, attributes, unit_of | {"run_seconds": "s"})


def _optional(rows: Sequence[Row], shape: tuple[int, int]) -> dict[str, Named]:
    """Estimates and inner bounds, if any method has them."""
    estimates = [row.estimate for row in rows]
    inner = [row.inner and np.stack(row.inner) for row in rows]
    arrays: dict[str, Named] = {}
    if any(estimate is not None for estimate in estimates):
        arrays["estimate"] = ("method", "time", "output"), _filled(estimates, shape)
    if any(pair is not None for pair in inner):
        arrays["inner"] = ("method", "bound", "time", "output"), _filled(inner, (2, *shape))
    return arrays


def _filled(arrays: Sequence[Array | None], shape: tuple[int, ...]) -> Array:
    """Arrays in one; those that are missing are nan."""
    return np.stack([np.full(shape, np.nan) if array is None else array for array in arrays])
