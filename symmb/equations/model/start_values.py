"""Listed values of a start or of a guess, by name: coordinates and velocities of bodies and of joints, and states."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca

from symmb._errors import DeclarationError, Faults, faults_of
from symmb._names import did_you_mean
from symmb._options import shown
from symmb._types import Expr
from symmb.declare.mechanics import Element, Joint, Rotation, Spatial
from symmb.declare.symbolic import Kind, Symbol, components, records_in
from symmb.equations.model.system import System

_RATE_OF = {"x": "vx", "y": "vy", "z": "vz", "theta": "omega"}


@dataclass(frozen=True, eq=False)
class JointValue:
    """A listed value of a handle of a joint: "elbow.angle", or its rate "elbow.angle_rate"."""

    joint: Joint
    handle: str
    value: ca.SX

    @property
    def name(self) -> str:
        """The name of the joint and of the handle."""
        return f"{self.joint.name}.{self.handle}"

    @property
    def is_rate(self) -> bool:
        """Whether the value is a velocity."""
        return self.handle.endswith("_rate")

    @property
    def state(self) -> Symbol | None:
        """The state that counts the turns of an angle in space."""
        return next(iter(records_in(getattr(self.joint, self.handle), Kind.STATE)), None)

    @property
    def row(self) -> ca.SX:
        """Residual that is 0 if the handle has the listed value. The turns of angles are counted from this value."""
        expression, state = getattr(self.joint, self.handle), self.state
        return (expression if state is None else ca.substitute(expression, state.sx, self.value)) - self.value


@dataclass(frozen=True, eq=False)
class Prescribed:
    """Listed start values: coordinates and velocities by index, and the displacements that they prescribe.

    Three fields are by name: `drift` for coordinates on which no element acts, `joints` for joint values, and `states`
    for first-order states.
    """

    q: dict[int, ca.SX] = field(default_factory=dict)
    v: dict[int, ca.SX] = field(default_factory=dict)
    displacements: frozenset[int] = frozenset()
    drift: dict[str, ca.SX] = field(default_factory=dict)
    joints: tuple[JointValue, ...] = ()
    states: dict[str, ca.SX] = field(default_factory=dict)


def listed_values(system: System, listed: Mapping[str, Expr], what: str) -> Prescribed:
    """Listed values by the index or the name of the coordinate or state. `Scene` explains the names."""
    if not isinstance(listed, Mapping):
        raise DeclarationError(f'{what}: expected values by name, such as {{"rod.theta": 0.3}}, got {shown(listed)}.')
    values, faults = _Values(system, what), Faults()
    for name, value in listed.items():
        if not isinstance(name, str):
            faults.append(f"{what}: the name of a coordinate must be a text, got {shown(name)}.")
            continue
        with faults.noted():
            values.add(name, value)
    faults.raise_any()
    return Prescribed(
        values.q, values.v, frozenset(values.displacements), values.drift, tuple(values.joint_values), values.states
    )


class _Values:
    """The listed values that were read so far."""

    def __init__(self, system: System, what: str) -> None:
        c = system.collected
        self._system, self._what = system, what
        self._q_at = {name: i for i, name in enumerate(c.q_names)}
        self._v_at = {name: i for i, name in enumerate(c.v_names)}
        self._decoupled = {name for x, _, vx, _ in c.decoupled for name in (x, vx)}
        self._spatial = {b.name for b in c.bodies if isinstance(b.pose, Spatial)}
        self._joints = {e.name: e for e in system.elements if isinstance(e, Joint)}
        own = [f"{e.name}{e.of_start}" for e in system.elements if isinstance(e, Element) and e.of_start is not None]
        self._states = {state.name for state in c.states} & {*own}
        self.q: dict[int, ca.SX] = {}
        self.v: dict[int, ca.SX] = {}
        self.displacements: set[int] = set()
        self.drift: dict[str, ca.SX] = {}
        self.joint_values: list[JointValue] = []
        self.states: dict[str, ca.SX] = {}

    def add(self, name: str, value: Expr) -> None:
        """Add a value under its name."""
        body, _, part = name.rpartition(".")
        if body in self._spatial and part in ("rotation", "omega"):
            self._add_of_spatial(body, part, name, value)
        elif name in self._decoupled:
            self.drift[name] = self._bind(value, name)
        elif name in self._q_at and not _is_quaternion(name, self._spatial):
            self.q[self._q_at[name]] = self._bind(value, name)
            self.displacements.add(self._v_at[f"{body}.{_RATE_OF.get(part, f'{part}_dot')}"])
        elif name in self._v_at:
            self.v[self._v_at[name]] = self._bind(value, name)
        elif name in self._states:
            self.states[name] = self._bind(value, name)
        elif body in self._joints and part.removesuffix("_rate") in ("angle", "displacement"):
            bound = self._bind(value, name)
            with faults_of(self._what):
                getattr(self._joints[body], part)
            self.joint_values.append(JointValue(self._joints[body], part, bound))
        else:
            known = did_you_mean(name, self._known())
            raise DeclarationError(f"{self._what}: no coordinate or velocity {name!r}.{known}")

    def _add_of_spatial(self, body: str, part: str, name: str, value: Any) -> None:
        """Add the rotation or the angular velocity of a spatial body."""
        omega = [self._v_at[f"{body}.omega_{c}"] for c in "xyz"]
        if part == "omega":
            if (parts := components(value)) is None or len(parts) != 3:
                what = f"{self._what} {name!r}"
                raise DeclarationError(f"{what}: expected three numbers or expressions, got {shown(value)}.")
            self.v.update({at: self._bind(w, name) for at, w in zip(omega, parts, strict=True)})
            return
        if not isinstance(value, Rotation):
            raise DeclarationError(
                f"{self._what} {name!r}: expected rotation(axis=..., angle=...), got {shown(value)}."
            )
        e = self._bind(value.quaternion, name, 4)
        self.q.update({self._q_at[f"{body}.e{k}"]: e[k] for k in range(4)})
        self.displacements.update(omega)

    def _known(self) -> Iterator[str]:
        """All known names, for suggestions in messages."""
        yield from (n for n in (*self._q_at, *self._v_at) if not _is_quaternion(n, self._spatial))
        yield from (f"{b}.{part}" for b in self._spatial for part in ("rotation", "omega"))
        yield from sorted(self._decoupled)
        yield from self._states
        handles = ((joint, handle) for joint in self._joints.values() for handle in joint.handles)
        yield from (f"{joint.name}.{handle}{rate}" for joint, handle in handles for rate in ("", "_rate"))

    def _bind(self, value: Expr, name: str, size: int = 1) -> ca.SX:
        bind = self._system.bind
        bound = bind(value, f"{self._what} {name!r}", any_size=True)
        if bound.numel() != size:
            raise DeclarationError(f"{self._what} {name!r}: expected one number or expression, got {shown(value)}.")
        if not bind.has_parameters_alone(bound):
            raise DeclarationError(f"{self._what} {name!r}: the value may depend on parameters only.")
        return bound


def with_modes(system: System, listed: Prescribed, guess: Collection[str], equilibrium: bool) -> Prescribed:
    """Listed values in which modes of flexible bodies without a guess are at rest and undeformed."""
    c, zero = system.collected, ca.SX(0)
    modes = [f"{b.name}.{x}" for b in c.bodies for x in b.pose.coordinates[len(b.pose.rigid_coordinates) :]]
    fixed = [name for name in modes if name not in guess]
    rates = {c.v_names.index(f"{name}_dot"): zero for name in fixed}
    listed = replace(listed, v={**rates, **listed.v})
    if equilibrium:
        return listed
    undeformed = {c.q_names.index(name): zero for name in fixed}
    return replace(listed, q={**undeformed, **listed.q}, displacements=listed.displacements | rates.keys())


def _is_quaternion(name: str, spatial: set[str]) -> bool:
    body, _, part = name.rpartition(".")
    return body in spatial and part in ("e0", "e1", "e2", "e3")
