"""FunctionSimulator: shapes, failures and what is told of them."""

import gc
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from faults import refused
from processes import in_time, runs

from symmb import FunctionSimulator, simulate
from symmb.connect import run_blocks

TIMES = np.array([0.0, 1.0, 2.0])


def _simulator(f, outputs=("x",), **options):
    return FunctionSimulator(f, {"a": 1.0}, TIMES, outputs, **options)


@pytest.mark.parametrize(
    ("result", "what"),
    [
        (np.zeros(2), "the shape (2,), "), ("text", ""), (None, ""), ([[1.0], [1.0, 2.0], [3.0]], ""), ({"x": 1.0}, ""),
        ([1j, 0, 0], ""), (["1", "2", "3"], ""), (object(), ""),
    ],
    ids=["shape", "text", "None", "ragged", "dict", "complex", "texts", "object"],
)  # fmt: skip
def test_what_is_no_array_of_numbers_is_a_failed_sample(result, what):
    """One output may come without its axis."""
    ensemble = _simulator(lambda a: a * TIMES if a > 0 else result).run(np.array([[2.0], [-1.0]]))
    assert ensemble.ok.tolist() == [True, False] and ensemble.Y[0].tolist() == [[0.0], [2.0], [4.0]]
    assert f"the function returned {what}" in ensemble.messages[0]
    assert "expected numbers of the shape (3, 1)" in ensemble.messages[0]


class _Odd(Exception):
    """An exception without a text."""

    def __str__(self):
        raise ValueError


@pytest.mark.parametrize(("error", "told"), [(RuntimeError("stuck"), "RuntimeError: stuck"), (_Odd(), "_Odd")])
def test_exception_is_a_failed_sample(error, told):
    def f(a):
        if a > 1:
            raise error
        return a * TIMES

    ensemble = _simulator(f).run(np.array([[1.0], [3.0]]))
    assert ensemble.ok.tolist() == [True, False]
    assert ensemble.t_failed[1] == 0.0 and np.isnan(ensemble.t_failed[0])
    assert ensemble.messages == (f"{told} (a=3)",) and np.isnan(ensemble.Y[1]).all()


def test_value_that_is_not_finite_fails_from_its_time_on():
    ensemble = _simulator(lambda a: np.stack([TIMES, [0, np.inf, 1]], axis=1), ["x", "y"]).run(np.array([[1.0]]))
    assert not ensemble.ok[0] and ensemble.t_failed[0] == 1.0
    assert ensemble.Y[0, 0].tolist() == [0, 0] and np.isnan(ensemble.Y[0, 1:]).all()
    assert ensemble.messages == ("y is not finite at t = 1 (a=1)",)


@pytest.mark.parametrize(
    "masked",
    [
        np.ma.array([0, 1, 2], mask=[False, True, False]),
        np.ma.array([[0.0], [1.0], [2.0]], mask=[[False], [True], [False]]),
        [0.0, np.ma.masked, 2.0],
        (np.ma.array([0.0]), np.ma.array([1.0], mask=[True]), [2.0]),
    ],
)
def test_a_masked_value_fails_from_its_time_on(masked):
    ensemble = _simulator(lambda a: masked).run(np.array([[1.0]]))
    assert ensemble.messages == ("x is not finite at t = 1 (a=1)",)
    assert ensemble.Y[0, 0, 0] == 0 and np.isnan(ensemble.Y[0, 1:]).all()


def test_malformed_times_outputs_and_timeouts_are_refused():
    for times in ([0.0, 0.0], [1.0, 0.0], [0.0, np.nan], [], [[0.0]]):
        refused("times must be finite and increase", FunctionSimulator, lambda a: 0, {"a": 1.0}, times, ["x"])
    for outputs in ([], ["x", "x"]):
        refused("one or more different names", _simulator, lambda a: TIMES, outputs)
    for timeout in (0, -1.0, np.nan, "10", True):
        refused("timeout must be a number of seconds above 0", _simulator, _hangs, timeout=timeout)
    refused("is a simulator", simulate, _simulator(_hangs))


# -- Timeouts ----------------------------------------------------------------------------------------------


def _hangs(a):
    """A function that hangs, ends its process or raises for some of its arguments."""
    if 1.5 < a < 2.5:
        time.sleep(1000)
    if 2.5 < a < 3.5:
        os.kill(os.getpid(), signal.SIGKILL)
    if 3.5 < a < 4.5:
        sys.exit(3)
    if 4.5 < a < 5.5:
        raise RuntimeError("stuck")
    if 5.5 < a < 6.5:
        return lambda: None
    return a * TIMES


LIMITED = _simulator(_hangs, timeout=0.3)
FAULTS = (
    "timed out: the function had not returned after 0.3 s (a=2)",
    "the function ended its process by SIGKILL (a=3)",
    "SystemExit: 3 (a=4)",
    "RuntimeError: stuck (a=5)",
)


