"""Blocks, reductions and executors: the same bits whatever runs the blocks."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest

from symmb import Box, DeclarationError, FunctionSimulator, MonteCarlo, PolynomialChaos
from symmb.black_boxes.simulator import BLOCK, blocks, run_blocks, stream

TIMES = np.linspace(0.0, 1.0, 11)
BOX = Box(a=(0.5, 1.5), b=(1.0, 4.0))
METHODS = (PolynomialChaos.paper(order=3), PolynomialChaos(), MonteCarlo(300))


def response(a, b):
    return np.stack([np.sin(a * b * TIMES), np.exp(-a * TIMES) / b], axis=1)


SIMULATOR = FunctionSimulator(response, {"a": 1.0, "b": 2.0}, TIMES, ["x", "y"])


def _bits(bounds):
    return [bounds.lower.tobytes(), bounds.upper.tobytes(), *(inner.tobytes() for inner in bounds.inner)]


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_threads_give_the_same_bits(method):
    with ThreadPoolExecutor(3) as threads:
        assert _bits(method.bounds(SIMULATOR, BOX, executor=threads)) == _bits(method.bounds(SIMULATOR, BOX))


def test_processes_give_the_same_bits():
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as processes:
        for method in METHODS:
            assert _bits(method.bounds(SIMULATOR, BOX, executor=processes)) == _bits(method.bounds(SIMULATOR, BOX))


def test_dask_gives_the_same_bits():
    distributed = pytest.importorskip("distributed")
    with distributed.Client(processes=False, dashboard_address=":0") as client:
        executor = client.get_executor()
        for method in METHODS:
            assert _bits(method.bounds(SIMULATOR, BOX, executor=executor)) == _bits(method.bounds(SIMULATOR, BOX))


def test_blocks_follow_from_the_sample_number_alone():
    assert [list(part) for part in blocks(5, 2)] == [[0, 1], [2, 3], [4]]
    assert [part[0] for part in blocks(3 * BLOCK + 1)] == [0, BLOCK, 2 * BLOCK, 3 * BLOCK]


def test_samples_keep_their_order_and_progress_is_told():
    P = np.random.default_rng(1).uniform(1, 2, (200, 2))
    told = []
    ensemble = run_blocks(SIMULATOR, P, progress=lambda done, total: told.append((done, total)))
    np.testing.assert_array_equal(ensemble.Y, [response(a, b) for a, b in P])
    assert told[-1] == (200, 200) and told == sorted(told) and len(told) == 50


def test_no_samples():
    assert run_blocks(SIMULATOR, np.empty((0, 2))).Y.shape == (0, 11, 2)


def test_wrong_number_of_columns():
    with pytest.raises(
        DeclarationError, match=r"samples must be numbers of the shape \(N, 2\), one column for each of a, b"
    ):
        stream(SIMULATOR, np.zeros((3, 1)), None)
