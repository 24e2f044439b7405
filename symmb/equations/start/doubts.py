"""Warnings about a start: unused elements, locked mechanisms, unstable equilibria, reactions that are not unique."""

from collections.abc import Iterator

import casadi as ca
import numpy as np

from symmb._magnitudes import SLIGHT
from symmb._types import Array, Indices
from symmb.declare.mechanics import Constraint, Weld
from symmb.declare.symbolic import evaluated
from symmb.declare.symbolic import t as time
from symmb.equations import start
from symmb.equations.model import DAE, Scene, left_out
from symmb.equations.start.rank import redundant_names, vanishing_combinations
from symmb.equations.start.residual_limits import SOLVED
from symmb.equations.start.scales import evaluate_at_rest
from symmb.equations.start.sparse_rows import normal_solver

_HEAVY = 100.0
"""Energy of a free velocity, divided by that of the bodies with given velocities, above which a warning is issued. A
rotor of 0.001 kg m^2 that turns a housing of 16 kg m^2 has a ratio of 16,000. Panels of a satellite have a few."""


def start_doubts(scene: Scene, dae: DAE, q: Array, v: Array, t0: float, rows: Indices, free: Indices) -> Iterator[str]:
    """Warnings about the start with coordinates q (n_q,) and velocities v (n_v,) at the nominal parameters.

    `rows` are the indices of independent constraint rows, and `free` those of velocities that nothing determines.
    """
    yield from left_out(scene.system.elements)
    yield from _moved_by_light_bodies(scene, dae, q, v, t0, free)
    s = (dae.s_start(q, dae.p_nominal).full().ravel(),) if dae.s_start is not None else ()
    if dae.sampling is not None:
        s = (np.asarray(ca.evalf(dae.sampling.held(*map(ca.SX, (q, v, *s, dae.p_nominal, t0))))).ravel(),)
    at = (q, v, *s, dae.p_nominal, t0)
    G = np.zeros((0, dae.n_v))
    if dae.G is not None:
        G = evaluated(dae.G, *map(np.atleast_1d, at)) * dae.displacement_scales
    yield from _open_outputs(scene, dae, at, G, len(rows))
    driven = dae.Phi is not None and dae.Phi.jac_sparsity(0, dae.Phi.n_in() - 1).nnz()  # the law of a drive may jump
    gated = any(scene.system.collected.gated.values())  # a joint that locks the mechanism may open
    if not dae.n_v or len(scene.times) < 2 or v.any() or driven or gated:
        return
    if len(rows) == dae.n_v:
        is_welded = all(isinstance(e, Weld) for e in scene.system.elements if isinstance(e, Constraint))
        if not scene.system.collected.decoupled and not is_welded:
            yield (
                f"The mechanism is locked: its constraints leave none of its {dae.n_v} velocities free, and no drive "
                "moves it. Remove a constraint if the mechanism should move."
            )
    elif _is_unstable(dae, at, G, rows):
        yield (
            "The start is an unstable equilibrium: all forces are balanced, and only rounding decides in which "
            "direction the system moves. Start away from the equilibrium."
        )


def _moved_by_light_bodies(scene: Scene, dae: DAE, q: Array, v: Array, t0: float, free: Indices) -> Iterator[str]:
    """The warning that heavy bodies start with the velocity of light ones, such as the housing of a rotor."""
    free = free[v[free] != 0]
    if not free.size:
        return
    sizes = scene.system.block_sizes
    body_of = np.repeat(np.arange(len(sizes)), sizes)
    given = np.zeros(dae.n_v, dtype=bool)
    given[list(scene.prescribed.v)] = True
    if dae.Phi_dot is not None and dae.G is not None:
        drive = evaluate_at_rest(dae.Phi_dot, dae, q, t0).ravel()
        given |= (evaluate_at_rest(dae.G, dae, q, t0)[drive != 0] != 0).any(axis=0)
    M = evaluate_at_rest(dae.M, dae, q, t0)
    leads = np.isin(body_of, body_of[given])
    energy = v[leads] @ M[np.ix_(leads, leads)] @ v[leads]
    heavy = [k for k in free if not leads[k] and M[k, k] * v[k] ** 2 > _HEAVY * energy > 0]
    if heavy:
        bodies = scene.system.bodies
        names = dict.fromkeys(bodies[body_of[k]].name for k in heavy)
        others = dict.fromkeys(bodies[k].name for k in body_of[leads])
        values = ", ".join(f"{dae.v_names[k]} = {v[k]:.4g}" for k in heavy)
        yield (
            f"{', '.join(map(repr, names))} moves with the lighter {', '.join(map(repr, others))} at the start "
            f"({values}), because no other velocity is listed. List {dae.v_names[heavy[0]]}, which is 0 at rest."
        )


