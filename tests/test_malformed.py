"""Malformed calls, stores and commands are told in sentences, and nothing is lost: a tenth of the benchmark's."""

import os
import random
import resource
import sqlite3
import tempfile
import warnings
from functools import cache
from importlib import import_module
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import sympy
from faults import refused, refused_command
from scipy.interpolate import PchipInterpolator

import symmb as mb
from symmb._options import numbers_of
from symmb.connect import run_database
from symmb.show.cli.main import main


@cache
def malformed():
    """The benchmark, whose import makes runs."""
    with warnings.catch_warnings(action="ignore"):
        return import_module("malformed")


@pytest.mark.parametrize("seed", range(3))
def test_malformed_calls_are_told_in_sentences(seed):
    assert malformed().study(50, 100 + 50 * seed) == []


def test_a_fault_would_be_found(monkeypatch):
    def fails(value):
        raise ValueError(value)

    monkeypatch.setattr(malformed(), "CALLS", [(fails, (1,), {})])
    assert len(malformed().study(3)) == 2


@pytest.mark.parametrize(
    ("call", "number", "text"),
    [(lambda n: n, 3, "accepts"), (lambda n: 2 * np.int8(n), 3, "Overflow"), (lambda n: n * n, 100, "gives")],
)
def test_nonsense_overflows_and_other_results_would_be_found(monkeypatch, call, number, text):
    monkeypatch.setattr(malformed(), "CALLS", [(call, (number,), {})])
    assert any(text in malformed().api_fault(random.Random(seed)) for seed in range(60))


CALLS = {
    "inputs": lambda m: mb.linearize(m.SCENE, inputs=np.array([1.0])),
    "outputs": lambda m: mb.linearize(m.SCENE, outputs=3),
    "critical": lambda m: mb.critical(m.SCENE, np.array(["k"]), (0, 1)),
    "range": lambda m: mb.critical(m.SCENE, "k", np.array([1.0, 2.0, 3.0])),
    "locus": lambda m: mb.root_locus(m.SCENE, ["k"], (0, 1)),
    "modes": lambda m: mb.FiniteElements.beams(m.BEAM).modes(interfaces=3),
    "executor that is a module": lambda m: mb.propagate(m.DECAY, mb.Vertex(), m.BOX, executor=np),
    "executor with another map": lambda m: mb.propagate(m.DECAY, mb.Vertex(), m.BOX, executor=_Maps()),
    "names": lambda m: mb.Scene(m.SCENE.system, outputs=np.ones(3)),
    "start": lambda m: mb.Scene(m.SCENE.system, start=np.ones(3)),
    "a symbol of nothing": lambda m: m.in_a_scene(mb.BushContact)(
        "bush", m.A, m.B, (ca.SX.sym("a"), 0, 1), 1e-3, mb.HuntCrossley(1e5, 0.5, 0.1)
    ),
}


class _Maps:
    """An executor whose map keeps no order."""

    def map(self, f, items):
        return [f(item) for item in items][::-1]


@pytest.mark.parametrize("name", CALLS)
def test_calls_that_ended_in_foreign_exceptions(name):
    with warnings.catch_warnings(action="ignore"), pytest.raises(mb.SymmbError) as error:
        CALLS[name](malformed())
    assert str(error.value).endswith((".", ")", "'")) and len(str(error.value)) < 1000


def test_files_that_cannot_be_written_or_read(tmp_path):
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "file").touch()
    for call in (
        lambda: malformed().RUN.save(tmp_path / "folder.npz"),
        lambda: malformed().RUN.save(tmp_path / "none" / "run.npz"),
        lambda: malformed().DAE.save_c(tmp_path / "file"),
        lambda: mb.Bounds.load(tmp_path / "none.npz"),
        lambda: mb.FiniteElements.matrices(np.eye(3), tmp_path / "none.mtx", np.eye(9)),
    ):
        with pytest.raises(mb.SymmbError, match=r"cannot be (written|made|read): .*\.$") as error:
            call()
        assert isinstance(error.value, OSError)  # as Python's own


