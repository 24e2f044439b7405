"""CommandSimulator: a program of C in folders of its own, with all that may go wrong with it."""

import gc
import os
import sys
import time
from pathlib import Path

import external_program
import numpy as np
import pytest
from faults import refused
from numpy.testing import assert_allclose
from processes import in_time, runs

import symmb as mb


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    made = external_program.compiled(tmp_path_factory.mktemp("program"))
    if made is None:
        pytest.skip("needs a C compiler")
    return made


def simulator(program, **options):
    box = external_program.BOX
    nominal = dict(zip(box.names, box.center.tolist(), strict=True))
    templates = {"in.txt": " ".join(f"{name} = {{{name}}}" for name in nominal)}
    times, options = external_program.TIMES, {"timeout": 0.5} | options
    return mb.CommandSimulator([program], nominal, times, ["x", "y"], templates, **options)


def script(code, outputs=("x",), parameters=None, **options):
    """A simulator of a Python script."""
    parameters = {"k": 2.0} if parameters is None else parameters
    templates = {"in.py": code} | options.pop("templates", {})
    return mb.CommandSimulator([sys.executable, "in.py"], parameters, [0, 1], outputs, templates, **options)


def is_sentence(text):
    return text.isprintable() and text[-1] in ".)'" and "Traceback" not in text


def only_message(simulator, k=1.0):
    """Of the only run of a simulator, which fails."""
    (message,) = simulator.run(np.array([[k]])).messages
    return message


WRITE = "open('out.csv', 'w').write(f'time,x\\n0,0\\n1,{k!r}\\n')"
GOOD = "k = {k}\n" + WRITE


@pytest.mark.parametrize("method", [mb.PolynomialChaos(tolerance=1e-6, budget=60), mb.MonteCarlo(150), mb.Scanning(2)])
def test_failures_are_counted_and_located(program, method):
    finding = external_program.study(program, method, 0.4)
    assert not finding.faults and sum(finding.failed.values()) > 0


def test_folders_of_failed_runs_stay_and_are_told(program, tmp_path):
    P = np.array([1.0, 2.0, 0.5, 3.0]) + np.arange(100)[:, None] * [1e-6, 0, 0, 0]
    kinds = [external_program.truth(p) for p in P]
    P = P[[kinds.index("crash"), kinds.index("")]]
    ensemble = simulator(program, folder=tmp_path, keep="failed").run(P)
    assert ensemble.ok.tolist() == [False, True]
    (kept,) = tmp_path.iterdir()
    assert str(kept) in ensemble.messages[0]
    assert {path.name for path in kept.iterdir()} >= {"in.txt", "stdout.txt", "stderr.txt"}
    simulator(program, folder=tmp_path, keep="all").run(P)
    assert len(list(tmp_path.iterdir())) == 3


def test_arguments_are_filled_and_nothing_is_a_shell():
    code = "import sys; open('out.csv', 'w').write(f'time,x\\n0,0\\n1,{sys.argv[1]}\\n')"
    command = [sys.executable, "in.py", "{k:.4e}", "$(touch x); *"]
    told = mb.CommandSimulator(command, {"k": 1.0}, [0, 1], "x", {"in.py": code})
    assert told.run(np.array([[0.12345678]])).Y[0, 1, 0] == 0.12346


@pytest.mark.parametrize(
    ("k", "code", "read", "expected"),
    [
        (0.1 + 0.2, GOOD, "out.csv", [0, 0.1 + 0.2]),
        (0.1, "assert '{k:.3f}' == '0.100' and '{no}'[0] == '{' and '{k!s}'[1] == 'k'\n" + GOOD, "out.csv", [0, 0.1]),
        (3.0, "open('out.csv', 'w').write('time;x;more\\n0;1;7\\n1;{k};8\\n')", "out.csv", [1, 3]),
        (3.0, "import json; json.dump(dict(time=[0, 1], x=[1, {k}]), open('out.json', 'w'))", "out.json", [1, 3]),
        (3.0, "import numpy; numpy.savez('out.npz', time=[0, 1], x=[1, {k}])", "out.npz", [1, 3]),
        (3.0, "open('k', 'w').write('{k}')", lambda folder: [[0.0], [float((folder / "k").read_text())]], [0, 3]),
    ],
    ids=["all digits", "declared names alone", "csv", "json", "npz", "function"],
)
def test_templates_and_formats_of_results(k, code, read, expected):
    assert script(code, read=read).run(np.array([[k]])).Y[0, :, 0].tolist() == expected


