"""StoredSimulator: what is kept, what is made again, and what may happen to the file."""

import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import kill_studies
import numpy as np
import pytest
from faults import refused, told_in_a_line

import symmb as mb
from models import double_pendulum
from symmb.bound.reductions import bounded
from symmb.connect import run_blocks, run_database
from symmb.connect.run_database import open_run_database
from symmb.show.cli.main import main

EXAMPLES = Path(__file__).parents[2] / "examples"
TIMES = np.linspace(0.0, 1.0, 11)
BOX = mb.Box(a=(0.5, 1.5), b=(0.8, 1.2))


def response(a, b):
    if a > 1.45 and b > 1.15:
        raise RuntimeError("stuck")
    return np.column_stack([np.exp(-a * TIMES), np.sin(b * TIMES)])


def simulator(f, times=TIMES, outputs=("x", "y"), **options):
    return mb.FunctionSimulator(f, {"a": 1.0, "b": 1.0}, times, outputs, **options)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "runs.db"


@pytest.fixture
def stored(path):
    return mb.StoredSimulator(simulator(response), path)


def change(path, script):
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(script)


def asked(path, question):
    """The first value of an answer."""
    with closing(sqlite3.connect(path)) as connection:
        return connection.execute(question).fetchone()[0]


def counting(identity=None):
    """A simulator, known by an identity of its own or another, and the list of its calls."""
    calls = []
    made = simulator(lambda a, b: calls.append((a, b)) or response(a, b))
    if identity:
        object.__setattr__(made, "identity", lambda: identity)
    return made, calls


def bits(bounds):
    return bounds.lower.tobytes(), bounds.upper.tobytes(), bounds.evaluations, len(bounds.failed)


METHODS = [mb.PolynomialChaos(budget=60), mb.MonteCarlo(40), mb.Scanning(5), mb.Vertex()]


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_stored_runs_give_the_same_bounds_and_are_not_made_again(method, path):
    plain = bounded(method, simulator(response), BOX)
    for expected in plain.evaluations, 0:
        made, calls = counting("response")
        assert bits(bounded(method, mb.StoredSimulator(made, path), BOX)) == bits(plain)
        assert len(calls) <= expected and (len(calls) > 0) == (expected > 0)


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_a_finer_study_and_another_method_use_what_is_there(path):
    made, calls = counting("response")
    for method, number in ((mb.Vertex(), 4), (mb.Scanning(3), 9), (mb.Scanning(5), 25)):
        bounded(method, mb.StoredSimulator(made, path), BOX)
        assert len(calls) == number


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_other_functions_times_outputs_and_versions_are_other_studies(path):
    many = [simulator(response), simulator(lambda a, b: 2 * response(a, b)), simulator(response, TIMES + 1)]
    many += [simulator(response, TIMES, ["x", "z"])]
    many += [simulator(lambda a, b, factor=factor: factor * response(a, b)) for factor in (2, 3)]
    for k, one in enumerate([*many, many[0], many[0]]):
        bounded(mb.Vertex(), mb.StoredSimulator(one, path, version="2" if k == len(many) else ""), BOX)
        assert asked(path, "SELECT count(*) FROM studies") == min(k, len(many)) + 1


def test_programs_are_known_by_their_templates_and_files(tmp_path):
    (tmp_path / "data.txt").write_text("1")

    def command(code, **options):
        own = {"templates": {"in.py": code}, "files": [tmp_path / "data.txt"]} | options
        return mb.CommandSimulator([sys.executable, "in.py"], {"k": 1.0}, [0.0], ["x"], **own).identity()

    first = command("{k}")
    assert first == command("{k}", timeout=3)
    assert first not in (command("{k} "), command("{k}", environment={"A": "1"}))
    (tmp_path / "data.txt").write_text("2")
    assert first != command("{k}")


