"""Bodies, joints and forces of a machine from a file."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import unquote, urlsplit

import casadi as ca

from symmb._cleanup import real_path
from symmb._errors import DeclarationError, Faults
from symmb._names import did_you_mean
from symmb._options import is_finite_number, is_real, require_truth, shown
from symmb._types import Expr
from symmb.declare.mechanics.actuator import Actuator, Stop
from symmb.declare.mechanics.axis_joint import AxisJoint, Joint
from symmb.declare.mechanics.body import AbstractBody, Body, Flywheel, Ground, Link, Point
from symmb.declare.mechanics.constraint import Motion, VelocityConstraint
from symmb.declare.mechanics.contact_law import ContactLaw
from symmb.declare.mechanics.element import Element
from symmb.declare.mechanics.force import Bushing
from symmb.declare.mechanics.friction import Coulomb
from symmb.declare.mechanics.geometry import Box3, Cylinder, Geometry, Mesh, Sphere
from symmb.declare.mechanics.joint import PlanarJoint, Prismatic, Revolute, Spherical
from symmb.declare.mechanics.pose import Spatial
from symmb.declare.mechanics.robots.algebra import (
    Mass,
    Scalar,
    Vector,
    about,
    add,
    by_angles,
    is_nought,
    matrix,
    one_after,
    plain,
    product,
    rotation,
    transposed,
    turned,
    unit,
    united,
)
from symmb.declare.mechanics.robots.description import (
    ENTRIES,
    RPY,
    SLIDING,
    TURNING,
    XYZ,
    Description,
    JointData,
    inertia_fault,
)
from symmb.declare.symbolic import is_sympy, scalar, vector

Place: TypeAlias = "tuple[Vector, Vector]"
"""Origin (3,) [m] and quaternion (4,) of a frame."""
ORIGIN: Place = (0.0, 0.0, 0.0), by_angles((0.0, 0.0, 0.0))
_JOINTS: dict[str, type[AxisJoint]] = dict.fromkeys(TURNING, Revolute)
_JOINTS |= dict.fromkeys(SLIDING, Prismatic) | {"planar": PlanarJoint}


class _LinkMesh(Mesh):
    """The mesh of a link. The file is read only for drawings, so it may be missing."""

    def __post_init__(self) -> None:
        pass


@dataclass(frozen=True, eq=False)
class LinkFrame:
    """A link that fixed joints connect to other links. All are one `body` with the name of the link nearest the base.

    Attributes
    ----------
    name : str
    body : Body or Ground
    origin : (3,)          origin of the link in body axes, relative to the origin of the body's points [m]
    quaternion : (4,)      rotation from axes of the link to axes of the body, scalar first
    """

    name: str
    body: AbstractBody
    origin: Vector
    quaternion: Vector

    def point(self, x: Expr, y: Expr, z: Expr = 0) -> Point:
        """Point of the body at (x, y, z) [m] in axes of the link, from the link's origin."""
        return self.body.point(*add(self.origin, self.direction(x, y, z)))

    def direction(self, x: Expr, y: Expr, z: Expr = 0) -> Vector:
        """A vector (3,) in body axes, from its components in axes of the link. Use it for axes of joints."""
        own = ca.vertsplit(vector([x, y, z], f"direction of {self.name!r}"))
        return turned(matrix(self.quaternion), tuple(map(plain, own)))


class _ByName(dict[str, Any]):
    """Parts by name. The error for an unknown name suggests similar names."""

    def __init__(self, robot: str, what: str) -> None:
        super().__init__()
        self._robot, self._what = robot, what

    def __missing__(self, name: str) -> Any:
        raise DeclarationError(f"Robot {self._robot!r} has no {self._what} {name!r}.{did_you_mean(name, self)}")


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """A machine from a file, as `load_urdf` and `load_mjcf` return it.

    Attributes
    ----------
    name : str
    numbers : dict         all numbers of the file by name, in SI units
    bodies : dict          link -> `Body`, `Ground`, or `LinkFrame` if fixed joints connect links; `.point(x, y, z)`
                           uses the origin and the axes of the link
    joints : dict          joint -> `Revolute`, `Prismatic`, `PlanarJoint` or `Spherical`. Angles and displacements
                           have the zero and the sign of the file
    elements : tuple       all elements for a `System`: bodies, joints, forces and other elements of the file
    start : dict           the pose of the machine in the file, for `Scene(start=...)` or `guess=`
    """

    name: str
    numbers: dict[str, float]
    bodies: Mapping[str, Any]
    joints: Mapping[str, Any]
    elements: tuple[Body | Element, ...]
    start: dict[str, Any]

    def __repr__(self) -> str:
        kinds: dict[str, int] = {}
        for element in self.elements:
            kinds[type(element).__name__] = kinds.get(type(element).__name__, 0) + 1
        limits = sum(name.endswith(".limit.lower") for name in self.numbers)
        stops = kinds.get("Stop", 0)
        text = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        of_joints = "the limits of one joint" if limits == 1 else f"the limits of {limits} joints"
        idle = f"; {of_joints} have no effect without stop=..." if limits and not stops else ""
        return f"Robot({self.name!r}: {text}{idle})"


