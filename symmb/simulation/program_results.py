"""Results that programs write: tables of times and outputs as .csv, .json or .npz files."""

import csv
import json
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from symmb._errors import SimulationError
from symmb._types import Array
from symmb.files import require_usual_size

_TIME = "time"
_AGREE = 1e-6
"""Difference of times, over the largest one, up to which they are the same: programs write about six digits."""


def read_table(path: Path, times: Array, outputs: tuple[str, ...], interpolate: bool) -> Array:
    """Outputs (n_t, n_y) at times from a file with a column `time` and one for each output. Other columns are ignored.

    With a single time the column `time` may be left out.

    Raises
    ------
    SimulationError     if the file cannot be read, lacks a column, or has other times
    """
    if not path.is_file():
        raise SimulationError(f"the program wrote no file {path.name!r}")
    if not path.stat().st_size:
        raise SimulationError(f"{path.name} is empty")
    try:
        columns = READERS[path.suffix](path)
        lost = [name for name in outputs if name not in columns]
        if lost:
            raise SimulationError(f"no column {lost[0]!r}, only {', '.join(map(repr, columns))[:200]}")
        values = np.column_stack([_numbers(columns, name) for name in outputs])
        if _TIME not in columns and len(times) == len(values) == 1:
            return values
        if _TIME not in columns:
            raise SimulationError(f"no column {_TIME!r}")
        at = _numbers(columns, _TIME)
    except SimulationError as error:
        raise SimulationError(f"{path.name}: {error}") from None
    except Exception as error:  # a file of another program: anything may be wrong with it
        raise SimulationError(f"{path.name} cannot be read: {' '.join(str(error).split())[:200]}") from None
    if len(at) != len(values):
        raise SimulationError(f"{path.name}: {len(at)} times, but {len(values)} values of the outputs")
    return _at_times(path.name, at, values, times, interpolate)


def _numbers(columns: Mapping[str, Any], name: str) -> Array:
    """A column (n,) as numbers; a single one as a column."""
    column = columns[name]
    if isinstance(column, list) and (odd := [x for x in column if isinstance(x, str) and "_" in x]):
        raise SimulationError(f"{name!r}: {odd[0][:40]!r} is no number")  # Python would take it for one
    values = np.atleast_1d(column if isinstance(column, np.ndarray) else np.array(column, dtype=float))
    if values.ndim != 1 or np.iscomplexobj(values):
        raise SimulationError(
            f"{name!r} must be a list of real numbers, got the shape {values.shape} of {values.dtype}"
        )
    return values.astype(float)


def _at_times(name: str, at: Array, values: Array, times: Array, interpolate: bool) -> Array:
    """Values at the declared times."""
    if not len(at):
        raise SimulationError(f"{name} has no rows")
    allowed = _AGREE * float(np.abs(times).max())
    if len(at) == len(times) and (np.abs(at - times) <= allowed).all():
        return values
    has = f"{name} has {len(at)} times from {at[0]:g} to {at[-1]:g} s"
    declared = f"{len(times)} times from {times[0]:g} to {times[-1]:g} s are declared"
    if not interpolate:
        raise SimulationError(f"{has}, but {declared}; declare those of the file, or give interpolate=True")
    if not np.isfinite(at).all() or (np.diff(at) < 0).any():
        raise SimulationError(f"{name}: its times do not increase, so that nothing can be interpolated")
    if at[0] > times[0] + allowed or at[-1] < times[-1] - allowed:
        raise SimulationError(f"{has}, but {declared}: nothing is known beyond those of the file")
    return _interpolated(name, at, values, times, allowed)


def _interpolated(name: str, at: Array, values: Array, times: Array, allowed: float) -> Array:
    """Values between those of a file. Of several rows at one time, as at an event, the last one counts from there."""
    events = at[1:][np.diff(at) == 0]
    if len(events):  # declared times at an event have as many digits as those of the file
        nearest = events[np.abs(events[:, None] - times).argmin(axis=0)]
        times = np.where(np.abs(nearest - times) <= allowed, nearest, times)
    times = np.clip(times, at[0], at[-1])
    before = np.searchsorted(at, times, side="right") - 1
    after = np.where(times > at[before], before + 1, before)
    needed = slice(before[0], after[-1] + 1)
    bad = ~np.isfinite(values[needed]).all(axis=1)
    if bad.any():
        raise SimulationError(f"{name}: a value at {at[needed][bad][0]:g} s is not finite")
    span = np.where(after > before, at[after] - at[before], 1.0)
    weight = ((times - at[before]) / span)[:, None]
    return (1 - weight) * values[before] + weight * values[after]


def _csv(path: Path) -> Mapping[str, Any]:
    with path.open(newline="", encoding="utf-8-sig") as file:
        header = file.readline()
        mark = max(",;\t", key=header.count)
        names = [name.strip().strip('"') for name in header.rstrip("\r\n").split(mark)]
        rows = [row for row in csv.reader(file, delimiter=mark) if row]
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise SimulationError(f"two columns {twice[0]!r}")
    short = next((k for k, row in enumerate(rows) if len(row) < len(names)), None)
    if short is not None:
        raise SimulationError(f"line {short + 2} has {len(rows[short])} values for {len(names)} columns")
    long = next((k for k, row in enumerate(rows) if any(cell.strip() for cell in row[len(names) :])), None)
    if long is not None:
        raise SimulationError(
            f"line {long + 2} has {len(rows[long])} values for {len(names)} columns; decimal commas may be the reason"
        )
    return {name: [row[i] for row in rows] for i, name in enumerate(names)}


def _json(path: Path) -> Mapping[str, Any]:
    columns = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(columns, dict):
        raise SimulationError("it must hold an object with a list for each output")
    return columns


def _npz(path: Path) -> Mapping[str, Any]:
    arrays = np.load(path, allow_pickle=False)
    if not isinstance(arrays, np.lib.npyio.NpzFile):
        raise SimulationError("it must hold arrays with names")
    with arrays:
        require_usual_size(arrays.zip)
        return dict(arrays)


READERS: dict[str, Callable[[Path], Mapping[str, Any]]] = {".csv": _csv, ".json": _json, ".npz": _npz}
"""Readers by suffix."""