SCENE_KEY = """
import symmb as mb
from models import double_pendulum
scene = double_pendulum.scene().with_times([0.0, 0.5])
for solver in mb.DormandPrince(rtol=1e-10), mb.DormandPrince(rtol=1e-9):
    print(mb.DAESimulator(scene, solver).identity())
"""


def test_scenes_are_known_in_other_processes(path):
    scene = double_pendulum.scene().with_times([0.0, 0.5])
    told = subprocess.run([sys.executable, "-c", SCENE_KEY], capture_output=True, text=True, check=True).stdout.split()
    made = mb.DAESimulator(scene, mb.DormandPrince(rtol=1e-10))
    assert told[0] == made.identity() != told[1]
    stored = mb.StoredSimulator(made, path)
    first = bounded(mb.Scanning(3), stored, scene.box)
    assert bits(bounded(mb.Scanning(3), stored, scene.box)) == bits(first)
    assert np.abs(bounded(mb.Scanning(3), made, scene.box).upper - first.upper).max() < 1e-8


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("pool", [ThreadPoolExecutor, ProcessPoolExecutor])
def test_executors_store_the_same(pool, stored):
    plain = bounded(mb.MonteCarlo(60), simulator(response), BOX)
    assert bits(bounded(mb.MonteCarlo(60), stored, BOX, executor=pool(2))) == bits(plain)


STUDY = """
import sys, time, warnings
import numpy as np
import symmb as mb
from symmb.bound.reductions import bounded

warnings.simplefilter("ignore")
TIMES = np.linspace(0.0, 1.0, 11)

def response(a, b):
    with open(sys.argv[2], "a") as calls:
        calls.write(f"{a!r} {b!r}\\n")
    time.sleep(0.002)
    return np.column_stack([np.exp(-a * TIMES), np.sin(b * TIMES)])

f = mb.FunctionSimulator(response, {"a": 1.0, "b": 1.0}, TIMES, ["x", "y"])
bounds = bounded(mb.MonteCarlo(400), mb.StoredSimulator(f, sys.argv[1]), mb.Box(a=(0.5, 1.5), b=(0.8, 1.2)))
bounds.save(sys.argv[3])
"""


def test_a_killed_study_goes_on_where_it_stopped(tmp_path):
    (tmp_path / "study.py").write_text(STUDY)

    def study(name):
        paths = (tmp_path / part for part in ("study.py", f"{name}.db", f"{name}.txt", f"{name}.npz"))
        return [sys.executable, *map(str, paths)]

    subprocess.run(study("whole"), check=True)
    calls = tmp_path / "killed.txt"
    for share in (0.3, 0.6, 0.9):
        process = subprocess.Popen(study("killed"))
        while not calls.exists() or len(calls.read_text().splitlines()) < share * 400:
            time.sleep(0.005)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        assert asked(tmp_path / "killed.db", "PRAGMA integrity_check") == "ok"
    subprocess.run(study("killed"), check=True)
    made = calls.read_text().splitlines()
    assert len(set(made)) == 400 and len(made) <= 403  # the run in flight of each kill
    assert bits(mb.Bounds.load(tmp_path / "killed.npz")) == bits(mb.Bounds.load(tmp_path / "whole.npz"))


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("seed", range(20))
def test_a_damaged_store_is_told_or_gives_the_same_bounds(seed):
    """In a larger number: tests/benchmarks/kill_studies.py damaged."""
    assert ":" not in kill_studies.damaged_store(7000 + seed)


DAMAGES = {
    "other value": f"UPDATE runs SET response = x'{np.full(3, 0.5).tobytes().hex()}' WHERE rowid = 3",
    "not finite": f"UPDATE runs SET response = x'{np.full(3, np.nan).tobytes().hex()}' WHERE rowid = 3",
    "exchanged": "UPDATE runs SET response = (SELECT response FROM runs WHERE rowid = 4) WHERE rowid = 3",
    "not failed": "UPDATE runs SET state = 0 WHERE state = 1",
    "no text": "UPDATE studies SET simulator = CAST(x'ff00fe' AS TEXT)",
    "view": kill_studies.TABLES[3],
    "view without end": kill_studies.TABLES[4],
}


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("statement", DAMAGES.values(), ids=DAMAGES)
def test_what_was_not_written_by_symmb_is_damage(statement, path, capsys):
    kill_studies.stored_study(path)
    change(path, statement)
    if "simulator" not in statement:
        with told_in_a_line("is damaged"):
            kill_studies.stored_study(path)
    if "runs SET" not in statement:
        assert main(["runs", str(path)]) == 2
        assert "is damaged" in capsys.readouterr().err


