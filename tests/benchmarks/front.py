"""Error against run time: polynomial chaos beside scans, random runs, corners and optimisation.

    PYTHONPATH=. python tests/benchmarks/front.py [SCENES ...] [--repeats 9] [--picture FILE]

All methods run on one core, in turn. Seconds are medians of the processor time of `propagate` on prepared scenes. The
error is the root mean square over time of both bounds over that of the width, the mean over the outputs. It is measured
from what all methods and a fine scan attain. Between two points of a method, errors and seconds are interpolated on
logarithmic axes. The ratio at an error is the time of polynomial chaos over the least time of the methods that run the
scene itself. The other expansions are in the picture only. `--points` prints each point, and for polynomial chaos the
told error over the true one.
"""

import argparse
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from _suite import duffing
from _timing import pin

import symmb as mb
from models import bouncing_ball, double_pendulum, four_bar, half_car, heavy_top, slider_crank, slider_crank_spatial
from symmb.bound.methods.method import Method
from symmb.study.metrics import Yardstick
from symmb.study.reference import find_reference

ERRORS = 10.0 ** -np.arange(2.0, 5.5, 0.5)
CHAOS = "PolynomialChaos()"
RUNS_ALONE = "scanning", "Monte Carlo", "vertex", "optimisation"
CHEBYSHEV = {"nodes": mb.ChebyshevGauss(), "range": mb.ChebyshevInclusion()}


def around(make: Callable[[], mb.Scene], percent: float) -> mb.Scene:
    scene = make()
    names = scene.box.names
    return replace(scene, box=mb.Box.around({n: scene.system.parameters[n] for n in names}, f"{percent:g}%"))


SCENES: dict[str, Callable[[], mb.Scene]] = {
    "double pendulum 5 %": lambda: around(double_pendulum.scene, 5),
    "double pendulum 10 %": lambda: around(double_pendulum.scene, 10),
    "four-bar": four_bar.scene,
    "slider-crank": slider_crank.scene,
    "Duffing": lambda: duffing(10.0),
    "half car": half_car.scene,
    "bouncing ball": bouncing_ball.scene,
    "heavy top": heavy_top.scene,
    "spatial slider-crank": slider_crank_spatial.scene,
}


def families(d: int) -> dict[str, list[Method]]:
    """The methods by their names in the legend, with their resolutions from fast to accurate."""
    counts = [n for n in (3, 5, 7, 9, 13, 17, 21, 31, 41, 61, 81, 121) if n**d <= 6000]
    orders = [p for p in (2, 3, 4, 5, 6) if (p + 1) ** d <= 2000]
    return {
        CHAOS: [mb.PolynomialChaos(tolerance=tolerance) for tolerance in (0.1, 1e-2, 1e-3, 1e-4, 1e-5)],
        "scanning": [mb.Scanning(n) for n in counts],
        "Monte Carlo": [mb.MonteCarlo(n) for n in (30, 100, 300, 1000, 3000)],
        "vertex": [mb.Vertex()],
        "optimisation": [mb.Optimization(n) for n in (100, 300, 1000)],
        "paper": [mb.PolynomialChaos.paper(p) for p in orders],
        "Chebyshev inclusion": [mb.PolynomialChaos(order=p, **CHEBYSHEV) for p in orders],
        "Taylor": [mb.Taylor(order) for order in (1, 2, 3)],
    }


def least_seconds(seconds: np.ndarray, errors: np.ndarray, wanted: float) -> float:
    """Least time in which a method reaches an error, on logarithmic axes; infinite if it does not reach it."""
    order = np.argsort(seconds)
    seconds, errors = np.log(seconds[order]), np.log(np.maximum(np.minimum.accumulate(errors[order]), 1e-16))
    wanted = np.log(wanted)
    if wanted < errors[-1]:
        return np.inf
    k = int(np.argmax(errors <= wanted))
    if k == 0 or errors[k - 1] == errors[k]:
        return float(np.exp(seconds[k]))
    part = (errors[k - 1] - wanted) / (errors[k - 1] - errors[k])
    return float(np.exp(seconds[k - 1] + part * (seconds[k] - seconds[k - 1])))


