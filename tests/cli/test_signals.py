"""SIGINT and SIGTERM end every command, and studies in Python carry what was found so far."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from contextlib import contextmanager
from pathlib import Path

import casadi as ca
import interrupts
import numpy as np
import pytest
from conftest import but_long
from mechanisms import double_pendulum

import symmb as mb
from symmb import _cleanup
from symmb._interrupts import kept_interrupts
from symmb.show.cli.main import main
from symmb.study import compare

T = np.linspace(0.0, 1.0, 5)


@pytest.mark.parametrize("number", interrupts.SIGNALS, ids=lambda number: number.name)
@pytest.mark.parametrize("name", but_long(interrupts.COMMANDS, "stability"))
def test_a_signal_ends_a_command_in_two_seconds_and_leaves_nothing(name, number):
    moment = {"stability": 2.5, "compare": 2.0}.get(name, 0.9)
    seconds, faults = interrupts.interrupted(name, number, moment)
    assert not faults and (seconds is None or seconds < interrupts.MOST)


@pytest.mark.parametrize(
    ("name", "number"),
    [
        pytest.param(name, number, marks=[pytest.mark.long] * ((i + k) % 2), id=f"{name}-{number.name}")
        for i, name in enumerate(["command", "Python, threads"])
        for k, number in enumerate(interrupts.ENDS)
    ],
)
def test_no_program_and_no_folder_outlives_a_study(name, number):
    assert not interrupts.ended_programs("programs", name, number, 0.1)


class Interrupted(mb.FunctionSimulator):
    """Ends by an interrupt at a run."""

    def __init__(self, last):
        self.left = last
        super().__init__(self.values, {"k": 1.0, "c": 0.5}, T, ["x"])

    def values(self, k, c):
        self.left -= 1
        if self.left < 0:
            raise KeyboardInterrupt
        return np.exp(-k * T) + c


BOX = mb.Box(k=(0.9, 1.1), c=(0.4, 0.6))


def partial_of(study, *arguments, **options):
    """What a study that is interrupted carries."""
    with pytest.raises(KeyboardInterrupt) as caught:
        study(*arguments, **options)
    return caught.value.partial


@pytest.mark.parametrize(
    ("method", "runs"), [(mb.MonteCarlo(1000), 200), (mb.Scanning(30), 200), (mb.PolynomialChaos(tolerance=1e-9), 20)]
)
def test_interrupted_bounds_carry_what_the_runs_attained(method, runs):
    partial = partial_of(mb.propagate, Interrupted(runs), method, BOX)
    assert partial.kind == "sampled" and "interrupted" in partial.method and 0 < partial.evaluations <= runs
    whole = mb.propagate(Interrupted(10**9), method, BOX)
    assert (partial.lower >= whole.inner[0]).all() and (partial.upper <= whole.inner[1]).all()
    assert (partial.lower < partial.upper).all()


def test_bounds_without_a_finished_run_carry_nothing():
    assert partial_of(mb.propagate, Interrupted(0), mb.Vertex(), BOX) is None


def test_an_interrupted_comparison_carries_the_methods_so_far():
    def progress(label, done, total):
        if label.startswith("MonteCarlo") and done > 500:
            raise KeyboardInterrupt

    methods = [mb.Vertex(), mb.MonteCarlo(10_000), mb.Scanning(5)]
    partial = partial_of(mb.compare, Interrupted(10**9), methods, BOX, mb.Scanning(3), progress=progress)
    assert [row.name for row in partial.rows] == ["Vertex()"]
    left = [(method.name, method.reason) for method in partial.not_run]
    assert left == [("MonteCarlo(10000)", "interrupted"), ("Scanning(5)", "interrupted")]
    assert "interrupted" in str(partial)


def test_so_does_one_that_is_interrupted_in_its_check_runs(monkeypatch):
    def interrupted(method, simulator, bounds, executor):
        if isinstance(method, mb.Scanning):
            raise KeyboardInterrupt
        return (), ()

    monkeypatch.setattr(compare, "doubts_of_checks", interrupted)
    partial = partial_of(mb.compare, Interrupted(10**9), [mb.Vertex(), mb.Scanning(5)], BOX, mb.Scanning(3))
    assert [row.name for row in partial.rows] == ["Vertex()"]
    assert [left.name for left in partial.not_run] == ["Scanning(5)"]


@contextmanager
def interrupt_after(seconds):
    """What runs within takes longer, so that the interrupt meets it and not a later test."""
    gc.collect()  # Python drops an interrupt that arrives while garbage of former tests is collected
    timer = threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@pytest.mark.parametrize("solver", [mb.CVODES(), mb.IDAS(), mb.StabilizedIndex2()], ids=repr)
def test_an_integrator_of_casadi_does_not_swallow_an_interrupt(solver):
    scene = double_pendulum(np.linspace(0.0, 1000.0, 100_001))
    mb.simulate(scene, solver, times=[0.0, 0.1])
    before, begin = signal.getsignal(signal.SIGINT), time.monotonic()
    with interrupt_after(0.3), pytest.raises(KeyboardInterrupt):
        mb.simulate(scene, solver)
    assert time.monotonic() - begin < 2.0 and signal.getsignal(signal.SIGINT) is before


PLATE = mb.Body("plate", 1.0, 0.1)
POINT = PLATE.point(1.0, 2.0)


@contextmanager
def interrupt_where_casadi_asks_for_a_shape(number, monkeypatch):
    """A signal is sent at the first time, and is an interrupt; yields what was asked."""
    asked = []

    def shape(matrix):
        if not asked:
            asked.append(matrix)
            signal.raise_signal(number)
        return matrix.size1(), matrix.size2()

    monkeypatch.setattr(ca.SX, "shape", property(shape))
    before = signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            yield asked
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_is_not_lost_where_casadi_asks_for_a_shape(number, monkeypatch):
    """CasADi drops what Python raises while it converts its arguments."""
    x = ca.SX.sym("x", 2, 2)
    with interrupt_where_casadi_asks_for_a_shape(number, monkeypatch) as asked, kept_interrupts():
        x @ x
        assert asked
        time.sleep(1.0)


def test_an_interrupt_while_handlers_return_leaves_none_of_them(monkeypatch):
    before, restore, calls = signal.getsignal(signal.SIGINT), signal.signal, []

    def interrupted(number, handler):
        calls.append(number)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return restore(number, handler)

    with pytest.raises(KeyboardInterrupt), kept_interrupts():
        assert signal.getsignal(signal.SIGINT) is not before
        monkeypatch.setattr(signal, "signal", interrupted)
    assert signal.getsignal(signal.SIGINT) is before


BRANCH = Path(__file__).parents[1] / "data" / "urdf" / "branch.urdf"


@pytest.mark.parametrize(
    "work",
    [
        lambda run: mb.linearize(run.scene), lambda run: mb.load_urdf(BRANCH), lambda run: mb.view(run, "page.html"),
        lambda run: run.reaction("elbow"),
    ],
    ids=["linearize", "load_urdf", "view", "Trajectory.reaction"],
)  # fmt: skip
def test_long_functions_and_methods_of_results_keep_an_interrupt(work, monkeypatch, tmp_path):
    run = mb.simulate(double_pendulum(T))
    monkeypatch.chdir(tmp_path)
    with interrupt_where_casadi_asks_for_a_shape(signal.SIGINT, monkeypatch) as asked:
        work(run)
    assert asked


@pytest.mark.parametrize(
    "declared",
    [
        lambda: mb.Body("b", 1.0, 0.1), lambda: mb.Body("c", 1.0, (1, 1, 1), mb.Spatial()), mb.Ground,
        lambda: PLATE.point(1.0, 2.0), lambda: POINT.r, lambda: POINT.velocity, lambda: mb.Parameters(a=1.0, b=2.0),
    ],
)  # fmt: skip
def test_an_interrupt_of_a_short_declaration_is_raised_at_its_end(declared, monkeypatch):
    """It comes where CasADi drops it, and the work ends before it is sent again."""
    with interrupt_where_casadi_asks_for_a_shape(signal.SIGINT, monkeypatch) as asked:
        declared()
        assert not asked
        raise KeyboardInterrupt  # it asks for no shape
    time.sleep(0.003)  # nothing is sent any more


@pytest.mark.parametrize(("d", "order", "m"), [(6, 4, 8), (3, 12, 10_000)])
def test_a_long_search_of_ranges_ends_at_an_interrupt(d, order, m):
    """They take 7 s and 16 s: polynomials of many parameters, and many polynomials of few."""
    alpha = mb.TensorDegree().indices(d, order)
    coefficients = np.random.default_rng(0).standard_normal((len(alpha), m)) * 0.8 ** alpha.sum(axis=1)[:, None]
    mb.Exact().search(np.zeros((1, 1), dtype=int), np.ones((1, 1)))  # builds the search
    begin = time.monotonic()
    with interrupt_after(0.5), pytest.raises(KeyboardInterrupt):
        mb.Exact().search(alpha, coefficients)
    assert time.monotonic() - begin < 1.5


def test_a_run_in_python_carries_its_trajectory_so_far():
    scene = double_pendulum(np.linspace(0.0, 50.0, 5001))
    mb.simulate(scene, mb.StateSpace(), times=[0.0, 0.01])
    with interrupt_after(0.7):
        run = partial_of(mb.simulate, scene, mb.StateSpace())
    assert 1 < len(run.t) < len(scene.times) and np.isfinite(run.values).all() and str(run)


LEFT = """
import os, signal
from symmb._cleanup import temporary_folder
with temporary_folder() as folder:
    print(folder.parent, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def python(*arguments, **options):
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, **options)


