"""Pickles of objects with expressions of CasADi. Symbols keep their identity, and the time stays `t`."""

import io
import pickle
from collections.abc import Callable
from contextvars import ContextVar
from typing import Any

import casadi as ca

from symmb.declare.symbolic.symbols import Symbol, is_time, lookup, t

_is_inside: ContextVar[bool] = ContextVar("_is_inside", default=False)


def reduction(build: Callable[..., Any], *parts: Any) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """The return value of `__reduce__` for an object that `build` makes from parts with expressions.

    Nested objects are written into one pickle, so they share their symbols.
    """
    if _is_inside.get():
        return build, parts
    token = _is_inside.set(True)
    try:
        first = _Pickler(io.BytesIO())
        first.dump(parts)  # finds the symbols, whose records must be first in the pickle
        buffer = io.BytesIO()
        pickler = _Pickler(buffer)
        pickler.dump(first.records())
        pickler.dump((build, parts))
    finally:
        _is_inside.reset(token)
    return _built, (buffer.getvalue(),)


def _built(data: bytes) -> Any:
    unpickler = pickle.Unpickler(io.BytesIO(data))
    records, (build, parts) = unpickler.load(), unpickler.load()
    result = build(*parts)
    vars(result)["_records"] = records  # the table of symbols has only weak references
    return result


class _Pickler(pickle.Pickler):
    """A pickler that writes an expression as a Function of its symbols."""

    def __init__(self, buffer: io.BytesIO) -> None:
        super().__init__(buffer)
        self._references: dict[int, _Reference] = {}

    def records(self) -> list[Symbol]:
        """The records of all symbols that were written so far."""
        records = (lookup(reference.symbol) for reference in self._references.values())
        return [record for record in records if record is not None]

    def reducer_override(self, obj: Any) -> Any:
        if type(obj) is ca.SX:
            symbols = ca.symvar(obj)
            references = [self._references.setdefault(s.element_hash(), _Reference(s)) for s in symbols]
            return _expression, (ca.Function("expression", symbols, [obj]).serialize(), references)
        return NotImplemented


class _Reference:
    """A reference to a symbol. The symbol itself is written only once in a pickle."""

    def __init__(self, symbol: ca.SX) -> None:
        self.symbol = symbol

    def __reduce__(self) -> Any:
        return (_time, ()) if is_time(self.symbol) else (ca.SX.sym, (self.symbol.name(),))


def _time() -> ca.SX:
    return t


def _expression(function: str, symbols: list[ca.SX]) -> ca.SX:
    return ca.SX(ca.Function.deserialize(function).call(symbols)[0])  # CasADi returns a DM if there are no symbols
