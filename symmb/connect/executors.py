"""Work on other threads, processes and machines. Each result is returned when its task ends."""

import os
import pickle
import queue
import secrets
import signal
import threading
import time
import warnings
import zlib
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any

import symmb.connect as connect
from symmb._cleanup import watch_parent
from symmb._errors import DeclarationError, SimulationError, SymmbError, SymmbWarning, text_of
from symmb._options import shown
from symmb.connect.tasks import LostTask, Numbered

_TRIES = 3
"""Maximum number of attempts at a task if its worker dies: first together with other tasks, then alone."""
_TASKS_PER_WORKER = 2
"""Number of submitted tasks for each worker: one task runs and one waits."""
_POLL_SECONDS = 0.02
"""Time between checks of futures without callbacks, and between checks whether threads have ended [s]."""
_CHECK_SECONDS = 1.0
"""Time between checks of futures with callbacks, and for results that Dask has lost [s]."""
_END_SECONDS = 0.5
"""Time for threads and processes to end when a study is interrupted [s]."""
_KILLED = "KilledWorker"
"""Name of Dask's exception for a task whose workers died."""
_CANCELLED = "CancelledError"
"""Name of the exception of futures, also of asyncio, if the executor was shut down or its cluster has ended."""
_LOCAL = "LocalCluster"
"""Dask's cluster on one machine. If a worker dies twice within 15 s, Dask ends the process that starts workers. The
cluster may then have no workers until the number of workers is set again."""
_START_SECONDS = 30.0
"""Time limit for the start of a first task, for executors whose futures report running tasks [s]. MPI takes some
seconds to start processes. Dask may wait hours for workers, and its futures do not report running tasks."""
_THREADS: dict[int, threading.Thread] = {}
"""Number of each task that runs in this process -> its thread."""
_END = object()


class RefusedError(BrokenExecutor):
    """An executor refuses a task, or cancels it. No worker has died."""


@dataclass(frozen=True)
class _Task:
    item: Any
    future: Any


def is_shut_down(executor: Any) -> bool:
    """Whether an executor refuses a task, because it is shut down."""
    submit = getattr(executor, "submit", None)
    if not callable(submit):
        return False
    try:
        submit(int, 0)
    except Exception:
        return True
    return False


def finished_by(executor: Any, f: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Numbered]:
    """Pairs (number of an item, f(item)) in the order in which tasks end, as `tasks.finished` describes."""
    first = secrets.randbits(60)  # so that results of different calls cannot be confused
    with _Pool(executor) as pool:
        for k, result in (_submitted if pool.submits else _mapped)(f, enumerate(items, first), pool):
            yield k - first, result


def _mapped(f: Callable[[Any], Any], tasks: Iterator[Numbered], pool: "_Pool") -> Iterator[Numbered]:
    sent: set[int] = set()

    def numbered() -> Iterator[Numbered]:
        for task in tasks:
            sent.add(task[0])
            yield task

    waiting = numbered()
    with _as_simulation_error():
        answers = iter(pool.executor.map(partial(_reply, f), waiting))
    while True:
        with _as_simulation_error():
            answer = next(answers, _END)
        if answer is _END:
            break
        k, result = _unpacked(answer, sent)
        sent.remove(k)
        yield k, result
    if next(waiting, None) is not None or sent:
        raise SimulationError("executor: map ended without the results of all tasks.")


