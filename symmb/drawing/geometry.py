"""Shapes that bodies were given: boxes, cylinders and balls, and the convex hulls of meshes."""

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from symmb._types import Array
from symmb.drawing.elements import GUIDE, Build, sketch
from symmb.drawing.shapes import Shape
from symmb.drawing.survey import Survey
from symmb.mechanics import Geometry

_SOLIDS = {"box": 0, "cylinder": 1, "sphere": 2}
"""Kinds of the form "solid"."""


def can_be_drawn(geometry: Geometry) -> bool:
    """Whether the shape is known: a mesh can lack its file, or the package trimesh that reads it."""
    return geometry.mesh is None or _hull(geometry.mesh) is not None


@sketch.register
def _(geometry: Geometry, survey: Survey) -> Build | None:
    if not can_be_drawn(geometry):
        return None
    owner = geometry.point.body.owner
    frame = survey.frame(owner)
    middle, axes = survey.ask(geometry.point.s), survey.ask(geometry.axes.matrix)
    colour = str(frame - 1) if frame else GUIDE

    def build(u: float) -> Iterator[Shape]:
        R, at, size = axes.first.reshape(3, 3).T, middle.first, np.array(geometry.size)
        more: dict[str, Any] = {"name": owner.name, "kind": geometry.form, "colour": colour}
        if geometry.mesh is not None:
            corners = at + (_corners(geometry.mesh) * size) @ R.T
            center = (corners.min(axis=0) + corners.max(axis=0)) / 2
            radius = float(np.linalg.norm(corners - center, axis=1).max())
            yield Shape("hull", places=(survey.fixed(frame, center),), size=(radius,), direction=corners, **more)
            return
        half = {"box": size / 2, "cylinder": size[[0, 0, -1]] * [1, 1, 0.5], "sphere": size[[0, 0, 0]]}[geometry.form]
        code = float(_SOLIDS[geometry.form])
        yield Shape("solid", places=(survey.fixed(frame, at),), size=(code,), direction=R * half, **more)

    return build


def _corners(path: Path) -> Array:
    """Corners (3 m, 3) of the triangles of the convex hull of a mesh, anticlockwise seen from outside."""
    hull = _hull(path)
    assert hull is not None  # such a shape is not drawn
    triangles = hull.points[hull.simplices]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inward = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return triangles.reshape(-1, 3)


@lru_cache(maxsize=256)
def _hull(path: Path) -> Any:
    """The convex hull of a mesh by SciPy; None if it cannot be read or is flat."""
    from scipy.spatial import ConvexHull

    try:
        import trimesh  # pyright: ignore[reportMissingImports]

        mesh: Any = trimesh.load(path, force="mesh")
        return ConvexHull(np.asarray(mesh.vertices, dtype=float))
    except Exception:  # of readers of many formats, and of Qhull
        return None
