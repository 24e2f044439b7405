"""What a system has and what fell away, in words."""

from collections import Counter
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from symmb.mechanics.body import Body
from symmb.mechanics.constraint import Constraint
from symmb.mechanics.force import ForceElement
from symmb.mechanics.pose import Spatial
from symmb.symbolic.geometry import is_zero
from symmb.symbolic.symbols import Kind, is_time, lookup

if TYPE_CHECKING:
    from symmb.system import System


def describe(system: "System") -> str:
    """A few lines: bodies, sizes, the structure of M, and what the scene does without."""
    c = system.collected
    constraints = [e for e in system.elements if isinstance(e, Constraint)]
    forces = [e for e in system.elements if isinstance(e, ForceElement)]
    dropped = c.written - c.Phi.numel()
    lines = [
        f"bodies       {_count([_kind(b) for b in c.bodies])}",
        f"constraints  {_count([type(e).__name__ for e in constraints])}",
        f"forces       {_count([type(e).__name__ for e in forces])}",
        *([f"impacts      {', '.join(name for name, *_ in c.impacts)}"] if c.impacts else []),
        f"parameters   {', '.join(system.parameters) or 'none'}",
        f"sizes        n_q = {c.q.numel()}, n_v = {c.v.numel()}, n_c = {c.Phi.numel()}"
        + (f", {c.Psi.numel()} velocity-only rows" if c.Psi.numel() else "")
        + (f", {len(c.states)} first-order states" if c.states else "")
        + f"; {c.v.numel() - len(c.row_names)} degrees of freedom if the rows are independent",
        f"M            {_mass_structure(system)}",
    ]
    if dropped:
        lines.append(f"fell away    {dropped} of {c.written} rows of Phi vanish by structure")
    lines += [f"fell away    {x} moves uniformly, nothing touches it" for x, *_ in c.drifting]
    lines.append(f"left out     {'; '.join(_left_out(system)) or 'nothing'}")
    return "System\n" + "\n".join("  " + line for line in lines)


def _kind(body: Body) -> str:
    return ("flexible " if body.pose.modes else "") + type(body.pose).__name__.lower()


def _count(kinds: list[str]) -> str:
    return ", ".join(f"{n} {kind}" for kind, n in Counter(kinds).items()) or "none"


def _mass_structure(system: "System") -> str:
    if not system.v.numel():
        return "none"
    kinds = {record.kind for s in ca.symvar(system.M) if (record := lookup(s)) is not None}
    varies = Kind.COORDINATE in kinds or any(is_time(s) for s in ca.symvar(system.M))
    what = "varies along the motion" if varies else "constant along the motion"
    if system.M.sparsity().is_subset(ca.Sparsity.diag(system.v.numel())):
        massless = any(is_zero(ca.diag(system.M)[i]) for i in range(system.v.numel()))
        return f"{what}, diagonal" + (", singular: the full matrix is solved" if massless else ": reciprocals")
    return f"{what}, blocks of {sorted(set(np.asarray(system.block_sizes).tolist()))}"


def _left_out(system: "System") -> list[str]:
    c = system.collected
    out = []
    if not any(isinstance(b.pose, Spatial) for b in c.bodies):
        out.append("quaternions and N (no spatial body)")
    if not c.row_names:
        out.append("Phi, gamma and multipliers (no constraint)")
    if is_zero(system.Phi_t):
        out.append("Phi_t and Phi_tt (no drive)")
    if not c.Psi.numel():
        out.append("Psi (no velocity-only row)")
    if not c.states:
        out.append("s (no first-order state)")
    if is_zero(system.power):
        out.append("work (all forces have a potential)")
    return out
