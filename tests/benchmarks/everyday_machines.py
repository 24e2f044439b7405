"""Bounds of everyday machines with the tolerances of a drawing, against 20,000 runs and local searches.

    PYTHONPATH=. python tests/benchmarks/everyday_machines.py [MACHINES ...] [--seeds 0-2] [--alone] [--truth FOLDER]

Seed 0 is the machine as drawn, others are random neighbours. Errors are root mean squares over time over that of the
true width. For each output: the true error, the estimate, the share of times at which the bounds miss the true range
by more than the estimate and 1 % of the width (silent), the most that is so missed (in brackets over the width at
that time, if that is larger), and the share of times at which a
doubt is needless, because the true error is less than half of the estimate. For each machine: runs, and processor
seconds beyond them. With `--alone` each output is studied by itself as well. True ranges are kept in a folder.
"""

import argparse
import time
import warnings
from pathlib import Path

import numpy as np
from _machines_a import MACHINES as MACHINES_A
from _machines_b import MACHINES as MACHINES_B
from _true_ranges import true_range

import symmb as mb
from symmb.bound.adaptive import runs as adaptive_runs
from symmb.bound.responses.time_windows import average_over_window, rms
from symmb.run.simulation import Subject

MACHINES = MACHINES_A | MACHINES_B
SILENT = 1e-2
"""Share of the width, beyond the estimate, that counts as missed in silence."""
NEEDLESS = 0.5
"""True error over the estimate below which a doubt is needless."""


class Clock:
    """A function, and the processor seconds of all of its calls."""

    def __init__(self, function):
        self.function, self.seconds = function, 0.0

    def __call__(self, *args, **options):
        begin = time.process_time()
        try:
            return self.function(*args, **options)
        finally:
            self.seconds += time.process_time() - begin


def kept_truth(folder, name, scene):
    """Lower and upper (n_t, n_y), from the folder if they are there."""
    file = folder / f"{name}.npz"
    if not file.exists():
        lower, upper, runs = true_range(*Subject.of(scene).over())
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(file, lower=lower, upper=upper, runs=runs)
    data = np.load(file)
    return data["lower"], data["upper"]


def windowed(a):
    return np.sqrt(average_over_window(np.square(a)))


def study(scene):
    """Bounds, and processor seconds beyond the runs."""
    clock = Clock(adaptive_runs.run_blocks)
    adaptive_runs.run_blocks = clock
    begin = time.process_time()
    try:
        bounds = mb.propagate(scene, mb.PolynomialChaos())
    finally:
        adaptive_runs.run_blocks = clock.function
    return bounds, time.process_time() - begin - clock.seconds


def doubtful_times(bounds):
    """(n_t, n_y) where bounds are told to be doubtful."""
    bad = np.zeros(bounds.lower.shape, dtype=bool)
    for name, first, last in bounds.doubtful_windows():
        bad[:, bounds.names.index(name)] |= (bounds.t >= first) & (bounds.t <= last)
    return bad


def judged(bounds, lower, upper):
    """(6, n_y): true error, estimate, share of silent times, most that is missed, also over the width at that time if
    this is larger, and share of needless times.
    """
    lower, upper = np.minimum(lower, bounds.inner[0]), np.maximum(upper, bounds.inner[1])
    width, estimate = rms(upper - lower), bounds.estimate
    error = np.maximum(np.abs(bounds.lower - lower), np.abs(bounds.upper - upper))
    missed = np.maximum(bounds.lower - estimate - lower, upper - bounds.upper - estimate) / width
    then = missed * width / np.maximum(windowed(upper - lower), width)
    needless = doubtful_times(bounds) & (windowed(error) < NEEDLESS * windowed(estimate))
    silent = (missed > SILENT).mean(axis=0)
    figures = silent, missed.max(axis=0), then.max(axis=0), needless.mean(axis=0)
    return np.stack([rms(error) / width, rms(estimate) / width, *figures])


def beside_alone(scene, bounds, output, width):
    """How the bounds of an output differ from those of a study of its own, in words."""
    k = bounds.names.index(output)
    own, _ = study(scene.with_outputs({output: scene.outputs[output]}))
    apart = np.maximum(np.abs(bounds.lower[:, k] - own.lower[:, 0]), np.abs(bounds.upper[:, k] - own.upper[:, 0]))
    told, apart = rms(own.estimate)[0] / width, rms(apart) / width
    return f"  alone {own.evaluations:5d} runs, told {100 * told:6.2f} %, apart {100 * apart:.2f} %"


def line(output, figures):
    """Figures of an output (6,), as `judged` gives them, in words."""
    error, estimate, silent, missed, then, needless = 100 * figures
    return (
        f"  {output:18s} error {error:6.2f} %  told {estimate:6.2f} %  silent {silent:5.1f} %"
        f" at most {missed:5.1f} ({then:.1f}) %  needless {needless:5.1f} %"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machines", nargs="*", metavar="MACHINES", help=", ".join(MACHINES))
    parser.add_argument("--seeds", default="0")
    parser.add_argument("--alone", action="store_true")
    parser.add_argument("--truth", type=Path, default=Path("build/true_ranges"))
    options = parser.parse_args()
    warnings.simplefilter("ignore", mb.SymmbWarning)
    first, _, last = options.seeds.partition("-")
    tables, studies = [], []
    for seed in range(int(first), int(last or first) + 1):
        for name in options.machines or MACHINES:
            scene = MACHINES[name](np.random.default_rng(seed) if seed else None)
            truth = kept_truth(options.truth, f"{name} {seed}", scene)
            bounds, seconds = study(scene)
            tables.append(judged(bounds, *truth))
            studies.append((bounds.evaluations, seconds))
            width = rms(truth[1] - truth[0])
            print(f"{name} {seed}: {len(scene.box)} parameters, {bounds.evaluations} runs, {seconds:.2f} s")
            for k, output in enumerate(bounds.names):
                alone = beside_alone(scene, bounds, output, width[k]) if options.alone else ""
                print(line(output, tables[-1][:, k]) + alone, flush=True)
    error, estimate, silent, missed, then, needless = np.concatenate(tables, axis=1)
    runs, seconds = np.array(studies).T
    ratio = np.median(estimate / np.maximum(error, 1e-12))
    print(f"{len(runs)} machines, {len(error)} outputs: true error {100 * np.median(error):.2f} % in the median, ")
    print(f"  estimate over error {ratio:.1f}; of output-times {100 * silent.mean():.2f} % silent, ", end="")
    print(
        f"{100 * needless.mean():.1f} % needless; at most {100 * missed.max():.1f} % missed ({100 * then.max():.1f} % "
        "of the width then); ",
        end="",
    )
    print(f"runs {np.median(runs):.0f}, seconds beyond them {np.median(seconds):.2f}, at most {seconds.max():.2f}")
