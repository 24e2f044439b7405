"""Forward kinematics: bodies are first turned and then moved, along a spanning tree of joints.

Joints get their listed or guessed values, or 0 if they are declared with `zero=`. Other joints move a body as little as
possible: a hinge turns the body until the axes are parallel, and then moves the body's point to the joint. Listed and
guessed rotations and positions of bodies are kept. Loops stay open.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from heapq import heappop, heappush
from typing import TypeVar

import casadi as ca
import numpy as np

from symmb._types import Array, Indices
from symmb.declare.mechanics import AxisJoint, Joint, Planar, Universal
from symmb.declare.symbolic import product, t
from symmb.equations.model import DAE, Scene
from symmb.equations.start.joint_tree import GROUND
from symmb.equations.start.joint_values import of_positions
from symmb.equations.start.residual_limits import SOLVED

J = TypeVar("J", bound=Joint)
_ROTATION, _POSITION = ("theta", "e0"), ("x", "y", "z")
_VELOCITY_OF = {"theta": "omega", "e0": "omega_x", "x": "vx", "y": "vy", "z": "vz"}


def placed_along_joints(scene: Scene, dae: DAE, q: Array, s: Array, free: Indices, t0: float) -> Array:
    """Coordinates (n_q,) after the bodies at coordinates q and states s (n_s,) were moved to fit the joints.

    `free` are the indices of the displacements that are not listed.
    """
    joints = [e for e in scene.system.elements if isinstance(e, Joint) and e.name in dae.rows]
    kinematics = _Kinematics(scene, dae, frozenset(dae.v_names[k] for k in free), (s, dae.p_nominal, t0), joints)
    turning = [e for e in joints if isinstance(e, AxisJoint) and (e.assembly_cosines().numel() or type(e) is Universal)]
    for joint, body in kinematics.along(turning, "angle", _ROTATION):
        q = kinematics.turned_to_joint(q, joint, body)
    for joint, body in kinematics.along(joints, "displacement", _POSITION):
        q = kinematics.moved_to_joint(q, joint, body)
    return q


@dataclass(frozen=True, eq=False)
class _Kinematics:
    """Bodies on joints at the states, parameters and time `at`. `free` has the names of velocities of unlisted
    displacements."""

    scene: Scene
    dae: DAE
    free: frozenset[str]
    at: tuple[Array, Array, float]
    joints: list[Joint]
    _functions: dict[Joint, tuple[ca.Function, list[int]]] = field(default_factory=dict, init=False)

    def along(self, joints: list[J], handle: str, parts: tuple[str, ...]) -> Iterator[tuple[J, int]]:
        """Pairs of a joint and the body that the joint places. Joints that determine more coordinates come first.

        The ground, bodies with listed `parts`, and guessed bodies without a joint value are placed first. Each other
        body is placed relative to a placed neighbour. If a body has no such neighbour, it keeps its position, and its
        neighbours are placed relative to it.
        """
        bodies, names = range(len(self.scene.system.bodies)), [body.name for body in self.scene.system.bodies]
        beside = self._beside(joints, handle)
        determined = {body for body, edges in beside.items() if any(has_value for _, has_value, *_ in edges)}
        placed: dict[int, int] = {}
        queue: list[tuple[bool, int, int, int]] = []

        def place(body: int) -> None:
            placed[body] = len(placed)
            for is_least, _, rows, number in beside[body]:
                heappush(queue, (is_least, placed[body], rows, number))

        known = [{self._numbers.get(f"{name}.{part}") for part in parts} for name in names]
        guessed = [body for body in bodies if not known[body].isdisjoint(self.scene.guesses)]
        listed = [body for body in bodies if not self._free_parts(body, parts)]
        for body in sorted({GROUND, *listed} | (set(guessed) - determined)):
            place(body)
        for root in (GROUND, *guessed, *bodies):
            if root not in placed:
                place(root)
            while queue:
                joint = joints[heappop(queue)[-1]]
                for body in self._ends[joint]:
                    if body not in placed:
                        place(body)
                        yield joint, body

    def _beside(self, joints: list[J], handle: str) -> dict[int, list[tuple[bool, bool, int, int]]]:
        """Sort keys of each body's joints: is the move smallest, is there a value, minus the number of rows, index."""
        beside: dict[int, list[tuple[bool, bool, int, int]]] = defaultdict(list)
        for number, joint in enumerate(joints):
            has_value = handle in self._values.get(joint, {})
            locks = handle == "angle" and joint.assembly_cosines().numel() > 1
            where = self.dae.rows[joint.name]
            for body in self._ends[joint]:
                beside[body].append((not has_value and not locks, has_value, where.start - where.stop, number))
        return beside

    def _free_parts(self, body: int, parts: tuple[str, ...]) -> list[int]:
        """Indices of the coordinates `parts` of a body that are not listed."""
        name = self.scene.system.bodies[body].name
        return [self._numbers[f"{name}.{part}"] for part in parts if f"{name}.{_VELOCITY_OF[part]}" in self.free]

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.dae.q_names)}

    @cached_property
    def _ends(self) -> dict[Joint, tuple[int, ...]]:
        """The indices of the bodies of each joint."""
        numbers = {id(body): k for k, body in enumerate(self.scene.system.bodies)}
        return {joint: tuple(numbers.get(id(end.owner), GROUND) for end in joint.bodies()) for joint in self.joints}

    @cached_property
    def _values(self) -> dict[Joint, dict[str, float]]:
        """The values of each joint: listed, guessed, or 0 by `zero=`."""
        values: dict[Joint, dict[str, float]] = {
            joint: {"angle": 0.0, "displacement": 0.0}
            for joint in self.joints
            if isinstance(joint, AxisJoint) and joint.zero is not None
        }
        for listed in (self.scene.guessed, self.scene.prescribed):
            for value in of_positions(listed):
                number = ca.Function("value", [self.scene.system.p], [value.value])(self.dae.p_nominal)
                values.setdefault(value.joint, {})[value.handle] = float(number)
        return values

    def turned_to_joint(self, q: Array, joint: AxisJoint, body: int) -> Array:
        """Coordinates after a body is turned until the joint's axes are parallel, and then turned about the axis."""
        sign = 1 if self._ends[joint][1] == body else -1
        _, A, B, *_ = self._measured(joint, q)
        if isinstance(joint, Universal):  # its two axes are perpendicular
            end = B[:, 2] - (A[:, 2] @ B[:, 2]) * A[:, 2]
            return self._turned(q, body, sign * _least_rotation(B[:, 2], end)) if np.linalg.norm(end) > SOLVED else q
        q = self._turned(q, body, sign * _least_rotation(B[:, 2], A[:, 2]))
        angle, A, B, *_ = self._measured(joint, q)
        wanted = self._values.get(joint, {}).get("angle", angle)
        # The joint locks all axes parallel, or has no angle that could be at zero.
        if joint.assembly_cosines().numel() > 1 or (joint.zero is not None and "angle" not in joint.handles):
            angle, wanted = float(np.arctan2(A[:, 1] @ B[:, 0], A[:, 0] @ B[:, 0])), 0.0
        return self._turned(q, body, sign * (wanted - angle) * A[:, 2])

    def moved_to_joint(self, q: Array, joint: Joint, body: int) -> Array:
        """Coordinates after the smallest move of a body that satisfies the rows and the displacement of a joint."""
        used = self._function(joint)[1]
        moving = [k for k in self._free_parts(body, _POSITION) if k in used]
        value, where = self._values.get(joint, {}).get("displacement"), self.dae.rows[joint.name]
        *_, r, J = self._measured(joint, q)
        n = where.stop - where.start
        r, J = (r[:n], J[:n]) if value is None else (np.append(r[:n], r[n:] - value), J)
        if not moving or not (np.isfinite(r).all() and np.isfinite(J).all()):
            return q
        q = q.copy()
        q[moving] -= np.linalg.lstsq(J[:, [used.index(k) for k in moving]], r, rcond=None)[0]
        return q

    def _measured(self, joint: Joint, q: Array) -> tuple[float, Array, Array, Array, Array]:
        """Angle, frames (3, 3), rows and displacements (m,), and their Jacobian by the coordinates in use."""
        f, used = self._function(joint)
        angle, A, B, rows, J = (part.full() for part in f(q[used], *self.at))
        return float(angle[0, 0]), A, B, rows.ravel(), J

    def _function(self, joint: Joint) -> tuple[ca.Function, list[int]]:
        """The Function of `_measured`, and the indices of the coordinates q that it uses."""
        if joint not in self._functions:
            system, angle, displacement, frames = self.scene.system, ca.SX(0), ca.SX(0), (ca.SX(3, 3), ca.SX(3, 3))
            if isinstance(joint, AxisJoint):
                frames = joint.frames
                angle = joint.angle if "angle" in joint.handles else angle
                for state in joint.turn_states:
                    angle = ca.substitute(angle, state.sx, 0)
                if "displacement" in joint.handles:
                    displacement = joint.displacement
                elif joint.zero is not None:  # points coincide, except for removed coordinates
                    known = {x.element_hash() for x in ca.vertsplit(ca.vertcat(system.q, system.s, system.p, t))}
                    parts = ca.vertsplit(joint.d)
                    seen = [d for d in parts if known.issuperset(x.element_hash() for x in ca.symvar(d))]
                    displacement = ca.vertcat(*seen, ca.SX(0, 1))
            rows = ca.vertcat(system.Phi[self.dae.rows[joint.name]], displacement)
            hashes = (x.element_hash() for x in ca.symvar(ca.veccat(angle, *frames, rows)))
            used = sorted({self._symbols[h] for h in hashes if h in self._symbols})
            parts = [angle, *frames, rows, ca.jacobian(rows, system.q[used])]
            self._functions[joint] = ca.Function("joint", [system.q[used], system.s, system.p, t], parts), used
        return self._functions[joint]

    @cached_property
    def _symbols(self) -> dict[int, int]:
        """Indices of the coordinates by the hashes of their symbols."""
        return {q.element_hash(): k for k, q in enumerate(ca.vertsplit(self.scene.system.q))}

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


def _least_rotation(start: Array, end: Array) -> Array:
    """The smallest rotation vector (3,) that turns one direction onto another."""
    axis, cosine = np.cross(start, end), float(start @ end)
    sine = float(np.linalg.norm(axis))
    if sine < SOLVED and cosine < 0:  # opposite directions: any perpendicular axis
        axis = np.cross(start, np.eye(3)[np.abs(start).argmin()])
    length = float(np.linalg.norm(axis))
    return np.asarray(axis * (np.arctan2(sine, cosine) / (length or 1.0)), dtype=np.float64)
