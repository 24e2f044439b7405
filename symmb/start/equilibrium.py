"""Static equilibrium: where nothing moves, because forces and reactions balance."""

import casadi as ca
import numpy as np

from symmb._errors import AssemblyError
from symmb._types import Array, Indices
from symmb.model import DAE
from symmb.start.initial_assembly import coordinate_of, rest

_TOLERANCE, _LAST = 1e-11, 1e-9
"""Forces that are left, as a share of what a displacement of the size would need, and the last displacement but one, of
which Newton's method leaves the square."""
_NEWTON, _STEPS = 20, 400
"""Newton's steps before the system is let sink into its equilibrium, and steps of that."""
_STRIDE, _THINNER = 0.02, 0.7
"""First displacement of sinking [rad, share of the size], and by what drag falls besides with the forces."""


def balance(dae: DAE, q: ca.SX, lam: ca.SX, p: ca.SX, t0: float, free: Indices, rows: Indices) -> ca.SX:
    """Forces on the free displacements that are left over, and position rows over their scales, for multipliers lam."""
    _, *at = rest(dae, q)
    if dae.s_start is not None:
        at[-1] = dae.s_start(q, p)
    Q = dae.Q(q, *at, p, t0)
    if dae.G is None or dae.Phi is None:
        return Q[free.tolist()]
    G, Phi = dae.G(q, *at, p, t0)[rows.tolist(), :], dae.Phi(q, *at, p, t0) / dae.row_scales[: dae.n_c]
    return ca.densify(ca.vertcat((Q - G.T @ lam)[free.tolist()], Phi[rows.tolist()]))


def settle(dae: DAE, q: Array, t0: float, free: Indices, rows: Indices) -> tuple[Array, Array, float]:
    """Coordinates (n_q,), multipliers of the rows and the largest stiffness in equilibrium at the nominal parameters.

    Newton's method; where it fails or ends where the system would fall over, the masses sink through a fluid that thins
    out as the forces do.

    Raises
    ------
    AssemblyError        if there is none near q, or displacements remain that no force opposes
    """
    n, m = len(free), len(rows)
    at, delta, lam = ca.SX.sym("q", dae.n_q), ca.SX.sym("delta", n), ca.SX.sym("lam", m)
    left = balance(dae, dae.retract(at, _spread(dae, free) @ delta), lam, ca.SX(ca.DM(dae.p_nominal)), t0, free, rows)
    z = ca.vertcat(delta, lam)
    at_zero = [ca.substitute(e, delta, ca.SX.zeros(n, 1)) for e in (left, ca.jacobian(left, z))]
    f = ca.Function("balance", [at, lam], at_zero)
    size = float(np.abs(q / dae.coordinate_scales).max(initial=0.0)) or 1.0
    names = [coordinate_of(dae, int(i)) for i in free]
    for thick in (False, True):
        found = _sink(dae, f, q, t0, free, m, size, thick)
        if found is not None:
            settled, multipliers, J = found
            loose = _loose(J[:n, :n], J[n:, :n])
            if loose is not None:
                raise AssemblyError(
                    f"The equilibrium is not unique: no force opposes {names[loose]}. List it in start, or hold it."
                )
            if thick or _stable(J[:n, :n], J[n:, :n]):
                return settled, multipliers, float(np.abs(J[:n, :n]).max(initial=0.0)) or 1.0
    raise AssemblyError(
        "No static equilibrium is found near the guess. Give a better guess, or list in start what should not move."
    )


def _spread(dae: DAE, free: Indices) -> ca.SX:
    """(n_v, n): displacements along all velocities from the free ones."""
    columns = list(range(len(free)))
    return ca.SX(ca.DM(ca.Sparsity.triplet(dae.n_v, len(free), free.tolist(), columns), 1))


def _sink(
    dae: DAE, f: ca.Function, q: Array, t0: float, free: Indices, m: int, size: float, thick: bool
) -> tuple[Array, Array, Array] | None:
    """Coordinates, multipliers and Jacobian in equilibrium; None if it is not reached."""
    n, lam = len(free), np.zeros(m)
    s = (np.zeros(dae.n_s),) if dae.n_s else ()
    M = dae.M(q, np.zeros(dae.n_v), *s, dae.p_nominal, t0).full()[np.ix_(free, free)]
    scales = dae.displacement_scales[free] * size
    drag, before, reach = 0.0, np.inf, np.inf
    for step in range(_STEPS if thick else _NEWTON):
        r, J = (part.full() for part in f(q, lam))
        r = r.ravel()
        forces = np.abs(r[:n]).max(initial=0.0)
        whole = max(float(np.abs(J[:n, n:] @ lam).max(initial=0.0)), float(np.abs(J[:n, :n] * scales).max(initial=0.0)))
        if not (np.isfinite(r).all() and np.isfinite(J).all()):
            return None
        if reach <= _LAST and forces <= _TOLERANCE * whole and np.abs(r[n:]).max(initial=0.0) <= _TOLERANCE * size:
            return q, lam, J
        if thick:
            more = forces / before
            drag = drag * (_THINNER * more if more < 1 else min(2.0, more)) if step else _first_drag(M, r[:n], scales)
            before = forces or 1e-300
        A = J.copy()
        A[:n, :n] -= drag * M
        weights = np.concatenate([np.ones(n), np.full(m, np.abs(A[:n, :n]).max(initial=0.0) or 1.0)])
        z = weights * np.linalg.lstsq(weights[:, None] * A * weights, -weights * r, rcond=1e-14)[0]
        reach = float(np.abs(z[:n] / scales).max(initial=0.0))
        z[:n] *= min(1.0, (0.2 if thick else 2.0) / max(reach, 1e-300))
        delta = np.zeros(dae.n_v)
        delta[free] = z[:n]
        q, lam = np.asarray(dae.retract(q, delta)).ravel(), lam + z[n:]
    return None


def _first_drag(M: Array, force: Array, scales: Array) -> float:
    speed = np.abs(np.linalg.lstsq(M, force, rcond=None)[0] / scales).max(initial=0.0)
    return float(speed) / _STRIDE


def _stable(K: Array, G: Array) -> bool:
    """Whether the forces of displacements on the constraints, K times those, push back."""
    _, sigma, V = np.linalg.svd(G)
    along = V[int((sigma > 1e-12 * sigma.max(initial=0.0)).sum()) :].T
    values = np.linalg.eigvals(along.T @ K @ along).real
    return bool(values.max(initial=0.0) <= 1e-9 * np.abs(values).max(initial=0.0))


def _loose(K: Array, G: Array) -> int | None:
    """Number of a displacement that neither forces nor rows oppose; None if all are held."""
    A = np.vstack([K / (np.abs(K).max(initial=0.0) or 1.0), G])
    _, sigma, V = np.linalg.svd(A)
    if not len(V) or (len(sigma) == len(V) and sigma[-1] > 1e-14 * sigma[0]):
        return None
    return int(np.abs(V[-1]).argmax())
