"""The elements that are made inside `with System() as system:`."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

_MADE: ContextVar[list[Any] | None] = ContextVar("elements made inside", default=None)


@contextmanager
def declaring() -> Iterator[list[Any]]:
    """The elements that are made inside, in their order."""
    made: list[Any] = []
    token = _MADE.set(made)
    try:
        yield made
    finally:
        _MADE.reset(token)


def declared(*elements: Any) -> None:
    """Note elements, if those that are made are noted."""
    if (made := _MADE.get()) is not None:
        made.extend(elements)
