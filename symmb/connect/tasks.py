"""Tasks that the calling thread or an executor finishes. Executors are loaded at the first task for an executor."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import symmb.connect as connect

Numbered = tuple[int, Any]
"""The number of a task, and its item or its result."""


@dataclass(frozen=True)
class LostTask:
    """The result of a task if the worker died at each attempt."""

    reason: str


def finished(f: Callable[[Any], Any], items: Iterable[Any], executor: Any) -> Iterator[Numbered]:
    """Pairs (number of an item, f(item)) in the order in which tasks end; `LostTask` is the result if workers die.

    Parameters
    ----------
    f : picklable if the executor runs in other processes
    items : an item is taken when a worker is free
    executor : an object with `submit`, as in concurrent.futures, loky, mpi4py and Dask; an object with an ordered
        `map`; or a function that makes an executor, and a new one after a failure; None: the calling thread

    Raises
    ------
    DeclarationError        if the executor is none of these, or f cannot be pickled
    SimulationError         if an executor breaks and cannot be replaced, raises an exception, or returns wrong results
    """
    yield from enumerate(map(f, items)) if executor is None else connect.finished_by(executor, f, items)
