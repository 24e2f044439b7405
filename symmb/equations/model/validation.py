"""Checks of a declaration. Each function returns faults of one kind, or raises the faults of one element."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from symmb._doubt import Doubt
from symmb._errors import DeclarationError, Faults, faults_of
from symmb._magnitudes import SAME
from symmb._names import name_fault
from symmb._options import number_text, shown
from symmb._types import Array
from symmb._units import units_of_parameters, values_text
from symmb.declare.mechanics import (
    RESTITUTION,
    TRIANGLE,
    AbstractBody,
    Action,
    Body,
    Constraint,
    Element,
    Ground,
    Impact,
    Input,
    JointEvent,
    OwnState,
    Parameters,
    Particle,
    Sampled,
    Spatial,
    as_matrix,
    in_no_system,
    inertia_matrix,
    law_value,
    positive_numbers,
)
from symmb.declare.symbolic import Kind, TruthValueError, is_zero, margin_of
from symmb.equations.model.binding import Binding
from symmb.equations.model.box import Box
from symmb.equations.model.multipliers import joint_reaction

T = TypeVar("T")
Inertia = tuple[Body, tuple[ca.SX, ca.SX]]
"""A body with its mass and its inertia matrix (3, 3)."""


class ElementFaults(Faults):
    """The faults of the elements of a system."""

    def each(self, otherwise: T, f: Callable[..., T], elements: Sequence[Element], *arguments: Any) -> dict[str, T]:
        """The results of f for each element, by the names of the elements."""
        return {e.name: self.attempt(otherwise, f, e, *arguments) for e in elements}

    def attempt(self, otherwise: T, f: Callable[..., T], *arguments: Any, what: str = "A law") -> T:
        """The result of f, or `otherwise` if f raises a DeclarationError. The fault is then noted."""
        with self.noted():
            try:
                return f(*arguments)
            except TruthValueError as error:
                self.append(f"{what}: {error}")
        return otherwise


def name_faults(elements: Sequence[object], parameters: Parameters) -> list[str]:
    """Faults of arguments that are not elements, and of names that are invalid or used twice."""
    faults, names = [], set()
    own = [e.title for e in elements if isinstance(e, OwnState) and e.name in (*parameters, "t")]
    for u in (e for e in elements if isinstance(e, Input)):
        is_parameter = u.name in parameters and parameters.__getattr__(u.name).element_hash() == u.value.element_hash()
        own += [u.title] if u.name in (*parameters, "t") and not is_parameter else []
    faults += [f"{title}: a parameter or the time has this name. Choose another name." for title in own]
    for e in elements:
        if not isinstance(e, Body | Element):
            remedy = " Pass parameters=p." if isinstance(e, Parameters) else ""
            faults.append(f"System: {shown(e)} is neither a body, a constraint nor a force.{remedy}")
            continue
        fault = name_fault(e.name, without=".[] ")
        if fault:
            faults.append(f"{_kind(e)} {shown(e.name)}: {fault}")
        elif e.name in names and isinstance(e, JointEvent):
            faults.append(f"{e.title}: there are two events of this kind. Combine their conditions by casadi.logic_or.")
        elif e.name in names:
            faults.append(f"{_kind(e)} {shown(e.name)}: the name is used twice. Choose another name.")
        else:
            names.add(e.name)
    return faults


def _kind(part: Body | Element) -> str:
    return part.kind if isinstance(part, Element) else type(part).__name__


def membership_faults(element: Element, known: Collection[int]) -> list[str]:
    """Faults of an element that refers to missing bodies or elements. `known` are the `id`s of the system's parts."""
    missing = [f"body {body.name!r}" for body in _bodies_of(element) if id(body) not in known]
    missing += [part.title for part in element.parts() if isinstance(part, Element) and id(part) not in known]
    return [f"{element.title}: {what} is not part of the System. Add it to System(...)." for what in missing]


def _bodies_of(element: Element) -> list[Body]:
    """The bodies, without grounds, to which an element is attached; empty if it is not attached to points or bodies."""
    try:
        owners = [body.owner for body in element.bodies() if isinstance(body, AbstractBody)]
    except AttributeError:  # a point of a wrong type: the element reports this fault itself
        return []
    return [owner for owner in owners if isinstance(owner, Body)]


