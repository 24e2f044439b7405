"""Static equilibrium: positions with balanced forces and reactions."""

import casadi as ca
import numpy as np

from symmb._errors import AssemblyError
from symmb._magnitudes import FACTORS, NOTHING
from symmb._types import Array, Indices
from symmb.equations.model import DAE
from symmb.equations.start.labels import coordinate_of
from symmb.equations.start.residual_limits import SOLVED
from symmb.equations.start.scales import evaluate_at_rest, resting

_TOLERANCE = 1e-11
"""Largest accepted residual forces, relative to forces that a displacement of the scene's size causes.
tests/start/test_equilibrium.py"""


def imbalance(dae: DAE, q: ca.SX, lam: ca.SX, p: ca.SX, t0: float, free: Indices, rows: Indices) -> ca.SX:
    """Residuals of equilibrium: unbalanced forces on the free displacements, and scaled position rows."""
    _, *at = resting(dae, q, p)
    if dae.s_start is not None:
        at[-1] = dae.s_start(q, p)
    if dae.sampling is not None:
        at[-1] = dae.sampling.held(q, at[0], at[1], p, ca.SX(t0))
    Q = dae.Q(q, *at, p, t0)
    if dae.G is None or dae.Phi is None:
        return Q[free.tolist()]
    G, Phi = dae.G(q, *at, p, t0)[rows.tolist(), :], dae.Phi(q, *at, p, t0) / dae.row_scales[: dae.n_c]
    return ca.densify(ca.vertcat((Q - G.T @ lam)[free.tolist()], Phi[rows.tolist()]))


def find_equilibrium(dae: DAE, q: Array, t0: float, free: Indices, rows: Indices) -> tuple[Array, Array, float]:
    """Coordinates (n_q,), multipliers of the rows and the largest stiffness in equilibrium at the nominal parameters.

    The first attempt is Newton's method. If this method fails or ends in an unstable equilibrium, a second attempt adds
    a drag proportional to the masses, so that the system moves into a stable equilibrium. The drag decreases with the
    forces. Raises AssemblyError if there is no equilibrium near q, or if no force opposes some displacement.
    """
    n, m = len(free), len(rows)
    at, delta, lam = ca.SX.sym("q", dae.n_q), ca.SX.sym("delta", n), ca.SX.sym("lam", m)
    places = ca.SX(ca.DM(ca.Sparsity.triplet(dae.n_v, n, free.tolist(), list(range(n))), 1))
    residual = imbalance(dae, dae.retract(at, places @ delta), lam, ca.SX(ca.DM(dae.p_nominal)), t0, free, rows)
    z = ca.vertcat(delta, lam)
    at_zero = [ca.substitute(e, delta, ca.SX.zeros(n, 1)) for e in (residual, ca.jacobian(residual, z))]
    f = ca.Function("balance", [at, lam], at_zero)
    names = [coordinate_of(dae, int(i)) for i in free]
    for damped in (False, True):
        equilibrium = _damped_newton(dae, f, q, t0, free, m, _size(dae, q) or 1.0, damped)
        if equilibrium is not None:
            q_new, multipliers, J = equilibrium
            unopposed = _unopposed(J[:n, :n], J[n:, :n])
            if unopposed is not None:
                raise AssemblyError(
                    f"The equilibrium is not unique: no force opposes {names[unopposed]}. Give its value in start."
                )
            if damped or is_stable(J[:n, :n], J[n:, :n]):
                return q_new, multipliers, float(np.abs(J[:n, :n]).max(initial=0.0)) or 1.0
    raise AssemblyError("No static equilibrium was found near the guess. Improve the guess, or list more start values.")


def _damped_newton(
    dae: DAE, f: ca.Function, q: Array, t0: float, free: Indices, m: int, size: float, damped: bool
) -> tuple[Array, Array, Array] | None:
    """Coordinates, multipliers and Jacobian in equilibrium; None if there is no convergence."""
    n, lam = len(free), np.zeros(m)
    M = evaluate_at_rest(dae.M, dae, q, t0)[np.ix_(free, free)]
    drag, before, reach = 0.0, np.inf, np.inf
    # Short steps with drag follow the motion into a stable equilibrium; Newton's method may jump over it [rad, size].
    steps, longest = (400, 0.2) if damped else (20, 2.0)
    for step in range(steps):
        size = max(size, _size(dae, q))  # the guess may be small compared with the distance to the equilibrium
        scales = dae.displacement_scales[free] * size
        r, J = (part.full() for part in f(q, lam))
        r = r.ravel()
        forces = np.abs(r[:n]).max(initial=0.0)
        whole = max(float(np.abs(J[:n, n:] @ lam).max(initial=0.0)), float(np.abs(J[:n, :n] * scales).max(initial=0.0)))
        if not (np.isfinite(r).all() and np.isfinite(J).all()):
            return None
        if reach <= SOLVED and forces <= _TOLERANCE * whole and np.abs(r[n:]).max(initial=0.0) <= _TOLERANCE * size:
            return q, lam, J
        if damped and not step:
            # The first displacement is 2 % of the size, or 0.02 rad.
            drag = float(np.abs(np.linalg.lstsq(M, r[:n], rcond=None)[0] / scales).max(initial=0.0)) / 0.02
        elif damped:
            more = forces / before
            # The drag decreases faster than the forces, so that the last steps are steps of Newton's method.
            drag *= 0.7 * more if more < 1 else min(2.0, more)
        before = forces or NOTHING
        A = J.copy()
        A[:n, :n] -= drag * M
        weights = np.concatenate([np.ones(n), np.full(m, np.abs(A[:n, :n]).max(initial=0.0) or 1.0)])
        # Weights make displacements and multipliers comparable, so that one limit for singular values suits both.
        z = weights * np.linalg.lstsq(weights[:, None] * A * weights, -weights * r, rcond=FACTORS)[0]
        reach = float(np.abs(z[:n] / scales).max(initial=0.0))
        z[:n] *= min(1.0, longest / max(reach, NOTHING))
        delta = np.zeros(dae.n_v)
        delta[free] = z[:n]
        q, lam = np.asarray(dae.retract(q, delta)).ravel(), lam + z[n:]
    return None


def _size(dae: DAE, q: Array) -> float:
    """The largest ratio of a coordinate to its scale."""
    return float(np.abs(q / dae.coordinate_scales).max(initial=0.0))


def is_stable(K: Array, G: Array) -> bool:
    """Whether the equilibrium is stable: no displacement d with G d = 0 causes forces -K d that increase d.

    Forces that are rounding errors of the largest forces count as zero.
    """
    along = np.linalg.svd(G)[2][len(G) :].T
    values = np.linalg.eigvals(along.T @ K @ along).real
    return bool(values.max(initial=0.0) <= SOLVED * np.abs(K).max(initial=0.0))


def _unopposed(K: Array, G: Array) -> int | None:
    """Index of a displacement that no force and no constraint opposes; None if there is no such displacement."""
    A = np.vstack([K / (np.abs(K).max(initial=0.0) or 1.0), G])
    _, sigma, V = np.linalg.svd(A)
    if not len(V) or (len(sigma) == len(V) and sigma[-1] > FACTORS * sigma[0]):
        return None
    return int(np.abs(V[-1]).argmax())
