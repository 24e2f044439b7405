"""Results that can be saved as files. Fields of a result declare the check, the axes and the name of each entry."""

from collections.abc import Callable, Mapping
from dataclasses import Field, fields
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Self, get_args

from symmb._interrupts import keep_interrupts
from symmb._units import units_of_parameters
from symmb.results import files
from symmb.results.files.record import Record

_CHECKS: dict[Any, Callable[..., Any]] = {
    str: Record.text,
    int: Record.whole,
    float: Record.number,
    tuple[str, ...]: Record.texts,
    dict[str, float]: Record.numbers,
    Mapping[str, float]: Record.numbers,
}
"""Functions that read fields of these types, if the field does not declare a check."""


def entry(check: Callable[..., Any] | None = None, *axes: str | None, name: str = "") -> dict[str, Any]:
    """Metadata of a field that files store.

    Parameters
    ----------
    check          method of Record that reads the entry; default: the method for the type of the field
    axes           for each axis of an array, the name of an entry with the same length, in this record or in the record
                   that contains it; None for any length
    name           name of the entry, if it differs from the name of the field
    """
    return {"check": check, "axes": axes, "name": name}


NOT_KEPT: Mapping[str, Any] = {"kept": False}
"""Metadata of a field that files do not store, or that the class stores in other entries."""
TIMES, NAMES = entry(Record.times), entry(Record.names)
_EMPTY = (None, "", (), {})
"""A field with one of these defaults may have no entry, for example in files of earlier versions."""


def entries(result: Any) -> dict[str, Any]:
    """The fields of a result, by the names of their entries."""
    values = {_name(own): getattr(result, own.name) for own in _kept(type(result))}
    units = {f"{name}_units": units_of_parameters(value) for name, value in values.items()}
    return values | {name: some for name, some in units.items() if some}


def attributes(kind: Any, record: Record) -> dict[str, Any]:
    """The fields of a dataclass from a record. Fields that define lengths of arrays are read first."""
    return {own.name: _value(own, record) for own in sorted(_kept(kind), key=lambda own: bool(_axes(own)))}


def _kept(kind: Any) -> list[Field[Any]]:
    return [own for own in fields(kind) if own.metadata.get("kept", True)]


def _name(own: Field[Any]) -> str:
    return own.metadata.get("name") or own.name


def _axes(own: Field[Any]) -> tuple[str | None, ...]:
    return own.metadata.get("axes", ())


def _value(own: Field[Any], record: Record) -> Any:
    name, kinds = _name(own), get_args(own.type) if isinstance(own.type, UnionType) else (own.type,)
    default = None if NoneType in kinds else {} if own.default_factory is dict else own.default
    if default in _EMPTY and name not in record:
        return default
    check = own.metadata.get("check") or _CHECKS[kinds[0]]
    return check(record, name, *(axis and record.length(axis) for axis in _axes(own)))


class Saved:
    """A dataclass that converts its fields to a record and back, and possibly to a table."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        keep_interrupts(cls)

    def _record(self) -> dict[str, Any]:
        return entries(self)

    @classmethod
    def _of_record(cls, record: Record) -> Self:
        return cls(**attributes(cls, record))

    def _table(self) -> "files.Table":
        raise NotImplementedError

    @classmethod
    def _of_table(cls, table: Record) -> Self:
        raise NotImplementedError

    def to_json(self) -> dict[str, Any]:
        """The result as lists, texts and numbers. Numbers that are not finite are None."""
        return files.in_json(self._named_record())

    def _named_record(self) -> dict[str, Any]:
        return {"result": type(self).__name__} | self._record()

    def save(self, path: str | Path) -> None:
        """Write the complete result as .npz or .json. Runs and bounds can also be written as a .csv table over time.

        Raises
        ------
        DeclarationError
            If the name has another suffix
        FileError
            If the file cannot be written. A previous file is kept
        """
        sources = {"record": self._named_record, "entries": lambda: files.in_json(self._named_record())}
        files.save(path, sources | ({"table": self._table} if _has_table(type(self)) else {}))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file that `save` has written. A .csv table contains only times and outputs.

        Raises
        ------
        DeclarationError
            If the file is damaged, or contains something else
        FileError
            If the file cannot be read
        """
        what, from_table = f"a result of {cls.__name__}.save", cls._of_table if _has_table(cls) else None
        return files.load(path, what, cls._of_record, from_table)


def _has_table(kind: type[Saved]) -> bool:
    return kind._table is not Saved._table