def checked_path(owner: str, path: object, stop: object, **truths: object) -> Path:
    """The path of a file. Raises DeclarationError for an invalid path or stop, or if `truths` are not booleans."""
    if not isinstance(path, str | Path):
        raise DeclarationError(f"{owner}: expected the path of a file, got {shown(path)}.")
    for name, value in truths.items():
        require_truth(owner, name, value)
    if stop is not None and not isinstance(stop, ContactLaw) and not is_sympy(stop):
        scalar(stop, f"{owner}: stop, a contact law or a coefficient of restitution")
    return Path(path)


def replaced(
    description: Description, replace: Mapping[str, Expr] | None, stop: object, fixed: str | None
) -> dict[str, Scalar]:
    """All numbers of a file, after replacements. `fixed` says what to do if a number of a fixed base is replaced."""
    replace = {} if replace is None else replace
    if not isinstance(replace, Mapping):
        raise DeclarationError(
            f'replace: expected a mapping from names to expressions, such as {{"forearm.mass": p.m}}, got '
            f"{shown(replace)}."
        )
    faults = Faults()
    values: dict[str, Scalar] = dict(description.numbers)
    for name, value in replace.items():
        fault = _idle_fault(description, name, stop, fixed) or _value_fault(name, value)
        if fault:
            faults.append(f"replace: {fault}")
        else:
            values[name] = float(value) if is_real(value) else scalar(value, f"replace: {name!r}")
    for link in {name.partition(".inertia.")[0] for name in replace if ".inertia." in str(name)} & {*description.links}:
        entries = [values[f"{link}.inertia.{entry}"] for entry in ENTRIES]
        numbers = tuple(entry for entry in entries if not isinstance(entry, ca.SX))
        fault = inertia_fault(numbers) if len(numbers) == len(entries) else ""
        if fault:
            faults.append(f"replace: inertia of {link!r}: {fault}")
    faults.raise_any()
    return values


def _idle_fault(description: Description, name: str, stop: object, fixed: str | None) -> str:
    """A sentence if a replaced number would have no effect; else empty."""
    if name not in description.numbers:
        return f"{description.name!r} has no number {name!r}.{did_you_mean(name, description.numbers)}"
    owner, what = name.split(".")[:2]
    if name.endswith((".effort", ".velocity")):
        return f"{name!r} has no effect, because symmb does not use limits of forces and velocities. Omit it."
    if what == "limit" and stop is None:
        return f"{name!r} has no effect without stop=.... Pass stop=...."
    if fixed is not None and description.tops.get(owner) == description.root and what in ("mass", "com", "inertia"):
        return f"{name!r} has no effect, because the base is fixed. {fixed}"
    return ""


def _value_fault(name: str, value: Any) -> str:
    """A sentence if a number is not finite, or if a quantity such as a mass is negative; else empty."""
    if not is_real(value):
        return ""
    if not is_finite_number(value):
        return f"{name!r} is {value!r}, not a finite number."
    is_negative = value < 0 and name.split(".")[1] in ("mass", "damping", "friction", "armature")
    return f"{name!r} is {value:g}; it must not be negative." if is_negative else ""


