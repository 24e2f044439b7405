"""The initial value problem of a scene's simulator, or the reason why there is none."""

import casadi as ca
import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array
from symmb.enclosures.discs import OPERATIONS
from symmb.enclosures.problem import Problem, StartEquations
from symmb.enclosures.tape import Tape
from symmb.events import kinks
from symmb.model import Box
from symmb.simulation import DAESimulator, Formulation


def problem_of(method: object, simulator: object, box: Box) -> Problem:
    """The problem whose solutions a method encloses.

    Raises
    ------
    PropagationError         if the scene has loops, impacts, sampled values, kinks or jumps, or operations that are
                             not analytic, or starts in equilibrium
    """
    if not isinstance(simulator, DAESimulator):
        raise PropagationError(
            f"{method!r}: it needs the equations of a scene, but {simulator!r} only gives runs. Use PolynomialChaos()."
        )
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
    names = list(simulator.parameters)
    middle = np.array([float(value) for value in simulator.parameters.values()])
    radius, variables = np.zeros(len(names)), [-1] * len(names)
    uncertain = [(name, low, high) for name, (low, high) in zip(box.names, box.bounds, strict=True)]
    for name, low, high in uncertain:
        k = names.index(name)
        middle[k] = low
        if low < high:
            middle[k] = low + 0.5 * (high - low)
            radius[k] = np.nextafter(max(high - middle[k], middle[k] - low), np.inf)
            variables[k] = max(variables) + 1
    problem = _problem(form, middle, radius, tuple(variables), np.asarray(simulator.times, dtype=float))
    for tape in (problem.jacobian_tape, problem.sensitivity_tape, Tape(problem.start.states)):
        if unknown := tape.unknown(OPERATIONS):
            raise PropagationError(f"{method!r}: it has no remainder of {', '.join(unknown)}. Use PolynomialChaos().")
    return problem


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


def _problem(form: Formulation, middle: Array, radius: Array, variables: tuple[int, ...], times: Array) -> Problem:
    dae, begin = form.dae, float(times[0])
    n = dae.n_q + dae.n_v + dae.n_s
    x, p, t = ca.SX.sym("x", n), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
    later = t + begin if begin else t
    rates = ca.vertcat(*dae.rhs.call(list(dae.arguments(x, p, later)))) if n else ca.SX(0, 1)
    options = {"cse": True}
    return Problem(
        rates=ca.Function("rates", [x, p, t], [ca.densify(rates)], options),
        outputs=ca.Function("outputs", [x, p, t], [ca.densify(form.y(x, p, later))], options),
        middle=middle,
        radius=radius,
        variables=variables,
        times=times - begin,
        scales=dae.state_sizes.copy(),
        start=_start(form, p, t),
    )


def _start(form: Formulation, p: ca.SX, t: ca.SX) -> StartEquations:
    start = form.start
    u = ca.SX.sym("u", start.place.numel_in(0))
    held = start.position is None
    residual = ca.SX(0, 1) if start.position is None else start.position.residual(u, p)
    if held:
        u_at, u = ca.SX.zeros(u.numel(), 1), ca.SX.sym("u", 0)
    else:
        u_at = u
    q = start.place(u_at, p)
    s = [start.dae.s_start(q, p)] if start.dae.s_start is not None else []
    states = ca.vertcat(q, start.velocities(q, p), *s)
    position = start.position

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
