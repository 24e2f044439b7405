"""Largest tolerances of everyday machines, against many runs over the box that is found and over a wider one.

    PYTHONPATH=. python tests/benchmarks/machine_tolerances.py [MACHINES ...] [--seeds 0-2] [--number 3] [--truth DIR]

Each problem has a limit of a random output between that of the nominal run and a little beyond the true range. A factor
is right if 10,000 runs over its box keep the limit, and a run over a box that is 2 % wider breaks it. Curves have to
keep a limit between output times, too: these runs have `PARTS` times as many times. Runs are at corners, on edges and
faces, inside, and then at the neighbours of the worst ones. A line through the worst place of the wider box tells how
much larger the factor may be at most.
"""

import argparse
import time
import warnings
from pathlib import Path

import numpy as np
from everyday_machines import MACHINES, kept_truth
from scipy.optimize import brentq

import symmb as mb
from symmb.bound.responses import parameter_samples
from symmb.run.simulation import Subject

ALLOWED = 1.02
"""A factor may be so many times too small."""
PARTS = 8
"""Parts of the distance of two output times. Runs have values at their ends."""
LOCAL = 0.5, 0.2, 0.05, 0.02
"""Steps of local searches."""


def stretched(box, nominal, factor):
    return mb.Box(**{n: tuple(nominal[n] + factor * (end - nominal[n]) for end in box[n]) for n in box.names})


def excess(simulator, box, points, sign, limit):
    """How far runs at points (N, d) of the unit box are beyond a limit."""
    values = [
        sign * simulator.run(parameter_samples(simulator, box, some)).Y[:, :, 0] - sign * limit
        for some in np.array_split(points, len(points) // 2000 + 1)
    ]
    return np.concatenate(values).max(axis=1)


def worst(simulator, box, sign, limit, number, rng):
    """How far the worst of so many runs is beyond a limit, and its place (d,)."""
    d = len(box)
    corners = np.indices((2,) * d).reshape(d, -1).T * 2.0 - 1.0 if d <= 10 else rng.choice([-1.0, 1.0], (1024, d))
    inside = rng.uniform(-1, 1, (max(number - len(corners), 500), d))
    sides = rng.uniform(size=inside.shape) < rng.choice([0.0, 0.5, 0.8], (len(inside), 1))
    points = np.concatenate([corners, np.where(sides, np.sign(inside), inside)])
    values = excess(simulator, box, points, sign, limit)
    for step in LOCAL:
        for _ in range(3):
            best = np.argsort(-values)[:8]
            points, values = points[best], values[best]
            moves = rng.normal(size=(8, 4 * d, d)) * np.where(rng.uniform(size=(8, 4 * d, d)) < 2 / d, step, 0.0)
            new = np.clip(points[:, None] + moves, -1, 1).reshape(-1, d)
            points = np.concatenate([points, new])
            values = np.concatenate([values, excess(simulator, box, new, sign, limit)])
    return values.max(), points[values.argmax()]


def solve(scene, truth, rng):
    """Factor, how many times larger the true one may be, how far runs are beyond over the width, runs, seconds."""
    names = scene.output_names
    k, sign = int(rng.integers(len(names))), float(rng.choice([-1, 1]))
    n = len(scene.times)
    times = np.interp(np.arange(PARTS * (n - 1) + 1) / PARTS, np.arange(n), scene.times)
    own = scene.with_outputs({names[k]: scene.outputs[names[k]]}).with_times(times)
    simulator, box = Subject.of(own).over()
    nominal = dict(simulator.parameters)
    at_nominal = (sign * simulator.run(np.array([[*nominal.values()]])).Y[0, :, 0]).max()
    reach = (sign * truth[0 if sign < 0 else 1][:, k]).max()
    limit = sign * (at_nominal + rng.uniform(0.4, 1.2) * (reach - at_nominal))
    if not reach > at_nominal + 1e-9 * abs(at_nominal):
        return None
    begin = time.process_time()
    found = mb.tolerances(scene, {names[k]: (limit, None) if sign < 0 else (None, limit)})
    seconds = time.process_time() - begin
    beyond, place = worst(simulator, found.box, sign, limit, 10_000, rng)

    def along(share):
        return excess(simulator, stretched(box, nominal, share * found.factor), place[None], sign, limit)[0]

    wider, over = min(ALLOWED, 16 / found.factor), along(min(ALLOWED, 16 / found.factor))
    while over < 0 and wider * found.factor < 4:
        over, place = worst(simulator, stretched(box, nominal, wider * found.factor), sign, limit, 3000, rng)
        wider *= 1.0 if over > 0 else 1.1
    larger = np.inf if over < 0 else brentq(along, 0, wider, xtol=1e-4)
    return names[k], found, larger, beyond / (reach - at_nominal), seconds


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machines", nargs="*", metavar="MACHINES", help=", ".join(MACHINES))
    parser.add_argument("--seeds", default="0")
    parser.add_argument("--number", type=int, default=3)
    parser.add_argument("--truth", type=Path, default=Path("build/true_ranges"))
    options = parser.parse_args()
    warnings.simplefilter("ignore", mb.SymmbWarning)
    first, _, last = options.seeds.partition("-")
    ratios, beyonds, runs, times = [], [], [], []
    for seed in range(int(first), int(last or first) + 1):
        for number, name in enumerate(options.machines or MACHINES):
            scene = MACHINES[name](np.random.default_rng(seed) if seed else None)
            truth = kept_truth(options.truth, f"{name} {seed}", scene)
            rng = np.random.default_rng([seed, number, 1])
            for _ in range(options.number):
                try:
                    solved = solve(scene, truth, rng)
                except mb.PropagationError as error:
                    print(f"{name} {seed}: {error}", flush=True)
                    ratios.append(np.inf)
                    continue
                if solved is None:
                    continue
                output, found, larger, beyond, seconds = solved
                ratios.append(larger)
                beyonds.append(beyond)
                runs.append(found.evaluations)
                times.append(seconds)
                limit = found.check[output].text
                text = f"{name} {seed}: {limit:32s} factor {found.factor:.4f}, may be {larger:.4f} times"
                beside = f"runs beyond by {100 * max(beyond, 0):.3f} %, kept {found.check.kept}"
                print(text, beside, f"{found.evaluations} runs, {seconds:.1f} s", *found.remarks, flush=True)
    ratios = np.array(ratios)
    print(f"{len(ratios)} problems: {np.sum(ratios <= ALLOWED)} factors are less than 2 % too small, ", end="")
    print(f"{np.sum(np.array(beyonds) > 0)} boxes have runs beyond, at most {100 * max(beyonds):.2f} %; ", end="")
    print(f"runs {np.median(runs):.0f} in the median, seconds {np.median(times):.1f}")