def _submitted(f: Callable[[Any], Any], tasks: Iterator[Numbered], pool: "_Pool") -> Iterator[Numbered]:
    # Only a few tasks wait in the executor, so that an interrupted study ends soon.
    most = _TASKS_PER_WORKER * (pool.workers_at_first or pool.workers)  # a cluster may get more workers
    running: dict[int, _Task] = {}
    killed: dict[int, tuple[Any, LostTask]] = {}
    done: queue.SimpleQueue[int] = queue.SimpleQueue()
    try:
        while True:
            try:
                while len(running) < most and (following := next(tasks, None)) is not None:
                    k, item = following
                    running[k] = _Task(item, None)  # if the executor is already broken, the task is tried again
                    running[k] = _begun(f, item, k, pool, done)
                if not running:
                    break
                k = _next(running, done, pool)
                most = min(most + 2, _TASKS_PER_WORKER * pool.workers)
                result = pool.result(running[k].future, k)
                task = running.pop(k)
                if isinstance(result, LostTask):
                    killed[k] = task.item, result
                else:
                    yield k, result
            except BrokenExecutor as error:
                # Any of the running tasks may have killed the worker. Each task is repeated alone, so that only the
                # task that kills its worker is lost.
                suspects, done = dict(sorted(running.items())), queue.SimpleQueue()
                running.clear()
                pool.renew(error)
                for k, task in suspects.items():
                    yield k, _alone(f, k, task.item, pool)
        for k, (item, lost) in killed.items():  # Dask also reports the waiting tasks of a dead worker
            yield k, lost if len(killed) == 1 else _alone(f, k, item, pool)
    finally:  # also after an interrupt or an error
        for task in running.values():
            if task.future is not None:
                with suppress(Exception):
                    task.future.cancel()
        _end_calls(running)  # otherwise a pool of threads waits for programs


def _require_same_versions(versions: Mapping[str, Any]) -> None:
    """Raise SimulationError if a Dask worker has another version of symmb or Python than its client."""
    for address, worker in versions["workers"].items():
        for name, length in (("symmb", None), ("python", 2)):  # 3.11 of 3.11.7
            here, there = (
                ".".join(str(each["packages"].get(name)).split(".")[:length]) for each in (versions["client"], worker)
            )
            if here != there:
                raise SimulationError(f"executor: worker {address} has {name} {there}, but this process has {here}.")


def _end_calls(tasks: Iterable[int]) -> None:
    """End `LimitedCalls` that run, or are about to start, in the threads of some tasks."""
    deadline = time.monotonic() + _END_SECONDS
    while (threads := [_THREADS[k] for k in [*tasks] if k in _THREADS]) and time.monotonic() < deadline:
        connect.end_calls_of(threads)
        time.sleep(_POLL_SECONDS)


def _begun(f: Callable[[Any], Any], item: Any, k: int, pool: "_Pool", done: "queue.SimpleQueue[int]") -> _Task:
    future = pool.submit(partial(_reply, f), (k, item))
    with _as_simulation_error(BrokenExecutor):
        if isinstance(future, type) or not all(callable(getattr(future, name, None)) for name in ("done", "result")):
            raise SimulationError(f"executor: submit returned {shown(future)}, which is not a future.")
        if hasattr(future, "add_done_callback"):
            future.add_done_callback(lambda _: done.put(k))
    return _Task(item, future)


def _next(running: dict[int, _Task], done: "queue.SimpleQueue[int]", pool: "_Pool") -> int:
    """The number of a task that has ended."""
    while True:
        with _as_simulation_error(BrokenExecutor):
            calls_back = all(hasattr(task.future, "add_done_callback") for task in running.values())
        with suppress(queue.Empty):
            k = done.get(timeout=_CHECK_SECONDS if calls_back else _POLL_SECONDS)
            if k in running:  # otherwise a check has already found it
                return k
        with _as_simulation_error(BrokenExecutor):
            for k, task in running.items():
                if task.future.done():
                    return k
        pool.look([task.future for task in running.values()])


def _alone(f: Callable[[Any], Any], k: int, item: Any, pool: "_Pool") -> Any:
    """The result of a task that is repeated alone, because a worker died during the task."""
    last = BrokenExecutor()
    for _ in range(_TRIES - 1):
        try:
            done: queue.SimpleQueue[int] = queue.SimpleQueue()
            task = _begun(f, item, k, pool, done)
            _next({k: task}, done, pool)
            return pool.result(task.future, k)
        except BrokenExecutor as error:
            last = error
            pool.renew(error)
    if isinstance(last, RefusedError):
        raise _made_broken(last)
    return LostTask(f"its worker process died each of {_TRIES} times ({text_of(last)})")


def _reply(f: Callable[[Any], Any], task: Numbered) -> tuple[int, int, bytes]:
    """The number of a task, a checksum and the pickled result, because some executors return results of other tasks."""
    k, item = task
    watch_parent()
    _THREADS[k] = threading.current_thread()
    try:
        content = pickle.dumps(f(item), pickle.HIGHEST_PROTOCOL)
    finally:
        del _THREADS[k]
    return k, zlib.crc32(content, k), content


