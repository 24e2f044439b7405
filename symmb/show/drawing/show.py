"""`view`: draw a scene, a run or bounds into a file. The suffix of the file selects the format."""

from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError
from symmb._interrupts import kept_interrupts
from symmb._names import ByName
from symmb._options import shown
from symmb.bound.answers import Bounds
from symmb.declare.mechanics import Point
from symmb.equations.model import Scene
from symmb.results.files import replacement, require_suffix
from symmb.run.formulations import program_of
from symmb.run.simulation import DAESimulator, Sweep, Trajectory, simulate
from symmb.show.drawing.exhibit import Exhibit, of_bounds, of_run, of_sweep
from symmb.show.drawing.film import FILMS, film
from symmb.show.drawing.page import page
from symmb.show.drawing.still import STILLS, still

_WRITERS: dict[str, Callable[[Exhibit, BinaryIO, str], object]] = {
    ".html": lambda exhibit, file, _: file.write(page(exhibit).encode()),
    **dict.fromkeys(STILLS, still),
    **dict.fromkeys(FILMS, film),
}
FORMATS = tuple(_WRITERS)


@dataclass(frozen=True)
class Page:
    """A drawing that a notebook shows: the text of an HTML page that needs no network."""

    name: str
    text: str = field(repr=False)

    def _repr_html_(self) -> str:
        return html.frame(self.text, f"drawing of {self.name}")


@kept_interrupts()
def view(
    subject: Scene | DAESimulator | Trajectory | Bounds | Sweep,
    path: str | Path | None = None,
    *,
    output: str | None = None,
    time: float | str | None = None,
    point: Point | None = None,
) -> Page | None:
    """Draw a mechanism into a file, or in a notebook.

    Parameters
    ----------
    subject : Scene, Trajectory, Bounds or Sweep
        a Scene, or a prepared scene, is simulated at its nominal parameters. For Bounds, the runs that attain the
        bounds are also drawn. The page of a Sweep over a grid has a slider for each parameter
    path : str or Path
        .html: an interactive page that needs no network; .png, .svg: a still; .gif, .mp4: a film (.mp4 needs the
        program ffmpeg); default: a page that a notebook shows below its cell
    output : str
        for Bounds: the runs attain the bounds of this output; default: the output with the widest bounds
    time : float or str
        time of a still [s], or a text with a unit; default: the start. For Bounds, the runs attain the bounds at this
        time; default: the time of the output's widest bounds, or the middle of the motion for a scalar output
    point : Point
        a point; its path is drawn, and for Bounds also the region that it reaches over the box

    Returns
    -------
    Page or None
        the page if no path is given. Its `text` is HTML

    Raises
    ------
    DeclarationError
        If the suffix is not supported, if bounds cannot be drawn, if the time is outside of the run, or if the point is
        not on a body of the scene

    Examples
    --------
    >>> import symmb as mb, tempfile, pathlib
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> fall = mb.Scene(mb.System(ball, mb.Gravity(0, -9.81)), start={"ball.vx": 2.0}, times=[0.0, 0.5, 1.0])
    >>> page = pathlib.Path(tempfile.mkdtemp()) / "fall.html"
    >>> mb.view(fall, page)
    >>> page.read_text()[:15]
    '<!DOCTYPE html>'
    """
    suffix = ".html" if path is None else require_suffix(path, *FORMATS)
    if not isinstance(subject, Scene | DAESimulator | Trajectory | Bounds | Sweep):
        raise DeclarationError(f"view draws a Scene, a Trajectory, Bounds or a Sweep, got {type(subject).__name__}.")
    if not isinstance(point, Point | None):
        raise DeclarationError(f"view: point must be a point of a body, such as body.point(0, 0), got {shown(point)}.")
    if isinstance(subject, Bounds):
        exhibit = of_bounds(subject, output, time, point)
    elif output is not None:
        raise DeclarationError("view: output= selects the bounds that runs attain. Use it with Bounds only.")
    elif isinstance(subject, Sweep):
        if suffix != ".html":
            raise DeclarationError("view: the sliders of a Sweep need a page. Give a file name that ends in .html.")
        exhibit = of_sweep(subject, time, point)
    else:
        exhibit = of_run(subject if isinstance(subject, Trajectory) else simulate(subject), time, point)
    if path is None:
        return Page(exhibit.drawing.name, page(exhibit))
    with replacement(path) as file:
        _WRITERS[suffix](exhibit, file, suffix)
    return None


def start_picture(subject: Scene | DAESimulator) -> bytes:
    """A scene at its start as a PNG. Nothing is compiled or integrated."""
    scene = subject if isinstance(subject, Scene) else subject.scene
    if isinstance(subject, Scene) or scene.figures:  # scalar outputs need several times
        scene = scene.curves
        program = program_of(scene)
    else:
        program = subject.program
    times, parameters = program.times[:1], ByName(scene.system.parameters)
    at_start = scene.with_times(times)
    x, (fault,) = program.bodies.start.states(np.array([[*parameters.values()]]))
    if fault:
        simulate(at_start)  # this call raises the reason
    none, text = np.full(1, np.nan), repr(program.solver)
    run = Trajectory(at_start, program, parameters, text, "", times, x, none, {}, np.nan, np.nan)
    file = BytesIO()
    still(of_run(run, None, None), file, ".png")
    return file.getvalue()