def test_other_times_are_interpolated_only_if_asked():
    write = "open('out.csv', 'w').write('time,x\\n0,0\\n0.25,1\\n1.5,{k}\\n')"
    told = "out.csv has 3 times from 0 to 1.5 s, but 2 times from 0 to 1 s are declared"
    assert told in only_message(script(write, keep="none"), 6.0)
    assert_allclose(script(write, interpolate=True).run(np.array([[6.0]])).Y[0, :, 0], [0, 4])
    early = script(write.replace("1.5", "0.5"), interpolate=True, keep="none")
    assert "interpolation is only possible" in only_message(early, 6.0)


def test_what_fails_is_made_again(tmp_path):
    count = tmp_path / "count"
    code = f"n = len(open({str(count)!r}, 'a+').read()); open({str(count)!r}, 'a').write('1')\n"
    code += f"import os\nif os.path.getsize({str(count)!r}) < 3: raise SystemExit(1)\n" + GOOD
    assert script(code, retries=2).run(np.array([[1.0]])).ok.all()
    assert count.read_text() == "111"


def test_files_and_environment(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "offset.txt").write_text("5")
    code = "import os\nk = {k} + float(open('data/offset.txt').read()) + float(os.environ['MORE'])\n" + WRITE
    made = script(code, files=[tmp_path / "data"], environment={"MORE": "10"})
    assert made.run(np.array([[1.0]])).Y[0, 1, 0] == 16


def test_folders_with_links_that_lead_nowhere(tmp_path):
    folder = tmp_path / "data"
    folder.mkdir()
    (folder / "lost").symlink_to(tmp_path / "none")
    (folder / "here").write_text("1")
    assert script("{k}", files=[folder]).files == (folder,)


def test_programs_in_the_background_end_with_the_run():
    code = "import subprocess, sys; p = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(1000)'])\n"
    code += "open('out.csv', 'w').write(f'time,x\\n0,{p.pid}\\n1,0\\n')  # {k}"
    begin = time.monotonic()
    number = int(script(code).run(np.array([[1.0]])).Y[0, 0, 0])
    assert time.monotonic() - begin < 100
    assert in_time(lambda: not runs(number), 5)


def test_the_processes_of_unused_simulators_end_at_once():
    """Both threads of such a process clean up. Each waited half a second for the other."""
    used = [script(GOOD) for _ in range(8)]
    for made in used:
        made.run(np.array([[1.0]]))
    del made
    used.clear()
    gc.collect()
    begin = time.monotonic()
    script(GOOD).run(np.array([[1.0]]))
    assert time.monotonic() - begin < 1.5


