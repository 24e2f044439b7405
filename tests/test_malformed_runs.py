"""Malformed commands, templates, results of programs, and stores: each is told in one sentence, and nothing is lost."""

import os
import resource
import sqlite3
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

import symmb as mb
from symmb.black_boxes import run_database
from symmb.cli.main import main

TIMES = np.linspace(0.0, 1.0, 11)
BOX = mb.Box(k=(0.5, 1.5))


def decay(k):
    return np.exp(-k * TIMES)


def is_sentence(text):
    return text.isprintable() and text[-1] in ".)'" and "Traceback" not in text


PROGRAM = [sys.executable, "in.py"]
DECLARATIONS = [
    ({"command": 3}, "command must be a list"),
    ({"command": [""]}, "is not found"),
    ({"command": [os.sep]}, "is not found"),
    ({"command": ["in.py\0"]}, "command must be a list"),
    ({"command": [*PROGRAM, 3]}, "command must be a list"),
    ({"timeout": float("nan")}, "timeout must be a number"),
    ({"timeout": "5"}, "timeout must be a number"),
    ({"retries": 1.5}, "retries must be an integer"),
    ({"environment": "A=1"}, "environment must be texts"),
    ({"environment": {"A": 1}}, "environment must be texts"),
    ({"environment": {"A=B": "1"}}, "environment must be texts"),
    ({"environment": {"A": "\0"}}, "environment must be texts"),
    ({"files": "mesh.inp"}, "files must be a list of paths"),
    ({"files": [3]}, "files must be a list of paths"),
    ({"files": [__file__, __file__]}, "is the name of two files"),
    ({"folder": 3}, "folder must be a path"),
    ({"folder": __file__}, "is no folder"),
    ({"read": "../out.csv"}, "in the folder of a run"),
    ({"read": "/out.csv"}, "in the folder of a run"),
    ({"read": ""}, "in the folder of a run"),
    ({"templates": {".": "{k}"}}, "inside the folder"),
    ({"templates": {"x" * 300: "{k}"}}, "inside the folder"),
    ({"templates": {3: "{k}"}}, "inside the folder"),
    ({"templates": {"stdout.txt": "{k}"}}, "is the name of two files"),
    ({"templates": {"a": "{k}", "a/b": "{k}"}}, "its folder has the name of a file"),
    ({"templates": {"in.py": Path(os.sep)}}, "cannot be read"),
    ({"templates": {"in.py": "{k:>99999999999999999}"}}, "is no format of a number"),
    ({"templates": {"in.py": "{k}\ud800"}}, "expected a text or a Path"),
    ({"interpolate": "yes"}, "interpolate must be True or False"),
    ({"keep": []}, "keep must be one of"),
    ({"keep": np.array(["all", "none"])}, "keep must be one of"),
    ({"environment": np.array(["A", "B"])}, "environment must be texts"),
    ({"templates": np.array(["A", "B"])}, "templates must be texts"),
    ({"retries": True}, "retries must be an integer"),
]


@pytest.mark.parametrize(("change", "text"), DECLARATIONS, ids=lambda part: part if isinstance(part, str) else "")
def test_declarations(change, text):
    options = {"command": PROGRAM, "templates": {"in.py": "{k}"}} | change
    with pytest.raises(mb.DeclarationError) as error:
        mb.CommandSimulator(options.pop("command"), {"k": 1.0}, [0, 1], ["x"], **options)
    assert text in str(error.value) and is_sentence(str(error.value))


def test_folders_with_links_that_lead_nowhere(tmp_path):
    folder = tmp_path / "data"
    folder.mkdir()
    (folder / "lost").symlink_to(tmp_path / "none")
    (folder / "here").write_text("1")
    made = mb.CommandSimulator(PROGRAM, {"k": 1.0}, [0, 1], ["x"], {"in.py": "{k}"}, files=[folder])
    assert made.files == (folder,)


def wrote(text, name="out.csv"):
    return f"open({name!r}, 'wb').write({text if isinstance(text, bytes) else text.encode()!r})"


