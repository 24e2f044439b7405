"""Commands on scenes: bounds, comparisons, linearisation, URDF files, completion, and the exit status of doubts."""

import json
import os
import shutil
import signal
import subprocess
import sys
import warnings

import numpy as np
import pytest
from faults import printed, refused_command
from processes import in_time, runs

import symmb as mb
from symmb.show.cli.main import main
from symmb.show.cli.urdf_scene import parameter_name

SCENE = """
import numpy as np
import symmb as mb

p = mb.Parameters(speed=1.0, height=2.0)
ball = mb.Body("ball", 1.0, pose=mb.Particle())
scene = mb.Scene(
    mb.System(ball, parameters=p), {"ball.vx": p.speed, "ball.y": p.height}, np.linspace(0, 2, 5),
    {"x": ball.x, "y": ball.y}, box=mb.Box(speed=(0.9, 1.1)),
)
"""
OSCILLATORS = """
import symmb as mb
from small_scenes import two_masses

own = two_masses(lambda p, a, b: ((-p.k * a.x - p.c * a.vx, 0, 0), (0, -9 * b.y, 0)), k=4.0, c=0.4)
scene = mb.Scene(own.system, {START}, [0.0, 1.0], {"x": own.outputs["x"]}, name=own.name)
"""
ROBOT = """
<robot name="pendulum"><link name="wall"/>
<link name="rod"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
<inertia ixx="0" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="wall"/><child link="rod"/><axis xyz="0 1 0"/>
<dynamics damping="0.1"/></joint></robot>
"""
FILES = {
    "roll.py": SCENE, "t.csv": "name,nominal,plus\nspeed,1.0,0.2\n", "oscillators.py": OSCILLATORS.replace("START", ""),
    "pendulum.urdf": ROBOT, "still.urdf": '<robot name="still"><link name="wall"/></robot>',
    "wrong.urdf": '<robot name="still"><lnk name="wall"/></robot>',
}  # fmt: skip


def written(folder, *arguments, status=0):
    """What a command writes as JSON."""
    assert main([*arguments, "--json", str(folder / "written.json")]) == status
    return json.loads((folder / "written.json").read_text())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current one, where the files are."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.parametrize(
    ("words", "status", "upper"),
    [
        ([], 0, 2.2), (["--limit", "x=:2.3", "y=1:3"], 0, 2.2), (["--limit", "x=:2.1"], 1, 2.2),
        (["--box", "speed=1:1.5"], 0, 3.0), (["--tolerances", "t.csv"], 0, 2.4),
        (["--tolerances", "t.csv", "--box", "height=1:4", "--limit", "y=:3.9"], 1, 2.4),
        (["--method", "vertex", "--limit", "x=:2.3"], 3, 2.2),
    ],
)  # fmt: skip
def test_bounds_and_limits(folder, capsys, words, status, upper):
    assert main(["bound", "roll.py", *words, "--json", "b.json", "--csv", "b.csv"]) == status
    text = capsys.readouterr().out
    assert text.startswith("Bounds by ") and ("Limits by " in text) == ("--limit" in words)
    assert json.loads((folder / "b.json").read_text())["upper"][-1][0] == pytest.approx(upper)
    assert np.genfromtxt(folder / "b.csv", delimiter=",", skip_header=1)[-1, 2] == pytest.approx(upper)


@pytest.mark.parametrize("words, fixed", [([], ""), (["--box", "speed=1:2"], ""), (["--box", "height=1:3"], "speed ")])
def test_parameters_that_an_option_fixes_are_told(folder, capsys, words, fixed):
    main(["bound", "roll.py", *words])
    told = f"{fixed}keep their nominal values, because --box and --tolerances replace the scene's box."
    assert (told in capsys.readouterr().out) == bool(fixed)


