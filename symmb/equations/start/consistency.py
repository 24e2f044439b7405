"""Checks of a start: the constraints must not require contradictory velocities or accelerations."""

import casadi as ca
import numpy as np

from symmb._errors import AssemblyError
from symmb._magnitudes import SLIGHT
from symmb._types import Array
from symmb.equations.start.labels import constraint_of_row
from symmb.equations.start.rank import vanishing_combinations
from symmb.equations.start.residual_limits import VIOLATION
from symmb.equations.start.scales import rest_states
from symmb.equations.start.start import Start


def check_velocities(start: Start, p0: Array) -> None:
    """Raise AssemblyError if no velocities at the nominal parameters (n_p,) satisfy the constraints."""
    dae = start.dae
    reason = start.states(p0[None])[1][0]
    if not reason:
        return
    if "positive" in reason:
        raise AssemblyError(f"The start at the nominal parameters failed: {reason}.")
    q = start.q_nominal
    if dae.Phi_dot is None:
        raise AssemblyError("The start at the nominal parameters could not be computed.")
    v = np.asarray(start.velocities(q, p0)).ravel()
    s = (rest_states(dae),) if dae.n_s else ()
    r = np.abs(np.asarray(dae.Phi_dot(q, v, *s, p0, start.t0))).ravel()
    off = np.abs(start.joint_residuals(q, v, p0).full()).ravel() if start.joint_residuals is not None else np.zeros(1)
    listed = ", ".join(start.listed_velocities)
    opposed = f" {', '.join(map(repr, start.redundant))}" if start.redundant else ""
    remedy = f"Remove one of {listed} from start." if listed else f"The constraints{opposed} contradict each other."
    if off.max() > r.max():
        k = int(off.argmax())
        others = _determining(start, k, q, v, p0, s)
        asked = f" from the value of {', '.join(map(repr, others))}" if others else ""
        what = f"{start.joint_values[k]} differs by {off.max():.2g}{asked}"
    else:
        what = f"the residual rate is {r.max():.2g} in joint {constraint_of_row(dae, int(r.argmax()))!r}"
    raise AssemblyError(f"The start velocities contradict the constraints: {what}. {remedy}")


def _determining(start: Start, k: int, q: Array, v: Array, p: Array, s: tuple[Array, ...]) -> list[str]:
    """Names of the constraints whose rates determine the listed joint value number `k`."""
    dae, f = start.dae, start.joint_residuals
    if dae.G is None or f is None:
        return []
    symbols = f.sx_in()
    slopes = ca.Function("slopes", symbols, [ca.jacobian(f(*symbols), symbols[1])])(q, v, p).full()[k]
    G = dae.G(q, v, *s, p, start.t0).full()
    shares = np.abs(np.linalg.lstsq(G.T, slopes, rcond=None)[0])
    return [name for name, rows in dae.rows.items() if shares[rows].max(initial=0.0) > SLIGHT * shares.max()]


def check_accelerations(start: Start, G: Array, sizes: Array) -> None:
    """Raise AssemblyError if redundant rows have common positions and velocities, but no common accelerations."""
    dae = start.dae
    if not start.redundant or dae.gamma is None:  # gamma is derived at its first use
        return
    at = start.nominal()
    x = (at["q"], at["v"], *([at["s"]] if dae.n_s else []), at["p"], start.t0)
    gamma = dae.gamma(*x).full().ravel() / sizes
    contradiction = np.abs(vanishing_combinations(G / sizes[:, None], start.ranks[0]).T @ gamma)
    if contradiction.max(initial=0.0) > VIOLATION * max(np.abs(gamma).max(initial=0.0), 1.0):
        names = ", ".join(map(repr, start.redundant))
        raise AssemblyError(f"At the start, {names} require accelerations that contradict each other.")
