"""Executors: the same bits by all of them, workers that die, and executors that break."""

import asyncio
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import Future, InvalidStateError, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import nullcontext
from functools import partial

import numpy as np
import pytest
from _faulty_executors import FAULTS, FaultyMap, FaultySubmit
from conftest import in_turns
from faults import refused, told_in_a_line, warned
from small_scenes import particle

import symmb as mb
from symmb.connect import Reduction, executors, open_run_database, run_blocks
from symmb.connect.executors import _require_same_versions
from symmb.connect.simulator import BLOCK, blocks

TIMES = np.linspace(0.0, 1.0, 11)
SAMPLES = np.linspace(0.5, 1.5, 40)[:, None]


def decay(k):
    """A run of 5 ms."""
    time.sleep(0.005)
    return np.exp(-k * TIMES)


def quick(k):
    return np.exp(-k * TIMES)


def deadly(k, end=0.95, other=decay):
    """A run that kills its process for some parameters."""
    if 0.9 < k < end:
        os.kill(os.getpid(), signal.SIGKILL)
    return other(k)


def simulator(f):
    return mb.FunctionSimulator(f, {"k": 1.0}, TIMES, ["x"])


class Failing:
    """An executor and its futures, one call of which raises an error or returns something else."""

    def __init__(self, where="", answer=None):
        self.where, self.answer = where, answer

    def _called(self, where, usual):
        if where != self.where:
            return usual
        if isinstance(self.answer, BaseException):
            raise self.answer
        return self.answer

    def submit(self, f, item):
        future = type(self)(self.where, self.answer)
        future.reply = f(item)
        return self._called("submit", future)

    def done(self):
        return self._called("done", True)

    def running(self):
        return self._called("running", False)

    def result(self):
        return self._called("result", self.reply)

    def shutdown(self, wait=True):
        self._called("shutdown", None)


class Calling(Failing):
    def add_done_callback(self, callback):
        self._called("add_done_callback", None)
        callback(self)


class Mapping(Failing):
    """An executor that has an ordered map alone."""

    submit = None

    def map(self, f, items):
        return map(f, items) if f is abs else self._called("map", map(f, items))


class Later(Failing):
    """A future that does not call back, and whose executor has to ask for some time."""

    def done(self):
        self.asked = getattr(self, "asked", 0) + 1
        return self.asked > 3


EXECUTORS = {
    "threads": partial(ThreadPoolExecutor, 3),
    "forked": partial(ProcessPoolExecutor, 2, mp_context=multiprocessing.get_context("fork")),
    "spawned": partial(ProcessPoolExecutor, 2, mp_context=multiprocessing.get_context("spawn")),
    "loky": lambda: pytest.importorskip("loky").ProcessPoolExecutor(2),
    "polled": Later,
    "map": Mapping,
}


@pytest.mark.parametrize(("name", "handed_in", "f"), in_turns(EXECUTORS, [True, False], [decay, quick]))
def test_results_do_not_depend_on_the_executor(name, handed_in, f):
    alone, make = run_blocks(simulator(f), SAMPLES), EXECUTORS[name]
    given = make() if handed_in else make
    shared = run_blocks(simulator(f), SAMPLES, given)
    if handed_in and hasattr(given, "shutdown"):
        given.shutdown()
    assert shared.Y.tobytes() == alone.Y.tobytes() and shared.ok.all()


def bits(bounds):
    return [part.tobytes() for part in (bounds.lower, bounds.upper, *bounds.inner)]


@pytest.mark.parametrize(
    "method", [mb.PolynomialChaos(), mb.PolynomialChaos.paper(order=3), mb.MonteCarlo(60), mb.Scanning(9)], ids=repr
)
@pytest.mark.parametrize("make", [partial(ThreadPoolExecutor, 3), partial(ProcessPoolExecutor, 2)])
def test_bounds_do_not_depend_on_the_executor(method, make):
    box = mb.Box(k=(0.5, 1.5))
    alone = mb.propagate(simulator(decay), method, box)
    assert bits(mb.propagate(simulator(decay), method, box, executor=make)) == bits(alone)


def test_the_run_that_kills_its_worker_is_found():
    ensemble = run_blocks(simulator(deadly), SAMPLES, lambda: ProcessPoolExecutor(2))
    killed = (SAMPLES[:, 0] > 0.9) & (SAMPLES[:, 0] < 0.95)
    assert (ensemble.ok == ~killed).all() and killed.sum() == len(ensemble.messages) == 2
    for message, k in zip(ensemble.messages, SAMPLES[killed, 0], strict=True):
        assert "its worker process died each of 3 times" in message and f"(k={k:.6g})" in message
    assert ensemble.Y[~killed].tobytes() == run_blocks(simulator(decay), SAMPLES).Y[~killed].tobytes()