def test_limits_stand_in_the_file(folder):
    main(["bound", "roll.py", "--limit", "x=:2.3", "y=1:1.5", "--json", "b.json"])
    limits = json.loads((folder / "b.json").read_text())["limits"]
    assert [*limits] == ["x", "y"] and limits["y"]["result"] == "violated"
    assert limits["y"]["why"] == "The nominal run is beyond the limit."
    assert limits["x"] == {**limits["x"], "result": "satisfied", "time": 2.0, "low": None, "high": 2.3}
    assert limits["x"]["margin"] == pytest.approx(0.1) and limits["y"]["margin"] == pytest.approx(-0.5)
    assert mb.Bounds.load("b.json")["x"][1][-1] == pytest.approx(2.2)


def test_pictures_are_written(folder):
    assert main(["bound", "roll.py", "--limit", "x=:2.3", "--plot", "b.png", "--view", "b.svg"]) == 0
    assert (folder / "b.png").stat().st_size > 5000 and (folder / "b.svg").stat().st_size > 500


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--limit", "x"], "name=low:high"), (["--limit", "x=:"], "has no number"), (["--limit", "x=a:1"], "low:high"),
        (["--limit", "x=2:1"], "above"), (["--limit", "q=:1"], "no output 'q'"), (["--box", "speed=1:"], "both ends"),
        (["--box", "speed=1:2", "speed=1:2"], "twice"), (["--box", "sped=1:2"], ": Box: no parameter 'sped'. Did you"),
        (["--box", "speed=:"], "both ends"), (["--limit", "x=-inf:inf"], "must be finite"),
        (["--tolerances", "none.csv"], "cannot be read"), (["--method", "magic"], "magic"), (["--csv", "b.png"], "csv"),
        (["--limit", "yy=:3"], "symmb bound: --limit: no output 'yy'. Did you mean 'y'?\n"),
    ],
)  # fmt: skip
def test_wrong_words_are_told_in_one_sentence(folder, capsys, monkeypatch, words, why):
    if "--limit" in words:  # these are checked before the study
        monkeypatch.setattr(mb, "propagate", None)
    error = refused_command(capsys, "bound", "roll.py", *words)
    assert why in error and error.startswith("symmb bound: ") and error.count("\n") == 1


def test_other_nominal_values_and_no_box_are_refused(folder, capsys):
    (folder / "t.csv").write_text("name,nominal,plus\nspeed,1.1,0.2\n")
    error = refused_command(capsys, "bound", "roll.py", "--tolerances", "t.csv")
    assert "the nominal value of 'speed' is 1.1 in the table, but 1 in the model" in error
    (folder / "roll.py").write_text(SCENE.replace(", box=mb.Box(speed=(0.9, 1.1))", ""))
    assert "--box NAME=1:2" in refused_command(capsys, "bound", "roll.py")


def test_numbers_with_units(folder, capsys):
    text = SCENE.replace("speed=1.0", 'speed=(1000, "mm/s")').replace('"x": ball.x', '"x": (ball.x, "cm")')
    (folder / "roll.py").write_text(text.replace("(0.9, 1.1)", '(0.9, 1.1, "m/s")'))
    assert main(["bound", "roll.py", "--box", "speed=1m/s:1500mm/s", "--limit", "x=:3.1m", "--json", "b.json"]) == 0
    bounds = mb.Bounds.load("b.json")
    assert bounds["x"][1][-1] == pytest.approx(300) and bounds.box == mb.Box(speed=(1000, 1500, "mm/s"))
    assert "speed = 1500 mm/s" in capsys.readouterr().out
    assert main(["simulate", "roll.py", "--set", "speed=2 m/s", "--csv", "run.csv"]) == 0
    assert np.genfromtxt(folder / "run.csv", delimiter=",", skip_header=1)[-1, 1] == pytest.approx(400)
    for words in ("speed=1:1.5m/s", "speed=1m/s:1.5"):
        assert main(["bound", "roll.py", "--box", words, "--limit", "x=2:3.1m", "--json", "b.json"]) == 1
        assert mb.Bounds.load("b.json").box == bounds.box
        assert "200 <= x <= 310 cm" in capsys.readouterr().out
    for words in (["--box", "speed=1kg:2kg"], ["--limit", "x=:3.1s"], ["--limit", "x=:3.1mmm"]):
        assert "unit" in (error := refused_command(capsys, "bound", "roll.py", *words)) or "does not fit" in error


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
    error = refused_command(capsys, "compare", str(study), "--methods", "mc:3", *options)
    assert words in error and error.count("\n") == 1