def test_numbers_of_what_users_give():
    assert numbers_of(np.longdouble(1.5)) == 1.5 and numbers_of([10**30, 1]).tolist() == [1e30, 1.0]
    others = "1", b"1", {}, {1}, 1j, [1j], None, [[1], [1, 2]], np.timedelta64(1, "s"), [ca.SX.sym("x")], object()
    truths, buffers = (True, [0, True], np.array([True])), (memoryview(b"x"), bytearray(b"x"), [memoryview(b"x")])
    for value in (*others, *truths, *buffers, np.ma.masked):
        assert numbers_of(value) is None


OPTIONS = {
    mb.Swarm: {"particles": 50, "steps": 10}, mb.PolynomialChaos: {"order": 100}, mb.RungeKutta: {"steps": 100},
    mb.MonteCarlo: {"samples": 100, "seed": 7}, mb.Taylor: {"order": 3, "subintervals": 2},
    mb.Collocation: {"degree": 4, "steps": 50}, mb.CVODES: {"rtol": 0.5, "atol": 0.25}, mb.HyperbolicCross: {"q": 0.5},
    mb.Exact: {"tolerance": 0.5, "budget": 20}, mb.Baumgarte: {"alpha": 2, "beta": 0.5},
    mb.AugmentedLagrangian: {"penalty": 100.0, "iterations": 3},
}  # fmt: skip


@pytest.mark.parametrize("kind", OPTIONS)
@pytest.mark.parametrize("number", [np.int8, np.uint16, np.int64, np.float16, np.longdouble])
def test_numbers_of_options_become_pythons(kind, number):
    whole = issubclass(number, np.integer)
    given = {name: number(value) if isinstance(value, int) == whole else value for name, value in OPTIONS[kind].items()}
    made = kind(**given)
    assert repr(made) == repr(kind(**OPTIONS[kind]))
    assert all(type(getattr(made, name)) is type(value) for name, value in OPTIONS[kind].items())


def test_an_order_does_not_overflow():
    bounds = mb.propagate(malformed().DECAY, mb.Swarm(np.int8(50), np.int8(10)), malformed().BOX)
    assert bounds.evaluations == 2 * len(malformed().T) * 500
    bounds = mb.propagate(malformed().DECAY, mb.PolynomialChaos(order=np.int8(100)), malformed().BOX)
    np.testing.assert_allclose(bounds.lower[:, 0], np.exp(-1.05 * malformed().T), rtol=1e-12)