VERSION_2 = """
CREATE TABLE former AS SELECT id, digest, simulator, parameters, outputs, times, begun FROM studies;
CREATE TABLE former_runs AS SELECT study, sample, state, t_failed, reason, response, events, seconds FROM runs;
DROP TABLE runs;
DROP TABLE studies;
CREATE TABLE studies (
    id INTEGER PRIMARY KEY, digest TEXT UNIQUE NOT NULL, simulator TEXT NOT NULL, parameters TEXT NOT NULL,
    outputs TEXT NOT NULL, times BLOB NOT NULL, begun TEXT NOT NULL);
CREATE TABLE runs (
    study INTEGER NOT NULL REFERENCES studies(id), sample BLOB NOT NULL, state INTEGER NOT NULL, t_failed REAL,
    reason TEXT NOT NULL, response BLOB NOT NULL, events BLOB, seconds REAL NOT NULL, UNIQUE (study, sample));
INSERT INTO studies SELECT * FROM former;
INSERT INTO runs SELECT * FROM former_runs;
DROP TABLE former;
DROP TABLE former_runs;
PRAGMA user_version = 2;
"""


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_files_of_version_2_are_taken_over(path):
    made, calls = counting()
    stored = mb.StoredSimulator(made, path)
    first = bounded(mb.Scanning(3), stored, BOX)
    change(path, VERSION_2)
    assert bits(bounded(mb.Scanning(3), stored, BOX)) == bits(first) and len(calls) == 9


def test_two_studies_at_once_lose_nothing(stored):
    P = np.random.default_rng(0).uniform(0.5, 1.2, (120, 2))
    with ThreadPoolExecutor(2) as pool:
        both = list(pool.map(lambda part: run_blocks(stored, part), (P[:80], P[40:])))
    assert both[0].Y[40:].tobytes() == both[1].Y[:40].tobytes()
    assert run_blocks(stored, P).Y.tobytes() == run_blocks(simulator(response), P).Y.tobytes()


def test_what_has_no_identity_and_a_store_of_a_store_are_refused(stored, tmp_path):
    plain = SimpleNamespace(parameters={"a": 1.0}, times=TIMES, outputs=("x",))
    refused("has no method identity", mb.StoredSimulator, plain, tmp_path / "runs.db")
    refused("is already a StoredSimulator", mb.StoredSimulator, stored, tmp_path / "other.db")


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_symmb_runs(path, stored, tmp_path, capsys):
    bounded(mb.Scanning(3), stored, BOX)
    assert main(["runs", str(path)]) == 0
    titles, row = capsys.readouterr().out.splitlines()
    assert titles.split() == ["study", "simulator", "begun", "done", "failed", "timed", "out", "lost", "parameters"]
    assert row.split()[-6:] == ["8", "1", "0", "0", "a,", "b"]
    xarray = pytest.importorskip("xarray")
    assert main(["runs", str(path), "--export", str(tmp_path / "runs.nc")]) == 0
    with xarray.open_dataset(tmp_path / "runs.nc") as data:
        assert data.response.shape == (9, 11, 2) and int(data.ok.sum()) == 8
        k = int(np.flatnonzero((data.a == 0.5) & (data.b == 0.8))[0])
        np.testing.assert_array_equal(data.response[k].values, response(0.5, 0.8))
    capsys.readouterr()
    assert main(["runs", str(path), "--prune", "failed"]) == 0
    assert "1 runs removed" in capsys.readouterr().out
    made, calls = counting(simulator(response).identity())
    bounded(mb.Scanning(3), mb.StoredSimulator(made, path), BOX)
    assert calls == [(1.5, 1.2)]


