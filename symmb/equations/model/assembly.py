"""Collects the declared elements into M, Q, Phi and Psi, and reports all faults of the declaration at once."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import Any, NamedTuple, TypeVar

import casadi as ca
import numpy as np

from symmb.declare.mechanics import (
    Action,
    Body,
    Constraint,
    Element,
    ForceElement,
    Ground,
    Impact,
    Inertial,
    Input,
    Joint,
    JointEvent,
    Latch,
    Load,
    OwnState,
    Parameters,
    Particle,
    Sampled,
    Spatial,
    closed_at_start,
    row_gates,
)
from symmb.declare.symbolic import Symbol, is_zero, t
from symmb.equations.model.binding import Binding
from symmb.equations.model.validation import (
    ElementFaults,
    Inertia,
    event_margin,
    held_faults,
    impact_law,
    mass_and_inertia,
    membership_faults,
    name_faults,
    plane_faults,
    position_rows,
    positive,
    velocity_rows,
)

T = TypeVar("T")


class Coordinates(NamedTuple):
    """Coordinates q, velocities v, rates q' and the names of q and v of a part of the system."""

    q: ca.SX
    v: ca.SX
    qdot: ca.SX
    q_names: tuple[str, ...]
    v_names: tuple[str, ...]

    @classmethod
    def of_body(cls, body: Body) -> "Coordinates":
        """The coordinates of a body, with their full names."""
        pose, frame = body.pose, body.frame
        names = (tuple(f"{body.name}.{x}" for x in of) for of in (pose.coordinates, pose.velocities))
        return cls(frame.q, frame.v, frame.rate, *names)

    @classmethod
    def joined(cls, parts: Sequence["Coordinates"]) -> dict[str, Any]:
        """The coordinates of several parts together, as a dictionary with the names of the attributes."""
        columns: dict[str, list[Any]] = {name: [getattr(part, name) for part in parts] for name in cls._fields}
        names = {name: tuple(chain.from_iterable(columns.pop(name))) for name in ("q_names", "v_names")}
        return {name: stacked(column) for name, column in columns.items()} | names


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
    units: ca.SX  # (n_r,), units that make force and moment multipliers comparable: 1, or an arm [m]
    sampled: tuple[tuple[Sampled, ca.SX], ...]  # each with its law
    impacts: tuple[tuple[str, ca.SX, ca.SX], ...]  # name, gap, restitution
    joint_events: tuple[tuple[JointEvent, ca.SX], ...]  # each with its margin, negative if the condition holds
    assembly_cosines: ca.SX
    positive: tuple[tuple[str, ca.SX], ...]  # expressions that must be above 0 for all parameters, with their names
    loads: tuple[Load, ...]
    forces: dict[str, ca.SX | None]  # force laws of elements; None if not a scalar
    decoupled: tuple[tuple[str, ca.SX, str, ca.SX], ...]  # coordinates on which no element acts: name, x, name, vx
    n_declared_rows: int  # number of rows of all joints, including zero rows

    def keeping(self, numbers: Sequence[int]) -> "Collected":
        """A copy with only the rows whose indices are in `numbers`, in ascending order."""
        n_c = self.Phi.numel()
        owners = [next(name for name, where in self.rows.items() if where.start <= i < where.stop) for i in numbers]
        return replace(
            self,
            Phi=self.Phi[[i for i in numbers if i < n_c], :],
            Psi=self.Psi[[i - n_c for i in numbers if i >= n_c], :],
            rows=_row_slices(owners),
            row_names=tuple(self.row_names[i] for i in numbers),
            units=self.units[list(numbers)],
        )

    @property
    def has_events(self) -> bool:
        """Whether there are impacts, or joints that open and close."""
        return bool(self.impacts or self.joint_events)

    @property
    def gated(self) -> dict[str, bool]:
        """Joints that open and close. The value is True for joints that are closed at the start."""
        return closed_at_start(event for event, _ in self.joint_events)

    @property
    def gates(self) -> ca.SX | None:
        """Factors of the rows (n_r,): 0 for rows of open joints and 1 for other rows. None if no joint opens."""
        by_name = row_gates(event for event, _ in self.joint_events)
        sizes = {name: where.stop - where.start for name, where in self.rows.items()}
        gates = ca.vertcat(*[ca.repmat(by_name.get(name, ca.SX(1)), n, 1) for name, n in sizes.items()])
        return gates if by_name else None

    @property
    def power(self) -> ca.SX:
        """Power of forces without potential, and of added or removed mass [W]."""
        M = self.M_flow
        moving = ca.vertcat(self.q, t, *[state.sx for state in self.states])
        M_dot = ca.jtimes(M, moving, ca.vertcat(self.qdot, 1, *[state.rate for state in self.states]))
        return ca.dot(self.v, self.Q_work) + 0.5 * ca.dot(self.v, M_dot @ self.v)

    @cached_property
    def slices(self) -> list[tuple[slice, slice]]:
        """Slices of q and v of each body. Removed coordinates of particles are not counted."""
        slices, at_q, at_v = [], 0, 0
        for body, n_v in zip(self.bodies, self.block_sizes, strict=True):
            n_q = n_v + isinstance(body.pose, Spatial)
            slices.append((slice(at_q, at_q + n_q), slice(at_v, at_v + n_v)))
            at_q, at_v = at_q + n_q, at_v + n_v
        return slices

    def retract(self, delta: ca.SX) -> ca.SX:
        """Coordinates (n_q,) of all bodies after a small displacement delta (n_v,)."""
        own = zip(self.bodies, self.slices, strict=True)
        return ca.vertcat(ca.SX(0, 1), *[body.pose.retract(self.q[q], delta[v]) for body, (q, v) in own])


