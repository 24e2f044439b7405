"""The contents of a file, which are checked when they are read."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._names import ByName
from symmb._types import Array, Mask


class Record:
    """Named texts, numbers, arrays and records that were read from a file.

    Every method raises DeclarationError if the entry is missing, of another type or of another shape.
    """

    def __init__(self, entries: Mapping[str, Any], where: str = "", holder: "Record | None" = None) -> None:
        self._entries = entries
        self._where = where
        self._holder = holder

    @classmethod
    def of(cls, value: Any, where: str, holder: "Record | None" = None) -> "Record":
        """The record of a mapping from names to values. `holder` is the record that contains this record, if any."""
        if not isinstance(value, Mapping):
            raise DeclarationError(f"{where or 'the file'} holds {_kind(value)}, not names with values.")
        return cls(value, where, holder)

    def __contains__(self, name: str) -> bool:
        """Whether the entry exists. In files of earlier versions, an array of the shape (0, 0) stands for None."""
        value = self._entries.get(name)
        return value is not None and getattr(value, "shape", None) != (0, 0)

    def text(self, name: str, *allowed: str) -> str:
        """A text. If `allowed` texts are given, the text must be one of these."""
        value = self._value(name)
        if not isinstance(value, str):
            raise self._wrong(name, "a text", _kind(value))
        if allowed and value not in allowed:
            raise self._wrong(name, " or ".join(map(repr, allowed)), repr(value[:80]))
        return value

    def number(self, name: str) -> float:
        """A real number; nan if JSON has None, because the number was not finite."""
        value = self._entries.get(name)
        if value is None and name in self._entries:
            return math.nan
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._wrong(name, "a number", _kind(value))
        return float(value)

    def whole(self, name: str, default: int | None = None) -> int:
        """An integer of at least 0."""
        value = self._value(name, default)
        if isinstance(value, bool) or not isinstance(value, int) or value < 0:
            raise self._wrong(name, "an integer of at least 0", repr(value)[:80])
        return value

    def texts(self, name: str, default: tuple[str, ...] | None = None) -> tuple[str, ...]:
        """A sequence of texts."""
        value = self._value(name, default)
        value = value.tolist() if isinstance(value, np.ndarray) else value
        if not isinstance(value, list | tuple) or not all(isinstance(text, str) for text in value):
            raise self._wrong(name, "a list of texts", _kind(value))
        return tuple(value)

    def names(self, name: str) -> tuple[str, ...]:
        """A sequence of different texts."""
        value = self.texts(name)
        if len(set(value)) < len(value):
            raise self._wrong(name, "a list of different names", repr(value)[:80])
        return value

    def with_nan(self, name: str, *shape: int | None) -> Array:
        """An array of real numbers; nan means unknown. In `shape`, None stands for any length of an axis."""
        entry = self._value(name)
        try:
            value = np.array(entry, dtype=float)
        except (TypeError, ValueError):
            raise self._wrong(name, "an array of real numbers", "other contents") from None
        if not value.size and len(shape) > 1 and 0 in shape:  # JSON does not store the lengths of empty arrays
            value = value.reshape([length or 0 for length in shape])
        fits = len(value.shape) == len(shape) and all(n in (None, m) for n, m in zip(shape, value.shape, strict=True))
        if not fits:
            expected = ", ".join("any" if n is None else str(n) for n in shape)
            raise self._wrong(name, f"an array of the shape ({expected})", f"the shape {value.shape}")
        return value

    def array(self, name: str, *shape: int | None) -> Array:
        """An array of finite numbers."""
        value = self.with_nan(name, *shape)
        if not np.isfinite(value).all():
            raise self._wrong(name, "an array of finite numbers", "other numbers")
        return value

    def arrays(self, name: str, *shape: int | None) -> dict[str, Array]:
        """Arrays of the same shape by name, with their units, if any."""
        record = self.record(name)
        return ByName({key: record.array(key, *shape) for key in record.plain}, self.units(name))

    def mask(self, name: str) -> Mask:
        """Truth values (n,), one for each run or time."""
        return self.array(name, None).astype(bool)

    def size(self, name: str, *shape: int | None) -> Array:
        """An array of nonnegative numbers. Infinite numbers are nan in JSON."""
        value = self.with_nan(name, *shape)
        if isinstance(self._value(name), list):
            value = np.where(np.isnan(value), np.inf, value)
        if not (value >= 0).all():
            raise self._wrong(name, "an array of numbers of at least 0", "other numbers")
        return value

    def covariance(self, name: str, n: int) -> Array:
        """A symmetric matrix (n, n) with variances of at least 0. Infinite variances are nan in JSON."""
        value = self.with_nan(name, n, n)
        variances = np.where(np.isnan(np.diag(value)), np.inf, np.diag(value))
        if not (np.allclose(value, value.T, equal_nan=True) and (variances >= 0).all()):
            raise self._wrong(name, "a symmetric matrix with variances of at least 0", "another matrix")
        np.fill_diagonal(value, variances)
        return value

    def times(self, name: str = "t") -> Array:
        """Times (n_t,) in increasing order; at least one."""
        t = self.array(name, None)
        if not t.size or (np.diff(t) <= 0).any():
            raise self._wrong(name, "times that increase", "other times")
        return t

    def pair(self, name: str, *shape: int | None) -> tuple[Array, Array]:
        """Lower and upper bounds, found by the name of the lower bounds. Infinite bounds are nan in JSON."""
        bounds, names = [], (name, name.replace("lower", "upper"))
        for own, infinite in zip(names, (-np.inf, np.inf), strict=True):
            value = self.with_nan(own, *shape)
            bounds.append(np.where(np.isnan(value), infinite, value) if isinstance(self._value(own), list) else value)
        if not (bounds[0] <= bounds[1]).all():
            raise self._wrong(names[1], f"at least {name}", "smaller values")
        return bounds[0], bounds[1]

    def lower(self, name: str, *shape: int | None) -> Array:
        """The lower bounds of a pair."""
        return self.pair(name, *shape)[0]

    def upper(self, name: str, *shape: int | None) -> Array:
        """The upper bounds of a pair."""
        return self.pair(name.replace("upper", "lower"), *shape)[1]

    def length(self, name: str) -> int:
        """The number of values of an entry in this record, or in the record that holds this record."""
        if name not in self._entries and self._holder is not None:
            return self._holder.length(name)
        return len(self._value(name))

    def record(self, name: str) -> "Record":
        """A record in this record."""
        return self.of(self._value(name), self._named(name), self)

    def records(self, name: str, *fields: str) -> list["Record"]:
        """A list of records; empty if the entry is missing. An item may also be a list of the values of `fields`."""
        value = self._entries.get(name)
        if not isinstance(value, list | tuple | None):
            raise self._wrong(name, "a list", _kind(value))
        items = [
            dict(zip(fields, item, strict=True)) if fields and isinstance(item, list) else item for item in value or ()
        ]
        return [self.of(item, f"{self._named(name)}/{k}", self) for k, item in enumerate(items)]

    @property
    def plain(self) -> Mapping[str, Any]:
        """All entries as they are in the file."""
        return self._entries

    def numbers(self, name: str) -> dict[str, float]:
        """Numbers by name, with their units, if any."""
        record = self.record(name)
        return ByName({key: record.number(key) for key in record.plain}, self.units(name))

    def units(self, name: str) -> dict[str, str]:
        """Units of numbers by name, if any."""
        units = self.record(f"{name}_units") if f"{name}_units" in self else Record({})
        return {key: units.text(key) for key in units.plain}

    def _value(self, name: str, default: Any = None) -> Any:
        value = self._entries.get(name)
        if value is None:
            value = default
        if value is None:
            raise DeclarationError(f"{self._named(name)} is missing.")
        return value

    def _named(self, name: str) -> str:
        return f"{self._where}/{name}" if self._where else name

    def _wrong(self, name: str, expected: str, got: str) -> DeclarationError:
        return DeclarationError(f"{self._named(name)} must be {expected}, got {got}.")


def _kind(value: object) -> str:
    return "nothing" if value is None else f"a {type(value).__name__}"
