"""The initial value problem of a scene's simulator, or the reason why there is none."""

from dataclasses import replace
from typing import cast

import casadi as ca
import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array
from symmb.enclosures.discs import OPERATIONS
from symmb.enclosures.problem import Problem, StartEquations
from symmb.enclosures.tape import Tape
from symmb.events import kinks
from symmb.model import Box
from symmb.simulation import DAESimulator, Formulation, Simulator


def problem_of(method: object, simulator: Simulator, box: Box) -> Problem:
    """The problem whose solutions a method encloses.

    Raises
    ------
    PropagationError         if the scene has loops, impacts, sampled values, kinks or jumps, or operations that are
                             not analytic, or starts in equilibrium
    """
    # The attribute is read: from Python 3.12 on isinstance accepts a property that raises.
    expression: ca.Function | None = getattr(simulator, "expression", None)
    if not isinstance(simulator, DAESimulator) and expression is None:
        raise PropagationError(
            f"{method!r}: it needs the equations of a scene, or outputs that are plain expressions of parameters and "
            f"time, but {simulator!r} gives values only. Use PolynomialChaos()."
        )
    if isinstance(simulator, DAESimulator):
        form = _formulation(method, simulator)
        rates, outputs, scales = _equations(form)
        start = _start(form)
    else:
        p, t = ca.SX.sym("p", len(simulator.parameters)), ca.SX.sym("t")
        none = ca.SX.sym("x", 0)
        rates = ca.Function("rates", [none, p, t], [ca.SX(0, 1)])
        outputs = ca.Function("outputs", [none, p, t], [ca.densify(cast(ca.Function, expression)(p, t))])
        scales, start = np.zeros(0), StartEquations(rates, rates, lambda P: np.zeros((len(P), 0)))
    times = np.asarray(simulator.times, dtype=float)
    problem = Problem(rates, outputs, *_intervals(simulator, box), times - times[0], scales, start)
    if times[0]:
        problem = replace(problem, rates=_later(rates, times[0]), outputs=_later(outputs, times[0]))
    starts = [Tape(problem.start.residual), Tape(problem.start.states)]
    for tape in (problem.jacobian_tape, problem.sensitivity_tape, *starts):
        if unknown := tape.unknown(OPERATIONS):
            raise PropagationError(f"{method!r}: it has no remainder of {', '.join(unknown)}. Use PolynomialChaos().")
    return problem


def _later(f: ca.Function, begin: float) -> ca.Function:
    """f(x, p, begin + t)."""
    x, p, t = (ca.SX.sym(name, f.numel_in(i)) for i, name in enumerate("xpt"))
    return ca.Function(f.name(), [x, p, t], [f(x, p, t + begin)], {"cse": True})


def _intervals(simulator: Simulator, box: Box) -> tuple[Array, Array, tuple[int, ...]]:
    """Middles and radii of all parameters, and the numbers of their variables."""
    names = list(simulator.parameters)
    middle = np.array([float(value) for value in simulator.parameters.values()])
    radius, variables = np.zeros(len(names)), [-1] * len(names)
    for name, (low, high) in zip(box.names, box.bounds, strict=True):
        k = names.index(name)
        middle[k] = low
        if low < high:
            middle[k] = low + 0.5 * (high - low)
            radius[k] = np.nextafter(max(high - middle[k], middle[k] - low), np.inf)
            variables[k] = max(variables) + 1
    return middle, radius, tuple(variables)


def _formulation(method: object, simulator: DAESimulator) -> Formulation:
    """The formulation of a scene in which no row of constraints binds the states, if its motion is smooth."""
    form = simulator.unconstrained
    if form is None:
        rows = ", ".join(dict.fromkeys(name.rpartition(".")[0] or name for name in simulator.dae.row_names))
        raise PropagationError(
            f"{method!r}: joints close loops or have no coordinates of their own ({rows}). Its proofs are of open "
            "chains and trees alone. Use PolynomialChaos()."
        )
    _require_smooth(method, form, simulator.times)
    if form.start.is_equilibrium:
        raise PropagationError(
            f"{method!r}: the scene starts in equilibrium, which it does not prove. Give the start by values."
        )
    return form


def _require_smooth(method: object, form: Formulation, times: Array) -> None:
    dae = form.dae
    if dae.impacts is not None:
        raise PropagationError(
            f"{method!r}: the scene has impacts, over which it proves nothing. Use PolynomialChaos()."
        )
    if dae.sampling is not None:
        raise PropagationError(f"{method!r}: the scene holds sampled values. Use PolynomialChaos().")
    if (found := kinks(dae, times)) is not None:
        raise PropagationError(
            f"{method!r}: the equations have {found}. Its proofs are of smooth motions alone. Use PolynomialChaos()."
        )


def _equations(form: Formulation) -> tuple[ca.Function, ca.Function, Array]:
    """(x, p, t) -> x' and (x, p, t) -> y, and the sizes of the states."""
    dae = form.dae
    n = dae.n_q + dae.n_v + dae.n_s
    x, p, t = ca.SX.sym("x", n), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
    rates = ca.vertcat(*dae.rhs.call(list(dae.arguments(x, p, t)))) if n else ca.SX(0, 1)
    f = ca.Function("rates", [x, p, t], [ca.densify(rates)], {"cse": True})
    return f, ca.Function("outputs", [x, p, t], [ca.densify(form.y(x, p, t))], {"cse": True}), dae.state_sizes.copy()


def _start(form: Formulation) -> StartEquations:
    start, position = form.start, form.start.position
    p, t, places = ca.SX.sym("p", len(start.dae.p_names)), ca.SX.sym("t"), start.place.numel_in(0)
    u = ca.SX.sym("u", 0 if position is None else places)
    residual = ca.SX(0, 1) if position is None else position.residual(u, p)
    states = start.state(ca.SX.zeros(places, 1) if position is None else u, p)

    def solve(P: Array) -> Array:
        if position is None:
            return np.zeros((len(P), 0))
        found, ok = position.solve(P)
        return np.where(ok[:, None], found, np.nan)

    return StartEquations(
        ca.Function("residual", [u, p, t], [ca.densify(residual)], {"cse": True}),
        ca.Function("states", [u, p, t], [ca.densify(states)], {"cse": True}),
        solve,
    )