DECLARATIONS = {
    ("command", "command must be a list"): ["solver in.txt", [], 3, ["in.py\0"], [sys.executable, "in.py", 3]],
    ("command", "is not found"): [[""], [os.sep]],
    ("command", "the program 'no_such_program' is not found"): [["no_such_program"]],
    ("environment", "environment must map names"): ["A=1", {"A": 1}, {"A=B": "1"}, {"A": "\0"}, np.array(["A", "B"])],
    ("files", "files must be a list of paths"): ["mesh.inp", [3]],
    ("files", "does not exist"): [["no_such_file"]],
    ("files", "is the name of two files"): [[__file__, __file__]],
    ("folder", "folder must be a path"): [3],
    ("folder", "does not exist"): ["no_such_folder"],
    ("folder", "is not a folder"): [__file__],
    ("interpolate", "interpolate must be True or False"): ["yes"],
    ("keep", "keep must be one of"): ["some", [], np.array(["all", "none"])],
    ("read", "must end in one of .csv, .json, .npz"): ["out.xls"],
    ("read", "read must be the name of a file"): [3],
    ("read", "in the folder of a run"): ["../out.csv", "/out.csv", ""],
    ("retries", "retries must be an integer"): [-1, 1.5, True],
    ("templates", "templates must map names of files"): [["{k}"], np.array(["A", "B"])],
    ("templates", "no template and no argument contains parameter 'k'"): [{"in.txt": "nothing"}],
    ("templates", "{k:d} is not a valid number format"): [{"in.txt": "{k:d}"}],
    ("templates", "is not a valid number format"): [{"in.py": "{k:>99999999999999999}"}],
    ("templates", "must be inside the folder"): [{name: "{k}"} for name in ("../in.txt", "/in.txt", ".", "x" * 300, 3)],
    ("templates", "cannot be read"): [{"in.txt": Path("no_such_file")}, {"in.py": Path(os.sep)}],
    ("templates", "expected a text or a Path"): [{"in.txt": 3}, {"in.py": "{k}\ud800"}],
    ("templates", "is the name of two files"): [{"stdout.txt": "{k}"}],
    ("templates", "needs a folder, but a file of the run has the name"): [{"a": "{k}", "a/b": "{k}"}],
    ("timeout", "timeout must be a number of seconds above 0"): [0, float("nan"), "5"],
}


@pytest.mark.parametrize(("option", "text"), DECLARATIONS)
def test_faults_of_a_declaration(option, text):
    for wrong in DECLARATIONS[option, text]:
        options = {"command": [sys.executable, "in.py"], "templates": {"in.py": "{k}"}} | {option: wrong}
        message = refused(None, mb.CommandSimulator, options.pop("command"), {"k": 1.0}, [0, 1], ["x"], **options)
        assert text in message and is_sentence(message)


def wrote(text, name="out.csv"):
    return f"open({name!r}, 'wb').write({text if isinstance(text, bytes) else text.encode()!r})"


RESULTS = [
    ("", "wrote no file 'out.csv'"),
    ("raise SystemExit('the mesh is torn')", "ended with exit status 1: the mesh is torn"),
    (wrote(""), "is empty"),
    (wrote("time,x\n"), "has no rows"),
    (wrote("x\n1\n2\n"), "no column 'time'"),
    (wrote("time,x\n0,1\n1\n"), "line 3 has 1 values for 2 columns"),
    (wrote(bytes(range(256))), "cannot be read"),
    (wrote("time,x\n0,0,1,5\n1,0,2,5\n"), "decimal commas"),
    (wrote("time,x\n0,1_0\n1,2\n"), "'1_0' is not a number"),
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
    ("import numpy as np; np.save(open('out.npz', 'wb'), [1, 2])", "must hold named arrays"),
    ("import numpy as np; np.savez('out.npz', time=[0, 1], x=np.array([None, 1]))", "cannot be read"),
]


@pytest.mark.parametrize(("code", "text"), RESULTS, ids=[text for _, text in RESULTS])
def test_what_a_program_may_do_wrong(code, text):
    read = next((name for name in ("out.json", "out.npz") if name in code), "out.csv")
    message = only_message(script(code + "  # {k}", read=read, timeout=20, keep="none"))
    assert text in message and is_sentence(message)


@pytest.mark.parametrize("form", ["{}", "--script={}"])
def test_files_in_arguments_are_known_by_their_contents(form, tmp_path):
    path = tmp_path / "m.sh"

    def identity(text):
        path.write_text(text)
        return mb.CommandSimulator(["/bin/sh", form.format(path), "{k}"], {"k": 1.0}, [0, 1], ["x"]).identity()

    assert identity("echo 1") == identity("echo 1") != identity("echo 2")