def left_out(elements: Sequence[Body | Element]) -> Iterator[str]:
    """Warnings about elements that act on bodies of this System, but belong to no System. The user may have forgotten
    these elements.

    An element with the same name as an element in the System is a variant, and causes no warning.
    """
    bodies, names = [e for e in elements if isinstance(e, Body)], [e.name for e in elements]
    known, symbols = set(map(id, bodies)), {s.sx.element_hash() for body in bodies for s in body.frame.records}
    for element in in_no_system():
        own = {id(body) for part in (element, *element.parts()) for body in _bodies_of(part)}
        laws = [value for value in vars(element).values() if isinstance(value, ca.SX)]
        acts = own <= known if own else any(s.element_hash() in symbols for x in laws for s in ca.symvar(x))
        if acts and element.name not in names:
            yield Doubt(
                f"{element.title} is not part of the System and has no effect, although the System contains its "
                "bodies. Add it to System(...) if it belongs to the mechanism."
            )


def mass_and_inertia(body: Body, bind: Binding) -> tuple[ca.SX, ca.SX]:
    """Mass (scalar) and inertia (3, 3) of a body as SX. All faults of mass and inertia are raised at once."""
    mass = bind(body.mass, f"Body {body.name!r}: mass")
    bind.check(body.laws, f"Body {body.name!r}: stiffness or damping")
    J = inertia_matrix(body, as_matrix(body.inertia, f"Body {body.name!r}: inertia", bind))
    faults = Faults(_inertia_faults(body, "mass", mass, bind))
    faults += _inertia_faults(body, "inertia", ca.diag(J), bind)
    skew, size = _nominal(ca.vec(J - J.T), bind), _nominal(ca.vec(J), bind)
    if skew is not None and size is not None and skew.any():
        # A turned inertia matrix is symmetric up to rounding only.
        if np.abs(skew).max() > SAME * np.abs(size).max():
            faults.append(f"Body {body.name!r}: inertia matrix is not symmetric.")
        J = (J + J.T) / 2
    if v_like := bind.symbols(Kind.VELOCITY, ca.vertcat(mass, ca.vec(J))):
        faults.append(f"Body {body.name!r}: mass and inertia must not depend on velocities ({v_like[0].name()}).")
    faults.raise_any()
    return mass, J


def _inertia_faults(body: Body, what: str, value: ca.SX, bind: Binding) -> Iterator[str]:
    """Fault of a mass or a moment of inertia that is negative, or that is 0 at the nominal parameters only."""
    nominal = _nominal(value, bind)
    if nominal is not None and np.any(nominal < 0):
        yield f"Body {body.name!r}: {what} is negative at the nominal parameters. It must not be below 0."
    elif nominal is not None and any(n == 0 and not is_zero(value[i]) for i, n in enumerate(nominal)):
        yield (
            f"Body {body.name!r}: {what} is an expression and has the value 0 at the nominal parameters. "
            "Declare the number 0 for a massless body. The equations are then solved without a division by this value."
        )


def _nominal(value: ca.SX, bind: Binding) -> Array | None:
    """Values of an expression at the nominal parameters; None if the expression contains coordinates or time."""
    f = ca.Function("f", [bind.parameters.symbols], [ca.densify(value)], {"allow_free": True})
    return None if f.has_free() else np.asarray(f(bind.parameters.nominal)).ravel()


def position_rows(constraint: Constraint, rows: ca.SX, bind: Binding) -> list[ca.SX]:
    """The nonzero rows of a constraint. Each row must depend on a coordinate."""
    nonzero = [rows[i] for i in range(rows.numel()) if not is_zero(rows[i])]
    faults = Faults()
    for row in nonzero:
        bind.check(row, constraint.title)
        if not bind.symbols(Kind.COORDINATE, row):
            faults.append(f"{constraint.title}: no coordinate can satisfy row {row} = 0. Check points, axis and law.")
        if bind.symbols(Kind.VELOCITY, row):
            faults.append(f"{constraint.title}: a position row must not contain velocities. Use VelocityConstraint.")
        faults += [f"{constraint.title}: {fault}" for fault in _state_faults(row, bind)]
    if rows.numel() and not nonzero:
        faults.append(f"{constraint.title}: all rows of this constraint are identically zero. Remove the constraint.")
    faults.raise_any()
    return nonzero


