"""Checks of mesh data: finite numbers, and symbols only in some places."""

from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from symmb._errors import DeclarationError
from symmb._options import numbers_of, shown
from symmb._types import Array

Shape = tuple[int | str, ...]


def numbers(value: npt.ArrayLike, owner: str, name: str, *shapes: Shape) -> Array:
    """A read-only copy of finite numbers in one of the shapes, or of a scalar. A letter in a shape means any size."""
    if any(type(item).__module__.split(".")[0] in ("casadi", "sympy") for item in _items(value)):
        raise DeclarationError(
            f"{owner}: {name} contains a symbol. Give numbers, because the modes are computed once. Parameters are "
            "allowed only in joints, forces, rigid bodies, materials, sections and damping ratios."
        )
    shapes = shapes or ((),)
    expected = " or ".join(map(_words, shapes))
    found = numbers_of(value)
    if found is None:
        raise DeclarationError(f"{owner}: {name} must be {expected}, got {shown(value)}.")
    array = found.copy()
    if not any(_fits(array.shape, shape) for shape in shapes):
        raise DeclarationError(f"{owner}: {name} must be {expected}, got the shape {array.shape}.")
    if not np.isfinite(array).all():
        raise DeclarationError(f"{owner}: {name} must be finite, got {shown(value)}.")
    array.setflags(write=False)
    return array


LARGEST = 1e60
"""Largest length, modulus or mass [SI]. The fifth power of this number must be finite."""


def positive(value: npt.ArrayLike, owner: str, name: str) -> float:
    """A number above zero with finite powers. Raises DeclarationError for other values."""
    number = float(numbers(value, owner, name))
    if number <= 0:
        raise DeclarationError(f"{owner}: {name} must be above 0, got {number:g}.")
    if number > LARGEST:
        raise DeclarationError(f"{owner}: {name} must be at most {LARGEST:g}, got {number:g}.")
    return number


def is_law(value: Any) -> bool:
    """Whether a value is a scalar expression of symbols."""
    return isinstance(value, ca.SX) and value.is_scalar() and not value.is_constant()


def positive_law(value: Any, owner: str, name: str) -> Any:
    """A number above zero, or an expression of parameters. Raises DeclarationError for other values."""
    return value if is_law(value) else positive(value, owner, name)


def _items(value: npt.ArrayLike, depth: int = 0) -> list[object]:
    if isinstance(value, list | tuple) and depth < 3:  # no array has more axes, and lists may contain themselves
        return [inner for item in value for inner in _items(item, depth + 1)]
    if isinstance(value, np.ndarray) and value.dtype == object:
        return list(value.flat)
    return [value]


def _fits(shape: tuple[int, ...], expected: Shape) -> bool:
    if len(shape) != len(expected):
        return False
    sizes: dict[int | str, int] = {size: size for size in expected if isinstance(size, int)}
    return all(sizes.setdefault(name, size) == size for name, size in zip(expected, shape, strict=True))


def _words(shape: Shape) -> str:
    return "an array (" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")" if shape else "a number"
