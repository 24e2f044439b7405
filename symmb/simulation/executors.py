"""Work on other threads, processes and machines: tasks go out one by one, and come back as they end."""

import queue
import secrets
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from symmb._errors import SimulationError, text_of
from symmb._options import shown
from symmb.simulation.executor_pool import LOOK, Lost, Pool, RefusedError, made_broken, outcome, pool_of, told
from symmb.simulation.limited_calls import end_calls_of
from symmb.simulation.replies import THREADS, Numbered, opened, reply, reply_to

_TRIES = 3
"""Times that a task is tried whose worker dies: at first among others, then alone."""
_AHEAD = 2
"""Tasks at a time for each worker: one that runs and one that waits."""
_TICK = 0.02
"""Time between looks at futures that do not call back [s]."""


_BITS = 60
"""Of the number at which those of the tasks begin."""


def finished(f: Callable[[Any], Any], items: Iterable[Any], executor: Any) -> Iterator[tuple[int, Any]]:
    """Numbers of items with f(item), as the tasks end; `Lost` in place of a result if workers die.

    Parameters
    ----------
    f : picklable if the executor runs in other processes
    items : taken when there is a worker for them
    executor : with `submit`, as those of concurrent.futures, loky, mpi4py and Dask; with an ordered `map`; or a
        function that makes one, and makes another when it breaks

    Raises
    ------
    DeclarationError        if it is none of these, or what it has to run cannot be pickled
    SimulationError         if an executor that was handed in as an object breaks, or if a function makes broken ones;
                            if it returns other results than those of its tasks, or raises
    """
    first = secrets.randbits(_BITS)  # so that results of one call are not taken for those of another
    with pool_of(executor) as pool:
        for k, result in (_submitted if pool.submits else _mapped)(f, enumerate(items, first), pool):
            yield k - first, result


@dataclass(frozen=True)
class _Task:
    item: Any
    future: Any


def _mapped(f: Callable[[Any], Any], tasks: Iterator[Numbered], pool: Pool) -> Iterator[tuple[int, Any]]:
    sent: set[int] = set()

    def numbered() -> Iterator[Numbered]:
        for task in tasks:
            sent.add(task[0])
            yield task

    waiting = numbered()
    with told():
        answers = iter(pool.executor.map(partial(reply_to, f), waiting))
    while True:
        with told():
            answer = next(answers, _END)
        if answer is _END:
            break
        k, result = opened(answer, sent)
        sent.remove(k)
        yield k, result
    if next(waiting, None) is not None or sent:
        raise SimulationError("executor: its map has ended without the results of all its tasks.")


_END = object()


def _submitted(f: Callable[[Any], Any], tasks: Iterator[Numbered], pool: Pool) -> Iterator[tuple[int, Any]]:
    most = _AHEAD * pool.workers_at_first
    running: dict[int, _Task] = {}
    killed: dict[int, tuple[Any, Lost]] = {}
    done: queue.SimpleQueue[int] = queue.SimpleQueue()
    try:
        while True:
            try:
                while len(running) < most and (following := next(tasks, None)) is not None:
                    k, item = following
                    running[k] = _Task(item, None)  # if the executor is broken already, it is tried again
                    running[k] = _begun(f, item, k, pool, done)
                if not running:
                    break
                k = _next(running, done, pool)
                most = min(most + 2, _AHEAD * pool.workers)
                result = _result(running[k].future, k, pool)
                task = running.pop(k)
                if isinstance(result, Lost):
                    killed[k] = task.item, result
                else:
                    yield k, result
            except BrokenExecutor as error:
                suspects, done = dict(sorted(running.items())), queue.SimpleQueue()
                running.clear()
                pool.renew(error)
                for k, task in suspects.items():
                    yield k, _alone(f, k, task.item, pool)
        for k, (item, lost) in killed.items():  # Dask blames all tasks of a worker, also those that it had not begun
            yield k, lost if len(killed) == 1 else _alone(f, k, item, pool)
    finally:  # where it is interrupted, or an error ends it
        for task in running.values():
            if task.future is not None:
                with suppress(Exception):
                    task.future.cancel()
        end_calls_of([THREADS[k] for k in [*running] if k in THREADS])  # or else a pool of threads waits for programs


def _begun(f: Callable[[Any], Any], item: Any, k: int, pool: Pool, done: "queue.SimpleQueue[int]") -> _Task:
    future = pool.submit(partial(reply, f, k), item)
    with told(BrokenExecutor):
        if isinstance(future, type) or not all(callable(getattr(future, name, None)) for name in ("done", "result")):
            raise SimulationError(f"executor: its submit has returned {shown(future)}, which is no future.")
        if hasattr(future, "add_done_callback"):
            future.add_done_callback(lambda _: done.put(k))
    return _Task(item, future)


def _next(running: dict[int, _Task], done: "queue.SimpleQueue[int]", pool: Pool) -> int:
    """The number of a task that has ended."""
    while True:
        with told(BrokenExecutor):
            calls_back = all(hasattr(task.future, "add_done_callback") for task in running.values())
        with suppress(queue.Empty):
            k = done.get(timeout=LOOK if calls_back else _TICK)
            if k in running:  # it is not if a look has found it
                return k
        with told(BrokenExecutor):
            for k, task in running.items():
                if task.future.done():
                    return k
        pool.look([task.future for task in running.values()])


def _alone(f: Callable[[Any], Any], k: int, item: Any, pool: Pool) -> Any:
    """The result of a task during which a worker died, tried alone."""
    last = BrokenExecutor()
    for _ in range(_TRIES - 1):
        try:
            done: queue.SimpleQueue[int] = queue.SimpleQueue()
            task = _begun(f, item, k, pool, done)
            _next({k: task}, done, pool)
            return _result(task.future, k, pool)
        except BrokenExecutor as error:
            last = error
            pool.renew(error)
    if isinstance(last, RefusedError):
        raise made_broken(last)
    return Lost(f"its worker process died each of {_TRIES} times ({text_of(last)})")


def _result(future: Any, k: int, pool: Pool) -> Any:
    """The result of the task k, or `Lost`."""
    answer = outcome(future, pool)
    return answer if isinstance(answer, Lost) else opened(answer, (k,))[1]
