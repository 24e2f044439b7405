"""Velocities at the start: relative joint rates that nothing determines are zero.

Velocities are computed along the tree of joints for groups of bodies. A group is a single body, or the bodies of loops
with common joints. A group moves rigidly with the body that carries it, unless listed velocities or drives forbid this.
In that case the group deviates from this motion by the velocities d that have the smallest kinetic energy d' M d / 2
with G (v + d) + Phi_t = 0. If no such velocities d exist, the group and the group of its carrier deviate together. All
choices are made once, at the nominal parameters. Flywheels come last, because the mechanism turns them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from symmb._magnitudes import NOTHING
from symmb._types import Array, Indices
from symmb.declare.mechanics import AbstractBody, Flywheel, Joint, Planar
from symmb.declare.symbolic import common, is_singular, is_zero, pattern, saddle_solver
from symmb.equations.model import DAE, Scene
from symmb.equations.start.joint_tree import GROUND, Group, JointTree
from symmb.equations.start.rank import strong_rows
from symmb.equations.start.residual_limits import SOLVED, VIOLATION
from symmb.equations.start.scales import evaluate_at_rest, jacobian_at_rest, resting


def start_velocities(
    scene: Scene, dae: DAE, listed: Mapping[int, ca.SX], at: tuple[Array, Array], t0: float
) -> ca.Function:
    """Velocities at the start as a Function (q, p) -> v.

    `listed` velocities (by index) are kept. `at` are assembled coordinates (k, n_q) for k sets of parameters (k,
    n_p); the nominal set is the first.
    """
    rates = _Rates(scene, dae, listed, at, t0)
    if scene.restart is not None:
        v = rates.kept(scene.restart.v)
        return common("velocities", [rates.q, rates.p], [ca.densify(v)])
    tree = JointTree(rates.connected, rates.roots)
    # Each failure joins two groups, so that the loop ends at the latest with a single group.
    while (v := _along(tree, rates)) is None:
        pass
    return common("velocities", [rates.q, rates.p], [ca.densify(v)])


def _along(tree: JointTree, rates: "_Rates") -> ca.SX | None:
    """Velocities of all bodies (n_v,); None if a group was joined with the group of its carrier."""
    v = ca.SX(rates.dae.n_v, 1)
    for group in sorted(tree.groups(), key=lambda group: not rates.flywheels.isdisjoint(group.bodies)):
        moved = rates.moved(v, group)
        if moved is None:
            tree.join(group)
            return None
        v = moved
    return v


@dataclass(frozen=True, eq=False)
class _Rates:
    """The rates of the constraints at the start, G v + Phi_t, and the bodies of each row."""

    scene: Scene
    dae: DAE
    listed: Mapping[int, ca.SX]
    at: tuple[Array, Array]
    t0: float

    @property
    def q(self) -> ca.SX:
        return self.scene.system.q

    @property
    def p(self) -> ca.SX:
        return self.scene.system.p

    @cached_property
    def body_of(self) -> Indices:
        """The index of the body of each velocity, (n_v,)."""
        sizes = self.scene.system.block_sizes
        return np.repeat(np.arange(len(sizes)), sizes)

    @property
    def roots(self) -> list[int]:
        """The bodies in the order of their number of listed velocities, the largest number first."""
        counts = np.bincount(self.body_of[list(self.listed)], minlength=len(self.scene.system.bodies))
        return np.argsort(-counts, kind="stable").tolist()

    @cached_property
    def G(self) -> ca.SX:
        if self.dae.G is None:
            return ca.SX(0, self.dae.n_v)
        return self.dae.G(*resting(self.dae, self.q, self.p), self.p, self.t0)

    @cached_property
    def G_nominal(self) -> Array:
        return jacobian_at_rest(self.dae, self.at[0][0], self.t0)

    @cached_property
    def drive(self) -> ca.SX:
        """Rates of the rows at rest, Phi_t, (n_r,)."""
        if self.dae.Phi_dot is None:
            return ca.SX(0, 1)
        return ca.sparsify(self.dae.Phi_dot(*resting(self.dae, self.q, self.p), self.p, self.t0))

    @cached_property
    def M(self) -> ca.SX:
        return self.dae.M(*resting(self.dae, self.q, self.p), self.p, self.t0)

    @cached_property
    def M_nominal(self) -> Array:
        return evaluate_at_rest(self.dae.M, self.dae, self.at[0][0], self.t0)

    @cached_property
    def connected(self) -> list[frozenset[int]]:
        """The bodies of each row. The ground is included if a common rigid motion of the bodies changes the row.

        A row with a flywheel restricts only the flywheel.
        """
        there = pattern(self.G.sparsity())
        bodies = self.scene.system.bodies
        if not there.size:
            return []
        rigid = ca.vertcat(*[self._rigid(k, ca.SX(3, 1)) for k in range(len(bodies))])
        scales = self.dae.displacement_scales
        R = ca.Function("rigid", [self.q], [rigid])(self.at[0][0]).full() / scales[:, None]
        size = np.abs(R).max(axis=0)
        connected = []
        for row, touched in zip(self.G_nominal * scales, there, strict=True):
            numbers = frozenset(self.body_of[touched].tolist())
            if flywheels := numbers & self.flywheels:
                connected.append(flywheels)
                continue
            # A planar body has no velocities out of its plane, so rigid motions out of the plane do not count.
            motions = [0, 1, 5] if any(isinstance(bodies[k].pose, Planar) for k in numbers) else slice(None)
            own, along = row[touched], R[touched][:, motions]
            is_relative = bool((np.abs(own @ along) <= SOLVED * np.abs(own).sum() * size[motions]).all())
            connected.append(numbers if is_relative else numbers | {GROUND})
        return connected

    @cached_property
    def flywheels(self) -> frozenset[int]:
        """The indices of the flywheels."""
        return frozenset(k for k, body in enumerate(self.scene.system.bodies) if isinstance(body, Flywheel))

    @cached_property
    def _rows_of(self) -> list[list[int]]:
        """The rows that restrict each body."""
        rows: list[list[int]] = [[] for _ in self.scene.system.bodies]
        for i, bodies in enumerate(self.connected):
            for body in bodies - {GROUND}:
                rows[body].append(i)
        return rows

    def kept(self, v: Array) -> ca.SX:
        """Velocities (n_v,) that satisfy listed values and rows. The change from v has the smallest kinetic energy."""
        all_columns = list(range(self.dae.n_v))
        begin = ca.vertcat(*[self.listed.get(i, ca.SX(v[i])) for i in all_columns]) if all_columns else ca.SX(0, 1)
        free = [i for i in all_columns if i not in self.listed]
        return self._deviated(begin, list(range(self.dae.n_r)), all_columns, free, 0.0)

    def moved(self, v: ca.SX, group: Group) -> ca.SX | None:
        """Velocities v (n_v,) with new velocities of a group; None if the constraints require another motion of the
        base."""
        members = frozenset(group.bodies)
        columns = np.flatnonzero(np.isin(self.body_of, group.bodies)).tolist()
        near = sorted({i for body in members for i in self._rows_of[body]})
        rows = [i for i in near if self.connected[i] <= members | {group.base}]
        listed = [i for i in columns if i in self.listed]
        v = ca.SX(v)
        v[columns] = self._carried(v, group)
        if not listed and is_zero(self.drive[rows]) and not members & self.flywheels:
            return v
        for i in listed:
            v[i] = self.listed[i]
        if not rows:
            return v
        free = [i for i in columns if i not in self.listed]
        # Below this singular value, listed velocities and drives would turn a joint very fast. Then the carrier moves
        # too.
        deviated = self._deviated(v, rows, columns, free, weak=1e-2)
        if self._holds(deviated, rows):
            return deviated
        # The ground cannot move, so that a group on the ground takes any velocity. Later checks report contradictions.
        return None if group.base != GROUND else self._deviated(v, rows, columns, free, 0.0)

    def _carried(self, v: ca.SX, group: Group) -> ca.SX:
        """Velocities of a group that moves rigidly with its base."""
        if group.base == GROUND or is_zero(v):
            return ca.SX(int(np.isin(self.body_of, group.bodies).sum()), 1)
        bodies = self.scene.system.bodies
        frame = self._carrier(bodies[group.base], {bodies[k] for k in group.bodies}).frame
        own = np.flatnonzero(self.body_of == group.base).tolist()
        twist = ca.vertcat(frame.velocity, frame.R @ frame.omega)
        twist = self._without_untouched(ca.substitute(twist, self.scene.system.v[own], ca.densify(v[own])))
        return ca.vertcat(*[self._rigid(k, frame.r) @ twist for k in group.bodies])

    def _carrier(self, base: AbstractBody, members: set[AbstractBody]) -> AbstractBody:
        """The part of the base that a joint connects with the members: the body, or a node of a flexible body."""
        for joint in self.scene.system.elements:
            if isinstance(joint, Joint):
                a, b = joint.bodies()
                for near, far in ((a, b), (b, a)):
                    if near.owner is base and far.owner in members:
                        return near
        return base

    def _rigid(self, k: int, about: ca.SX) -> ca.SX:
        """Matrix (n, 6): velocities of a body for the velocity of the point `about` and the angular velocity, in world
        axes."""
        body = self.scene.system.bodies[k]
        twist = ca.blockcat([[ca.SX.eye(3), -ca.skew(body.frame.r - about)], [ca.SX(3, 3), body.frame.R.T]])
        known = [i for i, part in enumerate(body.pose.velocities) if f"{body.name}.{part}" in self.dae.v_names]
        return self._without_untouched((body.frame.rigid @ twist)[known, :])

    def _without_untouched(self, expression: ca.SX) -> ca.SX:
        """An expression without coordinates on which no element acts."""
        for _, x, _, vx in self.scene.system.collected.decoupled:
            expression = ca.substitute(expression, ca.vertcat(x, vx), ca.SX.zeros(2, 1))
        return expression

    def _deviated(self, v: ca.SX, rows: list[int], columns: list[int], free: list[int], weak: float) -> ca.SX:
        """Velocities v that satisfy the rows. The change of the `free` velocities has the smallest kinetic energy."""
        independent = [rows[i] for i in strong_rows(self._unit_rows(rows, columns, free), weak)]
        if not independent:
            return v
        sizes = self._sizes(free)
        solve = saddle_solver(self._metric(independent, free, sizes), self.G[independent, free], sizes)
        for _ in range(2):  # the second step removes rounding near singular positions
            v = ca.SX(v)
            rate = self.G[independent, :] @ v + self.drive[independent]
            v[free] += solve(ca.SX(len(free), 1), -rate)[0]
        return v

    def _sizes(self, columns: list[int]) -> list[int]:
        """Number of velocities of each body among `columns`."""
        return np.unique(self.body_of[columns], return_counts=True)[1].tolist()

    def _unit_rows(self, rows: list[int], columns: list[int], free: list[int]) -> Array:
        """Rows for the free velocities in the metric of kinetic energy, with norm 1 over all velocities of the
        group."""
        root = [self._root(part) for part in (columns, free)]
        whole, own = (self.G_nominal[np.ix_(rows, part)] @ r for part, r in zip((columns, free), root, strict=True))
        norm = np.linalg.norm(whole, axis=1, keepdims=True)
        return own / np.where(norm > 0, norm, 1.0)

    def _root(self, columns: list[int]) -> Array:
        """Matrix W with W W' = M^-1 for velocities in `columns`; diagonal with their scales if a body has no mass."""
        if is_singular(self.M[columns, columns], self._sizes(columns)):
            return np.diag(self.dae.displacement_scales[columns])
        values, vectors = np.linalg.eigh(self.M_nominal[np.ix_(columns, columns)])
        # A later check reports values that are not positive.
        return vectors / np.sqrt(np.maximum(np.abs(values), NOTHING))

    def _metric(self, rows: list[int], free: list[int], sizes: list[int]) -> ca.SX:
        """The mass matrix if it determines all velocities; otherwise the diagonal matrix of 1 / scale^2."""
        M, scales = self.M[free, free], self.dae.displacement_scales[free]
        if not is_singular(M, sizes):
            return M
        # The rows may determine the massless velocities. Then M is positive for the free motions.
        left = np.linalg.svd(self.G_nominal[np.ix_(rows, free)] * scales)[2][len(rows) :]
        inertia = self.M_nominal[np.ix_(free, free)] * np.outer(scales, scales)
        energies = np.linalg.eigvalsh(left @ inertia @ left.T)
        if len(left) and energies.min() > SOLVED * inertia.max():
            return M
        return ca.SX(ca.DM(np.diag(1 / scales**2)))

    def _holds(self, v: ca.SX, rows: list[int]) -> bool:
        """Whether velocities satisfy rows."""
        rate, drive = self.G[rows, :] @ v, self.drive[rows]
        size = ca.fabs(self.G[rows, :]) @ ca.fabs(v) + ca.fabs(drive)
        limit = VIOLATION * size + SOLVED * ca.mmax(size)  # for rows with terms that are rounding of other rows
        excess = ca.Function("excess", [self.q, self.p], [ca.densify(ca.fabs(rate + drive) - limit)])
        return all(excess(q, p).full().max(initial=0.0) <= 0 for q, p in zip(*self.at, strict=True))
