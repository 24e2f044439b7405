"""Values that are computed at their first use."""

from collections.abc import Callable
from typing import Any, Generic, TypeVar, cast

T = TypeVar("T")


class Lazy(Generic[T]):
    """A value that is computed at its first use. A pickle contains the value."""

    def __init__(self, compute: Callable[[], T]) -> None:
        self._compute: Callable[[], T] | None = compute
        self._value: T | None = None

    def __call__(self) -> T:
        """The value; the first call computes it."""
        compute = self._compute
        if compute is not None:
            self._value = compute()
            self._compute = None  # the closure may hold large objects
        return cast(T, self._value)

    def __reduce__(self) -> tuple[Any, ...]:
        return known, (self(),)


def known(value: T) -> Lazy[T]:
    """A `Lazy` with a value that is known already."""
    return Lazy(lambda: value)
