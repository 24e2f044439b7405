"""Samples in blocks, and samples of the wrong shape or kind, which every simulator refuses in one sentence."""

import numpy as np
import pytest
from faults import refused
from small_scenes import particle

import symmb as mb
from symmb.connect import Reduction
from symmb.connect.simulator import BLOCK, blocks, run_blocks

TIMES = np.linspace(0.0, 0.1, 3)


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
