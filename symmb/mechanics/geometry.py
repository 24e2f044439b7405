"""The outer shape of a body, for drawings. It has no part in the equations."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from symmb.mechanics.body import AbstractBody, Point
from symmb.mechanics.element import Element, point_faults
from symmb.mechanics.rotation import Rotation


@dataclass(frozen=True, eq=False)
class Geometry(Element):
    """A shape that is drawn where a body is.

    Parameters
    ----------
    name : str
    point : Point          its middle, or the origin of a mesh
    axes : Rotation        of the shape, shape to body; a cylinder stands along its z
    form : str             "box", "cylinder", "sphere" or "mesh"
    size : tuple           sides of a box; radius and length; radius; scale of a mesh along x, y, z [m, -]
    mesh : Path            the file of a mesh
    """

    name: str
    point: Point
    axes: Rotation
    form: Literal["box", "cylinder", "sphere", "mesh"]
    size: tuple[float, ...]
    mesh: Path | None = None

    def bodies(self) -> tuple[AbstractBody, ...]:
        return (self.point.body,)

    def faults(self) -> Iterator[str]:
        yield from point_faults(self.title, self.point)
