"""Equations for redundant rows: multipliers of least norm, and combinations of rows that vanish."""

import casadi as ca

from symmb.model.system import System
from symmb.symbolic import least_multipliers, vanishing_rows


def redundancy_equations(system: System, reduced: System, nullities: tuple[int, int]) -> dict[str, dict[str, ca.SX]]:
    """Outputs of the DAE's Functions for a system with redundant rows, reduced to those that determine the motion.

    Of these rows and of the position rows among them, so many combinations vanish as `nullities` says. None do where
    they are independent wherever the system can move.
    """
    every = least_multipliers(system.G, reduced.G.T @ ca.SX(reduced.lam))
    if not any(nullities):
        return {"distribute_multipliers": {"lam": every}}
    N = N_c = vanishing_rows(reduced.G, nullities[0])
    if reduced.Psi.numel():
        N_c = vanishing_rows(reduced.G[: reduced.Phi.numel(), :], nullities[1])
    return {"vanishing": {"of_all": N, "of_positions": N_c}, "distribute_multipliers": {"lam": every}}
