"""What executors and the store cost: python tests/benchmarks/executors.py [dask] prints figures for two workers.

With MPI: mpiexec -n 3 python -m mpi4py.futures tests/benchmarks/executors.py mpi
"""

import os
import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
import symmb as mb
from symmb.simulation import RunDatabase, opened
from symmb.simulation.run_database import Study
from symmb.simulation.simulator import Ensemble

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
    with tempfile.TemporaryDirectory() as folder, opened(Path(folder, "runs.db")) as database:
        number = database.begin(Study("digest", "none", tuple("abcd"), tuple("abcdefghijkl"), np.arange(1001.0)))
        begin = time.perf_counter()
        for p in P[:10_000]:
            database.add(number, p, run, 0.0)
        written = time.perf_counter() - begin
        _look_up(database, number, P[:10_000], 10_000)
        size = sum(path.stat().st_size for path in Path(folder).iterdir())
    small = Ensemble(Y[:, :1, :1], run.ok, run.t_failed, ())
    with tempfile.TemporaryDirectory() as folder, opened(Path(folder, "runs.db")) as database:
        number = database.begin(Study("digest", "none", tuple("abcd"), ("x",), np.arange(1.0)))
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


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main(sys.argv[1:])