def test_prints_modes_and_writes_matrices(folder, capsys):
    told = printed(capsys, "linearize", "oscillators.py", "--set", "k=16", "--json", "l.json")
    head, _, first, second = told.splitlines()[:4]
    assert head == "oscillators: linearised at 0 s, 4 states, not asymptotically stable: 1 undamped oscillation"
    assert first.split() == ["1", "0.477465", "0", "b.y"]
    assert second.split() == ["2", "0.63662", "0.05", "a.x"]
    layout = json.loads((folder / "l.json").read_text())
    assert layout["parameters"] == {"k": 16.0, "c": 0.4} and layout["outputs"] == ["x"]
    values, own = np.array(layout["eigenvalues"]) @ [1, 1j], np.linalg.eigvals(np.array(layout["A"]))
    np.testing.assert_allclose(np.sort_complex(values), np.sort_complex(own), atol=1e-12)
    np.testing.assert_allclose(layout["modes"][1]["eigenvalue"], [-0.2, np.sqrt(16 - 0.04)], rtol=1e-12)
    assert layout["modes"][1]["shape"]["a.x"] == pytest.approx([1.0, 0.0]) and layout["doubts"] == []


def test_a_state_out_of_equilibrium_exits_with_3(tmp_path, capsys):
    path = tmp_path / "moving.py"
    path.write_text(OSCILLATORS.replace("START", '"b.y": 0.1').replace("-9 * b.y", "-9 * b.y**3"))
    with warnings.catch_warnings(action="always"):
        assert main(["linearize", str(path)]) == 3
    told = capsys.readouterr()
    assert "warning: The state is neither an equilibrium" in told.out
    assert "symmb linearize: linearize(oscillators): The state is neither" in told.err


def test_a_run_at_a_time(folder, capsys):
    assert printed(capsys, "linearize", "oscillators.py", "--time", "1").startswith("oscillators: linearised at 1 s")


def test_simulate_with_numbers_of_the_file(folder):
    """The pendulum falls from the horizontal: its acceleration at the start is m g c / (J + m c^2)."""
    run = written(folder, "simulate", "pendulum.urdf", "--set", "rod.mass=4", "rod.com.x=0.25")
    assert run["outputs"] == ["hinge"] and run["parameters"] == {"rod_mass": 4.0, "rod_com_x": 0.25}
    angle, t = np.array(run["values"])[:, 0], np.array(run["times"])
    assert angle[0] == 0.0
    assert abs(2 * angle[1] / t[1] ** 2 - 4 * 9.81 * 0.25 / (0.1 + 4 * 0.25**2)) < 0.05


def test_compare_over_uncertain_numbers(folder):
    arguments = "--spread 5% --uncertain rod.mass hinge.damping --methods vertex".split()
    box = written(folder, "compare", "pendulum.urdf", *arguments)["box"]
    assert box == {"rod_mass": pytest.approx([1.9, 2.1]), "hinge_damping": pytest.approx([0.095, 0.105])}


def test_view_and_equations(folder, capsys):
    assert main(["view", "pendulum.urdf", "-o", "page.html"]) == 0
    assert (folder / "page.html").stat().st_size > 10_000
    assert "Q = [-0.1⋅q̇_hinge + 9.81⋅cos(q_hinge)]" in printed(capsys, "equations", "pendulum.urdf", "--joint")


