"""Checks of arguments from users, such as numbers and names, and the printed form of objects with options."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from dataclasses import MISSING, fields
from importlib import import_module
from inspect import signature
from types import ModuleType
from typing import Any, TypeGuard

import numpy as np

from symmb._errors import DeclarationError
from symmb._limits import fits
from symmb._names import did_you_mean, normal, shown
from symmb._types import Array


def constructor_text(instance: Any, *leading: str) -> str:
    """Text of the call that makes an options object. Fields with default values are left out.

    ``leading`` has the texts of the first fields. These texts are shown without names of fields; "" is not shown.
    """
    options = [
        f"{option.name}={getattr(instance, option.name)!r}"
        for option in fields(instance)[len(leading) :]
        if option.default is MISSING or getattr(instance, option.name) != option.default
    ]
    return f"{type(instance).__name__}({', '.join([*filter(None, leading), *options])})"


def number_text(value: float) -> str:
    """The shortest text of a number, for messages. The value may be an integer beyond the range of doubles."""
    try:
        return f"{value:g}"
    except OverflowError:
        return shown(value)


def is_real(value: object) -> TypeGuard[float]:
    """Whether a value is a real number, or nan. The result is False for texts, truth values and durations."""
    kinds = int | float | np.integer | np.floating
    return isinstance(value, kinds) and not isinstance(value, bool | np.timedelta64)


def numbers_of(value: object) -> Array | None:
    """A number, nested lists of numbers, or an array of numbers as an array of doubles; None for anything else.

    These are not accepted as numbers: texts, durations, times, truth values, bytes, complex numbers, masked values, and
    values that do not fit into memory.
    """
    if isinstance(value, str | bytes | bytearray | memoryview | bool | Mapping | Set) or np.ma.is_masked(value):
        return None
    size = len(value) if isinstance(value, range) else getattr(value, "size", 0)
    if isinstance(size, int) and not fits(size):
        return None
    try:
        if isinstance(value, list | tuple) and _has_others(value):
            return None
        value = np.arange(value.start, value.stop, value.step) if isinstance(value, range) else value
        array = np.asarray(float(value) if isinstance(value, int) else value)
        if array.dtype.kind == "O" and all(is_real(entry) for entry in array.ravel()):  # integers beyond 64 bits
            array = array.astype(float)
    except Exception:  # ragged, recursive, symbolic, beyond doubles, or an exception of the user's class
        return None
    return np.ascontiguousarray(array, dtype=float).reshape(array.shape) if array.dtype.kind in _REAL else None


_REAL = "iuf"
"""Kinds of NumPy's types that are real numbers."""
_NO_NUMBERS = {bool, np.bool_, bytes, bytearray, memoryview}
"""Types that are not accepted as numbers, although NumPy converts them to numbers in a list."""


def _has_others(values: Sequence[object]) -> bool:
    """Whether nested lists contain a value of a type in `_NO_NUMBERS`."""
    kinds = set(map(type, values))
    inside = (part for part in values if isinstance(part, list | tuple)) if kinds & {list, tuple} else ()
    return not _NO_NUMBERS.isdisjoint(kinds) or any(map(_has_others, inside))


def python_number(value: float) -> float:
    """A number as Python's own type. NumPy's integers overflow, and CasADi crashes at NumPy's long doubles."""
    return int(value) if is_whole(value) else float(value)


def require_numbers(owner: str, name: str, value: object, *shape: int | None, leading: bool = False) -> Array:
    """Real numbers as an array of the given shape. None is any length. With `leading`, other axes may come first.

    DeclarationError is raised if the values are not numbers, or have another shape.
    """
    array = numbers_of(value)
    if array is None:
        raise DeclarationError(f"{owner}: {name} must be real numbers, got {shown(value)}.")
    own = array.shape[-len(shape) :] if leading and shape else array.shape
    if len(own) != len(shape) or any(n not in (m, None) for n, m in zip(shape, own, strict=True)):
        wanted = ", ".join("N" if n is None else f"{n}" for n in shape)
        raise DeclarationError(f"{owner}: {name} must have the shape ({wanted}), got {array.shape}.")
    return array


def require_name(owner: str, what: str, name: object, known: Collection[str]) -> str:
    """A known name in normal form. DeclarationError is raised if the name is not known."""
    if not isinstance(name, str) or (form := normal(name)) not in known:
        raise DeclarationError(f"{owner}: no {what} {shown(name)}.{did_you_mean(name, known)}")
    return form


def require_names(owner: str, what: str, names: object, known: Iterable[str]) -> list[str]:
    """A list of known names.

    DeclarationError is raised if the value is not a list of names, or a name is not known.
    """
    if isinstance(names, str):
        raise DeclarationError(f'{owner}: expected a list of names, got the text {names!r}. Write ["{names}"].')
    if isinstance(names, np.ndarray) and not names.ndim:
        names = None
    if not isinstance(names, Sequence | np.ndarray) or not all(isinstance(name, str) for name in names):
        raise DeclarationError(f"{owner}: expected a list of names, got {shown(names)}.")
    known = dict.fromkeys(known)
    return [require_name(owner, what, str(name), known) for name in names]


