"""Gathers what was declared into M, Q, Phi and Psi, and reports all faults of the declaration at once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array
from symmb.binding import Binding
from symmb.mechanics.body import Body, Ground, as_matrix, inertia_matrix
from symmb.mechanics.constraint import Constraint
from symmb.mechanics.element import Element
from symmb.mechanics.force import Action, ForceElement, Load
from symmb.mechanics.parameter import Parameters
from symmb.mechanics.pose import Particle
from symmb.symbolic.geometry import is_zero
from symmb.symbolic.symbols import Symbol


@dataclass(frozen=True, eq=False)
class Collected:
    """A valid declaration in equations: see `System` for the notation."""

    bodies: tuple[Body, ...]
    bind: Binding
    q: ca.SX
    v: ca.SX
    qdot: ca.SX
    q_names: tuple[str, ...]
    v_names: tuple[str, ...]
    block_sizes: tuple[int, ...]
    states: tuple[Symbol, ...]
    M: ca.SX
    Q: ca.SX
    Q_work: ca.SX  # the share of Q without potential, whose power is counted
    potential: ca.SX
    Phi: ca.SX
    Psi: ca.SX
    rows: dict[str, slice]
    row_names: tuple[str, ...]
    upright: ca.SX
    drifting: tuple[tuple[str, ca.SX, str, ca.SX], ...]  # coordinates that nothing touches: name, x, name, vx
    written: int  # rows written by the joints, those that vanish included

    def with_states(self, states: Sequence[Symbol]) -> "Collected":
        """A copy that also integrates the given first-order states."""
        return replace(self, states=(*self.states, *states))


def collect(elements: Sequence[Body | Element], parameters: Parameters) -> Collected:
    """Validate the declaration and write its equations.

    Raises
    ------
    DeclarationError       with one line for each fault
    """
    faults = [*_names(elements), *_membership(elements)]
    for element in elements:
        if isinstance(element, Element):
            faults.extend(element.faults())
    bodies = tuple(e for e in elements if isinstance(e, Body))
    bind = Binding(parameters, bodies)

    def attempt(fn: Callable[[], object]) -> object:
        try:
            return fn()
        except DeclarationError as error:
            faults.extend(str(error).split("\n"))
            return None

    inertial = [(b, attempt(lambda b=b: _inertial(b, bind, parameters))) for b in bodies]
    if faults:
        raise DeclarationError("\n".join(faults))
    masses = [(b, mass_and_inertia[0]) for b, mass_and_inertia in inertial]
    constraints = [e for e in elements if isinstance(e, Constraint)]
    forces = [e for e in elements if isinstance(e, ForceElement)]
    actions = {f.title: attempt(lambda f=f: tuple(f.actions(bind, masses))) for f in forces}
    written = {c.name: attempt(lambda c=c: c.position_rows(bind)) for c in constraints}
    positions = {c.name: attempt(lambda c=c: _rows(c, written[c.name], bind)) for c in constraints}
    velocities = {c.name: attempt(lambda c=c: _velocity_rows(c, bind)) for c in constraints}
    for title, acts in actions.items():
        for action in acts or ():
            faults.extend(_plane(title, action))
    if faults:
        raise DeclarationError("\n".join(dict.fromkeys(faults)))

    Q_work, Q_potential, potential = _forces(bodies, inertial, actions)
    Phi = [row for rows in positions.values() for row in rows]
    Psi = [row for rows in velocities.values() for row in rows]
    draft = Collected(
        bodies=bodies,
        bind=bind,
        q=_vertcat([b.frame.q for b in bodies]),
        v=_vertcat([b.frame.v for b in bodies]),
        qdot=_vertcat([b.frame.rate for b in bodies]),
        q_names=tuple(f"{b.name}.{c}" for b in bodies for c in b.pose.coordinates),
        v_names=tuple(f"{b.name}.{c}" for b in bodies for c in b.pose.velocities),
        block_sizes=tuple(b.frame.v.numel() for b in bodies),
        states=bind.states(_vertcat([Q_work, Q_potential, *Phi, *Psi])),
        M=ca.diagcat(*[_mass_block(b, mi) for b, mi in inertial]) if bodies else ca.SX(0, 0),
        Q=Q_work + Q_potential,
        Q_work=Q_work,
        potential=potential,
        Phi=_vertcat(Phi),
        Psi=_vertcat(Psi),
        rows=_row_slices(positions, velocities),
        row_names=_row_names(positions) + _row_names(velocities),
        upright=_vertcat([c.upright() for c in constraints]),
        drifting=(),
        written=sum(rows.numel() for rows in written.values()),
    )
    return _without_untouched(draft)


def _vertcat(parts: Sequence[ca.SX]) -> ca.SX:
    return ca.densify(ca.vertcat(*parts)) if parts else ca.SX(0, 1)


def _names(elements: Sequence[object]) -> list[str]:
    faults, seen = [], set()
    for e in elements:
        if not isinstance(e, Body | Element):
            faults.append(f"System: {e!r} is neither a body, a constraint nor a force. Name parameters as parameters=p.")
            continue
        if not isinstance(e.name, str) or not e.name or any(c in e.name for c in ".[] "):
            faults.append(f"{type(e).__name__} {e.name!r}: a name is a text without dots, brackets and spaces.")
        elif e.name in seen:
            faults.append(f"{type(e).__name__} {e.name!r}: the name is used twice. Choose another.")
        seen.add(e.name)
    return faults


def _membership(elements: Sequence[object]) -> list[str]:
    known = {id(e) for e in elements if isinstance(e, Body)}
    faults = []
    for e in elements:
        if not isinstance(e, Element):
            continue
        try:
            attached = e.bodies()
        except AttributeError:  # a wrong kind of point, which the element's own faults tell
            continue
        for body in attached:
            if isinstance(body, Body) and id(body) not in known:
                faults.append(f"{e.title}: body {body.name!r} is not part of the System. Add it to System(...).")
    return faults


def _inertial(body: Body, bind: Binding, parameters: Parameters) -> tuple[ca.SX, ca.SX]:
    faults = []
    mass = bind(body.mass, f"Body {body.name!r}: mass")
    if mass.numel() != 1:
        raise DeclarationError(f"Body {body.name!r}: mass has {mass.numel()} components; expected one number or expression.")
    J = inertia_matrix(body, as_matrix(body.inertia, f"Body {body.name!r}: inertia", bind))
    for what, value in (("mass", mass), ("inertia", ca.diag(J))):
        nominal = _nominal(value, parameters)
        if nominal is not None and np.any(nominal < 0):
            faults.append(f"Body {body.name!r}: {what} is negative at the nominal parameters. It must not be below 0.")
        elif nominal is not None and any(n == 0 and not is_zero(value[i]) for i, n in enumerate(nominal)):
            faults.append(
                f"Body {body.name!r}: {what} vanishes at the nominal parameters, not as declared. "
                "Write 0 for a massless body, so that its equations are solved without dividing by it."
            )
    skew = _nominal(ca.vec(J - J.T), parameters)
    if skew is not None and np.abs(skew).max() > 0:
        faults.append(f"Body {body.name!r}: inertia matrix is not symmetric.")
    v_like = [s for s in ca.symvar(ca.vertcat(mass, ca.vec(J))) if bind.is_velocity(s)]
    if v_like:
        faults.append(f"Body {body.name!r}: mass and inertia must not depend on velocities ({v_like[0].name()}).")
    if faults:
        raise DeclarationError("\n".join(faults))
    return mass, J


def _nominal(value: ca.SX, parameters: Parameters) -> Array | None:
    """Numbers at the nominal parameters; None if coordinates or time stand in the expression."""
    f = ca.Function("f", [parameters.symbols], [ca.densify(value)], {"allow_free": True})
    return None if f.has_free() else np.asarray(f(parameters.nominal)).ravel()


def _mass_block(body: Body, mass_and_inertia: tuple[ca.SX, ca.SX]) -> ca.SX:
    mass, J = mass_and_inertia
    S = body.frame.S
    return ca.sparsify(S.T @ ca.diagcat(mass, mass, mass, J) @ S)


def _rows(constraint: Constraint, rows: ca.SX | None, bind: Binding) -> list[ca.SX]:
    """The rows that do not vanish; each must depend on a coordinate."""
    if rows is None:  # its fault is told already
        return []
    kept = [rows[i] for i in range(rows.numel()) if not is_zero(rows[i])]
    faults = []
    for row in kept:
        bind.check(row, constraint.title)
        if not any(bind.is_coordinate(s) for s in ca.symvar(row)):
            faults.append(f"{constraint.title}: no coordinate can meet the row {row} = 0. Check points, axis and law.")
        if any(bind.is_velocity(s) for s in ca.symvar(row)):
            faults.append(f"{constraint.title}: a position row must not contain velocities. Use VelocityConstraint.")
    if rows.numel() and not kept:
        faults.append(f"{constraint.title}: all its rows vanish, nothing is left to constrain. Leave it out.")
    if faults:
        raise DeclarationError("\n".join(faults))
    return kept


def _velocity_rows(constraint: Constraint, bind: Binding) -> list[ca.SX]:
    rows = constraint.velocity_rows(bind)
    kept = [rows[i] for i in range(rows.numel()) if not is_zero(rows[i])]
    for row in kept:
        bind.check(row, constraint.title)
        velocities = [s for s in ca.symvar(row) if bind.is_velocity(s)]
        linear = ca.jacobian(row, ca.vertcat(*velocities)) if velocities else None
        if linear is None or any(bind.is_velocity(s) for s in ca.symvar(linear)):
            raise DeclarationError(f"{constraint.title}: expressions must be linear in the velocities, and contain some.")
    return kept


def _plane(title: str, action: Action) -> list[str]:
    faults = []
    for load in action.loads:
        wrench = ca.vertcat(load.force, load.torque)
        S = np.asarray(ca.DM(load.body.frame.S))
        if isinstance(load.body, Ground) or isinstance(load.body.pose, Particle):
            continue
        outside = [i for i in range(6) if not S[i].any() and not is_zero(wrench[i])]
        if outside:
            what = ("force along x", "force along y", "force along z", "torque about x", "torque about y", "torque about z")
            faults.append(
                f"{title}: {what[outside[0]]}{_shown(wrench[outside[0]])} leaves the plane of planar body "
                f"{load.body.name!r}. Leave it out or use pose=Spatial()."
            )
    return faults


def _shown(value: ca.SX) -> str:
    """A value in brackets, unless it is too long to help."""
    text = str(value)
    return f" ({text})" if len(text) <= 40 else ""


def _forces(bodies, inertial, actions) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Generalised forces without and with potential, gyroscopic terms among the latter, and the potential."""
    zero = {id(b): ca.SX(b.frame.v.numel(), 1) for b in bodies}
    work, conservative = dict(zero), dict(zero)
    potential = ca.SX(0)

    def add(share: dict[int, ca.SX], load: Load) -> None:
        if not isinstance(load.body, Ground):
            share[id(load.body)] += load.body.frame.S.T @ ca.vertcat(load.force, load.torque)

    for acts in actions.values():
        for action in acts:
            for load in action.loads:
                add(work if action.potential is None else conservative, load)
            if action.potential is not None:
                potential += action.potential
    for body, (_, J) in inertial:
        omega = body.frame.omega
        add(conservative, Load(body, ca.SX(3, 1), -ca.cross(omega, J @ omega)))
    return _vertcat([work[id(b)] for b in bodies]), _vertcat([conservative[id(b)] for b in bodies]), potential