def collect(elements: Sequence[Body | Element], parameters: Parameters | None) -> Collected:
    """Validate the declaration and derive its equations. A DeclarationError has one line for each fault.

    If `parameters` is None, the system has the parameters with symbols in the elements.
    """
    collected = driven = _with_all_coordinates(elements, parameters)
    parameters = collected.bind.parameters
    inputs = [u.symbol for u in _of_kind(Input, elements) if u.name not in parameters]
    if inputs and any(isinstance(body.pose, Particle) for body in collected.bodies):
        # Inputs are 0 here. Coordinates that only inputs drive stay, because the equations with inputs need them.
        driven = _with_all_coordinates(elements, parameters.with_inputs(inputs))
    return _without(collected, _untouched(driven))


def _with_all_coordinates(elements: Sequence[Body | Element], given: Parameters | None) -> Collected:
    """The equations in all coordinates of particles, including coordinates that appear in no equation."""
    parameters = Parameters() if given is None else given
    faults, sound = ElementFaults(name_faults(elements, parameters)), []
    bodies = tuple(e for e in elements if isinstance(e, Body))
    known = {id(element) for element in elements}
    for element in elements:
        if isinstance(element, Element):
            own = [*membership_faults(element, known), *(element.place_faults() or element.faults())]
            sound += [] if own or not isinstance(element.name, str) else [element]
        else:
            own = getattr(element, "faults", ())
        faults += own
    bind = Binding(parameters, bodies, _of_kind(OwnState, sound), _of_kind(Input, sound))
    some = ca.SX(1), ca.SX.eye(3)  # a substitute, so that the other laws are checked too
    inertial = [(b, faults.attempt(some, mass_and_inertia, b, bind)) for b in bodies]
    equations = _write_equations(sound, inertial, bind, faults)
    # The parameters are only known after all laws were read, so everything is derived once more with these parameters.
    if given is None and bind.missing is not None:
        return _with_all_coordinates(elements, bind.missing)
    faults.raise_any()
    collected = _assemble(inertial, bind, equations)
    for name in bind.inputs_in([ca.vec(collected.M), collected.Q, collected.Phi, collected.Psi]):
        faults.append(f"Input {name!r}: a point, mass or shape depends on this input. Only laws may depend on inputs.")
    faults.raise_any()
    return collected


