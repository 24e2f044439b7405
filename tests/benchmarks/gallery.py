"""The contact sheet of the README: all shipped scenes and all examples that draw a mechanism, each as a still.

PYTHONPATH=. python tests/benchmarks/gallery.py FILE.png
"""

import runpy
import sys
import tempfile
import warnings
from pathlib import Path

import matplotlib.image as mpimg
from matplotlib.figure import Figure

import symmb as mb
from symmb.cli.scene_file import load_scene, shipped_names

EXAMPLES = Path(__file__).parents[2] / "examples"
COLUMNS = 6
SHOWN_AT = 0.3
"""Share of the run at which its still is taken: most mechanisms have left their start there."""


def drawn() -> list[mb.Trajectory]:
    """A run of each scene that has bodies."""
    runs = [mb.simulate(load_scene(name)) for name in shipped_names() if load_scene(name).system.bodies]
    for path in sorted(EXAMPLES.glob("*.py")):
        if "mb.view(run" in path.read_text(encoding="utf-8"):
            runs.append(runpy.run_path(str(path))["run"])
    return runs


def main(path: str) -> None:
    warnings.simplefilter("ignore", mb.SymmbWarning)
    runs = drawn()
    rows = -(-len(runs) // COLUMNS)
    figure = Figure(figsize=(3 * COLUMNS, 2.6 * rows), dpi=110)
    with tempfile.TemporaryDirectory() as folder:
        for i, run in enumerate(runs):
            still = Path(folder) / f"{i}.png"
            mb.view(run, still, time=float(run.t[0] + SHOWN_AT * (run.t[-1] - run.t[0])))
            axes = figure.add_subplot(rows, COLUMNS, i + 1)
            axes.imshow(mpimg.imread(still))
            axes.set_axis_off()
    figure.subplots_adjust(0, 0, 1, 1, 0.02, 0.02)
    figure.savefig(path)


if __name__ == "__main__":
    main(sys.argv[1])
