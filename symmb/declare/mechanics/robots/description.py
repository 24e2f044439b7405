"""The content of a file of a machine: links, joints, and all numbers by name."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from symmb._types import Array
from symmb.declare.mechanics.body import TRIANGLE

TURNING, SLIDING = ("revolute", "continuous"), ("prismatic",)
"""Types of joints that have an angle, and types of joints that have a displacement."""
XYZ, RPY, ENTRIES = ("x", "y", "z"), ("roll", "pitch", "yaw"), ("xx", "xy", "xz", "yy", "yz", "zz")

Form = Literal["box", "cylinder", "sphere", "mesh"]


@dataclass(frozen=True, eq=False)
class ShapeData:
    """A shape of a link at the position `xyz` [m] with the angles `rpy` [rad], in axes of the link.

    `size` [m] contains the sides of a box, radius and length of a cylinder, radius of a sphere, or scale of a mesh.
    """

    form: Form
    xyz: tuple[float, ...]
    rpy: tuple[float, ...]
    size: tuple[float, ...]
    mesh: str = ""


@dataclass(frozen=True, eq=False)
class LinkData:
    """A link and its shapes in drawings, with its XML element for messages."""

    name: str
    shapes: tuple[ShapeData, ...]
    tag: Any = None


@dataclass(frozen=True, eq=False)
class JointData:
    """A joint, with its XML element for messages. `mimic` is the name of the joint that it follows, or None."""

    name: str
    kind: str
    parent: str
    child: str
    mimic: str | None
    tag: Any = None

    @property
    def moves(self) -> bool:
        """Whether the joint has an angle or a displacement."""
        return self.kind in (*TURNING, *SLIDING)


@dataclass(frozen=True, eq=False)
class Description:
    """The content of a file: links and joints by name. A joint comes after the joint that carries its parent."""

    name: str
    path: Path
    links: Mapping[str, LinkData]
    joints: Mapping[str, JointData]
    root: str
    numbers: dict[str, float]

    @cached_property
    def tops(self) -> dict[str, str]:
        """For each link, the link that represents its body. Fixed joints connect the two links. Parents come first."""
        tops = {self.root: self.root}
        for joint in self.joints.values():
            tops[joint.child] = tops[joint.parent] if joint.kind == "fixed" else joint.child
        return tops


def named(prefix: str, names: tuple[str, ...], values: tuple[float, ...]) -> dict[str, float]:
    """The values, with the keys `prefix.name`, such as "elbow.axis.x"."""
    return {f"{prefix}.{name}": value for name, value in zip(names, values, strict=True)}


def full_matrix(moments: tuple[float, ...]) -> Array:
    """The symmetric matrix (3, 3) with the entries xx, xy, xz, yy, yz, zz."""
    xx, xy, xz, yy, yz, zz = moments
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def inertia_fault(moments: tuple[float, ...]) -> str:
    """The reason why an inertia matrix with entries xx, xy, xz, yy, yz, zz is impossible, and a remedy; else empty."""
    low, middle, high = np.linalg.eigvalsh(full_matrix(moments)).tolist()
    total = low + middle + high
    diagonal = min(moments[0], moments[3], moments[5])
    if low < -TRIANGLE * abs(total) or diagonal < 0:  # `Body` refuses all negative diagonal entries
        return f"a moment of inertia is negative: {min(low, diagonal):.3g}. Check the entries and their signs."
    if high - middle - low > TRIANGLE * total:
        return (
            f"the largest principal moment of inertia, {high:.4g}, must not exceed the sum of the others, "
            f"{low + middle:.4g}. Check the entries and their signs."
        )
    return ""
