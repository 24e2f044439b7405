"""Scenes as functions `scene(...) -> Scene`, in a checkout: their files lie in `models` beside the package.

An installed wheel has the files of that folder in the place of this one.
"""

from pathlib import Path

__path__ = [str(Path(__file__).parents[2] / "models")]
