"""A digest of what a simulator computes. Simulators with equal digests make equal runs, as far as symmb can detect.

`DeclaredFiles` ends a study if a declared file changes during the study.
"""

import builtins
import copyreg
import dis
import functools
import hashlib
import sys
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError, SimulationError

_ATOMS = (type(None), type(...), type(NotImplemented), bool, int, float, complex, str, bytes)
_INSTALLED = {"site-packages", "dist-packages"}
_OURS = __name__.partition(".")[0]


class UndigestedError(DeclarationError):
    """Some objects have no digest. The attribute `key` is the digest of the other objects."""

    def __init__(self, text: str, key: str) -> None:
        super().__init__(text)
        self.key = key


def digest(*things: Any) -> str:
    """A digest of numbers, texts, arrays, expressions and functions, and of objects that contain these.

    A Python function is identified by its code, its defaults, and the values of all outside variables in the code.
    Functions and classes that the code uses are identified in the same way. If a function or a class is part of Python
    or of an installed package, its name identifies it. Other objects are identified by their pickled form.
    UndigestedError is raised if an object cannot be pickled.
    """
    values = _Digests()
    try:
        key = values.of(things).hex()
    except RecursionError:
        raise DeclarationError("StoredSimulator: the function depends on too deeply nested objects.") from None
    if values.lacking:
        raise UndigestedError(
            f"StoredSimulator: the function depends on an object of the type {values.lacking[0]!r}. symmb cannot "
            "detect changes of this object. Pass version=, and give another version whenever the function changes.",
            key,
        )
    return key


def file_digest(path: Path) -> str:
    """A digest of a file, or of all files in a folder with their names."""
    state = hashlib.sha256()
    for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if file.is_file():
            state.update(f"{file.relative_to(path)}\0".encode())
            with file.open("rb") as content:
                state.update(hashlib.file_digest(content, "sha256").digest())
    return state.hexdigest()


class _Digests:
    """Digests of objects by their values."""

    def __init__(self) -> None:
        self.lacking: list[str] = []
        """Types of the objects that have no digest."""
        self._known: dict[int, tuple[Any, bytes]] = {}
        """Objects and their digests. The objects are kept, so that their ids stay valid."""
        self._depth = 0

    def of(self, thing: Any) -> bytes:
        """The digest of an object."""
        if id(thing) in self._known:
            return self._known[id(thing)][1]
        self._known[id(thing)] = thing, f"the one at depth {self._depth}".encode()  # an object may contain itself
        self._depth += 1
        state = hashlib.sha256(f"<{type(thing).__qualname__}>".encode())
        for part in self._parts(thing):
            content = part if isinstance(part, bytes) else self.of(part[0])
            state.update(len(content).to_bytes(8, "big") + content)
        self._depth -= 1
        self._known[id(thing)] = thing, state.digest()
        return state.digest()

    def _parts(self, thing: Any) -> Iterator[bytes | tuple[Any]]:
        """Parts of an object: bytes, or objects in tuples of length one."""
        kind = type(thing)
        if kind in _ATOMS or isinstance(thing, np.generic):
            yield repr(thing).encode(errors="surrogatepass")
        elif kind in _PARTS:
            yield from _PARTS[kind](thing)
        elif kind in (set, frozenset):
            yield from sorted(self.of(part) for part in thing)
        elif kind is np.ndarray and not thing.dtype.hasobject:
            yield f"{thing.dtype} {thing.shape}".encode()
            yield np.ascontiguousarray(thing).tobytes()
        elif isinstance(thing, types.ModuleType | types.FunctionType | type):
            yield from _code_parts(thing)
        elif is_dataclass(thing) and kind.__module__.partition(".")[0] == _OURS:
            yield from _pairs({field.name: getattr(thing, field.name) for field in fields(thing)})
        else:
            yield from self._pickled_parts(thing)

    def _pickled_parts(self, thing: Any) -> Iterator[bytes | tuple[Any]]:
        """The parts of an object that pickle would write."""
        try:
            reduce = copyreg.dispatch_table.get(type(thing))
            reduced = thing.__reduce_ex__(4) if reduce is None else reduce(thing)
        except RecursionError:
            raise
        except Exception:  # the user's code may raise any exception
            self.lacking.append(type(thing).__qualname__)
            return
        if isinstance(reduced, str):  # a name in a module
            yield f"{getattr(thing, '__module__', '')}.{reduced}".encode()
            yield (getattr(thing, "__wrapped__", None),)
            return
        items: list[Any]
        make, arguments, state, *items = (*reduced, None, None, None, None)[:5]
        if isinstance(state, dict):  # without cached values, which are computed from the others
            kind, computed = type(thing), functools.cached_property
            state = {name: x for name, x in state.items() if not isinstance(getattr(kind, name, None), computed)}
        yield ((make, arguments, state, *(None if some is None else [*some] for some in items)),)


