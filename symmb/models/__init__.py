"""Scenes as functions `scene(...) -> Scene`. In a checkout, their files are in the folder `models` beside the package.

In an installed wheel, the files of that folder replace this file.
"""

from pathlib import Path

__path__ = [str(Path(__file__).parents[2] / "models")]
