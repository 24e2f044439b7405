"""What bounding costs beyond the runs: the double pendulum beside a scan, then every scene of models/ at +-10 %.

    PYTHONPATH=. python tests/benchmarks/bounding.py [repeats]

Seconds are those that pass, medians of repeats that take turns in one process. The runs' seconds are those inside the
simulator during the same study; "beyond" is the rest of it, and "first" that of the first study, which may compile. The
scan has 441 runs.
"""

import importlib
import pkgutil
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
import models
import symmb as mb
from models import double_pendulum
from symmb import DAESimulator
from symmb.bound.methods.method import Method
from symmb.bound.reductions import bounded

SPREADS = (0.05, 0.1, 0.15, 0.2)
COLUMNS = {"d": 3, "values": 8, "runs": 6, "runs, s": 9, "beyond, s": 11, "of allowed": 12, "first, s": 10}
SCAN = mb.Scanning(21)


class Stopwatch:
    """Adds up the seconds that a simulator spends on runs."""

    def __init__(self, simulator: DAESimulator) -> None:
        self.simulator, self.seconds, self._stream = simulator, 0.0, simulator.stream
        simulator.stream = self._timed

    def _timed(self, *arguments: object) -> object:
        begin = time.perf_counter()
        parts = list(self._stream(*arguments))
        self.seconds += time.perf_counter() - begin
        return iter(parts)


def study(watch: Stopwatch, method: Method, box: mb.Box) -> tuple[mb.Bounds, float, float]:
    """Bounds, seconds of the runs and seconds beyond."""
    watch.seconds, begin = 0.0, time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.SymmbWarning)
        bounds = bounded(method, watch.simulator, box)
    return bounds, watch.seconds, time.perf_counter() - begin - watch.seconds


def beside_scan(repeats: int) -> None:
    """Seconds beyond the runs over those of a scan."""
    print(
        f"{'double pendulum':18s}{'runs':>6s}{'runs, ms':>10s}{'beyond, ms':>12s}{'scan, ms':>10s}{'beyond/scan':>13s}"
    )
    scene = double_pendulum.scene()
    watch = Stopwatch(DAESimulator(scene))
    boxes = [mb.Box.around(scene.system.parameters, spread) for spread in SPREADS]
    seconds = np.zeros((len(boxes), repeats + 1, 3))
    runs = np.zeros(len(boxes), dtype=int)
    for repeat in range(repeats + 1):
        for k, box in enumerate(boxes):
            begin = time.perf_counter()
            bounded(SCAN, watch.simulator, box)
            scan = time.perf_counter() - begin
            bounds, within, beyond = study(watch, mb.PolynomialChaos(), box)
            runs[k], seconds[k, repeat] = bounds.evaluations, (within, beyond, scan)
    for spread, number, rows in zip(SPREADS, runs, seconds, strict=True):
        within, beyond, scan = 1e3 * np.median(rows[1:], axis=0)
        ratio = np.median(rows[1:, 1] / rows[1:, 2])
        print(f"+-{spread:<16.0%}{number:6d}{within:10.1f}{beyond:12.1f}{scan:10.1f}{ratio:13.2f}", flush=True)


def widened(scene: mb.Scene) -> mb.Box:
    """The box with parameters known to +-10 %; those with a nominal value of 0 keep their interval."""
    parameters, box = scene.system.parameters, scene.box
    own = zip(box.names, box.lower.tolist(), box.upper.tolist(), strict=True)
    ends = {name: sorted((0.9 * parameters[name], 1.1 * parameters[name])) for name in box.names}
    return mb.Box(**{name: tuple(ends[name]) if parameters[name] else (low, high) for name, low, high in own})


def every_scene(repeats: int) -> None:
    """Seconds beyond the runs over what is allowed: a second and three times those of the runs."""
    columns = "".join(f"{name:>{width}s}" for name, width in COLUMNS.items())
    print(f"\n{'+-10 %':24s}{columns}  doubts")
    for name in sorted(module.name for module in pkgutil.iter_modules(models.__path__)):
        declared: Callable[[], mb.Scene] = importlib.import_module(f"models.{name}").scene
        scene = declared()
        if scene.box is None:
            continue
        box = widened(scene)
        watch = Stopwatch(DAESimulator(scene))
        try:
            studies = [study(watch, mb.PolynomialChaos(), box) for _ in range(repeats + 1)]
        except mb.SymmbError as error:
            print(f"{name:24s}{len(box):3d}  {str(error).splitlines()[0][:90]}", flush=True)
            continue
        bounds = studies[0][0]
        first = studies[0][2]
        within, beyond = np.median([row[1:] for row in studies[1:]], axis=0)
        share = beyond / (1 + 3 * within)
        doubts = "; ".join(text[:60] for text in bounds.doubts)
        print(
            f"{name:24s}{len(box):3d}{bounds.lower.size:8d}{bounds.evaluations:6d}{within:9.3f}{beyond:11.3f}{share:12.2f}{first:10.3f}"
            f"  {doubts}", flush=True,
        )  # fmt: skip


if __name__ == "__main__":
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    beside_scan(repeats)
    every_scene(min(repeats, 3))
