"""Machines from MJCF files: `load_mjcf`, and bodies and joints of the model that the package mujoco compiles."""

import math
import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace as with_changes
from pathlib import Path
from typing import Any

import numpy as np

from symmb._errors import DeclarationError, warn_of
from symmb._interrupts import kept_interrupts
from symmb._magnitudes import ROUNDING
from symmb._options import optional_package
from symmb._types import Expr
from symmb.declare.mechanics.contact_law import ContactLaw
from symmb.declare.mechanics.declaration import Block, declared
from symmb.declare.mechanics.robots.algebra import Vector, add, angles, conjugate, matrix, one_after, turned
from symmb.declare.mechanics.robots.description import (
    ENTRIES,
    RPY,
    XYZ,
    Description,
    JointData,
    LinkData,
    ShapeData,
    named,
)
from symmb.declare.mechanics.robots.mjcf_elements import MjcfElements, element_numbers
from symmb.declare.mechanics.robots.mjcf_left_out import left_out
from symmb.declare.mechanics.robots.mjcf_model import MjcfModel, values_of
from symmb.declare.mechanics.robots.repair import nearest_possible, repaired
from symmb.declare.mechanics.robots.robot import Building, Robot, checked_path, replaced

_JOINTS = {"FREE": "floating", "BALL": "ball", "SLIDE": "prismatic", "HINGE": "revolute"}
"""The kind of a joint in a `Description`, by the last word of its mjtJoint."""
_UNNAMED = "MuJoCo Model"
"""The name that MuJoCo gives a model without a name."""


@kept_interrupts()
def load_mjcf(
    path: str | Path,
    *,
    replace: Mapping[str, Expr] | None = None,
    stop: ContactLaw | float | None = None,
    strict: bool = False,
) -> Robot:
    """A machine from an MJCF file of MuJoCo. The package mujoco must be installed.

    Bodies become bodies in space. A body without joints and its parent become one body. Hinges become `Revolute`, slide
    joints `Prismatic`, and ball joints `Spherical`. A body with a free joint is free. If a body has several joints,
    bodies without mass are inserted between the joints. Armature becomes a disc on the ground that turns at the
    rate of the joint. Equality constraints become rigid joints and constraints, although MuJoCo uses stiff springs.
    Springs, damping, tendons through sites, actuators, weight compensation and gravity become elements. A SymmbWarning
    names all parts of the file that are left out, such as contacts.

    Parameters
    ----------
    path : str or Path
    replace : mapping
        numbers or expressions of parameters by name, such as {"forearm.mass": p.m}. Names are those of `load_urdf`
        ("elbow.origin.x" is the position of the body in its parent), and "elbow.pos.x" (.y .z), "elbow.ref",
        "elbow.stiffness", "elbow.springref", "elbow.armature", "gravity.x" (.y .z), "motor.ctrl", "motor.gear",
        "motor.gain" (.gain.length .gain.velocity), "motor.bias" (.bias.length .bias.velocity), "motor.timeconst",
        "tendon.stiffness", "tendon.damping", "tendon.springlength.lower" (.upper), "loop.body1.x" (.y .z),
        "loop.body2.x", "loop.polycoef.0" (.1 ... .4)
    stop : ContactLaw or float
        see `load_urdf`
    strict : bool
        whether an impossible inertia is an error. By default the inertia is replaced, as in `load_urdf`

    Returns
    -------
    Robot

    Raises
    ------
    DeclarationError
        If MuJoCo refuses the file, if a name cannot be used, or if `replace` contains unknown names
    ImportError
        If the package mujoco is not installed

    Examples
    --------
    >>> import symmb as mb, tempfile, pathlib
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "pendulum.xml"
    >>> _ = file.write_text('''<mujoco> <worldbody> <body name="rod"> <joint name="hinge" axis="0 1 0"/>
    ...     <inertial pos="0.5 0 0" mass="2" diaginertia="0.1 0.1 0.1"/> </body> </worldbody> </mujoco>''')
    >>> p = mb.Parameters(m=3.0)
    >>> robot = mb.load_mjcf(file, replace={"rod.mass": p.m})  # doctest: +SKIP
    >>> system = mb.System(*robot.elements, parameters=p)  # doctest: +SKIP
    >>> scene = mb.Scene(system, robot.start, [0.0, 0.1], {"angle": robot.joints["hinge"].angle})  # doctest: +SKIP
    >>> float(mb.simulate(scene)["angle"][-1].round(4))  # doctest: +SKIP
    0.0865
    """
    path = checked_path("load_mjcf", path, stop, strict=strict)
    try:
        with Block():
            source, name, said = _compiled(path, strict)
            description = _description(source, name)
            values = replaced(description, replace, stop, "Add a joint to this body in the file.")
            building, repairs = repaired(Building(description, values, True, stop))
            robot = building.robot()
            more = MjcfElements(source, building, robot.joints)
            elements = (*robot.elements, *more.all())
            # The start must not contain joints that follow other joints: their constraints determine their values.
            start = {name: value for name, value in robot.start.items() if name.rpartition(".")[0] not in more.led}
            remarks = [*left_out(source, stop is not None), *said, *repairs]
    except UnicodeDecodeError:
        raise DeclarationError(f"{path}: names in this file are not UTF-8. Save the file in UTF-8.") from None
    declared(*elements)
    warn_of(remarks, f"load_mjcf {path}")
    return with_changes(robot, elements=elements, start=start)


