"""Multipliers of constraints, and accelerations of bodies, from the accelerations of a formulation.

If all accelerations are known, G' lam = Q - M v' gives the multipliers lam. First, the multipliers of the rows of a
formulation follow from equations of the velocities that these rows determine. Then the equations of carried bodies give
the multipliers of the joints that carry them, from the last body of a tree to the first. No equation is divided by a
mass.

Source: Featherstone (2008), Rigid Body Dynamics Algorithms, section 5.3, the recursive Newton-Euler algorithm.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._magnitudes import ROUNDING
from symmb.declare.symbolic import ExplicitSolver, common, is_zero
from symmb.declare.symbolic import t as time_symbol
from symmb.equations.model import System
from symmb.run.formulations import Formulation

RANDOM_POINTS = 20
"""Number of random points for analytic functions. If a property holds at all these points, it holds everywhere."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """The bodies in a state of a formulation.

    Attributes
    ----------
    at : arguments of the Functions of the bodies
    J : (n, n_v) derivatives of the bodies' velocities with respect to the velocities of the formulation
    drift : (n,) accelerations of the bodies if the accelerations of the formulation are 0
    Q : (n,) forces on the bodies
    G : (n_r, n) Jacobian of all rows of the system, if the system is known
    """

    at: tuple[ca.SX, ...]
    J: ca.SX
    drift: ca.SX
    Q: ca.SX
    G: ca.SX


def of_bodies(form: Formulation, system: System | None, at: tuple[ca.SX, ...], qdot: ca.SX) -> Bodies:
    """The bodies in the state `at` of a formulation. `qdot` are the rates of its coordinates."""
    dae, (*state, p, t) = form.dae, at
    if form.bodies is None:
        G = ca.SX(0, dae.n_v)
        if system is not None:
            states = [system.q, system.v, *([system.s] if dae.n_s else []), system.p, time_symbol]
            G = ca.Function("G", states, [system.G])(*at)
        return Bodies(at, ca.SX.eye(dae.n_v), ca.SX.zeros(dae.n_v), dae.Q(*at), G)
    bodies = form.bodies.dae
    q, v, s = ca.SX.sym("q", dae.n_q), ca.SX.sym("v", dae.n_v), ca.SX.sym("s", dae.n_s)
    rate = ca.SX.sym("rate", dae.n_q)
    x = form.bodies.states()(ca.vertcat(q, v, s), p)
    moved = x[bodies.n_q : bodies.n_q + bodies.n_v]
    f = ca.Function("moved", [q, v, s, p, rate], [x, ca.jacobian(moved, v), ca.jtimes(moved, q, rate)])
    found, J, drift = f(*state[:2], state[2] if dae.n_s else ca.SX(0, 1), p, qdot)
    of_all = bodies.arguments(found, p, t)
    if form.bodies.loads is None:
        return Bodies(of_all, J, drift, bodies.Q(*of_all), ca.SX(0, bodies.n_v))
    return Bodies(of_all, J, drift, *form.bodies.loads()(ca.vertcat(*map(ca.vec, state)), p, t))


def solved_function(
    form: Formulation,
    system: System | None,
    at: tuple[ca.SX, ...],
    bodies: Bodies,
    vdot: ca.SX,
    of_rows: Callable[[ca.SX], ca.SX] = lambda f: f,
) -> ca.Function:
    """(x, p, t) -> multipliers of all rows of a system, and accelerations of its bodies. `at` are the symbols x, p, t.

    vdot (n_v,) are the accelerations of the formulation. If it has rows, `of_rows` returns their multipliers for forces
    (n_v, m) along its velocities. If it omits redundant rows, the multipliers are those of smallest norm.
    """
    assert system is not None
    dae, c, G = form.dae if form.bodies is None else form.bodies.dae, system.collected, bodies.G
    a = ca.densify(bodies.drift + bodies.J @ vdot)
    own = [c.row_names.index(name) for name in form.dae.row_names]
    carried = () if form.bodies is None else form.bodies.carried
    # the last body of a tree has one joint; the multipliers of this joint then act on the body before it
    parts = [part for joint, body in reversed(carried) for part in _parts(G, c.rows[joint], c.slices[body][1])]
    directions = [G[rows, columns] for rows, columns in parts]
    solvers = [ExplicitSolver(S) for S in _with_whole_numbers(form, at, [P @ P.T for P in directions])]

    def solve(f: ca.SX) -> ca.SX:
        """Multipliers of the rows of the formulation and of joints that carry bodies, for forces f (n, m)."""
        lam = ca.SX.zeros(G.shape[0], f.shape[1])
        if own:
            lam[own, :] = of_rows(bodies.J.T @ f)
            f = f - G[own, :].T @ lam[own, :]
        for (rows, columns), P, of_joint in zip(parts, directions, solvers, strict=True):
            lam[rows, :] = of_joint(P @ f[columns, :])
            f = f - G[rows, :].T @ lam[rows, :]
        return lam

    left = [k for k in range(G.shape[0]) if k not in {*own, *(row for rows, _ in parts for row in rows)}]
    every = solve(ca.horzcat(bodies.Q - dae.inertia(*bodies.at, a), G[left, :].T))
    lam, N = every[:, 0], every[:, 1:]
    N[left, :] = -ca.SX.eye(len(left))  # G' N = 0
    units = ca.substitute(c.units, system.p, at[1])
    of_units = N.T @ ca.diag(1 / units**2)
    least = lam - N @ ExplicitSolver(of_units @ N)(of_units @ lam) if left else lam
    return common("solved", list(at), [ca.densify(least), a])


def _parts(G: ca.SX, rows: slice, columns: slice) -> list[tuple[list[int], list[int]]]:
    """Rows of a joint with columns of the carried body: first the rows that depend on translations, then the others."""
    at, own = [*range(columns.start, columns.stop)], [*range(rows.start, rows.stop)]
    n = 2 if len(at) == 3 else 3
    first = [k for k in own if not is_zero(G[k, at[:n]])]
    parts = [(first, at[:n]), ([k for k in own if k not in first], at[n:])]
    return [part for part in parts if part[0]]


def _with_whole_numbers(form: Formulation, at: tuple[ca.SX, ...], matrices: Sequence[ca.SX]) -> list[ca.SX]:
    """Products P P' as functions of positions and parameters. Entries that are integers everywhere become numbers.

    If an analytic function is the same integer at random points, up to rounding, it is this integer everywhere.
    """
    dae, rng, n_free = form.dae, np.random.default_rng(0), at[0].numel() - form.dae.n_q
    q, p = form.start.q_nominal, form.start.nominal()["p"]
    # random parameters differ from the nominal ones by about 1 %
    spread = 0.01 * np.where(p == 0, 1.0, np.abs(p))
    f = ca.Function("matrices", list(at), [ca.densify(S) for S in matrices])
    points = [f.call([ca.vertcat(dae.retract(q, rng.normal(size=dae.n_v)), ca.DM.zeros(n_free)),
                      p + spread * rng.normal(size=len(p)), rng.normal()]) for _ in range(RANDOM_POINTS)]  # fmt: skip
    found = []
    for S, *values in zip(matrices, *points, strict=True):
        values = np.array([value.full() for value in values])
        whole, size = np.round(values[0]), np.sqrt(np.einsum("kii,kjj->kij", values, values))
        known = np.abs(values - whole) <= ROUNDING * np.where(whole == 0, size, np.abs(whole))
        entries = [ca.SX(whole[i, j] + 0.0) if known[:, i, j].all() else S[i, j] for j, i in np.ndindex(*S.shape)]
        found.append(ca.reshape(ca.vertcat(*entries), *S.shape))
    return found