@dataclass(frozen=True, eq=False)
class Building:
    """Builds a robot from a description. `values` has the numbers of the description after replacements."""

    description: Description
    values: Mapping[str, Scalar]
    fixed_base: bool
    stop: ContactLaw | Expr | None

    def vector(self, name: str, parts: tuple[str, ...] = XYZ) -> Vector:
        """The numbers or expressions `name.x`, `name.y`, ... for the given parts."""
        return tuple(self.values[f"{name}.{part}"] for part in parts)

    def quaternion(self, name: str) -> Vector:
        """The quaternion (4,) of `name.roll`, `name.pitch` and `name.yaw`."""
        return by_angles(self.vector(name, RPY))

    def carried(self, joint: JointData, place: Place) -> Place:
        """The origin and quaternion of a joint's child at joint value 0. `place` belongs to the joint's parent."""
        at, e = place
        origin = add(at, turned(matrix(e), self.vector(f"{joint.name}.origin")))
        return origin, one_after(e, self.quaternion(f"{joint.name}.origin"))

    @cached_property
    def places(self) -> dict[str, Place]:
        """The origins and quaternions of all links relative to their bodies."""
        places: dict[str, Place] = {}
        joints = {joint.child: joint for joint in self.description.joints.values()}
        for link, top in self.description.tops.items():
            places[link] = ORIGIN if link == top else self.carried(joints[link], places[joints[link].parent])
        return places

    @cached_property
    def frames(self) -> dict[str, LinkFrame]:
        """The frames of all links, with the bodies to which they belong."""
        tops = self.description.tops
        held: dict[str, list[Mass]] = {top: [] for top in tops.values()}
        for link, top in tops.items():
            held[top].append(self.mass(link, self.places[link]))
        bodies = {top: self._body(top, masses) for top, masses in held.items()}
        return {link: LinkFrame(link, bodies[top], *self.places[link]) for link, top in tops.items()}

    def mass(self, link: str, place: Place) -> Mass:
        """The mass of a link, its centre of mass and its inertia, in the axes in which `place` is given."""
        origin, e = place
        xx, xy, xz, yy, yz, zz = self.vector(f"{link}.inertia", ENTRIES)
        R = matrix(one_after(e, self.quaternion(f"{link}.com")))
        J = product(product(R, ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))), transposed(R))
        return Mass(self.values[f"{link}.mass"], add(origin, turned(matrix(e), self.vector(f"{link}.com"))), J)

    def _body(self, top: str, masses: list[Mass]) -> AbstractBody:
        if self.fixed_base and top == self.description.root:
            return Ground(tuple(self._shapes(top)))
        whole = united(masses)
        if top == self.description.root and is_nought(whole.mass):
            raise DeclarationError(
                f"load_urdf: the free base {top!r} has no mass, so its acceleration is not determined. Add an "
                "<inertial> with mass and inertia to this link, or use fixed_base=True."
            )
        name = f"{top}_link" if top in self.description.joints else top
        J = whole.inertia
        if not any(isinstance(x, ca.SX) for row in J for x in row):  # rounding may make a moment of a rod negative
            J = tuple(tuple(max(x, 0.0) if i == k else x for k, x in enumerate(row)) for i, row in enumerate(J))
        return Link(name, whole.mass, J, Spatial(), whole.com, tuple(self._shapes(top)))

    def robot(self) -> Robot:
        """The robot with its bodies, joints, forces and start."""
        description, frames = self.description, self.frames
        bodies, joints = _ByName(description.name, "link"), _ByName(description.name, "joint")
        for link, top in description.tops.items():
            bodies[link] = frames[link].body if link == top else frames[link]
        joints.update({j.name: self._joint(j) for j in description.joints.values() if j.kind in (*_JOINTS, "ball")})
        elements: list[Body | Element] = [b for b in bodies.values() if isinstance(b, Body)]
        elements += joints.values()
        for joint in description.joints.values():
            elements += self._joint_forces(joint, joints) if joint.moves else self._damping(joint, joints)
        followers = {joint.name for joint in description.joints.values() if joint.mimic}
        moving = [j for j in joints.values() if j.coordinate and j.name not in followers]
        start = {f"{j.name}.{j.coordinate}": self.values.get(f"{j.name}.ref", 0.0) for j in moving}
        return Robot(description.name, description.numbers, bodies, joints, tuple(elements), start | self._free_start())

    def _joint(self, joint: JointData) -> Joint:
        name, (at, e) = joint.name, self.carried(joint, self.places[joint.parent])
        anchor = self.vector(f"{name}.pos") if f"{name}.pos.x" in self.values else (0.0, 0.0, 0.0)
        base, at = self.frames[joint.parent].body, add(at, turned(matrix(e), anchor))
        point_b = self.frames[joint.child].point(*anchor)
        if joint.kind == "ball":
            return Spherical(name, base.point(*at), point_b)
        own = self.vector(f"{name}.axis")
        axis, ref = turned(matrix(e), own), self.values.get(f"{name}.ref", 0.0)
        if not is_nought(ref):  # the joint value in the pose of the file
            if joint.kind in SLIDING:
                at = add(at, tuple(-ref * x for x in unit(axis)))
            else:
                e = one_after(e, about(own, -ref))
        return _JOINTS[joint.kind](name, base.point(*at), point_b, axis, zero=rotation(e))

    def _damping(self, data: JointData, joints: Mapping[str, Any]) -> Iterator[Element]:
        """The damping of a ball joint or a free joint, if it has one."""
        damping = self.values.get(f"{data.name}.damping", 0.0)
        if not is_nought(damping):
            if data.kind == "ball":
                points = joints[data.name].point_a, joints[data.name].point_b
            else:
                points = self.frames[data.parent].point(0, 0, 0), self.frames[data.child].point(0, 0, 0)
            yield Bushing(f"{data.name}:damping", *points, 0.0, damping, 0.0, damping)

    def _joint_forces(self, data: JointData, joints: Mapping[str, AxisJoint]) -> Iterator[Body | Element]:
        """Elements of a joint with one coordinate: damping, friction, spring, armature, mimic constraint and stop."""
        name, joint = data.name, joints[data.name]
        damping, friction = self.values[f"{name}.damping"], self.values[f"{name}.friction"]
        rate = getattr(joint, f"{joint.coordinate}_rate")
        if not is_nought(damping):
            yield Actuator(f"{name}:damping", joint, -damping * rate)
        if not is_nought(friction):
            # Above 0.01 [rad/s, m/s], a hundredth of usual joint rates, dry friction has its full value. A smaller
            # limit is closer to Coulomb's law, and makes the equations stiffer.
            force, _ = Coulomb(1.0, 0.01).resistance(name, rate, ca.SX(friction))
            yield Actuator(f"{name}:friction", joint, force)
        stiffness, armature = (self.values.get(f"{name}.{what}", 0.0) for what in ("stiffness", "armature"))
        if not is_nought(stiffness):
            value = getattr(joint, str(joint.coordinate))
            yield Actuator(f"{name}:spring", joint, -stiffness * (value - self.values[f"{name}.springref"]))
        if not is_nought(armature):
            # A disc on the ground turns at the rate of the joint. A disc on a body of the mechanism would also affect
            # other motions.
            rotor = Flywheel(f"{name}:rotor", armature, (armature,) * 3, Spatial())
            yield rotor
            yield Revolute(f"{name}:bearing", Ground().point(0, 0, 0), rotor.point(0, 0, 0))
            yield VelocityConstraint(f"{name}:armature", (rotor.omega[2] - rate,))
        if data.mimic is not None:
            value, led = (getattr(j, str(j.coordinate)) for j in (joint, joints[data.mimic]))
            factor, offset = (self.values[f"{name}.mimic.{part}"] for part in ("multiplier", "offset"))
            yield Motion(f"{name}:mimic", value - factor * led, offset)
        yield from self._stop(data, joint)

    def _stop(self, data: JointData, joint: AxisJoint) -> Iterator[Element]:
        """The stop at the limits of a joint, if the limits differ."""
        lower, upper = (self.values.get(f"{data.name}.limit.{end}") for end in ("lower", "upper"))
        if self.stop is None or data.kind == "continuous" or lower is None or upper is None:
            return
        if not (lower is upper or (isinstance(lower, float) and lower == upper)):
            law = self.stop if isinstance(self.stop, ContactLaw) else None
            yield Stop(f"{data.name}:stop", joint, lower, upper, law=law, restitution=None if law else self.stop)

    def _shapes(self, top: str) -> Iterator[Geometry]:
        """The shapes of all links that form the body of the link `top`."""
        for link, data in self.description.links.items():
            origin, e = self.places[link]
            for shape in data.shapes if self.description.tops[link] == top else ():
                at, turn = add(origin, turned(matrix(e), shape.xyz)), one_after(e, by_angles(shape.rpy))
                if shape.form == "box":
                    yield Box3(shape.size, at, rotation(turn))
                elif shape.form == "cylinder":
                    yield Cylinder(shape.size[0], shape.size[1], turned(matrix(turn), (0.0, 0.0, 1.0)), at)
                elif shape.form == "sphere":
                    yield Sphere(shape.size[0], at)
                else:
                    yield _LinkMesh(_mesh_path(shape.mesh, self.description.path), shape.size, at, rotation(turn))

    def _free_start(self) -> dict[str, Any]:
        """The start of free bodies, and the orientations of bodies on ball joints."""
        kinds = {joint.child: joint.kind for joint in self.description.joints.values()}
        places: dict[str, Place] = {self.description.root: ORIGIN}
        start: dict[str, Any] = {}
        for joint in self.description.joints.values():
            places[joint.child] = self.carried(joint, places[joint.parent])
        for link, (at, e) in places.items():
            body, kind = self.frames[link].body, kinds.get(link, "floating")
            if kind not in ("floating", "ball") or not isinstance(body, Body):
                continue
            start[f"{body.name}.rotation"] = rotation(e)
            if kind == "floating":
                center = add(at, turned(matrix(e), body.com))
                start |= {f"{body.name}.{x}": value for x, value in zip("xyz", center, strict=True)}
        return start


def _mesh_path(name: str, urdf: Path) -> Path:
    """The path of a mesh that a URDF file names, relative to the folder of the URDF file.

    The mesh "package://arm/meshes/a.stl" is `arm/meshes/a.stl` in one of the folders above the URDF file.
    """
    folder = real_path(urdf).parent
    try:
        address = urlsplit(name)
    except ValueError:  # not a valid URL: the name of a file
        return folder / name
    if address.scheme not in ("package", "model"):
        return folder / (unquote(address.path) if address.scheme == "file" else name)
    inside = Path(address.netloc, unquote(address.path).lstrip("/"))
    found = (above / inside for above in (folder, *folder.parents))
    return next((path for path in found if path.is_file()), folder / inside)
