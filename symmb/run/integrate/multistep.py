"""Integrations by SUNDIALS' multistep methods, through CasADi's interface."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.declare.symbolic import batch, common
from symmb.equations.model import DAE, Lazy
from symmb.run import integrate
from symmb.run.events import longest_step
from symmb.run.integrate.cells import CELLS, refined
from symmb.run.integrate.initial_value_problem import InitialValueProblem
from symmb.run.integrate.integration import Integration, RunAdvance, quiet
from symmb.run.integrate.side_walk import SideWalk, Stops
from symmb.run.integrate.switch_passes import SwitchPasses, follows_switches

USUAL, LEAST, LOST = 2.0, 200, 0.05
"""SUNDIALS limits the steps from one time to the next. The limit is USUAL times the mean number of steps, and at least
LEAST. A run that needs more steps continues interval by interval, up to the fraction LOST of the limit of the run."""
_SCALED = {"ode", "alg", "quad"}
_WITHOUT_DERIVATIVES = {"enable_forward": False, "enable_jacobian": False, "enable_fd": True}


def multistep_integration(
    problem_of: Callable[[DAE], InitialValueProblem],
    dae: DAE,
    plugin: str,
    options: Callable[[InitialValueProblem, float], dict[str, Any]],
    times: Array,
    rtol: float,
    units: Array | None = None,
    order: int = 0,
    first: float | None = None,
    independent: bool = False,
    of_state: bool = True,
) -> Integration:
    """The integration of a DAE by SUNDIALS. `options` gives CasADi's options for an integration over a given time.

    Steps end at switches, and are shorter than other pulses of functions of time. Errors of states and integrals are
    relative to `units` (n_x + n_quad,). If the first step [s] is not given, SUNDIALS chooses it. In an independent
    integration, the step control follows switches of the state, with steps of at most a thousandth of the horizon.
    With `of_state`, steps also end at the passes that runs of DormandPrince report. Without a C compiler there are no
    such runs, so that every integration of equations with switches of the state is independent.
    """
    independent = independent or follows_switches(dae)
    problem = problem_of(dae).jets(order)
    problem = problem if units is None else problem.in_units(units)
    guess = ca.Function("guess", [problem.x, problem.p, problem.t], [problem.z_guess])
    project, passes = problem.projection(), SwitchPasses(dae, times, rtol, of_state=of_state)
    n_x = problem.x.numel()
    if not n_x or len(times) < 2:
        return Integration(times, n_x, problem.quad.numel(), guess, None, None, project, passes.stops, units)
    whole = between = onward = smooth = None
    (fine, outputs), horizon = refined(times), float(times[-1] - times[0])
    # A run has at most a million steps. If the product of steps and states is above 20 million, a run takes minutes. An
    # independent integration is a check, which must take less than a second. Its product is at most a million.
    most = min(1_000_000, (1_000_000 if independent else 20_000_000) // n_x)
    # Longest step of an independent integration, divided by the horizon. Longer steps may pass over two switches of the
    # state.
    steps = _step_lengths(dae, times, first, 1e-3 * horizon if independent else np.inf)
    made = _Integrators(plugin, options, steps)
    if project is None:
        whole = made.over("whole", problem, fine, USUAL * most / CELLS)
        onward = Lazy(lambda: made.from_0_to_1("onward", problem, fine, LOST * most))
    if project is not None or passes.are_possible:
        between = made.from_0_to_1("between", problem, times, most * max(LOST, 1 / (len(times) - 1)))
    equations = integrate.one_sided(dae) if passes.are_possible and not independent and not order else None
    if equations is not None:
        one = problem_of(equations.dae)
        # Maximum number of steps of a piece on one side of each switch. If a piece needs more, the equations with
        # switches are used.
        integrator = made.from_0_to_1("smooth", one.from_begin(), times, 20_000)
        smooth = _SmoothPieces(equations, one, integrator, dae.n_q, rtol, units)
    return _MultistepIntegration(
        times,
        n_x,
        problem.quad.numel(),
        guess,
        whole,
        between,
        project,
        passes.stops,
        units,
        whole_times=(fine, outputs),
        onward=onward,
        limit=(USUAL * most / horizon, LOST * most),
        samples=dae.sampling is not None,
        smooth=smooth,
    )


class _Integrators(NamedTuple):
    """CasADi's integrators of one plugin, with options for an integration over a given time, and step lengths [s]."""

    plugin: str
    options: Callable[[InitialValueProblem, float], dict[str, Any]]
    steps: dict[str, float]

    def over(self, name: str, problem: InitialValueProblem, times: Array, most: float) -> ca.Function:
        """The integrator over all times, with at most `most` steps from one time to the next."""
        unit = _time_unit(times)
        part = _parts(problem) if unit == 1 else _rescaled(problem, ca.SX(0), ca.SX(unit))
        limits = self._limited(problem, float(times[-1] - times[0]) / unit, unit, most)
        return _integrator(name, self.plugin, part, times[0] / unit, times / unit, limits)

    def from_0_to_1(self, name: str, problem: InitialValueProblem, ends: Array, most: float) -> ca.Function:
        """The integrator for intervals between ends, with a time from 0 at the start to 1 at the end of an interval."""
        begin, span = ca.SX.sym("begin"), ca.SX.sym("span")
        part = _rescaled(problem, begin, span) | {"p": ca.vertcat(problem.p, begin, span)}
        limits = self._limited(problem, 1.0, float(np.diff(ends).max()), most)
        return _integrator(name, self.plugin, part, 0, 1, limits)

    def _limited(self, problem: InitialValueProblem, length: float, unit: float, most: float) -> dict[str, Any]:
        lengths = {name: step / unit for name, step in self.steps.items()}
        return self.options(problem, length) | lengths | {"max_num_steps": max(int(most), LEAST)}


