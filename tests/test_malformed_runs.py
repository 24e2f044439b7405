"""Malformed stores, and commands about them: each is told in one sentence, and nothing is lost."""

import os
import resource
import sqlite3
import tempfile
from pathlib import Path

import numpy as np
import pytest
from faults import refused

import symmb as mb
from symmb.connect import run_database
from symmb.show.cli.main import main

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
    assert main(["runs", str(folder / "runs.db")]) == 2
    assert is_sentence(capsys.readouterr().err.strip())


COMMANDS = [
    ["runs", ""], ["runs", "."], ["runs", "x" * 300], ["runs", "empty.db"], ["runs", "runs.db/runs.db"],
    ["runs", "runs.db", "--study", "0"], ["runs", "runs.db", "--export", ""],
    ["runs", "runs.db", "--export", "out.csv"], ["runs", "runs.db", "--export", "no/folder/out.nc"],
    ["runs", "runs.db", "--study", "x"], ["runs", "runs.db", "--prune", "some"], ["runs", "runs.db", "--study"],
    ["runs", "runs.db", "--keep"], ["runs"],
]  # fmt: skip
TOLD = [
    (["runs", "no_such.db"], "does not exist"),
    (["runs", "text.db"], "is not a run store"),
    (["runs", "runs.db", "--study", "7"], "no study 7"),
    (["runs", "runs.db", "--export", "runs.xls"], ".nc"),
]


@pytest.mark.parametrize(("arguments", "text"), [*((words, "") for words in COMMANDS), *TOLD])
def test_commands(arguments, text, folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    Path("empty.db").touch()
    Path("text.db").write_text("time,x")
    before = Path("runs.db").read_bytes()
    try:
        status = main(arguments)
    except SystemExit as end:
        status = end.code
    error = capsys.readouterr().err.strip()
    assert status == 2 and is_sentence(error) and text in error
    assert Path("runs.db").read_bytes() == before and not Path("empty.db").stat().st_size


def test_a_full_disk_keeps_what_was_written(folder):
    plain = mb.propagate(mb.FunctionSimulator(decay, {"k": 1.0}, TIMES, ["x"]), mb.MonteCarlo(400), BOX)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (90_000, limits[1]))  # of a file
    try:
        with pytest.raises(mb.SimulationError, match=r"cannot be written.* Earlier entries are kept") as error:
            study(folder / "runs.db", 400)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert is_sentence(str(error.value))
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
