"""Shapes as flat outlines, seen from a camera: what stills and films paint, from the back to the front."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from symmb._types import Array, Indices
from symmb.drawing.exhibit import convex_hull
from symmb.drawing.shapes import Drawing, Shape

_TURNS, _STUB = 7, 0.12
"""Turns of a coil, and the share of its length at each end that is straight."""
_LIGHT = np.array([-0.4, 0.6, 0.8]) / np.sqrt(1.16)
"""Direction to the light, seen by the viewer."""
_ROUND = np.linspace(0, 2 * np.pi, 25)
_CIRCLE = np.stack([np.cos(_ROUND), np.sin(_ROUND)], axis=1)
_CYLINDER = np.vstack([np.column_stack([_CIRCLE, np.full(len(_ROUND), z)]) for z in (-1.0, 1.0)])
_FINE = np.linspace(0, 2 * np.pi, 49)
_DRUM = np.vstack([np.stack([np.cos(_FINE), np.sin(_FINE), np.full(len(_FINE), z)], axis=1) for z in (-1.0, 1.0)])
_BOX = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_BALL = np.vstack(
    [
        np.stack([np.cos(_FINE) * np.sin(a), np.sin(_FINE) * np.sin(a), 0 * _FINE + np.cos(a)], axis=1)
        for a in _FINE[:25]
    ]
)
_SOLIDS = _BOX, _DRUM, _BALL


@dataclass(frozen=True, eq=False)
class Outline:
    """A polygon (n, 2) to fill, or a line of a `width` [m], in the camera's plane; `depth` grows to the viewer [m].

    With `light` (m,) the points are corners of m triangles, the last ones in front, each as bright as it tells.
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
        """All outlines, those at the back first."""
        shapes = (shape for shape in self.drawing.shapes if self.drawing.has(shape, self.k))
        every = [outline for shape in shapes for outline in self._of(shape)]
        return sorted(every, key=lambda outline: outline.depth)

    def _of(self, shape: Shape) -> Iterator[Outline]:
        at = [self.drawing.position(place, self.k) for place in shape.places]
        R = self.drawing.pose(self.drawing.places[shape.places[0]].frame, self.k)[:, :3]
        return _FORMS[shape.form](self, shape, at, R)

    def direction(self, shape: Shape) -> Array:
        """Of the shape in this picture, in the axes in which it is given."""
        if shape.direction is None:
            return np.array([0.0, 0.0, 1.0])
        return shape.direction[min(self.k, len(shape.direction) - 1)]

    def hull(self, shape: Shape, points: Array) -> Outline:
        """The outline of points in space (n, 3)."""
        seen = points @ self.camera.T
        return Outline(convex_hull(seen[:, :2]), float(seen[:, 2].mean()), shape)

    def triangles(self, shape: Shape, corners: Array, *, closed: bool) -> Outline:
        """Shaded triangles by their corners in space (3 m, 3); of a closed surface those that face the viewer."""
        seen = (corners @ self.camera.T).reshape(-1, 3, 3)
        normals = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        if closed:
            seen, normals = seen[normals[:, 2] > 0], normals[normals[:, 2] > 0]
        normals[normals[:, 2] < 0] *= -1
        light = 0.42 + 0.48 * np.maximum(normals @ _LIGHT, 0) + 0.14 * normals[:, 2]  # as in the page
        order = np.argsort(seen[:, :, 2].mean(axis=1))
        depth = float((corners @ self.camera[2]).mean())
        return Outline(seen[order, :, :2].reshape(-1, 2), depth, shape, light=light[order])

    def line(self, shape: Shape, points: Array, width: float) -> Outline:
        """A line along points in space (n, 3)."""
        seen = points @ self.camera.T
        return Outline(seen[:, :2], float(seen[:, 2].mean()), shape, width)