@pytest.mark.parametrize("copies", [1, 3])
def test_calls_that_take_too_long_are_failed_samples(copies):
    P = np.tile(np.arange(1.0, 8.0), copies)[:, None]
    begin = time.monotonic()
    ensemble = LIMITED.run(P)
    assert time.monotonic() - begin < 10 * copies
    assert ensemble.ok.tolist() == [True, False, False, False, False, False, True] * copies
    assert ensemble.messages[:4] == FAULTS and "cannot be sent" in ensemble.messages[4]
    assert (ensemble.Y[ensemble.ok][:, :, 0] == P[ensemble.ok] * TIMES).all()


def test_a_signal_without_a_name_is_told_by_its_number():
    number = signal.SIGRTMIN + 3  # one of real time
    ends = _simulator(lambda a: os.kill(os.getpid(), number), timeout=10)
    assert ends.run(np.ones((1, 1))).messages == (f"the function ended its process by signal {int(number)} (a=1)",)


def test_timeouts_hold_in_threads_and_in_processes():
    P = np.arange(1.0, 8.0)[:, None]
    alone = run_blocks(LIMITED, P)
    for pool in ThreadPoolExecutor(3), ProcessPoolExecutor(2):
        with pool:
            assert run_blocks(LIMITED, P, pool).ok.tolist() == alone.ok.tolist()


def test_an_interrupt_ends_a_call():
    timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    slow = _simulator(_hangs, timeout=100)
    timer.start()
    refused(None, slow.run, np.array([[2.0]]), error=KeyboardInterrupt)
    assert slow.run(np.array([[1.0]])).Y[0, :, 0].tolist() == TIMES.tolist()


def _process(a):
    """The number of the process that makes a call."""
    return np.full(len(TIMES), float(os.getpid()))


def _number(simulator):
    return int(simulator.run(np.array([[1.0]])).Y[0, 0, 0])


def test_copies_in_a_process_share_that_of_their_calls():
    simulator = _simulator(_process, timeout=10)
    copies = [pickle.loads(pickle.dumps(simulator)) for _ in range(3)]  # a pool sends one with each task
    assert {_number(simulator)} == {_number(copy) for copy in copies} != {os.getpid()}


def test_processes_of_gone_simulators_and_threads_end():
    simulator = _simulator(_process, timeout=10)
    with ThreadPoolExecutor(1) as pool:
        numbers = [pool.submit(_number, simulator).result(), _number(simulator)]
    del simulator
    gc.collect()
    _number(_simulator(_process, timeout=10))
    assert in_time(lambda: not any(map(runs, numbers)), 5)


def test_a_study_that_is_killed_leaves_no_process():
    code = """
import os, sys, time, numpy as np, symmb as mb
def hang(a):
    print(os.getpid(), flush=True)
    time.sleep(1000)
mb.FunctionSimulator(hang, {"a": 1.0}, [0.0], ["x"], timeout=900).run(np.ones((1, 1)))
"""
    study = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    number = int(study.stdout.readline())
    study.kill()
    study.wait()
    study.stdout.close()
    assert in_time(lambda: not runs(number), 5)


def _ends_beside_a_fork(a):
    """A function that ends while a process that it has forked keeps all files open."""
    if os.fork() == 0:
        time.sleep(100)
    os._exit(7)


@pytest.mark.parametrize("timeout", [2, 60])
def test_the_end_of_a_process_shows_whoever_keeps_its_pipe_open(timeout):
    begin = time.monotonic()
    ensemble = _simulator(_ends_beside_a_fork, timeout=timeout).run(np.ones((1, 1)))
    assert ensemble.messages == ("the function ended its process with exit status 7 (a=1)",)
    assert time.monotonic() - begin < 5


def test_processes_that_end_in_threads_harm_no_others():
    """Threads fork and end processes at the same time, also those that the threads of former pools have left."""
    P = np.tile([1.0, 2.0, 1.0, 1.0], 20)[:, None]
    ending = _simulator(lambda a: a * TIMES if a < 1.5 else os._exit(7), timeout=60)
    for _ in range(5):
        with ThreadPoolExecutor(8) as pool:
            ensemble = run_blocks(ending, P, pool)
        assert (ensemble.ok == (P[:, 0] == 1.0)).all()
        assert set(ensemble.messages) == {"the function ended its process with exit status 7 (a=2)"}


def _exits(a):
    """A function that ends the program for some arguments."""
    return a * TIMES if a < 1.5 else sys.exit(3)


@pytest.mark.parametrize("pool", [None, ThreadPoolExecutor, ProcessPoolExecutor])
def test_a_call_that_ends_the_program_is_a_failed_sample(pool):
    ensemble = run_blocks(_simulator(_exits), np.array([[1.0], [2.0], [1.0]]), pool and pool(2))
    assert ensemble.ok.tolist() == [True, False, True]
    assert ensemble.messages == ("SystemExit: 3 (a=2)",)


def test_a_call_that_is_interrupted_ends_the_study():
    def interrupted(a):
        raise KeyboardInterrupt

    refused(None, _simulator(interrupted).run, np.ones((2, 1)), error=KeyboardInterrupt)
