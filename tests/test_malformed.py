"""Malformed calls of the API and of the command line are told in sentences: a tenth of the benchmark's."""

import sys
import warnings
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import sympy

import symmb as mb
from symmb._options import numbers_of

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import malformed


@pytest.mark.parametrize("seed", range(3))
def test_malformed_calls_are_told_in_sentences(seed):
    assert malformed.study(50, 100 + seed) == []


def test_a_fault_would_be_found(monkeypatch):
    def fails(value):
        raise ValueError(value)

    monkeypatch.setattr(malformed, "CALLS", [(fails, (1,), {})])
    assert len(malformed.study(3)) == 2


DATES = np.array(["2020-01-01"], dtype="datetime64[D]")
WRONG = [None, "1", {"a": 1}, {1.0}, 1j, DATES, [["x"]], np.timedelta64(1, "s"), 10**400]


@pytest.mark.parametrize("name", ["function", "simulator", "stored", "modal"])
@pytest.mark.parametrize("value", WRONG, ids=lambda value: str(value)[:20])
def test_samples_that_are_no_numbers(name, value):
    with pytest.raises(mb.SymmbError, match="samples must be numbers of the shape"):
        malformed.RECEIVERS[name].run(value)


@pytest.mark.parametrize("value", [0, "x", None, np.array(1.0), ca.MX.sym("x"), sympy.Symbol("x"), lambda: 0])
def test_initial_of_no_expression(value):
    with pytest.raises(mb.DeclarationError, match="initial"):
        mb.initial(value)


SCENE = malformed.SCENE
CALLS = {
    "inputs": lambda: mb.linearize(SCENE, inputs=np.array([1.0])),
    "outputs": lambda: mb.linearize(SCENE, outputs=3),
    "critical": lambda: mb.critical(SCENE, np.array(["k"]), (0, 1)),
    "range": lambda: mb.critical(SCENE, "k", np.array([1.0, 2.0, 3.0])),
    "locus": lambda: mb.root_locus(SCENE, ["k"], (0, 1)),
    "modes": lambda: mb.FiniteElements.beams(malformed.BEAM).modes(interfaces=3),
    "executor that is a module": lambda: mb.propagate(malformed.DECAY, mb.Vertex(), malformed.BOX, executor=np),
    "executor with another map": lambda: mb.propagate(malformed.DECAY, mb.Vertex(), malformed.BOX, executor=_Maps()),
    "names": lambda: mb.Scene(SCENE.system, outputs=np.ones(3)),
    "start": lambda: mb.Scene(SCENE.system, start=np.ones(3)),
    "a symbol of nothing": lambda: malformed.in_a_scene(mb.BushContact)(
        "bush", malformed.A, malformed.B, (ca.SX.sym("a"), 0, 1), 1e-3, mb.HuntCrossley(1e5, 0.5, 0.1)
    ),
}


class _Maps:
    """An executor whose map keeps no order."""

    def map(self, f, items):
        return [f(item) for item in items][::-1]


@pytest.mark.parametrize("name", CALLS)
def test_calls_that_ended_in_foreign_exceptions(name):
    with warnings.catch_warnings(), pytest.raises(mb.SymmbError) as error:
        warnings.simplefilter("ignore")
        CALLS[name]()
    assert str(error.value).endswith((".", ")", "'")) and len(str(error.value)) < 1000


def test_files_that_cannot_be_written_or_read(tmp_path):
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "file").touch()
    for call in (
        lambda: malformed.RUN.save(tmp_path / "folder.npz"),
        lambda: malformed.RUN.save(tmp_path / "none" / "run.npz"),
        lambda: malformed.DAE.save_c(tmp_path / "file"),
        lambda: mb.Bounds.load(tmp_path / "none.npz"),
        lambda: mb.FiniteElements.matrices(np.eye(3), tmp_path / "none.mtx", np.eye(9)),
    ):
        with pytest.raises(mb.SymmbError, match=r"cannot be (written|made|read): .*\.$") as error:
            call()
        assert isinstance(error.value, OSError)  # as Python's own


def test_numbers_of_what_users_give():
    assert numbers_of(np.longdouble(1.5)) == 1.5 and numbers_of([10**30, 1]).tolist() == [1e30, 1.0]
    for value in ("1", b"1", {}, {1}, 1j, [1j], None, [[1], [1, 2]], np.timedelta64(1), [ca.SX.sym("x")], object()):
        assert numbers_of(value) is None
