"""Drawings of mechanisms. A run is converted to a `Drawing`, and a `Drawing` to a page, a still picture or a film.

- `draw` makes a `Drawing` (`shapes`) of a run. `bodies`, `joints`, `forces` and `curves` give the shapes of elements,
  and `survey` computes the numbers of a run. `forms` and `outlines` are the triangles of shapes.
- `exhibit` adds bounds, worst cases and sweeps. `page`, `still` and `film` write files, and `show` contains `view`.
"""

from symmb.show.drawing import curves, forces, joints
from symmb.show.drawing.draw import draw, surveyed
from symmb.show.drawing.exhibit import UPPER, Exhibit, Ghost, attaining_runs, of_bounds, of_run
from symmb.show.drawing.page import Live, bare, page
from symmb.show.drawing.shapes import Drawing, MovingFrame
from symmb.show.drawing.show import FORMATS, Page, start_picture, view
from symmb.show.drawing.still import still
from symmb.show.drawing.survey import Driven
