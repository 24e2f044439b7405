"""The equations of motion in joint coordinates."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, cast

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.declare.mechanics import (
    AxisJoint,
    Body,
    Element,
    Frame,
    Ground,
    Joint,
    Particle,
    Planar,
    RelativePose,
    Spatial,
)
from symmb.declare.symbolic import MassBlocks, Symbol, conjugate, product, rotation_by, with_nodes
from symmb.equations.model.articulated_bodies import ArticulatedBodies, Loads, Placed
from symmb.equations.model.assembly import Collected, Coordinates, stacked
from symmb.equations.model.joint_motion import JointMotion
from symmb.equations.model.spanning_tree import Carrying, Link, spanning_tree


class JointSpace:
    """A spanning tree of joints. The joint coordinates determine the coordinates of the bodies.

    Bodies without a carrying joint, flexible bodies and particles keep their own coordinates.

    Parameters
    ----------
    c : Collected              the equations in coordinates of the bodies
    elements : sequence        the elements of the system; their joints may carry bodies
    turns : mapping            name -> whole turns of body b relative to body a in planar joints without an angle
    """

    def __init__(
        self, c: Collected, elements: Sequence[Body | Element], turns: Mapping[str, int] = MappingProxyType({})
    ) -> None:
        self._bodies = c
        self._turned: list[int] = []  # bodies with quaternions of the opposite sign
        rigid = [k for k, body in enumerate(c.bodies) if not (isinstance(body.pose, Particle) or body.pose.modes)]
        counts = {name: where.stop - where.start for name, where in c.rows.items()}
        joints = [e for e in elements if isinstance(e, Joint)]
        # The rigid bodies, each after its carrier, and the indices of the remaining rows.
        self.links = _by_trees(spanning_tree(c.bodies, rigid, joints, counts, c.bind, turns))
        self.tree = ArticulatedBodies(c.bodies, self.links)
        carrying = {link.carrying.joint.name for link in self.links if link.carrying is not None}
        self.rows = [k for name, at in c.rows.items() if name not in carrying for k in range(at.start, at.stop)]
        self._others = [k for k in range(len(c.bodies)) if k not in rigid]

    def expression(self, of_bodies: ca.SX) -> ca.SX:
        """Convert an expression from body to joint coordinates. Multipliers and accelerations are not changed."""
        nodes, old, new = self._replacements
        e = ca.vertcat(ca.SX(0, 1), *[self._bodies.bodies[k].frame.q[3:7] for k in self._turned])
        return ca.substitute(ca.substitute(with_nodes(of_bodies, nodes), e, -e), old, new)

    def expressions(self, of_bodies: Sequence[ca.SX]) -> list[ca.SX]:
        """Convert expressions from body to joint coordinates. One call is faster than a call for each expression."""
        entries = [e.nz[:] for e in of_bodies]
        ends = np.cumsum([0, *[e.numel() for e in entries]]).tolist()
        parts = ca.vertsplit(self.expression(ca.vertcat(ca.SX(0, 1), *entries)), ends)
        return [ca.SX(e.sparsity(), part) for e, part in zip(of_bodies, parts, strict=True)]

    def with_signs(self, found: Array, wanted: Array) -> "JointSpace":
        """A copy with the signs of the quaternions in `wanted` (n_q,). `found` (n_q,) are this object's coordinates."""
        own = {link.body: self._bodies.slices[link.body][0] for link in self.links if link.carrying is not None}
        spatial = {k: at for k, at in own.items() if isinstance(self._bodies.bodies[k].pose, Spatial)}
        turned = [k for k, at in spatial.items() if found[at][3:7] @ wanted[at][3:7] < 0]
        other = copy(self)
        other._turned = turned
        other.__dict__.pop("of_bodies", None)
        return other

    def whole_turns(self, q: Array) -> dict[str, int]:
        """Whole turns of planar joints without an angle, by name, at body coordinates q (n_q,)."""
        bodies, excess = self._bodies.bodies, {}
        for link in self.links:
            by, body = link.carrying, bodies[link.body]
            if by is None or not isinstance(body.pose, Planar) or f"{by.joint.name}.angle" in by.motion.q_names:
                continue
            carrier = ca.SX(0) if by.carrier is None else bodies[by.carrier].frame.angle
            more = body.frame.angle - carrier - by.motion.angle
            excess[by.joint.name] = more if by.joint.point_b.body is body else -more
        if not excess:
            return {}
        angles = ca.substitute(ca.vertcat(*excess.values()), self._bodies.q, ca.SX(ca.DM(q)))
        turns = np.round(self._bodies.bind.nominal(angles).ravel() / (2 * np.pi)).astype(int).tolist()
        return {name: number for name, number in zip(excess, turns, strict=True) if number}

    @cached_property
    def _replacements(self) -> tuple[dict[int, ca.SX], ca.SX, ca.SX]:
        nodes: dict[int, ca.SX] = {}
        old, new = [ca.SX(0, 1)], [ca.SX(0, 1)]
        for link in self.links:
            if link.carrying is None:
                continue
            body, here = self._bodies.bodies[link.body], self.tree.placed[link.body]
            # Rotation matrices are replaced as a whole: products of joint rotations are shorter than their quaternions.
            q, v = _of_body(body, here)
            old += [body.frame.q, body.frame.v]
            new += [q, v]
            if isinstance(body.pose, Spatial):
                pairs = zip(*(ca.vertsplit(ca.vec(ca.densify(R))) for R in (body.frame.R, here.rotation)), strict=True)
                nodes |= {a.element_hash(): b for a, b in pairs}
            joint, motion = link.carrying.joint, link.carrying.motion
            nodes |= _handles(joint, motion)
            for state in self._turns(link):
                nodes[cast(Any, joint).angle.element_hash()] = motion.q[0]
                old, new = [*old, state.sx], [*new, motion.q[0]]
        return nodes, ca.vertcat(*old), ca.densify(ca.vertcat(*new))

    @cached_property
    def loads(self) -> Loads:
        """Inertia and forces of the rigid bodies."""
        c, numbers = self._bodies, [link.body for link in self.links]
        inertia, forces = [], []
        for k in numbers:
            S, (_, at) = c.bodies[k].frame.S, self._bodies.slices[k]
            inertia.append(S @ c.M[at, at] @ S.T)
            forces.append(S @ c.Q[at])
        moved = self.expressions([*inertia, *forces])
        M, Q = moved[: len(numbers)], moved[len(numbers) :]
        return self.tree.loads(dict(zip(numbers, M, strict=True)), dict(zip(numbers, Q, strict=True)))

    def _turns(self, link: Link) -> tuple[Symbol, ...]:
        """The states of the system that count the turns of the link's joint."""
        joint = None if link.carrying is None else link.carrying.joint
        known = {state.sx.element_hash() for state in self._bodies.states}
        states = joint.turn_states if isinstance(joint, AxisJoint) else ()
        return tuple(state for state in states if state.sx.element_hash() in known)

    @cached_property
    def _parts(self) -> list[tuple[Body | None, Coordinates]]:
        """The owner (a body, or None for a joint) and the coordinates of each link, then of each other body."""
        parts: list[tuple[Body | None, Coordinates]] = []
        for k, by in [*((link.body, link.carrying) for link in self.links), *((k, None) for k in self._others)]:
            if by is None:
                parts.append((self._bodies.bodies[k], self._own_coordinates(k)))
            else:
                m = by.motion
                parts.append((None, Coordinates(m.q, m.u, m.q_rate, m.q_names, m.u_names)))
        return parts

    def _own_coordinates(self, k: int) -> Coordinates:
        c, (at_q, at_v) = self._bodies, self._bodies.slices[k]
        return Coordinates(c.q[at_q], c.v[at_v], c.qdot[at_q], c.q_names[at_q], c.v_names[at_v])

    @cached_property
    def collected(self) -> Collected:
        """The equations in coordinates of the joints, with the mass matrix of the bodies."""
        c, kept = self._bodies, self._bodies.keeping(self.rows)
        turns = {s.sx.element_hash() for link in self.links for s in self._turns(link)}
        return replace(
            kept,
            **Coordinates.joined([own for _, own in self._parts]),
            block_sizes=(*self.tree.sizes, *(c.block_sizes[k] for k in self._others)),
            states=tuple(
                replace(s, rate=self.expression(s.rate), value=self.expression(s.value))
                for s in c.states
                if s.sx.element_hash() not in turns
            ),
            Q=stacked([self.loads.Q, *[self.expression(c.Q[self._bodies.slices[k][1]]) for k in self._others]]),
            potential=self.expression(c.potential),
            Phi=self.expression(kept.Phi),
            Psi=self.expression(kept.Psi),
            sampled=tuple((element, self.expression(law)) for element, law in c.sampled),
            impacts=tuple((name, self.expression(gap), self.expression(law)) for name, gap, law in c.impacts),
            assembly_cosines=ca.SX(0, 1),
            n_declared_rows=kept.Phi.numel(),
        )

    def retract(self, q: ca.SX, delta: ca.SX) -> ca.SX:
        """Coordinates (n_q,) after a small displacement delta (n_v,), the product of a velocity and a time. Quaternions
        keep the norm 1."""
        moved, at_q, at_v = [], 0, 0
        for body, part in self._parts:
            n_q, n_v = part.q.numel(), part.v.numel()
            if not n_v:
                continue
            own, step = q[at_q : at_q + n_q], delta[at_v : at_v + n_v]
            if body is not None:
                moved.append(body.pose.retract(own, step))
            elif n_q > n_v:  # only a spherical joint has a quaternion, and no other coordinates
                e = product(own, rotation_by(step))
                moved.append(e / ca.norm_2(e))
            else:
                moved.append(own + step)
            at_q, at_v = at_q + n_q, at_v + n_v
        return stacked(moved)

    @property
    def names(self) -> tuple[str, ...]:
        """The joints that carry bodies."""
        return tuple(link.carrying.joint.name for link in self.links if link.carrying is not None)

    @property
    def n_v(self) -> int:
        """Number of velocities."""
        return self.tree.n_v + sum(self._bodies.block_sizes[k] for k in self._others)

    @property
    def power(self) -> ca.SX:
        """Power of forces without potential, and of added or removed mass [W]."""
        return self.expression(self._bodies.power)

    @cached_property
    def M(self) -> ca.SX:
        """Mass matrix (n_v, n_v). Solvers do not form the full matrix of a long chain."""
        return ca.diagcat(self.loads.M, self._inertia_of_others)

    @cached_property
    def _inertia_of_others(self) -> ca.SX:
        at = [self._bodies.slices[k][1] for k in self._others]
        return ca.diagcat(*[self.expression(self._bodies.M[own, own]) for own in at]) if at else ca.SX(0, 0)

    def inertial(self, a: ca.SX) -> ca.SX:
        """M a (n_v,) for accelerations a (n_v,)."""
        n = self.tree.n_v
        others = [self._inertia_of_others @ a[n:]] if self._others else []
        return ca.vertcat(self.loads.inertial(a[:n]), *others)

    def solve(self, f: ca.SX, g: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Accelerations M^-1 f (n_v,) of a system without rows, and an empty vector of multipliers."""
        n = self.tree.n_v
        return ca.vertcat(self.loads.solve(f[:n]), self._of_others(f[n:])), g

    @property
    def accelerations(self) -> ca.SX:
        """Accelerations (n_v,) of a system without rows."""
        return ca.vertcat(self.loads.accelerations, self._of_others(self.collected.Q[self.tree.n_v :]))

    @cached_property
    def _of_others(self) -> MassBlocks:
        return MassBlocks(self._inertia_of_others, [self._bodies.block_sizes[k] for k in self._others])

    @cached_property
    def of_bodies(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Coordinates, velocities and states in body coordinates, as expressions of joint coordinates."""
        c = self._bodies
        s = ca.vertcat(*[state.sx for state in c.states]) if c.states else ca.SX(0, 1)
        return self.expression(c.q), self.expression(c.v), self.expression(s)

    @cached_property
    def of_joints(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Coordinates, velocities and states in joint coordinates, as expressions of body coordinates."""
        measured = [
            self._own_coordinates(link.body)[:2]
            if link.carrying is None
            else _measured(self._bodies.bodies, link, link.carrying, bool(self._turns(link)))
            for link in self.links
        ]
        measured += [self._own_coordinates(k)[:2] for k in self._others]
        q, v = ([of[k] for of in measured] for k in range(2))
        return stacked(q), stacked(v), stacked([state.sx for state in self.collected.states])


def _by_trees(links: Sequence[Link]) -> tuple[Link, ...]:
    """Links sorted by tree. In each tree, every link comes after its carrier."""
    root: dict[int | None, int | None] = {None: None}
    for link in links:
        carrier = None if link.carrying is None else link.carrying.carrier
        root[link.body] = link.body if carrier is None else root[carrier]
    first = list(dict.fromkeys(root[link.body] for link in links))
    return tuple(sorted(links, key=lambda link: first.index(root[link.body])))


def _handles(joint: Joint, motion: JointMotion) -> dict[int, ca.SX]:
    """Joint coordinates and velocities by hashes of the joint's handles, which they replace in expressions."""
    nodes: dict[int, ca.SX] = {}
    names, values = (*motion.q_names, *motion.u_names), ca.vertsplit(ca.vertcat(motion.q, motion.u))
    for name, value in zip(names, values, strict=True):
        node = vars(joint).get(name.rpartition(".")[2])  # a cached property, present only after its first use
        if node is not None:
            nodes[node.element_hash()] = value
            if node.op() == ca.OP_NEG:  # CasADi simplifies a - (-b)
                nodes[node.dep(0).element_hash()] = -value
    return nodes


def _of_body(body: Body, here: Placed) -> tuple[ca.SX, ca.SX]:
    """Coordinates and velocities of a body from its position and motion."""
    if isinstance(body.pose, Planar):
        return ca.vertcat(here.r[:2], here.angle), ca.vertcat(here.r_dot[:2], here.omega[2])
    return ca.vertcat(here.r, here.quaternion), ca.vertcat(here.r_dot, here.omega)


def _measured(bodies: Sequence[Body], link: Link, by: Carrying, counts_turns: bool) -> tuple[ca.SX, ca.SX]:
    """Coordinates and velocities of a joint, as expressions of the coordinates of the connected bodies."""
    motion, follower = by.motion, bodies[link.body].frame
    carrier = Ground().frame if by.carrier is None else bodies[by.carrier].frame
    A, B = carrier.R @ motion.carrier, follower.R @ motion.follower
    shift = A.T @ (follower.r + follower.R @ by.on_body - carrier.r - carrier.R @ by.on_carrier)
    turn = A.T @ B
    planar = isinstance(bodies[link.body].pose, Planar)
    own = ca.SX(4, 1) if planar else product(follower.q[3:7], motion.follower_quaternion)
    e = _quaternion(carrier)
    relative = product(conjugate(product(e, motion.carrier_quaternion)), own)
    q = motion.measured(RelativePose(shift, turn, relative, follower.angle - carrier.angle if planar else None))
    if counts_turns:
        q[0] = cast(Any, by.joint).angle
    foot = carrier.velocity + carrier.R @ ca.cross(carrier.omega, by.on_carrier)
    tip = follower.velocity + follower.R @ ca.cross(follower.omega, by.on_body)
    spin = motion.carrier.T @ carrier.omega
    speed = A.T @ (tip - foot) - ca.cross(spin, shift)
    v = motion.rates(speed, motion.follower.T @ follower.omega - turn.T @ spin)
    return q, ca.substitute(v, motion.q, q)


def _quaternion(frame: Frame) -> ca.SX:
    """The quaternion (4,) of the frame of a spatial body, a planar body or the ground."""
    if frame.q.numel() > 3:
        return frame.q[3:7]
    return ca.vertcat(ca.cos(frame.angle / 2), 0, 0, ca.sin(frame.angle / 2))
