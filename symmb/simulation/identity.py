"""What a simulator computes, as a digest: equal ones give equal runs, as far as symmb can see."""

import functools
import hashlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np


def digest(*things: Any) -> str:
    """A digest of numbers, texts, arrays, expressions, functions, and of what is made of them.

    A Python function counts by its source and by the values that it has caught. What it calls is not looked at.
    """
    state = hashlib.sha256()
    for thing in things:
        _feed(state.update, thing)
    return state.hexdigest()


def file_digest(path: Path) -> str:
    """A digest of a file, or of all files in a folder with their names."""
    state = hashlib.sha256()
    for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if file.is_file():
            state.update(f"{file.relative_to(path)}\0".encode())
            with file.open("rb") as content:
                state.update(hashlib.file_digest(content, "sha256").digest())
    return state.hexdigest()


def _feed(update: Callable[[bytes], None], thing: Any) -> None:
    update(f"<{type(thing).__name__}>".encode())
    if thing is None or isinstance(thing, bool | int | float | str | bytes | np.generic):
        update(repr(thing).encode())
    elif isinstance(thing, np.ndarray):
        update(f"{thing.dtype} {thing.shape}".encode() + np.ascontiguousarray(thing).tobytes())
    elif isinstance(thing, ca.Function):
        update(thing.serialize().encode())
    elif is_dataclass(thing) and not isinstance(thing, type):
        for field in fields(thing):
            _feed(update, field.name)
            _feed(update, getattr(thing, field.name))
    elif isinstance(thing, Mapping):
        for key in thing:
            _feed(update, key)
            _feed(update, thing[key])
    elif isinstance(thing, list | tuple):
        for part in thing:
            _feed(update, part)
    elif isinstance(thing, functools.partial):
        _feed(update, (thing.func, thing.args, thing.keywords))
    elif inspect.isroutine(thing):
        _feed_function(update, thing)
    elif callable(thing) and hasattr(thing, "__dict__"):  # an object that can be called
        _feed(update, type(thing).__qualname__)
        _feed(update, dict(vars(thing)))


def _feed_function(update: Callable[[bytes], None], f: Any) -> None:
    f = inspect.unwrap(f)
    update(f"{getattr(f, '__module__', '')}.{getattr(f, '__qualname__', '')}".encode())
    if owner := getattr(f, "__self__", None):
        _feed(update, owner)
    try:
        update(inspect.getsource(f).encode())
    except (OSError, TypeError):
        code = getattr(f, "__code__", None)
        update(b"" if code is None else code.co_code + repr(code.co_consts).encode())
    for value in getattr(f, "__defaults__", None) or ():
        _feed(update, value)
    for cell in getattr(f, "__closure__", None) or ():
        try:
            _feed(update, cell.cell_contents)
        except ValueError:  # a name that has no value yet
            continue
