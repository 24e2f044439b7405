"""Ends of steps that are not output times: switches of time and of the state."""

from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.declare.symbolic import On, batch, branches, has_kinks, with_common_expressions
from symmb.equations.model import DAE
from symmb.run.codegen import StepEnds
from symmb.run.events import TimeSwitches, time_switches
from symmb.run.integrate.initial_value_problem import InitialValueProblem

_BESIDE, _NEAR, _SEVERAL = 64, 1e-10, 4.0
"""Number of close states, their distance divided by their size, and a safety factor. The deviations of a switch from a
straight line over these states show its rounding."""


@dataclass(frozen=True, eq=False)
class SwitchedProblem:
    """A problem with the branches on one side of each switch of the state.

    Attributes
    ----------
    problem                  problem with the sides as last parameters
    switches : (2 m,) SX     switches and their rates
    ends : StepEnds          ends of steps
    ranged : (m,) SX         expressions whose bounds replace the bounds of the switches; None: no replacement
    """

    problem: InitialValueProblem
    switches: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    ends: StepEnds = field(default_factory=StepEnds)
    ranged: ca.SX | None = None


def switched(problem: InitialValueProblem, dae: DAE, times: Array, of_time: bool = False) -> SwitchedProblem:
    """A problem without algebraic variables, with its switches.

    Switches of time are located before a run. With `of_time`, switches of time are treated like switches of the state.
    """
    x, p, t = problem.x, problem.p, problem.t
    f = ca.Function("problem", [x, p, t], [ca.densify(ca.vertcat(problem.ode, problem.quad))])
    smooth = not has_kinks(f)
    stops = None if dae.sampling is None and (smooth or of_time) else stops_in_time(dae, times)
    if smooth:
        return SwitchedProblem(problem, ends=StepEnds(stops=stops))
    branch = branches(
        with_common_expressions(f), [(x, On.STATE), (p, On.PARAMETERS), (t, On.STATE if of_time else On.TIME)]
    )
    (rates,) = branch.outputs
    ode = rates[: x.numel(), :]

    def slopes(values: ca.SX) -> ca.SX:
        return ca.densify(ca.jtimes(values, x, ode) + ca.jacobian(values, t))

    others = x[dae.n_q :]  # steep functions of velocities are smooth friction; step control follows its fast motion
    fronts, exponents = (
        [value for value in ca.vertsplit(values) if not ca.depends_on(value, others)]
        for values in (branch.fronts, branch.exponents)
    )
    switches = ca.vertcat(branch.switches, *fronts, *(slopes(exponent) for exponent in exponents))
    if not switches.numel():
        return SwitchedProblem(problem, ends=StepEnds(stops=stops))
    sides = ca.vertcat(branch.sides, ca.SX.sym("side", switches.numel() - branch.sides.numel()))
    on_branches = replace(problem, p=ca.vertcat(p, sides), ode=ode, quad=rates[x.numel() :, :])
    ends = StepEnds(hysteresis_of(dae, switches, x, p, t, sides), stops)
    return SwitchedProblem(on_branches, ca.vertcat(switches, slopes(switches)), ends)


@dataclass(frozen=True)
class StopsInTime:
    """A function of samples x0, p that returns their switches of time (N, k) [s]."""

    switches: TimeSwitches

    def __call__(self, x0: Array, p: Array) -> Array:
        return self.switches(p)


def stops_in_time(dae: DAE, times: Array) -> StopsInTime | None:
    """The switches of time of a DAE; None if it has none."""
    switches = dae.remembered(time_switches, times)
    return None if switches is None else StopsInTime(switches)


def hysteresis_of(dae: DAE, switches: ca.SX, x: ca.SX, p: ca.SX, t: ca.SX, sides: ca.SX) -> tuple[float, ...]:
    """A value above the rounding error of each switch, at typical sizes of its states. Other states have no effect."""
    size, m = np.maximum(dae.state_sizes, 1e-300), sides.numel()
    change = ca.Function("change", [x, p, t, sides], [ca.fabs(ca.jacobian(switches, x)) @ ca.DM(size)])
    # A switch may depend on the state only for some sides of other switches. The smallest change is used, because the
    # motion may never reach the other combinations of sides.
    # Number of combinations of sides for which changes of switches are evaluated.
    on_sides = np.vstack([np.ones(m), np.random.default_rng(0).choice([-1.0, 1.0], (64, m))])
    values = np.nan_to_num(batch(change, size, dae.p_nominal, np.zeros(1), on_sides)[0].reshape(-1, m), posinf=0.0)
    least = np.where(values > 0, values, np.inf).min(axis=0)
    values = np.where(values[0] > 0, values[0], np.where(np.isfinite(least), least, 1.0))
    # If a large number is added to a small state, the rounding error of the sum is larger than that of the state.
    value, share = ca.Function("value", [x, p, t, sides], [ca.densify(switches)]), np.linspace(0.0, 1.0, _BESIDE)
    near = batch(value, size * (1 + _NEAR * share[:, None]), dae.p_nominal, np.zeros(1), on_sides[0])[0].reshape(-1, m)
    line = np.column_stack([np.ones(_BESIDE), share])
    known = np.isfinite(near).all(axis=0)
    rounding = np.zeros(m)
    rounding[known] = np.ptp(near[:, known] - line @ (np.linalg.pinv(line) @ near[:, known]), axis=0)
    # Changes of a switch up to this fraction of its change by the sizes of all states are rounding errors.
    return tuple(np.maximum(1e-13 * values, _SEVERAL * rounding).tolist())