RESULTS = [
    (wrote("time,x,x\n0,1,2\n1,3,4\n"), "two columns 'x'"),
    (wrote("Time,X\n0,1\n1,3\n"), "no column 'x', only 'Time', 'X'"),
    (wrote("time,x\nnan,1\nnan,2\n"), "times from nan to nan s"),
    (wrote("time;x\n0;1,5\n1;2,5\n"), "convert string to float: '1,5'"),
    (wrote("time,x\n0,\0\n1,2\n"), "cannot be read"),
    (wrote("time,x\n0,1\n1,2\n".encode("utf-16")), "cannot be read"),
    (wrote(b"time,x\n0," + b"1" * 200_000), "cannot be read"),
    ("import os; os.mkdir('out.csv')", "wrote no file"),
    ("import os; os.mkfifo('out.csv')", "wrote no file"),
    ("import os; os.symlink('/dev/zero', 'out.csv')", "wrote no file"),
    ("import os, shutil; shutil.rmtree(os.getcwd())", "wrote no file"),
    ("import sys; sys.exit('\\x1b[31mred \\x07')", "exit status 1: [31mred"),
    (wrote("3", "out.json"), "an object with a list"),
    (wrote("[" * 100_000, "out.json"), "cannot be read"),
    (wrote('{"time": [0, 1], "x": [[1, 2], [3, 4]]}', "out.json"), "'x' must be a list of real numbers"),
    (wrote('{"time": [0, 1], "x": [1]}', "out.json"), "2 times, but 1 values"),
    ("import numpy as np; np.savez('out.npz', time=[0, 1], x=[1j, 2])", "'x' must be a list of real numbers"),
    ("import numpy as np; np.save(open('out.npz', 'wb'), [1, 2])", "must hold arrays with names"),
    ("import numpy as np; np.savez('out.npz', time=[0, 1], x=np.array([None, 1]))", "cannot be read"),
]


@pytest.mark.parametrize(("code", "text"), RESULTS, ids=[text for _, text in RESULTS])
def test_results(code, text):
    read = next((name for name in ("out.json", "out.npz") if name in code), "out.csv")
    templates = {"in.py": code + "  # {k}"}
    made = mb.CommandSimulator(PROGRAM, {"k": 1.0}, [0, 1], ["x"], templates, read, timeout=20, keep="none")
    (message,) = made.run(np.array([[1.0]])).messages
    assert text in message and is_sentence(message)


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
    with pytest.raises((mb.DeclarationError, mb.SimulationError)) as error:
        study(path)
    assert str(path) in str(error.value) and is_sentence(str(error.value))
    assert not path.is_file() or path.stat().st_size >= len(kept)


@pytest.mark.parametrize("name", LISTS)
def test_lists_of_stores(name, folder, capsys):
    LISTS[name](folder / "runs.db")
    assert main(["runs", str(folder / "runs.db")]) == 2
    assert is_sentence(capsys.readouterr().err.strip())


COMMANDS = [
    ["runs", ""],
    ["runs", "."],
    ["runs", "no_such.db"],
    ["runs", "x" * 300],
    ["runs", "empty.db"],
    ["runs", "runs.db/runs.db"],
    ["runs", "runs.db", "--study", "0"],
    ["runs", "runs.db", "--export", ""],
    ["runs", "runs.db", "--export", "out.csv"],
    ["runs", "runs.db", "--export", "no/folder/out.nc"],
    ["runs", "runs.db", "--study", "x"],
    ["runs", "runs.db", "--prune", "some"],
    ["runs", "runs.db", "--study"],
    ["runs", "runs.db", "--keep"],
    ["runs"],
]


@pytest.mark.parametrize("arguments", COMMANDS, ids=lambda words: " ".join(words[1:])[:40])
def test_commands(arguments, folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    Path("empty.db").touch()
    before = Path("runs.db").read_bytes()
    try:
        status = main(arguments)
    except SystemExit as end:
        status = end.code
    assert status == 2 and is_sentence(capsys.readouterr().err.strip())
    assert Path("runs.db").read_bytes() == before and not Path("empty.db").stat().st_size


def test_a_full_disk_keeps_what_was_written(folder):
    plain = mb.propagate(mb.FunctionSimulator(decay, {"k": 1.0}, TIMES, ["x"]), mb.MonteCarlo(400), BOX)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (90_000, limits[1]))  # of a file
    try:
        with pytest.raises(mb.SimulationError, match=r"cannot be written.* What was written before is kept") as error:
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
            with pytest.raises(mb.DeclarationError) as error:
                study(each)
            assert str(each) in str(error.value) and is_sentence(str(error.value))
    finally:
        os.seteuid(0)
    assert study(path).evaluations == 40


def test_a_store_that_another_program_holds(folder, monkeypatch, capsys):
    monkeypatch.setattr(run_database, "_WAIT", 0.1)
    other = sqlite3.connect(folder / "runs.db", isolation_level=None)
    other.execute("BEGIN EXCLUSIVE")
    with pytest.raises(mb.SimulationError, match="database is locked"):
        study(folder / "runs.db")
    assert main(["runs", str(folder / "runs.db"), "--prune", "all"]) in (1, 2)
    assert is_sentence(capsys.readouterr().err.strip())
    other.execute("ROLLBACK")
    other.close()
    assert study(folder / "runs.db").evaluations == 40


@pytest.mark.parametrize(
    "path", [3, None, b"runs.db", "", "a\0b", "no/such/folder/runs.db", "/proc/runs.db", "x" * 300]
)
def test_paths_of_stores(path):
    with pytest.raises(mb.DeclarationError) as error:
        study(path)
    assert is_sentence(str(error.value))
