"""Equations of motion with all coordinates, and with independent velocities.

Coordinates are not projected onto the constraints of loops. Velocities satisfy the constraints: G v = -nu gives the
dependent velocities from the free ones. The free velocities u follow from Newton's second law,

    S' M S u' = S' (Q - M a),

where S are the velocities of the bodies along u, and a the accelerations for u' = 0. Masses of bodies are constant, so
the equations have no terms of joints that must cancel each other.

Source: Wehage and Haug, Journal of Mechanical Design 104 (1982), generalised coordinate partitioning.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import casadi as ca
import numpy as np
from scipy.linalg import qr

from symmb._magnitudes import SLIGHT
from symmb._types import Array, Indices
from symmb.declare.symbolic import ExplicitSolver, common
from symmb.equations.model import Lazy, System
from symmb.prove import points
from symmb.prove.errors import ProofError
from symmb.prove.reactions import of_bodies, solved_function
from symmb.prove.tape import Tape
from symmb.run.formulations import Formulation

_MOST_SETS_COMPARED = 500
"""Up to this number, all sets of dependent velocities are compared. If there are more, only sets that are best at some
time are compared."""
_LARGE_LOG_CHANGE = np.log(10.0)
"""If the logarithm of a determinant changes by more than this, another set may be better."""


class Partition(NamedTuple):
    """Indices of the dependent velocities, the Jacobian G at the time of the largest det(S' M S), and the last time."""

    dependent: tuple[int, ...]
    G_there: Array
    until: float


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations of motion. Their states x are entries of the states of a formulation.

    Attributes
    ----------
    rates : (x, p, t) -> x'
    whole : (x, p, t) -> the state (q, v, s) of the formulation
    kept : indices of the entries of this state that x contains
    solved : (x, p, t) -> multipliers of all rows of the system, and accelerations of the bodies, if the system is known
    regular : (x, p, t) -> (m,), all different from 0 if the rates are those of the formulation; None: everywhere
    until : time from which `following` is better [s]; infinite if there are no other equations
    following : other equations with the same number of states
    """

    rates: ca.Function
    whole: ca.Function
    kept: Indices
    solved: Lazy[ca.Function]
    regular: ca.Function | None = None
    until: float = np.inf
    following: "Lazy[Equations] | None" = None


def equations_of(form: Formulation, system: System | None, times: Array) -> Equations:
    """The equations of a formulation over times (n_t,). `system` is None for pickled copies of a simulator."""
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
    return _partitioned(form, system, _partitions(form, times))


def _partitioned(form: Formulation, system: System | None, partitions: Sequence[Partition]) -> Equations:
    """The equations of the first partition, followed by those of the other partitions."""
    (dependent, G_there, until), *later = partitions
    following = Lazy(lambda: _partitioned(form, system, later)) if later else None
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
    none = ca.SX(len(free), 1)
    along = _in_order(dependent, -solve(G[:, free]), ca.SX.eye(len(free)))
    v = along @ u + _in_order(dependent, -solve(dae.Phi_dot(*at_rest)), none)
    at = (q, v, *state, p, t)
    first, *others = dae.rhs.call(list(at))
    bias = _in_order(dependent, solve(dae.gamma(*at)), none)
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
    return Equations(rates, whole, kept, solved, common("regular", [x, p, t], [determinants]), until, following)


def _in_order(dependent: Sequence[int], values: ca.SX, free_values: ca.SX) -> ca.SX:
    """Rows (n_v, m) of the dependent and of the free velocities, in the order of all velocities."""
    free = [k for k in range(values.shape[0] + free_values.shape[0]) if k not in dependent]
    return ca.densify(ca.vertcat(values, free_values))[np.argsort([*dependent, *free]).tolist(), :]


def start_states(form: Formulation, u: ca.SX, p: ca.SX) -> ca.SX:
    """The state (n_x,) at the start. Velocities with large error bounds are computed from the other velocities.

    The expressions of the start are made for runs. Bounds of their rounding errors may be large, but they are small
    for velocities with given start values. Constraints determine the other velocities from these.
    """
    dae, start = form.dae, form.start
    x0 = start.state(u, p)
    if dae.G is None or dae.Phi_dot is None:
        return x0
    q, v, *rest = at = dae.arguments(x0, p, ca.SX(start.t0))
    unknowns = start.position.solve(dae.p_nominal[None])[0][0]
    nominal = [[points.point(value) for value in values.tolist()] for values in (unknowns, dae.p_nominal)]
    try:
        found = Tape(start.state).run(points.OPERATIONS, points.point, nominal)[0]
    except (ProofError, KeyError):  # the proof reports the cause later
        return x0
    errors = np.array([error for _, error, *_ in found[dae.n_q : dae.n_q + dae.n_v]])
    x = start.nominal()
    there = dae.arguments(ca.SX(np.concatenate([x["q"], x["v"], x["s"]])), ca.SX(x["p"]), ca.SX(start.t0))
    G_there = ca.DM(dae.G(*there)).full()
    weights = np.maximum(errors / errors.max(initial=1e-300), SLIGHT) * dae.displacement_scales
    dependent = list(qr(G_there * weights, mode="r", pivoting=True)[-1][: dae.n_r])
    free = [k for k in range(dae.n_v) if k not in dependent]
    G = dae.G(*at)
    solve = ExplicitSolver(G[:, dependent], G_there[:, dependent])
    drift = dae.Phi_dot(*dae.arguments(ca.vertcat(q, 0 * v, *rest[:-2]), p, ca.SX(start.t0)))
    return ca.vertcat(q, _in_order(dependent, -solve(drift + G[:, free] @ v[free, :]), v[free, :]), *rest[:-2])


def _partitions(form: Formulation, times: Array) -> list[Partition]:
    """The partitions of the velocities for consecutive parts of a nominal run.

    The best partition has the smallest change of the determinant of S' M S. The determinant is infinite if the rows do
    not determine the dependent velocities. If the change is large, the run is divided into parts, each with its best
    partition.
    """
    G, M, at = _along_a_run(form, times)
    scales = form.dae.displacement_scales
    n_r, n_v = G.shape[1:]
    scaled, none = G * scales, np.zeros((len(G), n_r, n_r))
    saddle = np.block([[M * scales * scales[:, None], scaled.swapaxes(1, 2)], [scaled, none]])
    whole = np.linalg.slogdet(saddle)[1]
    if math.comb(n_v, n_r) <= _MOST_SETS_COMPARED:
        sets = list(combinations(range(n_v), n_r))
    else:  # sets that are independent at some time: each column is the farthest from earlier columns
        sets = sorted({tuple(sorted(qr(A, mode="r", pivoting=True)[-1][:n_r].tolist())) for A in scaled})
    signs, sizes = (np.stack(part) for part in zip(*(np.linalg.slogdet(scaled[:, :, list(s)]) for s in sets),
                                                   strict=True))  # fmt: skip
    # det(S' M S) is, up to its sign, a quotient. Its numerator is the determinant of the saddle point matrix, the same
    # for all sets. Its denominator is the squared determinant of the dependent columns of G. S is not needed.
    logs = whole - 2 * sizes

    def changes(first: int) -> Array:
        """Changes (sets, times) of logarithms of determinants from time `first` on; infinite after a sign change."""
        with np.errstate(invalid="ignore"):
            part = logs[:, first:]
            change = np.maximum.accumulate(part, axis=1) - np.minimum.accumulate(part, axis=1)
            lost = np.logical_or.accumulate(signs[:, first:] != signs[:, first, None], axis=1)
        return np.where(lost | ~np.isfinite(change), np.inf, change)

    found, first = [], 0
    while True:
        change = changes(first)
        best, last = int(change[:, -1].argmin()), len(at)
        if change[best, -1] > _LARGE_LOG_CHANGE:
            lengths = (change <= _LARGE_LOG_CHANGE).sum(axis=1)
            best = int(lengths.argmax())
            last = first + int(lengths[best])
        if found and found[-1].dependent == sets[best]:
            found[-1] = found[-1]._replace(until=np.inf)
            return found
        worst = first + int(logs[best, first:last].argmax())
        is_last = last >= len(at) or last <= first + 1
        found.append(Partition(sets[best], G[worst], np.inf if is_last else float(at[last - 1])))
        if is_last:
            return found
        first = last - 1


def _along_a_run(form: Formulation, times: Array) -> tuple[Array, Array, Array]:
    """Jacobians (m, n_r, n_v), mass matrices (m, n_v, n_v) and times (m,) of a nominal run, up to its end.

    There are eight times for each step of the run, and at least 100.
    """
    from scipy.integrate import solve_ivp

    dae, at = form.dae, form.start.nominal()
    assert dae.G is not None
    p, x0 = at["p"], np.concatenate([at["q"], at["v"], at["s"]])
    x, parameters, t = ca.SX.sym("x", len(x0)), ca.SX.sym("p", len(p)), ca.SX.sym("t")
    arguments = dae.arguments(x, parameters, t)
    rhs = ca.Function("rhs", [x, parameters, t], [ca.vertcat(*dae.rhs.call(list(arguments)))])
    f = ca.Function("matrices", [x, parameters, t], [dae.G(*arguments), dae.M(*arguments)])
    at, states = times[:1], x0[None]
    if times[-1] > times[0]:
        run = solve_ivp(
            lambda t, x: rhs(x, p, t).full().ravel(),
            (times[0], times[-1]),
            x0,
            method="DOP853",
            rtol=SLIGHT,
            atol=SLIGHT * dae.state_sizes,
            dense_output=True,
        )
        at = np.linspace(times[0], run.t[-1], max(100, 8 * len(run.t)))
        states = run.sol(at).T
    found = [f(state, p, time) for state, time in zip(states, at, strict=True)]
    G, M = (np.stack([matrices[i].full() for matrices in found]) for i in (0, 1))
    return G, M, at
