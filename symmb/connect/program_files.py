"""Files of programs: input files from templates, which have names of parameters in braces, and tables of results."""

import csv
import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from symmb._errors import DeclarationError, SimulationError
from symmb._magnitudes import SLIGHT
from symmb._options import shown
from symmb._types import Array
from symmb.results.files import require_usual_size

_TIME = "time"


def filled(template: str, values: Mapping[str, float]) -> str:
    """The template with values in the place of `{name}` and `{name:format}`. Other braces are kept.

    Without a format, all digits of a number are written.

    Examples
    --------
    >>> filled("k = {k}; c = {c:.1f}; /* {comment} */", {"k": 0.1, "c": 2})
    'k = 0.1; c = 2.0; /* {comment} */'
    """

    def text(match: re.Match[str]) -> str:
        name, form = match.groups()
        return repr(float(values[name])) if form is None else format(float(values[name]), form)

    return re.sub(rf"\{{({_names(values)})(?::([^{{}}]*))?\}}", text, template)


def template_faults(template: str, values: Mapping[str, float]) -> Iterator[str]:
    """Faults of the formats in a template."""
    for name, form in re.findall(rf"\{{({_names(values)}):([^{{}}]*)\}}", template):
        try:
            format(float(values[name]), form)
        except (ValueError, MemoryError) as error:
            yield f"{{{name}:{form}}} is not a valid number format ({error}). Write, for example, {{{name}:.6e}}"


def is_filled(template: str, name: str) -> bool:
    """Whether a parameter occurs in a template."""
    return re.search(rf"\{{{re.escape(name)}(:[^{{}}]*)?\}}", template) is not None


def template_texts(owner: str, templates: Mapping[str, str | Path]) -> dict[str, str]:
    """Path of a file in the folder of a run -> text of the file. If a template is a Path, its text is read now.

    DeclarationError is raised if a path leads out of the folder, or a file cannot be read.
    """
    if not isinstance(templates, Mapping):
        raise DeclarationError(f"{owner}: templates must map names of files to texts or paths, got {shown(templates)}.")
    texts = {}
    for name, template in templates.items():
        if not isinstance(name, str) or not is_inside(name):
            raise DeclarationError(f"{owner}: template {name!r}: the file must be inside the folder of the run.")
        if isinstance(template, Path):
            try:
                template = template.read_bytes().decode()  # keeps the line ends
            except (OSError, UnicodeDecodeError) as error:
                raise DeclarationError(f"{owner}: template {name!r}: {template} cannot be read: {error}.") from None
        if not isinstance(template, str) or not is_text(template):
            raise DeclarationError(f"{owner}: template {name!r}: expected a text or a Path, got {shown(template)}.")
        texts[name] = template
    return texts


def is_inside(name: str) -> bool:
    """Whether a path is relative, and leads to a file inside the folder."""
    place = PurePosixPath(name)
    parts = [part.encode(errors="replace") for part in place.parts]
    is_valid = 0 < max(map(len, parts), default=0) <= 255 and is_text(name)  # file systems allow names of 255 bytes
    return is_valid and not place.is_absolute() and ".." not in place.parts


def is_text(text: str) -> bool:
    """Whether a text can be written into a file and passed to the system."""
    return "\0" not in text and text.encode(errors="ignore").decode() == text


def _names(values: Mapping[str, float]) -> str:
    return "|".join(map(re.escape, sorted(values, key=len, reverse=True)))