def _open_outputs(scene: Scene, dae: DAE, at: tuple[Array | float, ...], G: Array, rank: int) -> Iterator[str]:
    """The warning that outputs depend on the distribution of forces among redundant rows of G (n_r, n_v)."""
    lam, y = ca.SX(scene.system.lam), scene.y
    if rank == len(G) or not any(ca.which_depends(y, lam, 1, True)):
        return
    sizes = np.maximum(np.linalg.norm(G, axis=1, keepdims=True), SOLVED)
    shares = vanishing_combinations(G / sizes, rank)
    shares = np.where(np.abs(shares) > SLIGHT, shares, 0.0) / sizes
    system = scene.system
    symbols = [*dae.arguments(ca.vertcat(system.q, system.v, system.s), system.p, time), lam, system.vdot]
    slopes = ca.Function("slopes", symbols, [ca.jacobian(y, lam)])
    some = np.cos(np.arange(1, len(G) + 1) ** 1.5)  # outputs need not be linear in the multipliers
    J = slopes(*at, some, np.zeros(dae.n_v)).full()
    is_open = (np.abs(J @ shares) > SLIGHT * (np.abs(J) @ np.abs(shares))).any(axis=1)
    if is_open.any():
        outputs = ", ".join(repr(name) for name, own in zip(scene.curve_names, is_open, strict=True) if own)
        names = ", ".join(map(repr, redundant_names(G / sizes, rank, dae.rows)))
        yield (
            f"Outputs {outputs} depend on how the redundant constraints {names} share their load. This is not "
            "unique for rigid bodies, so the smallest reactions are used. Replace a joint that is not stiff by a "
            "Bushing, or by a joint with fewer rows."
        )


def _is_unstable(dae: DAE, at: tuple[Array | float, ...], G: Array, rows: Indices) -> bool:
    """Whether forces are balanced at rest, but some admissible displacement causes forces that make it larger."""
    scales = dae.displacement_scales
    forces = dae.Q(*at).full().ravel() * scales
    lam = _multipliers(G[rows], forces)
    terms = np.abs(forces) + np.abs(G[rows].T) @ np.abs(lam)
    if np.abs(forces - G[rows].T @ lam).max() > SOLVED * terms.max():
        return False
    delta, others = ca.SX.sym("delta", dae.n_v), [ca.SX(ca.DM(part)) for part in at[1:]]
    moved = dae.retract(ca.SX(ca.DM(at[0])), ca.SX(ca.DM(scales)) * delta)
    if dae.sampling is not None:  # sampled values change with displacements
        s = ca.SX(ca.DM(at[2]))
        for _, count in dae.sampling.states:
            s[count] = 0
        others[1] = dae.sampling.held(moved, others[0], s, *others[2:])
    residual = ca.SX(ca.DM(scales)) * dae.Q(moved, *others)
    if dae.G is not None and len(rows):
        G_moved = dae.G(moved, *others)[rows.tolist(), :] @ ca.diag(ca.SX(ca.DM(scales)))
        residual -= G_moved.T @ ca.SX(ca.DM(lam))
    stiffness = ca.Function("stiffness", [delta], [ca.jacobian(residual, delta)])(np.zeros(dae.n_v)).full()
    return bool(np.isfinite(stiffness).all()) and not start.is_stable(stiffness, G[rows])


def _multipliers(G: Array, forces: Array) -> Array:
    """Multipliers lam (n_r,) of the rows G (n_r, n_v), for which G' lam is closest to the given forces (n_v,)."""
    if (solve := normal_solver(G)) is None:
        return np.asarray(np.linalg.lstsq(G.T, forces, rcond=None)[0], dtype=np.float64) if len(G) else np.zeros(0)
    return solve(G @ forces)
