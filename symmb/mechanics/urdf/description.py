"""What a URDF file says: its links, its joints, and every number by name. Nothing is built from it here."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from symmb._errors import DeclarationError
from symmb._names import did_you_mean
from symmb.mechanics.urdf.document import Tag, read_document

TURNING, SLIDING = ("revolute", "continuous"), ("prismatic",)
"""Types of joints that have an angle, and those that have a displacement."""
_TYPES = (*TURNING, *SLIDING, "fixed", "floating", "planar")
_LIMITED = ("revolute", "prismatic")
"""Types of joints that must have limits."""
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_XYZ, _RPY = ("x", "y", "z"), ("roll", "pitch", "yaw")
_SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",), "mesh": ("filename", "scale")}
"""Attributes of the shapes that can be drawn."""
_IN_ROBOT = ("link", "joint", "material", "transmission", "gazebo", "sensor")
_IN_LINK = ("inertial", "visual", "collision", "contact", "sensor", "gazebo")
_IN_JOINT = ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "calibration", "safety_controller")
_TRIANGLE = 5e-4
"""Share of the sum of the moments of inertia by which one may exceed the others, as for `Body`: data of thin plates,
rounded to three digits."""

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
    """A link, and where it stands in the file."""

    name: str
    tag: Tag
    shapes: tuple[ShapeData, ...]


@dataclass(frozen=True, eq=False)
class JointData:
    """A joint, and where it stands in the file; `mimic` is the joint that it follows."""

    name: str
    tag: Tag
    kind: str
    parent: str
    child: str
    mimic: str | None

    @property
    def moves(self) -> bool:
        """Whether it has an angle or a displacement."""
        return self.kind in (*TURNING, *SLIDING)


@dataclass(frozen=True, eq=False)
class Description:
    """A file: its links and joints by name, joints in an order in which each one follows that of its parent."""

    name: str
    path: Path
    links: dict[str, LinkData]
    joints: dict[str, JointData]
    root: str
    numbers: dict[str, float]

    @cached_property
    def tops(self) -> dict[str, str]:
        """Each link, after its parent, and the one that carries it by fixed joints: itself if no fixed joint does."""
        tops = {self.root: self.root}
        for joint in self.joints.values():
            tops[joint.child] = tops[joint.parent] if joint.kind == "fixed" else joint.child
        return tops


def read_description(path: Path) -> Description:
    """What a URDF file says.

    Raises
    ------
    DeclarationError       all faults of links and joints at once, each in a sentence with line and element
    """
    top = read_document(path)
    if top.name != "robot":
        raise top.fault("the outermost element of a URDF file must be <robot>.")
    top.check(_IN_ROBOT, ("name", "version"))
    faults: list[str] = []
    numbers: dict[str, float] = {}
    links: dict[str, LinkData] = {}
    joints: dict[str, JointData] = {}
    for tag in top.inside:
        try:
            if tag.name == "link":
                _add(links, _link(tag, numbers))
            elif tag.name == "joint":
                _add(joints, _joint(tag, numbers))
            elif tag.name in {*_IN_LINK, *_IN_JOINT} - {*_IN_ROBOT}:
                raise tag.fault("this element stands right in <robot>; move it into its link or joint.")
        except DeclarationError as error:
            faults.append(str(error))
    if not faults:
        faults += _reference_faults(links, joints)
    if faults:
        raise DeclarationError("\n".join(dict.fromkeys(faults)))
    if not links:
        raise top.fault("it has no <link>; add one.")
    root, order = _tree(top, links, joints)
    return Description(top.text("name") if "name" in top.attributes else path.stem, path, links, order, root, numbers)


def _add(known: dict, new: LinkData | JointData) -> None:
    if new.name in known:
        raise new.tag.fault(f"the name is used twice, first in line {known[new.name].tag.line}; rename one of them.")
    known[new.name] = new


def _origin(tag: Tag) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Position [m] and angles [rad] of the <origin> of an element; zeros if it has none."""
    origin = tag.one("origin")
    if origin is None:
        return (0.0,) * 3, (0.0,) * 3
    origin.check_exactly(("xyz", "rpy"))
    return origin.numbers("xyz", (0.0,) * 3), origin.numbers("rpy", (0.0,) * 3)


def _named(prefix: str, names: tuple[str, ...], values: tuple[float, ...]) -> dict[str, float]:
    return {f"{prefix}.{name}": value for name, value in zip(names, values, strict=True)}


