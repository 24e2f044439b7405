"""Ends of steps for solvers that cannot locate switches of the state. Runs of DormandPrince locate the switches."""

from dataclasses import replace

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.declare.symbolic import has_kinks
from symmb.equations.model import DAE
from symmb.equations.start import Start
from symmb.run.codegen import Engine, FailureCode, StepTolerances, compiler_advice, has_compiler
from symmb.run.events import time_switches
from symmb.run.integrate.compiled import Task
from symmb.run.integrate.explicit import DormandPrince
from symmb.run.integrate.initial_value_problem import build_problem
from symmb.run.integrate.side_walk import Stops, no_stops
from symmb.run.integrate.step_ends import switched

_SAFE_RTOL = 1e-8
"""Tolerance of a second run if the first run fails."""


class SwitchPasses:
    """Switches of time, and passes of switches of the state by a run of DormandPrince. Pickling is possible.

    Parameters
    ----------
    dae : DAE
    times : (n_t,) array     output times [s]
    rtol : float             relative tolerance of the solver
    start : Start, optional  start of the runs, if the engine of the solver computes it
    of_state : bool          whether switches of the state are located, if there is a compiler
    """

    def __init__(
        self, dae: DAE, times: Array, rtol: float = 1e-8, start: Start | None = None, of_state: bool = True
    ) -> None:
        self._dae, self._times = dae, times
        self._of_time = dae.remembered(time_switches, times)
        self._engine: Engine | None = None
        if of_state and len(times) > 1 and has_kinks(dae.rhs) and has_compiler():
            x, p = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s), ca.SX.sym("p", len(dae.p_names))
            t = ca.SX.sym("t")
            nothing = ca.Function("nothing", [x, p, t], [ca.SX(1, 1)])
            # Tolerance of these runs over that of the solver. Smallest tolerance of these runs: below it, steps
            # are rounding.
            solver = DormandPrince(max(0.1 * rtol, 1e-12))
            engine = solver.engine(Task(dae, times[[0, -1]], nothing, start=start))
            # Maximum number of steps of these runs. Stiff motions need more: step control then follows later passes.
            engine.most_steps = 20_000
            self._engine = engine if engine.ends.hysteresis else None

    @property
    def are_possible(self) -> bool:
        """Whether a run may have stops."""
        return self._of_time is not None or self._engine is not None

    def __call__(self, x0: Array, p: Array) -> Array:
        """Ordered stops (N, k) [s] of samples x0 (N, n_x) or (N, 0), p (N, n_p); infinite after the last stop."""
        return self.stops(x0, p).times

    def stops(self, x0: Array, p: Array) -> Stops:
        """The `Stops` of samples x0 (N, n_x) or (N, 0), p (N, n_p)."""
        dae, p = self._dae, p[:, : len(self._dae.p_names)]
        stops = np.empty((len(p), 0)) if self._of_time is None else self._of_time(p)
        if self._engine is None:
            return no_stops(len(p))._replace(times=stops)
        passes, until, sticks = _passes(self._engine, x0[:, : dae.n_q + dae.n_v + dae.n_s], p)
        passes = np.where(np.isnan(passes), np.inf, passes)
        stops = np.sort(np.hstack([stops, passes, sticks[:, None]]), axis=1)
        return Stops(stops[:, np.isfinite(stops).any(axis=0)], passes, until, sticks)

    def first(self, x0: Array, p: Array) -> float:
        """Time of the first pass of a switch of the state [s] by one sample x0 (1, n_x), p (1, n_p); nan if none."""
        if self._engine is None:
            return np.nan
        passes = _passes(self._engine, x0, p)[0].ravel()
        span = float(np.ptp(self._times))  # a motion may begin on a switch
        # A pass belongs to the start if its time after the start, divided by the horizon, is not above this value.
        return float(np.fmin.reduce(passes[passes - self._times[0] > 1e-9 * span], initial=np.nan))


def follows_switches(dae: DAE) -> bool:
    """Whether step control has to follow switches of the state, because there are no compiled runs to locate them."""
    return not has_compiler() and dae.remembered(_switches_with_state)


def _switches_with_state(dae: DAE, _: Array) -> bool:
    if not has_kinks(dae.rhs):
        return False
    found = switched(build_problem(dae, None, algebraic=False, work=False), dae, np.zeros(2))
    return bool(found.ends.hysteresis)


def follow_doubts(dae: DAE) -> tuple[str, ...]:
    """Warnings about runs in which step control has to follow switches of the state."""
    if not follows_switches(dae):
        return ()
    text = "The equations have switches of the state. Without a C compiler, steps do not end at switches"
    return (f"{text}: short pulses may be missed. {compiler_advice()}",)


def _passes(engine: Engine, x0: Array, p: Array) -> tuple[Array, Array, Array]:
    """Passes (N, k) of switches of the state [s], nan after the last one, and `until` and `sticks` of `Stops`."""
    passes, until, sticks = _passes_by(engine, x0, p)
    control, again = engine.control, np.isfinite(until)
    if not again.any() or not isinstance(control, StepTolerances) or control.rtol >= _SAFE_RTOL:
        return passes, until, sticks
    # If a force rises over a distance of a few thousand rounding errors of the position, smaller tolerances are noise.
    engine.control = replace(control, rtol=_SAFE_RTOL, atol=control.atol * _SAFE_RTOL / control.rtol)
    others = _passes_by(engine, x0[again], p[again])
    engine.control = control
    better = others[1] > until[again]
    for old, new in zip((passes, until, sticks), others, strict=True):
        old[np.flatnonzero(again)[better]] = new[better]
    return passes, until, sticks


def _passes_by(engine: Engine, x0: Array, p: Array) -> tuple[Array, Array, Array]:
    _, failed_samples = engine.values(x0, p)
    until = np.where(np.isnan(failed_samples.t_failed), np.inf, failed_samples.t_failed)
    sticks = np.where(failed_samples.failure == FailureCode.STICKS, until, np.inf)
    passes = failed_samples.passes
    if passes is None:
        return np.empty((len(p), 0)), until, sticks
    return passes, np.fmin(until, np.where(np.isnan(passes[:, -1]), np.inf, passes[:, -1])), sticks
