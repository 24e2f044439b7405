"""The start of a scene in coordinates of its joints."""

from dataclasses import replace

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.mechanics import Spatial
from symmb.model import DAE, Scene, System
from symmb.start.implicit_function import ImplicitMap
from symmb.start.rank import independent_rows_and_columns
from symmb.start.scales import resting, with_coarse_scales
from symmb.start.start import Start
from symmb.symbolic import conjugate, product


def start_in_joints(start: Start, scene: Scene, joints: System, dae: DAE) -> Start | None:
    """The start of the bodies, which is no equilibrium, in coordinates of the joints, for a system in joint space.

    Displacements of bodies that are listed, or that stay where they are, are held; with the rows of loops they
    determine the coordinates of the joints. None where they do not, as close to singular positions.
    """
    bodies, space, p = scene.system, joints.joints, scene.system.p
    at = start.nominal()
    s_b = [at["s"]] if start.dae.n_s else []
    own = [bodies.q, bodies.v, *([bodies.s] if s_b else []), p]
    measured = ca.Function("measured", own, [ca.densify(part) for part in space.of_joints])
    q0 = measured(at["q"], at["v"], *s_b, at["p"])[0].full().ravel()
    dae = with_coarse_scales(dae, q0, start.t0)
    of_bodies = ca.Function("of_bodies", [joints.q, p], [space.of_bodies[0]], {"cse": True})
    u, scales = ca.SX.sym("u", dae.n_v), dae.displacement_scales
    q = dae.retract(ca.DM(q0), ca.DM(scales) * u)
    place = ca.Function("place", [u, p], [q], {"cse": True})
    q_b = of_bodies(q, p)
    moved = _displacement(bodies, start.reference(p, ca.DM(start.q_nominal)), q_b)
    listed = (moved / start.dae.displacement_scales)[list(start.held)]
    residuals = None
    if start.joint_residuals is not None:
        listed = ca.vertcat(listed, *_values(scene, joints, q, q_b))
        states = ca.Function("states", [joints.q, joints.v, p], [*space.of_bodies[:2]])
        q_j, v_j = ca.SX.sym("q", dae.n_q), ca.SX.sym("v", dae.n_v)
        at_bodies = start.joint_residuals(*states(q_j, v_j, p), p)
        own = dict(zip((*dae.q_names, *dae.v_names), ca.vertsplit(ca.vertcat(q_j, v_j)), strict=True))
        values = [
            own[v.name] - v.value if v.name in own else at_bodies[k] for k, v in enumerate(scene.prescribed.joints)
        ]
        residuals = ca.Function("listed", [q_j, v_j, p], [ca.densify(ca.vertcat(*values))], {"cse": True})
    loops = (
        dae.Phi(*resting(dae, q, p), p, start.t0) / dae.row_scales[: dae.n_c] if dae.Phi is not None else ca.SX(0, 1)
    )
    rows = ca.vertcat(listed, loops)
    slopes = ca.Function("slopes", [u, p], [ca.jacobian(rows, u)])(np.zeros(dae.n_v), at["p"]).full()
    chosen = _sufficient(slopes, listed.numel())
    if len(chosen) < dae.n_v:
        return None
    others = [k for k in range(listed.numel()) if k not in chosen]
    q_j = ca.SX.sym("q", dae.n_q)
    q_of = of_bodies(q_j, p)
    v = start.velocities(q_of, p)
    s = [start.dae.s_start(q_of, p)] if start.dae.s_start is not None else []
    velocities = ca.Function("velocities", [q_j, p], [measured(q_of, v, *s, p)[1]], {"cse": True})
    found = replace(
        start,
        dae=dae,
        q_nominal=q0,
        place=place,
        position=ImplicitMap.of(rows[chosen], u, p) if chosen else None,
        velocities=velocities,
        joint_residuals=residuals,
        implied=ca.Function("implied", [u, p], [listed[others]], {"cse": True}) if others else None,
    )
    return None if found.states(at["p"][None])[1][0] else found


def _values(scene: Scene, joints: System, q: ca.SX, q_b: ca.SX) -> list[ca.SX]:
    """What is 0 where listed angles and displacements hold, with whole turns for those of joints that carry bodies."""
    rows, names = [], joints.collected.q_names
    for value in scene.prescribed.joints:
        if value.name in names:
            rows.append(q[names.index(value.name)] - value.value)
        elif not value.is_rate:
            rows.append(ca.substitute(value.row, scene.system.q, q_b))
    return rows


def _sufficient(slopes: Array, first: int) -> list[int]:
    """Numbers of independent rows: of the first ones, and as many of the others as determine the unknowns."""
    listed, _ = independent_rows_and_columns(slopes[:first])
    if len(listed) == slopes.shape[1]:
        return listed.tolist()
    V = np.linalg.svd(slopes[listed])[2][len(listed) :] if len(listed) else np.eye(slopes.shape[1])
    loops, _ = independent_rows_and_columns(slopes[first:] @ V.T)
    return [*listed.tolist(), *(first + loops).tolist()]


def _displacement(system: System, begin: ca.SX, end: ca.SX) -> ca.SX:
    """Displacement (n_v,) of the bodies from coordinates `begin` to coordinates `end`, to first order."""
    parts, at = [], 0
    for body, n_v in zip(system.bodies, system.block_sizes, strict=True):
        if isinstance(body.pose, Spatial):
            e = product(conjugate(begin[at + 3 : at + 7]), end[at + 3 : at + 7])
            parts += [end[at : at + 3] - begin[at : at + 3], 2 * ca.sign(e[0]) * e[1:]]
            parts.append(end[at + 7 : at + n_v + 1] - begin[at + 7 : at + n_v + 1])
            at += n_v + 1
        else:
            parts.append(end[at : at + n_v] - begin[at : at + n_v])
            at += n_v
    return ca.densify(ca.vertcat(*parts))
