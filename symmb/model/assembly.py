"""Collects the declared elements into M, Q, Phi and Psi, and reports all faults of the declaration at once."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb.mechanics import (
    Action,
    Body,
    Constraint,
    Element,
    ForceElement,
    Ground,
    Impact,
    Inertial,
    Load,
    OwnState,
    Parameters,
    Particle,
    Sampled,
    Spatial,
    Stop,
)
from symmb.model.binding import Binding
from symmb.model.positive import Inertia, positive
from symmb.model.validation import (
    held_faults,
    impact_law,
    mass_and_inertia,
    membership_faults,
    name_faults,
    plane_faults,
    position_rows,
    velocity_rows,
)
from symmb.symbolic import Symbol, TruthValueError, is_zero, t

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Collected:
    """The equations of a valid declaration. `System` explains the notation."""

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
    M_flow: ca.SX  # the part of M that changes because mass joins or leaves
    Q: ca.SX
    Q_work: ca.SX  # the part of Q without potential, whose power is integrated
    potential: ca.SX
    Phi: ca.SX
    Psi: ca.SX
    rows: dict[str, slice]
    row_names: tuple[str, ...]
    sampled: tuple[tuple[Sampled, ca.SX], ...]  # with their laws
    impacts: tuple[tuple[str, ca.SX, ca.SX], ...]  # name, gap, restitution
    assembly_cosines: ca.SX
    positive: tuple[tuple[str, ca.SX], ...]  # expressions that must be above 0 for all parameters, with their names
    loads: tuple[Load, ...]
    decoupled: tuple[tuple[str, ca.SX, str, ca.SX], ...]  # coordinates without force and constraint: name, x, name, vx
    n_declared_rows: int  # rows that the joints declare, with those that are zero

    def keeping(self, numbers: Sequence[int]) -> "Collected":
        """A copy with some rows only, given by their numbers in rising order."""
        n_c = self.Phi.numel()
        owners = [next(name for name, where in self.rows.items() if where.start <= i < where.stop) for i in numbers]
        first = {name: owners.index(name) for name in dict.fromkeys(owners)}
        return replace(
            self,
            Phi=self.Phi[[i for i in numbers if i < n_c], :],
            Psi=self.Psi[[i - n_c for i in numbers if i >= n_c], :],
            rows={name: slice(at, at + owners.count(name)) for name, at in first.items()},
            row_names=tuple(self.row_names[i] for i in numbers),
        )

    @property
    def power(self) -> ca.SX:
        """Power of forces without potential, and of mass that joins or leaves [W]."""
        M = self.M_flow
        moving = ca.vertcat(self.q, t, *[state.sx for state in self.states])
        M_dot = ca.jtimes(M, moving, ca.vertcat(self.qdot, 1, *[state.rate for state in self.states]))
        return ca.dot(self.v, self.Q_work) + 0.5 * ca.dot(self.v, M_dot @ self.v)

    def retract(self, delta: ca.SX) -> ca.SX:
        """The retraction of all bodies. It leaves out the coordinates that their particles do not have."""
        out, at_q, at_v = [], 0, 0
        for body, n_v in zip(self.bodies, self.block_sizes, strict=True):
            n_q = n_v + isinstance(body.pose, Spatial)
            out.append(body.pose.retract(self.q[at_q : at_q + n_q], delta[at_v : at_v + n_v]))
            at_q, at_v = at_q + n_q, at_v + n_v
        return ca.vertcat(*out) if out else ca.SX(0, 1)

    def with_states(self, states: Sequence[Symbol]) -> "Collected":
        """A copy with additional first-order states."""
        return replace(self, states=(*self.states, *states))


def collect(elements: Sequence[Body | Element], parameters: Parameters) -> Collected:
    """Validate the declaration and derive its equations.

    Raises
    ------
    DeclarationError       with one line for each fault
    """
    faults, sound = _Faults(name_faults(elements, parameters)), []
    bodies = tuple(e for e in elements if isinstance(e, Body))
    known = {id(element) for element in elements}
    for element in elements:
        if isinstance(element, Element):
            own = [*membership_faults(element, known), *element.faults()]
            sound += [] if own or not isinstance(element.name, str) else [element]
        else:
            own = getattr(element, "faults", ())
        faults.lines += own
    bind = Binding(parameters, bodies, [e for e in sound if isinstance(e, OwnState)])
    some = ca.SX(1), ca.SX.eye(3)  # with which the other laws are checked
    inertial = [(b, faults.attempt(lambda b=b: mass_and_inertia(b, bind, parameters), some)) for b in bodies]
    equations = _write_equations(sound, inertial, bind, parameters, faults)
    faults.raise_any()
    return _without_untouched(_assemble(inertial, bind, equations))


class _Faults:
    """The faults of a declaration as lines of text."""

    def __init__(self, lines: list[str]) -> None:
        self.lines = lines

    def attempt(self, f: Callable[[], T], otherwise: T, what: str = "A law") -> T:
        """The result of f, or a substitute where f raises a fault of the declaration."""
        try:
            return f()
        except TruthValueError as error:
            self.lines.append(f"{what}: {error}")
        except DeclarationError as error:
            self.lines += str(error).split("\n")
        return otherwise

    def raise_any(self) -> None:
        """Raise a DeclarationError that names every fault once."""
        if self.lines:
            raise DeclarationError("\n".join(dict.fromkeys(self.lines)))


@dataclass(frozen=True, eq=False)
class _Equations:
    """Contributions of the elements: actions by title, rows by name of the constraint, laws of impacts by name."""

    constraints: list[Constraint]
    impacts: list[Impact]
    states: list[OwnState]
    sampled: list[tuple[Sampled, ca.SX]]
    actions: dict[str, tuple[Action, ...]]
    positions: dict[str, list[ca.SX]]
    velocities: dict[str, list[ca.SX]]
    laws: dict[str, tuple[ca.SX, ca.SX]]
    n_declared_rows: int


def _write_equations(
    elements: Sequence[Body | Element],
    inertial: Sequence[Inertia],
    bind: Binding,
    parameters: Parameters,
    faults: _Faults,
) -> _Equations:
    attempt, nothing = faults.attempt, ca.SX(0, 1)
    masses = [(b, mass) for b, (mass, _) in inertial]
    constraints = [e for e in elements if isinstance(e, Constraint)]
    forces = [e for e in elements if isinstance(e, ForceElement)]
    impacts = [e for e in elements if isinstance(e, Impact)]
    stops = [e for e in elements if isinstance(e, Stop)]
    impacts += [impact for stop in stops for impact in attempt(lambda stop=stop: stop.impacts(bind), ())]
    states = [e for e in elements if isinstance(e, OwnState)]
    for state in states:
        attempt(lambda s=state: bind.check(s.symbols[0].rate, f"{s.title}: rate"), None)
    held = [e for e in states if isinstance(e, Sampled)]
    sampled = [(e, attempt(lambda e=e: bind(e.law, f"{e.title}: law"), ca.SX(0))) for e in held]
    actions = {f.title: attempt(lambda f=f: tuple(f.actions(bind, masses)), (), f.title) for f in forces}
    declared = {c.name: attempt(lambda c=c: c.position_rows(bind), nothing) for c in constraints}
    equations = _Equations(
        constraints=constraints,
        impacts=impacts,
        states=states,
        sampled=sampled,
        actions=actions,
        positions={c.name: attempt(lambda c=c: position_rows(c, declared[c.name], bind), []) for c in constraints},
        velocities={c.name: attempt(lambda c=c: velocity_rows(c, bind), []) for c in constraints},
        laws={e.name: attempt(lambda e=e: impact_law(e, bind, parameters), (nothing, nothing)) for e in impacts},
        n_declared_rows=sum(rows.numel() for rows in declared.values()),
    )
    faults.lines += [line for e in held for line in held_faults(e, equations.positions, equations.velocities)]
    faults.lines += [line for title, some in actions.items() for action in some for line in plane_faults(title, action)]
    return equations


def _assemble(inertial: Sequence[Inertia], bind: Binding, equations: _Equations) -> Collected:
    bodies = tuple(body for body, _ in inertial)
    shares = [body.inertial(*values) for body, values in inertial]
    Q_work, Q_potential, potential = _forces(bodies, shares, equations.actions)
    Phi = [row for rows in equations.positions.values() for row in rows]
    Psi = [row for rows in equations.velocities.values() for row in rows]
    gaps = [gap for gap, _ in equations.laws.values()]
    M = _diagcat([share.M for share in shares])
    return Collected(
        bodies=bodies,
        bind=bind,
        q=_vertcat([b.frame.q for b in bodies]),
        v=_vertcat([b.frame.v for b in bodies]),
        qdot=_vertcat([b.frame.rate for b in bodies]),
        q_names=tuple(f"{b.name}.{c}" for b in bodies for c in b.pose.coordinates),
        v_names=tuple(f"{b.name}.{c}" for b in bodies for c in b.pose.velocities),
        block_sizes=tuple(b.frame.v.numel() for b in bodies),
        states=_states(bind, [ca.vec(M), Q_work, Q_potential, *Phi, *Psi, *gaps], equations),
        sampled=tuple(equations.sampled),
        M=M,
        M_flow=_diagcat([share.M if share.flows else ca.SX(*share.M.shape) for share in shares]),
        Q=Q_work + Q_potential,
        Q_work=Q_work,
        potential=potential,
        Phi=_vertcat(Phi),
        Psi=_vertcat(Psi),
        rows=_row_slices(equations.positions, equations.velocities),
        row_names=_row_names(equations.positions) + _row_names(equations.velocities),
        impacts=tuple((name, *law) for name, law in equations.laws.items()),
        assembly_cosines=_vertcat([c.assembly_cosines() for c in equations.constraints]),
        positive=tuple(positive(inertial, equations.constraints, bind)),
        loads=tuple(load for acts in equations.actions.values() for action in acts for load in action.loads),
        decoupled=(),
        n_declared_rows=equations.n_declared_rows,
    )


def _states(bind: Binding, expressions: Sequence[ca.SX], equations: _Equations) -> tuple[Symbol, ...]:
    """The declared states, those in expressions and in rates of others, and whether contacts are closed."""
    declared = [symbol for state in equations.states for symbol in state.symbols]
    laws = [law for _, law in equations.sampled]
    states = dict.fromkeys([*declared, *bind.states(ca.vertcat(*expressions, *laws))])
    for state in (reached := [*states]):  # which grows
        reached += [s for s in dict.fromkeys(bind.states(state.rate)) if s not in reached]
    return tuple(dict.fromkeys([*reached, *(impact.state for impact in equations.impacts)]))


def _vertcat(parts: Sequence[ca.SX]) -> ca.SX:
    return ca.densify(ca.vertcat(*parts)) if parts else ca.SX(0, 1)


def _diagcat(blocks: Sequence[ca.SX]) -> ca.SX:
    return ca.diagcat(*blocks) if blocks else ca.SX(0, 0)


def _forces(
    bodies: Sequence[Body], shares: Sequence[Inertial], actions: Mapping[str, Sequence[Action]]
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Generalised forces without and with potential, and the potential. Gyroscopic terms belong to the latter."""
    zero = {id(b): ca.SX(b.frame.v.numel(), 1) for b in bodies}
    work, conservative = dict(zero), dict(zero)
    potential = ca.SX(0)

    def add(share: dict[int, ca.SX], load: Load) -> None:
        if not isinstance(load.body, Ground):
            share[id(load.body.owner)] += load.body.frame.S.T @ ca.vertcat(load.force, load.torque)

    for acts in actions.values():
        for action in acts:
            for load in action.loads:
                add(work if action.potential is None else conservative, load)
            if action.potential is not None:
                potential += action.potential
    for body, share in zip(bodies, shares, strict=True):
        conservative[id(body)] += share.Q
        if share.Q_work is not None:
            work[id(body)] += share.Q_work
        if share.potential is not None:
            potential += share.potential
    return _vertcat([work[id(b)] for b in bodies]), _vertcat([conservative[id(b)] for b in bodies]), potential


