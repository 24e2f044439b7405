"""Drawings of mechanisms. A run is converted to a `Drawing`, and a `Drawing` to a page, a still picture or a film.

- `draw` makes a `Drawing` (`shapes`) of a run. `bodies`, `joints`, `forces` and `curves` give the shapes of elements,
  and `survey` computes the numbers of a run. `forms` and `outlines` are the triangles of shapes.
- `exhibit` adds bounds, worst cases and sweeps. `page`, `still` and `film` write files, and `show` contains `view`.
"""

from symmb._doors import open_door
from symmb.show.drawing import curves, forces, joints  # they register their sketches

open_door(__name__)
