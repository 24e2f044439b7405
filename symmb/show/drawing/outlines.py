"""Shapes as flat outlines, seen from a camera. Stills and films paint the outlines from back to front."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from symmb._magnitudes import NOTHING
from symmb._types import Array, Indices
from symmb.show.drawing.exhibit import convex_hull
from symmb.show.drawing.forms import IN_WORLD, LIGHT, Part, circle, directions, parts
from symmb.show.drawing.shapes import Drawing, Shape

_LIGHT = np.array(LIGHT["direction"]) / np.linalg.norm(LIGHT["direction"])
_CIRCLE = circle(np.linspace(0, 1, 25))
_FINE = circle(np.linspace(0, 1, 49))
_DRUM = np.vstack([_FINE - [0, 0, 1], _FINE + [0, 0, 1]])
_BOX = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_BALL = np.vstack([_FINE * np.sin(a) + [0, 0, np.cos(a)] for a in np.linspace(0, np.pi, 25)])
_SOLIDS = _BOX, _DRUM, _BALL
_CONVEX = {"box": _BOX, "cylinder": np.vstack([_CIRCLE, _CIRCLE + [0, 0, 1]]), "cone": np.vstack([_CIRCLE, [0, 0, 1]])}
"""Corners of parts."""


@dataclass(frozen=True, eq=False)
class Outline:
    """A filled polygon (n, 2), or a line with a `width` [m], in the camera's plane. `depth` [m] increases to the
    viewer.

    With `light` (m,), points are the corners of m triangles with this brightness. The front triangles are last.
    """

    points: Array
    depth: float
    shape: Shape
    width: float = 0.0
    light: Array | None = None


class Painter:
    """The outlines of a drawing in one picture."""

    def __init__(self, drawing: Drawing, k: int, camera: Array) -> None:
        self.drawing, self.k, self.camera = drawing, k, camera

    def outlines(self) -> list[Outline]:
        """All outlines, from back to front."""
        shapes = (shape for shape in self.drawing.shapes if self.drawing.has(shape, self.k))
        every = [outline for shape in shapes for outline in self._of(shape)]
        return sorted(every, key=lambda outline: outline.depth)

    def _of(self, shape: Shape) -> Iterator[Outline]:
        at = [self.drawing.position(place, self.k) for place in shape.places]
        R = self.drawing.pose(self.drawing.places[shape.places[0]].frame, self.k)[:, :3]
        if shape.form in _WHOLE:
            yield from _WHOLE[shape.form](self, shape, at, R)
            return
        track = directions(shape)
        direction = np.array([0.0, 0.0, 1.0]) if track is None else track[min(self.k, len(track) - 1)]
        d = direction if shape.form in IN_WORLD else R @ direction
        for part in parts(shape, flat=True):
            yield from self._of_part(shape, part, at, d)

    def _of_part(self, shape: Shape, part: Part, at: list[Array], d: Array) -> Iterator[Outline]:
        axes = self._axes(part, at, d)
        place = at[0] + part.at @ axes
        if not axes.any():
            return
        if part.what == "arrow":
            yield from self._arrow(shape, part, place, d)
        elif part.what == "ball":
            middle = self.camera @ place
            yield Outline(middle[:2] + part.size[0] * _CIRCLE[:-1, :2], float(middle[2]), shape)
        elif part.points is not None:
            yield self.line(shape, place + part.points @ axes, 2 * part.size[0] * float(np.linalg.norm(axes[0])))
        elif part.axes == "ends":
            ends = np.array([place, place + part.size[2] * axes[2]]) @ self.camera.T
            corners: Array = np.vstack([end[:2] + part.size[0] * _CIRCLE[:-1, :2] for end in ends])
            yield Outline(convex_hull(corners), float(ends[:, 2].mean()), shape)
        else:
            yield self.hull(shape, place + _CONVEX[part.what] * part.size @ axes)

    def _axes(self, part: Part, at: list[Array], d: Array) -> Array:
        """The axes x, y and z of a part as rows."""
        if part.axes == "world":
            return np.eye(3)
        if part.axes == "ends":
            along = at[1] - at[0]
            return np.array([self._sideways(along), self.camera[2], along])
        length = float(np.linalg.norm(d))
        w = d / (length or 1.0)
        u = np.array([0.0, 0.0, 1.0]) if self.drawing.planar and abs(w[2]) < 0.5 else _across(w)
        v = np.cross(w, u)
        return length * np.array([v, w, u]) if part.axes == "scaled" else np.array([u, v, w])

    def _sideways(self, along: Array) -> Array:
        """A unit vector at a right angle to a line, in the picture's plane."""
        side = np.cross(self.camera[2], along)
        return side / (np.linalg.norm(side) or 1.0)

    def _arrow(self, shape: Shape, part: Part, a: Array, d: Array) -> Iterator[Outline]:
        radius, wide, long = part.size
        length = float(np.linalg.norm(d))
        if length <= radius:
            return
        head, side = min(long, length), wide * self._sideways(d / length)
        neck = a + (1 - head / length) * d
        if length > head:
            yield self.line(shape, np.array([a, neck]), 2 * radius)
        yield self.hull(shape, np.array([neck + side, neck - side, a + d]))

    def hull(self, shape: Shape, points: Array) -> Outline:
        """The outline of points in space (n, 3)."""
        seen = points @ self.camera.T
        return Outline(convex_hull(seen[:, :2]), float(seen[:, 2].mean()), shape)

    def triangles(self, shape: Shape, corners: Array, *, closed: bool) -> Outline:
        """Shaded triangles with corners (3 m, 3). On closed surfaces, only those that face the viewer are drawn."""
        seen = (corners @ self.camera.T).reshape(-1, 3, 3)
        normals = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), NOTHING)
        if closed:
            seen, normals = seen[normals[:, 2] > 0], normals[normals[:, 2] > 0]
        normals[normals[:, 2] < 0] *= -1
        light = LIGHT["everywhere"] + LIGHT["lit"] * np.maximum(normals @ _LIGHT, 0) + LIGHT["in_front"] * normals[:, 2]
        order = np.argsort(seen[:, :, 2].mean(axis=1))
        depth = float((corners @ self.camera[2]).mean())
        return Outline(seen[order, :, :2].reshape(-1, 2), depth, shape, light=light[order])

    def line(self, shape: Shape, points: Array, width: float) -> Outline:
        """A line along points in space (n, 3)."""
        seen = points @ self.camera.T
        return Outline(seen[:, :2], float(seen[:, 2].mean()), shape, width)


