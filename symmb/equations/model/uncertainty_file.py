"""Intervals from SSV files and FMUs that contain the uncertainty records of DLR's Credibility library.

Neither SSP nor FMI has a type for intervals. The library (github.com/DLR-SR/Credibility; Otter et al., Electronics
2022, 11(17), 2728) declares them as parameters: `lower` and `upper`, or `nominal` with `relTol` and `absTol`, where the
half width is max(absTol, relTol |nominal|).
"""

import re
import tempfile
import zipfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from symmb._errors import DeclarationError
from symmb.declare.mechanics.robots import Tag, read_document

_RECORD = ".uncertainty."
_FIELDS = "nominal", "lower", "upper", "relTol", "absTol"


def records_in_file(path: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """The name of each uncertain parameter, and the fields of its record as texts with units."""
    values = dict(_values(path))
    records: dict[str, dict[str, str]] = defaultdict(dict)
    for full, text in values.items():
        owner, mark, field = full.rpartition(_RECORD)
        if mark and field in _FIELDS:
            records[owner][field] = text
    for full, record in records.items():
        if any(other.startswith((f"{full}.table", f"{full}{_RECORD}table")) for other in values):
            continue  # a table, which is not a number
        if f"{full}.value" in values:
            record.setdefault("nominal", values[f"{full}.value"])
        yield full.rpartition(".")[2], record


def _values(path: Path) -> Iterator[tuple[str, str]]:
    for parent in _root(path).inside:
        for variable in parent.inside if parent.name in ("Parameters", "ModelVariables") else ():
            for tag in (variable, *variable.inside):
                given = tag.attributes.get("value", tag.attributes.get("start"))
                if given is not None and tag.name in ("Real", "Float64"):
                    unit = re.sub(r"(?<=[A-Za-z])(-?\d)", r"^\1", tag.attributes.get("unit", ""))  # kg.m2 is kg.m^2
                    yield variable.attributes.get("name", ""), f"{given} {unit}".strip()


def _root(path: Path) -> Tag:
    if path.suffix.lower() == ".ssv":
        return read_document(path, None)
    try:
        with zipfile.ZipFile(path) as archive, tempfile.TemporaryDirectory() as folder:
            return read_document(Path(archive.extract("modelDescription.xml", folder)), None)
    except (zipfile.BadZipFile, KeyError):
        raise DeclarationError(f"{path}: this is not an FMU.") from None
