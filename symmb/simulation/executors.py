"""Work on other threads, processes and machines: tasks go out one by one, and come back as they end."""

import queue
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from symmb._cleanup import end_with_parent
from symmb._errors import DeclarationError, SimulationError, SymmbError, text_of

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
_GRACE = 0.5
"""Time for processes to end what they have started [s]."""
_TICK = 0.02
"""Time between looks at futures that do not call back [s]."""


class _RefusedError(BrokenExecutor):
    """An executor does not take a task, or cancels it. No worker has died."""


@dataclass(frozen=True)
class Lost:
    """A task whose worker died each time that it was tried."""

    reason: str


class WorkerPool(ProcessPoolExecutor):
    """Processes of symmb's own: they end with this one, and leave nothing behind.

    Parameters
    ----------
    workers : how many
    """

    def __init__(self, workers: int) -> None:
        super().__init__(workers, initializer=end_with_parent)

    def stop(self) -> None:
        """End the processes, whatever they do."""
        processes = list((self._processes or {}).values())
        self.shutdown(wait=False)
        for process in processes:
            process.terminate()
        deadline = time.monotonic() + _GRACE
        for process in processes:
            process.join(max(deadline - time.monotonic(), 0.0))
            process.kill()  # it may be in compiled code, which notices no signals


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
    SimulationError         if an executor that was handed in as an object breaks, or if a function makes broken ones
    """
    with _pool(executor) as pool:
        if pool.submits:
            yield from _submitted(f, items, pool)
        else:
            yield from enumerate(pool.executor.map(f, items))


class _Pool:
    """An executor, and how to make another."""

    def __init__(self, given: Any) -> None:
        self._make = given if _is_factory(given) else None
        self._start(given)

    def _start(self, given: Any) -> None:
        self.executor = given if self._make is None else _made(self._make)
        self._at_first: int | None = None
        if hasattr(self.executor, "get_executor"):  # a client of Dask
            self._at_first = max(sum(self.executor.nthreads().values()), _FEW_WORKERS)
            self.executor = self.executor.get_executor(pure=False)
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
            return self.executor.submit(f, item)
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
            _result(self.submit(int, 0))
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
        return list(executor.map(abs, [-1, 2])) == [1, 2]
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


def _submitted(f: Callable[[Any], Any], items: Iterable[Any], pool: _Pool) -> Iterator[tuple[int, Any]]:
    waiting, most = iter(enumerate(items)), _AHEAD * pool.workers_at_first
    running: dict[int, _Task] = {}
    done: queue.SimpleQueue[int] = queue.SimpleQueue()
    try:
        while True:
            try:
                while len(running) < most and (following := next(waiting, None)) is not None:
                    k, item = following
                    running[k] = _Task(item, None)  # if the executor is broken already, it is tried again
                    running[k] = _begun(f, item, k, pool, done)
                if not running:
                    return
                k = _next(running, done)
                most = min(most + 2, _AHEAD * pool.workers)
                result = _result(running[k].future)
                del running[k]
                yield k, result
            except BrokenExecutor as error:
                suspects, done = dict(sorted(running.items())), queue.SimpleQueue()
                running.clear()
                pool.renew(error)
                for k, task in suspects.items():
                    yield k, _alone(f, task.item, pool)
    finally:  # where it is interrupted, or an error ends it
        for task in running.values():
            if task.future is not None:
                task.future.cancel()


def _begun(f: Callable[[Any], Any], item: Any, k: int, pool: _Pool, done: "queue.SimpleQueue[int]") -> _Task:
    future = pool.submit(f, item)
    if hasattr(future, "add_done_callback"):
        future.add_done_callback(lambda _: done.put(k))
    return _Task(item, future)


def _next(running: dict[int, _Task], done: "queue.SimpleQueue[int]") -> int:
    """The number of a task that has ended."""
    if all(hasattr(task.future, "add_done_callback") for task in running.values()):
        return done.get()
    while True:
        for k, task in running.items():
            if task.future.done():
                return k
        time.sleep(_TICK)


def _alone(f: Callable[[Any], Any], item: Any, pool: _Pool) -> Any:
    """The result of a task during which a worker died, tried alone."""
    last = BrokenExecutor()
    for _ in range(_TRIES - 1):
        try:
            return _result(pool.submit(f, item))
        except BrokenExecutor as error:
            last = error
            pool.renew(error)
    if isinstance(last, _RefusedError):
        raise _made_broken(last)
    return Lost(f"its worker process died each of {_TRIES} times ({text_of(last)})")


def _made_broken(error: BrokenExecutor) -> SimulationError:
    reason = str(error).rstrip(".") or text_of(error)
    return SimulationError(f"executor: the function makes executors that do not run tasks ({reason}).")


def _result(future: Any) -> Any:
    try:
        return future.result()
    except BrokenExecutor:
        raise
    except CancelledError:  # by whoever shut the executor down, or because its cluster is gone
        raise _RefusedError("The executor has cancelled runs.") from None
    except Exception as error:
        if type(error).__name__ == _KILLED:
            return Lost(text_of(error))
        _require_sent(error)
        raise


def _require_sent(error: Exception) -> None:
    """DeclarationError if what is to run cannot be pickled."""
    if "pickle" in str(error):
        raise DeclarationError(
            f"executor: the simulator cannot be sent to other processes ({text_of(error)}). Its functions must be "
            "those of a module, not lambdas or functions inside of others."
        ) from None
