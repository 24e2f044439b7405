"""The pictures of README, as large as they are shown, so that their letters are as large as those of the text.

PYTHONPATH=.:tests python tests/benchmarks/readme_pictures.py FOLDER

The first one is the page of `examples/rod_on_a_spring.py`, as Chromium shows it. The second one is drawn of what
README's comparison writes.
"""

import runpy
import subprocess
import sys
import time
from pathlib import Path

from browser import Browser

import symmb as mb

ROOT = Path(__file__).parents[2]
WIDTH, HEIGHT = 830, 430
"""Of the page [pixels], as wide as the column of code hosts."""
INCHES = 6.4, 5.2
"""Of the comparison: letters of 8 points are 14 pixels high if it is as wide as the column."""


def page(folder: Path) -> None:
    sys.argv = ["rod_on_a_spring.py", str(folder)]
    runpy.run_path(str(ROOT / "examples" / "rod_on_a_spring.py"))
    with Browser() as browser:
        browser.resize(WIDTH, HEIGHT, ratio=2)
        browser.open(folder / "rod_on_a_spring.html", "t=1.9")
        time.sleep(1)  # for the fonts
        browser.screenshot(folder / "rod.png")


def comparison(folder: Path) -> None:
    numbers = folder / "out.npz"
    subprocess.run([sys.executable, "-m", "symmb", "compare", "double_pendulum", "--save", numbers], check=True)
    figure = mb.Comparison.load(numbers).plot(outputs="theta2_dot", figsize=INCHES)
    for legend in figure.subfigs[0].legends:  # colours are those below
        legend.remove()
    figure.savefig(folder / "compare.png", dpi=200)


if __name__ == "__main__":
    page(Path(sys.argv[1]))
    comparison(Path(sys.argv[1]))
