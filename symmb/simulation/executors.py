"""Work on other threads, processes and machines: tasks go out one by one, and come back as they end."""

import queue
import secrets
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any, NoReturn

from symmb._errors import DeclarationError, SimulationError, SymmbError, text_of
from symmb._options import shown
from symmb.simulation.limited_calls import end_calls_of
from symmb.simulation.replies import THREADS, Numbered, opened, reply, reply_to
from symmb.simulation.worker_pool import WorkerPool

_TRIES = 3
"""Times that a task is tried whose worker dies: at first among others, then alone."""
_AHEAD = 2
"""Tasks at a time for each worker: one that runs and one that waits."""
_UNKNOWN_WORKERS = 512
"""Tasks at a time, over _AHEAD, of an executor that does not tell its workers, such as that of a cluster."""
_FEW_WORKERS = 8
"""The same of a cluster with fewer workers when the first tasks go out. With each task that ends two more may go out
beside: the cluster may get more workers, and how long tasks take tells how much one should hold."""
_KILLED = "KilledWorker"
"""What Dask raises for a task after it has tried it on several workers."""
_LOCAL = "LocalCluster"
"""Dask's cluster of one machine. Where a worker dies twice within 15 s, it ends the process that would start the next
one, and may come to be without workers for ever, until it is told again how many it should have."""
_TICK = 0.02
"""Time between looks at futures that do not call back [s]."""
_LOOK = 1.0
"""The same of those that should call back, and of results of Dask that do not arrive [s]."""
_PATIENCE = 30.0
"""Time in which an executor must begin one of its first tasks, if its futures tell what runs [s]. Processes of MPI take
some seconds to start. Dask may wait for hours for workers, and its futures do not tell."""


_BITS = 60
"""Of the number at which those of the tasks begin."""


class _RefusedError(BrokenExecutor):
    """An executor does not take a task, or cancels it. No worker has died."""


@dataclass(frozen=True)
class Lost:
    """A task whose worker died each time that it was tried."""

    reason: str


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
    with _pool(executor) as pool:
        for k, result in (_submitted if pool.submits else _mapped)(f, enumerate(items, first), pool):
            yield k - first, result


class _Pool:
    """An executor, and how to make another."""

    def __init__(self, given: Any) -> None:
        self._make = given if _is_factory(given) else None
        self._start(given)

    def _start(self, given: Any) -> None:
        self.executor = given if self._make is None else _made(self._make)
        self._at_first: int | None = None
        self.has_begun, self._since = False, time.monotonic()
        self._options: dict[str, Any] = {}
        if hasattr(getattr(self.executor, "_client", None), "get_executor"):
            # Dask's executor: futures that it makes from those of its client may never end where workers die.
            self._options, self.executor = getattr(self.executor, "_kwargs", {}), self.executor._client
        self.is_dask = hasattr(self.executor, "get_executor")
        if self.is_dask:
            self._options = {"pure": False, **self._options}
            try:
                self._at_first = max(sum(self.executor.nthreads().values()), _FEW_WORKERS)
            except Exception as error:  # it is closed
                raise SimulationError(f"executor: {self.executor!r} does not answer ({text_of(error)}).") from None
        self.submits = callable(getattr(self.executor, "submit", None))
        maps = callable(getattr(self.executor, "map", None))
        is_pool = hasattr(self.executor, "apply_async")  # of multiprocessing: no futures
        if not self.submits and (not maps or is_pool or not _maps_in_order(self.executor)):
            raise DeclarationError(
                f"executor: {self.executor!r} is not supported. Give an object with submit(f, x) or with an ordered "
                "map(f, *iterables), such as a ThreadPoolExecutor, a ProcessPoolExecutor or a client of Dask, or a "
                "function that makes one."
            )

    def submit(self, f: Callable[[Any], Any], item: Any) -> Any:
        try:
            return self.executor.submit(f, item, **self._options)
        except BrokenExecutor:
            raise
        except Exception as error:  # shut down, or its cluster is gone
            _require_sent(error)
            raise _RefusedError(text_of(error)) from None

    @property
    def workers(self) -> int:
        """How many tasks run side by side."""
        told = getattr(self.executor, "_max_workers", None) or getattr(self.executor, "num_workers", None)
        return told if isinstance(told, int) and told > 0 else _UNKNOWN_WORKERS

    @property
    def workers_at_first(self) -> int:
        """How many there are when the first tasks go out. A cluster may get more."""
        return self._at_first or self.workers

    def look(self, futures: Sequence[Any]) -> None:
        """SimulationError if the executor has begun no task yet, and has had the time."""
        cluster: Any = getattr(self.executor, "cluster", None)
        if type(cluster).__name__ == _LOCAL and len(cluster.requested) < len(cluster.plan):
            cluster.scale(len(cluster.plan))
        states = [getattr(future, "running", None) for future in futures]
        self.has_begun = self.has_begun or any(not callable(runs) or runs() for runs in states)
        if not self.has_begun and time.monotonic() - self._since > _PATIENCE:
            raise SimulationError(f"executor: it has begun none of its tasks in {_PATIENCE:.0f} s. Has it no workers?")

    def renew(self, error: BaseException) -> None:
        """Make another executor in the place of a broken one."""
        if self._make is None:
            reason = str(error).rstrip(".") or text_of(error)
            raise SimulationError(
                f"executor: {reason}. The study ends here. Give a function that makes the executor, such as "
                "lambda: ProcessPoolExecutor(8): then symmb makes another, and finds the run at which workers die."
            ) from None
        self.end()
        self._start(self._make)
        try:  # a task that harms no worker
            _outcome(self.submit(int, 0), self)
        except BrokenExecutor as fault:
            raise _made_broken(fault) from None

    def end(self) -> None:
        """Shut down an executor that was made here."""
        if self._make is not None and hasattr(self.executor, "shutdown"):
            # Waiting tasks are cancelled one by one: with cancel_futures ProcessPoolExecutor waits for ever for tasks
            # that it could not pickle.
            self.executor.shutdown(wait=True)


