"""Blocks, reductions and executors: the same bits whatever runs the blocks."""

import numpy as np

from symmb import FunctionSimulator
from symmb.connect.simulator import BLOCK, blocks, run_blocks

TIMES = np.linspace(0.0, 1.0, 11)


def response(a, b):
    return np.stack([np.sin(a * b * TIMES), np.exp(-a * TIMES) / b], axis=1)


SIMULATOR = FunctionSimulator(response, {"a": 1.0, "b": 2.0}, TIMES, ["x", "y"])


def test_blocks_follow_from_the_sample_number_alone():
    assert [list(part) for part in blocks(5, 2)] == [[0, 1], [2, 3], [4]]
    assert [part[0] for part in blocks(3 * BLOCK + 1)] == [0, BLOCK, 2 * BLOCK, 3 * BLOCK]


def test_samples_keep_their_order_and_progress_is_told():
    P = np.random.default_rng(1).uniform(1, 2, (200, 2))
    told = []
    ensemble = run_blocks(SIMULATOR, P, progress=lambda done, total: told.append((done, total)))
    np.testing.assert_array_equal(ensemble.Y, [response(a, b) for a, b in P])
    assert told[-1] == (200, 200) and told == sorted(told) and len(told) == 50