def _across(axis: Array) -> Array:
    """A unit vector at a right angle to an axis."""
    u = np.cross(np.eye(3)[0 if abs(axis[2]) > 0.9 * np.linalg.norm(axis) else 2], axis)
    return u / (np.linalg.norm(u) or 1.0)


def _solid(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    half = R @ (shape.direction if shape.direction is not None else np.eye(3))
    points = _SOLIDS[int(shape.size[0])]
    if shape.faint:
        yield p.hull(shape, at[0] + points @ half.T)
    else:
        corners = points[_surface(int(shape.size[0]))] @ half.T
        yield p.triangles(shape, at[0] + (corners if np.linalg.det(half) > 0 else corners[::-1]), closed=True)


@cache
def _surface(solid: int) -> Indices:
    """Indices of the corners (3 m,) of the triangles of a box, a cylinder or a ball, anticlockwise from outside."""
    from scipy.spatial import ConvexHull

    points = _SOLIDS[solid]
    numbers = ConvexHull(points).simplices.astype(np.intp)
    a, b, c = (points[numbers[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    numbers[inward] = numbers[inward][:, ::-1]
    return numbers.ravel()


def _mesh(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    corners = shape.direction if shape.direction is not None else np.zeros((0, 3))
    origin = p.drawing.pose(p.drawing.places[shape.places[0]].frame, p.k)[:, 3]
    yield p.triangles(shape, origin + corners @ R.T, closed=bool(shape.size[1]))


def _curve(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    yield p.line(shape, np.array(at), 2 * shape.size[0])


def _plate(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    yield p.hull(shape, np.array(at))


def _path(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    yield p.line(shape, p.drawing.track(shape.places[0]), 2 * shape.size[0])


_WHOLE: dict[str, Callable[[Painter, Shape, list[Array], Array], Iterator[Outline]]] = {
    "curve": _curve,
    "solid": _solid,
    "mesh": _mesh,
    "plate": _plate,
    "path": _path,
}
"""Forms that are painted as a whole, not part by part."""
