"""The file of a run: attributes of a Trajectory, and values that the equations would give without a file."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from symmb._labelled import Labelled, each_parameter, known, over_outputs, unit_text
from symmb._types import Array
from symmb._units import read_headings
from symmb.results.files import Record
from symmb.run.events import Event
from symmb.run.verification import Drift, Energy

PLAIN = (
    *("t", "units", "values", "parameters", "q", "v", "s", "lam", "row_names", "position_drift", "velocity_drift"),
    *("energy_drift", "solver", "reason", "statistics", "setup_seconds", "run_seconds", "error", "doubts", "figures"),
)
"""Attributes of a Trajectory that its file contains under the same names."""
Contents = tuple[dict[str, Any], dict[str, Any]]
"""Attributes of a Trajectory without its scene, and values of its cached properties."""


def of_record(record: Record) -> Contents:
    """The contents of an archive or a JSON file."""
    t, names, rows = record.times(), record.texts("names"), record.names("row_names")
    states = record.names("q_names"), record.names("v_names"), record.names("s_names")
    parts = [record.array(key, len(t), len(own)) for key, own in zip("qvs", states, strict=True)]
    drift = Drift(**_series(record.record("drift"), Drift._fields, len(t)))
    energy = Energy(**_series(record.record("energy"), Energy._fields, len(t)))
    attributes = {
        "parameters": record.numbers("parameters"),
        "solver": record.text("solver"),
        "reason": record.text("reason"),
        "t": t,
        "x": np.concatenate(parts, axis=1),
        "work": energy.work,
        "statistics": dict(record.record("statistics").plain),
        "setup_seconds": record.number("setup_seconds"),
        "run_seconds": record.number("run_seconds"),
        "events": tuple(_event(event) for event in record.records("events")),
        "figures": record.numbers("figures") if "figures" in record else {},
        "error": record.with_nan("error", len(t), len(names)) if "error" in record else None,
    }
    derived = {
        "name": record.text("scene"),
        "names": names,
        "units": record.texts("units"),
        "values": record.with_nan("values", len(t), len(names)),
        "lam": record.with_nan("lam", len(t), len(rows)),
        "state_names": states,
        "row_names": rows,
        "drift": drift,
        "energy": energy,
        **{name: record.number(name) for name in ("position_drift", "velocity_drift", "energy_drift")},
        "doubts": record.texts("doubts") if "doubts" in record else (),
        "_text": record.text("text"),
    }
    return attributes, derived


def of_table(table: Record) -> Contents:
    """The contents of a table with a column t, and a column for each output."""
    (first, *own), columns = table.texts("headings"), table.record("columns")
    names, units = read_headings(first, own)
    t, *values = (columns.with_nan(str(k), None) for k in range(1 + len(names)))
    unknown = np.full(len(t), np.nan)
    entries = {
        "scene": "",
        "t": t,
        "names": names,
        "units": units,
        "values": np.transpose(values) if values else np.zeros((len(t), 0)),
        "text": f"{len(t)} times from {t[0]:g} to {t[-1]:g} s: {', '.join(names)}",
        **dict.fromkeys(("q", "v", "s", "lam"), np.zeros((len(t), 0))),
        **dict.fromkeys(("q_names", "v_names", "s_names", "row_names"), ()),
        "parameters": {},
        "statistics": {},
        **dict.fromkeys(("solver", "reason"), ""),
        **dict.fromkeys(("setup_seconds", "run_seconds"), math.nan),
        "drift": dict.fromkeys(Drift._fields, unknown),
        "energy": dict.fromkeys(Energy._fields, unknown),
        **dict.fromkeys(("position_drift", "velocity_drift", "energy_drift"), math.nan),
    }
    return of_record(Record(entries))


def labelled(record: Mapping[str, Any]) -> Labelled:
    """The entries of a file as labelled arrays. The parameters become coordinates without a dimension."""
    names, units = list(record["names"]), record["units"]
    coordinates, unit_of = over_outputs(record["t"], names, units, "value", "error")
    series = ("time", "output")
    variables = known({"value": (series, record["values"]), "error": (series, record["error"])})
    own, units_of_own = each_parameter(record["parameters"], (), [*coordinates, "unit", *variables, "error"])
    attributes = {name: record[name] or None for name in ("scene", "solver", "reason")}
    attributes |= {"units": unit_text(names, units), "doubts": "\n".join(record["doubts"]) or None}
    return Labelled(coordinates | own, variables, attributes, unit_of | units_of_own)


def _series(record: Record, names: tuple[str, ...], n_t: int) -> dict[str, Array]:
    return {name: record.with_nan(name, n_t) for name in names}


def _event(record: Record) -> Event:
    numbers = {name: record.number(name) for name in ("time", "before", "after", "work")}
    depends = record.plain.get("depends_on_order") is True
    impulse = tuple(record.array("impulse", None).tolist()) if "impulse" in record else ()
    return Event(
        name=record.text("name"), what=record.text("what"), depends_on_order=depends, impulse=impulse, **numbers
    )
