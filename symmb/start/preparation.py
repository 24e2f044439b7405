"""The start of a scene at the nominal parameters, and the decision on the unknowns of every sample."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from symmb._errors import AssemblyError
from symmb._types import Array, Indices
from symmb.model import DAE, Scene
from symmb.start.consistency import check_accelerations, check_velocities
from symmb.start.doubts import start_doubts
from symmb.start.equilibrium import find_equilibrium, imbalance
from symmb.start.implicit_function import ImplicitMap
from symmb.start.initial_assembly import assemble, listed_coordinates
from symmb.start.joint_values import of_positions, of_rates, residuals, with_position_rows, with_rate_rows, with_states
from symmb.start.labels import coordinate_of, coordinate_with_value
from symmb.start.rank import (
    general_entries,
    independent_rows,
    independent_rows_and_columns,
    lasting_rows,
    redundant_names,
    row_sizes,
)
from symmb.start.scales import evaluate_at_rest, resting, with_coarse_scales
from symmb.start.start import VIOLATION, Start
from symmb.start.unstretched import unstretched
from symmb.start.velocities import start_velocities
from symmb.symbolic import batch, common

_PROBED = 1e-2
"""Relative distance of parameters at which decisions on velocities must hold as well. A listed speed that is a
parameter may vanish at its nominal value."""


def prepare_start(scene: Scene, dae: DAE) -> Start:
    """Solve for the start at the nominal parameters, and decide on the unknowns of every sample.

    Raises
    ------
    AssemblyError              if listed values contradict the constraints, no assembly is found near the guess, a joint
                               is assembled the wrong way round, or the start is a singular position
    """
    prescribed = scene.prescribed
    t0, p0 = float(np.asarray(scene.times)[0]), dae.p_nominal
    begin = t0 if scene.restart is None else scene.restart.first_instant
    dae = dae if dae.sampling is None else replace(dae, sampling=replace(dae.sampling, begin=begin))
    reference = listed_coordinates(scene, dae)
    free = np.array([i for i in range(dae.n_v) if i not in prescribed.displacements], dtype=np.intp)
    q0, s0 = assemble(scene, dae, t0)
    dae = with_coarse_scales(with_states(scene, dae, s0), q0, t0)
    general = general_entries(dae, q0, t0)
    G, sizes = _scaled_jacobian(dae, q0, t0, general)
    listed, rates = of_positions(prescribed), of_rates(prescribed)
    placed = with_coarse_scales(with_position_rows(scene.system, dae, listed), q0, t0) if listed else dae
    moved = with_coarse_scales(with_rate_rows(scene.system, dae, rates), q0, t0) if rates else dae
    try:
        rows = independent_rows(dae, q0, t0, sizes)
    except AssemblyError as error:
        raise AssemblyError(" ".join(unstretched(scene)) or str(error)) from None
    is_redundant, sufficient, nullities = len(rows) < dae.n_r, None, (0, 0)
    position_rows, _ = independent_rows_and_columns(G[: dae.n_c], sizes[: dae.n_c])
    if is_redundant:
        sufficient, nullities = lasting_rows(dae, q0, t0, rows, general)
    of_placed = _scaled_jacobian(placed, q0, t0) if listed else (G, sizes)
    positions = _solve_positions(scene, placed, reference, q0, t0, free, *of_placed)
    velocities = start_velocities(scene, moved, prescribed.v, _probes(positions, p0), t0)
    free_velocities = np.array([i for i in range(dae.n_v) if i not in prescribed.v], dtype=np.intp)
    G_moved, of_moved = _scaled_jacobian(moved, q0, t0) if rates else (G, sizes)
    solved_velocities = free_velocities[independent_rows_and_columns(G_moved[:, free_velocities], of_moved)[1]]
    v0 = velocities(positions.q0, p0).full().ravel()
    redundant = redundant_names(G / sizes[:, None], len(rows), dae.rows) if is_redundant else ()
    lost = _only_nominal(scene, dae, positions, t0, redundant, len(rows)) if is_redundant else ()
    start = Start(
        dae,
        t0,
        positions.q0,
        reference,
        positions.place,
        positions.position,
        velocities,
        listed=tuple(scene.start),
        listed_velocities=(*(dae.v_names[i] for i in prescribed.v), *(value.name for value in rates)),
        joint_residuals=residuals(scene),
        joint_values=tuple(value.name for value in prescribed.joints),
        solved=tuple(coordinate_of(dae, i) for i in positions.solved),
        free=tuple(coordinate_with_value(dae, i, positions.q0) for i in np.setdiff1d(free, positions.solved)),
        solved_velocities=tuple(dae.v_names[i] for i in solved_velocities),
        free_velocities=tuple(
            f"{dae.v_names[i]} = {v0[i]:.6g}" for i in np.setdiff1d(free_velocities, solved_velocities)
        ),
        rows=None if sufficient is None else tuple(sufficient.tolist()),
        nullities=nullities,
        ranks=(len(rows), len(position_rows)),
        redundant=redundant,
        is_equilibrium=scene.equilibrium,
        doubts=(*start_doubts(scene, dae, positions.q0, v0, t0, rows), *lost),
        held=tuple(np.setdiff1d(np.arange(dae.n_v), positions.solved).tolist()),
    )
    check_velocities(start, p0)
    if is_redundant:
        check_accelerations(start, G, sizes)
    return start


def _scaled_jacobian(dae: DAE, q: Array, t0: float, general: Array | None = None) -> tuple[Array, Array]:
    """The velocity Jacobian at coordinates q, in the scales of displacements (n_r, n_v), and the sizes of its rows."""
    if dae.G is None:
        return np.zeros((0, dae.n_v)), np.zeros(0)
    G = evaluate_at_rest(dae.G, dae, q, t0) * dae.displacement_scales
    general = general_entries(dae, q, t0) if general is None else general
    return G, row_sizes(G, general * dae.displacement_scales)


def _only_nominal(
    scene: Scene, dae: DAE, positions: "_Positions", t0: float, names: tuple[str, ...], rank: int
) -> Iterator[str]:
    """The doubt that constraints of these names are redundant at the nominal parameters, but not all over the box."""
    if scene.box is None or dae.Phi is None:
        return
    p, bounds = dae.p_nominal.copy(), np.array(scene.box.bounds)
    varied = [dae.p_names.index(name) for name in scene.box.names]
    p[varied] = bounds[:, 0] + np.random.default_rng(0).uniform(size=len(varied)) * (bounds[:, 1] - bounds[:, 0])
    u, solved = np.zeros((1, positions.place.numel_in(0))), True
    if positions.position is not None:
        u, (solved,) = positions.position.solve(p[None])
    q = batch(positions.place, u, p[None])[0][0]
    if not solved:
        return
    at = [ca.SX(ca.DM(part)) for part in (q, p)]
    r = np.asarray(ca.evalf(dae.Phi(*resting(dae, *at), at[1], t0))).ravel() / dae.row_scales[: dae.n_c]
    limit = VIOLATION * max(float(np.abs(q / dae.coordinate_scales).max(initial=0.0)), 1.0)
    if np.abs(r).max(initial=0.0) > limit:
        then = "there they contradict each other, and runs do not start"
    elif len(independent_rows_and_columns(*_scaled_jacobian(replace(dae, p_nominal=p), q, t0))[0]) > rank:
        then = "there they leave fewer motions free, which runs miss"
    else:
        return
    where = ", ".join(f"{dae.p_names[k]} = {p[k]:.6g}" for k in varied)
    yield (
        f"Constraints {', '.join(map(repr, names))} are redundant at the nominal parameters, but not at {where}: "
        f"{then}. Leave one of them out, or give points and axes that fit for all parameters."
    )


@dataclass(frozen=True, eq=False)
class _Positions:
    """Coordinates q0 (n_q,), the displacements that are solved for, their equations, and (u, p) -> q."""

    q0: Array
    solved: Indices
    position: ImplicitMap | None
    place: ca.Function


def _probes(positions: _Positions, p0: Array) -> tuple[Array, Array]:
    """Coordinates (k, n_q) at the start for the nominal parameters and others close to them, (k, n_p)."""
    near = np.random.default_rng(0).uniform(-_PROBED, _PROBED, p0.shape) * np.where(p0 != 0, p0, 1.0)
    P = np.stack([p0, p0 + near]) if p0.size else p0[None]
    u, ok = np.zeros((len(P), positions.place.numel_in(0))), np.ones(len(P), dtype=bool)
    if positions.position is not None:
        u, ok = positions.position.solve(P)
    ok[0] = True  # checks that come later tell what is wrong there
    return batch(positions.place, u, P)[0][ok], P[ok]


def _solve_positions(
    scene: Scene, dae: DAE, reference: ca.Function, q0: Array, t0: float, free: Indices, G: Array, sizes: Array
) -> _Positions:
    """Which displacements every sample solves for: as many as independent rows, or all free ones in equilibrium."""
    p = scene.system.p
    rows, columns = independent_rows_and_columns(G[: dae.n_c, free], sizes[: dae.n_c])
    solved, lam0, stiffness = free[columns], np.empty(0), 1.0
    if scene.equilibrium:
        solved = free
        q0, lam0, stiffness = find_equilibrium(dae, q0, t0, free, rows)
    u = ca.SX.sym("u", len(solved))
    places = ca.Sparsity.triplet(dae.n_v, len(solved), solved.tolist(), list(range(len(solved))))
    delta = ca.SX(ca.DM(places, dae.displacement_scales[solved])) @ u
    q = dae.retract(reference(p, ca.DM(q0)), delta)
    place = common("place", [u, p], [q])
    position = None
    if scene.equilibrium:
        # Multipliers as shares of the stiffness are as small as displacements, by which Newton's method ends.
        share = ca.SX.sym("share", len(rows))
        z, lam = ca.vertcat(u, share), ca.SX(ca.DM(lam0)) + stiffness * share
        position = ImplicitMap.of(imbalance(dae, place(u, p), lam, p, t0, free, rows), z, p)
        place = common("place", [z, p], [q])
    elif len(solved) and dae.Phi is not None:
        residual = (dae.Phi(*resting(dae, place(u, p), p), p, t0) / dae.row_scales[: dae.n_c])[rows.tolist()]
        position = ImplicitMap.of(residual, u, p)
    return _Positions(q0, solved, position, place)