def _link(tag: Tag, numbers: dict[str, float]) -> LinkData:
    name = tag.own_name()
    tag.check(_IN_LINK, ("name", "type"))
    inertial = tag.one("inertial")
    mass, xyz, rpy, moments = 0.0, (0.0,) * 3, (0.0,) * 3, (0.0,) * 6
    if inertial is not None:
        inertial.check(("mass", "origin", "inertia"), ())
        xyz, rpy = _origin(inertial)
        of_mass = inertial.needed("mass")
        of_mass.check_exactly(("value",))
        mass = of_mass.number("value")
        if mass < 0:
            raise of_mass.fault(f"the mass {mass:g} is negative; give 0 or more.")
        of_inertia = inertial.needed("inertia")
        of_inertia.check_exactly(_INERTIA)
        moments = tuple(of_inertia.number(entry) for entry in _INERTIA)
        fault = inertia_fault(moments)
        if fault:
            raise of_inertia.fault(fault)
    numbers |= {f"{name}.mass": mass} | _named(f"{name}.com", (*_XYZ, *_RPY), (*xyz, *rpy))
    numbers |= _named(f"{name}.inertia", tuple(entry[1:] for entry in _INERTIA), moments)
    visual, collision = ([shape for t in tag.all(kind) if (shape := _shape(t))] for kind in ("visual", "collision"))
    return LinkData(name, tag, tuple(visual or collision))


def inertia_fault(moments: tuple[float, ...]) -> str:
    """Why no body has these entries xx, xy, xz, yy, yz, zz of its inertia matrix; empty if one has."""
    xx, xy, xz, yy, yz, zz = moments
    low, middle, high = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).tolist()
    total = low + middle + high
    if low < -_TRIANGLE * abs(total):
        return f"a principal moment of inertia is {low:.3g}, below 0; check the entries and their signs."
    if high - middle - low > _TRIANGLE * total:
        return (
            f"the largest principal moment of inertia {high:.4g} exceeds the sum of the others, {low + middle:.4g}, "
            "which no body has; check the entries and their signs."
        )
    return ""


def _shape(tag: Tag) -> ShapeData | None:
    """The shape of a <visual> or <collision>; None of one that other programs have invented."""
    tag.check(("origin", "geometry", "material"), ("name",))
    xyz, rpy = _origin(tag)
    geometry = tag.needed("geometry")
    geometry.check((*_SIZES,), ())
    if not geometry.inside:
        raise geometry.fault(f"it is empty; add one of {', '.join(_SIZES)}.")
    shape = geometry.inside[0]
    if shape.name not in _SIZES:
        return None
    shape.check_exactly(_SIZES[shape.name])
    if shape.name == "mesh":
        return ShapeData("mesh", xyz, rpy, shape.numbers("scale", (1.0,) * 3), shape.text("filename"))
    if shape.name == "box":
        shape.text("size")
        size = shape.numbers("size", (0.0,) * 3)
    else:
        size = tuple(shape.number(attribute) for attribute in _SIZES[shape.name])
    if min(size) <= 0:
        raise shape.fault(f"the size {min(size):g} is not positive; give one above 0.")
    return ShapeData(shape.name, xyz, rpy, size)  # pyright: ignore[reportArgumentType]


def _joint(tag: Tag, numbers: dict[str, float]) -> JointData:
    name = tag.own_name()
    tag.check(_IN_JOINT, ("name", "type"))
    kind = tag.text("type")
    if kind not in _TYPES:
        raise tag.fault(f"its type {kind!r} is not known; it must be one of {', '.join(_TYPES)}.")
    ends = []
    for end in ("parent", "child"):
        of_end = tag.needed(end)
        of_end.check_exactly(("link",))
        ends.append(of_end.text("link"))
    numbers |= _named(f"{name}.origin", (*_XYZ, *_RPY), sum(_origin(tag), ()))
    if kind not in ("fixed", "floating"):
        numbers |= _named(f"{name}.axis", _XYZ, _axis(tag))
    mimic = tag.one("mimic")
    if kind in (*TURNING, *SLIDING):
        numbers |= _limits(tag, name, kind) | _dynamics(tag, name)
        if mimic is not None:
            mimic.check_exactly(("joint", "multiplier", "offset"))
            numbers[f"{name}.mimic.multiplier"] = mimic.number("multiplier", 1.0)
            numbers[f"{name}.mimic.offset"] = mimic.number("offset", 0.0)
    elif mimic is not None:
        raise mimic.fault(f"a {kind} joint has no value that could follow another one; remove <mimic>.")
    elif kind != "fixed" and any(_dynamics(tag, name).values()):
        raise tag.needed("dynamics").fault(f"a {kind} joint has no single rate to damp; declare its forces in Python.")
    return JointData(name, tag, kind, *ends, mimic=None if mimic is None else mimic.text("joint"))