@pytest.mark.parametrize("how", ["files", "folder", "argument"])
def test_a_file_that_changes_ends_the_study(how, tmp_path):
    path = tmp_path / "data" / "k.txt"
    path.parent.mkdir()
    path.write_text("1")
    options = {"files": [path if how == "files" else path.parent]} if how != "argument" else {}
    command = [sys.executable, "in.py", *([str(path)] if how == "argument" else [])]
    made = mb.CommandSimulator(command, {"k": 1.0}, [0, 1], ["x"], {"in.py": GOOD}, folder=tmp_path, **options)
    store = mb.StoredSimulator(made, tmp_path / "runs.db")
    os.utime(path, ns=(1, 1))
    assert store.run(np.array([[1.0]])).ok.all()
    path.write_text("2")
    changed = "has changed since the simulator was declared"
    refused(changed, store.run, np.array([[1.0], [2.0]]), error=mb.SimulationError)
    assert not list(tmp_path.glob("symmb_run-*"))


@pytest.mark.parametrize("x", ["nan", "inf"])
def test_what_is_not_finite_is_made_again_and_kept(x, tmp_path):
    count = tmp_path / "count"
    code = f"open({str(count)!r}, 'a').write('1')\n" + GOOD.replace("{k!r}", x)
    message = only_message(script(code, retries=2, folder=tmp_path))
    (kept,) = tmp_path.glob("symmb_run-*")
    assert " is not finite at t = 1" in message and str(kept) in message and count.read_text() == "111"


def test_a_result_of_another_shape_is_kept_and_nothing_stays_of_good_runs(tmp_path):
    script(GOOD, folder=tmp_path).run(np.array([[1.0]]))
    assert not list(tmp_path.iterdir()) and os.getcwd() != str(tmp_path)
    message = only_message(script(GOOD, read=lambda folder: np.ones(7), folder=tmp_path))
    assert "the shape (7,)" in message and "symmb_run-" in message


def interpolated(rows):
    write = f"open('out.csv', 'w').write('time,x\\n{rows}')\n# {{k}}"
    return script(write, interpolate=True, keep="none")


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ("0,0\\n0.5,1\\n0.5,5\\n1,7\\n", [0, 7]),
        ("0,0\\n0,3\\n1,7\\n1,9\\n", [3, 9]),
        ("-1,nan\\n0,3\\n2,5\\n3,inf\\n", [3, 4]),
        ("-1,nan\\n0,3\\n1,5\\n3,inf\\n", [3, 5]),
        ("0,0\\n0.9999999,2\\n0.9999999,8\\n3,8\\n", [0, 8]),
    ],
)
def test_events_between_the_times(rows, expected):
    assert_allclose(interpolated(rows).run(np.array([[1.0]])).Y[0, :, 0], expected)


@pytest.mark.parametrize("row", ["0.5,nan", "0.2,inf", "0.999,-inf"])
def test_what_is_not_finite_between_the_times_fails(row):
    assert "is not finite" in only_message(interpolated(f"0,0\\n{row}\\n1,1\\n"))


def test_templates_keep_their_line_ends(tmp_path):
    (tmp_path / "in.txt").write_bytes(b"a\r\n{k}\r\n")
    code = "assert open('in.txt', 'rb').read() == b'a\\r\\n3.0\\r\\n'\n" + GOOD
    assert script(code, templates={"in.txt": tmp_path / "in.txt"}).run(np.array([[3.0]])).ok.all()


def test_columns_of_a_frame_are_taken_by_name():
    pandas = pytest.importorskip("pandas")

    def simulator(*names):
        read = lambda k: pandas.DataFrame({name: [k + ord(name)] for name in names})  # noqa: E731
        return mb.FunctionSimulator(read, {"k": 1.0}, [0.0], ["x", "y"])

    assert simulator("y", "x").run(np.array([[0.0]])).Y.tolist() == [[[ord("x"), ord("y")]]]
    assert "the columns ['x', 'z'], expected ['x', 'y']" in only_message(simulator("x", "z"), 0.0)