def _row_slices(*kinds: dict[str, list[ca.SX]]) -> dict[str, slice]:
    slices, at = {}, 0
    for rows in kinds:
        for name, kept in rows.items():
            if kept:
                slices[name] = slice(at, at + len(kept))
            at += len(kept)
    return slices


def _row_names(rows: dict[str, list[ca.SX]]) -> tuple[str, ...]:
    return tuple(f"{name}.lam[{i}]" for name, kept in rows.items() for i in range(len(kept)))


def _without_untouched(c: Collected) -> Collected:
    """Leave out the particle coordinates that no force, no constraint and no other equation touches."""
    n = c.q.numel()
    if not any(isinstance(b.pose, Particle) for b in c.bodies):
        return c
    equations = ca.vertcat(c.Phi, c.Psi, c.Q, *[ca.vec(c.M)], c.potential, *[s.rate for s in c.states])
    depends = np.asarray(ca.DM(ca.jacobian_sparsity(equations, ca.vertcat(c.q, c.v)), 1)).any(axis=0)
    drop, q_at, v_at = [], 0, 0
    for body in c.bodies:
        if isinstance(body.pose, Particle):
            for k in range(3):
                if not depends[q_at + k] and not depends[n + v_at + k] and is_zero(c.Q[v_at + k]):
                    drop.append((q_at + k, v_at + k))
        q_at += body.frame.q.numel()
        v_at += body.frame.v.numel()
    q_keep = [i for i in range(n) if i not in {d[0] for d in drop}]
    v_drop = {d[1] for d in drop}
    v_keep = [i for i in range(c.v.numel()) if i not in v_drop]
    sizes, at = [], 0
    for size in c.block_sizes:
        sizes.append(sum(i not in v_drop for i in range(at, at + size)))
        at += size
    return replace(
        c,
        q=c.q[q_keep],
        v=c.v[v_keep],
        qdot=c.qdot[q_keep],
        q_names=tuple(c.q_names[i] for i in q_keep),
        v_names=tuple(c.v_names[i] for i in v_keep),
        block_sizes=tuple(sizes),
        M=c.M[v_keep, v_keep],
        Q=c.Q[v_keep],
        Q_work=c.Q_work[v_keep],
        drifting=tuple((c.q_names[i], c.q[i], c.v_names[j], c.v[j]) for i, j in drop),
    )