@dataclass(frozen=True, eq=False)
class _Equations:
    """Contributions of the elements: actions of forces, rows by name of the constraint, laws of impacts by name."""

    constraints: list[Constraint]
    impacts: list[Impact]
    joint_events: list[tuple[JointEvent, ca.SX]]
    states: list[OwnState]
    sampled: list[tuple[Sampled, ca.SX]]
    actions: dict[ForceElement, tuple[Action, ...]]
    positions: dict[str, list[ca.SX]]
    velocities: dict[str, list[ca.SX]]
    laws: dict[str, tuple[ca.SX, ca.SX]]
    n_declared_rows: int

    @property
    def forces(self) -> dict[str, ca.SX | None]:
        """The law of each force element, by name; for an element with several forces, the sum of their laws."""
        own = {f.name: [a.force for a in actions if a.force is not None] for f, actions in self.actions.items()}
        return {name: sum(forces[1:], forces[0]) if forces else None for name, forces in own.items()}


def _write_equations(
    elements: Sequence[Element], inertial: Sequence[Inertia], bind: Binding, faults: ElementFaults
) -> _Equations:
    """The laws of the elements. Faults are noted, and laws with a fault are left out."""
    attempt, nothing = faults.attempt, ca.SX(0, 1)
    masses = [(b, mass) for b, (mass, _) in inertial]
    constraints, forces = _of_kind(Constraint, elements), _of_kind(ForceElement, elements)
    impacts, states = _of_kind(Impact, elements), _of_kind(OwnState, elements)
    for force in forces:
        impacts += attempt((), force.impacts, bind)
    for state in states:
        attempt(None, state.settle)
        attempt(None, bind.check, state.symbols[0].rate, f"{state.title}: rate")
    settled = [e for e in _of_kind(Sampled, states) if not callable(e.law)]
    sampled = [(e, attempt(ca.SX(0), bind, e.law, f"{e.title}: law")) for e in settled]
    actions = {f: attempt((), lambda f: tuple(f.actions(bind, masses)), f, what=f.title) for f in forces}
    declared = faults.each(nothing, lambda c: c.position_rows(bind), constraints)
    of_forces = chain.from_iterable(attempt((), force.events, bind) for force in forces)
    events = [(e, ca.SX(1)) for e in (*_of_kind(JointEvent, elements), *of_forces)]
    equations = _Equations(
        constraints=constraints,
        impacts=impacts,
        joint_events=events,
        states=states,
        sampled=sampled,
        actions=actions,
        positions=faults.each([], lambda c: position_rows(c, declared[c.name], bind), constraints),
        velocities=faults.each([], velocity_rows, constraints, bind),
        laws=faults.each((nothing, nothing), impact_law, impacts, bind),
        n_declared_rows=sum(rows.numel() for rows in declared.values()),
    )
    for element, _ in sampled:
        faults += held_faults(element, equations.positions, equations.velocities)
    for force, own in actions.items():
        faults += chain.from_iterable(plane_faults(force.title, action) for action in own)
    # Margins of events may contain rows of joints, so margins are derived last, and only if no row has a fault.
    if events and not faults:
        _gate_rows(equations, bind)
        for k, (e, _) in enumerate(events):
            rows = [*equations.positions[e.joint.name], *equations.velocities[e.joint.name]]
            events[k] = e, attempt(ca.SX(1), event_margin, e, rows, bind, what=e.title)
    return equations


def _gate_rows(equations: _Equations, bind: Binding) -> None:
    """Rewrite the rows of joints that open or close. Rows of open joints are 0. A Latch keeps its pose."""
    for name in row_gates(event for event, _ in equations.joint_events):
        parts, own = [], equations.positions[name]
        for event, _ in equations.joint_events:
            if own and event.joint.name == name:
                rows = position_rows(event.joint, event.rows(bind), bind) if isinstance(event, Latch) else own
                parts.append(event.closed * ca.vertcat(*rows))
        equations.positions[name] = ca.vertsplit(sum(parts[1:], parts[0])) if parts else []


def _of_kind(kind: type[T], elements: Sequence[object]) -> list[T]:
    """The elements that are instances of `kind`."""
    return [element for element in elements if isinstance(element, kind)]