def test_a_broken_executor_that_was_handed_in_ends_the_study_in_a_sentence():
    with ProcessPoolExecutor(2) as pool, told_in_a_line("Pass a function that makes", mb.SimulationError):
        run_blocks(simulator(deadly), SAMPLES, pool)


class Ending(ThreadPoolExecutor):
    """An executor that somebody shuts down when some tasks have been sent."""

    def __init__(self, tasks, cancel):
        super().__init__(2)
        self.tasks, self.cancel = tasks, cancel

    def submit(self, f, item):
        self.tasks -= 1
        if self.tasks == 0:
            self.shutdown(wait=False, cancel_futures=self.cancel)
        return super().submit(f, item)


@pytest.mark.parametrize("cancel", [True, False])
@pytest.mark.parametrize("tasks", [1, 12])
def test_an_executor_that_is_shut_down_ends_the_study_in_a_sentence(tasks, cancel, tmp_path):
    stored = mb.StoredSimulator(simulator(decay), tmp_path / "runs.db")
    with told_in_a_line("The study ends here", mb.SimulationError):
        run_blocks(stored, SAMPLES, Ending(tasks, cancel))
    assert run_blocks(stored, SAMPLES, lambda: Ending(30, cancel)).ok.all()


def shut_pool():
    with ThreadPoolExecutor(2) as pool:
        return pool


BROKEN = {
    "shut": shut_pool,
    "initializer": lambda: ThreadPoolExecutor(2, initializer=lambda: 1 / 0),
    "one task each": lambda: Ending(2, True),
    "none": lambda: Ending(1, True),
}


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize("make", BROKEN.values(), ids=BROKEN)
def test_a_function_that_makes_broken_executors_ends_the_study(make, tmp_path):
    stored = mb.StoredSimulator(simulator(decay), tmp_path / "runs.db")
    with told_in_a_line("makes executors that do not run tasks", mb.SimulationError):
        run_blocks(stored, SAMPLES, make)
    with open_run_database(stored.path) as database:
        assert not any(sum(counts[1:]) for *_, counts in database.studies())


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("fault", [*FAULTS, "never"])
@pytest.mark.parametrize("kind", [FaultyMap, FaultySubmit])
def test_an_executor_that_does_not_return_what_it_ran_gives_no_other_results(kind, fault, seed, monkeypatch):
    """In a larger number: tests/benchmarks/executors.py faulty."""
    if fault == "never" and kind is FaultyMap:
        pytest.skip("a map that does not return cannot be told from a long run")
    monkeypatch.setattr(executors, "_START_SECONDS", 0.1)
    alone = run_blocks(simulator(quick), SAMPLES)
    try:
        shared = run_blocks(simulator(quick), SAMPLES, kind(fault, random.Random(seed)))
    except mb.SimulationError as error:
        assert str(error).startswith("executor: ") and "\n" not in str(error)
    else:
        assert fault == "exchange" or kind is FaultySubmit  # whose fault may come after the last task
        assert shared.Y.tobytes() == alone.Y.tobytes()


def test_the_last_result_that_a_map_drops_is_missed():
    class Dropping:
        def map(self, f, items):
            results = [f(item) for item in items]
            return results if f is abs else results[:-1]

    own, box = {"executor": Dropping(), "error": mb.SimulationError}, mb.Box(k=(0.5, 1.5))
    for method in (mb.Vertex(), mb.MonteCarlo(40), mb.PolynomialChaos()):
        refused("without the results of all tasks", mb.propagate, simulator(quick), method, box, **own)


def test_results_of_another_call_are_not_taken():
    class Remembering:
        results = []

        def map(self, f, items):
            results = [f(item) for item in items]
            self.results += [results] * (f is not abs)
            return results if f is abs else self.results[0]

    run_blocks(simulator(quick), SAMPLES, Remembering())
    others = "other values than the results of its tasks"
    refused(others, run_blocks, simulator(quick), SAMPLES + 0.1, Remembering(), error=mb.SimulationError)


def test_what_cannot_be_sent_and_what_is_no_executor_are_told():
    local, box = simulator(lambda k: np.exp(-k * TIMES)), mb.Box(k=(0.9, 1.1))
    with ProcessPoolExecutor(1) as pool:
        refused("not lambdas or functions inside", run_blocks, local, SAMPLES, pool)
    own = {"executor": lambda: ProcessPoolExecutor(2)}
    refused("cannot be sent to other processes", mb.propagate, local, mb.MonteCarlo(40), box, **own)
    for executor in (3, "threads", object(), int):
        refused("is not supported", run_blocks, simulator(quick), SAMPLES, executor)


