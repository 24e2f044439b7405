"""What executors and the store cost: python tests/benchmarks/executors.py [dask] prints figures for two workers.

With MPI: mpiexec -n 3 python -m mpi4py.futures tests/benchmarks/executors.py mpi

python tests/benchmarks/executors.py faulty [SEED [TRIALS]] makes studies by executors that drop, repeat, exchange and
alter results, raise, and never return them, and studies whose runs kill their workers (processes, Dask). Each must end
with the right bounds, with failed runs by name, or with one sentence. It prints how they ended, and what did not hold.
"""

import os
import random
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
import symmb as mb
from models import double_pendulum
from symmb.connect import RunDatabase, executors, open_run_database
from symmb.connect.run_database import StoredStudy
from symmb.connect.simulator import Ensemble

sys.path.insert(0, str(Path(__file__).parent))
from _faulty_executors import FAULTS, FaultyMap, FaultySubmit

TIMES = np.linspace(0.0, 1.0, 11)
BOX = mb.Box(a=(0.5, 1.5), b=(0.8, 1.2))
WORKERS, RUNS, MEAN = 2, 400, 0.05
"""Workers, runs, and mean time of a run [s]."""


def duration(a: float, b: float) -> float:
    """Time of a run [s]: 50 ms on average, by chance up to a half more or less."""
    return MEAN * (0.5 + abs(np.sin(1e4 * a + 1e3 * b) * 1e4) % 1)


def slow(a: float, b: float) -> np.ndarray:
    """A run of about 50 ms, whose response takes several levels of nodes."""
    time.sleep(duration(a, b))
    return _response(a, b)


def short(a: float, b: float) -> np.ndarray:
    """A run of 25 ms: above the time at which several are sent at once."""
    time.sleep(0.025)
    return _response(a, b)


def _response(a: float, b: float) -> np.ndarray:
    t = TIMES[:, None]
    return np.hstack([np.exp(-a * t), np.cos(8 * a * b * t), np.tanh(20 * (a - 1.03 * b) * t)])


def simulator(f: Callable[..., np.ndarray]) -> mb.FunctionSimulator:
    """The simulator of a function."""
    return mb.FunctionSimulator(f, {"a": 1.0, "b": 1.0}, TIMES, ["x", "y", "z"])


def study(f: Callable[..., np.ndarray], method: Any, executor: Any) -> tuple[mb.Bounds, float]:
    """Bounds, and the time that they took [s]."""
    begin = time.perf_counter()
    bounds = mb.propagate(simulator(f), method, BOX, executor=executor)
    return bounds, time.perf_counter() - begin


def figures(name: str, executor: Any, reference: mb.Bounds, adaptive: mb.Bounds, workers: int = WORKERS) -> None:
    """Print the overhead of a run, and the share of the workers' time that runs take."""
    study(short, mb.MonteCarlo(10), executor)  # workers start
    _, seconds = study(short, mb.MonteCarlo(200), executor)
    overhead = (seconds - 200 * 0.025 / workers) * workers / 200
    bounds, seconds = study(slow, mb.MonteCarlo(RUNS), executor)
    points = np.asarray(mb.Random().points(RUNS, 2, 0))
    busy = sum(duration(*p) for p in BOX.from_unit(points)) / workers
    same = bounds.lower.tobytes() == reference.lower.tobytes() and bounds.upper.tobytes() == reference.upper.tobytes()
    other, taken = study(slow, mb.PolynomialChaos(), executor)
    same &= other.lower.tobytes() == adaptive.lower.tobytes() and other.upper.tobytes() == adaptive.upper.tobytes()
    share = other.evaluations * MEAN / workers / taken
    print(
        f"{name}: overhead {1e3 * overhead:.1f} ms a run; MonteCarlo({RUNS}) uses {busy / seconds:.1%} of the workers' "
        f"time, PolynomialChaos() with {other.evaluations} runs about {share:.0%}; "
        f"{'the same bits as alone' if same else 'OTHER BITS'}",
        flush=True,
    )


def store() -> None:
    """Print how fast runs of 12 x 1001 are stored and found."""
    Y = np.random.default_rng(0).standard_normal((1, 1001, 12))
    run = Ensemble(Y, np.array([True]), np.array([np.nan]), ())
    P = np.random.default_rng(1).uniform(size=(100_000, 4))
    with tempfile.TemporaryDirectory() as folder, open_run_database(Path(folder, "runs.db")) as database:
        number = database.begin(StoredStudy("digest", "none", tuple("abcd"), tuple("abcdefghijkl"), np.arange(1001.0)))
        begin = time.perf_counter()
        for p in P[:10_000]:
            database.add(number, p, run, 0.0)
        written = time.perf_counter() - begin
        _look_up(database, number, P[:10_000], 10_000)
        size = sum(path.stat().st_size for path in Path(folder).iterdir())
    small = Ensemble(Y[:, :1, :1], run.ok, run.t_failed, ())
    with tempfile.TemporaryDirectory() as folder, open_run_database(Path(folder, "runs.db")) as database:
        number = database.begin(StoredStudy("digest", "none", tuple("abcd"), ("x",), np.arange(1.0)))
        for p in P:
            database.add(number, p, small, 0.0)
        found = _look_up(database, number, P, 100_000)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"store: {10_000 / written:.0f} runs of 12 x 1001 a second, {size / 1e6:.0f} MB; 100,000 keys are looked up in "
        f"{found:.2f} s; at most {memory:.0f} MB of memory",
        flush=True,
    )