def test_uncertain_names_parameters_of_any_scene(tmp_path, capsys):
    arguments = ["--spread", "2%", "--uncertain", "l2", "--methods", "vertex"]
    assert written(tmp_path, "compare", "double_pendulum", *arguments)["box"] == {"l2": [0.98, 1.02]}


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("compare pendulum.urdf --methods vertex --uncertain rod.mass", "needs the width of the intervals"),
        ("compare pendulum.urdf --methods vertex --spread 5%", "Name the parameters by --uncertain"),
        ("compare pendulum.urdf --methods vertex --spread 5% --uncertain rod.mas", "Did you mean 'rod.mass'"),
        ("compare pendulum.urdf --methods vertex --spread 5% --uncertain hinge.origin.x", "'hinge_origin_x' is 0"),
        ("simulate pendulum.urdf --set rod.mass=4 rod_mass=4", "parameters with equal names. Rename a link or joint"),
        ("linearize oscillators.py --set q=1", "No parameter 'q'"),
        ("linearize oscillators.py --set k", "--set takes name=number"),
        ("linearize oscillators.py --time 0.5", "one of the run's 2 output times, 0 to 1 s, got 0.5"),
        ("linearize oscillators.py --json l.csv", ".json"),
        ("simulate none.urdf", "There is no scene file none.urdf"),
        ("simulate still.urdf", "no joint of this file moves"),
        ("simulate wrong.urdf", "wrong.urdf, line 1, <lnk name='wall'>"),
    ],
)
def test_what_is_wrong_is_told(folder, capsys, words, text):
    assert text in refused_command(capsys, *words.split())


def test_names_of_parameters():
    assert [parameter_name(name) for name in ("forearm.mass", "1-link.com.x")] == ["forearm_mass", "_1_link_com_x"]


ASK = """
source {script}
COMP_WORDS=({line}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
$(complete -p symmb | sed 's/.*-F \\([^ ]*\\).*/\\1/')
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture
def completed(tmp_path, capsys):
    """What bash offers for the last word of a line."""
    pytest.importorskip("shtab")
    if shutil.which("bash") is None:
        pytest.skip("needs bash")
    assert main(["completion", "bash"]) == 0
    script = tmp_path / "completion.bash"
    script.write_text(capsys.readouterr().out)
    (tmp_path / "door.py").touch()

    def ask(line):
        asked = ["bash", "--norc", "-c", ASK.format(script=script, line=line)]
        run = subprocess.run(asked, cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert not run.stderr
        return set(run.stdout.split())

    return ask


@pytest.mark.parametrize(
    "line, offered",
    [
        ("symmb comp", {"compare", "completion"}), ("symmb compare door.py --me", {"--methods"}),
        ("symmb simulate do", {"door.py", "double_pendulum", "double_wishbone"}), ("symmb completion z", {"zsh"}),
    ],
)  # fmt: skip
def test_bash_completes(completed, line, offered):
    assert completed(line) == offered


def test_zsh_has_a_script(capsys):
    pytest.importorskip("shtab")
    assert "#compdef symmb" in printed(capsys, "completion", "zsh")


def test_without_shtab_a_sentence_tells_what_to_install(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "shtab", None)
    told = refused_command(capsys, "completion", "bash")
    assert told.startswith("symmb completion: this command needs shtab, which is not installed.")


PENDULUM = """
from machines import pendulum

scene = pendulum().scene("y", [0, 0.1], {{"rod.theta": {angle}}})
"""


@pytest.mark.parametrize(("angle", "status"), [(-np.pi / 2, 0), (np.pi / 2, 3)])
@pytest.mark.filterwarnings("default::symmb.SymmbWarning")
def test_an_unstable_equilibrium_is_a_doubt(tmp_path, capsys, angle, status):
    """The rod hangs, or stands upright."""
    file = tmp_path / "pendulum.py"
    file.write_text(PENDULUM.format(angle=angle))
    doubts = written(tmp_path, "simulate", str(file), status=status)["doubts"]
    assert ("unstable equilibrium" in capsys.readouterr().err) == bool(status)
    assert len(doubts) == bool(status) and all("unstable equilibrium" in doubt for doubt in doubts)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device that is always full")
@pytest.mark.parametrize(("closing", "status"), [(">/dev/full", 2), (">&-", 0), (">&- 2>&-", 0)])
def test_an_output_that_cannot_be_written_is_told(closing, status, tmp_path):
    command = f"exec {sys.executable} -m symmb.show.cli cache {closing}"
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    end = subprocess.run(["sh", "-c", command], capture_output=True, text=True, env=environment)
    assert end.returncode == status and "Traceback" not in end.stderr
    assert end.stderr.count("\n") == (status == 2)
