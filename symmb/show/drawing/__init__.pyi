"""The names that other rooms use. `_doors` loads their modules when they are used."""

from . import curves as curves, forces as forces, joints as joints
from .draw import draw as draw, surveyed as surveyed
from .exhibit import (
    UPPER as UPPER,
    Exhibit as Exhibit,
    Ghost as Ghost,
    attaining_runs as attaining_runs,
    of_bounds as of_bounds,
    of_run as of_run,
)
from .page import Live as Live, bare as bare, page as page
from .shapes import Drawing as Drawing, MovingFrame as MovingFrame
from .show import FORMATS as FORMATS, Page as Page, start_picture as start_picture, view as view
from .still import still as still
from .survey import Driven as Driven
