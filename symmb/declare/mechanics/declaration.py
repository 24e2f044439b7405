"""Recording of the elements that are declared inside `with System() as system:`, and of elements in no System."""

from collections.abc import Iterable
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, Self
from weakref import WeakValueDictionary

from symmb._errors import DeclarationError

_MADE: ContextVar[list[Any] | None] = ContextVar("elements made inside", default=None)
_IN_NO_SYSTEM: WeakValueDictionary[int, Any] = WeakValueDictionary()
"""The elements that have not been part of a System yet, by their `id`."""


def declared(*elements: Any) -> None:
    """Record elements if they are declared inside a block."""
    if (made := _MADE.get()) is not None:
        made.extend(elements)


def enter(element: Any) -> None:
    """Record a new element, which is in no System yet."""
    declared(element)
    _IN_NO_SYSTEM[id(element)] = element


def mark_as_used(elements: Iterable[Any]) -> None:
    """Note that these elements are part of a System."""
    for element in elements:
        _IN_NO_SYSTEM.pop(id(element), None)


def in_no_system() -> list[Any]:
    """The elements in use that have not been part of a System yet."""
    references = _IN_NO_SYSTEM.valuerefs()  # a list, which other threads do not change
    return [element for reference in references if (element := reference()) is not None]


class Block:
    """A context manager that records the elements declared inside its `with`."""

    def __enter__(self) -> Self:
        self._made: list[Any] = []
        self._token = _MADE.set(self._made)
        return self

    def __exit__(self, *error: object) -> None:
        _MADE.reset(self._token)


class FilledByBlock(Block):
    """An object to which a `with` block adds elements. The object cannot be used inside the block."""

    elements: tuple[Any, ...]
    parameters: Any

    def __enter__(self) -> Self:
        if "_outside" in vars(self):
            raise DeclarationError("with: the block of this System is already open. Use one block for all elements.")
        outside = dict(vars(self))
        vars(self).clear()
        self._outside = outside
        return super().__enter__()

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        made, outside = self._made, self._outside
        vars(self).clear()
        vars(self).update(outside)
        if error[0] is None:  # after an error the object keeps its old elements
            kind: Any = type(self)
            whole = kind(*self.elements, *made, parameters=self.parameters or None)
            vars(self).clear()
            vars(self).update(vars(whole))

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if "_outside" in vars(self) and not name.startswith("__"):
                raise DeclarationError("System: a System cannot be used inside its own block. Use it after the block.")
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}.")
