"""Given shapes of bodies: boxes, cylinders, spheres and meshes."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array
from symmb.declare.mechanics import AbstractBody, Element, Ground, Mesh, coarser
from symmb.declare.symbolic import vector
from symmb.show.drawing.elements import GUIDE
from symmb.show.drawing.shapes import Shape
from symmb.show.drawing.survey import Survey

MOST_TRIANGLES = 12_000
"""Largest number of triangles of all meshes in a drawing. They take 1.2 MB of a page. All meshes are reduced by the
same ratio."""
_SOLIDS = {"box": 0.0, "cylinder": 1.0, "sphere": 2.0}
"""Numbers of the forms in a shape "solid"."""


class BodyShapes:
    """The given shapes of a body. `unread` contains titles of meshes that cannot be drawn, and the reasons.

    `coarse` contains titles of meshes with omitted triangles, the numbers of omitted triangles, and those in the file.
    """

    def __init__(self, body: AbstractBody, survey: Survey, most: int) -> None:
        self.body, self.survey, self.frame = body, survey, survey.frame(body)
        self.unread: list[tuple[str, str]] = []
        self.coarse: list[tuple[str, int, int]] = []
        self._drawn = []
        for shape in body.shapes:
            triangles = self._triangles(shape, most) if isinstance(shape, Mesh) else None
            if triangles is not None or not isinstance(shape, Mesh):
                place = vector(shape.at) - vector(body.com)
                self._drawn.append((shape.form, survey.ask(place), survey.ask(shape.axes), triangles))

    def __bool__(self) -> bool:
        return bool(self._drawn)

    def _triangles(self, mesh: Mesh, most: int) -> Array | None:
        """Corners of the drawn triangles, (3 m, 3); None if the file cannot be read, or the mesh is a point."""
        title = f"{Path(mesh.path).name!r} of {self.body.name!r}"
        try:
            triangles = mesh.triangles
        except DeclarationError as error:
            self.unread.append((title, str(error).removeprefix("Mesh: ").removesuffix(".")))
            return None
        drawn = coarser(triangles, most)
        if len(drawn) < len(triangles):
            self.coarse.append((title, len(triangles) - len(drawn), len(triangles)))
        return drawn.reshape(-1, 3) if len(drawn) else None

    @property
    def reach(self) -> float:
        """The longest extent of the shapes along an axis of the body [m]."""
        points = np.vstack([ends for *_, ends in self._placed()])
        return float(np.ptp(points, axis=0).max())

    def _placed(self) -> Iterator[tuple[str, Array, Array, Array]]:
        """Form, centre, half axes as columns, and corners of each shape. The corners are those of its triangles, or
        of its bounding box."""
        for form, middle, axes, triangles in self._drawn:
            at, half = middle.first, axes.first.reshape(3, 3).T
            local = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
            yield form, at, half, at + (local if triangles is None else triangles) @ half.T

    def shapes(self) -> Iterator[Shape]:
        """The shapes of the body."""
        colour = str(self.frame - 1) if self.frame else GUIDE
        for form, at, half, corners in self._placed():
            if form == "mesh":
                center = (corners.min(axis=0) + corners.max(axis=0)) / 2
                place, radius = self.survey.fixed(self.frame, center), np.linalg.norm(corners - center, axis=1).max()
                corners, closed = outward(corners)
                size = float(radius), float(closed)
                yield Shape("mesh", self.body.name, form, colour, (place,), size, corners)
            else:
                place = self.survey.fixed(self.frame, at)
                yield Shape("solid", self.body.name, form, colour, (place,), (_SOLIDS[form],), half)


def shapes_of_bodies(survey: Survey, elements: Sequence[object]) -> list[BodyShapes]:
    """The given shapes of bodies, and of the grounds to which elements are attached."""
    attached = [body.owner for e in elements if isinstance(e, Element) for body in e.bodies()]
    grounds = {id(body): body for body in attached if isinstance(body, Ground)}
    bodies = [body for body in (*grounds.values(), *survey.bodies[1:]) if body.shapes]
    meshes = sum(isinstance(shape, Mesh) for body in bodies for shape in body.shapes)
    return [BodyShapes(body, survey, MOST_TRIANGLES // max(meshes, 1) or 1) for body in bodies]


def not_drawn(bodies: Sequence[BodyShapes]) -> Iterator[str]:
    """Lines about parts of meshes that are not drawn. Meshes with the same reason share a line."""
    alike: dict[str, list[tuple[str, str]]] = {}
    for title, why in (unread for body in bodies for unread in body.unread):
        alike.setdefault(re.sub(r"\S*" + re.escape(title.split("'")[1]) + r"\S*", "", why), []).append((title, why))
    for (title, why), *others in alike.values():
        yield f"Mesh {title} ({why})" + (f" and {len(others)} more for the same reason" if others else "")
    coarse = [own for body in bodies for own in body.coarse]
    if coarse:
        title = coarse[0][0] if len(coarse) == 1 else f"{len(coarse)} meshes"
        yield f"{sum(left for _, left, _ in coarse):,} of {sum(n for *_, n in coarse):,} triangles of {title}"


def outward(corners: Array) -> tuple[Array, bool]:
    """Corners (3 m, 3) of triangles, and whether the surface is closed. Then they are anticlockwise from outside."""
    _, number = np.unique(corners, axis=0, return_inverse=True)
    triangles = number.reshape(-1, 3)
    edges = np.vstack([triangles[:, [i, k]] for i, k in ((0, 1), (1, 2), (2, 0))]) @ [1, len(corners)]
    back = np.vstack([triangles[:, [k, i]] for i, k in ((0, 1), (1, 2), (2, 0))]) @ [1, len(corners)]
    closed = np.array_equal(np.sort(edges), np.sort(back))
    volume = np.linalg.det(corners.reshape(-1, 3, 3) - corners.mean(axis=0)).sum()
    return (corners[::-1] if volume < 0 else corners), closed
