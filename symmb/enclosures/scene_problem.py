"""The initial value problem of a scene's simulator, or the reason why there is none."""

from functools import cache
from typing import cast

import casadi as ca
import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array
from symmb.black_boxes import Simulator
from symmb.enclosures.discs import OPERATIONS
from symmb.enclosures.independent_velocities import Equations, equations_of, start_states
from symmb.enclosures.modes import with_modes
from symmb.enclosures.problem import Change, Problem, StartEquations
from symmb.enclosures.sampling import sampled
from symmb.enclosures.schedule import Phase, Schedule, corners
from symmb.enclosures.tape import Tape
from symmb.events import kinks
from symmb.formulations import Formulation
from symmb.linear import ModalSimulator
from symmb.model import DAE, Box
from symmb.simulation import DAESimulator, prepare_equations
from symmb.symbolic import On, batch, branches, common
from symmb.symbolic import t as time_symbol


def problem_of(method: object, simulator: Simulator, box: Box) -> Problem:
    """The problem whose solutions a method encloses.

    Raises
    ------
    PropagationError         if the scene has impacts, joints that open or close, kinks or jumps that depend on the
                             state, or operations without a remainder in its equations or in all outputs
    """
    if isinstance(simulator, ModalSimulator):
        return _modal_problem(method, simulator, box)
    # The attribute is read: from Python 3.12 on isinstance accepts a property that raises.
    expression: ca.Function | None = getattr(simulator, "expression", None)
    if not isinstance(simulator, DAESimulator) and expression is None:
        raise PropagationError(
            f"{method!r}: it needs the equations of a scene, or outputs that are plain expressions of parameters and "
            f"time, but {simulator!r} gives values only. Use PolynomialChaos()."
        )
    times = np.asarray(simulator.times, dtype=float)
    if isinstance(simulator, DAESimulator):
        form = _formulation(method, simulator, box)
        equations = equations_of(form, simulator.scene and simulator.scene.system, times)
        return _of_equations(method, simulator, box, form, equations)
    p, t = ca.SX.sym("p", len(simulator.parameters)), ca.SX.sym("t")
    none = ca.SX.sym("x", 0)
    rates = ca.Function("rates", [none, p, t], [ca.SX(0, 1)])
    outputs = ca.Function("outputs", [none, p, t], [ca.densify(cast(ca.Function, expression)(p, t))])
    outputs, refused = _with_remainders(method, outputs)
    start = StartEquations(rates, rates, lambda P: np.zeros((len(P), 0)))
    problem = Problem(rates, _later(outputs, times[0]), *_intervals(simulator, box), times - times[0], np.zeros(0),
                      start, phase=Phase(rates), refused=refused)  # fmt: skip
    _require_tapes(method, problem)
    return problem


def _of_equations(
    method: object, simulator: DAESimulator, box: Box, form: Formulation, equations: Equations, begin: float = 0.0
) -> Problem:
    """The problem with the states of equations from a time on, from the first one on [s]."""
    times, intervals = np.asarray(simulator.times, dtype=float), _intervals(simulator, box)
    phase = _phase(method, form.dae, _later(equations.rates, times[0]), times, intervals, begin)
    outputs, refused = _with_remainders(method, _outputs(simulator, form, equations))
    regular, change = equations.regular, None
    if equations.following is not None:
        other = equations.following()
        x, p, t = (ca.SX.sym(name, equations.whole.numel_in(i)) for i, name in enumerate("xpt"))
        states = common("states", [x, p, t], [equations.whole(x, p, t)[other.kept.tolist()]])
        later = cache(lambda time: _of_equations(method, simulator, box, form, other, time))

        def following(time: float, problem: Problem) -> Problem:
            found = later(time if phase.valid else 0.0)
            return found.with_fields(middle=problem.middle, radius=problem.radius, errors=problem.errors)

        change = Change(equations.until - times[0], _later(states, times[0]), following)
    if form.dae.sampling is not None:
        change = sampled(form.dae, equations, times)
    problem = Problem(phase.rates, _later(outputs, times[0]), *intervals, times - times[0],
                      form.dae.state_sizes[equations.kept], _start(form, equations), phase=phase,
                      regular=regular and _later(regular, times[0]), refused=refused, change=change)  # fmt: skip
    _require_tapes(method, problem)
    return problem


def _require_tapes(method: object, problem: Problem) -> None:
    """Refuse operations without a remainder in equations, switches and the start."""
    starts = [Tape(problem.start.residual), Tape(problem.start.states)]
    of_switches = [] if problem.valid_tape is None else [problem.valid_tape]
    for tape in (problem.jacobian_tape, problem.sensitivity_tape, *of_switches, *starts):
        _require_remainders(method, ", ".join(tape.unknown(OPERATIONS)))


