"""Records in NumPy archives and in JSON, and tables.

A record is a mapping of names to texts, numbers, arrays, records and lists of records. Archives and JSON store the same
entries. In JSON, ``t`` has the name ``times``, ``names`` has the name ``outputs``, and None stands for numbers that are
not finite. An archive has one array for each array of the record, and an array ``about`` with the rest as JSON.
"""

import csv
import io
import json
import math
import zipfile
from collections.abc import Callable, Container, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TypeVar

import numpy as np

from symmb._errors import DeclarationError
from symmb.results.files.record import Record
from symmb.results.files.replacement import replacement, require_suffix, told

_IN_JSON = {"t": "times", "names": "outputs"}
_IN_ARCHIVES = {name: own for own, name in _IN_JSON.items()}

_VERSION = 1
"""Version of both formats. A file without a version number also has this version."""

Table = Mapping[str, Any]
"""Columns by their headings. All columns have the same length."""
T = TypeVar("T")


def save(path: str | PathLike[str], sources: Mapping[str, Callable[[], Mapping[str, Any]]]) -> None:
    """Write a result in the format that the suffix of the file selects.

    `sources` are functions that give the "record", the "entries" of JSON and, if it exists, the "table".
    DeclarationError is raised if the suffix is not known, and FileError if the file cannot be written.
    """
    form = _format_of(path, sources)
    contents = sources[form.source]()
    with replacement(path) as file:
        form.write(file, contents)


def save_json(path: str | PathLike[str], entries: Mapping[str, Any]) -> None:
    """Write the entries that `in_json` returns."""
    with replacement(path) as file:
        _write_json(file, entries)


