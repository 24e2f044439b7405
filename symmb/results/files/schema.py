"""Results whose fields declare how files store them: the check, the axes, and the name of the entry."""

from collections.abc import Callable, Mapping
from dataclasses import Field, fields
from types import NoneType, UnionType
from typing import Any, get_args

from symmb._units import units_of_parameters
from symmb.results.files.record import Record

_CHECKS: dict[Any, Callable[..., Any]] = {
    str: Record.text,
    int: Record.whole,
    float: Record.number,
    tuple[str, ...]: Record.texts,
    dict[str, float]: Record.numbers,
    Mapping[str, float]: Record.numbers,
}
"""How fields of these types are read if the field does not declare a check."""


def entry(check: Callable[..., Any] | None = None, *axes: str | None, name: str = "") -> dict[str, Any]:
    """Metadata of a field that files store.

    Parameters
    ----------
    check          method of Record that reads the entry; default: the method for the type of the field
    axes           for each axis of an array, the entry (of this record or the record around it) with the same length;
                   None for any length
    name           name of the entry, if it differs from the name of the field
    """
    return {"check": check, "axes": axes, "name": name}


NOT_KEPT: Mapping[str, Any] = {"kept": False}
"""Metadata of a field that files do not store, or that the class stores in other entries."""
TIMES, NAMES = entry(Record.times), entry(Record.names)
_EMPTY = (None, "", (), {})
"""Defaults of fields whose entries may be missing, for example in files of earlier versions."""


def entries(result: Any) -> dict[str, Any]:
    """The fields of a result, by the names of their entries."""
    values = {_name(own): getattr(result, own.name) for own in _kept(type(result))}
    units = {f"{name}_units": units_of_parameters(value) for name, value in values.items()}
    return values | {name: some for name, some in units.items() if some}


def attributes(kind: Any, record: Record) -> dict[str, Any]:
    """The fields of a dataclass from a record. Fields that give the lengths of arrays are read first."""
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