def left_folder(place):
    """A temporary folder of a process that was killed."""
    return Path(python("-c", LEFT, env={**os.environ, "TMPDIR": str(place)}).stdout.strip())


def look_alikes(place, left):
    """Folders with such names that are not of a process of symmb on this machine that has ended."""
    process, mark = left.name.split("-")[1], (left / ".symmb").read_text()
    title, name, machine, number, begin = mark.split("\n")

    def made(own, mark=None, **changed):
        (place / own).mkdir()
        parts = {"title": title, "name": own, "machine": machine, "number": number, "begin": begin}
        text = "\n".join((parts | changed).values()).encode() if mark is None else mark
        (place / own / ".symmb").write_bytes(text)

    for own in ("2024-results", f"{process}-own", *(f"{int(process) + k}-{k}-x" for k in range(40))):
        (place / f"symmb-{own}").mkdir()
    (place / "symmb_run-abc").mkdir()
    (place / f"symmb-{process}-file").write_text("mine")
    (place / f"symmb-{process}-link").symlink_to(left)
    for k, node in enumerate(("node7", f"node7 {machine.partition(' ')[2]}", machine[:-3] + "9]", "")):
        made(f"symmb-{process}-machine{k}", machine=node)
    made(f"symmb-{os.getpid()}-live", number=str(os.getpid()), begin=_cleanup._begin_of(os.getpid()))
    made(f"symmb-{process}-copy", name=name)
    made(f"symmb-{process}-title", title="other")
    for k, text in enumerate(("", "symmb", mark + "\n", mark.replace("\n", " "), "\0" * 9)):
        made(f"symmb-{process}-text{k}", text.encode())
    made(f"symmb-{process}-binary", bytes(range(256)))
    (place / f"symmb-{process}-folder" / ".symmb").mkdir(parents=True)
    (place / f"symmb-{process}-linked").mkdir()
    (place / f"symmb-{process}-linked" / ".symmb").symlink_to(left / ".symmb")
    return {path.name for path in place.iterdir()} - {left.name}