NO_NUMBERS = True, False, np.True_, "1e-3", 1j, np.ma.masked, np.array([0.1]), None
OF_NUMBERS = [
    (mb.CVODES, "rtol"), (mb.HHT, "step"), (mb.RungeKutta, "steps"), (mb.Exact, "tolerance"), (mb.Baumgarte, "beta"),
    (mb.AugmentedLagrangian, "iterations"), (mb.GeneralizedAlpha, "rho"), (mb.Swarm, "steps"), (mb.Bernstein, "boxes"),
]  # fmt: skip
RATES = 1e200, 1e304, np.inf
SAMPLERS = mb.Sobol(), mb.Random(), mb.LatinHypercube()
REFUSED = {
    "an initial value of no expression": (
        "initial", mb.initial, [0, "x", None, np.array(1.0), ca.MX.sym("x"), sympy.Symbol("x"), lambda: 0],
    ),
    "rates whose squares are no numbers": (r"at most 1e\+60", lambda rate: mb.Baumgarte(beta=rate), RATES),
    "such rates of a penalty": (r"at most 1e\+60", lambda rate: mb.AugmentedLagrangian(omega=rate), RATES),
    "a tolerance beyond doubles": ("must be a number above", lambda value: mb.IDAS(atol=value), [10**400]),
    "a step beyond doubles": ("must be a number above", lambda value: mb.HHT(step=value), [10**400]),
    "samplers are no rules": ("nodes", lambda nodes: mb.PolynomialChaos(2, nodes=nodes), SAMPLERS),
    "nor of the paper": ("nodes", lambda nodes: mb.PolynomialChaos.paper(2, nodes=nodes), SAMPLERS),
    "slopes that are no numbers": (
        "slopes between the points exceed", lambda points: mb.Table(*points),
        [([0, 1], [-1e308, 1e308]), ([-1e308, 1e308], [0, 1]), ([0, 5e-324], [0, 1])],
    ),
} | {
    f"{kind.__name__}, {name}": (name, lambda value, kind=kind, name=name: kind(**{name: value}), NO_NUMBERS)
    for kind, name in OF_NUMBERS
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_values_that_do_not_fit_are_refused(name):
    text, call, values = REFUSED[name]
    for value in values:
        refused(text, call, value)


def sampled(m, period):
    held = mb.Sampled("held", period, m.ROD.theta)
    return mb.simulate(mb.Scene(mb.System(m.ROD, held, parameters=m.SCENE.system.parameters), times=m.T))


COSTS = {
    "swarm": ("1.0e\\+11 runs", lambda m: mb.propagate(m.DECAY, mb.Swarm(10**5, 10**5), m.BOX)),
    "steps": ("1.0e\\+20 steps in each", lambda m: mb.simulate(m.SCENE, mb.RungeKutta(10**20))),
    "collocation": ("1.0e\\+30 steps in each", lambda m: mb.simulate(m.SCENE, mb.Collocation(steps=10**30))),
    "beyond doubles": ("more than 1e300 steps", lambda m: mb.simulate(m.SCENE, mb.RungeKutta(10**400))),
    "memory": ("2.1e\\+09 steps in each", lambda m: mb.simulate(m.SCENE, mb.RungeKutta(2**31))),
    "step": ("steps in each", lambda m: mb.simulate(m.SCENE, mb.HHT(1e-300))),
    "longest step": ("steps in each", lambda m: mb.simulate(m.SCENE, mb.NSTIFFSI2(1e-300, rtol=1e-3))),
    "ensemble": ("1.0e\\+09 steps in each", lambda m: mb.propagate(m.SCENE, mb.Vertex(), solver=mb.RungeKutta(10**9))),
    "probes": ("1.0e\\+12 runs", lambda m: mb.propagate(m.DECAY, mb.PolynomialChaos(probes=10**12), m.BOX)),
    "instants": ("steps in each", lambda m: sampled(m, 1e-12)),
    "instants without end": ("steps in each", lambda m: sampled(m, 1e-300)),
    "table": ("1000000000000 points are too many", lambda m: mb.Table(range(10**12), range(10**12))),
    "locus": ("at most", lambda m: mb.root_locus(m.SCENE, "k", (4.0, 5.0), count=10**9)),
    "mesh": ("at most", lambda m: mb.Beam([(0, 0, 0), (1, 0, 0)], m.BEAM.section, m.BEAM.material, 10**9)),
    "corrections": ("at most", lambda m: mb.AugmentedLagrangian(iterations=10**9)),
}


@pytest.mark.parametrize("name", COSTS)
def test_what_cannot_be_afforded_is_told_before_it_starts(name):
    text, call = COSTS[name]
    refused(text, call, malformed(), error=mb.SymmbError)


@pytest.mark.parametrize("size", [1e-100, 1.0, 1e100])
def test_tables_of_large_and_small_numbers_are_finite(size):
    table, other = mb.Table([0, 1, 2], [-size, size, 0]), PchipInterpolator([0, 1, 2], [-size, size, 0])
    places = np.linspace(0, 2, 9)
    np.testing.assert_allclose([float(table(x)) for x in places], other(places), rtol=1e-12, atol=1e-15 * size)


def test_a_budget_without_end_costs_no_memory():
    bounds = [mb.propagate(malformed().SCENE, mb.Optimization(budget=budget)) for budget in (300, 10**15)]
    np.testing.assert_allclose(bounds[0].upper, bounds[1].upper, rtol=1e-9)


def test_errors_are_no_longer_than_a_screen():
    error = refused(None, malformed().SCENE.with_name, "a" * 10_000)
    assert len(error) < 2000 and error.startswith("name 'aaa")


NUMBERS = {
    "box": lambda m, v: mb.Box(l=(v, 1)),
    "nominal": lambda m, v: mb.Box.around({"l": v}, 0.05),
    "area": lambda m, v: mb.Section(area=v, Iy=1, Iz=1, J=1),
    "points": lambda m, v: mb.Beam([(0, 0, 0), (v, 0, 0)], m.BEAM.section, m.BEAM.material),
    "mass": lambda m, v: mb.System(mb.Body("b", v, 0.1)),
    "doubtful": lambda m, v: m.BOUNDS.doubtful(v),
    "gas": lambda m, v: m.in_a_scene(mb.NonlinearSpring)("gas", m.A, m.B, mb.GasSpring(1e5, 1e-3, v, 0.1)),
    "time": lambda m, v: mb.Scene(m.SCENE.system, times=[v, 1]),
    "table": lambda m, v: mb.Table([0, 1], [0, v]),
    "sample": lambda m, v: m.DECAY.run([[v]]),
}


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", ["1", True, b"1", memoryview(b"x"), np.ma.masked, np.timedelta64(1, "s"), 1j])
def test_what_is_no_number_is_refused_by_name(name, value):
    refused(None, NUMBERS[name], malformed(), value, error=mb.SymmbError)


def test_calls_write_into_a_folder_of_the_generator(monkeypatch, tmp_path):
    def writes(value):
        Path("written").write_text("x")
        raise mb.DeclarationError("f: no.")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(malformed(), "CALLS", [(writes, (1,), {})])
    for seed in range(9):
        assert malformed().api_fault(random.Random(seed)) == ""
    assert [*tmp_path.iterdir()] == [] and Path.cwd() == tmp_path


TIMES = np.linspace(0.0, 1.0, 11)
BOX = mb.Box(k=(0.5, 1.5))


def decay(k):
    return np.exp(-k * TIMES)


def is_sentence(text):
    return text.isprintable() and text[-1] in ".)'" and "Traceback" not in text


@pytest.fixture
def folder():
    """A folder that other users may read, in which a store with ten runs lies."""
    with tempfile.TemporaryDirectory() as name:
        os.chmod(name, 0o755)
        study(Path(name, "runs.db"), 10)
        yield Path(name)


def study(path, runs=40):
    made = mb.FunctionSimulator(decay, {"k": 1.0}, TIMES, ["x"])
    return mb.propagate(mb.StoredSimulator(made, path), mb.MonteCarlo(runs), BOX)


def sql(*statements):
    def change(path):
        connection = sqlite3.connect(path)
        for statement in statements:
            connection.execute(statement)
        connection.commit()
        connection.close()

    return change


def cut(size):
    return lambda path: path.write_bytes(path.read_bytes()[:size])


def overwritten(path):
    content = bytearray(path.read_bytes())
    content[4096:] = os.urandom(len(content) - 4096)
    path.write_bytes(content)


def special(path):
    path.unlink()
    os.mkfifo(path)


STORES = {
    "one byte": cut(1),
    "header": cut(20),
    "first page": cut(4096),
    "half": cut(10_000),
    "overwritten": overwritten,
    "pipe": special,
    "header and nonsense": lambda path: path.write_bytes(b"SQLite format 3\x00" + bytes(range(256)) * 8),
    "text": lambda path: path.write_text("x"),
    "folder": lambda path: (path.unlink(), path.mkdir()),
    "other tables": lambda path: (path.unlink(), sql("CREATE TABLE other (x)")(path)),
    "foreign": sql("PRAGMA application_id = 5"),
    "newer": sql("PRAGMA user_version = 1000"),
    "no runs": sql("DROP TABLE runs"),
    "no studies": sql("DROP TABLE studies"),
    "no column": sql("ALTER TABLE runs DROP COLUMN state"),
    "short rows": sql("UPDATE runs SET response = x'00'"),
    "other rows": sql("UPDATE runs SET response = x'0011223344556677'"),
    "text rows": sql("UPDATE runs SET response = 'text'"),
    "states": sql("UPDATE runs SET state = 7"),
}
LISTS = {
    "times": sql("UPDATE studies SET times = x'00'"),
    "names": sql("UPDATE studies SET parameters = '{'"),
    "number of names": sql("UPDATE studies SET outputs = '3'"),
}


@pytest.mark.parametrize("name", STORES)
def test_stores(name, folder):
    path = folder / "runs.db"
    STORES[name](path)
    kept = path.read_bytes() if path.is_file() else b""
    error = refused(None, study, path, error=(mb.DeclarationError, mb.SimulationError))
    assert str(path) in error and is_sentence(error)
    assert not path.is_file() or path.stat().st_size >= len(kept)
    assert name != "text" or path.read_bytes() == kept


@pytest.mark.parametrize("name", LISTS)
def test_lists_of_stores(name, folder, capsys):
    LISTS[name](folder / "runs.db")
    assert is_sentence(refused_command(capsys, "runs", str(folder / "runs.db")).strip())


COMMANDS = [
    ["runs", ""], ["runs", "."], ["runs", "x" * 300], ["runs", "empty.db"], ["runs", "runs.db/runs.db"],
    ["runs", "runs.db", "--study", "0"], ["runs", "runs.db", "--export", ""],
    ["runs", "runs.db", "--export", "out.csv"], ["runs", "runs.db", "--export", "no/folder/out.nc"],
    ["runs", "runs.db", "--study", "x"], ["runs", "runs.db", "--prune", "some"], ["runs", "runs.db", "--study"],
    ["runs", "runs.db", "--keep"], ["runs"],
]  # fmt: skip
TOLD = [
    (["runs", "no_such.db"], "does not exist"), (["runs", "text.db"], "is not a run store"),
    (["runs", "runs.db", "--study", "7"], "no study 7"), (["runs", "runs.db", "--export", "runs.xls"], ".nc"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "text"), [*((words, "") for words in COMMANDS), *TOLD])
def test_commands(arguments, text, folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    Path("empty.db").touch()
    Path("text.db").write_text("time,x")
    before = Path("runs.db").read_bytes()
    error = refused_command(capsys, *arguments).strip()
    assert is_sentence(error) and text in error
    assert Path("runs.db").read_bytes() == before and not Path("empty.db").stat().st_size


def test_a_full_disk_keeps_what_was_written(folder):
    plain = mb.propagate(mb.FunctionSimulator(decay, {"k": 1.0}, TIMES, ["x"]), mb.MonteCarlo(400), BOX)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (90_000, limits[1]))  # of a file
    try:
        told = r"cannot be written.* Earlier entries are kept"
        error = refused(told, study, folder / "runs.db", 400, error=mb.SimulationError)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert is_sentence(error)
    connection = sqlite3.connect(folder / "runs.db")
    kept = connection.execute("SELECT count(*) FROM runs").fetchone()[0]
    assert kept >= 10 and connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    connection.close()
    assert study(folder / "runs.db", 400).lower.tobytes() == plain.lower.tobytes()


@pytest.mark.skipif(not hasattr(os, "seteuid") or os.getuid() != 0, reason="takes the place of another user")
@pytest.mark.parametrize(("of_file", "of_folder"), [(0o444, 0o555), (0o000, 0o555), (0o644, 0o555)])
def test_what_may_not_be_written(of_file, of_folder, folder):
    path = folder / "runs.db"
    os.chmod(path, of_file)
    os.chmod(folder, of_folder)
    os.seteuid(65534)
    try:
        for each in path, folder / "new.db":
            error = refused(None, study, each)
            assert str(each) in error and is_sentence(error)
    finally:
        os.seteuid(0)
    assert study(path).evaluations == 40


def test_a_store_that_another_program_holds(folder, monkeypatch, capsys):
    monkeypatch.setattr(run_database, "_WAIT_AT_FIRST", 0.1)
    other = sqlite3.connect(folder / "runs.db", isolation_level=None)
    other.execute("BEGIN EXCLUSIVE")
    refused("is locked by another program", study, folder / "runs.db", error=mb.SimulationError)
    assert main(["runs", str(folder / "runs.db"), "--prune", "all"]) in (1, 2)
    assert is_sentence(capsys.readouterr().err.strip())
    other.execute("ROLLBACK")
    other.close()
    assert study(folder / "runs.db").evaluations == 40


@pytest.mark.parametrize("path", [3, None, b"runs.db", "", "a\0b", "no/folder/runs.db", "/proc/runs.db", "x" * 300])
def test_paths_of_stores(path):
    assert is_sentence(refused(None, study, path))