def _look_up(database: RunDatabase, number: int, P: np.ndarray, expected: int) -> float:
    begin = time.perf_counter()
    if len(database.known(number, P)) != expected:
        print("  runs are not found")
    return time.perf_counter() - begin


def main(kinds: list[str]) -> None:
    """Print the figures."""
    warnings.simplefilter("ignore")
    if not kinds:
        store()
    alone, _ = study(_response, mb.MonteCarlo(RUNS), None)
    adaptive, _ = study(_response, mb.PolynomialChaos(), None)
    if "mpi" in kinds:
        from mpi4py import MPI
        from mpi4py.futures import MPIPoolExecutor

        with MPIPoolExecutor() as pool:
            figures("mpi4py.futures", pool, alone, adaptive, MPI.COMM_WORLD.Get_size() - 1)
        return
    with ThreadPoolExecutor(WORKERS) as threads:
        figures("threads", threads, alone, adaptive)
    with ProcessPoolExecutor(WORKERS) as processes:
        figures("processes", processes, alone, adaptive)
    figures("processes made by a function", lambda: ProcessPoolExecutor(WORKERS), alone, adaptive)
    if "dask" in kinds:
        from distributed import Client, LocalCluster

        with (
            LocalCluster(n_workers=WORKERS, threads_per_worker=1, dashboard_address=":0") as cluster,
            Client(cluster) as client,
        ):
            figures("Dask", client, alone, adaptive)


METHODS = mb.Vertex(), mb.Scanning(3), mb.MonteCarlo(200), mb.PolynomialChaos(budget=60), mb.PolynomialChaos(order=2)
KINDS = [(FaultyMap, fault) for fault in FAULTS] + [(FaultySubmit, fault) for fault in (*FAULTS, "never")]


def quick_response(a: float, b: float) -> np.ndarray:
    """A run that takes no time."""
    return _response(a, b)


def deadly(a: float, b: float) -> np.ndarray:
    """A run that kills its process near the upper corner of the box."""
    if a > 1.38 and b > 1.15:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.005)
    return _response(a, b)


def faulty_study(seed: int) -> str:
    """How a study by a faulty executor ended: "right bounds", "a sentence", or what did not hold."""
    choice = random.Random(seed)
    kind, fault = choice.choice(KINDS)
    method, source = choice.choice(METHODS), simulator(quick_response)
    box: mb.Box | None = BOX
    if choice.random() < 0.3:
        scene = double_pendulum.scene().with_times(TIMES)
        source, box = mb.DAESimulator(scene), scene.box
    stored = choice.random() < 0.3
    try:
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder, name) for name in ("own.db", "runs.db")]
            own, used = (mb.StoredSimulator(source, path) if stored else source for path in paths)
            expected = mb.propagate(own, method, box)
            bounds = mb.propagate(used, method, box, executor=kind(fault, choice))
    except mb.SymmbError as error:
        return "a sentence" if "\n" not in str(error) else f"{kind.__name__} {fault}: several lines: {error}"
    except Exception as error:
        return f"{kind.__name__} {fault}: {type(error).__name__}: {error}"
    far = np.abs([bounds.lower - expected.lower, bounds.upper - expected.upper]).max()
    return "right bounds" if far == 0 else f"{kind.__name__} {fault}: bounds are off by {far:g}"


def deadly_study(executor: Any) -> str:
    """How a study ended in which some runs kill their worker."""
    points = BOX.from_unit(np.asarray(mb.Random().points(60, 2, 0)))
    dead = (points[:, 0] > 1.38) & (points[:, 1] > 1.15)
    alone = mb.FunctionSimulator(_response, {"a": 1.0, "b": 1.0}, TIMES, ["x", "y", "z"]).run(points[~dead])
    try:
        bounds = mb.propagate(simulator(deadly), mb.MonteCarlo(60), BOX, executor=executor)
    except mb.SymmbError as error:
        return "a sentence" if "\n" not in str(error) else f"several lines: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    if len(bounds.failed) != dead.sum():
        return f"{len(bounds.failed)} failed runs for {dead.sum()}"
    lower, upper = alone.extremes()
    assert bounds.inner is not None
    right = (bounds.inner[0] == lower).all() and (bounds.inner[1] == upper).all()
    return "failed runs by name" if right else "other bounds than those of the other runs"


def faulty(seed: int, trials: int) -> int:
    """Print how studies by faulty executors end, and those by workers that die."""
    executors._START_SECONDS = 0.3  # the futures of these either run at once or never
    found = Counter(faulty_study(seed + k) for k in range(trials))
    for _ in range(max(1, trials // 20)):
        found[deadly_study(lambda: ProcessPoolExecutor(WORKERS))] += 1
    found += _deadly_dask(max(1, trials // 20))
    for outcome, count in sorted(found.items()):
        print(f"{count:4}  {outcome}")
    return len(found.keys() - {"right bounds", "a sentence", "failed runs by name"})


def _deadly_dask(trials: int) -> Counter[str]:
    from distributed import Client, LocalCluster

    found = Counter[str]()
    for k in range(trials):
        with (
            LocalCluster(n_workers=WORKERS, threads_per_worker=1, dashboard_address=":0", silence_logs=50) as cluster,
            Client(cluster) as client,
        ):
            found[deadly_study(client.get_executor() if k % 2 else client)] += 1
        found[deadly_study(client)] += 1  # it is closed
    return found


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if sys.argv[1:2] == ["faulty"]:
        warnings.simplefilter("ignore")
        sys.exit(faulty(*map(int, [*sys.argv[2:], "0", "100"][:2])))
    main(sys.argv[1:])
