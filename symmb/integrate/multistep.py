"""Problems compiled for CasADi's interface to SUNDIALS' multistep methods."""

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.events import longest_step
from symmb.integrate.integration import Integration, quiet
from symmb.integrate.one_sided import OneSided, one_sided
from symmb.integrate.problem import Problem
from symmb.integrate.side_walk import SideWalk, Stops
from symmb.integrate.switch_passes import SwitchPasses
from symmb.model import DAE
from symmb.symbolic import batch

MOST_STEPS, MOST_STATES = 1_000_000, 20_000_000
"""Most steps of a run, and most steps times states: more take minutes."""
CLOSE_TIMES = 1e-6
"""Output times closer than this [s] are rescaled: CasADi's interface takes times less than 1e-9 s apart for equal."""
_SCALED = {"ode", "alg", "quad"}
_SMOOTH_STEPS = 20_000
"""Most steps of a piece on one side of each switch: one that needs more is left to equations that follow the state."""
_NOISE = 1e-15
"""Rounding of a position that counts: tolerances of short pieces are no smaller."""


def multistep_integration(
    problem_of: Callable[[DAE], Problem],
    dae: DAE,
    plugin: str,
    options: Callable[[Problem, float], dict[str, Any]],
    times: Array,
    rtol: float,
    units: Array | None = None,
    order: int = 0,
) -> Integration:
    """Problems of DAEs compiled for CasADi's interface to SUNDIALS; options for an integration over a given time.

    Steps end at switches, and are so short that none passes over another pulse of a law of time. Errors of the states
    (n_x,) are measured by their units.
    """
    problem = problem_of(dae).jets(order)
    problem = problem if units is None else problem.in_units(units)
    guess = ca.Function("guess", [problem.x, problem.p, problem.t], [problem.z_guess])
    project = problem.projection()
    whole = between = None
    longest = longest_step(dae, times)
    stops = SwitchPasses(dae, times, rtol).stops
    if not problem.x.numel() or len(times) < 2:
        return _MultistepIntegration(times, problem, None, None, guess, project, stops, units, None)
    # The limit holds from one output time to the next; a run that needs more is lost in a singularity.
    per_interval = max(min(MOST_STEPS, MOST_STATES // problem.x.numel()) // (len(times) - 1), 1000)

    def limited(problem: Problem, length: float, unit: float, most: float = math.inf) -> dict[str, Any]:
        limit = {"max_num_steps": min(most, per_interval)}
        return options(problem, length) | limit | ({"max_step_size": longest / unit} if np.isfinite(longest) else {})

    if project is None:
        unit = _time_unit(times)
        part = _parts(problem) if unit == 1 else _rescaled(problem, ca.SX(0), ca.SX(unit))
        length = float(times[-1] - times[0]) / unit
        whole = ca.integrator("whole", plugin, part, times[0] / unit, times / unit, limited(problem, length, unit))

    def from_0_to_1(name: str, problem: Problem, most: float = math.inf) -> ca.Function:
        """One integrator for every interval, by the time since its begin over its length."""
        begin, span = ca.SX.sym("begin"), ca.SX.sym("span")
        part = _rescaled(problem, begin, span) | {"p": ca.vertcat(problem.p, begin, span)}
        return ca.integrator(name, plugin, part, 0, 1, limited(problem, 1.0, float(np.diff(times).max()), most))

    between = from_0_to_1("between", problem)
    equations = None if order else one_sided(dae)
    if equations is None:
        smooth = None
    else:
        one = problem_of(equations.dae)
        smooth = _SmoothPieces(
            equations, one, from_0_to_1("smooth", one.from_begin(), _SMOOTH_STEPS), dae.n_q, rtol, units
        )
    return _MultistepIntegration(times, problem, whole, between, guess, project, stops, units, smooth)


class _MultistepIntegration(Integration):
    """Runs in one call, or in pieces between stops; these on one side of each switch if `smooth` is given."""

    def __init__(
        self,
        times: Array,
        problem: Problem,
        whole: ca.Function | None,
        between: ca.Function | None,
        guess: ca.Function,
        project: ca.Function | None,
        stops: Callable[[Array, Array], Stops],
        units: Array | None,
        smooth: "_SmoothPieces | None",
    ) -> None:
        n_x, n_quad = problem.x.numel(), problem.quad.numel()
        super().__init__(times, n_x, n_quad, whole, between, guess, project, stops=stops, units=units)
        self._smooth = smooth

    def _pieces(self, p: Array, stops: Stops) -> Callable[[float, float, Array], tuple[Array, Array]]:
        smooth, n = self._smooth, self.n_x
        if smooth is None or not np.isfinite(stops.passes).any():
            return super()._pieces(p, stops)
        units = np.ones(n) if self._units is None else self._units

        def free(begin: float, end: float, y: Array, p: Array) -> Array:
            x, quad = self.advance(begin, end, y[:n] / units, p)
            return np.concatenate([x * units, y[n:] + quad])

        span = float(np.ptp(self.times))
        walk = SideWalk(smooth.equations, p, stops, span, smooth.advance, smooth.advance, free)

        def piece(begin: float, end: float, x: Array) -> tuple[Array, Array]:
            y = walk.piece(begin, end, np.concatenate([x * units, np.zeros(self.n_quad)]))
            return y[:n] / units, y[n:]

        return piece


class _SmoothPieces:
    """Pieces of runs on one side of each switch.

    A zone that a motion passes may be narrower than the tolerance of its position: in short pieces tolerances are those
    of the displacement since their begin.
    """

    def __init__(
        self, equations: OneSided, problem: Problem, between: ca.Function, n_q: int, rtol: float, units: Array | None
    ) -> None:
        self.equations, self._between, self._n_q, self._rtol = equations, between, n_q, rtol
        self._units = np.ones(problem.x.numel()) if units is None else units
        at = [problem.x, problem.p, problem.t]
        speed = equations.dae.rhs.call(list(equations.dae.arguments(*at)))[0]
        self._start = ca.Function("start", at, [problem.z_guess, speed], {"cse": True})

    def advance(self, begin: float, end: float, y: Array, p: Array) -> Array:
        """From one time to another, which may be before it: y is the state and the integral along."""
        n, n_q, units = len(self._units), self._n_q, np.concatenate([self._units, np.ones(len(y) - len(self._units))])
        (z0,), (speed,) = batch(self._start, y[:n], p, np.array([begin]))
        size = float(np.max(np.abs(y[:n_q]) / units[:n_q], initial=0.0))
        way = float(np.max(np.abs(speed * (end - begin)) / units[:n_q], initial=0.0))
        noise = _NOISE * size / self._rtol  # in tolerances, of a displacement 1
        share = max(way, noise) or 1.0
        units[:n_q] *= min(share, 1.0)
        offset = np.full(len(y), noise / share)
        with quiet():
            parameters = np.concatenate([p, y[:n], units, offset, [begin, end - begin]])
            yf = batch(self._between, offset, z0, parameters)[0][0]
        return y + units * (yf - offset)


def _parts(problem: Problem) -> dict[str, ca.SX]:
    parts = {"x": problem.x, "z": problem.z, "p": problem.p, "t": problem.t}
    parts |= {"ode": problem.ode, "alg": problem.alg, "quad": problem.quad}
    return {name: e for name, e in parts.items() if e.numel()}


def _rescaled(problem: Problem, begin: ca.SX, span: ca.SX) -> dict[str, ca.SX]:
    """In terms of tau, t = begin + span tau."""
    tau, parts = ca.SX.sym("tau"), _parts(problem)
    own = {name: ca.substitute(parts[name], problem.t, begin + span * tau) for name in _SCALED & parts.keys()}
    return parts | {"t": tau} | {name: e if name == "alg" else span * e for name, e in own.items()}


def _time_unit(times: Array) -> float:
    """1, but close times apart: CasADi's interface takes those less than 1e-9 s apart for the same."""
    least = float(np.diff(times).min())
    return 1.0 if least > CLOSE_TIMES else 2.0 ** math.floor(math.log2(least))
