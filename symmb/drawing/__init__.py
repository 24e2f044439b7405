"""The mechanism drawn: a run becomes a `Drawing` of shapes in numbers, and that a page, a still or a film."""

from symmb.drawing import curves, forces, joints
from symmb.drawing.draw import draw
from symmb.drawing.exhibit import attaining_runs, of_bounds, of_run
from symmb.drawing.page import page
from symmb.drawing.show import FORMATS, start_picture, view
from symmb.drawing.still import still
