"""Equations for redundant rows: multipliers of least norm, and combinations of rows that vanish."""

from collections.abc import Sequence

import casadi as ca

from symmb.model.system import System
from symmb.symbolic import symmetric_solver, vanishing_rows


def redundancy_equations(
    system: System, reduced: System, rows: Sequence[int], nullities: tuple[int, int]
) -> dict[str, dict[str, ca.SX]]:
    """Outputs of the DAE's Functions for redundant rows of a system, of which `rows` are reduced.

    Of all its rows and of the position rows among them, so many combinations vanish as `nullities` says. None do where
    rows are independent wherever the system can move.
    """
    lam = ca.SX(reduced.lam)
    if not any(nullities):
        return {"distribute_multipliers": {"lam": _least_multipliers(system.G, rows, lam)}}
    N = N_c = vanishing_rows(reduced.G, nullities[0])
    if reduced.Psi.numel():
        N_c = vanishing_rows(reduced.G[: reduced.Phi.numel(), :], nullities[1])
    least = lam - N @ symmetric_solver(N.T @ N)(N.T @ lam)
    return {"vanishing": {"of_all": N, "of_positions": N_c}, "distribute_multipliers": {"lam": least}}


def _least_multipliers(G: ca.SX, rows: Sequence[int], lam: ca.SX) -> ca.SX:
    """Multipliers (n_r,) of all rows of G of least norm, with the same effect as lam (k,) on independent rows."""
    numbers, others = list(rows), [i for i in range(G.shape[0]) if i not in set(rows)]
    independent, dependent = G[numbers, :], G[others, :]
    solve = symmetric_solver(independent @ independent.T)
    # Dependent rows are C times the independent ones, so lam = [1; C]' all; the least norm has [1; C] (1 + C'C)^-1 lam.
    C = ca.horzcat(*[solve(independent @ dependent[i, :].T) for i in range(len(others))]).T
    of_left = symmetric_solver(ca.SX.eye(len(others)) + C @ C.T)(C @ lam)
    every = ca.SX(G.shape[0], 1)
    every[numbers] = lam - C.T @ of_left
    every[others] = of_left
    return ca.densify(every)
