"""The start of a scene at the nominal parameters, and the choice of unknowns for all samples."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import casadi as ca
import numpy as np

from symmb._errors import AssemblyError
from symmb._magnitudes import NOTHING, SLIGHT
from symmb._types import Array, Indices, Mask
from symmb.declare.mechanics import Constraint, is_flexible
from symmb.declare.symbolic import batch, shared
from symmb.equations import start as starts
from symmb.equations.model import DAE, Scene
from symmb.equations.start.assembly import assemble, listed_coordinates
from symmb.equations.start.consistency import check_accelerations, check_velocities
from symmb.equations.start.doubts import start_doubts
from symmb.equations.start.implicit_function import ImplicitMap
from symmb.equations.start.joint_tree import GROUND, JointTree
from symmb.equations.start.joint_values import (
    of_positions,
    of_rates,
    residuals,
    with_position_rows,
    with_rate_rows,
    with_states,
)
from symmb.equations.start.labels import coordinate_of, coordinate_with_value
from symmb.equations.start.rank import independent_rows, independent_rows_and_columns, lasting_rows, redundant_names
from symmb.equations.start.residual_limits import VIOLATION
from symmb.equations.start.scales import general_entries, jacobian_at_rest, resting, row_sizes, with_coarse_scales
from symmb.equations.start.start import Start, start_functions
from symmb.equations.start.velocities import start_velocities


def prepare_start(scene: Scene, dae: DAE) -> Start:
    """Compute the start at the nominal parameters, and choose the unknowns for all samples.

    Raises AssemblyError if listed values contradict the constraints, if no assembly is found near the guess, if a joint
    is assembled the wrong way round, or if the start is a singular position.
    """
    prescribed, system = scene.prescribed, scene.system
    t0, p0 = float(np.asarray(scene.times)[0]), dae.p_nominal
    begin = t0 if scene.restart is None else scene.restart.first_instant
    dae = dae if dae.sampling is None else replace(dae, sampling=replace(dae.sampling, begin=begin))
    reference = listed_coordinates(scene, dae)
    free = np.setdiff1d(np.arange(dae.n_v), list(prescribed.displacements)).astype(np.intp)
    q0, s0 = assemble(scene, dae, t0)
    rows = _Rows(with_coarse_scales(with_states(scene, dae, s0), q0, t0), q0, t0)
    dae = rows.dae
    try:
        independent = independent_rows(dae, q0, t0, rows.sizes)
    except AssemblyError as error:
        # Rigid connections between nodes look like a singular position, but have another cause and remedy.
        raise AssemblyError(" ".join(_unstretched(scene)) or str(error)) from None
    placed = rows.extended(with_position_rows(system, dae, of_positions(prescribed)))
    moved = rows.extended(with_rate_rows(system, dae, of_rates(prescribed)))
    positions = _solve_positions(scene, placed, reference, free)
    velocities = start_velocities(scene, moved.dae, prescribed.v, _probes(positions, p0), t0)
    free_velocities = np.setdiff1d(np.arange(dae.n_v), list(prescribed.v)).astype(np.intp)
    determined = independent_rows_and_columns(moved.G[:, free_velocities], moved.sizes)[1]
    v0 = velocities(positions.q0, p0).full().ravel() + 0.0  # turns -0.0 into 0.0
    left = np.delete(free_velocities, determined)
    redundancy = _redundancy(rows, independent)
    lost = _only_nominal(scene, rows, positions, redundancy["redundant"], len(independent))
    of_joints = residuals(scene)
    v = velocities(positions.q, system.p)
    state, holds = start_functions(dae, t0, positions.unknowns, positions.q, v, of_joints, ca.SX(0, 1))
    start = Start(
        dae,
        t0,
        positions.q0,
        reference,
        positions.position,
        state,
        holds,
        velocities,
        listed=tuple(scene.start),
        listed_velocities=(*(dae.v_names[i] for i in prescribed.v), *(value.name for value in of_rates(prescribed))),
        joint_residuals=of_joints,
        joint_values=tuple(value.name for value in prescribed.joints),
        solved=tuple(coordinate_of(dae, i) for i in positions.solved),
        free=tuple(coordinate_with_value(dae, i, positions.q0) for i in np.setdiff1d(free, positions.solved).tolist()),
        solved_velocities=tuple(dae.v_names[i] for i in free_velocities[determined]),
        free_velocities=tuple(f"{dae.v_names[i]} = {v0[i]:.6g}" for i in left),
        is_equilibrium=scene.equilibrium,
        doubts=(*start_doubts(scene, dae, positions.q0, v0, t0, independent, left), *lost),
        held=tuple(np.setdiff1d(np.arange(dae.n_v), positions.solved).tolist()),
        **redundancy,
    )
    check_velocities(start, p0)
    check_accelerations(start, rows.G, rows.sizes)
    return start


def with_gated_rows(start: Start, dae: DAE, gated: Collection[str]) -> Start:
    """A start for scenes in which the joints `gated` open or close in a run.

    The start keeps all rows of these joints, and independent rows of the other constraints. Rows of gated joints may
    depend on the other rows.
    """
    own = start.dae
    dae = replace(dae, s_rest=own.s_rest, s_start=own.s_start, sampling=own.sampling)
    rows = _Rows(with_coarse_scales(dae, start.q_nominal, start.t0), start.q_nominal, start.t0)
    lasting = [k for name, at in dae.rows.items() if name not in gated for k in range(at.start, at.stop)]
    kept, _ = independent_rows_and_columns(rows.G[lasting])
    every = np.setdiff1d(np.arange(dae.n_r), np.delete(lasting, kept))
    return replace(start, dae=rows.dae, rows=tuple(every.tolist()), nullities=(0, 0))


@dataclass(frozen=True, eq=False)
class _Rows:
    """The rows of a DAE at coordinates q (n_q,) and the time t0."""

    dae: DAE
    q: Array
    t0: float

    def extended(self, dae: DAE) -> "_Rows":
        """The rows of another DAE, which may have additional rows, at the same coordinates and time."""
        return self if dae is self.dae else _Rows(with_coarse_scales(dae, self.q, self.t0), self.q, self.t0)

    @cached_property
    def general(self) -> Array:
        """General sizes of the entries of the velocity Jacobian, (n_r, n_v)."""
        return general_entries(self.dae, self.q, self.t0)

    @cached_property
    def G(self) -> Array:
        """The velocity Jacobian in the scales of displacements, (n_r, n_v)."""
        return jacobian_at_rest(self.dae, self.q, self.t0) * self.dae.displacement_scales

    @cached_property
    def sizes(self) -> Array:
        """The sizes of the rows of G, (n_r,)."""
        return row_sizes(self.G, self.general * self.dae.displacement_scales)


def _unstretched(scene: Scene) -> Iterator[str]:
    """Warnings about flexible bodies in which no mode changes the distance between two nodes with joints."""
    joints = [element for element in scene.system.elements if isinstance(element, Constraint)]
    for body in scene.system.bodies:
        if not is_flexible(body) or not len(body.modes.stiffness):
            continue
        carriers = [carrier for joint in joints for carrier in joint.bodies()]
        held = sorted({n for carrier in carriers if (n := body.number_of(carrier)) is not None})
        shapes, places = body.modes.shapes, body.modes.positions
        for a, b in combinations(held, 2):
            line = (places[b] - places[a]) / max(float(np.linalg.norm(places[b] - places[a])), NOTHING)
            if np.abs(line @ (shapes[b] - shapes[a])).max() <= SLIGHT * np.abs(shapes).max():
                yield (
                    f"FlexibleBody {body.name!r}: joints hold the nodes {a} and {b}, but no mode changes the distance "
                    f"between these nodes. Compute the modes with interfaces=[{a}, {b}] (without a clamped node) and "
                    "with all interface modes."
                )
                break


def _redundancy(rows: _Rows, independent: Indices) -> dict[str, Any]:
    """The fields of `Start` that describe redundant rows."""
    dae, rank = rows.dae, len(independent)
    if rank == dae.n_r:
        return {"ranks": (rank, dae.n_c), "rows": None, "nullities": (0, 0), "redundant": ()}
    position_rows, _ = independent_rows_and_columns(rows.G[: dae.n_c], rows.sizes[: dae.n_c])
    sufficient, nullities = lasting_rows(dae, rows.q, rows.t0, independent, rows.general)
    return {
        "ranks": (rank, len(position_rows)),
        "rows": tuple(sufficient.tolist()),
        "nullities": nullities,
        "redundant": redundant_names(rows.G / rows.sizes[:, None], rank, dae.rows),
    }


def _only_nominal(scene: Scene, at: _Rows, positions: "_Positions", names: tuple[str, ...], rank: int) -> Iterator[str]:
    """The warning that constraints with these names are redundant at the nominal parameters, but not in the box."""
    dae = at.dae
    if not names or scene.box is None or dae.Phi is None:
        return
    p, bounds = dae.p_nominal.copy(), np.array(scene.box.bounds)
    varied = [dae.p_names.index(name) for name in scene.box.names]
    p[varied] = bounds[:, 0] + np.random.default_rng(0).uniform(size=len(varied)) * (bounds[:, 1] - bounds[:, 0])
    (q,), (is_solved,) = positions.at(p[None])
    if not is_solved:
        return
    there = _Rows(replace(dae, p_nominal=p), q, at.t0)
    state = [ca.SX(ca.DM(part)) for part in (q, p)]
    r = np.asarray(ca.evalf(dae.Phi(*resting(dae, *state), state[1], at.t0))).ravel() / dae.row_scales[: dae.n_c]
    limit = VIOLATION * max(float(np.abs(q / dae.coordinate_scales).max(initial=0.0)), 1.0)
    if np.abs(r).max(initial=0.0) > limit:
        then = "there the constraints contradict each other, and runs do not start"
    elif len(independent_rows_and_columns(there.G, there.sizes)[0]) > rank:
        then = "there the constraints leave fewer degrees of freedom, but runs use the nominal number"
    else:
        return
    where = ", ".join(f"{dae.p_names[k]} = {p[k]:.6g}" for k in varied)
    yield (
        f"Constraints {', '.join(map(repr, names))} are redundant at the nominal parameters, but not at {where}: "
        f"{then}. Remove one of these constraints, or declare points and axes that fit for all parameters."
    )


@dataclass(frozen=True, eq=False)
class _Positions:
    """Coordinates q0 (n_q,), the unknown displacements, and coordinates q (n_q,) as expressions of unknowns u and p."""

    q0: Array
    solved: Indices
    unknowns: tuple[ca.SX, ca.SX]
    q: ca.SX
    position: ImplicitMap

    def at(self, P: Array) -> tuple[Array, Mask]:
        """Coordinates (N, n_q) for parameters P (N, n_p), and whether the solution converged (N,)."""
        u, ok = self.position.solve(P)
        return batch(ca.Function("place", [*self.unknowns], [self.q]), u, P)[0], ok


def _probes(positions: _Positions, p0: Array, distance: float = 1e-2) -> tuple[Array, Array]:
    """Start coordinates (k, n_q) at the nominal and at neighbouring parameters, and these parameters (k, n_p)."""
    # Decisions on velocities must also be valid near the nominal parameters: a listed speed may be 0 only there.
    near = np.random.default_rng(0).uniform(-distance, distance, p0.shape) * np.where(p0 != 0, p0, 1.0)
    P = np.stack([p0, p0 + near]) if p0.size else p0[None]
    q, ok = positions.at(P)
    ok[0] = True  # later checks report faults of the nominal start
    return q[ok], P[ok]


def _weights_by_distance(scene: Scene, at: _Rows) -> Array:
    """Weights (n_v,) of displacements, from 1 to 2. They increase with the number of joints between body and ground.

    In samples, bodies near the ground keep their places where constraints allow it, as in the nominal assembly. Bodies
    that they carry move.
    """
    sizes = scene.system.block_sizes
    body_of = np.repeat(np.arange(len(sizes)), sizes)
    touched = (frozenset(body_of[row != 0].tolist()) for row in at.G[: at.dae.n_c])
    tree = JointTree((own | {GROUND} if len(own) == 1 else own for own in touched), range(len(sizes)))
    depths = {GROUND: 0}
    for body, carrier in tree.carriers.items():
        depths[body] = depths[carrier] + 1
    own = np.array([depths[body] for body in range(len(sizes))])
    return 1.0 + (own / own.max(initial=1))[body_of]


def _solve_positions(scene: Scene, at: _Rows, reference: ca.Function, free: Indices) -> _Positions:
    """Choose the unknown displacements: one for each independent row, or all free displacements for an equilibrium."""
    p, dae, q0, t0 = scene.system.p, at.dae, at.q, at.t0
    near = at.G[: dae.n_c, free] * _weights_by_distance(scene, at)[free]
    rows, columns = independent_rows_and_columns(near, at.sizes[: dae.n_c])
    solved, lam0, stiffness = free[columns], np.empty(0), 1.0
    if scene.equilibrium:
        solved = free
        q0, lam0, stiffness = starts.find_equilibrium(dae, q0, t0, free, rows)
    u = ca.SX.sym("u", len(solved))
    places = ca.Sparsity.triplet(dae.n_v, len(solved), solved.tolist(), list(range(len(solved))))
    delta = ca.SX(ca.DM(places, dae.displacement_scales[solved])) @ u
    (q,) = shared([dae.retract(reference(p, ca.DM(q0)), delta)])
    if scene.equilibrium:
        # Newton's method ends if displacements are small. Multipliers divided by the stiffness have a similar size.
        share = ca.SX.sym("share", len(rows))
        z, lam = ca.vertcat(u, share), ca.SX(ca.DM(lam0)) + stiffness * share
        residual = starts.imbalance(dae, q, lam, p, t0, free, rows)
    else:
        z, residual = u, ca.SX(0, 1)
        if len(solved) and dae.Phi is not None:
            residual = (dae.Phi(*resting(dae, q, p), p, t0) / dae.row_scales[: dae.n_c])[rows.tolist()]
    return _Positions(q0, solved, (z, p), q, ImplicitMap.of(residual, z, p))
