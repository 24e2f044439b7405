"""Options of frozen objects such as methods, rules and solvers: how they print, and checks of their values."""

import math
from dataclasses import MISSING, fields
from importlib import import_module
from inspect import signature
from typing import Any

import numpy as np

from symmb._errors import DeclarationError


def constructor_text(instance: Any, *leading: str, name: str | None = None) -> str:
    """The call that makes an options object; fields at their defaults are left out.

    ``leading`` are texts for the first fields, shown as they are ("" shows nothing).
    """
    options = [
        f"{option.name}={getattr(instance, option.name)!r}"
        for option in fields(instance)[len(leading) :]
        if option.default is MISSING or getattr(instance, option.name) != option.default
    ]
    return f"{name or type(instance).__name__}({', '.join([*filter(None, leading), *options])})"


def is_finite_number(value: object) -> bool:
    """Whether a value is a real number, neither nan nor infinite. Texts and truth values are not."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond floats
        return False


def require_instance(owner: str, value: object, kind: type, example: str) -> None:
    """DeclarationError unless a value is of a class."""
    if not isinstance(value, kind):
        got = f"the class {value.__name__}" if isinstance(value, type) else repr(value)
        raise DeclarationError(f"{owner}: expected {example}, got {' '.join(got.split())[:200]}.")


def require_timeout(owner: str, value: object) -> None:
    """DeclarationError unless a value is None or a number of seconds above 0."""
    if value is not None and not (is_finite_number(value) and value > 0):  # pyright: ignore[reportOperatorIssue]
        raise DeclarationError(f"{owner}: timeout must be a number of seconds above 0, got {value!r}.")


def require_callable(owner: str, value: object, *arguments: str) -> None:
    """DeclarationError unless a value is None or can be called with these arguments."""
    try:
        if value is not None:
            signature(value).bind(*arguments)  # pyright: ignore[reportArgumentType]
    except TypeError:
        raise DeclarationError(f"{owner} must be a function of {', '.join(arguments)}, got {value!r}.") from None
    except ValueError:  # a function of C may not tell
        pass


def require_kind(owner: str, name: str, value: object, has: str, example: str) -> None:
    """DeclarationError unless a value is an object with a method of this name, such as `example`."""
    if isinstance(value, type) or not callable(getattr(value, has, None)):
        raise DeclarationError(f"{owner}: {name} must be an object such as {example}, got {value!r}.")


def require_whole(owner: str, name: str, value: object, least: int) -> None:
    """DeclarationError unless value is an integer of at least ``least``."""
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < least:
        raise DeclarationError(f"{owner}: {name} must be an integer of at least {least}, got {value!r}.")


def optional_package(name: str, what: str, extra: str) -> Any:
    """A package, or a module of one, that is loaded when `what` needs it; symmb[extra] installs it.

    Raises
    ------
    ImportError     if it is not installed
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise ImportError(
            f"{what} needs {error.name}, which is not installed. Install it: pip install {error.name}, "
            f"or pip install 'symmb[{extra}]'."
        ) from error