def _state_faults(row: ca.SX, bind: Binding) -> list[str]:
    """Faults of a position row that contains a state with velocities in its rate. The row's rate has no Jacobian."""
    states = [state for state in bind.states(row) if state.owner]
    fast = [state for state in states if bind.symbols(Kind.VELOCITY, state.rate)]
    return [
        f"the rate of {state.owner} contains velocities, so a position constraint cannot contain this state. Use a "
        "force law."
        for state in fast
    ]


def held_faults(sampled: Sampled, *kinds: Mapping[str, Sequence[ca.SX]]) -> list[str]:
    """Faults of constraints with a sampled value. `kinds` are the rows of all constraints by name."""
    rows = [(name, row) for kind in kinds for name, own in kind.items() for row in own]
    jumping = dict.fromkeys(name for name, row in rows if ca.depends_on(row, sampled.value))
    return [
        f"{name!r}: the value of {sampled.title} jumps, but a constraint must be continuous. Use an Actuator or a "
        "Force."
        for name in jumping
    ]


def velocity_rows(constraint: Constraint, bind: Binding) -> list[ca.SX]:
    """The nonzero velocity-only rows of a constraint. Each row must be linear in the velocities."""
    rows = constraint.velocity_rows(bind)
    nonzero = [rows[i] for i in range(rows.numel()) if not is_zero(rows[i])]
    for row in nonzero:
        bind.check(row, constraint.title)
        velocities = bind.symbols(Kind.VELOCITY, row)
        linear = ca.jacobian(row, ca.vertcat(*velocities)) if velocities else None
        if linear is None or bind.symbols(Kind.VELOCITY, linear):
            raise DeclarationError(
                f"{constraint.title}: each expression must contain velocities and be linear in all velocities."
            )
    return nonzero


def impact_law(impact: Impact, bind: Binding) -> tuple[ca.SX, ca.SX]:
    """Gap and coefficient of restitution of an impact as SX scalars."""
    gap = bind(impact.gap, f"{impact.title}: gap")
    e = bind(impact.restitution, f"{impact.title}: restitution")
    faults = Faults()
    for what, value in (("gap", gap), ("restitution", e)):
        if value.numel() != 1:
            faults.append(f"{impact.title}: {what} has {value.numel()} components. Write an Impact for each.")
    if bind.symbols(Kind.VELOCITY, gap):
        faults.append(f"{impact.title}: the gap must not contain velocities. Write a distance, such as ball.y - r.")
    elif not bind.symbols(Kind.COORDINATE, gap):
        faults.append(f"{impact.title}: the gap {gap} contains no coordinate. Write a distance, such as ball.y - r.")
    if not bind.has_parameters_alone(e):
        faults.append(f"{impact.title}: restitution may depend on parameters only.")
    nominal = None if faults else _nominal(e, bind)
    if nominal is not None and not 0 <= nominal[0] <= 1:
        fault = RESTITUTION.format(number_text(nominal[0]))
        faults.append(f"{impact.title}: {fault} at the nominal parameters. Give a valid coefficient.")
    faults.raise_any()
    return gap, e


def event_margin(event: JointEvent, rows: Sequence[ca.SX], bind: Binding) -> ca.SX:
    """The margin of the condition of a joint event as an SX scalar. `rows` are the rows of the joint."""
    condition, lam, what = event.condition, event.lam[: len(rows)], f"{event.title}: condition"
    if callable(condition):
        condition = law_value(condition, event.title, joint_reaction(event.joint, ca.vertcat(*rows), lam))
    condition = bind(condition, what, {s.element_hash() for s in ca.vertsplit(lam)})
    with faults_of(event.title):
        value = margin_of(condition).value
    if bind.has_parameters_alone(value):
        raise DeclarationError(
            f"{event.title}: the condition is constant. Write a comparison of coordinates, velocities or mb.t, such "
            "as arm.theta > 0.8."
        )
    return value