def is_finite_number(value: object) -> TypeGuard[float]:
    """Whether a value is a finite real number. The result is False for texts and truth values."""
    try:
        return is_real(value) and math.isfinite(value)
    except OverflowError:  # an integer beyond the range of doubles
        return False


def require_instance(owner: str, value: object, kind: type, example: str) -> None:
    """Raise DeclarationError unless a value is an instance of a class."""
    if not isinstance(value, kind):
        raise DeclarationError(f"{owner}: expected {example}, got {shown(value)}.")


def require_truth(owner: str, name: str, value: object) -> None:
    """Raise DeclarationError unless a value is True or False."""
    if not isinstance(value, bool | np.bool_):
        raise DeclarationError(f"{owner}: {name} must be True or False, got {shown(value)}.")


def require_timeout(owner: str, value: object) -> None:
    """Raise DeclarationError unless a value is None or a number of seconds above 0."""
    if value is not None:
        require_positive(owner, "timeout", value, " of seconds")


def require_positive(owner: str, name: str, value: object, unit: str = "") -> None:
    """Raise DeclarationError unless a value is a finite number above 0."""
    if not is_finite_number(value) or not value > 0:
        raise DeclarationError(f"{owner}: {name} must be a number{unit} above 0, got {shown(value)}.")


def accepts(value: Any, *arguments: str) -> bool:
    """Whether a value can be called with these arguments."""
    if not callable(value):
        return False
    try:
        signature(value).bind(*arguments)
    except TypeError:
        return False
    except ValueError:  # a function of C may have no signature
        pass
    return True


def require_callable(owner: str, value: object, *arguments: str) -> None:
    """Raise DeclarationError unless a value is None or can be called with these arguments."""
    if value is not None and not accepts(value, *arguments):
        raise DeclarationError(f"{owner} must be a function of {', '.join(arguments)}, got {shown(value)}.")


def require_kind(owner: str, name: str, value: object, has: str, example: str) -> None:
    """Raise DeclarationError unless an object has the method `has`. The message contains `example`."""
    if isinstance(value, type | ModuleType) or not callable(getattr(value, has, None)):  # NumPy has `indices`
        raise DeclarationError(f"{owner}: {name} must be an object such as {example}, got {shown(value)}.")


def is_whole(value: object) -> TypeGuard[int]:
    """Whether a value is an integer. The result is False for truth values and durations (bool, timedelta64)."""
    return is_real(value) and isinstance(value, int | np.integer)


def whole(owner: str, name: str, value: object, least: int, most: float = math.inf) -> int:
    """An integer as Python's own type. DeclarationError is raised unless the value is from ``least`` to ``most``."""
    if not is_whole(value) or not least <= value <= most:
        end = "" if most == math.inf else f" and at most {most}"
        raise DeclarationError(f"{owner}: {name} must be an integer of at least {least}{end}, got {shown(value)}.")
    return int(value)


def dimensions(owner: object, d: object, *, n: object = 0, order: object = 0) -> tuple[int, int, int]:
    """Numbers of parameters and points, and an order, as integers. DeclarationError if a value is not an integer."""
    name = type(owner).__name__
    return whole(name, "d", d, 1), whole(name, "n", n, 0), whole(name, "order", order, 0)


def require_whole(options: object, name: str, least: int, most: float = math.inf) -> None:
    """Convert a field of a frozen object to an integer. DeclarationError if the value is out of the range."""
    value = whole(type(options).__name__, name, getattr(options, name), least, most)
    object.__setattr__(options, name, value)


def require_between(options: object, name: str, text: str, low: float, high: float = math.inf) -> None:
    """Convert a field of a frozen object to a float. DeclarationError unless the value is finite and in the range.

    `text` says which of `low` and `high` belong to the range. "[)" means that only `low` belongs to the range.
    """
    value = getattr(options, name)
    number = python_number(value) if is_finite_number(value) else math.nan
    outside = (low,) * (text[0] == "(") + (high,) * (text[1] == ")")
    if not low <= number <= high or number in outside:
        words = [f"at least {low:g}" if text[0] == "[" else f"above {low:g}"]
        words += [f"at most {high:g}" if text[1] == "]" else f"below {high:g}"] if high < math.inf else []
        raise DeclarationError(
            f"{type(options).__name__}: {name} must be a number {' and '.join(words)}, got {shown(value)}."
        )
    object.__setattr__(options, name, number)


def optional_package(name: str, what: str, extra: str) -> Any:
    """Load a package, or a module of a package, that `what` needs. symmb[extra] installs the package.

    ImportError is raised if the package is not installed.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        package = str(error.name).partition(".")[0]
        raise ImportError(
            f"{what} needs {error.name}, which is not installed. Install it: pip install {package}, "
            f"or pip install 'symmb[{extra}]'."
        ) from error