TAKEN = [("time", "output"), ("response", "ok"), ("=", "sample"), ("a/b", "a_b"), ("a_b", "a/b")]
FOREIGN = [("1 k", "ä μ"), ("_", "-"), ("Κ", "ω"), ("日本", "x²")]


@pytest.mark.parametrize("names", TAKEN + FOREIGN, ids=repr)
def test_runs_are_exported_whatever_parameters_are_called(names, tmp_path, capsys):
    xarray = pytest.importorskip("xarray")
    f = mb.FunctionSimulator(lambda **values: sum(values.values()) * TIMES, dict.fromkeys(names, 1.0), TIMES, ["x"])
    P = np.array([[1.0, 2.0], [3.0, 5.0], [4.0, 7.0]])
    mb.StoredSimulator(f, tmp_path / "runs.db").run(P)
    assert main(["runs", str(tmp_path / "runs.db"), "--export", str(tmp_path / "runs.nc")]) == 0
    with xarray.open_dataset(tmp_path / "runs.nc") as data:
        assert data.response.dims == ("sample", "time", "output") and data.attrs["parameters"].split("\n") == [*names]
        np.testing.assert_array_equal(data.time.values, TIMES)
        found = [data[name] for name in data.coords if data[name].dims == ("sample",)]
        assert {f.long_name: tuple(f.values) for f in found} == dict(zip(names, map(tuple, P.T), strict=True))
    capsys.readouterr()


class Dies:
    """A function that kills its process, or takes long, while a file says so."""

    def __init__(self, path):
        self.path = path

    def __call__(self, a, b):
        told = self.path.read_text()
        if told == "die" and a > 1:
            os.kill(os.getpid(), signal.SIGKILL)
        if told == "wait":
            time.sleep(0.3)
        return response(a, b)


def test_lost_runs_are_made_again(path, tmp_path):
    (tmp_path / "how").write_text("die")
    stored = mb.StoredSimulator(simulator(Dies(tmp_path / "how")), path)
    P = np.array([[0.5, 1.0], [1.2, 1.0]])
    assert run_blocks(stored, P, lambda: ProcessPoolExecutor(1)).ok.tolist() == [True, False]
    (tmp_path / "how").write_text("")
    assert run_blocks(stored, P).ok.all()
    assert main(["runs", str(path), "--prune", "failed"]) == 0


@pytest.mark.parametrize(("timeout", "calls"), [(0.1, 0), (0.05, 0), (2.0, 1), (10.0, 1), (None, 1)])
def test_runs_that_timed_out_are_made_again_with_more_time(timeout, calls, tmp_path, capsys):
    def stored(timeout):
        return mb.StoredSimulator(simulator(Dies(tmp_path / "how"), timeout=timeout), tmp_path / "runs.db")

    (tmp_path / "how").write_text("wait")
    P = np.array([[0.5, 1.0]])
    assert not stored(0.1).run(P).ok.any()
    (tmp_path / "how").write_text("")
    assert stored(timeout).run(P).ok.sum() == calls
    assert main(["runs", str(tmp_path / "runs.db"), "--prune", "timed-out"]) == 0
    assert f"{1 - calls} runs removed" in capsys.readouterr().out


def test_a_store_that_cannot_be_written_is_read_and_listed(path, stored, monkeypatch, capsys):
    P = np.array([[0.6, 0.9], [1.0, 1.1]])
    known = run_blocks(stored, P)
    monkeypatch.setattr(run_database, "_is_writable", lambda path: False)
    stored = mb.StoredSimulator(simulator(response), path)
    assert run_blocks(stored, P).Y.tobytes() == known.Y.tobytes()
    assert main(["runs", str(path)]) == 0
    assert capsys.readouterr().out.splitlines()[1].split()[-6:] == ["2", "0", "0", "0", "a,", "b"]
    refused(r"runs\.db cannot be written: .*readonly", run_blocks, stored, P + 0.01, error=mb.SimulationError)
    assert os.listdir(path.parent) == ["runs.db"]


