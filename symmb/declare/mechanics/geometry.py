"""Shapes of bodies for drawings. Shapes have no effect on the equations."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._options import is_real, require_instance, shown
from symmb._types import Array, Expr
from symmb.declare import mechanics
from symmb.declare.mechanics.rotation import Rotation
from symmb.declare.symbolic import components, has_irregular_constant, is_zero, scalar, triad, vector


class Geometry:
    """A shape that represents a body in drawings. The numbers of a shape may be expressions of parameters.

    Attributes
    ----------
    at : (3,)              centre of the shape, or origin of a mesh, in body axes, from the origin of the body's
                           points [m]
    axes : (3, 3)          columns from the centre to the surface along the axes of the shape, in body axes [m]; the
                           columns of a mesh are the directions x, y, z of the file times the scale
    """

    form: ClassVar[str]
    at: tuple[Expr, ...]

    @property
    def axes(self) -> ca.SX:
        raise NotImplementedError

    def _check(self, **sizes: Any) -> None:
        """Raise an error if `at` is not a finite vector, or if a size is not positive."""
        kind = type(self).__name__
        for name, value in sizes.items():
            parts = components(value) if name in ("size", "scale") else None
            for part in [value] if parts is None else parts:
                if is_real(part) and not 0 < part < np.inf:
                    raise DeclarationError(f"{kind}: {name} is {shown(value)}; it must be positive and finite.")
                scalar(part, f"{kind}: {name}")
            object.__setattr__(self, name, _double(value) if parts is None else tuple(map(_double, parts)))
        if has_irregular_constant(vector(self.at, f"{kind}: at")):
            raise DeclarationError(f"{kind}: at={shown(self.at)} contains NaN or infinity. Pass finite numbers.")
        object.__setattr__(self, "at", tuple(map(_double, components(self.at) or ())))
        if (turn := getattr(self, "rotation", None)) is not None:
            require_instance(f"{kind}: rotation", turn, Rotation, "a rotation, mb.rotation(axis=..., angle=...)")


def _double(value: Any) -> Any:
    """A number of any type as a float. Expressions are returned unchanged."""
    value = value.item() if isinstance(value, np.ndarray) else value
    return float(value) if is_real(value) else value


def _turned(rotation: Rotation | None, columns: ca.SX) -> ca.SX:
    return columns if rotation is None else rotation.matrix @ columns


@dataclass(frozen=True, eq=False)
class Box3(Geometry):
    """A box that represents a body in drawings.

    Parameters
    ----------
    size : tuple
        lengths of the sides along x, y, z [m]
    at : tuple
        centre of the box in body axes, from the origin of the body's points [m]
    rotation : Rotation
        rotation from axes of the box to axes of the body; by default the sides are parallel to the body's axes

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", 2.0, 0.5, shapes=[mb.Box3((1.0, 0.1, 0.05))])
    """

    form = "box"
    size: Sequence[Expr]
    at: tuple[Expr, ...] = (0.0, 0.0, 0.0)
    rotation: Rotation | None = None

    def __post_init__(self) -> None:
        if len(components(self.size) or ()) != 3:
            raise DeclarationError(f"Box3: size {shown(self.size)} must have three sides. Pass (x, y, z).")
        self._check(size=self.size)

    @property
    def axes(self) -> ca.SX:
        return _turned(self.rotation, ca.diag(vector(self.size)) / 2)


@dataclass(frozen=True, eq=False)
class Cylinder(Geometry):
    """A cylinder that represents a body in drawings.

    Parameters
    ----------
    radius, length : Expr
        radius and length of the cylinder [m]
    axis : tuple
        direction of the cylinder's axis, in body axes
    at : tuple
        centre of the cylinder in body axes, from the origin of the body's points [m]

    Examples
    --------
    >>> import symmb as mb
    >>> wheel = mb.Body("wheel", 2.0, 0.04, shapes=[mb.Cylinder(radius=0.2, length=0.05)])
    """

    form = "cylinder"
    radius: Expr
    length: Expr
    axis: tuple[Expr, ...] = (0.0, 0.0, 1.0)
    at: tuple[Expr, ...] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        self._check(radius=self.radius, length=self.length)
        axis = vector(self.axis, "Cylinder: axis")
        if is_zero(axis) or has_irregular_constant(axis):
            raise DeclarationError(
                f"Cylinder: axis {shown(self.axis)} has no direction. Pass a vector that is not zero."
            )
        object.__setattr__(self, "axis", tuple(map(_double, components(self.axis) or ())))

    @property
    def axes(self) -> ca.SX:
        radius, length = (scalar(value, "Cylinder") for value in (self.radius, self.length))
        u, v, axis = ca.horzsplit(triad(vector(self.axis)))
        return ca.horzcat(radius * v, -radius * u, length / 2 * axis)  # with axis z these are the axes of the body


@dataclass(frozen=True, eq=False)
class Sphere(Geometry):
    """A sphere that represents a body in drawings.

    Parameters
    ----------
    radius : Expr
        radius of the sphere [m]
    at : tuple
        centre of the sphere in body axes, from the origin of the body's points [m]

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle(), shapes=[mb.Sphere(0.05)])
    """

    form = "sphere"
    radius: Expr
    at: tuple[Expr, ...] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        self._check(radius=self.radius)

    @property
    def axes(self) -> ca.SX:
        return scalar(self.radius, "Sphere") * ca.SX.eye(3)


@dataclass(frozen=True, eq=False)
class Mesh(Geometry):
    """The surface in an STL file, which represents a body in drawings.

    Parameters
    ----------
    path : str or Path
        path of a binary or ASCII STL file. If the package trimesh is installed, other formats such as .obj are possible
    scale : Expr or (x, y, z)
        metres per unit of the file: 0.001 for a file in millimetres
    at : tuple
        origin of the file in body axes, from the origin of the body's points [m]
    rotation : Rotation
        rotation from axes of the file to axes of the body; by default these axes are parallel

    Raises
    ------
    DeclarationError
        If the file is missing, is not an STL file, is incomplete, or contains numbers that are not finite

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import symmb as mb
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "part.stl"
    >>> corners = "vertex 0 0 0 vertex 1 0 0 vertex 0 1 0"
    >>> _ = file.write_text(f"solid part facet normal 0 0 1 outer loop {corners} endloop endfacet endsolid part")
    >>> plate = mb.Body("plate", 2.0, 0.5, shapes=[mb.Mesh(file, scale=0.001)])
    """

    form = "mesh"
    path: str | Path
    scale: Expr | Sequence[Expr] = 1.0
    at: tuple[Expr, ...] = (0.0, 0.0, 0.0)
    rotation: Rotation | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.path, str | Path):
            raise DeclarationError(f"Mesh: expected the path of a file, got {shown(self.path)}.")
        object.__setattr__(self, "path", Path(self.path).absolute())
        if isinstance(self.scale, list | tuple | np.ndarray) and len(self.scale) != 3:
            raise DeclarationError(f"Mesh: scale {shown(self.scale)} must be one number, or (x, y, z).")
        self._check(scale=self.scale)
        _ = self.triangles  # a damaged file is an error where it is declared, not where it is drawn

    @property
    def axes(self) -> ca.SX:
        each = self.scale if isinstance(self.scale, list | tuple | np.ndarray) else [self.scale] * 3
        return _turned(self.rotation, ca.diag(vector(each)))

    @property
    def triangles(self) -> Array:
        """Corners of the triangles of the file, (m, 3, 3)."""
        return mechanics.read_mesh(Path(self.path))


def shapes_of(owner: str, shapes: Any) -> tuple[Geometry, ...]:
    """The shapes of a body as a tuple. Raises DeclarationError if they are not a list of shapes."""
    if not isinstance(shapes, list | tuple) or not all(isinstance(shape, Geometry) for shape in shapes):
        raise DeclarationError(
            f"{owner}: shapes must be a list of Box3, Cylinder, Sphere or Mesh, got {shown(shapes)}."
        )
    return tuple(shapes)