def _compiled(path: Path, strict: bool) -> tuple[MjcfModel, str, list[str]]:
    """MuJoCo's model of a file, the name of the model, and MuJoCo's warnings."""
    mujoco = optional_package("mujoco", "load_mjcf", "mjcf")
    is_urdf = path.suffix.lower() == ".urdf"
    if not path.is_file() and not is_urdf:
        why = "it is a folder" if path.is_dir() else "there is no such file"
        raise DeclarationError(f"{path}: this file cannot be read ({why}).")
    try:
        content = b"" if is_urdf else path.read_bytes()
    except OSError as error:
        raise DeclarationError(f"{path}: this file cannot be read ({error.strerror}).") from None
    if is_urdf or re.match(rb"(\s|<[?!][^>]*>)*<robot\b", content):
        raise DeclarationError(f"{path}: this is a URDF file. Use load_urdf.")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            spec, moments = mujoco.MjSpec.from_file(str(path)), {}
            try:
                model = spec.compile()
            except ValueError:  # perhaps of an impossible inertia, which MuJoCo refuses at the first body
                moments = {} if strict else dict(_impossible(spec))
                if not moments:
                    raise
                model = spec.compile()
        except Exception as error:  # MuJoCo's parser and compiler raise errors of several classes
            raise DeclarationError(f"{path}: MuJoCo cannot read this file ({_line(error)}).") from None
    name = path.stem if spec.modelname == _UNNAMED else spec.modelname
    return (
        MjcfModel(model, mujoco, path, moments),
        name,
        [f"MuJoCo's warning: {_line(warning.message)}." for warning in caught],
    )


def _impossible(spec: Any) -> Iterator[tuple[int, tuple[float, ...]]]:
    """The bodies with an impossible inertia, and the entries xx, xy, xz, yy, yz, zz of this inertia.

    In `spec` the inertia of a sphere replaces each impossible inertia, so that MuJoCo can compile the model.
    """
    for k, body in enumerate(spec.bodies):
        is_full = math.isfinite(body.fullinertia[0])
        xx, yy, zz, xy, xz, yz = map(float, body.fullinertia if is_full else (*body.inertia, 0, 0, 0))
        moments = xx, xy, xz, yy, yz, zz
        if body.explicitinertial and not np.allclose(moments, nearest_possible(moments), rtol=ROUNDING, atol=0):
            body.fullinertia, body.inertia = (math.nan, 0, 0, 0, 0, 0), (1, 1, 1)
            yield k, moments


def _line(text: object) -> str:
    """A text of several lines in one line."""
    return ", ".join(line.strip(" .") for line in str(text).splitlines() if line.strip())


def _description(source: MjcfModel, name: str) -> Description:
    """The description of a model: bodies, joints and numbers."""
    numbers: dict[str, float] = {}
    joints: dict[str, JointData] = {}
    for body in range(source.model.nbody):
        numbers |= _mass(source, body)
        if body:
            joints |= {joint.name: joint for joint in _joints(source, body, numbers)}
    links = {link: LinkData(link, tuple(_shapes(source, body))) for body, link in enumerate(source.bodies)}
    for joint in joints.values():  # links without mass between several joints of one body
        if joint.child not in links:
            links[joint.child] = LinkData(joint.child, ())
            numbers |= _weightless(joint.child)
    return Description(name, source.path, links, joints, source.bodies[0], numbers | element_numbers(source))


def _mass(source: MjcfModel, body: int) -> dict[str, float]:
    m, name = source.model, source.bodies[body]
    numbers = _weightless(name) | {f"{name}.mass": float(m.body_mass[body])}
    numbers |= named(f"{name}.com", (*XYZ, *RPY), _placed(m.body_ipos[body], m.body_iquat[body]))
    xx, yy, zz = values_of(m.body_inertia[body])
    return numbers | named(f"{name}.inertia", ENTRIES, source.moments.get(body, (xx, 0.0, 0.0, yy, 0.0, zz)))


def _weightless(name: str) -> dict[str, float]:
    """The numbers of the mass, centre and inertia of a body without mass: zeros."""
    zeros = named(f"{name}.com", (*XYZ, *RPY), (0.0,) * 6) | named(f"{name}.inertia", ENTRIES, (0.0,) * 6)
    return {f"{name}.mass": 0.0} | zeros