@pytest.mark.parametrize("is_new", [True, False])
def test_the_lock_of_another_program_is_told_soon(is_new, path, stored, monkeypatch):
    monkeypatch.setattr(run_database, "_WAIT_AT_FIRST", 0.05)
    if not is_new:
        run_blocks(stored, np.array([[0.6, 0.9]]))
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("PRAGMA locking_mode = EXCLUSIVE")
        other.execute("BEGIN EXCLUSIVE")
        locked = r"runs\.db is locked by another program"
        refused(locked, run_blocks, stored, np.array([[0.7, 0.9]]), error=mb.SymmbError)


@pytest.mark.parametrize("is_held_before", [True, False])
def test_a_lock_that_lets_read_is_told_by_a_study_that_needs_runs(is_held_before, tmp_path, monkeypatch):
    """Before it makes runs, or where it writes the first one."""
    monkeypatch.setattr(run_database, "_WAIT_AT_FIRST" if is_held_before else "_WAIT_AFTER_RUN", 0.05)
    calls, path = [], tmp_path / "runs.db"

    def f(a):
        calls.append(a)
        if not is_held_before and len(calls) == 2:
            other.execute("BEGIN IMMEDIATE")
        return [a]

    stored = mb.StoredSimulator(mb.FunctionSimulator(f, {"a": 1.0}, [0.0], ["y"]), path, version="1")
    run_blocks(stored, np.array([[0.5]]))
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        if is_held_before:
            other.execute("BEGIN IMMEDIATE")
        assert run_blocks(stored, np.array([[0.5]])).Y[0, 0, 0] == 0.5  # which need write nothing
        locked = r"runs\.db is locked by another program\. Try again"
        refused(locked, run_blocks, stored, np.array([[0.5], [0.7]]), error=mb.SimulationError)
    assert len(calls) == (1 if is_held_before else 2)


def test_studies_that_make_a_store_at_once_wait_for_each_other(tmp_path):
    """SQLite does not wait where the journal of a file is chosen."""
    barrier = threading.Barrier(4)

    def study(k):
        barrier.wait()
        with open_run_database(tmp_path / f"{k // 4}.db"):
            pass

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(study, range(40)))


def test_methods_as_jobs_fill_the_store_of_a_comparison(tmp_path, monkeypatch):
    submitit, _ = pytest.importorskip("submitit"), pytest.importorskip("distributed")
    monkeypatch.syspath_prepend(EXAMPLES)
    monkeypatch.setenv("PYTHONPATH", ":".join([str(EXAMPLES), *filter(None, sys.path)]))
    import cluster

    methods = cluster.METHODS[:1]  # two jobs write at once; examples/cluster.py has four
    jobs = submitit.AutoExecutor(tmp_path / "logs", cluster="local")
    numbers = [0, len(cluster.METHODS)]
    results = [job.result() for job in jobs.map_array(cluster.bounds_by, numbers, [tmp_path] * 2)]
    made = asked(tmp_path / "runs.db", "SELECT count(*) FROM runs")
    found = mb.compare(cluster.stored(tmp_path), methods, cluster.BOX, results[-1])
    assert asked(tmp_path / "runs.db", "SELECT count(*) FROM runs") == made > 289
    own = mb.FunctionSimulator(cluster.swing, {"mass": 1.0, "stiffness": 10.0}, cluster.TIMES, ["x"])
    plain = mb.compare(own, methods, cluster.BOX, cluster.REFERENCE)
    for row, other in zip(found.rows, plain.rows, strict=True):
        np.testing.assert_array_equal(row.score.error, other.score.error)
