"""Executors that do not return what they ran: they drop, repeat, exchange and alter results, or never return them."""

import random
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from itertools import cycle
from typing import Any


def altered(value: Any, choice: random.Random) -> Any:
    """Something else than a result: a part of it is changed, or it is replaced."""
    if isinstance(value, tuple) and choice.random() < 0.7:
        k = choice.randrange(len(value))
        return (*value[:k], altered(value[k], choice), *value[k + 1 :])
    if isinstance(value, bytes) and value and choice.random() < 0.7:
        k = choice.randrange(len(value))
        return value[:k] + bytes([value[k] ^ 1 << choice.randrange(8)]) + value[k + 1 :]
    if isinstance(value, int) and choice.random() < 0.7:
        return value + choice.choice([-1, 1, 10**30])
    return choice.choice([None, 0.0, "lost", (), (1, 2, 3), [value], b"", object()])


def _dropping(results: list[Any], choice: random.Random) -> Iterable[Any]:
    first = choice.randrange(len(results))
    return results[:first] + results[first + choice.randint(1, len(results)) :]


def _repeating(results: list[Any], choice: random.Random) -> Iterable[Any]:
    k = choice.randrange(len(results))
    return choice.choice([results + results[k : k + 1], cycle(results), results[: k + 1] + results[k:]])


def _altering(results: list[Any], choice: random.Random) -> Iterable[Any]:
    k = choice.randrange(len(results))
    return [*results[:k], altered(results[k], choice), *results[k + 1 :]]


def _raising(results: list[Any], choice: random.Random) -> Iterator[Any]:
    yield from results[: choice.randrange(len(results))]
    raise choice.choice([KeyError("gone"), OSError(5, "no network"), AssertionError(), RuntimeError("two\nlines")])


def _exchanging(results: list[Any], choice: random.Random) -> Iterable[Any]:
    return choice.sample(results, len(results))


FAULTS: dict[str, Callable[[list[Any], random.Random], Iterable[Any]]] = {
    "drop": _dropping,
    "repeat": _repeating,
    "alter": _altering,
    "raise": _raising,
    "exchange": _exchanging,
}


class FaultyMap:
    """An executor whose map keeps its order where it is tried, and has a fault later."""

    def __init__(self, fault: str, choice: random.Random) -> None:
        self.fault, self.choice = fault, choice

    def map(self, f: Callable[[Any], Any], items: Iterable[Any]) -> Iterable[Any]:
        if f is abs:
            return map(f, items)
        if self.fault == "drop" and self.choice.random() < 0.3:  # it does not even take them
            return [f(item) for _, item in zip(range(2), items, strict=False)]
        results = [f(item) for item in items]
        return FAULTS[self.fault](results, self.choice) if results else results


class FaultySubmit:
    """An executor whose futures have a fault from some task on."""

    def __init__(self, fault: str, choice: random.Random) -> None:
        self.fault, self.choice, self.left = fault, choice, choice.randint(1, 4)
        self.last: Any = "lost"

    def submit(self, f: Callable[[Any], Any], item: Any) -> Any:
        result, future = f(item), Future()
        self.left -= 1
        former, self.last = self.last, result
        if self.left > 0 and self.fault != "never":
            future.set_result(result)
        elif self.fault == "drop":
            future.cancel()
        elif self.fault in ("repeat", "exchange"):
            future.set_result(former)
        elif self.fault == "alter":
            if self.choice.random() < 0.3:
                return altered(future, self.choice)
            future.set_result(altered(result, self.choice))
        elif self.fault == "raise":
            error = self.choice.choice([KeyError("gone"), OSError(5, "no network"), RuntimeError("two\nlines")])
            if self.choice.random() < 0.3:
                raise error
            future.set_exception(error)
        return future
