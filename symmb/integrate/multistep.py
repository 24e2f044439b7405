"""Problems compiled for CasADi's interface to SUNDIALS' multistep methods."""

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.events import longest_step
from symmb.integrate.integration import Integration
from symmb.integrate.problem import Problem
from symmb.integrate.switch_passes import SwitchPasses
from symmb.model import DAE

MOST_STEPS, MOST_STATES = 1_000_000, 20_000_000
"""Most steps of a run, and most steps times states: more take minutes."""
CLOSE_TIMES = 1e-6
"""Output times closer than this [s] are rescaled: CasADi's interface takes times less than 1e-9 s apart for equal."""
_SCALED = {"ode", "alg", "quad"}


def multistep_integration(
    problem: Problem,
    dae: DAE,
    plugin: str,
    options: Callable[[float], dict[str, Any]],
    times: Array,
    rtol: float,
    units: Array | None = None,
) -> Integration:
    """A problem compiled for CasADi's interface to SUNDIALS; options for an integration over a time of given length.

    Steps end at switches, and are so short that none passes over another pulse of a law of time. Errors of the states
    (n_x,) are measured by their units.
    """
    problem = problem if units is None else problem.in_units(units)
    guess = ca.Function("guess", [problem.x, problem.p, problem.t], [problem.z_guess])
    project = problem.projection()
    whole = between = None
    longest = longest_step(dae, times)
    if problem.x.numel() and len(times) > 1:
        parts = {"x": problem.x, "z": problem.z, "p": problem.p, "t": problem.t}
        parts |= {"ode": problem.ode, "alg": problem.alg, "quad": problem.quad}
        parts = {name: e for name, e in parts.items() if e.numel()}
        # The limit holds from one output time to the next; a run that needs more is lost in a singularity.
        most = min(MOST_STEPS, MOST_STATES // problem.x.numel())
        limit = {"max_num_steps": max(most // (len(times) - 1), 1000)}

        def limited(length: float, unit: float) -> dict[str, Any]:
            return options(length) | limit | ({"max_step_size": longest / unit} if np.isfinite(longest) else {})

        tau = ca.SX.sym("tau")

        def rescaled(begin: ca.SX, span: ca.SX) -> dict[str, ca.SX]:
            """In terms of tau, t = begin + span tau."""
            own = {name: ca.substitute(parts[name], problem.t, begin + span * tau) for name in _SCALED & parts.keys()}
            return parts | {"t": tau} | {name: e if name == "alg" else span * e for name, e in own.items()}

        if project is None:
            unit = _time_unit(times)
            part = parts if unit == 1 else rescaled(ca.SX(0), ca.SX(unit))
            length = float(times[-1] - times[0]) / unit
            whole = ca.integrator("whole", plugin, part, times[0] / unit, times / unit, limited(length, unit))
        # With tau in [0, 1] one integrator serves every interval.
        begin, span = ca.SX.sym("begin"), ca.SX.sym("span")
        part = rescaled(begin, span) | {"p": ca.vertcat(problem.p, begin, span)}
        between = ca.integrator("between", plugin, part, 0, 1, limited(1.0, float(np.diff(times).max())))
    n_x, n_quad, stops = problem.x.numel(), problem.quad.numel(), SwitchPasses(dae, times, rtol)
    return Integration(times, n_x, n_quad, whole, between, guess, project, stops=stops, units=units)


def _time_unit(times: Array) -> float:
    """1, but close times apart: CasADi's interface takes those less than 1e-9 s apart for the same."""
    least = float(np.diff(times).min())
    return 1.0 if least > CLOSE_TIMES else 2.0 ** math.floor(math.log2(least))