def _assemble(inertial: Sequence[Inertia], bind: Binding, equations: _Equations) -> Collected:
    bodies = tuple(body for body, _ in inertial)
    shares = [body.inertial(*values) for body, values in inertial]
    actions = [*chain.from_iterable(equations.actions.values())]
    Q_work, Q_potential, potential = _forces(bodies, shares, actions)
    Phi, Psi = (stacked([*chain(*kind.values())]) for kind in (equations.positions, equations.velocities))
    owners = [*_owners(equations.positions), *_owners(equations.velocities)]
    rows, gaps = _row_slices(owners), [gap for gap, _ in equations.laws.values()]
    M = ca.diagcat(ca.SX(0, 0), *[share.M for share in shares])
    closed = closed_at_start(event for event, _ in equations.joint_events)
    own = [*map(Coordinates.of_body, bodies)]
    return Collected(
        bodies=bodies,
        bind=bind,
        **Coordinates.joined(own),
        block_sizes=tuple(part.v.numel() for part in own),
        states=_states(bind, [ca.vec(M), Q_work, Q_potential, Phi, Psi, *gaps], equations),
        sampled=tuple(equations.sampled),
        M=M,
        M_flow=ca.diagcat(ca.SX(0, 0), *[share.M_flow for share in shares]),
        Q=Q_work + Q_potential,
        Q_work=Q_work,
        potential=potential,
        Phi=Phi,
        Psi=Psi,
        rows=rows,
        row_names=tuple(f"{name}.lam[{k - rows[name].start}]" for k, name in enumerate(owners)),
        units=_units(equations.constraints, own, Phi, Psi),
        impacts=tuple((name, *law) for name, law in equations.laws.items()),
        joint_events=tuple(equations.joint_events),
        assembly_cosines=stacked([c.assembly_cosines() for c in equations.constraints if closed.get(c.name, True)]),
        positive=tuple(positive(inertial, (*equations.constraints, *equations.actions), bind)),
        loads=tuple(load for action in actions for load in action.loads),
        forces=equations.forces,
        decoupled=(),
        n_declared_rows=equations.n_declared_rows,
    )


def _states(bind: Binding, expressions: Sequence[ca.SX], equations: _Equations) -> tuple[Symbol, ...]:
    """The states of the system: declared states, states in expressions and in other rates, and states of contacts."""
    declared = [symbol for state in equations.states for symbol in state.symbols]
    laws = [law for _, law in equations.sampled]
    states = dict.fromkeys([*declared, *bind.states(ca.vertcat(*expressions, *laws))])
    for state in (reached := [*states]):  # the list grows in the loop
        reached += [s for s in dict.fromkeys(bind.states(state.rate)) if s not in reached]
    flags = [impact.state for impact in equations.impacts]
    flags += [state for event, _ in equations.joint_events for state in event.states]
    # The tuple keeps the records of states in expressions alive.
    return tuple(
        replace(state, rate=bind.without_inputs(state.rate)) if bind.inputs_in([state.rate]) else state
        for state in dict.fromkeys([*reached, *flags])
    )


def stacked(parts: Sequence[ca.SX]) -> ca.SX:
    """Dense columns, stacked vertically."""
    return ca.densify(ca.vertcat(*parts)) if parts else ca.SX(0, 1)