def read_table(path: Path, times: Array, outputs: tuple[str, ...], interpolate: bool) -> Array:
    """Outputs (n_t, n_y) at `times` from a file with a column `time` and a column for each output.

    Other columns are ignored. If there is only one time, the column `time` may be left out. SimulationError is raised
    if the file cannot be read, lacks a column, or has other times.
    """
    if not path.is_file():
        raise SimulationError(f"the program wrote no file {path.name!r}")
    if not path.stat().st_size:
        raise SimulationError(f"{path.name} is empty")
    try:
        columns = READERS[path.suffix](path)
        lost = [name for name in outputs if name not in columns]
        if lost:
            raise SimulationError(f"it has no column {lost[0]!r}, only {', '.join(map(repr, columns))[:200]}")
        values = np.column_stack([_numbers(columns, name) for name in outputs])
        if _TIME not in columns and len(times) == len(values) == 1:
            return values
        if _TIME not in columns:
            raise SimulationError(f"it has no column {_TIME!r}")
        at = _numbers(columns, _TIME)
    except SimulationError as error:
        raise SimulationError(f"{path.name}: {error}") from None
    except Exception as error:  # a file of another program may have any error
        raise SimulationError(f"{path.name} cannot be read: {' '.join(str(error).split())[:200]}") from None
    if len(at) != len(values):
        raise SimulationError(f"{path.name} has {len(at)} times, but {len(values)} values of each output")
    return _at_times(path.name, at, values, times, interpolate)


def _numbers(columns: Mapping[str, Any], name: str) -> Array:
    """A column as numbers (n,). A single number becomes a column of one number."""
    column = columns[name]
    if isinstance(column, list) and (odd := [x for x in column if isinstance(x, str) and "_" in x]):
        raise SimulationError(f"{name!r}: {odd[0][:40]!r} is not a number")  # Python accepts these as numbers
    values = np.atleast_1d(column if isinstance(column, np.ndarray) else np.array(column, dtype=float))
    if values.ndim != 1 or np.iscomplexobj(values):
        raise SimulationError(
            f"{name!r} must be a list of real numbers, got the shape {values.shape} of {values.dtype}"
        )
    return values.astype(float)


def _at_times(name: str, at: Array, values: Array, times: Array, interpolate: bool) -> Array:
    """The values of the outputs at the declared times, from their values at the times `at` of a file."""
    if not len(at):
        raise SimulationError(f"{name} has no rows")
    allowed = SLIGHT * float(np.abs(times).max())  # programs write about six digits
    if len(at) == len(times) and (np.abs(at - times) <= allowed).all():
        return values
    has = f"{name} has {len(at)} times from {at[0]:g} to {at[-1]:g} s"
    declared = f"{len(times)} times from {times[0]:g} to {times[-1]:g} s are declared"
    if not interpolate:
        raise SimulationError(f"{has}, but {declared}; declare the times of the file, or give interpolate=True")
    if not np.isfinite(at).all() or (np.diff(at) < 0).any():
        raise SimulationError(f"{name}: its times do not increase, so interpolation is not possible")
    if at[0] > times[0] + allowed or at[-1] < times[-1] - allowed:
        raise SimulationError(f"{has}, but {declared}: interpolation is only possible between times of the file")
    return _interpolated(name, at, values, times, allowed)


def _interpolated(name: str, at: Array, values: Array, times: Array, allowed: float) -> Array:
    """Values interpolated between times of a file. If two rows have one time, the second is valid from this time on."""
    events = at[1:][np.diff(at) == 0]
    if len(events):  # declared times at an event have as many digits as times of the file
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
        raise SimulationError(f"it has two columns {twice[0]!r}")
    for k, row in enumerate(rows):
        if len(row) < len(names):
            raise SimulationError(f"line {k + 2} has {len(row)} values for {len(names)} columns")
    for k, row in enumerate(rows):
        if any(cell.strip() for cell in row[len(names) :]):
            raise SimulationError(
                f"line {k + 2} has {len(row)} values for {len(names)} columns; decimal commas may be the reason"
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
        raise SimulationError("it must hold named arrays")
    with arrays:
        require_usual_size(arrays.zip)
        return dict(arrays)


READERS: dict[str, Callable[[Path], Mapping[str, Any]]] = {".csv": _csv, ".json": _json, ".npz": _npz}
"""Suffix of a file -> the function that reads its columns."""