def _row_slices(*kinds: dict[str, list[ca.SX]]) -> dict[str, slice]:
    slices, at = {}, 0
    for rows in kinds:
        for name, own in rows.items():
            if own:
                slices[name] = slice(at, at + len(own))
            at += len(own)
    return slices


def _row_names(rows: dict[str, list[ca.SX]]) -> tuple[str, ...]:
    return tuple(f"{name}.lam[{i}]" for name, own in rows.items() for i in range(len(own)))


def _without_untouched(c: Collected) -> Collected:
    """Leave out the particle coordinates that no force, no constraint and no other equation contains."""
    n = c.q.numel()
    if not any(isinstance(b.pose, Particle) for b in c.bodies):
        return c
    gaps = [gap for _, gap, _ in c.impacts]
    laws = [*(s.rate for s in c.states), *(law for _, law in c.sampled)]
    equations = ca.vertcat(c.Phi, c.Psi, c.Q, ca.vec(c.M), c.potential, *laws, *gaps)
    pattern = ca.DM(ca.jacobian_sparsity(equations, ca.vertcat(c.q, c.v)), 1).full()
    depends: list[bool] = np.any(pattern, axis=0).tolist()
    drop, q_at, v_at = [], 0, 0
    for body in c.bodies:
        if isinstance(body.pose, Particle):
            free = [k for k in range(3) if not (depends[q_at + k] or depends[n + v_at + k])]
            free = [k for k in free if is_zero(c.Q[v_at + k])]
            if len(free) < 3 or not is_zero(c.M[v_at, v_at]):  # else nothing determines how the body moves
                drop += [(q_at + k, v_at + k) for k in free]
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
        M_flow=c.M_flow[v_keep, v_keep],
        Q=c.Q[v_keep],
        Q_work=c.Q_work[v_keep],
        decoupled=tuple((c.q_names[i], c.q[i], c.v_names[j], c.v[j]) for i, j in drop),
    )