def test_an_exception_in_a_worker_is_told():
    def broken(item):
        raise ZeroDivisionError("here")

    class Broken(ThreadPoolExecutor):
        def submit(self, f, item):
            return super().submit(broken, item)

    with Broken(1) as pool, pytest.raises(mb.SimulationError, match="ZeroDivisionError: here") as error:
        run_blocks(simulator(quick), SAMPLES, pool)
    assert isinstance(error.value.__cause__, ZeroDivisionError)


def test_runs_go_out_one_by_one_where_they_are_slow():
    class Counting(ThreadPoolExecutor):
        sizes: list[int] = []

        def submit(self, f, item) -> Future:
            self.sizes.append(len(item[1]))
            return super().submit(f, item)

    with Counting(1) as pool:
        run_blocks(simulator(lambda k: time.sleep(0.03) or quick(k)), SAMPLES[:10], pool)
        assert pool.sizes == [1] * 10
        pool.sizes.clear()
        run_blocks(simulator(quick), np.linspace(0.5, 1.5, 1000)[:, None], pool)
        assert len(pool.sizes) < 200


def test_dask_gives_the_same_and_ends_where_runs_kill_their_workers():
    distributed, dask = pytest.importorskip("distributed"), pytest.importorskip("dask")
    alone, quick_alone = run_blocks(simulator(decay), SAMPLES), run_blocks(simulator(quick), SAMPLES)
    killed = (SAMPLES[:, 0] > 0.9) & (SAMPLES[:, 0] < 0.92)
    deaths = dask.config.set({"distributed.scheduler.allowed-failures": 1})  # of workers by one run: three by default
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0")
    with deaths, cluster, distributed.Client(cluster) as client:
        for given in client, client.get_executor():
            assert run_blocks(simulator(decay), SAMPLES, given).Y.tobytes() == alone.Y.tobytes()
        shared = run_blocks(simulator(partial(deadly, end=0.92, other=quick)), SAMPLES, client)
    assert (shared.ok == ~killed).all() and shared.Y[~killed].tobytes() == quick_alone.Y[~killed].tobytes()
    assert "KilledWorker" in "".join(shared.messages)
    refused("executor: ", run_blocks, simulator(quick), SAMPLES, client, error=mb.SimulationError)


class Odd:
    """What raises whatever one does with it."""

    def __iter__(self):
        raise OSError("no iteration")

    def __eq__(self, other):
        raise OSError("no comparison")

    __hash__ = object.__hash__


class OddError(Exception):
    def __str__(self):
        raise OSError("no text")


KINDS = RecursionError, OddError, TimeoutError, InvalidStateError, asyncio.CancelledError, GeneratorExit
RAISED = [OSError("odd"), StopIteration(3), SystemExit(3), *(kind() for kind in KINDS)]
RETURNED = [Odd(), None, Failing, (Odd(), 1, b""), (1, 2), 3]
CALLS = {
    "done": (Failing, RAISED),
    "add_done_callback": (Calling, RAISED),
    "submit": (Failing, RAISED + RETURNED),
    "result": (Failing, RAISED + RETURNED),
    "map": (Mapping, RAISED + RETURNED),
}


@pytest.mark.parametrize(
    ("kind", "where", "answer"),
    [(kind, where, answer) for where, (kind, answers) in CALLS.items() for answer in answers],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_whatever_an_executor_raises_or_returns_is_told_in_a_sentence(kind, where, answer):
    with told_in_a_line("executor: ", mb.SimulationError):
        run_blocks(simulator(quick), SAMPLES, kind(where, answer))


@pytest.mark.parametrize("answer", RAISED, ids=lambda a: type(a).__name__)
def test_results_are_kept_where_the_shutdown_fails(answer):
    alone = run_blocks(simulator(quick), SAMPLES)
    failing = partial(Failing, "shutdown", answer)
    shared = warned("executor: shutdown raised", run_blocks, simulator(quick), SAMPLES, failing)
    assert shared.Y.tobytes() == alone.Y.tobytes()


INTERRUPTED = """
import symmb as mb
from concurrent.futures import ProcessPoolExecutor

line = mb.CommandSimulator(["/bin/sh", "-c", "echo > $0.{k}; exec sleep 60", "MARK"], {"k": 1.0}, [0.0], ["x"])
mb.propagate(line, mb.MonteCarlo(20), mb.Box(k=(0.5, 2.0)), executor=lambda: ProcessPoolExecutor(2))
"""


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_an_interrupt_ends_the_processes_of_a_pool_that_symmb_made(tmp_path):
    code = INTERRUPTED.replace("MARK", str(tmp_path / "begun"))
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=20)
    assert "KeyboardInterrupt" in error and process.returncode != 0


