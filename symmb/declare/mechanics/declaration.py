"""The elements that are made inside `with System() as system:`."""

from contextvars import ContextVar
from typing import Any, Self

_MADE: ContextVar[list[Any] | None] = ContextVar("elements made inside", default=None)


def declared(*elements: Any) -> None:
    """Note elements, if those that are made are noted."""
    if (made := _MADE.get()) is not None:
        made.extend(elements)


class Block:
    """Notes the elements that are made inside its `with`."""

    def __enter__(self) -> Self:
        self._made: list[Any] = []
        self._token = _MADE.set(self._made)
        return self

    def __exit__(self, *error: object) -> None:
        _MADE.reset(self._token)