class Point(NamedTuple):
    """A method at one resolution. Errors are means over the outputs, divided by the widths."""

    text: str
    seconds: float
    error: float
    told: float  # nan: the method tells no error
    runs: int


def measured(scene: mb.Scene, repeats: int) -> dict[str, list[Point]]:
    """The points of each family of methods."""
    simulator = mb.prepare(scene)
    everything = [(name, method) for name, some in families(len(scene.box)).items() for method in some]
    found, seconds = dict[int, mb.Bounds](), {k: list[float]() for k in range(len(everything))}
    for repeat in range(repeats + 1):  # the first one warms up
        for k, (_, method) in enumerate(everything):
            begin = time.process_time()
            try:
                found[k] = mb.propagate(simulator, method, scene.box)
            except mb.SymmbError:
                continue
            if repeat:
                seconds[k].append(time.process_time() - begin)
    reference = find_reference(simulator, scene.box, runs=6000)
    by_runs = [bounds for bounds in found.values() if bounds.inner or bounds.kind == "sampled"]
    reference = reference.joined([bounds.inner or (bounds.lower, bounds.upper) for bounds in by_runs])
    yardstick = Yardstick(reference.lower, reference.upper, np.zeros(len(simulator.outputs)))
    result: dict[str, list[Point]] = {}
    for k, own in found.items():
        name, method = everything[k]
        error = float(np.nanmean(yardstick.deviation(own.lower, own.upper)))
        told = np.nan if own.estimate is None else float(np.nanmean(yardstick.relative(own.estimate[None])))
        point = Point(repr(method), float(np.median(seconds[k])), error, told, own.evaluations)
        result.setdefault(name, []).append(point)
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", metavar="SCENES", help=", ".join(SCENES).replace("%", "%%"))
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--picture", help="a file for the picture of all scenes")
    parser.add_argument("--points", action="store_true", help="print each point")
    options = parser.parse_args()
    pin()
    warnings.simplefilter("ignore", mb.SymmbWarning)
    chosen = {name: SCENES[name] for name in options.scenes or SCENES}
    figure, axes = plt.subplots(3, 3, figsize=(14, 12), squeeze=False)
    print(f"{'':22s}d " + "".join(f"{error:>14.0e}" for error in ERRORS))
    for ax, (name, make) in zip(axes.flat, chosen.items(), strict=False):
        scene = make()
        result = measured(scene, options.repeats)
        cells = []
        for error in ERRORS:
            times = {
                name: least_seconds(np.array([p.seconds for p in points]), np.array([p.error for p in points]), error)
                for name, points in result.items()
            }
            own, others = times[CHAOS], min(times[name] for name in RUNS_ALONE if name in times)
            cells.append(f"{own / others:.2f} of {1e3 * others:.0f}ms" if np.isfinite(others) else "-")
        print(f"{name:22s}{len(scene.box)} " + "".join(f"{cell:>14s}" for cell in cells), flush=True)
        for method, points in result.items():
            if options.points:
                for p in points:
                    told = "" if np.isnan(p.told) else f"  told/true {p.told / p.error:.1f}"
                    print(f"    {p.text:60s} {1e3 * p.seconds:8.1f} ms  {p.error:8.1e}  {p.runs} runs{told}")
            width = 2.5 if method == CHAOS else 1.2
            ax.loglog([p.seconds for p in points], [p.error for p in points], "o-", label=method, lw=width, ms=3)
        ax.set(title=name, xlabel="processor time [s]", ylabel="mean error over the width")
        ax.set(xlim=(1.5e-3, 3), ylim=(1e-8, 10))
        ax.grid(alpha=0.25)
    if options.picture:
        axes.flat[0].legend(fontsize=8)
        figure.tight_layout()
        figure.savefig(options.picture, dpi=90)


if __name__ == "__main__":
    main()