@pytest.mark.parametrize(
    ("name", "there", "is_same"),
    [("symmb", "0.1", False), ("symmb", None, False), ("python", "3.9.1.final.0", False), ("symmb", "1.2", True)],
)
def test_a_worker_of_dask_with_another_version_is_told(name, there, is_same):
    own = {"symmb": "1.2", "python": "3.12.1.final.0"}
    versions = {"client": {"packages": own}, "workers": {"tcp://a": {"packages": own | {name: there}}}}
    told = f"worker tcp://a has {name} .*, but this process has"
    with nullcontext() if is_same else told_in_a_line(told, mb.SimulationError):
        _require_same_versions(versions)


# Samples in blocks, and samples of the wrong shape or kind, which every simulator refuses in one sentence


def scene():
    law = lambda p, mass: -p.k * (mass.x - p.r)  # noqa: E731
    made = particle(law, TIMES, {}, r=(1.0, 1.0), k=(5.0, 5.0))
    return mb.Scene(made.system, times=TIMES, outputs=made.outputs)


SIMULATORS = {
    "lanes": lambda folder: mb.DAESimulator(scene(), mb.DormandPrince()),
    "sundials": lambda folder: mb.DAESimulator(scene(), mb.CVODES()),
    "function": lambda folder: mb.FunctionSimulator(lambda r, k: r * k * TIMES, {"r": 1.0, "k": 5.0}, TIMES, ["x"]),
    "stored": lambda folder: mb.StoredSimulator(SIMULATORS["lanes"](folder), folder / "runs.db"),
    "modal": lambda folder: mb.ModalSimulator(scene()),
}
BAD = {
    "too few columns": np.ones((3, 1)),
    "one dimension": np.ones(2),
    "extra columns": np.ones((3, 3)),
    "no dimension": 1.0,
    "three dimensions": np.ones((2, 2, 2)),
    "infinite": np.array([[1.0, np.inf]]),
    "nan": np.array([[1.0, 5.0], [np.nan, 5.0]]),
    "texts": [["1", "5"]],
    "a text": "many",
    "a dict": {"r": 1.0, "k": 5.0},
    "a set": {1.0, 5.0},
    "complex": np.array([[1.0, 5.0 + 1j]]),
    "time stamps": np.array([["2020-01-01", "2020-01-02"]], dtype="datetime64[D]"),
    "truths": np.array([[True, False]]),
    "time": np.timedelta64(1, "s"),
    "beyond doubles": 10**400,
    "none": None,
    "ragged": [[1.0, 5.0], [1.0]],
}


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD.keys())
@pytest.mark.parametrize("kind", SIMULATORS)
def test_malformed_samples_are_refused_in_a_sentence(kind, bad, tmp_path):
    simulator = SIMULATORS[kind](tmp_path)
    extremes = Reduction(list, lambda s, block, i: [*s, block.extremes()], lambda a, b: a + b)
    for call in (lambda: simulator.run(bad), lambda: simulator.stream(bad, extremes)):
        message = refused(r"samples must be numbers of the shape \(N, 2\).*r, k", call)
        assert message.isprintable() and len(message) < 400


@pytest.mark.parametrize("kind", SIMULATORS)
def test_lists_and_whole_numbers_are_samples(kind, tmp_path):
    simulator = SIMULATORS[kind](tmp_path)
    assert simulator.run([[1, 5], [2, 6]]).ok.all()
    assert simulator.run(np.empty((0, 2))).Y.shape[0] == 0


def test_blocks_follow_from_the_sample_number_alone():
    assert [list(part) for part in blocks(5, 2)] == [[0, 1], [2, 3], [4]]
    assert [part[0] for part in blocks(3 * BLOCK + 1)] == [0, BLOCK, 2 * BLOCK, 3 * BLOCK]


def test_samples_keep_their_order_and_progress_is_told():
    P = np.random.default_rng(1).uniform(1, 2, (200, 2))
    told, simulator = [], SIMULATORS["function"](None)
    ensemble = run_blocks(simulator, P, progress=lambda done, total: told.append((done, total)))
    np.testing.assert_array_equal(ensemble.Y, [(r * k * TIMES)[:, None] for r, k in P])
    assert told[-1] == (200, 200) and told == sorted(told) and len(told) == 50
