"""Checks of a start: velocities and accelerations that do not contradict each other."""

import numpy as np

from symmb._errors import AssemblyError
from symmb._types import Array
from symmb.start.labels import constraint_of_row
from symmb.start.rank import vanishing_combinations
from symmb.start.start import VIOLATION, Start


def check_velocities(start: Start, p0: Array) -> None:
    """Raise AssemblyError if no velocities at the nominal parameters (n_p,) satisfy the constraints."""
    dae = start.dae
    reason = start.states(p0[None])[1][0]
    if not reason:
        return
    if "positive" in reason:
        raise AssemblyError(f"Start at the nominal parameters: {reason}.")
    q = start.q_nominal
    if dae.Phi_dot is None:
        raise AssemblyError("Start could not be solved for at the nominal parameters.")
    v = np.asarray(start.velocities(q, p0)).ravel()
    s = (np.zeros(dae.n_s),) if dae.n_s else ()
    r = np.abs(np.asarray(dae.Phi_dot(q, v, *s, p0, start.t0))).ravel()
    listed = ", ".join(start.listed_velocities)
    remedy = f"Leave one of {listed} free." if listed else "None is listed in start: constraints contradict each other."
    name = constraint_of_row(dae, int(r.argmax()))
    raise AssemblyError(f"Start velocities contradict the constraints: rate {r.max():.2g} in joint {name!r}. {remedy}")


def check_accelerations(start: Start, G: Array) -> None:
    """Raise AssemblyError if redundant rows agree on positions and velocities, but not on accelerations."""
    dae, at = start.dae, start.nominal()
    if dae.gamma is None:
        return
    x = (at["q"], at["v"], *([at["s"]] if dae.n_s else []), at["p"], start.t0)
    gamma = dae.gamma(*x).full().ravel() / dae.row_scales
    contradiction = np.abs(vanishing_combinations(G / dae.row_scales[:, None]).T @ gamma)
    if contradiction.max(initial=0.0) > VIOLATION * max(np.abs(gamma).max(initial=0.0), 1.0):
        names = ", ".join(map(repr, start.redundant))
        raise AssemblyError(f"The accelerations that {names} ask for at the start contradict each other.")