def _made(make: Callable[[], Any]) -> Any:
    """What a function of the user makes."""
    try:
        return make()
    except SymmbError:
        raise
    except Exception as error:
        raise DeclarationError(f"executor: the function that makes one raises {text_of(error)}.") from error


def _maps_in_order(executor: Any) -> bool:
    """Whether its map is that of a function over items: tables and modules have others of that name."""
    try:
        return list(islice(executor.map(abs, [-1, 2]), 3)) == [1, 2]
    except Exception:
        return False


def _is_factory(given: Any) -> bool:
    return isinstance(given, type) or (callable(given) and not hasattr(given, "submit") and not hasattr(given, "map"))


@contextmanager
def _pool(given: Any) -> Iterator[_Pool]:
    pool = _Pool(given)
    try:
        yield pool
    except BaseException:
        if isinstance(pool.executor, WorkerPool):
            pool.executor.stop()
        raise
    finally:
        pool.end()


@dataclass(frozen=True)
class _Task:
    item: Any
    future: Any


def _mapped(f: Callable[[Any], Any], tasks: Iterator[Numbered], pool: _Pool) -> Iterator[tuple[int, Any]]:
    sent: set[int] = set()

    def numbered() -> Iterator[Numbered]:
        for task in tasks:
            sent.add(task[0])
            yield task

    waiting = numbered()
    try:
        for answer in pool.executor.map(partial(reply_to, f), waiting):
            k, result = opened(answer, sent)
            sent.remove(k)
            yield k, result
        if next(waiting, None) is not None or sent:
            raise SimulationError("executor: its map has ended without the results of all its tasks.")
    except Exception as error:
        _raise_told(error)


def _submitted(f: Callable[[Any], Any], tasks: Iterator[Numbered], pool: _Pool) -> Iterator[tuple[int, Any]]:
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


def _begun(f: Callable[[Any], Any], item: Any, k: int, pool: _Pool, done: "queue.SimpleQueue[int]") -> _Task:
    future = pool.submit(partial(reply, f, k), item)
    if not callable(getattr(future, "done", None)) or not callable(getattr(future, "result", None)):
        raise SimulationError(f"executor: its submit has returned {shown(future)}, which is no future.")
    if hasattr(future, "add_done_callback"):
        future.add_done_callback(lambda _: done.put(k))
    return _Task(item, future)


def _next(running: dict[int, _Task], done: "queue.SimpleQueue[int]", pool: _Pool) -> int:
    """The number of a task that has ended."""
    while True:
        calls_back = all(hasattr(task.future, "add_done_callback") for task in running.values())
        with suppress(queue.Empty):
            k = done.get(timeout=_LOOK if calls_back else _TICK)
            if k in running:  # it is not if a look has found it
                return k
        for k, task in running.items():
            if task.future.done():
                return k
        pool.look([task.future for task in running.values()])


def _alone(f: Callable[[Any], Any], k: int, item: Any, pool: _Pool) -> Any:
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
    if isinstance(last, _RefusedError):
        raise _made_broken(last)
    return Lost(f"its worker process died each of {_TRIES} times ({text_of(last)})")


def _made_broken(error: BrokenExecutor) -> SimulationError:
    reason = str(error).rstrip(".") or text_of(error)
    return SimulationError(f"executor: the function makes executors that do not run tasks ({reason}).")


def _result(future: Any, k: int, pool: _Pool) -> Any:
    """The result of the task k, or `Lost`."""
    outcome = _outcome(future, pool)
    return outcome if isinstance(outcome, Lost) else opened(outcome, (k,))[1]


def _outcome(future: Any, pool: _Pool) -> Any:
    """What the future of a task returns, or `Lost`."""
    try:
        seconds = _LOOK
        while pool.is_dask:  # a result may be lost with its worker, and then has to be made again
            with suppress(TimeoutError):
                return future.result(timeout=seconds)
            pool.look([future])
            seconds *= 2.0
        return future.result()
    except BrokenExecutor:
        raise
    except CancelledError:  # by whoever shut the executor down, or because its cluster is gone
        raise _RefusedError("The executor has cancelled runs.") from None
    except Exception as error:
        if type(error).__name__ == _KILLED:
            return Lost(text_of(error))
        _raise_told(error)


def _raise_told(error: Exception) -> NoReturn:
    """An error of symmb as it is, and that of an executor as a sentence."""
    if isinstance(error, SymmbError):
        raise error
    _require_sent(error)
    raise SimulationError(f"executor: a task ended with {text_of(error)}.") from error


def _require_sent(error: Exception) -> None:
    """DeclarationError if what is to run cannot be pickled."""
    if "pickle" in str(error):
        raise DeclarationError(
            f"executor: the simulator cannot be sent to other processes ({text_of(error)}). Its functions must be "
            "those of a module, not lambdas or functions inside of others."
        ) from None