def _unpacked(reply: Any, sent: Container[int]) -> Numbered:
    """The number and the result of a submitted task, from its `_reply`."""
    with suppress(Exception):  # comparison of an unknown object may raise
        k, checksum, content = reply
        if k in sent and zlib.crc32(content, k) == checksum:
            return k, pickle.loads(content)
    raise SimulationError("executor: the executor returned other values than the results of its tasks.")


class _Pool:
    """The user's executor, or an executor made by the user's function. The function can replace a broken executor."""

    def __init__(self, given: Any) -> None:
        named = ("submit", "map")
        is_factory = isinstance(given, type) or (callable(given) and not any(hasattr(given, name) for name in named))
        self._make = given if is_factory else None
        self._start(given)

    def __enter__(self) -> "_Pool":
        return self

    def __exit__(self, fault: type[BaseException] | None, *_: object) -> None:
        if fault is not None and isinstance(self.executor, ProcessPoolExecutor):
            if self._make is not None:
                _end_processes(self.executor)
            elif issubclass(fault, KeyboardInterrupt):  # as a terminal does; otherwise the pool waits for its tasks
                for process in list(self.executor._processes or ()):
                    with suppress(ProcessLookupError):
                        os.kill(process, signal.SIGINT)
        self._end()

    def _start(self, given: Any) -> None:
        self.executor: Any = given
        if self._make is not None:
            try:
                self.executor = self._make()
            except SymmbError:
                raise
            except Exception as error:
                raise DeclarationError(
                    f"executor: the function that makes the executor raises {text_of(error)}."
                ) from error
        self.workers_at_first = 0
        self.has_begun, self._since = False, time.monotonic()
        self._options: dict[str, Any] = {}
        if hasattr(getattr(self.executor, "_client", None), "get_executor"):
            # The client is used, because futures of Dask's executor may never end if workers die.
            self._options, self.executor = getattr(self.executor, "_kwargs", {}), self.executor._client
        self.is_dask = hasattr(self.executor, "get_executor")
        if self.is_dask:
            self._options = {"pure": False, **self._options}
            try:
                # A cluster counts as 8 workers if it has fewer at the start, because it may get more workers. For the
                # same reason, two more tasks may be submitted for each task that ends.
                self.workers_at_first = max(sum(self.executor.nthreads().values()), 8)
                versions = self.executor.get_versions(packages=["symmb"])
            except Exception as error:  # the client is closed
                raise SimulationError(f"executor: {self.executor!r} does not answer ({text_of(error)}).") from None
            _require_same_versions(versions)
        self.submits = callable(getattr(self.executor, "submit", None))
        maps = callable(getattr(self.executor, "map", None))
        is_pool = hasattr(self.executor, "apply_async")  # a pool of multiprocessing has no futures
        if not self.submits and (not maps or is_pool or not _maps_in_order(self.executor)):
            raise DeclarationError(
                f"executor: {shown(self.executor)} is not supported. Give an object with submit(f, x), or with an "
                "ordered map(f, *iterables), or a function that makes such an object. Examples are "
                "ThreadPoolExecutor(), ProcessPoolExecutor() and a Dask client."
            )

    def submit(self, f: Callable[[Any], Any], item: Any) -> Any:
        try:
            return self.executor.submit(f, item, **self._options)
        except (BrokenExecutor, KeyboardInterrupt):
            raise
        except BaseException as error:  # the executor is shut down, or its cluster has ended
            _require_sent(error)
            raise RefusedError(text_of(error)) from None

    def result(self, future: Any, k: int) -> Any:
        """The result of the task k, or `LostTask`."""
        answer = self._answer(future)
        return answer if isinstance(answer, LostTask) else _unpacked(answer, (k,))[1]

    def _answer(self, future: Any) -> Any:
        """The value of the future of a task, or `LostTask`."""
        try:
            seconds = _CHECK_SECONDS
            while self.is_dask:  # a result may be lost with its worker, and must then be computed again
                with suppress(TimeoutError):
                    return future.result(timeout=seconds)
                self.look([future])
                seconds *= 2.0
            return future.result()
        except (BrokenExecutor, KeyboardInterrupt):
            raise
        except BaseException as error:
            if type(error).__name__ == _CANCELLED:
                raise RefusedError("The executor has cancelled runs.") from None
            if type(error).__name__ == _KILLED:
                return LostTask(text_of(error))
            with _as_simulation_error():
                raise

    @property
    def workers(self) -> int:
        """Number of tasks that run at the same time; 512 if the executor does not report it, as for clusters."""
        number = getattr(self.executor, "_max_workers", None) or getattr(self.executor, "num_workers", None)
        return number if isinstance(number, int) and number > 0 else 512

    def look(self, futures: Sequence[Any]) -> None:
        """Raise SimulationError if the executor has not started any task within the time limit."""
        cluster: Any = getattr(self.executor, "cluster", None)
        if type(cluster).__name__ == _LOCAL and len(cluster.requested) < len(cluster.plan):
            cluster.scale(len(cluster.plan))
        with _as_simulation_error(BrokenExecutor):
            states = [getattr(future, "running", None) for future in futures]
            self.has_begun = self.has_begun or any(not callable(runs) or runs() for runs in states)
        if not self.has_begun and time.monotonic() - self._since > _START_SECONDS:
            raise SimulationError(
                f"executor: no task has started in {_START_SECONDS:.0f} s. Check that the executor has workers."
            )

    def renew(self, error: BaseException) -> None:
        """Make an executor that replaces the broken one. SimulationError is raised if this is not possible."""
        if self._make is None:
            raise SimulationError(
                f"executor: {_reason(error)}. The study ends here. Pass a function that makes the executor, such as "
                "lambda: ProcessPoolExecutor(8). Then symmb makes a new executor, and finds the run that kills workers."
            ) from None
        self._end()
        self._start(self._make)
        try:  # a test task, which cannot kill a worker
            self._answer(self.submit(int, 0))
        except BrokenExecutor as fault:
            raise _made_broken(fault) from None

    def _end(self) -> None:
        """Shut down the executor, if a function of the user made it."""
        if self._make is not None and hasattr(self.executor, "shutdown"):
            # Waiting tasks are cancelled one by one: with cancel_futures, ProcessPoolExecutor waits forever for tasks
            # that it could not pickle.
            try:
                self.executor.shutdown(wait=True)
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # the results are complete
                warnings.warn(f"executor: shutdown raised {text_of(error)}.", SymmbWarning, stacklevel=2)