def _step_lengths(dae: DAE, times: Array, first: float | None, longest: float) -> dict[str, float]:
    """SUNDIALS' options for the first step and for the longest step [s], if these are limited."""
    steps = {"step0": first, "max_step_size": min(longest_step(dae, times), longest)}
    return {name: length for name, length in steps.items() if length is not None and np.isfinite(length)}


@dataclass(eq=False)
class _MultistepIntegration(Integration):
    """Runs in one call, or in pieces between stops. If `smooth` is given, pieces are on one side of each switch."""

    smooth: "_SmoothPieces | None" = None

    def _pieces(self, p: Array, stops: Stops) -> RunAdvance:
        smooth, n = self.smooth, self.n_x
        if smooth is None or not np.isfinite(stops.passes).any():
            return super()._pieces(p, stops)
        every = np.ones(n + self.n_quad) if self.units is None else self.units
        units, quad_units = every[:n], every[n:]

        def free(begin: float, end: float, y: Array, p: Array) -> Array:
            x, quad = self.advance(self.between, p, begin, end, y[:n] / units)
            return np.concatenate([x * units, y[n:] + quad * quad_units])

        def one_sided(begin: float, end: float, y: Array, p: Array) -> Array:
            y = smooth.advance(begin, end, y, p)
            self.count(smooth.integrator)
            return y

        walk = SideWalk(smooth.equations, p, stops, float(np.ptp(self.times)), one_sided, free)

        def piece(begin: float, end: float, x: Array) -> tuple[Array, Array]:
            y = walk.piece(begin, end, np.concatenate([x * units, np.zeros(self.n_quad)]))
            return y[:n] / units, y[n:] / quad_units

        return piece


class _SmoothPieces:
    """Pieces of runs on one side of each switch.

    A motion may pass a zone that is narrower than the tolerance of the position. For this reason, tolerances in short
    pieces are relative to the displacement since the start of the piece.
    """

    def __init__(
        self,
        equations: "integrate.OneSided",
        problem: InitialValueProblem,
        integrator: ca.Function,
        n_q: int,
        rtol: float,
        units: Array | None,
    ) -> None:
        self.equations, self.integrator, self._n_q, self._rtol = equations, integrator, n_q, rtol
        self._n = problem.x.numel()
        self._units = np.ones(problem.x.numel() + problem.quad.numel()) if units is None else units
        at = [problem.x, problem.p, problem.t]
        speed = equations.dae.rhs.call(list(equations.dae.arguments(*at)))[0]
        self._start = common("start", at, [problem.z_guess, speed])

    def advance(self, begin: float, end: float, y: Array, p: Array) -> Array:
        """The state and the integral y at the time `end`, which may be before the time `begin`."""
        n, n_q, units = self._n, self._n_q, self._units.copy()
        (z0,), (speed,) = batch(self._start, y[:n], p, np.array([begin]))
        size = float(np.max(np.abs(y[:n_q]) / units[:n_q], initial=0.0))
        way = float(np.max(np.abs(speed * (end - begin)) / units[:n_q], initial=0.0))
        # Relative rounding error of a position. Tolerances of short pieces are not smaller.
        noise = 1e-15 * size / self._rtol  # divided by the tolerance of a displacement 1
        share = max(way, noise) or 1.0
        units[:n_q] *= min(share, 1.0)
        offset = np.full(len(y), noise / share)
        with quiet():
            parameters = np.concatenate([p, y[:n], units, offset, [begin, end - begin]])
            yf = batch(self.integrator, offset, z0, parameters)[0][0]
        return y + units * (yf - offset)


def _integrator(
    name: str, plugin: str, parts: dict[str, Any], begin: float, ends: Any, options: dict[str, Any]
) -> ca.Function:
    """CasADi's integrator of a problem. Without Newton iterations it needs no Jacobian, which takes long to derive.

    CasADi would derive the Jacobian nevertheless. Therefore the rates become a Function without derivatives.
    """
    if options.get("nonlinear_solver_iteration") == "functional":
        inputs, rates = [key for key in parts if key not in _SCALED], [key for key in parts if key in _SCALED]
        f = ca.Function("rates", parts, inputs, rates, _WITHOUT_DERIVATIVES)
        at = {key: ca.MX.sym(key, parts[key].sparsity()) for key in inputs}
        parts = at | {key: value for key, value in f.call(at).items() if key in rates}
    return ca.integrator(name, plugin, parts, begin, ends, options)


def _parts(problem: InitialValueProblem) -> dict[str, ca.SX]:
    parts = {"x": problem.x, "z": problem.z, "p": problem.p, "t": problem.t}
    parts |= {"ode": problem.ode, "alg": problem.alg, "quad": problem.quad}
    return {name: e for name, e in parts.items() if e.numel()}


def _rescaled(problem: InitialValueProblem, begin: ca.SX, span: ca.SX) -> dict[str, ca.SX]:
    """The problem with the independent variable tau instead of t = begin + span tau."""
    tau, parts = ca.SX.sym("tau"), _parts(problem)
    own = {name: ca.substitute(parts[name], problem.t, begin + span * tau) for name in _SCALED & parts.keys()}
    return parts | {"t": tau} | {name: e if name == "alg" else span * e for name, e in own.items()}


def _time_unit(times: Array) -> float:
    """Factor of times: 1, except for close times. CasADi's interface treats times less than 1e-9 s apart as equal."""
    least = float(np.diff(times).min())
    # Output times closer than this [s] are rescaled, because CasADi's interface treats times less than 1e-9 s apart
    # as equal.
    return 1.0 if least > 1e-6 else 2.0 ** math.floor(math.log2(least))