def _across(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed frame with an axis."""
    helper = np.eye(3)[0 if abs(axis[2]) > 0.9 * np.linalg.norm(axis) else 2]
    u = np.cross(helper, axis)
    u /= np.linalg.norm(u) or 1.0
    v = np.cross(axis, u)
    return u, v / (np.linalg.norm(v) or 1.0)


def _ball_at(painter: Painter, shape: Shape, center: Array, radius: float) -> Outline:
    middle = painter.camera @ center
    return Outline(middle[:2] + radius * _CIRCLE[:-1], float(middle[2]), shape)


def _rod(painter: Painter, shape: Shape, a: Array, b: Array, radius: float) -> Outline:
    ends = np.array([a, b]) @ painter.camera.T
    corners: Array = np.vstack([end[:2] + radius * _CIRCLE[:-1] for end in ends])
    return Outline(convex_hull(corners), float(ends[:, 2].mean()), shape)


def _bar(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    yield _rod(p, shape, at[0], at[1], shape.size[0])


def _ball(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    yield _ball_at(p, shape, at[0], shape.size[0])


def _pin(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    axis = R @ p.direction(shape)
    u, v = _across(axis)
    radius, length = shape.size
    yield p.hull(shape, at[0] + _CYLINDER @ np.array([radius * u, radius * v, length / 2 * axis]))


def _block(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    w = R @ p.direction(shape)
    u = np.array([0.0, 0.0, 1.0]) if p.drawing.planar and abs(w[2]) < 0.5 else _across(w)[0]
    sides = np.array(shape.size)[:, None] / 2 * np.array([w, np.cross(w, u), u])
    yield p.hull(shape, at[0] + _BOX @ sides)


def _ring(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    u, v = _across(R @ p.direction(shape))
    radius, tube = shape.size
    yield p.line(shape, at[0] + radius * _CIRCLE @ np.array([u, v]), 2 * tube)


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
    """Numbers of the corners (3 m,) of the triangles of a box, a cylinder or a ball, anticlockwise from outside."""
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


def _sideways(p: Painter, along: Array) -> Array:
    """A unit vector across a line, in the picture's plane."""
    side = np.cross(p.camera[2], along)
    return side / (np.linalg.norm(side) or 1.0)


def _coil(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    radius, offset = shape.size
    along = at[1] - at[0]
    side = _sideways(p, along)
    u = np.concatenate([[0.0], np.linspace(_STUB, 1 - _STUB, 4 * _TURNS + 1), [1.0]])
    swing = radius * np.sin(np.pi / 2 * np.arange(-1, 4 * _TURNS + 2))
    swing[[0, 1, -2, -1]] = 0.0
    yield p.line(shape, at[0] + u[:, None] * along + (swing + offset)[:, None] * side, 0.3 * radius)


def _dashpot(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    radius, offset = shape.size
    along = at[1] - at[0]
    a = at[0] + offset * _sideways(p, along)
    yield _rod(p, shape, a, a + along, 0.35 * radius)
    yield _rod(p, shape, a + 0.15 * along, a + 0.6 * along, radius)


def _dashes(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    along = at[1] - at[0]
    for i in range(0, 9, 2):
        yield p.line(shape, np.array([at[0] + i / 9 * along, at[0] + (i + 1) / 9 * along]), 2 * shape.size[0])


def _spiral(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    share = np.linspace(0, 1, 61)[:, None]
    turns = np.hstack([np.cos(5 * np.pi * share), np.sin(5 * np.pi * share)]) * (0.25 + 0.75 * share)
    yield p.line(shape, at[0] + shape.size[0] * turns @ np.array(_across(R @ p.direction(shape))), 0.14 * shape.size[0])


def _arrow(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    vector, radius = p.direction(shape), shape.size[0]
    length = float(np.linalg.norm(vector))
    if length > radius:
        yield from _arrow_to(p, shape, at[0], vector / length, length, radius)


def _arrow_to(p: Painter, shape: Shape, a: Array, along: Array, length: float, radius: float) -> Iterator[Outline]:
    head, side = min(4 * radius, length), _sideways(p, along)
    neck, tip = a + (length - head) * along, a + length * along
    if length > head:
        yield p.line(shape, np.array([a, neck]), 2 * radius)
    yield p.hull(shape, np.array([neck + 2.2 * radius * side, neck - 2.2 * radius * side, tip]))


def _twist(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    vector, radius = p.direction(shape), shape.size[0]
    size = 7 * radius * np.sqrt(np.linalg.norm(vector) / (23.4 * radius))
    if not size:
        return
    u, v = _across(vector)
    yield p.line(shape, at[0] + size * _CIRCLE[:19] @ np.array([u, v]), 0.1 * size)
    yield from _arrow_to(p, shape, at[0] - size * v, u, 0.45 * size, 0.16 * size / 2.2)


def _plane(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    normal, side = R @ p.direction(shape), shape.size[0]
    half = np.array([side / 2 * a for a in _across(normal)] + [0.006 * side * normal])
    yield p.hull(shape, at[0] - half[2] + _BOX @ half)


def _support(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    down, size = p.direction(shape), shape.size[0]
    flat = np.array([0.0, 0.0, 1.0]) if p.drawing.planar else _across(down)[0]
    side = np.cross(flat, down)
    base = at[0] + size * down
    yield p.hull(shape, np.vstack([at[0], base + 0.8 * size * _CIRCLE @ np.array([side, 0.3 * flat])]))
    yield p.hull(shape, base + 0.12 * size * down + _BOX @ (size * np.array([1.3 * side, 0.4 * flat, 0.12 * down])))


def _path(p: Painter, shape: Shape, at: list[Array], R: Array) -> Iterator[Outline]:
    yield p.line(shape, p.drawing.track(shape.places[0]), 2 * shape.size[0])


_FORMS: dict[str, Callable[[Painter, Shape, list[Array], Array], Iterator[Outline]]] = {
    "bar": _bar,
    "curve": _curve,
    "ball": _ball,
    "pin": _pin,
    "block": _block,
    "ring": _ring,
    "solid": _solid,
    "mesh": _mesh,
    "plate": _plate,
    "coil": _coil,
    "dashpot": _dashpot,
    "dashes": _dashes,
    "spiral": _spiral,
    "arrow": _arrow,
    "twist": _twist,
    "plane": _plane,
    "support": _support,
    "path": _path,
}
