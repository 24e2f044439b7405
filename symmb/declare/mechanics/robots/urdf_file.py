"""Machines from URDF files: `load_urdf`, and the reader of these files."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from symmb._errors import Faults, warn_of
from symmb._interrupts import kept_interrupts
from symmb._names import did_you_mean
from symmb._types import Expr
from symmb.declare.mechanics.contact_law import ContactLaw
from symmb.declare.mechanics.declaration import Block, declared
from symmb.declare.mechanics.robots.description import (
    RPY,
    SLIDING,
    TURNING,
    XYZ,
    Description,
    JointData,
    LinkData,
    ShapeData,
    inertia_fault,
    named,
)
from symmb.declare.mechanics.robots.document import Tag, read_document, told
from symmb.declare.mechanics.robots.repair import repaired
from symmb.declare.mechanics.robots.robot import Building, Robot, checked_path, replaced

_TYPES = (*TURNING, *SLIDING, "fixed", "floating", "planar")
_LIMITED = ("revolute", "prismatic")
"""Types of joints that must have limits."""
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",), "mesh": ("filename", "scale")}
"""Attributes of the shapes that can be drawn."""
_IN_ROBOT = ("link", "joint", "material", "transmission", "gazebo", "sensor")
_IN_LINK = ("inertial", "visual", "collision", "contact", "sensor", "gazebo")
_IN_JOINT = ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "calibration", "safety_controller")


@kept_interrupts()
def load_urdf(
    path: str | Path,
    *,
    replace: Mapping[str, Expr] | None = None,
    fixed_base: bool = True,
    stop: ContactLaw | float | None = None,
    strict: bool = False,
) -> Robot:
    """A machine from a URDF file.

    Links become bodies in space. Links that fixed joints connect become one body. Revolute and continuous joints become
    `Revolute`, prismatic joints `Prismatic`, and planar joints `PlanarJoint`. A link with a floating joint is free.
    Damping is linear. Dry friction is Coulomb's law, smooth below a rate of 0.01 rad/s or m/s. A mimic joint becomes a
    constraint between two joint values. URDF files do not contain gravity: add a `Gravity` to the elements.

    Parameters
    ----------
    path : str or Path
    replace : mapping
        numbers or expressions of parameters by name, such as {"forearm.mass": p.m}. Names are "forearm.mass",
        "forearm.com.x" (.y .z .roll .pitch .yaw), "forearm.inertia.xx" (.xy ...), "elbow.origin.x" (.y .z .roll .pitch
        .yaw), "elbow.axis.x", "elbow.limit.lower" (.upper), "elbow.damping", "elbow.friction", "elbow.mimic.multiplier"
        (.offset)
    fixed_base : bool
        whether the base link is fixed to the ground. With False, the base link moves freely
    stop : ContactLaw or float
        contact law or coefficient of restitution of a `Stop` at the limits of each joint. With None, limits have no
        effect. If the lower limit is equal to the upper limit, they never have an effect
    strict : bool
        whether all faults are errors. By default one SymmbWarning names harmless faults: attributes of other programs,
        <mimic> of joints that cannot follow, dots in names, and impossible inertias. The nearest possible inertia
        replaces an impossible inertia. If this would have a large effect on the motion, it is an error

    Returns
    -------
    Robot

    Raises
    ------
    DeclarationError
        If the file has faults, or if `replace` contains unknown names. The message has one sentence for each fault of
        the file, with its line and element

    Examples
    --------
    >>> import symmb as mb, tempfile, pathlib
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "pendulum.urdf"
    >>> _ = file.write_text('''<robot name="pendulum"> <link name="wall"/>
    ...     <link name="rod"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
    ...     <inertia ixx="0" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
    ...     <joint name="hinge" type="continuous"><parent link="wall"/><child link="rod"/><axis xyz="0 1 0"/></joint>
    ...     </robot>''')
    >>> p = mb.Parameters(m=3.0)
    >>> robot = mb.load_urdf(file, replace={"rod.mass": p.m})
    >>> system = mb.System(*robot.elements, mb.Gravity(0, 0, -9.81), parameters=p)
    >>> scene = mb.Scene(system, robot.start, [0.0, 0.1], {"angle": robot.joints["hinge"].angle})
    >>> float(mb.simulate(scene)["angle"][-1].round(4))
    0.0865
    """
    path = checked_path("load_urdf", path, stop, fixed_base=fixed_base, strict=strict)
    passed = None if strict else {}
    description = _read_description(path, passed)
    values = replaced(description, replace, stop, "Use fixed_base=False." if fixed_base else None)
    with Block():
        building, repairs = repaired(Building(description, values, fixed_base, stop))
        robot = building.robot()
    declared(*robot.elements)
    warn_of([*told(passed or {}), *repairs], f"load_urdf {path}")
    return robot


def _read_description(path: Path, passed: dict[str, list[Tag]] | None) -> Description:
    """The content of a URDF file. All faults of links and joints are reported at once, each with line and element."""
    top = read_document(path, passed)
    if top.name != "robot":
        raise top.fault("the root element of a URDF file must be <robot>.")
    top.check(_IN_ROBOT, ("name", "version"))
    faults = Faults()
    numbers: dict[str, float] = {}
    links: dict[str, LinkData] = {}
    joints: dict[str, JointData] = {}
    for tag in top.inside:
        with faults.noted():
            if tag.name == "link":
                _add(links, _link(tag, numbers))
            elif tag.name == "joint":
                _add(joints, _joint(tag, numbers))
            elif tag.name in {*_IN_LINK, *_IN_JOINT} - {*_IN_ROBOT}:
                raise tag.fault("this element is a direct child of <robot>. Move it into a link or a joint.")
    if not faults:
        faults += _reference_faults(links, joints)
    for joint in [*joints.values()] * (not faults):
        with faults.noted():
            _free_mimic(joint, joints)
    faults.raise_any()
    if not links:
        raise top.fault("this robot has no <link>. Add a <link>.")
    root, order = _tree(top, links, joints)
    return Description(top.text("name") if "name" in top.attributes else path.stem, path, links, order, root, numbers)


def _add(known: dict, new: LinkData | JointData) -> None:
    if new.name in known:
        raise new.tag.fault(f"line {known[new.name].tag.line} uses this name, too. Rename one of the two.")
    known[new.name] = new


def _origin(tag: Tag) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Position [m] and angles [rad] of the <origin> of an element; zeros without <origin>."""
    origin = tag.one("origin")
    if origin is None:
        return (0.0,) * 3, (0.0,) * 3
    origin.check_exactly(("xyz", "rpy"), others_matter=True)
    return origin.numbers("xyz", (0.0,) * 3), origin.numbers("rpy", (0.0,) * 3)


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
        mass = of_mass.not_negative("value", what="the mass")
        of_inertia = inertial.needed("inertia")
        of_inertia.check_exactly(_INERTIA)
        moments = tuple(of_inertia.number(entry) for entry in _INERTIA)
        fault = inertia_fault(moments)
        if fault:
            of_inertia.pass_over("impossible inertias", of_inertia.fault(fault))
    numbers |= {f"{name}.mass": mass} | named(f"{name}.com", (*XYZ, *RPY), (*xyz, *rpy))
    numbers |= named(f"{name}.inertia", tuple(entry[1:] for entry in _INERTIA), moments)
    visual, collision = ([shape for t in tag.all(kind) if (shape := _shape(t))] for kind in ("visual", "collision"))
    return LinkData(name, tuple(visual or collision), tag)