def plane_faults(title: str, action: Action) -> list[str]:
    """Faults of loads that push or turn a planar body out of its plane."""
    faults = []
    particle = next((load.body.name for load in action.loads if _is_particle(load.body)), None)
    remedy = "Leave it out or use pose=Spatial()."
    if particle is not None:
        remedy = f"Particle {particle!r} can leave the plane. Use Planar() for the particle, or Spatial() for both."
    for load in action.loads:
        wrench = ca.vertcat(load.force, load.torque)
        S = load.body.frame.S
        if isinstance(load.body, Ground) or _is_particle(load.body):
            continue
        outside = [i for i in range(6) if is_zero(S[i, :]) and not is_zero(wrench[i])]
        if outside:
            i = outside[0]
            text = str(wrench[i])
            value = f" ({text})" if len(text) <= 40 else ""  # a longer text does not help
            what = f"{'force along' if i < 3 else 'torque about'} {'xyzxyz'[i]}{value}"
            faults.append(f"{title}: {what} acts out of the plane of planar body {load.body.name!r}. {remedy}")
    return faults


def _is_particle(body: AbstractBody) -> bool:
    return isinstance(body, Body) and isinstance(body.pose, Particle)


def require_inertia(M: ca.Sparsity, G: ca.SX, v_names: Sequence[str]) -> None:
    """Raise DeclarationError if a velocity has neither an entry in M (n_v, n_v) nor a row in G (n_r, n_v)."""
    columns = ca.horzsplit(ca.vertcat(ca.DM(M, 1), ca.DM(G.sparsity(), 1)))
    free = [name for name, column in zip(v_names, columns, strict=True) if not column.nnz()]
    if free:
        raise DeclarationError(
            f"Nothing determines the acceleration of {', '.join(free)}. Give the body a mass for its translation and "
            "an inertia for its rotation, or add joints that connect it with other bodies."
        )


def sign_faults(names: Sequence[str], positive: ca.Function, parameters: Parameters, box: Box) -> list[str]:
    """Messages for values that are not positive at a corner of the box. `positive` maps parameters to the values."""
    order, parts = list(parameters), {}
    # A box with more than 1024 corners is not checked. Invalid samples of such a box fail one by one.
    for corner in product(*box.bounds) if len(box) <= 10 else ():
        p = parameters.nominal
        p[[order.index(name) for name in box.names]] = corner
        for name, value in zip(names, np.asarray(positive(p)).ravel(), strict=True):
            if not value > 0:
                at = values_text(box.names, corner, units_of_parameters(parameters))
                parts.setdefault(name, f"box: {name} is {value:g}, not positive, at {at}. Narrow the box.")
    return list(parts.values())


def positive(inertial: Sequence[Inertia], elements: Iterable[Element], bind: Binding) -> Iterator[tuple[str, ca.SX]]:
    """Expressions of parameters that must be above 0, with their names."""
    for body, (mass, J) in inertial:
        triangle = (
            ("triangle inequality of moments of inertia (a leading minor of tr(J) / 2 - J)", m)
            for m in _triangle_minors(body, J)
        )
        for what, value in (("mass", mass), *(("inertia", J[k, k]) for k in range(3)), *triangle):
            if not is_zero(value) and bind.has_parameters_alone(value):
                yield f"Body {body.name!r}: {what}", value
    for element in elements:
        for name, value in positive_numbers(element.title, element, bind):
            if bind.has_parameters_alone(value):
                yield name, value


def _triangle_minors(body: Body, J: ca.SX) -> list[ca.SX]:
    """Three expressions that are positive if each principal moment of a spatial body is at most the sum of the others.

    The expressions are the leading minors of tr(J) / 2 - J, the second moments of the mass, with an allowance for
    rounding. The first minor is half of the sum of two moments minus the third moment.
    """
    if not isinstance(body.pose, Spatial) or is_zero(J):
        return []
    moments = ca.densify((0.5 + TRIANGLE) * ca.trace(J) * ca.SX.eye(3) - J)
    return [ca.det(moments[:k, :k]) for k in (1, 2, 3)]