def to_jsonable(value: Any) -> Any:
    """Nested mappings, sequences, arrays and numbers, converted to the types of JSON.

    Examples
    --------
    >>> to_jsonable({"lower": np.array([[0.5, -np.inf]]), "failed": np.int64(2)})
    {'lower': [[0.5, None]], 'failed': 2}
    """
    if isinstance(value, Mapping):
        return {str(key): to_jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return to_jsonable(np.asarray(value).tolist())
    if isinstance(value, list | tuple):
        return [to_jsonable(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def in_json(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record as lists, texts and numbers. Numbers that are not finite are None."""
    return to_jsonable({"version": _VERSION} | {_IN_JSON.get(name, name): value for name, value in record.items()})


def load(
    path: str | PathLike[str], what: str, build: Callable[[Record], T], from_table: Callable[[Record], T] | None = None
) -> T:
    """A result read from a file: built from the record, or from the ``headings`` and ``columns`` of the table.

    DeclarationError is raised if the suffix is not known, or if the file is damaged or contains something else.
    FileError is raised if the file cannot be read.
    """
    form = _format_of(path, ("record", "entries", *(["table"] if from_table else [])))
    with told(path, "read"):
        data = Path(path).read_bytes()
    try:
        record = form.read(data)
        if form.source == "table" and from_table:
            return from_table(record)
        version = record.whole("version", _VERSION)
        if version != _VERSION:
            raise DeclarationError(f"the file has format version {version}, but this symmb reads version {_VERSION}.")
        if "result" in record and (content := f"a result of {record.text('result')}.save") != what:
            raise DeclarationError(f"the file holds {content}.")
        return build(Record({k: value for k, value in record.plain.items() if k not in ("version", "result")}))
    except Exception as error:  # damaged files can raise nearly every exception in zlib, zipfile, json and NumPy
        is_known = isinstance(error, DeclarationError)
        why = str(error) if is_known else f"the contents cannot be read ({_first_line(error)})."
        raise DeclarationError(f"{path} does not hold {what}: {why}") from error


def _format_of(path: str | PathLike[str], sources: Container[str]) -> "Format":
    return FORMATS[require_suffix(path, *[suffix for suffix, form in FORMATS.items() if form.source in sources])]


def _first_line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]


def _without_arrays(value: Any, place: str, arrays: dict[str, Any]) -> Any:
    """The value in the types of JSON. Its arrays are moved to ``arrays``; their keys are paths."""
    if isinstance(value, Mapping):
        parts = {name: _without_arrays(part, f"{place}/{name}", arrays) for name, part in value.items()}
        return {name: part for name, part in parts.items() if not isinstance(value[name], np.ndarray)}
    if isinstance(value, list | tuple):
        return [_without_arrays(part, f"{place}/{k}", arrays) for k, part in enumerate(value)]
    if isinstance(value, np.ndarray):
        arrays[place[1:]] = value
        return None
    return to_jsonable(value)


def _write_archive(file: BinaryIO, record: Mapping[str, Any]) -> None:
    arrays: dict[str, Any] = {}
    about = json.dumps(_without_arrays({"version": _VERSION, **record}, "", arrays))
    np.savez(file, about=np.array(about), **arrays)


def _of_archive(data: bytes) -> Record:
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        require_usual_size(archive.zip)
        arrays = {name: array if array.ndim else array.item() for name, array in archive.items()}
    entries = json.loads(arrays.pop("about", "{}"))
    for place, array in arrays.items():
        *parents, name = place.split("/")
        holder = entries
        for parent in parents:
            holder = holder[int(parent)] if isinstance(holder, list) else holder[parent]
        holder[name] = array
    return Record.of(entries, "")


def require_usual_size(archive: zipfile.ZipFile | None) -> None:
    """DeclarationError if the data of an archive would be much larger than the archive."""
    members = archive.infolist() if archive else []
    size, packed = (sum(getattr(member, name) for member in members) for name in ("file_size", "compress_size"))
    # The data may be at most 200 times as large as the archive. Results with random last digits expand by a factor of
    # a few, and constant results by a factor of a thousand.
    if size > 2**26 and size > 200 * packed:  # up to 64 MB can be unpacked quickly
        raise DeclarationError(f"the file has {packed:.3g} bytes, but {size:.3g} bytes after unpacking.")


def _write_json(file: BinaryIO, entries: Mapping[str, Any]) -> None:
    file.write(f"{json.dumps(entries, allow_nan=False)}\n".encode())


def _of_json(data: bytes) -> Record:
    entries = Record.of(json.loads(data), "")
    return Record({_IN_ARCHIVES.get(name, name): value for name, value in entries.plain.items()})


def _write_table(file: BinaryIO, columns: Table) -> None:
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(columns)
    writer.writerows(zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True))
    file.write(text.getvalue().encode())


def _of_table(data: bytes) -> Record:
    text = data.decode("utf-8")
    if not text.endswith(("\r", "\n")):
        raise DeclarationError("the last line is incomplete: a part of the file is missing.")
    headings, *rows = csv.reader(io.StringIO(text, newline=""), strict=True)
    for number, cells in enumerate(rows, 2):
        if len(cells) != len(headings):
            raise DeclarationError(f"line {number} has {len(cells)} of {len(headings)} columns.")
    if not headings or not rows:
        raise DeclarationError("the file has no headings, or no line below the headings.")
    columns = [_column(column) for column in zip(*rows, strict=True)]
    return Record({"headings": headings, "columns": {str(k): column for k, column in enumerate(columns)}})


def _column(cells: tuple[str, ...]) -> list[float] | list[str]:
    try:
        return [float(cell) for cell in cells]
    except ValueError:
        return list(cells)


class Format(NamedTuple):
    """Functions that write and read files with a suffix.

    Attributes
    ----------
    source : str        the stored form of the result: its "record", its "entries" of JSON or its "table"
    write : callable    takes an open file and the stored form
    read : callable     takes the bytes of a file, and returns what `write` has stored
    """

    source: str
    write: Callable[[BinaryIO, Mapping[str, Any]], None]
    read: Callable[[bytes], Record]


FORMATS = {
    ".npz": Format("record", _write_archive, _of_archive),
    ".json": Format("entries", _write_json, _of_json),
    ".csv": Format("table", _write_table, _of_table),
}
"""All formats of results."""
