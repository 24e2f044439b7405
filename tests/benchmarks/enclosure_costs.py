"""Time and memory of proved bounds against order, uncertain parameters and states, as a picture.

    PYTHONPATH=.:tests python tests/benchmarks/enclosure_costs.py costs.png

The scene is a row of masses on springs with cubic stiffness over 0.2 s, whose first stiffnesses are known to 2 %. A
study runs in a process of its own, whose largest memory is told, less that of a process that imports the same.
"""

import argparse
import json
import resource
import subprocess
import sys
import time

import matplotlib.pyplot as plt
import numpy as np

import symmb as mb
from symmb.prove import enclose, problem_of
from symmb.run.simulation import DAESimulator

ORDERS, MASSES, PARAMETERS = (2, 4, 6, 8, 12), (1, 2, 3, 4, 6), (1, 2, 3, 4, 5, 6)
FAR = 30.0
"""Time after which larger studies are not tried [s]."""


def scene(masses: int, uncertain: int) -> mb.Scene:
    p = mb.Parameters(**{f"k{i}": 10.0 for i in range(max(masses, uncertain))})
    bodies = [mb.Body(f"m{i}", mass=1.0, pose=mb.Particle()) for i in range(masses)]
    stretches = [b.x - a for a, b in zip([0.0, *(m.x for m in bodies)], bodies, strict=False)]
    share = [getattr(p, f"k{i}") for i in range(max(masses, uncertain))]
    pulls = [k * (s + s**3) for k, s in zip(share, stretches, strict=False)]
    pulls[0] = pulls[0] + sum((k * 0.1 * bodies[0].x ** 5 for k in share[masses:]), start=0.0 * bodies[0].x)
    forces = [
        mb.Force(f"f{i}", m.point(0, 0), (after - before, 0))
        for i, (m, before, after) in enumerate(zip(bodies, pulls, [*pulls[1:], 0.0], strict=True))
    ]
    box = mb.Box.around(p, 0.02, names=[f"k{i}" for i in range(uncertain)])
    outputs = {m.name: m.x for m in bodies}
    start = {f"m{masses - 1}.x": 0.5}
    return mb.Scene(mb.System(*bodies, *forces, parameters=p), start, np.linspace(0, 0.2, 3), outputs, box=box)


def study(order: int, masses: int, uncertain: int) -> None:
    """Print seconds and the largest memory [MB] of this process."""
    made = scene(masses, uncertain)
    problem = problem_of("benchmark", DAESimulator(made), made.box)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.process_time()
    found = enclose(problem, order, 1)
    seconds = time.process_time() - begin
    memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    print(json.dumps([seconds, memory, found.why]))


def measured(order: int, masses: int, uncertain: int) -> tuple[float, float, bool]:
    """Seconds, memory [MB], and whether the motion is proved to the end."""
    run = subprocess.run([sys.executable, __file__, "--study", str(order), str(masses), str(uncertain)], check=True,
                         capture_output=True, text=True)  # fmt: skip
    seconds, memory, why = json.loads(run.stdout)
    print(f"order {order:2}, {2 * masses:2} states, {uncertain} parameters: {seconds:7.2f} s, {memory:6.0f} MB {why}",
          flush=True)  # fmt: skip
    return seconds, max(memory, 0.1), not why


def picture(path: str) -> None:
    figure, axes = plt.subplots(2, 2, figsize=(10, 7), sharey="row", sharex="col", layout="constrained")
    for uncertain in PARAMETERS:
        for column, values in enumerate((ORDERS, MASSES)):
            points = []
            for value in values:
                order, masses = (value, 1) if column == 0 else (4, value)
                points.append((2 * value if column else value, *measured(order, masses, uncertain)))
                if points[-1][1] > FAR:
                    break
            x, seconds, memory, proved = np.transpose(points)
            for row, y in enumerate((seconds, memory)):
                [line] = axes[row, column].plot(x, y, "o-", label=f"{uncertain} uncertain")
                axes[row, column].plot(x[proved == 0], y[proved == 0], "o", color=line.get_color(), mfc="white")
    for row, label in enumerate(("seconds of one core", "memory [MB]")):
        axes[row, 0].set(yscale="log", ylabel=label)
        axes[row, 0].grid(alpha=0.3), axes[row, 1].grid(alpha=0.3)
    axes[1, 0].set_xlabel("order, with 2 states")
    axes[1, 1].set_xlabel("states, at order 4")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(PARAMETERS),
                  frameon=False, title="parameters (hollow: not proved to the end)")  # fmt: skip
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", nargs="?", default="costs.png")
    parser.add_argument("--study", nargs=3, type=int, help="order, masses, uncertain parameters: in this process")
    options = parser.parse_args()
    study(*options.study) if options.study else picture(options.path)