def _joints(source: MjcfModel, body: int, numbers: dict[str, float]) -> Iterator[JointData]:
    """The joints that carry a body, from its parent outward. A body without joints has one fixed joint."""
    m = source.model
    parent, child = source.bodies[m.body_parentid[body]], source.bodies[body]
    place = _placed(m.body_pos[body], m.body_quat[body])
    first, count = int(m.body_jntadr[body]), int(m.body_jntnum[body])
    for joint in range(first, first + count):
        name, kind = source.joints[joint], _JOINTS[source.kind("mjtJoint", m.jnt_type[joint])]
        link = child if joint == first + count - 1 else f"{name}:link"
        numbers |= named(f"{name}.origin", (*XYZ, *RPY), place) | _joint_numbers(source, joint, name, kind)
        yield JointData(name, kind, parent, link, None)
        parent, place = link, (0.0,) * 6
    if not count:
        name = f"{child}_mount" if child in source.joints else child
        numbers |= named(f"{name}.origin", (*XYZ, *RPY), place)
        yield JointData(name, "fixed", parent, child, None)


def _joint_numbers(source: MjcfModel, joint: int, name: str, kind: str) -> dict[str, float]:
    m, at = source.model, int(source.model.jnt_dofadr[joint])
    numbers = {f"{name}.damping": float(m.dof_damping[at]) if source.acts("DAMPER") else 0.0}
    if kind != "floating":
        numbers |= named(f"{name}.pos", XYZ, values_of(m.jnt_pos[joint]))
    if kind in ("floating", "ball"):
        return numbers
    numbers |= named(f"{name}.axis", XYZ, values_of(m.jnt_axis[joint]))
    position = int(m.jnt_qposadr[joint])
    numbers |= {
        f"{name}.ref": float(m.qpos0[position]),
        f"{name}.springref": float(m.qpos_spring[position]),
        f"{name}.stiffness": float(m.jnt_stiffness[joint]) if source.acts("SPRING") else 0.0,
        f"{name}.armature": float(m.dof_armature[at]),
        f"{name}.friction": float(m.dof_frictionloss[at]) if source.acts("FRICTIONLOSS") else 0.0,
    }
    if m.jnt_limited[joint] and source.acts("LIMIT"):
        numbers |= named(f"{name}.limit", ("lower", "upper"), values_of(m.jnt_range[joint]))
    return numbers


def _shapes(source: MjcfModel, body: int) -> Iterator[ShapeData]:
    m, first = source.model, int(source.model.body_geomadr[body])
    for geom in range(first, first + int(m.body_geomnum[body])):
        kind = source.kind("mjtGeom", m.geom_type[geom])
        at, e, (a, b, c) = (values_of(of[geom]) for of in (m.geom_pos, m.geom_quat, m.geom_size))
        if m.geom_group[geom] > 2:  # by convention for contacts only: MuJoCo's viewer hides these groups
            continue
        if kind == "BOX":
            yield ShapeData("box", at, angles(e), (2 * a, 2 * b, 2 * c))
        elif kind in ("CYLINDER", "CAPSULE"):
            yield ShapeData("cylinder", at, angles(e), (a, 2 * b))
            for end in (-b, b) if kind == "CAPSULE" else ():
                yield ShapeData("sphere", _moved(at, e, (0.0, 0.0, end)), (0.0,) * 3, (a,))
        elif kind == "SPHERE":
            yield ShapeData("sphere", at, (0.0,) * 3, (a,))
        elif kind == "MESH" and (file := source.mesh_file(int(m.geom_dataid[geom]))):
            yield _mesh(source, int(m.geom_dataid[geom]), file, at, e)


def _mesh(source: MjcfModel, mesh: int, file: str, at: tuple[float, ...], e: Vector) -> ShapeData:
    """A mesh in the axes of its file. MuJoCo has moved the mesh to its centre and its principal axes."""
    turn = one_after(e, conjugate(values_of(source.model.mesh_quat[mesh])))
    at = _moved(at, turn, values_of(-source.model.mesh_pos[mesh]))
    return ShapeData("mesh", at, angles(turn), values_of(source.model.mesh_scale[mesh]), file)


def _moved(at: tuple[float, ...], e: Vector, way: Vector) -> tuple[float, ...]:
    """The position `at` plus the vector `way`. The components of `way` are in axes turned by the quaternion e."""
    return tuple(map(float, add(at, turned(matrix(e), way))))


def _placed(at: Any, quaternion: Any) -> tuple[float, ...]:
    """The numbers x, y, z, roll, pitch, yaw of a position and a quaternion."""
    return (*values_of(at), *angles(values_of(quaternion)))
