"""Samples of the wrong shape or kind: every simulator refuses them in one sentence, and reads nothing else."""

import numpy as np
import pytest

import symmb as mb
from symmb.connect import Reduction

TIMES = np.linspace(0.0, 0.1, 3)


def scene():
    p = mb.Parameters(l=1.0, k=5.0)
    rod = mb.Body("rod", 1.0, p.l**2 / 12, mb.Planar())
    ground = mb.Ground()
    spring = mb.Spring("spring", ground.point(4, 0), rod.point(p.l / 2, 0), p.k, 0.5)
    hinge = mb.Revolute("hinge", ground.point(0, 0), rod.point(-p.l / 2, 0))
    system = mb.System(rod, hinge, spring, parameters=p)
    return mb.Scene(system, times=TIMES, outputs={"x": rod.x, "k": p.k + 0 * rod.x})


SIMULATORS = {
    "lanes": lambda folder: mb.DAESimulator(scene(), mb.DormandPrince()),
    "sundials": lambda folder: mb.DAESimulator(scene(), mb.CVODES()),
    "function": lambda folder: mb.FunctionSimulator(
        lambda **p: p["l"] * p["k"] * TIMES, {"l": 1.0, "k": 5.0}, TIMES, ["x"]
    ),
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
    "a dict": {"l": 1.0, "k": 5.0},
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
        with pytest.raises(mb.DeclarationError, match=r"samples must be numbers of the shape \(N, 2\).*l, k") as error:
            call()
        assert str(error.value).isprintable() and len(str(error.value)) < 400


@pytest.mark.parametrize("kind", SIMULATORS)
def test_lists_and_whole_numbers_are_samples(kind, tmp_path):
    simulator = SIMULATORS[kind](tmp_path)
    assert simulator.run([[1, 5], [2, 6]]).ok.all()
    assert simulator.run(np.empty((0, 2))).Y.shape[0] == 0