def _axis(tag: Tag) -> tuple[float, ...]:
    axis = tag.one("axis")
    if axis is None:
        return 1.0, 0.0, 0.0
    axis.check_exactly(("xyz",))
    axis.text("xyz")
    values = axis.numbers("xyz", (1.0, 0.0, 0.0))
    if not any(values):
        raise axis.fault("the axis 0 0 0 has no direction; give a vector that is not zero.")
    return values


def _limits(tag: Tag, name: str, kind: str) -> dict[str, float]:
    limit = tag.one("limit")
    if limit is None:
        if kind in _LIMITED:
            instead = ", or make the joint continuous" if kind == "revolute" else ""
            raise tag.fault(f"a {kind} joint must have limits; add <limit lower='...' upper='...'/>{instead}.")
        return {}
    limit.check((), ("lower", "upper", "effort", "velocity"))
    values = {end: limit.number(end, 0.0) for end in ("lower", "upper", "effort", "velocity")}
    if values["lower"] > values["upper"]:
        raise limit.fault(f"lower {values['lower']:g} is above upper {values['upper']:g}; exchange them.")
    for what in ("effort", "velocity"):
        if values[what] < 0:
            raise limit.fault(f"{what} {values[what]:g} is negative; give 0 or more.")
    return {f"{name}.limit.{end}": value for end, value in values.items()}


def _dynamics(tag: Tag, name: str) -> dict[str, float]:
    dynamics, values = tag.one("dynamics"), {}
    if dynamics is not None:
        dynamics.check_exactly(("damping", "friction"))
    for what in ("damping", "friction"):
        value = 0.0 if dynamics is None else dynamics.number(what, 0.0)
        if dynamics is not None and value < 0:
            raise dynamics.fault(f"{what} {value:g} is negative; give 0 or more.")
        values[f"{name}.{what}"] = value
    return values


def _reference_faults(links: Mapping[str, LinkData], joints: Mapping[str, JointData]) -> Iterator[str]:
    """Faults of the names by which joints refer to links and to each other."""
    carried: dict[str, JointData] = {}
    for joint in joints.values():
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                close = did_you_mean(link, links).strip().rstrip(".")
                yield str(joint.tag.needed(end).fault(f"there is no link {link!r}; {close[0].lower()}{close[1:]}."))
        if joint.parent == joint.child:
            yield str(joint.tag.fault(f"its parent and its child are both {joint.child!r}; name two links."))
        elif joint.child in carried:
            other = carried[joint.child]
            yield str(
                joint.tag.needed("child").fault(
                    f"joint {other.name!r} in line {other.tag.line} carries the link {joint.child!r} already; "
                    "close loops by joints in Python."
                )
            )
        carried.setdefault(joint.child, joint)
        if joint.mimic is not None:
            yield from _mimic_faults(joint, joints)


def _mimic_faults(joint: JointData, joints: Mapping[str, JointData]) -> Iterator[str]:
    mimic, seen, other = joint.tag.needed("mimic"), [joint.name], joint.mimic
    while other is not None:
        if other in seen:
            yield str(mimic.fault(f"joint {joint.name!r} follows itself; name another joint."))
            return
        if other not in joints:
            if len(seen) == 1:
                close = did_you_mean(other, joints).strip().rstrip(".")
                yield str(mimic.fault(f"there is no joint {other!r}; {close[0].lower()}{close[1:]}."))
            return
        if not joints[other].moves:
            if len(seen) == 1:
                yield str(mimic.fault(f"the {joints[other].kind} joint {other!r} has no value to follow."))
            return
        seen.append(other)
        other = joints[other].mimic


def _tree(top: Tag, links: Mapping[str, LinkData], joints: Mapping[str, JointData]) -> tuple[str, dict[str, JointData]]:
    """The link that carries all others, and the joints in an order in which each one follows that of its parent."""
    carrier = {joint.child: joint for joint in joints.values()}
    roots = [name for name in links if name not in carrier]
    if not roots:
        raise top.fault("its joints carry each other in a circle, so that no link is the base; close loops in Python.")
    if len(roots) > 1:
        raise links[roots[1]].tag.fault(
            f"no joint connects this link with {roots[0]!r}, which no joint carries either; add one."
        )
    by_parent: dict[str, list[JointData]] = {}
    for joint in joints.values():
        by_parent.setdefault(joint.parent, []).append(joint)
    order, reached = {}, [roots[0]]
    for link in reached:  # which grows
        for joint in by_parent.get(link, ()):
            order[joint.name] = joint
            reached.append(joint.child)
    if len(order) < len(joints):
        lost = next(joint for joint in joints.values() if joint.name not in order)
        raise lost.tag.fault("the joints that carry it form a circle; close loops by joints in Python.")
    return roots[0], order
