"""Executors of users: what they must offer, and what they raise, as a sentence."""

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from typing import Any

from symmb._errors import DeclarationError, SimulationError, SymmbError, SymmbWarning, text_of
from symmb._options import shown
from symmb.simulation.worker_pool import stop

_KILLED = "KilledWorker"
"""What Dask raises for a task after it has tried it on several workers."""
_CANCELLED = "CancelledError"
"""What futures raise, also those of asyncio, if the executor was shut down or its cluster is gone."""
_UNKNOWN_WORKERS = 512
"""Tasks at a time, over _AHEAD, of an executor that does not tell its workers, such as that of a cluster."""
_FEW_WORKERS = 8
"""The same of a cluster with fewer workers when the first tasks go out. With each task that ends two more may go out
beside: the cluster may get more workers, and how long tasks take tells how much one should hold."""
_LOCAL = "LocalCluster"
"""Dask's cluster of one machine. Where a worker dies twice within 15 s, it ends the process that would start the next
one, and may come to be without workers for ever, until it is told again how many it should have."""
_PATIENCE = 30.0
"""Time in which an executor must begin one of its first tasks, if its futures tell what runs [s]. Processes of MPI take
some seconds to start. Dask may wait for hours for workers, and its futures do not tell."""
LOOK = 1.0
"""Time between looks at futures that should call back, and at results of Dask that do not arrive [s]."""


class RefusedError(BrokenExecutor):
    """An executor does not take a task, or cancels it. No worker has died."""


@dataclass(frozen=True)
class Lost:
    """A task whose worker died each time that it was tried."""

    reason: str


class Pool:
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
                f"executor: {shown(self.executor)} is not supported. Give an object with submit(f, x) or with an "
                "ordered map(f, *iterables), such as a ThreadPoolExecutor, a ProcessPoolExecutor or a client of Dask, "
                "or a function that makes one."
            )

    def submit(self, f: Callable[[Any], Any], item: Any) -> Any:
        try:
            return self.executor.submit(f, item, **self._options)
        except (BrokenExecutor, KeyboardInterrupt):
            raise
        except BaseException as error:  # shut down, or its cluster is gone
            _require_sent(error)
            raise RefusedError(text_of(error)) from None

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
        with told(BrokenExecutor):
            states = [getattr(future, "running", None) for future in futures]
            self.has_begun = self.has_begun or any(not callable(runs) or runs() for runs in states)
        if not self.has_begun and time.monotonic() - self._since > _PATIENCE:
            raise SimulationError(f"executor: it has begun none of its tasks in {_PATIENCE:.0f} s. Has it no workers?")

    def renew(self, error: BaseException) -> None:
        """Make another executor in the place of a broken one."""
        if self._make is None:
            raise SimulationError(
                f"executor: {_reason(error)}. The study ends here. Give a function that makes the executor, such as "
                "lambda: ProcessPoolExecutor(8): then symmb makes another, and finds the run at which workers die."
            ) from None
        self.end()
        self._start(self._make)
        try:  # a task that harms no worker
            outcome(self.submit(int, 0), self)
        except BrokenExecutor as fault:
            raise made_broken(fault) from None

    def end(self) -> None:
        """Shut down an executor that was made here."""
        if self._make is not None and hasattr(self.executor, "shutdown"):
            # Waiting tasks are cancelled one by one: with cancel_futures ProcessPoolExecutor waits for ever for tasks
            # that it could not pickle.
            try:
                self.executor.shutdown(wait=True)
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # the results are there
                warnings.warn(f"executor: its shutdown has raised {text_of(error)}.", SymmbWarning, stacklevel=2)

    def stop(self) -> None:
        """End the processes of an executor that was made here, whatever they do."""
        if self._make is not None and isinstance(self.executor, ProcessPoolExecutor):
            stop(self.executor)


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
def pool_of(given: Any) -> Iterator[Pool]:
    pool = Pool(given)
    try:
        yield pool
    except BaseException:
        pool.stop()
        raise
    finally:
        pool.end()


def outcome(future: Any, pool: Pool) -> Any:
    """What the future of a task returns, or `Lost`."""
    try:
        seconds = LOOK
        while pool.is_dask:  # a result may be lost with its worker, and then has to be made again
            with suppress(TimeoutError):
                return future.result(timeout=seconds)
            pool.look([future])
            seconds *= 2.0
        return future.result()
    except (BrokenExecutor, KeyboardInterrupt):
        raise
    except BaseException as error:
        if type(error).__name__ == _CANCELLED:
            raise RefusedError("The executor has cancelled runs.") from None
        if type(error).__name__ == _KILLED:
            return Lost(text_of(error))
        with told():
            raise


@contextmanager
def told(*kept: type[BaseException]) -> Iterator[None]:
    """A context for a call of the user's executor. What it raises becomes a sentence, unless it is symmb's or kept."""
    try:
        yield
    except (SymmbError, KeyboardInterrupt, *kept):
        raise
    except BaseException as error:  # asyncio's CancelledError is no Exception
        _require_sent(error)
        cause = None if isinstance(error, StopIteration) else error  # contextlib would take it for its own
        raise SimulationError(f"executor: it has raised {text_of(error)}.") from cause


def _require_sent(error: BaseException) -> None:
    """DeclarationError if what is to run cannot be pickled."""
    if "pickle" in text_of(error):
        raise DeclarationError(
            f"executor: the simulator cannot be sent to other processes ({text_of(error)}). Its functions must be "
            "those of a module, not lambdas or functions inside of others."
        ) from None


def made_broken(error: BrokenExecutor) -> SimulationError:
    return SimulationError(f"executor: the function makes executors that do not run tasks ({_reason(error)}).")


def _reason(error: BaseException) -> str:
    return text_of(error).removeprefix(f"{type(error).__name__}: ").rstrip(".")
