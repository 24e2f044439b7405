"""Where steps of solvers end that cannot find switches of the state: runs of DormandPrince tell them when."""

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.events import time_switches
from symmb.integrate.compiled import AnyEngine
from symmb.integrate.explicit import DormandPrince
from symmb.model import DAE
from symmb.start import Start
from symmb.symbolic import has_kinks

_LEAST_RTOL = 1e-12
"""Least tolerance of these runs: below it, steps are rounding."""
_MOST_STEPS = 20_000
"""Steps of these runs. Stiff motions need more: later passes are left to the solver's own step control."""

_AT_ONCE = 1e-9
"""Time after the start, over the horizon, within which a pass belongs to the start."""


class SwitchPasses:
    """Switches of time, and passes of switches of the state by a run of DormandPrince. It can be pickled.

    Parameters
    ----------
    dae : DAE
    times : (n_t,) array     output times [s]
    rtol : float             relative tolerance of the solver
    start : Start, optional  the engine of the solver computes the start
    """

    def __init__(self, dae: DAE, times: Array, rtol: float = 1e-8, start: Start | None = None) -> None:
        self._dae, self._times = dae, times
        self._of_time = time_switches(dae, times)
        self._engine: AnyEngine | None = None
        if len(times) > 1 and has_kinks(dae.rhs):
            x, p = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s), ca.SX.sym("p", len(dae.p_names))
            t = ca.SX.sym("t")
            nothing = ca.Function("nothing", [x, p, t], [ca.SX(1, 1)])
            solver = DormandPrince(max(rtol, _LEAST_RTOL))
            self._engine = solver.engine(dae, times[[0, -1]], nothing, start=start)
            self._engine.most_steps = _MOST_STEPS

    def __call__(self, x0: Array, p: Array) -> Array:
        """Stops (N, k) in order, infinite behind the last one [s], of samples x0 (N, n_x) or (N, 0), p (N, n_p)."""
        dae, p = self._dae, p[:, : len(self._dae.p_names)]
        stops = np.empty((len(p), 0)) if self._of_time is None else self._of_time(p)
        if self._engine is None:
            return stops
        passes = _passes(self._engine, x0[:, : dae.n_q + dae.n_v + dae.n_s], p)
        stops = np.sort(np.hstack([stops, np.where(np.isnan(passes), np.inf, passes)]), axis=1)
        return stops[:, np.isfinite(stops).any(axis=0)]

    def first(self, x0: Array, p: Array) -> float:
        """The first pass of a switch of the state by one sample, x0 (1, n_x), p (1, n_p) [s]; nan if there is none."""
        if self._engine is None:
            return np.nan
        passes = _passes(self._engine, x0, p).ravel()
        span = float(np.ptp(self._times))  # a motion may begin on a switch
        return float(np.fmin.reduce(passes[passes - self._times[0] > _AT_ONCE * span], initial=np.nan))

    def closest(self, x0: Array, p: Array) -> tuple[float, float]:
        """Time and distance [s] of the two stops of one sample, x0 (1, n_x) and p (1, n_p), that follow closest."""
        stops = self(x0, p)[0]
        stops = stops[np.isfinite(stops)]
        if len(stops) < 2:
            return np.nan, np.inf
        k = int(np.diff(stops).argmin())
        return float(stops[k]), float(np.diff(stops)[k])


def _passes(engine: AnyEngine, x0: Array, p: Array) -> Array:
    """Passes (N, k) of switches of the state [s], nan behind the last one."""
    _, failed_samples = engine.values(x0, p)
    return np.empty((len(p), 0)) if failed_samples.passes is None else failed_samples.passes
