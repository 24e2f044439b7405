"""`view`: a scene, a run or bounds, drawn into a file whose suffix chooses the format."""

from pathlib import Path

from symmb._errors import DeclarationError
from symmb.bounds import Bounds
from symmb.drawing.draw import draw
from symmb.drawing.page import page
from symmb.files import replacement, require_suffix
from symmb.mechanics import Point
from symmb.model import Scene
from symmb.simulation import Trajectory, simulate

FORMATS = (".html",)


def view(
    subject: Scene | Trajectory | Bounds,
    path: str | Path,
    *,
    output: str | None = None,
    time: float | None = None,
    point: Point | None = None,
) -> None:
    """Draw a mechanism.

    Parameters
    ----------
    subject : Scene, Trajectory or Bounds      a Scene is simulated at its nominal parameters
    path : str or Path                         .html: a page to play, turn and look into, which needs no network
    point : Point                              whose path is drawn

    Raises
    ------
    DeclarationError       if the suffix is another one
    """
    require_suffix(path, *FORMATS)
    if isinstance(subject, Bounds):
        raise DeclarationError("view: bounds are not drawn yet. Give a Scene or a Trajectory.")
    run = simulate(subject) if isinstance(subject, Scene) else subject
    text = page(draw(run, point=point))
    with replacement(path) as file:
        file.write(text.encode())
