"""The start of a scene in joint coordinates."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np

from symmb._magnitudes import SLIGHT
from symmb._types import Array, Indices
from symmb.declare.mechanics import Spatial
from symmb.declare.symbolic import common, conjugate, product, shared
from symmb.equations.model import DAE, Scene, System, compile_dae, is_linear
from symmb.equations.start.assembly import drive_rows
from symmb.equations.start.gauss_newton import with_fewest_turns
from symmb.equations.start.implicit_function import ImplicitMap
from symmb.equations.start.rank import independent_rows_and_columns, lasting_rows
from symmb.equations.start.residual_limits import SOLVED
from symmb.equations.start.scales import (
    evaluate_at_rest,
    general_entries,
    jacobian_at_rest,
    own_scales,
    resting,
    row_sizes,
    with_coarse_scales,
)
from symmb.equations.start.start import Start, start_functions


def start_in_joints(start: Start, scene: Scene, joints: System) -> Start | None:
    """The start in joint coordinates for the system `joints`, from the start of the bodies.

    Returns None if the loop rows are close to singular in joint coordinates.
    """
    bodies, p = scene.system, scene.system.p
    x = ca.vertcat(bodies.q, bodies.v, bodies.s)
    measured = common("measured", [x, p], [ca.densify(ca.vertcat(*joints.joints.of_joints))])
    states, (fault,) = start.states(start.dae.p_nominal[None])
    q0 = measured(states[0], start.dae.p_nominal).full().ravel()[: joints.q.numel()]
    q0 = _with_listed_turns(scene, joints, q0, start.dae.p_nominal)
    dae = _with_independent_rows(start, joints, q0)
    if dae is None:
        return None
    q0 = _with_driven_turns(dae, drive_rows(scene, dae), q0, start.t0)
    if dae.sampling is not None and start.dae.sampling is not None:
        dae = replace(dae, sampling=replace(dae.sampling, begin=start.dae.sampling.begin))
    solved = None if start.is_equilibrium or fault else _solved(start, scene, joints, dae, measured, q0)
    if solved is not None:
        return solved
    u, y = ca.SX.sym("u", start.state.numel_in(0)), ca.SX.sym("x", measured.numel_out(0))
    state = start.state(u, p)
    return replace(
        start,
        dae=dae,
        q_nominal=q0,
        state=common("state", [u, p], [measured(state, p)]),
        holds=ca.Function("holds", [y, u, p], [start.holds(state, u, p)]),
    )


def _with_listed_turns(scene: Scene, joints: System, q: Array, p: Array) -> Array:
    """Coordinates q (n_q,) in which listed angles have the listed number of turns at parameters p (n_p,)."""
    q, names = q.copy(), joints.collected.q_names
    for value in scene.prescribed.joints:
        if value.name in names and not is_linear(value.name):
            k = names.index(value.name)
            listed = float(ca.Function("listed", [scene.system.p], [value.value])(p))
            q[k] += math.tau * round((listed - q[k]) / math.tau)
    return q


def _with_driven_turns(dae: DAE, rows: Indices, q: Array, t0: float) -> Array:
    """Coordinates q (n_q,) with the number of turns of each angle that minimises the violation of rows of drives."""
    if dae.Phi is None or not rows.size:
        return q
    Phi, angles = dae.Phi, [k for k, name in enumerate(dae.q_names) if name.endswith(".angle")]
    return with_fewest_turns(q, angles, lambda q: evaluate_at_rest(Phi, dae, q, t0).ravel()[rows], SLIGHT)


def _with_independent_rows(start: Start, joints: System, q: Array) -> DAE | None:
    """The equations with coarse scales and with independent loop rows only.

    The rank of all rows is known from the start of the bodies. The rank of the loop rows is this rank minus the number
    of rows of carrying joints, because rows of carrying joints are independent. Returns None if the loop rows do not
    have this rank at q (n_q,).
    """
    t0, space, bodies = start.t0, joints.joints, start.dae
    dae = with_coarse_scales(compile_dae(joints), q, t0)
    rank = start.ranks[0] - (bodies.n_v - dae.n_v)
    if dae.G is None or rank == dae.n_r:
        return dae
    carried = ca.jacobian(space.of_bodies[1], joints.v)
    along = ca.Function("along", [joints.q, joints.p], [carried])(q, dae.p_nominal).full()
    loops = general_entries(bodies, start.q_nominal, t0)[space.rows]
    general = loops @ np.abs(along)  # sums without cancellation
    scales = dae.displacement_scales
    G = jacobian_at_rest(dae, q, t0) * scales
    sizes = row_sizes(G, general * scales)
    if np.linalg.matrix_rank(G / sizes[:, None], tol=SOLVED * max(G.shape)) < rank:
        return None
    rows, _ = independent_rows_and_columns(G, sizes, rank)
    sufficient, nullities = lasting_rows(dae, q, t0, rows, general)
    return with_coarse_scales(compile_dae(joints, sufficient.tolist(), nullities), q, t0)


def _solved(start: Start, scene: Scene, joints: System, dae: DAE, measured: ca.Function, q0: Array) -> Start | None:
    """A start that is computed in joint coordinates.

    Listed and constant displacements of bodies are held. These displacements and the loop rows determine the joint
    coordinates. Returns None if they do not suffice, for example close to singular positions.
    """
    bodies, space, p = scene.system, joints.joints, scene.system.p
    p_nominal = start.dae.p_nominal
    of_bodies = ca.Function("of_bodies", [joints.q, p], [space.of_bodies[0]])
    u, scales = ca.SX.sym("u", dae.n_v), dae.displacement_scales
    (q,) = shared([dae.retract(ca.DM(q0), ca.DM(scales) * u)])
    q_b = of_bodies(q, p)
    moved = _displacement(bodies, start.reference(p, ca.DM(start.q_nominal)), q_b)
    held = list(start.held)
    listed = (moved / start.dae.displacement_scales)[held]
    if start.joint_residuals is not None:
        listed = ca.vertcat(listed, *_values(scene, joints, q, q_b))
    loops = (
        dae.Phi(*resting(dae, q, p), p, start.t0) / dae.row_scales[: dae.n_c] if dae.Phi is not None else ca.SX(0, 1)
    )
    rows = ca.vertcat(listed, loops)
    slopes = ca.Function("slopes", [u, p], [ca.jacobian(rows, u)])(np.zeros(dae.n_v), p_nominal).full()
    lengths = (own_scales(start.dae, start.q_nominal, start.t0) / start.dae.displacement_scales)[held]
    chosen = _sufficient(slopes, lengths, listed.numel())
    if len(chosen) < dae.n_v:
        return None
    others = [k for k in range(listed.numel()) if k not in chosen]

    def of_bodies_at(q: ca.SX) -> ca.SX:
        s = [start.dae.s_start(q, p)] if start.dae.s_start is not None else []
        return ca.vertcat(q, start.velocities(q, p), *s)

    q_j = ca.SX.sym("q", dae.n_q)
    x_j = measured(of_bodies_at(of_bodies(q_j, p)), p)
    _, v_j, s_j = ca.vertsplit(x_j, [0, dae.n_q, dae.n_q + dae.n_v, dae.n_q + dae.n_v + dae.n_s])
    s_start = ca.Function("s_start", [q_j, p], [s_j]) if dae.n_s else None
    velocities = common("velocities", [q_j, p], [v_j])
    of_joints = None
    if start.joint_residuals is not None:
        values = start.joint_residuals(*space.of_bodies[:2], joints.p)
        of_joints = ca.Function("listed", [joints.q, joints.v, joints.p], [values])
    dae = replace(dae, s_start=s_start)
    state, holds = start_functions(dae, start.t0, (u, p), q, velocities(q, p), of_joints, listed[others, :])
    if start.redundant:  # for other parameters, removed rows may contradict the remaining rows
        y = ca.SX.sym("x", holds.numel_in(0))
        all_rows = start.holds(of_bodies_at(q_b), ca.SX(start.state.numel_in(0), 1), p)
        holds = common("holds", [y, u, p], [ca.vertcat(holds(y, u, p), all_rows)])
    position = ImplicitMap.of(rows[chosen, :], u, p)
    found = replace(start, dae=dae, q_nominal=q0, position=position, state=state, holds=holds)
    return None if found.states(p_nominal[None])[1][0] else found


def _values(scene: Scene, joints: System, q: ca.SX, q_b: ca.SX) -> list[ca.SX]:
    """Residuals of listed angles and displacements. Angles of carrying joints include whole turns."""
    rows, names = [], joints.collected.q_names
    for value in scene.prescribed.joints:
        if value.name in names:
            rows.append(q[names.index(value.name)] - value.value)
        elif not value.is_rate:
            rows.append(ca.substitute(value.row, scene.system.q, q_b))
    return rows


def _sufficient(slopes: Array, sizes: Array, first: int) -> list[int]:
    """Indices of independent rows that determine the unknowns. The `first` rows have precedence over the other rows.

    `sizes` are general sizes of the first rows, because a first row may vanish except for rounding.
    """
    own = np.linalg.norm(slopes, axis=1)
    own[: len(sizes)] = row_sizes(slopes[: len(sizes)], sizes[:, None])
    listed, _ = independent_rows_and_columns(slopes[:first], own[:first])
    if len(listed) == slopes.shape[1]:
        return listed.tolist()
    # Rows of loops are chosen for the motions that the listed rows leave free.
    V = np.linalg.svd(slopes[listed])[2][len(listed) :] if len(listed) else np.eye(slopes.shape[1])
    loops, _ = independent_rows_and_columns(slopes[first:] @ V.T, own[first:])
    return [*listed.tolist(), *(first + loops).tolist()]


def _displacement(system: System, begin: ca.SX, end: ca.SX) -> ca.SX:
    """Displacement (n_v,) of the bodies from coordinates `begin` to coordinates `end`, to first order."""
    parts, at = [], 0
    for body, n_v in zip(system.bodies, system.block_sizes, strict=True):
        if isinstance(body.pose, Spatial):
            e = product(conjugate(begin[at + 3 : at + 7]), end[at + 3 : at + 7])
            # e and -e are the same orientation. The sign selects the shorter rotation.
            parts += [end[at : at + 3] - begin[at : at + 3], 2 * ca.sign(e[0]) * e[1:]]
            parts.append(end[at + 7 : at + n_v + 1] - begin[at + 7 : at + n_v + 1])
            at += n_v + 1
        else:
            parts.append(end[at : at + n_v] - begin[at : at + n_v])
            at += n_v
    return ca.densify(ca.vertcat(*parts))
