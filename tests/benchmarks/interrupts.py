"""Signals at random moments: python tests/benchmarks/interrupts.py [MOMENTS] ends each command so often by each signal.

Every command must end within 2 s with exit status 130, keep the files of an earlier run, and leave neither processes
nor folders. It prints the longest time to end of each command and what did not hold. 50 moments take half an hour.

python tests/benchmarks/interrupts.py programs [SIGNALS [SEED]] sends INT, TERM, HUP, QUIT and KILL to studies of
programs that start others and of FMUs some of whose runs hang, on the command line and in Python with and without
pools. 2 s later there must be no process and no folder; after KILL no folder once another study has begun.

python tests/benchmarks/interrupts.py declarations [SIGNALS [SEED]] sends INT while new curves, systems and scenes are
declared, prepared and compiled to functions. None may be lost, and each must end the work within 2 s.

python tests/benchmarks/interrupts.py functions [SIGNALS [SEED]] does the same while public functions and methods of
results work. Live pages need the package ziglang.
"""

import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import fmus
import numpy as np

import symmb as mb

LONG = """
import numpy as np
from models import {model} as model

def scene():
    return model.scene().with_times(np.linspace(0, {end}, {n}))
"""
SCENES = {
    "long.py": LONG.format(model="double_pendulum", end=5000, n=20_001),
    "short.py": LONG.format(model="double_pendulum", end=200, n=20_001),
    "wide.py": LONG.format(model="chain", end=2, n=2001),
}
COMMANDS = {
    "simulate by CVODES": ["simulate", "long.py", "--solver", "cvodes", "--json", "out.json"],
    "simulate by IDAS": ["simulate", "short.py", "--solver", "idas", "--csv", "out.csv"],
    "simulate in lanes": ["simulate", "long.py", "--solver", "dopri", "--json", "out.json"],
    "compare": ["compare", "double_pendulum", "--json", "out.json", "--plot", "out.png"],
    "stability": ["stability", "double_pendulum", "--json", "out.json"],
    "build": ["simulate", "wide.py", "--solver", "nstiff-si2:1e-3", "--json", "out.json"],
}
PROGRAMS = """
import sys
import numpy as np
import symmb as mb

CODE = r'''
import subprocess, sys, time
other = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
time.sleep({k})
other.kill()
open("out.csv", "w").write("time,x\\n0,{k}\\n")
'''

def simulator():
    run = mb.CommandSimulator([sys.executable, "in.py"], {"k": 1.0}, [0.0], ["x"], {"in.py": CODE})
    return run, mb.Box(k=(0.01, 0.9))
"""
FMU = """
import symmb as mb

def simulator():
    run = mb.FMUSimulator("spring.fmu", {"stiffness": 40.0}, [0.0, 0.5, 1.0], ["x"])
    return run, mb.Box(stiffness=(20.0, 95.0))
"""
STUDY = """
import importlib
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
import symmb as mb

if __name__ == "__main__":
    run, box = importlib.import_module(sys.argv[1]).simulator()
    if sys.argv[2] == "alone":
        mb.propagate(run, mb.MonteCarlo(100), box)
    else:
        with {"threads": ThreadPoolExecutor, "processes": ProcessPoolExecutor}[sys.argv[2]](2) as pool:
            mb.propagate(run, mb.MonteCarlo(100), box, executor=pool)
"""
_COMMAND = ["-m", "symmb.show.cli", "compare", "{}.py", "--methods", "mc:50"]
STUDIES = {
    "command": _COMMAND,
    "command with workers": [*_COMMAND, "--workers", "2"],
    **{f"Python, {kind}": ["study.py", "{}", kind] for kind in ("alone", "threads", "processes")},
}
MODELS = "programs", "fmu"
ENDS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGKILL
ROOT = Path(__file__).parents[2]
PREVIOUS = b"previous"
SIGNALS = signal.SIGINT, signal.SIGTERM
MOST = 2.0
LATEST = {"compare": 6.0, "stability": 8.0}
"""Moments are drawn from up to this time [s], otherwise from up to 2 s."""


@dataclass
class Findings:
    """The longest time to end [s], and what did not hold."""

    longest: float = 0.0
    faults: list[str] = field(default_factory=list)