def _modal_problem(method: object, simulator: ModalSimulator, box: Box) -> Problem:
    """Frequencies and damping: the starting equations have the modes, and nothing moves."""
    runs = prepare_equations(simulator.scene)
    form, t = _formulation(method, runs, box), float(runs.times[0])
    equations = equations_of(form, runs.scene.system, runs.times[:1])
    modes, p = simulator.eigenvalues, np.array([*simulator.parameters.values()])
    sizes = form.dae.state_sizes[equations.kept]
    start = with_modes(_start(form, equations), equations, sizes, modes, p, t)
    _require_remainders(method, ", ".join(Tape(start.residual).unknown(OPERATIONS)))
    x, parameters, time = ca.SX.sym("x", 2 * len(modes)), ca.SX.sym("p", len(p)), ca.SX.sym("t")
    a, b = x[::2] - 1, x[1::2]
    share = ca.sqrt(a**2 + b**2)
    outputs = ca.vertcat(share * np.abs(modes) / (2 * np.pi), -a / share)
    rates = ca.Function("rates", [x, parameters, time], [ca.SX.zeros(x.numel())])
    return Problem(rates, common("outputs", [x, parameters, time], [outputs]), *_intervals(simulator, box), np.zeros(1),
                   _OF_A_MODE * np.ones(x.numel()), start, refused=("",) * x.numel())  # fmt: skip


_OF_A_MODE = 0.1
"""How far the shares of a mode, of size 1, may move on ellipses: frequencies are roots, which are not smooth at 0."""


def _require_remainders(method: object, unknown: str) -> None:
    if unknown:
        raise PropagationError(f"{method!r}: it has no remainder of {unknown}. Use PolynomialChaos().")


def _with_remainders(method: object, outputs: ca.Function) -> tuple[ca.Function, tuple[str, ...]]:
    """The outputs, not a number where they have operations without a remainder, and these operations of each."""
    if not Tape(outputs).unknown(OPERATIONS):
        return outputs, ("",) * outputs.numel_out(0)
    x, p, t = (ca.SX.sym(name, outputs.numel_in(i)) for i, name in enumerate("xpt"))
    values = ca.vertsplit(outputs(x, p, t))
    alone = (common("output", [x, p, t], [value]) for value in values)
    refused = tuple(", ".join(Tape(f).unknown(OPERATIONS)) for f in alone)
    if all(refused):
        _require_remainders(method, ", ".join(dict.fromkeys(refused)))
    known = [ca.SX(np.nan) if unknown else value for value, unknown in zip(values, refused, strict=True)]
    return common(outputs.name(), [x, p, t], [ca.densify(ca.vertcat(*known))]), refused


def _later(f: ca.Function, begin: float) -> ca.Function:
    """f(x, p, begin + t)."""
    if not begin:
        return f
    x, p, t = (ca.SX.sym(name, f.numel_in(i)) for i, name in enumerate("xpt"))
    return common(f.name(), [x, p, t], [f(x, p, t + begin)])


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


def _formulation(method: object, simulator: DAESimulator, box: Box) -> Formulation:
    """The formulation of a scene with the fewest rows of constraints, if its motion is smooth."""
    form = simulator.least_constrained
    if rows := _rows_that_may_bind(simulator, form, box):
        raise PropagationError(
            f"{method!r}: rows of constraints depend on others ({rows}), which is not proved. Use PolynomialChaos()."
        )
    _require_smooth(method, form)
    middle, radius, _ = _intervals(simulator, box)
    places = np.random.default_rng(0).uniform(-1, 1, (_POINTS, len(middle)))
    if contradiction := _contradiction(form, middle + radius * places):
        raise PropagationError(f"{method!r}: {contradiction}. Give a start that all parameters of the box allow.")
    return form


def _rows_that_may_bind(simulator: DAESimulator, form: Formulation, box: Box) -> str:
    """The rows that are left out of a formulation, and do not vanish at random positions and parameters of the box.

    An analytic function that vanishes at random points but for rounding vanishes everywhere.
    """
    if not form.start.redundant:
        return ""
    system, dae, rng = simulator.scene.system, form.dae, np.random.default_rng(0)
    x, p, t = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s), system.p, time_symbol
    of_bodies = x if form.bodies is None else form.bodies.states()(x, p)
    own = [system.q, system.v, system.s]
    rows = ca.Function("rows", [*own, p, t], [ca.densify(ca.vertcat(system.Phi, system.Psi))])
    parts = ca.vertsplit(of_bodies, [0, *np.cumsum([part.numel() for part in own]).tolist()])
    f = ca.Function("rows", [x, p, t], [rows(*parts, p, t)])
    middle, radius, _ = _intervals(simulator, box)
    turned = [dae.retract(form.start.q_nominal, delta).full().ravel() for delta in rng.normal(size=(_POINTS, dae.n_v))]
    X = np.hstack([turned, rng.normal(size=(_POINTS, dae.n_v + dae.n_s))])
    P = middle + radius * rng.uniform(-1, 1, (_POINTS, len(middle)))
    instants = rng.uniform(float(simulator.times[0]), float(simulator.times[-1]), (_POINTS, 1))
    residuals = np.abs(batch(f, X, P, instants)[0])
    binds = residuals.max(axis=0) > _VANISHES * max(1.0, residuals.max())
    names = system.collected.row_names
    left = [name for name, is_bound in zip(names, binds, strict=False) if is_bound and name not in dae.row_names]
    return ", ".join(dict.fromkeys(name.rpartition(".")[0] for name in left))


