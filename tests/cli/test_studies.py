"""Comparisons of simulators from the command line: in processes, on clusters, with a file of runs."""

import json
import os
import signal
import subprocess
import sys

import pytest
from processes import in_time, runs

from symmb.show.cli.main import main

SIMULATOR = """
import numpy as np
import symmb as mb

T = np.linspace(0, 1, 5)
CALLS = __file__ + ".calls"

def decay(k, c):
    with open(CALLS, "a") as calls:
        calls.write("x")
    return c * np.exp(-k * T)

def simulator():
    return mb.FunctionSimulator(decay, {"k": 1.0, "c": 2.0}, T, ["x"]), mb.Box(k=(0.9, 1.1))
"""


@pytest.fixture
def study(tmp_path, request):
    path = tmp_path / f"{request.node.name}.py"
    path.write_text(SIMULATOR)
    return path


def compared(study, *options):
    """The rows of a comparison, and how many runs it made."""
    result, calls = study.with_suffix(".json"), study.with_suffix(".py.calls")
    calls.unlink(missing_ok=True)
    assert main(["compare", str(study), "--save", str(result), "--methods", "pce:2:paper", "mc:20", *options]) == 0
    rows = json.loads(result.read_text())["methods"]
    return [(row["lower"], row["upper"]) for row in rows], len(calls.read_text()) if calls.exists() else 0


def test_processes_a_dask_cluster_and_a_file_change_no_digit(study, tmp_path, capfd, monkeypatch):
    distributed = pytest.importorskip("dask.distributed")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    expected, _ = compared(study)
    assert compared(study, "--workers", "2")[0] == expected
    store = str(tmp_path / "runs.db")
    found, n_runs = compared(study, "--store", store, "--workers", "2")
    assert found == expected and n_runs > 20
    assert compared(study, "--store", store) == (expected, 0)
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as cluster:
        assert compared(study, "--dask", cluster.scheduler_address)[0] == expected


SLOW = """
import os
import symmb as mb
from symmb._cleanup import process_group

def slow(k):
    if k == 1.0:
        return [k]
    with process_group(["sleep", "100"]) as program:
        with open(__file__ + ".pids", "a") as pids:
            pids.write(f"{os.getpid()} {program.pid} ")
        program.wait()

def simulator():
    return mb.FunctionSimulator(slow, {"k": 1.0}, [0.0], ["x"]), mb.Box(k=(0.9, 1.1))
"""


@pytest.mark.skipif(os.name != "posix", reason="needs groups of processes")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL], ids=lambda number: number.name)
def test_workers_and_their_programs_end_with_the_command(tmp_path, number):
    path, pids = tmp_path / "slow.py", tmp_path / "slow.py.pids"
    path.write_text(SLOW)
    command = [sys.executable, "-m", "symmb.show.cli", "compare", str(path), "--methods", "mc:20", "--workers", "2"]
    process = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    assert in_time(lambda: pids.exists() and len(pids.read_text().split()) >= 4, 60)
    if number == signal.SIGINT:
        os.killpg(process.pid, number)  # as a terminal does
    else:
        process.send_signal(number)
    assert process.wait(10) == (-number if number == signal.SIGKILL else 130)
    assert in_time(lambda: not any(runs(pid) for pid in pids.read_text().split()), 10)


ENDED = """
import os, signal, subprocess, sys, threading, time
from symmb import _cleanup

class Popen(subprocess.Popen):
    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        print(self.pid, flush=True)
        END
        time.sleep(0.1)  # before anybody knows of it

_cleanup.lead_group()
with _cleanup.process_group(["true"]):
    pass
subprocess.Popen = Popen
with _cleanup.process_group(["sleep", "100"]):
    time.sleep(10)
"""


@pytest.mark.skipif(os.name != "posix", reason="needs groups of processes")
@pytest.mark.parametrize(
    "end",
    ["os.kill(os.getpid(), signal.SIGTERM)", "threading.Thread(target=_cleanup._end_now).start()"],
    ids=["by its parent", "by a thread that sees its parent end"],
)
def test_a_process_that_ends_while_it_starts_a_program_ends_the_program(end):
    code = ENDED.replace("END", end)
    begun = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert begun.returncode == 1 and begun.stderr == ""
    (program,) = begun.stdout.split()
    assert in_time(lambda: not runs(program), 5)


def test_spread_is_around_nominal_values_of_the_simulator(study, capsys):
    compared(study, "--spread", "20%")
    assert "box: k [0.8, 1.2]" in capsys.readouterr().out


def test_a_scene_keeps_its_runs(tmp_path, capsys):
    for _ in range(2):
        store = ["--store", str(tmp_path / "c.db")]
        assert main(["compare", "cubic", "--methods", "pce:2:paper", "taylor:1", *store]) == 0
    assert "evaluations that earlier methods have not stored" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (SIMULATOR, ["--workers", "0"], "--workers must be a number of processes, 1 or more, got 0"),
        (SIMULATOR, ["--store", "."], ". is not a run store"),
        (SIMULATOR, ["--store", __file__], "is not a run store. Give another name"),
        (SIMULATOR, ["--dask", "odd://here"], "--dask odd://here: unknown address scheme 'odd'"),
        (SIMULATOR, ["--solver", "cvodes"], "has its own solver"),
        (SIMULATOR.replace(", mb.Box(k=(0.9, 1.1))", ""), [], "simulator() must return a pair"),
        (SIMULATOR.replace("mb.Box(k=(0.9, 1.1))", "None"), [], "simulator() must return a pair"),
        ("simulator = 3", [], "simulator must be a function that returns a simulator"),
        (SIMULATOR.replace("def simulator", "def other"), [], "defines no function scene()"),
    ],
)  # fmt: skip
def test_one_sentence(tmp_path, capsys, text, options, words):
    study = tmp_path / "wrong_study.py"
    study.write_text(text)
    assert main(["compare", str(study), "--methods", "mc:3", *options]) == 2
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1 and "Traceback" not in error
