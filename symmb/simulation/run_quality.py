"""What cannot be trusted about a run: drift, singular positions, errors that have grown large."""

import numpy as np

from symmb._types import Array
from symmb.model import DAE
from symmb.simulation.certainty import error_doubts, rounding_of_outputs
from symmb.simulation.dae_simulator import DAESimulator
from symmb.start import Singularity, singularity
from symmb.symbolic import batch

_LEAST, _USUAL, _NEAR = 1e-6, 3e3, 1e2
"""Drift of energy that raises a doubt: the least one; in relative tolerances; and the same near singular positions.
Regular motion drifts by up to 1,000 tolerances with multistep methods, wrong branches by 300 and more.
tests/test_problems.py"""
_TIMES, _WORK, _CLOSER = 2000, 2e9, 2
"""A run that drifts is examined at so many times, but times (number of velocities)^3 stays below `_WORK`, which takes
seconds. A run that fails is examined so often, each time closer to its failure."""
_ROUNDING = 1e-14
"""Share of the largest energy up to which a change of energy may be rounding."""
_FALLS = 0.5
"""Share to which a drift of energy that is due to the tolerance falls at a tenth of it: to 0.1 by most solvers."""
_UNREACHED = 1e-2
"""Violation of positions, over the size of the scene, that no solver leaves where positions can be reached."""


def unexplained(drift: float, rtol: float | None, usual: float = _USUAL) -> bool:
    """Whether a relative drift is larger than the tolerance explains. Solvers of fixed steps have no tolerance."""
    return rtol is not None and drift > max(_LEAST, usual * rtol)


def drift_doubts(position: float, energy: float, is_singular: bool, rtol: float | None) -> tuple[str, ...]:
    """What drifts above the tolerance suggest. Energy drifts also at singular positions, where branches meet."""
    if unexplained(position, rtol):
        return (
            f"The run leaves its constraints by {position:.0e} of its size: they contradict each other, or a position "
            "is nearly singular.",
        )
    if not unexplained(energy, rtol, _NEAR if is_singular else _USUAL):
        return ()
    drift = f"The energy drifts by {energy:.0e}, which is more than rtol = {rtol:g} explains."
    if is_singular:
        return (f"{drift} The run may have taken another branch: try stabilization=AugmentedLagrangian().",)
    return (f"{drift} Try a smaller one.",)


def unreached(t: Array, violation: Array, size: float, rtol: float | None) -> str:
    """When and why a run leaves its constraints, as violations (n_t,) over the size tell; empty if it does not."""
    left = ~(violation <= _UNREACHED * size)
    if not left.any():
        return ""
    k = int(left.argmax())
    cause = "drives contradict each other, or ask for positions that cannot be reached"
    return (
        f"the run leaves its constraints at t = {t[k]:g} s, by up to {violation.max() / size:.0e} of its size: "
        f"{'steps are too long, ' if rtol is None else ''}{cause}"
    )


def pulse_doubts(longest: float, rtol: float | None) -> tuple[str, ...]:
    """A fixed step that may pass over a pulse of a law of time."""
    if rtol is not None or not np.isfinite(longest):
        return ()
    return (f"Steps of more than {longest:.2g} s may pass over a pulse in a law of time.",)


def closest_singularity(simulator: DAESimulator, X: Array, p: Array, times: Array, examine: bool) -> Singularity | None:
    """The time closest to a singular position, if one is close. Failed runs are examined closely, others if asked."""
    dae, first, failed = simulator.dae, X[:1], bool(np.isnan(X[-1]).any())
    near = _closest(simulator, X, p, times)
    if near or dae.G is None or not (failed or examine):
        return near
    number = int(np.clip(_WORK / dae.n_v**3, 2, _TIMES))
    begin, end = float(times[0]), times
    for _ in range(_CLOSER if failed else 1):
        lost = int(np.argmax(np.isnan(X).any(axis=1)))  # 0 if it does not fail
        end = np.unique(np.append(begin, np.linspace(end[max(lost - 1, 0)], end[lost or -1], number)))
        X = simulator.solver.integration(dae, end).run(first, p[None])[0].X
        near = near or _closest(simulator, X, p, end)
    return near


def _closest(simulator: DAESimulator, X: Array, p: Array, times: Array) -> Singularity | None:
    known = np.isfinite(X).all(axis=1)
    return singularity(simulator.dae, X[known], p, times[known])


def energies(dae: DAE, X: Array, p: Array, times: Array) -> tuple[Array, Array]:
    """Kinetic and potential energy (n_t,) of states (n_t, n_x) at parameters (n_p,) [J]."""
    q, v, s = np.split(X, [dae.n_q, dae.n_q + dae.n_v], axis=1)
    T, V = batch(dae.energy, q, v, *((s,) if dae.n_s else ()), p, times[:, None])
    return T[:, 0], V[:, 0]


def energy_change(T: Array, V: Array, W: Array) -> float:
    """Largest |T + V - W - E_0| of energies and work (n_t,) [J], 0 if it is within their rounding."""
    change = float(np.abs(T + V - W - (T + V - W)[0]).max(initial=0.0))
    return change if change > _ROUNDING * max(float(np.abs(energy).max(initial=0.0)) for energy in (T, V, W)) else 0.0


def largest_kinetic_energy(simulator: DAESimulator, x0: Array, p: Array, begin: float, end: float) -> float:
    """Over a second run from x0 (n_x,) with output times that are close together [J]."""
    times = np.linspace(begin, end, _TIMES)
    X = simulator.solver.integration(simulator.dae, times).run(x0[None], p[None])[0].X
    return float(np.nanmax(energies(simulator.dae, X, p, times)[0], initial=0.0))


def falls_with_tolerance(simulator: DAESimulator, x0: Array, p: Array, values: Array, change: float) -> bool:
    """Whether a run at a tenth of the tolerance has much less change of energy [J], and the same outputs (n_t, n_y).

    So it is where forces in balance do far more work than the motion has kinetic energy. On a wrong branch the change
    stays.
    """
    dae, times = simulator.dae, simulator.times
    work = dae.power is not None or dae.impacts is not None
    run = simulator.solver.tighter().integration(dae, times, work=work).run(x0[None], p[None])[0]
    if run.message:
        return False
    error = np.abs(batch(simulator.y, run.X, p, times[:, None])[0] - values)
    W = run.quad[:, 0] if run.quad.shape[1] else np.zeros(len(times))
    falls = energy_change(*energies(dae, run.X, p, times), W) < _FALLS * change

    def rounding() -> Array:
        return rounding_of_outputs(simulator.y, dae, run.X, p, times)

    return falls and not error_doubts(times, simulator.outputs, values, error, rounding)
