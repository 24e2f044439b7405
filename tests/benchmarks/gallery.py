"""The pictures of the gallery's cards: each shipped scene and each example with a mechanism, as a still of one size.

PYTHONPATH=. python tests/benchmarks/gallery.py [NAME ...]

It writes `examples/figures/mechanisms/NAME.png`, by default for all names. Lines and margins have the same size on all
pictures. Letters are left out: the cards have titles.
"""

import runpy
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

from PIL import Image

import symmb as mb
from symmb.show.cli.scene_file import load_scene, shipped_names
from symmb.show.drawing.exhibit import of_run
from symmb.show.drawing.still import canvas, paint

EXAMPLES = Path(__file__).parents[2] / "examples"
PICTURES = EXAMPLES / "figures" / "mechanisms"
SIZE, DPI, TINTS = (7.0, 5.25), 64, 48
"""Of a picture [inch], pixels of an inch, and how many colours it has. Stills are as wide."""
SHOWN_AT = 0.3
"""Share of the run at which its still is taken: most mechanisms have left their start there."""


def drawn(names: list[str]) -> Iterator[tuple[str, mb.Trajectory]]:
    """Names, and a run of each that has bodies."""
    for name in shipped_names():
        if name in names and load_scene(name).system.bodies:
            yield name, mb.simulate(load_scene(name))
    for path in sorted(EXAMPLES.glob("*.py")):
        if path.stem in names and path.stem not in shipped_names():
            found = [*runpy.run_path(str(path)).values()]
            runs = [value for value in found if isinstance(value, mb.Trajectory)]
            scenes = [value for value in found if isinstance(value, mb.Scene) and value.system.bodies]
            if runs or scenes:
                yield path.stem, runs[0] if runs else mb.simulate(scenes[0])


def draw(run: mb.Trajectory, path: Path) -> None:
    """Write the still of a run, in a frame of the common shape."""
    exhibit = of_run(run, float(run.t[0] + SHOWN_AT * (run.t[-1] - run.t[0])), None)
    figure, axes = canvas(exhibit, [exhibit.picture], DPI)
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    half = max(right - left, (high - low) * SIZE[0] / SIZE[1]) / 2
    figure.set_size_inches(*SIZE)
    axes.set_xlim((left + right) / 2 - half, (left + right) / 2 + half)
    axes.set_ylim((low + high) / 2 - half * SIZE[1] / SIZE[0], (low + high) / 2 + half * SIZE[1] / SIZE[0])
    paint(axes, exhibit, exhibit.picture)
    for artist in [*axes.texts, axes.lines[-1]]:  # letters, arrows, and the line of the scale
        artist.remove()
    figure.savefig(path)
    Image.open(path).convert("RGB").quantize(TINTS).save(path, optimize=True)


def main(names: list[str]) -> None:
    warnings.simplefilter("ignore", mb.SymmbWarning)
    PICTURES.mkdir(exist_ok=True)
    for name, run in drawn(names or [*shipped_names(), *(path.stem for path in EXAMPLES.glob("*.py"))]):
        draw(run, PICTURES / f"{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