_POINTS, _VANISHES = 20, 1e-13
"""Random points, and rows over the largest one that are rounding there."""


def _contradiction(form: Formulation, P: Array) -> str:
    """Where the start is solved for, but what else is listed does not hold: at one of the parameters P (N, n_p)."""
    u, ok = form.start.position.solve(P)
    x = batch(form.start.state, u, P)[0]
    broken = ok & ~(batch(form.start.holds, x, u, P)[0] > 0).all(axis=1)
    if not broken.any():
        return ""
    k = int(broken.argmax())
    moved = {name: P[k, i] for i, name in enumerate(form.dae.p_names) if P[k, i] != form.dae.p_nominal[i]}
    where = ", ".join(f"{name} = {value:.6g}" for name, value in moved.items())
    return f"the start contradicts the rows of constraints, or itself, at {where}"


def _require_smooth(method: object, form: Formulation) -> None:
    dae = form.dae
    if dae.impacts is not None:
        what = "joints that open or close" if dae.impacts.joints is not None else "impacts"
        raise PropagationError(
            f"{method!r}: the scene has {what}, over which it proves nothing. Use PolynomialChaos()."
        )


def _phase(
    method: object,
    dae: DAE,
    rates: ca.Function,
    times: Array,
    intervals: tuple[Array, Array, tuple[int, ...]],
    begin: float,
) -> Phase:
    """The phase from a time on of equations whose rates are Functions of the time from the first one on."""
    found = kinks(dae, times)
    if found is None:
        return Phase(rates)
    if found.on_state.any():
        raise PropagationError(
            f"{method!r}: the equations have {found} that depend on the state. Its proofs are of motions that are "
            "smooth for some time at least. Use PolynomialChaos()."
        )
    x, p, t, none = (*(ca.SX.sym(name, rates.numel_in(i)) for i, name in enumerate("xpt")), ca.SX.sym("none"))
    f = ca.Function("rates", [x, p, t, none], [rates(x, p, t)])
    branch = branches(f, [*((symbol, On.STATE) for symbol in (x, p, t)), (none, On.TIME)])
    arguments = [x, p, t, branch.sides]
    smooth = ca.Function("smooth", arguments, [ca.densify(ca.vertcat(*branch.outputs))])
    switches = ca.Function("switches", arguments, [ca.densify(branch.switches)])
    end, samples = float(times[-1] - times[0]), corners(*intervals[:2])
    return Schedule(smooth, switches, end, samples, float(times[0]), str(found)).phase(begin)


def _outputs(simulator: DAESimulator, form: Formulation, equations: Equations) -> ca.Function:
    """(x, p, t) -> y; a copy from a pickle, without its scene, has the multipliers and accelerations of runs."""
    x, p, t = (ca.SX.sym(name, equations.whole.numel_in(i)) for i, name in enumerate("xpt"))
    whole, symbols = equations.whole(x, p, t), form.declared.sx_in()
    depends = any(ca.which_depends(form.declared(*symbols), ca.vertcat(*symbols[3:]), 1, True) or [])
    if depends and simulator.scene is None:
        y = form.y(whole, p, t)
    else:  # values that are held change between steps
        solved = equations.solved()(x, p, t) if depends else [ca.SX.zeros(s.shape) for s in symbols[3:]]
        y = form.declared(whole, p, t, *solved)
    return common("outputs", [x, p, t], [ca.densify(y)])


def _start(form: Formulation, equations: Equations) -> StartEquations:
    start, position = form.start, form.start.position
    p, t = ca.SX.sym("p", len(start.dae.p_names)), ca.SX.sym("t")
    u = ca.SX.sym("u", start.state.numel_in(0))
    residual, states = position.residual(u, p), start_states(form, u, p)[equations.kept.tolist()]

    def solve(P: Array) -> Array:
        found, ok = position.solve(P)
        return np.where(ok[:, None], found, np.nan)

    return StartEquations(
        common("residual", [u, p, t], [ca.densify(residual)]), common("states", [u, p, t], [ca.densify(states)]), solve
    )
