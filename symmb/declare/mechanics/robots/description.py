"""What a file says about a machine: its links, its joints, and every number by name. Nothing is built from it here."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from symmb._types import Array
from symmb.declare.mechanics.body import TRIANGLE

TURNING, SLIDING = ("revolute", "continuous"), ("prismatic",)
"""Types of joints that have an angle, and those that have a displacement."""
XYZ, RPY, ENTRIES = ("x", "y", "z"), ("roll", "pitch", "yaw"), ("xx", "xy", "xz", "yy", "yz", "zz")

Form = Literal["box", "cylinder", "sphere", "mesh"]


@dataclass(frozen=True, eq=False)
class ShapeData:
    """A shape of a link, drawn at `xyz` [m] and turned by `rpy` [rad] in its axes.

    `size` [m] has the sides of a box, radius and length of a cylinder, the radius of a sphere, or the scale of a mesh.
    """

    form: Form
    xyz: tuple[float, ...]
    rpy: tuple[float, ...]
    size: tuple[float, ...]
    mesh: str = ""


@dataclass(frozen=True, eq=False)
class LinkData:
    """A link, and the shapes in which it is drawn."""

    name: str
    shapes: tuple[ShapeData, ...]


@dataclass(frozen=True, eq=False)
class JointData:
    """A joint; `mimic` is the joint that it follows."""

    name: str
    kind: str
    parent: str
    child: str
    mimic: str | None

    @property
    def moves(self) -> bool:
        """Whether the joint has an angle or a displacement."""
        return self.kind in (*TURNING, *SLIDING)


@dataclass(frozen=True, eq=False)
class Description:
    """A file: its links and joints by name, joints in an order in which each one follows that of its parent."""

    name: str
    path: Path
    links: Mapping[str, LinkData]
    joints: Mapping[str, JointData]
    root: str
    numbers: dict[str, float]

    @cached_property
    def tops(self) -> dict[str, str]:
        """Each link, after its parent, and the one that carries it by fixed joints: itself if no fixed joint does."""
        tops = {self.root: self.root}
        for joint in self.joints.values():
            tops[joint.child] = tops[joint.parent] if joint.kind == "fixed" else joint.child
        return tops


def named(prefix: str, names: tuple[str, ...], values: tuple[float, ...]) -> dict[str, float]:
    """Numbers by their names, such as "elbow.axis.x"."""
    return {f"{prefix}.{name}": value for name, value in zip(names, values, strict=True)}


def full_matrix(moments: tuple[float, ...]) -> Array:
    """The symmetric matrix (3, 3) of its entries xx, xy, xz, yy, yz, zz."""
    xx, xy, xz, yy, yz, zz = moments
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def inertia_fault(moments: tuple[float, ...]) -> str:
    """Why no body has these entries xx, xy, xz, yy, yz, zz of its inertia matrix; empty if one has."""
    low, middle, high = np.linalg.eigvalsh(full_matrix(moments)).tolist()
    total = low + middle + high
    diagonal = min(moments[0], moments[3], moments[5])
    if low < -TRIANGLE * abs(total) or diagonal < 0:  # `Body` takes no diagonal below 0, however small
        return f"a principal moment of inertia is {min(low, diagonal):.3g}, below 0; check the entries and their signs."
    if high - middle - low > TRIANGLE * total:
        return (
            f"the largest principal moment of inertia {high:.4g} exceeds the sum of the others, {low + middle:.4g}, "
            "which is impossible: check the entries and their signs."
        )
    return ""