def _forces(
    bodies: Sequence[Body], shares: Sequence[Inertial], actions: Sequence[Action]
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Generalised forces without potential, all other generalised forces with gyroscopic terms, and the potential."""
    zero = {id(b): ca.SX(b.frame.v.numel(), 1) for b in bodies}
    work, conservative = dict(zero), dict(zero)
    potential = ca.SX(0)

    def add(share: dict[int, ca.SX], load: Load) -> None:
        if not isinstance(load.body, Ground):
            share[id(load.body.owner)] += load.body.frame.S.T @ ca.vertcat(load.force, load.torque)

    for action in actions:
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
    return stacked([work[id(b)] for b in bodies]), stacked([conservative[id(b)] for b in bodies]), potential


def _owners(rows: dict[str, list[ca.SX]]) -> Iterator[str]:
    """The name of the constraint of each row."""
    return chain.from_iterable([name] * len(own) for name, own in rows.items())


def _row_slices(owners: Sequence[str]) -> dict[str, slice]:
    """The slice of rows of each constraint, from the owner of each row. Rows of one constraint are contiguous."""
    counts = Counter(owners)
    return {name: slice(at := owners.index(name), at + count) for name, count in counts.items()}


def is_linear(name: str) -> bool:
    """Whether a coordinate or velocity with this name is a translation or belongs to a mode."""
    part = name.rpartition(".")[2]
    translations = ("x", "y", "z", "vx", "vy", "vz", "displacement", "displacement_rate")
    return part in translations or part.startswith("eta")


def _units(constraints: Sequence[Constraint], own: Sequence[Coordinates], *rows: ca.SX) -> ca.SX:
    """Units of the rows (n_r,): 1 for rows with a translation, otherwise the mean arm of joints on bodies [m]."""
    points = [p for c in constraints if isinstance(c, Joint) for p in (c.point_a, c.point_b)]
    squares = [ca.sumsqr(p.s) for p in points if not isinstance(p.body, Ground)]
    arm = ca.sqrt(sum(squares) / len(squares)) if any(not is_zero(square) for square in squares) else ca.SX(1)
    names = [(*part.q_names, *part.v_names) for part in own]
    symbols = [ca.vertsplit(ca.vertcat(part.q, part.v)) for part in own]
    pairs = zip(chain.from_iterable(names), chain.from_iterable(symbols), strict=True)
    moving = {symbol.element_hash() for name, symbol in pairs if is_linear(name)}
    return ca.vertcat(
        ca.SX(0, 1),
        *[1 if moving & {s.element_hash() for s in ca.symvar(row)} else arm for row in ca.vertsplit(ca.vertcat(*rows))],
    )


def _without(c: Collected, pairs: Sequence[tuple[int, int]]) -> Collected:
    """The equations without these coordinates of particles. `pairs` are indices in q and v."""
    if not pairs:
        return c
    q_drop, v_drop = map(set, zip(*pairs, strict=True))
    q_keep = [i for i in range(c.q.numel()) if i not in q_drop]
    v_keep = [j for j in range(c.v.numel()) if j not in v_drop]
    return replace(
        c,
        q=c.q[q_keep],
        v=c.v[v_keep],
        qdot=c.qdot[q_keep],
        q_names=tuple(c.q_names[i] for i in q_keep),
        v_names=tuple(c.v_names[j] for j in v_keep),
        block_sizes=tuple(len({*range(at.start, at.stop)} - v_drop) for _, at in c.slices),
        M=c.M[v_keep, v_keep],
        M_flow=c.M_flow[v_keep, v_keep],
        Q=c.Q[v_keep],
        Q_work=c.Q_work[v_keep],
        decoupled=tuple((c.q_names[i], c.q[i], c.v_names[j], c.v[j]) for i, j in pairs),
    )


def _untouched(c: Collected) -> list[tuple[int, int]]:
    """Indices in q and v of the coordinates of particles that appear in no equation."""
    particles = [at for body, at in zip(c.bodies, c.slices, strict=True) if isinstance(body.pose, Particle)]
    if not particles:
        return []
    laws = [*(state.rate for state in c.states), *(law for _, law in c.sampled), *(gap for _, gap, _ in c.impacts)]
    laws += [margin for _, margin in c.joint_events]
    equations = ca.vertcat(c.Phi, c.Psi, c.Q, ca.sparsify(c.M).nz[:], c.potential, *laws)
    pattern = ca.jacobian_sparsity(equations, ca.vertcat(c.q, c.v))
    in_q, in_v = np.split(np.diff(pattern.colind()) > 0, [c.q.numel()])
    pairs = []
    for at_q, at_v in particles:
        own = zip(range(at_q.start, at_q.stop), range(at_v.start, at_v.stop), strict=True)
        free = [(i, j) for i, j in own if not in_q[i] and not in_v[j] and is_zero(c.Q[j])]
        if len(free) < 3 or not is_zero(c.M[at_v.start, at_v.start]):  # without mass nothing determines the motion
            pairs += free
    return pairs