def _shape(tag: Tag) -> ShapeData | None:
    """The shape of a <visual> or <collision>; None for shapes that URDF does not define."""
    tag.check(("origin", "geometry", "material"), ("name",))
    xyz, rpy = _origin(tag)
    geometry = tag.needed("geometry")
    geometry.check((*_SIZES,), ())
    if not geometry.inside:
        raise geometry.fault(f"this element is empty. Add one of {', '.join(_SIZES)}.")
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
        raise shape.fault(f"the size {min(size):g} is not positive. Write a positive size.")
    return ShapeData(shape.name, xyz, rpy, size)  # pyright: ignore[reportArgumentType]


def _joint(tag: Tag, numbers: dict[str, float]) -> JointData:
    name = tag.own_name()
    tag.check(_IN_JOINT, ("name", "type"))
    kind = tag.text("type")
    if kind not in _TYPES:
        raise tag.fault(f"the type {kind!r} is not known. Use one of {', '.join(_TYPES)}.")
    ends = []
    for end in ("parent", "child"):
        of_end = tag.needed(end)
        of_end.check_exactly(("link",))
        ends.append(of_end.reference("link"))
    numbers |= named(f"{name}.origin", (*XYZ, *RPY), sum(_origin(tag), ()))
    if kind not in ("fixed", "floating"):
        numbers |= named(f"{name}.axis", XYZ, _axis(tag))
    mimic = tag.one("mimic")
    if kind in (*TURNING, *SLIDING):
        numbers |= _limits(tag, name, kind) | _dynamics(tag, name)
        if mimic is not None:
            mimic.check_exactly(("joint", "multiplier", "offset"))
            numbers[f"{name}.mimic.multiplier"] = mimic.number("multiplier", 1.0)
            numbers[f"{name}.mimic.offset"] = mimic.number("offset", 0.0)
    elif kind != "fixed" and any(_dynamics(tag, name).values()):
        raise tag.needed("dynamics").fault(
            f"<dynamics> cannot be used, because a {kind} joint has several rates. Declare forces of this joint in "
            "Python."
        )
    return JointData(name, kind, *ends, mimic=None if mimic is None else mimic.reference("joint"), tag=tag)


