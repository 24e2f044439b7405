"""A run as a Drawing: scales, camera, and the order of the shapes."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import SAME
from symmb._types import Array, Indices
from symmb.declare.mechanics import Body, Element, Flywheel, Gravity, Input, Joint, OwnState, Planar, Point
from symmb.results.plot import labels, rounding
from symmb.run.simulation import Trajectory
from symmb.show.drawing.bodies import BodySketch
from symmb.show.drawing.elements import GUIDE, Sketch, begun, shapes_of, sketch
from symmb.show.drawing.geometry import not_drawn, shapes_of_bodies
from symmb.show.drawing.shapes import Drawing, Shape
from symmb.show.drawing.survey import Survey

_TURNED, _RAISED = np.radians(-28.0), np.radians(20.0)
"""Initial angles of view for a spatial mechanism: about the vertical, and above the horizontal."""


# `most` is the approximate number of pictures. Of longer runs, only every n-th output time is shown.
def draw(run: Trajectory, *, also: Sequence[int] = (), point: Point | None = None, most: int = 1001) -> Drawing:
    """A run with the path of a point. For long runs, every n-th output time and the indices `also` are shown."""
    return surveyed(run, also=also, point=point, most=most)[0]


def surveyed(
    run: Trajectory, *, also: Sequence[int] = (), point: Point | None = None, most: int = 1001
) -> tuple[Drawing, Survey, Indices]:
    """The drawing of a run, the survey of its numbers, and the indices of its output times."""
    scene = run.scene
    if scene is None:
        raise DeclarationError("This run has no scene: it was read from a file. Use Trajectory.load(path, scene).")
    rows = _pictures(len(run.t), also, most)
    run = replace(run, t=run.t[rows], x=run.x[rows], work=run.work[rows], run_examination=None, error=None)
    survey = Survey(run, scene)
    elements = [element for element in scene.system.elements if not _is_unseen(element)]
    sketches = [(e, begun(sketch(survey.acting(e), survey))) for e in elements if isinstance(e, Element)]
    gravity = next((survey.ask([e.gx, e.gy, e.gz]) for e in elements if isinstance(e, Gravity)), None)
    given = shapes_of_bodies(survey, elements)
    of = {id(own.body): own for own in given}
    seen = [body for body in scene.system.bodies if not _is_unseen(body)]
    bodies = [BodySketch(body, str(i), survey, of.get(id(body))) for i, body in enumerate(seen)]
    traced = None if point is None else survey.place(point)
    survey.evaluate()
    g = np.zeros(3) if gravity is None else gravity.first
    survey.down = -_right_and_up(g, all(isinstance(b.pose, Planar) for b in survey.bodies[1:]))[1]
    tracks = [survey.track(place) for place in range(survey.count)]
    tracks += [survey.pose(body.frame)[:, :, 3] for body in bodies]
    survey.span = _diagonal([track[:1] for track in tracks])
    size = _size(survey.span, tracks, bodies)
    unit = _unit(size, bodies)
    shapes = _shapes(survey, bodies, sketches, unit)
    planar = _is_planar(survey, g, size)  # before given shapes, which may be beside the plane of motion
    shapes += chain.from_iterable(own.shapes() for own in given)
    if traced is not None:
        shapes.append(Shape("path", "path of the point", "path", "trace", (traced,), (0.35 * unit,)))
    drawing = Drawing(
        name=run.name,
        t=run.t,
        frames=survey.frames(),
        places=survey.places(),
        shapes=tuple(shapes),
        camera=_camera(g, planar),
        up=_right_and_up(g, planar)[1],
        planar=planar,
        size=size,
        unit=unit,
        gravity=g,
        outputs=labels(run.names, run.units),
        values=np.where(np.abs(run.values).max(axis=0) <= rounding(run.values, run.units), 0.0, run.values),
        notes=(*_without_place(sketches), *not_drawn(given)),
    )
    return drawing, survey, rows


def _without_place(sketches: Sequence[tuple[Element, Sketch | None]]) -> list[str]:
    """Titles of the elements that are not drawn, except gravity (an arrow), inputs and states."""
    return [e.title for e, drawn in sketches if drawn is None and not isinstance(e, Gravity | Input | OwnState)]


def _is_unseen(part: Body | Element) -> bool:
    """Whether the element is a flywheel, or belongs to a flywheel."""
    return any(isinstance(body, Flywheel) for body in ([part] if isinstance(part, Body) else part.bodies()))


def _pictures(count: int, also: Sequence[int], most: int) -> Indices:
    """Indices of the output times that are shown, including the first and the last."""
    rows = np.linspace(0, count - 1, min(count, most)).astype(int)
    return np.union1d(rows, [row for row in also if row < count]).astype(int)


def _diagonal(tracks: Sequence[Array]) -> float:
    """Diagonal of the bounding box of paths, each (n, 3) [m]."""
    return float(np.linalg.norm(np.ptp(np.vstack(tracks), axis=0))) if tracks else 0.0


def _size(span: float, tracks: Sequence[Array], bodies: Sequence[BodySketch]) -> float:
    """Size of the mechanism [m], from the span of its attached points and centres of mass, and from its bodies.

    The size is at least 0.3 times the extent of the motion, so that small mechanisms on long paths are visible.
    """
    travelled = _diagonal(tracks)
    own = max([span, *(body.reach for body in bodies)])
    return max(own, 0.3 * travelled) if own else travelled or 1.0


def _unit(size: float, bodies: Sequence[BodySketch]) -> float:
    """Radius of a bar [m]: 1.1 % of the size. The size is limited to 7 times the median size of bodies."""
    reaches = [reach for body in bodies if (reach := body.reach)]
    return 0.011 * min(size, 7.0 * float(np.median(reaches or [size])))


def _shapes(
    survey: Survey, bodies: Sequence[BodySketch], sketches: Sequence[tuple[Element, Sketch | None]], unit: float
) -> list[Shape]:
    """The shapes of bodies and of elements. Parts of a joint at its bodies are present while the joint is closed."""
    of_elements = [
        replace(shape, present=survey.closed(element))
        if isinstance(element, Joint) and shape.colour != GUIDE
        else shape
        for element, drawn in sketches
        if drawn
        for shape in shapes_of(drawn, unit)
    ]
    of_bodies = [shape for body in bodies for shape in body.shapes(unit)]
    return of_bodies + _once(of_elements)


def _once(shapes: Sequence[Shape]) -> list[Shape]:
    """The shapes without repetitions: several elements may need a shape such as a support at the same place."""
    seen, rest = set(), []
    for shape in shapes:
        key = (shape.form, shape.places) if shape.form == "support" else id(shape)
        if key not in seen:
            seen.add(key)
            rest.append(shape)
    return rest


def _is_planar(survey: Survey, g: Array, size: float) -> bool:
    flat = np.array([0.0, 0.0, 1.0, 0.0])
    scale = np.array([1.0, 1.0, 1.0, 1 / size])
    poses = (survey.pose(i) for i in range(1, len(survey.bodies)))
    return (
        not g[2]
        and all(np.abs((pose[:, 2] - flat) * scale).max() < SAME for pose in poses)
        and all(np.abs(survey.track(place)[:, 2]).max() < SAME * size for place in range(survey.count))
    )


def _right_and_up(g: Array, planar: bool) -> tuple[Array, Array]:
    """World axes to the right and up in the picture. Gravity acts downwards."""
    down = g if np.linalg.norm(g) else np.array([0.0, -1.0, 0.0] if planar else [0.0, 0.0, -1.0])
    main = np.abs(down).argmax()
    up = -np.sign(down[main]) * np.eye(3)[main]
    return np.eye(3)[1 if main == 0 else 0], up


def _camera(g: Array, planar: bool) -> Array:
    """Directions to the right, up and to the viewer, as rows (3, 3)."""
    right, up = _right_and_up(g, planar)
    camera = np.array([right, up, np.cross(right, up)])
    if planar:
        return camera
    c, s = np.cos(_TURNED), np.sin(_TURNED)
    turned = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    c, s = np.cos(_RAISED), np.sin(_RAISED)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ turned @ camera
