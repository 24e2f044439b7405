"""Equations of motion with all coordinates, and as many velocities as the rows of loops leave free.

Coordinates are not projected onto the rows. Velocities satisfy them: G v = -nu gives the dependent ones from the free
ones. The free ones follow from Newton's second law for the velocities S of the bodies along them,

    S' M S u' = S' (Q - M a),

where a are the accelerations for u' = 0. Masses of bodies are constant, and terms of joints that cancel do not arise.

Source: Wehage and Haug, Journal of Mechanical Design 104 (1982), generalised coordinate partitioning.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import casadi as ca
import numpy as np

from symmb._types import Array, Indices
from symmb.enclosures.reactions import of_bodies, solved_function
from symmb.formulations import Formulation
from symmb.model import Lazy, System
from symmb.symbolic import ExplicitSolver, common

_SETS = 500
"""Most sets of velocities that are all compared; of more, those that are best at some time are."""
_TIMES = 100
"""Times of the nominal run at which they are compared."""
_RTOL = 1e-6
"""Tolerance of that run."""


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations whose states x are parts of those of a formulation.

    Attributes
    ----------
    rates : (x, p, t) -> x'
    whole : (x, p, t) -> the state (q, v, s) of the formulation
    kept : numbers of the entries of that state which x has
    solved : (x, p, t) -> multipliers of all rows of the system, and accelerations of the bodies, if the system is known
    regular : (x, p, t) -> (m,), of which none is 0 where the rates are those of the formulation; None: everywhere
    """

    rates: ca.Function
    whole: ca.Function
    kept: Indices
    solved: Lazy[ca.Function]
    regular: ca.Function | None = None


def equations_of(form: Formulation, system: System | None, times: Array) -> Equations:
    """The equations of a formulation of a system over times (n_t,); of a copy from a pickle it is not known."""
    dae = form.dae
    n = dae.n_q + dae.n_v + dae.n_s
    if dae.G is None:
        x, p, t = ca.SX.sym("x", n), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
        at = dae.arguments(x, p, t)
        parts = dae.rhs.call(list(at)) if n else [ca.SX(0, 1)] * 2
        whole = ca.Function("whole", [x, p, t], [x])

        def of_tree() -> ca.Function:
            bodies = of_bodies(form, system, at, parts[0])
            return solved_function(form, system, (x, p, t), bodies, parts[1])

        return Equations(
            common("rates", [x, p, t], [ca.densify(ca.vertcat(*parts))]), whole, np.arange(n), Lazy(of_tree)
        )
    return _partitioned(form, system, *_dependent(form, times))


def _partitioned(form: Formulation, system: System | None, dependent: Sequence[int], G_there: Array) -> Equations:
    """The equations in which the rows determine some velocities, by their numbers. Their Jacobian is G_there once."""
    dae, bodies = form.dae, form.dae if form.bodies is None else form.bodies.dae
    assert dae.G is not None and dae.Phi_dot is not None and dae.gamma is not None
    n_q, n_v = dae.n_q, dae.n_v
    free = [k for k in range(n_v) if k not in dependent]
    kept = np.array([*range(n_q), *(n_q + k for k in free), *range(n_q + n_v, n_q + n_v + dae.n_s)], dtype=np.intp)
    x, p, t = ca.SX.sym("x", len(kept)), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
    q, u, s = ca.vertsplit(x, [0, n_q, n_q + len(free), len(kept)])
    state = [s] if dae.n_s else []
    at_rest = (q, ca.SX.zeros(n_v), *state, p, t)
    G = dae.G(*at_rest)
    solve = ExplicitSolver(G[:, list(dependent)], G_there[:, list(dependent)])

    def of_all(values: ca.SX, free_values: ca.SX) -> ca.SX:
        """Rows (n_v, m) of the dependent and of the free velocities in their order."""
        order = np.argsort([*dependent, *free]).tolist()
        return ca.densify(ca.vertcat(values, free_values))[order, :]

    along = of_all(-solve(G[:, free]), ca.SX.eye(len(free)))
    v = along @ u + of_all(-solve(dae.Phi_dot(*at_rest)), ca.SX(len(free), 1))
    at = (q, v, *state, p, t)
    first, *others = dae.rhs.call(list(at))
    bias = of_all(solve(dae.gamma(*at)), ca.SX(len(free), 1))
    moved = of_bodies(form, system, at, first)
    S, a = ca.densify(moved.J @ along), moved.drift + moved.J @ bias
    acceleration = ca.SX.sym("a", bodies.n_v)
    M = ca.jacobian(bodies.inertia(*moved.at, acceleration), acceleration)
    of_mass = ExplicitSolver(S.T @ M @ S)
    du = of_mass(S.T @ (moved.Q - M @ a))
    determinants = ca.densify(ca.vertcat(solve.determinants, of_mass.determinants))
    rates = common("rates", [x, p, t], [ca.densify(ca.vertcat(first, du, *others[1:]))])
    whole = common("whole", [x, p, t], [ca.densify(ca.vertcat(q, v, s))])
    loads = ExplicitSolver(G[:, list(dependent)].T, G_there[:, list(dependent)].T)
    solved = Lazy(
        lambda: solved_function(form, system, (x, p, t), moved, along @ du + bias, lambda f: loads(f[dependent, :]))
    )
    return Equations(rates, whole, kept, solved, common("regular", [x, p, t], [determinants]))


