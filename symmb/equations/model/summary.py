"""The summary of a system: its parts, and the parts that were left out."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from symmb.declare.mechanics import Constraint, ForceElement
from symmb.declare.symbolic import Kind, is_time, is_zero, lookup
from symmb.equations.model.assembly import Collected
from symmb.equations.model.joint_space import JointSpace


def system_text(system: Any, joints: JointSpace | None) -> str:
    """The summary of a System in a few lines: bodies, sizes, the structure of M, parts that were left out.

    `joints` is the `JointSpace` of a system in joint coordinates, None for a system in coordinates of bodies.
    """
    c, elements = system.collected, system.elements
    constraints = [e.kind for e in elements if isinstance(e, Constraint)]
    forces = [e.kind for e in elements if isinstance(e, ForceElement)]
    dropped = c.n_declared_rows - c.Phi.numel()
    parts = [
        ("bodies", _count([("flexible " if b.pose.modes else "") + type(b.pose).__name__.lower() for b in c.bodies])),
        ("constraints", _count(constraints)),
        ("forces", _count(forces)),
        ("impacts", ", ".join(name for name, *_ in c.impacts)),
        ("events", ", ".join(f"{e.joint.name} {'opens' if e.opens else 'closes'}" for e, _ in c.joint_events)),
        ("sampled", ", ".join(f"{e.name} every {e.period:g} s" for e, _ in c.sampled)),
        ("parameters", ", ".join(system.parameters) or "none"),
        ("coordinates", _coordinates(c, joints or JointSpace(c, elements), joints is not None)),
        ("sizes", _sizes(c)),
        ("M", _mass_structure(system.M, system.block_sizes)),
        ("left out", f"{dropped} of {c.n_declared_rows} rows of Phi vanish by structure" if dropped else ""),
        *(("left out", f"{x} moves uniformly, because no element acts on it") for x, *_ in c.decoupled),
        ("left out", "; ".join(_left_out(c, system.Phi_t, system.power)) or "nothing"),
    ]
    return "System\n" + "\n".join(f"  {label:<12} {text}" for label, text in parts if text)


def _sizes(c: Collected) -> str:
    opened = sum(at.stop - at.start for name, at in c.rows.items() if not c.gated.get(name, True))
    freedom = c.v.numel() - len(c.row_names) + opened
    return (
        f"n_q = {c.q.numel()}, n_v = {c.v.numel()}, n_c = {c.Phi.numel()}"
        + (f", {c.Psi.numel()} velocity-only rows" if c.Psi.numel() else "")
        + (f", {len(c.states)} first-order states" if c.states else "")
        + f"; {freedom} degree{'' if freedom == 1 else 's'} of freedom if the rows are independent"
    )


def _coordinates(c: Collected, joints: JointSpace, in_joints: bool) -> str:
    if c.gated:
        return "of the bodies, since joints open or close"
    if not joints.names:
        return "of the bodies (no joint carries a body)"
    if in_joints:
        return f"of the joints {', '.join(joints.names)}"
    return f"of the bodies; joint_space() has n_v = {joints.n_v}, n_c = {len(joints.rows)}"


def _count(kinds: list[str]) -> str:
    return ", ".join(f"{n} {kind}" for kind, n in Counter(kinds).items()) or "none"


def _mass_structure(M: ca.SX, block_sizes: Sequence[int]) -> str:
    if not M.numel():
        return "none"
    kinds = {record.kind for s in ca.symvar(M) if (record := lookup(s)) is not None}
    varies = Kind.COORDINATE in kinds or any(is_time(s) for s in ca.symvar(M))
    what = "varies along the motion" if varies else "constant along the motion"
    if M.sparsity().is_subset(ca.Sparsity.diag(M.shape[0])):
        massless = any(is_zero(ca.diag(M)[i]) for i in range(M.shape[0]))
        return f"{what}, diagonal" + (", singular: the full matrix is solved" if massless else ": reciprocals")
    return f"{what}, blocks of {sorted(set(np.asarray(block_sizes).tolist()))}"


def _left_out(c: Collected, Phi_t: ca.SX, power: ca.SX) -> list[str]:
    out = []
    if c.q.numel() == c.v.numel():
        out.append("quaternions and N (no body turns freely in space)")
    if not c.row_names:
        out.append("Phi, gamma and multipliers (no constraint)")
    if is_zero(Phi_t):
        out.append("Phi_t and Phi_tt (no drive)")
    if not c.Psi.numel():
        out.append("Psi (no velocity-only row)")
    if not c.states:
        out.append("s (no first-order state)")
    if is_zero(power):
        out.append("work (all forces have a potential)")
    return out
