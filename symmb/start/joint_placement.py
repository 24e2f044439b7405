"""Bodies put where coordinates of the joints that carry them say: listed, guessed, or zero."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from symmb._types import Array, Indices
from symmb.mechanics import AxisJoint, Planar
from symmb.model import DAE, Scene
from symmb.start.joint_tree import GROUND
from symmb.start.joint_values import of_positions
from symmb.symbolic import product

_NEAR = 0.5
"""Cosine of directions that a joint locks parallel from which on Newton's method turns them together."""
_ANGULAR = ("omega", "omega_x", "omega_y", "omega_z")
Values = Mapping[str, float]
"""Values of the handles of a joint at the nominal parameters."""


@dataclass(frozen=True, eq=False)
class JointPlacement:
    """Moves bodies to joints with listed or guessed coordinates, and to those whose zero is declared.

    Handles that are neither listed nor guessed are zero where the zero is declared, and else stay as they are.
    """

    scene: Scene
    dae: DAE
    free: Indices

    def moved(self, q: Array, body: int, carrier: int) -> Array | None:
        """Coordinates q (n_q,) after a body is moved to the joint with its carrier; None if that has no value."""
        joint = self._joint_between.get(frozenset((body, carrier)))
        if joint is None or not self._turns_freely(body):
            return None
        moves_b = joint.bodies()[1].owner is self.scene.system.bodies[body]
        return self._placed(q, joint, self._joints[joint], body, moves_b)

    def aligned_to_known(self, q: Array) -> Array:
        """Coordinates q (n_q,) after bodies are turned with those of listed or guessed rotation to which joints lock
        them."""
        bodies = range(len(self.scene.system.bodies))
        known = [k for k in bodies if self._is_guessed(k) or not self._turns_freely(k)]
        locked = [pair for pair, joint in self._locking.items() if joint.assembly_cosines().numel() > 1]
        for body in known:  # which grows
            for other in [next(iter(pair - {body})) for pair in locked if body in pair and len(pair) > 1]:
                if other not in (*known, GROUND):
                    q = self.aligned(q, other, body)
                    known.append(other)
        return q

    def aligned(self, q: Array, body: int, carrier: int) -> Array:
        """Coordinates q (n_q,) after a body is turned with the joint that its carrier turns far.

        Newton's method does not converge from axes at right angles, and finds the flipped root beyond. Rotations that
        are listed or guessed stay.
        """
        joint = self._locking.get(frozenset((body, carrier)))
        if joint is None or not self._turns_freely(body) or self._is_guessed(body):
            return q
        _, A, B, _ = self._frames(joint, q)
        is_locked = joint.assembly_cosines().numel() > 1
        if min(A[:, k] @ B[:, k] for k in ((0, 2) if is_locked else (2,))) > _NEAR:
            return q
        moves_b = joint.bodies()[1].owner is self.scene.system.bodies[body]
        q = self._turned(q, body, _between(*((B[:, 2], A[:, 2]) if moves_b else (A[:, 2], B[:, 2]))))
        if is_locked:
            _, A, B, _ = self._frames(joint, q)
            q = self._turned(q, body, (-1 if moves_b else 1) * _angle_about_axis(A, B) * A[:, 2])
        return q

    @property
    def pairs(self) -> Iterable[frozenset[int]]:
        """The bodies that each joint with values connects, by their numbers."""
        return self._joint_between.keys()

    @cached_property
    def _locking(self) -> dict[frozenset[int], AxisJoint]:
        """The joint between two bodies that locks most of their directions parallel."""
        numbers = {id(body): k for k, body in enumerate(self.scene.system.bodies)}
        joints = [e for e in self.scene.system.elements if isinstance(e, AxisJoint) and e.assembly_cosines().numel()]
        joints.sort(key=lambda joint: -joint.assembly_cosines().numel())
        found: dict[frozenset[int], AxisJoint] = {}
        for joint in joints:
            found.setdefault(frozenset(numbers.get(id(end.owner), GROUND) for end in joint.bodies()), joint)
        return found

    def _is_guessed(self, body: int) -> bool:
        """Whether the rotation of a body is guessed."""
        name = self.scene.system.bodies[body].name
        return any(self.dae.q_names[i] in (f"{name}.theta", f"{name}.e0") for i in self.scene.guesses)

    @cached_property
    def _joint_between(self) -> dict[frozenset[int], AxisJoint]:
        """The first joint with values between two bodies."""
        numbers = {id(body): k for k, body in enumerate(self.scene.system.bodies)}
        joints: dict[frozenset[int], AxisJoint] = {}
        for joint in self._joints:
            joints.setdefault(frozenset(numbers.get(id(end.owner), GROUND) for end in joint.bodies()), joint)
        return joints

    @cached_property
    def _joints(self) -> dict[AxisJoint, dict[str, float]]:
        """The joints with values or a declared zero, and the values at the nominal parameters."""
        elements = self.scene.system.elements
        joints: dict[AxisJoint, dict[str, float]] = {
            e: {} for e in elements if isinstance(e, AxisJoint) and e.zero is not None
        }
        p = self.scene.system.p
        for listed in (self.scene.guessed, self.scene.prescribed):
            for value in of_positions(listed):
                if isinstance(value.joint, AxisJoint):
                    number = ca.Function("value", [p], [value.value])(self.dae.p_nominal)
                    joints.setdefault(value.joint, {})[value.handle] = float(number)
        return joints

    def _turns_freely(self, body: int) -> bool:
        name = self.scene.system.bodies[body].name
        turns = [self._numbers[v] for part in _ANGULAR if (v := f"{name}.{part}") in self._numbers]
        return bool(turns) and bool(np.isin(turns, self.free).all())

    @cached_property
    def _numbers(self) -> dict[str, int]:
        """Numbers of the coordinates and of the velocities."""
        return {name: k for names in (self.dae.q_names, self.dae.v_names) for k, name in enumerate(names)}

    def _placed(self, q: Array, joint: AxisJoint, values: Values, body: int, moves_b: bool) -> Array:
        """Turn the body until the axes are parallel, then about the axis, and move it last."""
        sign = 1 if moves_b else -1
        _, A, B, _ = self._frames(joint, q)
        own, other = (B, A) if moves_b else (A, B)
        q = self._turned(q, body, _between(own[:, 2], other[:, 2]))
        angle, A, B, _ = self._frames(joint, q)
        if not joint.turns:
            angle, wanted = _angle_about_axis(A, B), 0.0
        else:
            wanted = values.get("angle", angle if joint.zero is None else 0.0)
        q = self._turned(q, body, sign * (wanted - angle) * A[:, 2])
        _, A, _, d = self._frames(joint, q)
        reached = float(A[:, 2] @ d) if joint.zero is None else 0.0
        along = (values.get("displacement", reached) if joint.slides else 0.0) * A[:, 2]
        return self._shifted(q, body, sign * (along - d))

    def _frames(self, joint: AxisJoint, q: Array) -> tuple[float, Array, Array, Array]:
        """The angle of a joint that turns, its frames (3, 3), and the vector from point a to point b (3,)."""
        f, numbers = self._functions[joint]
        value, A, B, d = (part.full() for part in f(q[numbers], self.dae.p_nominal))
        return float(value[0, 0]), A, B, d.ravel()

    @cached_property
    def _functions(self) -> dict[AxisJoint, tuple[ca.Function, list[int]]]:
        """For each joint a Function (q, p) -> angle, frames and distance, and the numbers of its coordinates q."""
        system, functions = self.scene.system, {}
        numbers = {q.element_hash(): k for k, q in enumerate(ca.vertsplit(system.q))} if system.q.numel() else {}
        for joint in {*self._joints, *self._locking.values()}:
            angle = joint.angle if joint.turns else ca.SX(0)
            states = [s for s in ca.symvar(angle) if s.name() == f"{joint.name}.angle"]
            angle = ca.substitute(angle, ca.vertcat(*states), ca.SX.zeros(len(states), 1)) if states else angle
            parts = [angle, *joint.frames, joint.d]
            used = sorted({h for s in ca.symvar(ca.veccat(*parts)) if (h := numbers.get(s.element_hash())) is not None})
            functions[joint] = ca.Function("frames", [system.q[used], system.p], parts), used
        return functions

    def _turned(self, q: Array, body: int, turn: Array) -> Array:
        """Coordinates after a body turns by a rotation vector in world axes (3,) [rad]."""
        element, q = self.scene.system.bodies[body], q.copy()
        if isinstance(element.pose, Planar):
            q[self._numbers[f"{element.name}.theta"]] += turn[2]
            return q
        at = self._numbers[f"{element.name}.e0"]
        angle = float(np.linalg.norm(turn))
        e = ca.vertcat(np.cos(angle / 2), np.sinc(angle / 2 / np.pi) / 2 * turn)
        q[at : at + 4] = np.asarray(ca.DM(product(ca.SX(e), ca.SX(q[at : at + 4])))).ravel()
        return q

    def _shifted(self, q: Array, body: int, shift: Array) -> Array:
        """Coordinates after a body moves by a vector (3,) [m], along the coordinates that are not listed."""
        name, q = self.scene.system.bodies[body].name, q.copy()
        for part, distance in zip("xyz", shift.tolist(), strict=True):
            if self._numbers.get(f"{name}.v{part}", -1) in self.free:
                q[self._numbers[f"{name}.{part}"]] += distance
        return q


def _angle_about_axis(A: Array, B: Array) -> float:
    """The angle of a frame B (3, 3) about the common axis z, next to a frame A [rad]."""
    return float(np.arctan2(A[:, 1] @ B[:, 0], A[:, 0] @ B[:, 0]))


def _between(start: Array, end: Array) -> Array:
    """The least rotation vector (3,) that turns one direction onto another."""
    axis, cosine = np.cross(start, end), float(start @ end)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:  # opposite: about any axis at right angles
        axis = np.cross(start, np.eye(3)[np.abs(start).argmin()])
    length = float(np.linalg.norm(axis))
    return np.arctan2(sine, cosine) * axis / length if sine >= 1e-12 or cosine < 0 else np.zeros(3)
