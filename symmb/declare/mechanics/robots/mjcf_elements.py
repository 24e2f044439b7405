"""Elements between bodies of an MJCF file: gravity, tendons, actuators, and equality constraints."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from typing import Any

import casadi as ca

from symmb.declare.mechanics.actuator import Actuator
from symmb.declare.mechanics.body import Point
from symmb.declare.mechanics.constraint import Motion
from symmb.declare.mechanics.element import Element
from symmb.declare.mechanics.force import Force, Gravity
from symmb.declare.mechanics.joint import Spherical, Weld
from symmb.declare.mechanics.load import NonlinearSpring
from symmb.declare.mechanics.robots.algebra import Scalar, conjugate, is_nought, one_after, rotation
from symmb.declare.mechanics.robots.description import XYZ, named
from symmb.declare.mechanics.robots.mjcf_model import MjcfModel, values_of
from symmb.declare.mechanics.robots.robot import Building
from symmb.declare.mechanics.state import State
from symmb.declare.symbolic import ddt

_GAIN, _BIAS = "gain", "bias"
_AFFINE = ("", ".length", ".velocity")
"""Suffixes of the names of the three numbers of an affine law."""
_COEFFICIENTS = tuple(f"polycoef.{k}" for k in range(5))


def tendon_fault(source: MjcfModel, tendon: int) -> str:
    """The reason why a tendon is left out; empty if it is not left out."""
    kinds = {kind for kind, _, _ in _way(source, tendon)}
    return "" if kinds in ({"JOINT"}, {"SITE"}) else "the tendon leads around geoms or over pulleys"


def actuator_fault(source: MjcfModel, actuator: int) -> str:
    """The reason why an actuator is left out; empty if it is not left out."""
    m = source.model
    transmission, target = source.kind("mjtTrn", m.actuator_trntype[actuator]), int(m.actuator_trnid[actuator, 0])
    if transmission not in ("JOINT", "JOINTINPARENT", "TENDON"):
        return "they act on neither a joint nor a tendon"
    if transmission == "TENDON" and tendon_fault(source, target):
        return "the tendon is left out"
    if transmission != "TENDON" and source.kind("mjtJoint", m.jnt_type[target]) not in ("HINGE", "SLIDE"):
        return "the joint has several coordinates"
    laws = {
        "dyntype": ("mjtDyn", m.actuator_dyntype, ("NONE", "INTEGRATOR", "FILTER", "FILTEREXACT")),
        "gaintype": ("mjtGain", m.actuator_gaintype, ("FIXED", "AFFINE")),
        "biastype": ("mjtBias", m.actuator_biastype, ("NONE", "AFFINE")),
    }
    for what, (enum, kinds, known) in laws.items():
        if (kind := source.kind(enum, kinds[actuator])) not in known:
            return f"{what} is {kind.lower()}"
    if source.kind("mjtDyn", m.actuator_dyntype[actuator]).startswith("FILTER") and m.actuator_dynprm[actuator, 0] <= 0:
        return "the time constant is not positive"
    if int(m.opt.disableactuator) >> int(m.actuator_group[actuator]) & 1 or not source.acts("ACTUATION"):
        return "they are switched off"
    return ""


def equality_fault(source: MjcfModel, equality: int) -> str:
    """The reason why an equality constraint is left out; empty if it is not left out."""
    m, kind = source.model, source.kind("mjtEq", source.model.eq_type[equality])
    if not m.eq_active0[equality] or not source.acts("EQUALITY"):
        return "they are switched off"
    if kind not in ("CONNECT", "WELD", "JOINT", "TENDON"):
        return f"the type is {kind.lower()}"
    ends = [int(end) for end in (m.eq_obj1id[equality], m.eq_obj2id[equality]) if end >= 0]
    if kind == "TENDON" and any(tendon_fault(source, end) for end in ends):
        return "the tendon is left out"
    if kind == "JOINT" and any(source.kind("mjtJoint", m.jnt_type[end]) in ("FREE", "BALL") for end in ends):
        return "the joint has several coordinates"
    if kind in ("CONNECT", "WELD") and len({int(m.body_weldid[body]) for body in _bodies(source, equality)}) == 1:
        return "the bodies are fixed to each other"
    return ""


def _bodies(source: MjcfModel, equality: int) -> list[int]:
    """The two bodies that an equality constraint connects, by index."""
    m = source.model
    ends = int(m.eq_obj1id[equality]), int(m.eq_obj2id[equality])
    return [int(m.site_bodyid[end]) for end in ends] if _at_sites(source, equality) else [*ends]


def _at_sites(source: MjcfModel, equality: int) -> bool:
    """Whether an equality constraint connects sites; False if the constraint connects bodies."""
    return source.kind("mjtObj", source.model.eq_objtype[equality]) == "SITE"


def element_numbers(source: MjcfModel) -> dict[str, float]:
    """The numbers of gravity, and of the tendons, actuators and equality constraints that are not left out."""
    m = source.model
    numbers = named("gravity", XYZ, values_of(m.opt.gravity))
    for k, name in enumerate(source.tendons):
        if not tendon_fault(source, k):
            numbers[f"{name}.stiffness"] = float(m.tendon_stiffness[k]) if source.acts("SPRING") else 0.0
            numbers[f"{name}.damping"] = float(m.tendon_damping[k]) if source.acts("DAMPER") else 0.0
            numbers |= named(f"{name}.springlength", ("lower", "upper"), values_of(m.tendon_lengthspring[k]))
    for k, name in enumerate(source.actuators):
        if not actuator_fault(source, k):
            numbers |= _actuator_numbers(source, k, name)
    for k, name in enumerate(source.equalities):
        if not equality_fault(source, k):
            numbers |= _equality_numbers(source, k, name)
    return numbers


def _actuator_numbers(source: MjcfModel, actuator: int, name: str) -> dict[str, float]:
    m = source.model
    numbers = {f"{name}.ctrl": 0.0, f"{name}.gear": float(m.actuator_gear[actuator, 0])}
    at = int(m.actuator_ctrladr[actuator]) if hasattr(m, "actuator_ctrladr") else actuator
    if m.actuator_ctrllimited[at] and source.acts("CLAMPCTRL"):
        lower, upper = values_of(m.actuator_ctrlrange[at])
        numbers[f"{name}.ctrl"] = min(max(0.0, lower), upper)
    for what, enum, kind, values in (
        (_GAIN, "mjtGain", m.actuator_gaintype, m.actuator_gainprm),
        (_BIAS, "mjtBias", m.actuator_biastype, m.actuator_biasprm),
    ):
        count = {"NONE": 0, "FIXED": 1, "AFFINE": 3}[source.kind(enum, kind[actuator])]
        numbers |= {f"{name}.{what}{end}": float(values[actuator, k]) for k, end in enumerate(_AFFINE[:count])}
    if source.kind("mjtDyn", m.actuator_dyntype[actuator]).startswith("FILTER"):
        numbers[f"{name}.timeconst"] = float(m.actuator_dynprm[actuator, 0])
    return numbers


def _equality_numbers(source: MjcfModel, equality: int, name: str) -> dict[str, float]:
    m, kind = source.model, source.kind("mjtEq", source.model.eq_type[equality])
    data = values_of(m.eq_data[equality])
    if kind in ("JOINT", "TENDON"):
        return named(name, _COEFFICIENTS, data[:5])
    if _at_sites(source, equality):
        first, second = (values_of(m.site_pos[site]) for site in (m.eq_obj1id[equality], m.eq_obj2id[equality]))
    else:
        first, second = (data[:3], data[3:6]) if kind == "CONNECT" else (data[3:6], data[:3])
    return named(f"{name}.body1", XYZ, first) | named(f"{name}.body2", XYZ, second)


def _way(source: MjcfModel, tendon: int) -> list[tuple[str, int, float]]:
    """The joints or sites of a tendon: kind, number, and the coefficient of a joint."""
    m, first = source.model, int(source.model.tendon_adr[tendon])
    return [
        (source.kind("mjtWrap", m.wrap_type[k]), int(m.wrap_objid[k]), float(m.wrap_prm[k]))
        for k in range(first, first + int(m.tendon_num[tendon]))
    ]


@dataclass(frozen=True, eq=False)
class _Length:
    """The value of a joint, or the length of a tendon, with its rate. `push` returns elements that exert a force."""

    value: ca.SX
    rate: ca.SX
    push: Callable[[str, Scalar], Iterator[Element]]


class MjcfElements:
    """Elements of a file other than bodies, joints, and forces in joints.

    `led` contains the names of joints that follow other joints by equality constraints.
    """

    def __init__(self, source: MjcfModel, building: Building, joints: Mapping[str, Any]) -> None:
        self.source, self.building, self.joints = source, building, joints
        self.values, self.led = building.values, set[str]()

    def all(self) -> Iterator[Element]:
        """All elements of the file. Call this method once."""
        source = self.source
        if source.acts("GRAVITY"):
            yield from self._weights()
        for k, name in enumerate(source.tendons):
            if not tendon_fault(source, k):
                yield from self._tendon_forces(k, name)
        for k, name in enumerate(source.actuators):
            if not actuator_fault(source, k):
                yield from self._actuator(k, name)
        for k, name in enumerate(source.equalities):
            if not equality_fault(source, k):
                yield self._equality(k, name)

    def _weights(self) -> Iterator[Element]:
        """Gravity, and the forces that compensate gravity."""
        gravity = self.building.vector("gravity")
        yield Gravity(*gravity, name="gravity:field")
        for body, share in zip(self.source.bodies, self.source.model.body_gravcomp.tolist(), strict=True):
            frame, mass = self.building.frames[body], self.values[f"{body}.mass"]
            if share and not is_nought(mass):
                center = frame.point(*self.building.vector(f"{body}.com"))
                yield Force(f"{body}:gravcomp", center, tuple(-share * mass * g for g in gravity))

    def _joint_length(self, joint: int) -> _Length:
        moved = self.joints[self.source.joints[joint]]
        value, rate = getattr(moved, moved.coordinate), getattr(moved, f"{moved.coordinate}_rate")
        return _Length(value, rate, lambda name, force: iter([Actuator(name, moved, force)]))

    def _tendon_length(self, tendon: int) -> _Length:
        way = _way(self.source, tendon)
        if way[0][0] == "JOINT":
            parts = [(self._joint_length(joint), factor) for _, joint, factor in way]
            value, rate = (sum(getattr(part, what) * c for part, c in parts) for what in ("value", "rate"))

            def turn(name: str, force: Scalar) -> Iterator[Element]:
                for k, (part, factor) in enumerate(parts):
                    yield from part.push(f"{name}:{k}", factor * force)

            return _Length(ca.SX(value), ca.SX(rate), turn)
        lines = [*pairwise(self._site(site) for _, site, _ in way)]
        length = reduce(lambda a, b: a + b, [ca.norm_2(b.r - a.r) for a, b in lines])

        def part(name: str, force: Scalar) -> Iterator[Element]:
            for k, (a, b) in enumerate(lines):
                if a.body is not b.body:
                    yield NonlinearSpring(f"{name}:{k}", a, b, lambda length, rate: -force)

        return _Length(length, ddt(length), part)

    def _site(self, site: int) -> Point:
        m = self.source.model
        frame = self.building.frames[self.source.bodies[m.site_bodyid[site]]]
        return frame.point(*values_of(m.site_pos[site]))

    def _tendon_forces(self, tendon: int, name: str) -> Iterator[Element]:
        stiffness, damping = self.values[f"{name}.stiffness"], self.values[f"{name}.damping"]
        lower, upper = (self.values[f"{name}.springlength.{end}"] for end in ("lower", "upper"))
        if is_nought(stiffness) and is_nought(damping):
            return
        length = self._tendon_length(tendon)
        stretch = length.value - upper
        if isinstance(lower, ca.SX) or isinstance(upper, ca.SX) or lower != upper:  # slack between these lengths
            stretch = ca.fmax(stretch, 0) - ca.fmax(lower - length.value, 0)
        yield from length.push(f"{name}:tendon", -stiffness * stretch - damping * length.rate)

    def _actuator(self, actuator: int, name: str) -> Iterator[Element]:
        m, values = self.source.model, self.values
        gear, on_tendon = values[f"{name}.gear"], self.source.kind("mjtTrn", m.actuator_trntype[actuator]) == "TENDON"
        target = (self._tendon_length if on_tendon else self._joint_length)(int(m.actuator_trnid[actuator, 0]))
        given, kind = values[f"{name}.ctrl"], self.source.kind("mjtDyn", m.actuator_dyntype[actuator])
        if kind != "NONE":
            ctrl, lag = given, values.get(f"{name}.timeconst", 0.0)
            state = State(f"{name}:act", ctrl if kind == "INTEGRATOR" else lambda z: (ctrl - z) / lag)
            yield state
            given = state.value
        gain, bias = (
            self._affine(f"{name}.{what}", gear * target.value, gear * target.rate) for what in (_GAIN, _BIAS)
        )
        yield from target.push(f"{name}:actuator", gear * (gain * given + bias))

    def _affine(self, name: str, length: ca.SX, velocity: ca.SX) -> Scalar:
        """The value of an affine law; 0 if the file has no such law."""
        total: Scalar = 0.0
        for end, factor in zip(_AFFINE, (1.0, length, velocity), strict=True):
            share = self.values.get(name + end, 0.0)
            if not is_nought(share):
                total = total + share * factor
        return total

    def _equality(self, equality: int, name: str) -> Element:
        m, kind = self.source.model, self.source.kind("mjtEq", self.source.model.eq_type[equality])
        ends = int(m.eq_obj1id[equality]), int(m.eq_obj2id[equality])
        if kind in ("JOINT", "TENDON"):
            return self._led(kind, name, *ends)
        frames = [self.building.frames[self.source.bodies[body]] for body in _bodies(self.source, equality)]
        a, b = (f.point(*self.building.vector(f"{name}.body{k}")) for k, f in enumerate(frames, 1))
        # A weld with torquescale (index 10 of its data) 0 leaves the bodies free to turn.
        if kind == "CONNECT" or not m.eq_data[equality, 10]:
            return Spherical(name, a, b)
        if _at_sites(self.source, equality):
            turn = one_after(values_of(m.site_quat[ends[0]]), conjugate(values_of(m.site_quat[ends[1]])))
        else:
            turn = values_of(m.eq_data[equality, 6:10])
        zero = one_after(one_after(frames[0].quaternion, turn), conjugate(frames[1].quaternion))
        return Weld(name, a, b, zero=rotation(zero))

    def _led(self, kind: str, name: str, first: int, second: int) -> Element:
        """A constraint between two joints or tendons. The first value is a polynomial of the second value.

        Both values are changes from the pose of the file.
        """
        m = self.source.model
        moves = []
        for end in (first, second):
            if end >= 0 and kind == "JOINT":
                moves.append(self._joint_length(end).value - self.values[f"{self.source.joints[end]}.ref"])
            elif end >= 0:
                moves.append(self._tendon_length(end).value - float(m.tendon_length0[end]))
        if kind == "JOINT":
            self.led.add(self.source.joints[first])
        coefficients = [self.values[f"{name}.{part}"] for part in _COEFFICIENTS]
        law = coefficients[0]
        for power, factor in enumerate(coefficients[1:], 1) if second >= 0 else ():
            if not is_nought(factor):
                law = law + factor * moves[1] ** power
        return Motion(name, moves[0] - law, 0.0)
