"""Parts of an MJCF file that symmb leaves out."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from symmb.declare.mechanics.robots.mjcf_elements import actuator_fault, equality_fault, tendon_fault
from symmb.declare.mechanics.robots.mjcf_model import MjcfModel


def left_out(source: MjcfModel, has_stops: bool) -> list[str]:
    """One sentence that lists the parts that symmb leaves out; empty if there are none."""
    found = [*_of_joints(source, has_stops), *_of_tendons(source), *_of_actuators(source), *_of_the_rest(source)]
    return [f"These parts of the file are left out: {'; '.join(found)}."] if found else []


def _listed(what: str, names: list[str], where: Iterable[Any], most: int = 6) -> Iterator[str]:
    """The text `what` with the names that have a nonzero entry in `where`; nothing if there are none."""
    hit = [name for name, value in zip(names, where, strict=True) if np.any(value)]
    if hit:
        more = f" and {len(hit) - most} more" if len(hit) > most else ""
        yield f"{what} ({', '.join(hit[:most])}{more})"


def _of_joints(source: MjcfModel, has_stops: bool) -> Iterator[str]:
    m, names = source.model, source.joints
    several = np.array([source.kind("mjtJoint", kind) in ("FREE", "BALL") for kind in m.jnt_type], dtype=bool)
    if source.acts("LIMIT"):
        limited = (m.jnt_limited != 0) & (several | (not has_stops))
        yield from _listed("limits of joints, because stop=... is missing", names, limited)
    yield from _listed("springs of ball and free joints", names, several & (m.jnt_stiffness != 0))
    of_dofs = m.dof_jntid
    for what, values in (("armature", m.dof_armature), ("friction loss", m.dof_frictionloss)):
        at = np.isin(np.arange(m.njnt), of_dofs[values != 0])
        yield from _listed(f"{what} of ball and free joints", names, several & at)
    yield from _listed("nonlinear stiffness of joints", names, _parts(m, "jnt_stiffnesspoly", m.njnt))
    poly = _parts(m, "dof_dampingpoly", m.nv).any(axis=1)
    yield from _listed("nonlinear damping of joints", names, np.isin(np.arange(m.njnt), of_dofs[poly]))
    yield from _listed("yield of springs in joints", names, _parts(m, "jnt_springyield", m.njnt))
    yield from _listed("limits of forces in joints", names, m.jnt_actfrclimited)


def _parts(m: Any, name: str, count: int) -> Any:
    """The array (count, k) of a model; zeros if this version of MuJoCo does not have the array."""
    return np.reshape(getattr(m, name, np.zeros(count)), (count, -1) if count else (0, 1))


def _of_tendons(source: MjcfModel) -> Iterator[str]:
    m, names = source.model, source.tendons
    yield from _listed(
        "tendons around geoms or over pulleys", names, [tendon_fault(source, k) for k in range(m.ntendon)]
    )
    for what, array in (
        ("limits", "tendon_limited"), ("friction loss", "tendon_frictionloss"), ("armature", "tendon_armature"),
        ("nonlinear stiffness", "tendon_stiffnesspoly"), ("nonlinear damping", "tendon_dampingpoly"),
        ("yield", "tendon_springyield"), ("limits of forces", "tendon_actfrclimited"),
    ):  # fmt: skip
        yield from _listed(f"{what} of tendons", names, _parts(m, array, m.ntendon))


def _of_actuators(source: MjcfModel) -> Iterator[str]:
    m, names = source.model, source.actuators
    faults = [actuator_fault(source, k) for k in range(len(names))]
    for fault in dict.fromkeys(filter(None, faults)):
        yield from _listed(f"actuators, because {fault}", names, [own == fault for own in faults])
    for what, array in (
        ("ranges of controls", "actuator_ctrllimited"), ("ranges of forces", "actuator_forcelimited"),
        ("ranges of activations", "actuator_actlimited"), ("damping", "actuator_damping"),
        ("armature", "actuator_armature"), ("delay", "actuator_delay"),
    ):  # fmt: skip
        acts = what != "ranges of controls" or source.acts("CLAMPCTRL")
        kept = np.array([acts and not fault for fault in faults], dtype=bool)
        yield from _listed(f"{what} of actuators", names, _parts(m, array, len(names)).any(axis=1) & kept)


def _of_the_rest(source: MjcfModel) -> Iterator[str]:
    m = source.model
    faults = [equality_fault(source, k) for k in range(m.neq)]
    for fault in dict.fromkeys(filter(None, faults)):
        yield from _listed(
            f"equality constraints, because {fault}", source.equalities, [own == fault for own in faults]
        )
    if source.acts("CONTACT") and (_may_touch(source) or m.npair):
        yield "contacts"
    if m.opt.density or m.opt.viscosity:
        yield "forces of the fluid"
    yield from _listed("motions of mocap bodies", source.bodies, m.body_mocapid >= 0)
    yield from _listed("keyframes", [m.key(k).name or f"key{k}" for k in range(m.nkey)], [True] * m.nkey)
    for what, count in (("flexible parts", m.nflex), ("plugins", m.nplugin)):
        if count:
            yield what


def _may_touch(source: MjcfModel) -> bool:
    """Whether MuJoCo would search for contacts between bodies, except contacts of a body with its parent."""
    m = source.model
    body = m.body_weldid[m.geom_bodyid]
    parent = m.body_weldid[m.body_parentid[body]]
    carried = (parent[:, None] == body) & (body != 0) & source.acts("FILTERPARENT")
    meeting = (m.geom_contype[:, None] & m.geom_conaffinity) != 0
    return bool((meeting & (body[:, None] != body) & ~(carried | carried.T)).any())