def interrupted(name: str, number: signal.Signals, moment: float) -> tuple[float | None, list[str]]:
    """Time to end of a command that gets a signal at a moment; None if it had ended before; and what did not hold."""
    with tempfile.TemporaryDirectory() as folder:
        place, temporary = Path(folder, "work"), Path(folder, "tmp")
        place.mkdir()
        temporary.mkdir(mode=0o700)
        for file, text in SCENES.items():
            (place / file).write_text(text)
        outputs = [place / part for part in COMMANDS[name] if part.startswith("out.")]
        for path in outputs:
            path.write_bytes(PREVIOUS)
        environment = {**os.environ, "TMPDIR": str(temporary), "PYTHONPATH": str(ROOT)}
        if name == "build":
            environment["XDG_CACHE_HOME"] = str(Path(folder, "cache"))
        process = subprocess.Popen(
            [sys.executable, "-m", "symmb.show.cli", *COMMANDS[name]],
            cwd=place,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        time.sleep(moment)
        if process.poll() is not None:
            process.communicate()
            return None, []
        begin = time.monotonic()
        process.send_signal(number)
        try:
            _, error = process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            return 20.0, ["it did not end"]
        seconds = time.monotonic() - begin
        faults = []
        if process.returncode not in (0, 130):  # 0 if it had nearly ended
            faults.append(f"exit status {process.returncode}: {error.decode()[-200:]}")
        if b"Traceback" in error:
            faults.append(f"traceback: {error.decode()[-200:]}")
        if seconds > MOST:
            faults.append(f"took {seconds:.1f} s")
        faults += [f"{path.name} is not whole" for path in outputs if not is_whole(path)]
        faults += [f"left {path.name}" for path in temporary.iterdir()]
        faults += [f"left {path.name}" for path in place.iterdir() if path.name.startswith(".")]
        if processes_in(folder):
            time.sleep(0.3)  # a process that was killed takes a moment to go
        faults += [f"left a process: {line}" for line in processes_in(folder)]
        return seconds, faults


def ended_programs(model: str, name: str, number: signal.Signals, moment: float, fmu: bytes = b"") -> list[str]:
    """What is left of a study of programs or of an FMU that gets a signal at a moment."""
    with tempfile.TemporaryDirectory() as folder:
        temporary = Path(folder, "tmp")
        temporary.mkdir(mode=0o700)
        for file, text in (("programs.py", PROGRAMS), ("fmu.py", FMU), ("study.py", STUDY)):
            Path(folder, file).write_text(text)
        Path(folder, "spring.fmu").write_bytes(fmu)
        environment = {**os.environ, "TMPDIR": str(temporary), "PYTHONPATH": str(ROOT)}
        process = subprocess.Popen(
            [sys.executable, *(word.format(model) for word in STUDIES[name])],
            cwd=folder,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        deadline = time.monotonic() + 60
        first = {"programs": "*/run/in.py", "fmu": "symmb-*/*"}[model]
        while not any(temporary.glob(first)) and time.monotonic() < deadline:
            time.sleep(0.02)
        time.sleep(moment)
        if process.poll() is not None:
            return [f"a study that ended by itself with status {process.returncode}"]
        process.send_signal(number)
        deadline, left = time.monotonic() + MOST, [""]
        while left and time.monotonic() < deadline:
            time.sleep(0.05)
            process.poll()
            left = [f"process {line}" for line in processes_in(folder)]
            left += [f"folder {path.name}" for path in temporary.glob("symmb-*")]
        if number == signal.SIGKILL and left and not processes_in(folder):
            again = "from symmb._cleanup import temporary_folder as t\nwith t(): pass"
            subprocess.run([sys.executable, "-c", again], env=environment, cwd=folder, check=True)
            left = [f"folder {path.name}" for path in temporary.glob("symmb-*")]
        process.kill()
        process.wait()
        return left


def is_whole(path: Path) -> bool:
    """Whether a file is as it was before, or complete."""
    content = path.read_bytes()
    ends = {".json": b"}\n", ".csv": b"\n", ".png": b"IEND\xaeB`\x82"}
    return content == PREVIOUS or content.endswith(ends[path.suffix])


def processes_in(folder: str) -> list[str]:
    """Command lines of processes whose environment or arguments name a folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if folder.encode() in (path / "environ").read_bytes() and int(path.name) != os.getpid():
                found.append((path / "cmdline").read_bytes().replace(b"\0", b" ").decode()[:100])
        except OSError:
            continue
    return found


def study(name: str, moments: int, seed: int = 0) -> Findings:
    """A command under both signals at random moments."""
    choice, findings = random.Random(f"{name} {seed}"), Findings()
    for number in SIGNALS:
        done = 0
        while done < moments:
            moment = choice.uniform(0.1, LATEST.get(name, 2.0))
            seconds, faults = interrupted(name, number, moment)
            if seconds is None:
                continue
            done += 1
            findings.longest = max(findings.longest, seconds)
            findings.faults += [f"{number.name} at {moment:.3f} s: {fault}" for fault in faults]
    return findings


def programs(count: int, seed: int) -> int:
    """Print what signals leave of studies of programs and FMUs."""
    choice, faults = random.Random(seed), 0
    kinds = [(model, name, number) for model in MODELS for name in STUDIES for number in ENDS]
    with tempfile.TemporaryDirectory() as folder:
        fmu = fmus.spring(Path(folder, "spring.fmu"), {2: fmus.library(2, folder)}).read_bytes()
    for k in range(count):
        model, name, number = kinds[k % len(kinds)]
        left = ended_programs(model, name, number, choice.uniform(0.0, 1.5), fmu)
        faults += bool(left)
        if left:
            print(f"{model}, {name}, {number.name}: left {', '.join(left)}", flush=True)
    print(f"{count} signals, {faults} of them left something")
    return int(faults > 0)


def follower(number: float) -> None:
    """A ball on a curve, prepared and compiled: no two numbers give the same one."""
    curve = mb.Curve(lambda s: (s, s**2 + 1e-3 * number), -1.0, 1.0, corners=[0.5])
    mb.Curve([(k, (k * number) % 1) for k in range(6)])
    ball, law = mb.Body("ball", 1.0, 0.1, mb.Planar()), mb.KelvinVoigt(1e5, 10.0)
    rows = [mb.Body(f"link{k}", 1.0, 0.1, mb.Planar()) for k in range(2)]
    points = [mb.Ground().point(0, 0), *(link.point(0.5, 0) for link in rows)]
    joints = [mb.Revolute(f"pin{k}", points[k], rows[k].point(-0.5, 0)) for k in range(2)]
    contact = mb.CurveContact("on", mb.Ground().point(0, 0), curve, ball.point(0, 0), 0.1, law)
    system = mb.System(ball, *rows, *joints, contact, mb.Gravity(0, -9.81))
    mb.Scene(system, {"ball.y": 0.5}, np.linspace(0, 0.1, 3))
    mb.compile_dae(system)
    chain = mb.System(*rows, *joints, mb.Gravity(0, -9.81 - number))
    mb.prepare(mb.Scene(chain, {"pin0.angle": 0.5}, np.linspace(0, 0.1, 3)), mb.CVODES())


def long_functions(folder: str) -> dict[str, Callable[[], object]]:
    """Public functions and methods of results that take milliseconds or more, by name."""
    p = mb.Parameters(length=1.0, stiffness=40.0)
    end, rods, joints = mb.Ground().point(0, 0), [], []
    for k in range(3):
        rods.append(mb.Body(f"rod{k}", 1.0, p.length**3 / 12))
        joints.append(mb.Revolute(f"pin{k}", end, rods[-1].point(-p.length / 2, 0)))
        end = rods[-1].point(p.length / 2, 0)
    spring = mb.Spring("spring", mb.Ground().point(0, -3), end, p.stiffness, 0.5)
    system = mb.System(*rods, *joints, spring, mb.Gravity(0, -9.81), parameters=p)
    start, box = {f"rod{k}.theta": -np.pi / 2 for k in range(3)}, mb.Box(length=(0.98, 1.02))
    scene = mb.Scene(system, start, np.linspace(0, 1, 51), {"y": end.y}, box)
    run, bounds, beam = mb.simulate(scene), mb.propagate(scene), Path(__file__).parents[1] / "data/urdf/branch.urdf"
    limits, page, picture = {"y": (None, -2.5)}, f"{folder}/page.html", f"{folder}/page.png"
    found: dict[str, Callable[[], object]] = {
        "simulate": lambda: mb.simulate(scene),
        "sweep": lambda: mb.sweep(scene, {"length": [0.9, 1.1]}),
        "propagate": lambda: mb.propagate(scene),
        "compare": lambda: mb.compare(scene, [mb.Vertex()], reference=mb.Scanning(3)),
        "tolerances": lambda: mb.tolerances(scene, limits),
        "calibrate": lambda: mb.calibrate(scene, {"y": run["y"]}, ["length"]),
        "linearize": lambda: mb.linearize(scene),
        "root_locus": lambda: mb.root_locus(scene, "length", (0.9, 1.1), count=3),
        "sensitivities": lambda: mb.sensitivities(scene, ["length"]),
        "load_urdf": lambda: mb.load_urdf(beam),
        "view": lambda: mb.view(scene, page),
        "Trajectory.plot": lambda: run.plot(picture),
        "Trajectory.reaction": lambda: run.reaction("pin0"),
        "Bounds.plot": lambda: bounds.plot(picture),
        "Bounds.report": lambda: bounds.report(page, limits),
        "Bounds.check": lambda: bounds.check(limits),
        "Bounds.statistical": lambda: bounds.statistical(limits),
        "Bounds.contributions": bounds.contributions,
    }
    if find_spec("ziglang"):
        found |= {"live": lambda: mb.live(scene, page), "Bounds.live": lambda: bounds.live(page)}
    return found


def functions(count: int, seed: int) -> int:
    """Print how public functions end by signals."""
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        jobs = long_functions(folder)
        faults = [ended_work(job, count // len(jobs) + 1, f"{name} {seed}") for name, job in jobs.items()]
    return int(sum(faults) > 0)


def ended(work: Callable[[], object], moment: float) -> tuple[float | None, str]:
    """Time from a signal to the end of the work; None if it had ended before; and what did not hold."""
    sent: list[float] = []

    def press() -> None:
        sent.append(time.monotonic())
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)

    timer = threading.Timer(moment, press)
    fault = ""
    try:
        timer.start()
        work()
        ended = not sent
        timer.cancel()
        timer.join()
        time.sleep(0.01)  # what is repeated arrives
        if ended and not sent:
            return None, ""
        fault = "" if ended else "the signal was lost"
    except KeyboardInterrupt:
        pass
    except Exception as error:
        fault = f"it became {error!r}"
    seconds = time.monotonic() - sent[0]
    return seconds, fault or (f"took {seconds:.1f} s" if seconds > MOST else "")


def ended_work(work: Callable[[], object], count: int, seed: str) -> int:
    """The number of faults of so many signals, which are printed."""
    choice, times, faults = random.Random(seed), [], 0
    work()
    begin = time.monotonic()
    work()
    longest = time.monotonic() - begin
    while len(times) < count:
        moment = choice.uniform(0.0, longest)
        try:
            seconds, fault = ended(work, moment)
        except KeyboardInterrupt:  # one behind the end
            continue
        times += [] if seconds is None else [seconds]
        faults += bool(fault)
        if fault:
            print(f"{seed}, after {moment:.3f} s: {fault}", flush=True)
    print(f"{seed}: {count} signals, longest {max(times):.2f} s, {faults} faults", flush=True)
    return faults


def declarations(count: int, seed: int) -> int:
    """Print how declarations end by signals."""
    warnings.simplefilter("ignore")
    os.environ["SYMMB_CFLAGS"] = "-O0"
    choice = random.Random(seed)
    return int(ended_work(lambda: follower(choice.random()), count, f"declarations {seed}") > 0)


if __name__ == "__main__":
    for ignored in (signal.SIGINT, signal.SIGHUP, signal.SIGQUIT):  # by shells, in the background
        signal.signal(ignored, signal.default_int_handler if ignored == signal.SIGINT else signal.SIG_DFL)
    if sys.argv[1:2] in (["programs"], ["declarations"], ["functions"]):
        chosen = {"programs": programs, "declarations": declarations, "functions": functions}[sys.argv[1]]
        sys.exit(chosen(*(int(text) for text in (*sys.argv[2:], *("50", "0")[len(sys.argv) - 2 :]))))
    MOMENTS = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    for command in COMMANDS:
        result = study(command, MOMENTS)
        print(f"{command:20}  {2 * MOMENTS} signals, longest {result.longest:.2f} s, {len(result.faults)} faults")
        for fault in result.faults:
            print(f"    {fault}")
