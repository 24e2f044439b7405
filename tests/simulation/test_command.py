"""CommandSimulator: a program of C in folders of its own, with all that may go wrong with it."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import symmb as mb

TIMES = np.linspace(0.0, 2.0, 5)
NOMINAL = {"a": 1.0, "b": 2.0, "c": 0.5, "d": 3.0}
CODE = """
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>
/* Reads a, b, c, d; writes x = a exp(-c t) and y = b sin(d t). What fails looks like chance. */
int main(void) {
    double a, b, c, d;
    FILE *in = fopen("in.txt", "r");
    if (!in || fscanf(in, "a = %lf b = %lf c = %lf d = %lf", &a, &b, &c, &d) != 4) return 7;
    int kind = (int)floor(fabs(sin(12.3e3 * a + 4.56e3 * b + 789 * c + 1.01e3 * d)) * 1e4) % 100;
    if (kind < 5) abort();
    if (kind < 7) { if (fork() == 0) sleep(1000); sleep(1000); }
    FILE *out = fopen("out.csv", "w");
    if (kind < 8) { fputs("time,x,y\\n0,what,is this\\n", out); fclose(out); return 0; }
    fputs("time,x,y\\n", out);
    for (int i = 0; i < 5; i++) {
        double t = 0.5 * i;
        fprintf(out, "%.17g,%.17g,%.17g\\n", t, a * exp(-c * t), a > 1.09 && b > 2.15 ? NAN : b * sin(d * t));
    }
    return fclose(out);
}
"""


def kinds(P):
    """Which failure the program has, 8 and above: none."""
    return np.floor(np.abs(np.sin(P @ [12.3e3, 4.56e3, 789, 1.01e3])) * 1e4).astype(int) % 100


def fails(P):
    return (kinds(P) < 8) | ((P[:, 0] > 1.09) & (P[:, 1] > 2.15))


def closed_form(P):
    a, b, c, d = (column[:, None] for column in P.T)
    return np.stack([a * np.exp(-c * TIMES), b * np.sin(d * TIMES)], axis=2)


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("needs a C compiler")
    folder = tmp_path_factory.mktemp("program")
    (folder / "model.c").write_text(CODE)
    subprocess.run([compiler, "-O1", "-o", folder / "model", folder / "model.c", "-lm"], check=True)
    return folder / "model"


def simulator(program, **options):
    template = " ".join(f"{name} = {{{name}}}" for name in NOMINAL)
    options = {"templates": {"in.txt": template}, "timeout": 0.5, "keep": "none"} | options
    return mb.CommandSimulator([program], NOMINAL, TIMES, ["x", "y"], **options)


def script(code, outputs=("x",), parameters=None, **options):
    """A simulator of a Python script."""
    parameters = {"k": 2.0} if parameters is None else parameters
    templates = {"in.py": code} | options.pop("templates", {})
    return mb.CommandSimulator([sys.executable, "in.py"], parameters, [0, 1], outputs, templates, **options)


WRITE = "open('out.csv', 'w').write(f'time,x\\n0,0\\n1,{k!r}\\n')"


GOOD = "k = {k}\n" + WRITE


def left_processes(program):
    """Processes of the program that still run."""
    left = []
    for entry in Path("/proc").glob("[0-9]*/exe"):
        try:
            if entry.resolve() == program.resolve():
                left.append(entry.parent.name)
        except OSError:
            continue
    return left


@pytest.mark.slow
def test_failures_are_counted_and_located(program):
    rng = np.random.default_rng(0)
    P = np.column_stack([rng.uniform(0.9, 1.1, 200), rng.uniform(1.8, 2.2, 200), np.full(200, 0.5), np.full(200, 3.0)])
    expected = fails(P)
    assert 10 < expected.sum() < 60
    ensemble = simulator(program).run(P)
    assert (ensemble.ok == ~expected).all()
    assert_allclose(ensemble.Y[~expected], closed_form(P[~expected]), rtol=1e-15)
    for message, number in zip(ensemble.messages, kinds(P[expected]), strict=True):
        told = ["SIGABRT"] * 5 + ["had not ended after 0.5 s"] * 2 + ["cannot be read"]
        assert (told[number] if number < 8 else "not finite at t = ") in message
    assert not left_processes(program)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize("method", [mb.PolynomialChaos(budget=60), mb.MonteCarlo(60), mb.Scanning(2)])
def test_methods_finish(program, method):
    bounds = mb.propagate(simulator(program), method, mb.Box(a=(0.9, 1.1), b=(1.8, 2.2), c=(0.4, 0.6), d=(2.9, 3.1)))
    assert fails(np.array([[failure.parameters[name] for name in NOMINAL] for failure in bounds.failed])).all()
    assert bounds.doubts if bounds.failed else not bounds.doubts
    assert not left_processes(program)


def test_folders_of_failed_runs_stay_and_are_told(program, tmp_path):
    P = np.array([1.0, 2.0, 0.5, 3.0]) + np.arange(100)[:, None] * [1e-6, 0, 0, 0]
    P = np.array([P[kinds(P) < 5][0], P[kinds(P) > 8][0]])
    ensemble = simulator(program, folder=tmp_path, keep="failed").run(P)
    assert ensemble.ok.tolist() == [False, True]
    (kept,) = tmp_path.iterdir()
    assert str(kept) in ensemble.messages[0]
    assert {path.name for path in kept.iterdir()} >= {"in.txt", "stdout.txt", "stderr.txt"}
    simulator(program, folder=tmp_path, keep="all").run(P)
    assert len(list(tmp_path.iterdir())) == 3


def test_templates_replace_declared_names_alone():
    code = "assert '{k:.3f}' == '0.100' and '{other}'[0] == '{' and '{k!s}'[1] == 'k'\n" + GOOD
    assert script(code).run(np.array([[0.1]])).Y[0, 1, 0] == 0.1


def test_arguments_are_filled_and_nothing_is_a_shell():
    code = "import sys; open('out.csv', 'w').write(f'time,x\\n0,0\\n1,{sys.argv[1]}\\n')"
    command = [sys.executable, "in.py", "{k:.4e}", "$(touch x); *"]
    told = mb.CommandSimulator(command, {"k": 1.0}, [0, 1], "x", {"in.py": code})
    assert told.run(np.array([[0.12345678]])).Y[0, 1, 0] == 0.12346


def test_all_digits_arrive():
    value = 0.1 + 0.2
    assert script(GOOD).run(np.array([[value]])).Y[0, 1, 0] == value


@pytest.mark.parametrize("suffix", [".csv", ".json", ".npz"])
def test_formats_of_results(suffix):
    write = {
        ".csv": "open('out.csv', 'w').write('time;x;more\\n0;1;7\\n1;{k};8\\n')",
        ".json": "import json; json.dump(dict(time=[0, 1], x=[1, {k}]), open('out.json', 'w'))",
        ".npz": "import numpy; numpy.savez('out.npz', time=[0, 1], x=[1, {k}])",
    }[suffix]
    assert script(write, read=f"out{suffix}").run(np.array([[3.0]])).Y[0, :, 0].tolist() == [1, 3]


def test_a_function_reads_the_folder():
    def read(folder):
        return np.array([[0.0], [json.loads((folder / "k.json").read_text())]])

    assert script("open('k.json', 'w').write('{k}')", read=read).run(np.array([[3.0]])).Y[0, 1, 0] == 3


def test_other_times_are_interpolated_only_if_asked():
    write = "open('out.csv', 'w').write('time,x\\n0,0\\n0.25,1\\n1.5,{k}\\n')"
    (message,) = script(write, keep="none").run(np.array([[6.0]])).messages
    assert "out.csv has 3 times from 0 to 1.5 s, but 2 times from 0 to 1 s are declared" in message
    assert_allclose(script(write, interpolate=True).run(np.array([[6.0]])).Y[0, :, 0], [0, 4])
    early = "open('out.csv', 'w').write('time,x\\n0,0\\n0.25,1\\n0.5,{k}\\n')"
    (message,) = script(early, interpolate=True, keep="none").run(np.array([[6.0]])).messages
    assert "nothing is known beyond" in message


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


def test_programs_in_the_background_end_with_the_run():
    code = "import subprocess, sys; p = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(1000)'])\n"
    code += "open('out.csv', 'w').write(f'time,x\\n0,{p.pid}\\n1,0\\n')  # {k}"
    begin = time.monotonic()
    number = int(script(code).run(np.array([[1.0]])).Y[0, 0, 0])
    assert time.monotonic() - begin < 100
    for _ in range(50):
        if not _runs(number):
            return
        time.sleep(0.1)
    pytest.fail("it still runs")


def _runs(number):
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"command": "solver in.txt"}, "command must be a list"),
        ({"command": []}, "command must be a list"),
        ({"command": ["no_such_program"]}, "the program 'no_such_program' is not found"),
        ({"templates": {"in.txt": "nothing"}}, "parameter 'k' stands in no template"),
        ({"templates": {"in.txt": "{k:d}"}}, "{k:d} is no format of a number"),
        ({"templates": {"../in.txt": "{k}"}}, "must be inside the folder"),
        ({"templates": {"/in.txt": "{k}"}}, "must be inside the folder"),
        ({"templates": {"in.txt": Path("no_such_file")}}, "cannot be read"),
        ({"templates": {"in.txt": 3}}, "expected a text or a Path"),
        ({"templates": ["{k}"]}, "templates must be texts or paths by"),
        ({"files": ["no_such_file"]}, "does not exist"),
        ({"read": "out.xls"}, "must end in one of .csv, .json, .npz"),
        ({"read": 3}, "read must be the name of a file"),
        ({"timeout": 0}, "timeout must be a number of seconds above 0"),
        ({"keep": "some"}, "keep must be one of"),
        ({"folder": "no_such_folder"}, "does not exist"),
        ({"retries": -1}, "retries"),
    ],
)
def test_faults_of_a_declaration(change, text):
    options = {"command": [sys.executable, "in.txt"], "templates": {"in.txt": "{k}"}} | change
    command = options.pop("command")
    with pytest.raises(mb.DeclarationError, match=text.replace("{", r"\{").replace("}", r"\}")):
        mb.CommandSimulator(command, {"k": 1.0}, [0, 1], ["x"], **options)


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("", "wrote no file 'out.csv'"),
        ("raise SystemExit('the mesh is torn')", "ended with exit status 1: the mesh is torn"),
        ("open('out.csv', 'w').write('')", "no column"),
        ("open('out.csv', 'w').write('time,x\\n')", "has no rows"),
        ("open('out.csv', 'w').write('x\\n1\\n2\\n')", "no column 'time'"),
        ("open('out.csv', 'w').write('time,x\\n0,1\\n1\\n')", "line 3 has 1 values for 2 columns"),
        ("open('out.csv', 'wb').write(bytes(range(256)))", "cannot be read"),
    ],
)
def test_what_a_program_may_do_wrong(code, text):
    (message,) = script(code + "\n#{k}", keep="none").run(np.array([[1.0]])).messages
    assert text in message


def test_nothing_stays_of_good_runs(tmp_path):
    script(GOOD, folder=tmp_path).run(np.array([[1.0]]))
    assert not list(tmp_path.iterdir()) and os.getcwd() != str(tmp_path)