_CODE = (
    *("co_name", "co_consts", "co_names", "co_varnames", "co_freevars", "co_cellvars", "co_flags"),
    *("co_argcount", "co_posonlyargcount", "co_kwonlyargcount", "co_exceptiontable"),
)
"""The attributes of code that belong to its digest, besides its instructions. Lines and file names are left out."""


def _pairs(mapping: Mapping[Any, Any]) -> Iterator[tuple[Any]]:
    for key, value in mapping.items():
        yield from ((key,), (value,))


_PARTS: dict[type, Callable[[Any], Iterable[bytes | tuple[Any]]]] = {
    **dict.fromkeys((list, tuple), lambda things: ((part,) for part in things)),
    **dict.fromkeys((dict, types.MappingProxyType), _pairs),
    **dict.fromkeys((staticmethod, classmethod), lambda method: [(method.__func__,)]),
    functools.cached_property: lambda member: [(member.func,)],  # in Python 3.11 it holds a lock
    property: lambda member: [((member.fget, member.fset, member.fdel),)],
    types.CodeType: lambda code: [code.co_code, (tuple(getattr(code, name) for name in _CODE),)],
    ca.Function: lambda function: [function.serialize().encode()],
}
"""Type of an object -> a function that gives the parts of the object."""


def _code_parts(thing: types.ModuleType | types.FunctionType | type) -> Iterator[bytes | tuple[Any]]:
    if isinstance(thing, types.ModuleType):
        yield thing.__name__.encode()
        if not _is_installed(thing.__name__) and (file := getattr(thing, "__file__", None)):
            yield file_digest(Path(file)).encode()
    elif _has_name(thing):
        yield f"{thing.__module__}.{thing.__qualname__}".encode()
    elif isinstance(thing, types.FunctionType):
        yield from ((part,) for part in (thing.__code__, thing.__defaults__, thing.__kwdefaults__, vars(thing)))
        for cell in thing.__closure__ or ():
            try:
                yield (cell.cell_contents,)
            except ValueError:  # a name that has no value yet
                yield (None,)
        for name in sorted(_global_names(thing.__code__)):
            yield from ((name,), (thing.__globals__.get(name, getattr(builtins, name, None)),))
    else:
        yield thing.__qualname__.encode()
        yield (thing.__bases__,)
        yield from _pairs({name: member for name, member in vars(thing).items() if _is_member(name, member)})


def _global_names(code: types.CodeType) -> set[str]:
    """Names of the global variables that the code reads."""
    names = {step.argval for step in dis.get_instructions(code) if step.opname in ("LOAD_GLOBAL", "LOAD_NAME")}
    return names.union(*(_global_names(part) for part in code.co_consts if isinstance(part, types.CodeType)))


def _has_name(thing: Any) -> bool:
    """Whether a name identifies a function or a class. The name of an object made inside a function does not."""
    if isinstance(thing, type):
        return _is_installed(thing.__module__)
    module = thing.__globals__.get("__name__")
    return _is_installed(module) and getattr(sys.modules.get(module), thing.__name__, None) is thing


def _is_installed(module: str | None) -> bool:
    """Whether a module is part of Python, of symmb, or of an installed package."""
    top = (module or "").partition(".")[0]
    if top in sys.stdlib_module_names or top == _OURS:
        return True
    file = getattr(sys.modules.get(module or ""), "__file__", None)
    return file is not None and not _INSTALLED.isdisjoint(Path(file).parts)


def _is_member(name: str, member: Any) -> bool:
    """Whether a member of a class is written in the code of the class. Python adds other members."""
    if isinstance(member, types.MemberDescriptorType | types.GetSetDescriptorType) or name == "_abc_impl":
        return False
    return not (name[:2] == name[-2:] == "__") or isinstance(member, types.FunctionType | staticmethod | classmethod)


class ChangedFileError(SimulationError):
    """A declared file has changed. The study ends, because runs before and after the change differ."""


class DeclaredFiles:
    """Files and folders with their present contents, to detect later changes."""

    def __init__(self, paths: Iterable[Path]) -> None:
        self._declared = {path: (_stamp(path), file_digest(path)) for path in paths}

    def digests(self) -> list[tuple[str, str]]:
        """Names of the files and folders, and digests of their contents."""
        return [(path.name, content) for path, (_, content) in self._declared.items()]

    def require_same(self) -> None:
        """Raise ChangedFileError if the contents of a file have changed. Files of equal size and date are not read."""
        for path, (stamp, content) in self._declared.items():
            try:
                is_same = _stamp(path) == stamp or file_digest(path) == content
            except OSError:
                is_same = False
            if not is_same:
                raise ChangedFileError(f"{path} has changed since the simulator was declared. Make a new simulator.")


def _stamp(path: Path) -> tuple[tuple[str, int, int], ...]:
    """Names, sizes and dates of a file, or of the files in a folder."""
    files = [path, *path.rglob("*")] if path.is_dir() else [path]
    states = [(file, file.stat()) for file in files if file.is_file()]  # links may be broken
    return tuple(sorted((str(file), state.st_size, state.st_mtime_ns) for file, state in states))