def _dependent(form: Formulation, times: Array) -> tuple[tuple[int, ...], Array]:
    """The velocities that the rows determine best along a nominal run, and the Jacobian G where they do worst.

    Those of which the determinant of S' M S changes least are best: it is infinite where they are not determined.
    """
    G, M = _along_a_run(form, times)
    scales = form.dae.displacement_scales
    n_r, n_v = G.shape[1:]
    scaled, none = G * scales, np.zeros((len(G), n_r, n_r))
    saddle = np.block([[M * scales * scales[:, None], scaled.swapaxes(1, 2)], [scaled, none]])
    whole = np.linalg.slogdet(saddle)[1]
    sets = list(combinations(range(n_v), n_r)) if _count(n_v, n_r) <= _SETS else sorted(_best_sets(scaled))
    logs = np.array([whole - 2 * np.linalg.slogdet(scaled[:, :, list(chosen)])[1] for chosen in sets])
    with np.errstate(invalid="ignore"):
        change = np.ptp(logs, axis=1)
    best = int(np.where(np.isfinite(change), change, np.inf).argmin())
    return sets[best], G[int(logs[best].argmax())]


def _count(n: int, k: int) -> int:
    """Number of sets of k of n, and no more than is told apart from many."""
    count = 1
    for i in range(min(k, n - k)):
        count = count * (n - i) // (i + 1)
        if count > _SETS:
            break
    return count


def _best_sets(G: Array) -> set[tuple[int, ...]]:
    """Sets of columns that are independent at some time: each column is the one that is farthest from those before."""
    from scipy.linalg import qr

    n_r = G.shape[1]
    return {tuple(sorted(qr(at, mode="r", pivoting=True)[-1][:n_r].tolist())) for at in G}


def _along_a_run(form: Formulation, times: Array) -> tuple[Array, Array]:
    """Jacobians (m, n_r, n_v) of the rows and mass matrices (m, n_v, n_v) along a nominal run, as far as it goes."""
    from scipy.integrate import solve_ivp

    dae, at = form.dae, form.start.nominal()
    assert dae.G is not None
    p, x0 = at["p"], np.concatenate([at["q"], at["v"], at["s"]])
    x, parameters, t = ca.SX.sym("x", len(x0)), ca.SX.sym("p", len(p)), ca.SX.sym("t")
    arguments = dae.arguments(x, parameters, t)
    rhs = ca.Function("rhs", [x, parameters, t], [ca.vertcat(*dae.rhs.call(list(arguments)))])
    f = ca.Function("matrices", [x, parameters, t], [dae.G(*arguments), dae.M(*arguments)])
    found = [f(x0, p, times[0])]
    if times[-1] > times[0]:
        run = solve_ivp(
            lambda t, x: rhs(x, p, t).full().ravel(),
            (times[0], times[-1]),
            x0,
            method="DOP853",
            rtol=_RTOL,
            atol=_RTOL * dae.state_sizes,
            t_eval=np.linspace(times[0], times[-1], _TIMES)[1:],
        )
        found += [f(state, p, time) for state, time in zip(np.transpose(run.y), run.t, strict=True)]
    G, M = (np.stack([matrices[i].full() for matrices in found]) for i in (0, 1))
    return G, M