def _end_processes(pool: ProcessPoolExecutor) -> None:
    """End the processes of a pool, even if they are busy."""
    processes = list((pool._processes or {}).values())
    pool.shutdown(wait=False)
    for process in processes:
        process.terminate()
    deadline = time.monotonic() + _END_SECONDS
    for process in processes:
        process.join(max(deadline - time.monotonic(), 0.0))
        process.kill()  # compiled code does not react to other signals


def _maps_in_order(executor: Any) -> bool:
    """Whether `map` of the executor applies a function to items in order. `map` of tables and modules does not."""
    try:
        return list(islice(executor.map(abs, [-1, 2]), 3)) == [1, 2]
    except Exception:
        return False


@contextmanager
def _as_simulation_error(*kept: type[BaseException]) -> Iterator[None]:
    """A context for a call of the user's executor. Exceptions, except those of `kept` types, become errors of symmb."""
    try:
        yield
    except (SymmbError, KeyboardInterrupt, *kept):
        raise
    except BaseException as error:  # asyncio's CancelledError is not an Exception
        _require_sent(error)
        cause = None if isinstance(error, StopIteration) else error  # contextlib would treat it as its own
        raise SimulationError(f"executor: the executor raised {text_of(error)}.") from cause


def _require_sent(error: BaseException) -> None:
    """Raise DeclarationError if an error says that the simulator or f cannot be pickled."""
    if "pickle" in text_of(error):
        raise DeclarationError(
            f"executor: the simulator cannot be sent to other processes ({text_of(error)}). Use functions "
            "of a module, not lambdas or functions inside other functions."
        ) from None


def _made_broken(error: BrokenExecutor) -> SimulationError:
    return SimulationError(f"executor: the function makes executors that do not run tasks ({_reason(error)}).")


def _reason(error: BaseException) -> str:
    return text_of(error).removeprefix(f"{type(error).__name__}: ").rstrip(".")