def _axis(tag: Tag) -> tuple[float, ...]:
    axis = tag.one("axis")
    if axis is None:
        return 1.0, 0.0, 0.0
    axis.check_exactly(("xyz",))
    axis.text("xyz")
    values = axis.numbers("xyz", (1.0, 0.0, 0.0))
    if not any(values):
        raise axis.fault("the axis 0 0 0 has no direction. Write a vector that is not zero.")
    return values


def _limits(tag: Tag, name: str, kind: str) -> dict[str, float]:
    limit = tag.one("limit")
    if limit is None:
        if kind in _LIMITED:
            instead = ", or make the joint continuous" if kind == "revolute" else ""
            raise tag.fault(f"a {kind} joint must have limits. Add <limit lower='...' upper='...'/>{instead}.")
        return {}
    limit.check((), ("lower", "upper", "effort", "velocity"))
    values = {end: limit.number(end, 0.0) for end in ("lower", "upper")}
    if values["lower"] > values["upper"]:
        raise limit.fault(f"lower {values['lower']:g} exceeds upper {values['upper']:g}. Exchange the two values.")
    values |= {what: limit.not_negative(what, 0.0) for what in ("effort", "velocity")}
    return {f"{name}.limit.{end}": value for end, value in values.items()}


def _dynamics(tag: Tag, name: str) -> dict[str, float]:
    dynamics, kinds = tag.one("dynamics"), ("damping", "friction")
    if dynamics is None:
        return {f"{name}.{what}": 0.0 for what in kinds}
    dynamics.check_exactly(kinds)
    return {f"{name}.{what}": dynamics.not_negative(what, 0.0) for what in kinds}


def _reference_faults(links: Mapping[str, LinkData], joints: Mapping[str, JointData]) -> Iterator[str]:
    """Faults of the names with which joints refer to links and to each other."""
    carried: dict[str, JointData] = {}
    for joint in joints.values():
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                yield str(joint.tag.needed(end).fault(f"{_none('link', link, links)}."))
        if joint.parent == joint.child:
            yield str(joint.tag.fault(f"parent and child are both {joint.child!r}. Use two different links."))
        elif joint.child in carried:
            other = carried[joint.child]
            yield str(
                joint.tag.needed("child").fault(
                    f"joint {other.name!r} in line {other.tag.line} already carries the link {joint.child!r}. Close "
                    "loops by joints in Python."
                )
            )
        carried.setdefault(joint.child, joint)


def _none(what: str, name: str | None, known: Mapping[str, object]) -> str:
    """The message that there is no link or joint of a name, with similar names if there are any."""
    close = did_you_mean(name, known).strip().rstrip(".")
    return f"there is no {what} {name!r}" + (f"; {close[0].lower()}{close[1:]}" if close else "")


def _free_mimic(joint: JointData, joints: dict[str, JointData]) -> None:
    """Record a <mimic> without effect as a harmless fault: a joint is missing, has no value, or follows itself.

    If the joint has a value, it then moves freely."""
    # The leader of a joint is the joint that it follows. The search ends if a leader is missing or appears again. Only
    # the first joint of a circle becomes free. The other joints of the circle then follow this joint.
    row, leader = [joint.name], joint.mimic
    while leader in joints and leader not in row:
        row.append(leader)
        leader = joints[leader].mimic
    if joint.mimic is None:
        return
    if not joint.moves:
        what, why = (
            f"{joint.kind} joints",
            f"a {joint.kind} joint has no angle or displacement, so it cannot follow another joint",
        )
    elif joint.mimic not in joints:
        what, why = "joints that do not exist", _none("joint", joint.mimic, joints)
    elif leader == joint.name:
        what, why = "joints that follow themselves", f"joint {joint.name!r} follows itself. Use another joint"
    elif not joints[joint.mimic].moves:
        kind = joints[joint.mimic].kind
        what, why = f"a {kind} joint", f"{kind} joint {joint.mimic!r} has no angle or displacement. Use another joint"
    else:
        return
    mimic, free = joint.tag.needed("mimic"), ", so the followers move freely" * joint.moves
    mimic.pass_over(f"<mimic> of {what}{free}", mimic.fault(f"{why}."))
    joints[joint.name] = replace(joint, mimic=None)


def _tree(top: Tag, links: Mapping[str, LinkData], joints: Mapping[str, JointData]) -> tuple[str, dict[str, JointData]]:
    """The base link, and the joints from the base outward: a joint comes after the joint that carries its parent."""
    carrier = {joint.child: joint for joint in joints.values()}
    roots = [name for name in links if name not in carrier]
    if not roots:
        raise top.fault(
            "the joints form a closed loop, so no link is the base. Remove a joint "
            "of the loop from the file, and add it in Python."
        )
    if len(roots) > 1:
        raise links[roots[1]].tag.fault(
            f"no joint carries this link, and no joint carries {roots[0]!r}. Connect the two links by a joint."
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
        raise lost.tag.fault(
            "joints between the base and this joint form a closed loop. Remove one of these joints from the file, "
            "and declare it in Python."
        )
    return roots[0], order