def test_the_cache_is_cleared_of_folders_with_a_mark_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    left = left_folder(tmp_path)
    names = look_alikes(tmp_path, left)
    assert left.exists() and len(names) > 50
    monkeypatch.chdir(tmp_path)
    assert main(["cache", "--clear"]) == 0 and left.exists()  # nothing goes in the current folder
    monkeypatch.chdir("/")
    assert main(["cache", "--clear"]) == 0
    assert {path.name for path in tmp_path.iterdir()} - {"cache"} == names
    capsys.readouterr()


def test_folders_of_killed_processes_go_when_the_next_one_makes_one(tmp_path):
    first = left_folder(tmp_path)
    assert (first / "run").is_dir()
    assert left_folder(tmp_path).exists() and not first.exists()


IN_A_CALLBACK = """
import os, signal, time
from symmb.show.cli.signals import end_at_signals

class Slow:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)
        for _ in range(1000):
            pass

end_at_signals()
try:
    slow = Slow()
    del slow
    time.sleep(1.0)
except KeyboardInterrupt:
    print("interrupted")
"""


def test_an_interrupt_that_python_drops_is_repeated():
    """Exceptions of callbacks, such as those of garbage collection, do not reach the program."""
    end = python("-c", IN_A_CALLBACK)
    assert (end.stdout, end.stderr) == ("interrupted\n", "")


ALONE = """
import ctypes, os, resource
resource.setrlimit(resource.RLIMIT_NPROC, (1, 1))
if os.getuid() == 0:  # whom the limit does not concern
    os.setresuid(65534, 65534, 0)
    ctypes.CDLL(None).setfsuid(0)  # the files stay root's
from symmb.show.cli.__main__ import run
assert run() == 0
import numpy as np
from symmb import Vertex, propagate
from models.double_pendulum import scene
print(propagate(scene().with_times(np.linspace(0.0, 0.1, 3)), Vertex()))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit of processes that Linux knows")
def test_without_threads_and_processes_commands_and_studies_run(tmp_path):
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(interrupts.ROOT)}
    environment.pop("OPENBLAS_NUM_THREADS", None)
    end = python("-c", ALONE, "simulate", "double_pendulum", env=environment, cwd="/")
    assert end.returncode == 0 and "theta2_dot" in end.stdout and "Vertex" in end.stdout, end.stderr
    assert "cannot be started" in end.stderr and "Traceback" not in end.stderr


class _Gone:
    """An object at whose end a signal arrives."""

    def __del__(self):
        signal.raise_signal(signal.SIGINT)


class _Data(set):
    """The references of a WeakSet; a signal arrives while one goes."""

    def discard(self, item):
        signal.raise_signal(signal.SIGINT)
        super().discard(item)


@pytest.mark.parametrize("kind", ["__del__", "WeakSet"])
def test_an_interrupt_at_the_end_of_an_object_is_kept(kind):
    """Python drops what such functions raise."""
    with pytest.raises(KeyboardInterrupt), kept_interrupts():
        if kind == "__del__":
            _Gone()
        else:
            known, item = weakref.WeakSet(), type("Item", (), {})()
            known.add(item)
            known.data = _Data(known.data)
            del item
        time.sleep(1.0)  # it is sent again
