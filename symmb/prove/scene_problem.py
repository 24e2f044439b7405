"""The initial value problem of a scene's simulator, or an error with the reason why there is none."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from typing import cast

import casadi as ca
import numpy as np

from symmb._errors import PropagationError
from symmb._magnitudes import SAME, SLIGHT
from symmb._types import Array, Indices, Mask
from symmb._units import units_of_parameters, values_text
from symmb.connect import Simulator
from symmb.declare.mechanics import NonlinearSpring, SpringDamper
from symmb.declare.symbolic import On, batch, branches, common, is_zero
from symmb.declare.symbolic import t as time_symbol
from symmb.equations.model import DAE, Box, Lazy
from symmb.prove.discs import OPERATIONS
from symmb.prove.independent_velocities import Equations, equations_of, start_states
from symmb.prove.modes import LinearStart, with_limits, with_modes
from symmb.prove.problem import Change, Phase, Problem, StartEquations, label
from symmb.prove.reactions import RANDOM_POINTS
from symmb.prove.rounding import U, grain_of
from symmb.prove.tape import Tape
from symmb.run.events import kinks
from symmb.run.formulations import Formulation, program_of
from symmb.run.linear import CriticalSimulator, ModalSimulator
from symmb.run.simulation import DAESimulator, Subject


def problem_of(method: object, simulator: Simulator, box: Box) -> Problem:
    """The problem with the solutions that a method encloses.

    Raises
    ------
    PropagationError         if the scene has impacts, or joints that open or close, or if its equations or all outputs
                             have unsupported operations
    """
    if isinstance(simulator, ModalSimulator):
        return _modal_problem(method, simulator, box)
    if isinstance(simulator, CriticalSimulator):
        return _critical_problem(method, simulator, box)
    # The attribute is read, because from Python 3.12 on isinstance accepts a property that raises.
    expression: ca.Function | None = getattr(simulator, "expression", None)
    if not isinstance(simulator, DAESimulator) and expression is None:
        raise PropagationError(
            f"{method!r} needs the equations of a scene, or outputs that are expressions of parameters and time, but "
            f"{simulator!r} returns only values. Use PolynomialChaos()."
        )
    times = np.asarray(simulator.times, dtype=float)
    if isinstance(simulator, DAESimulator):
        form = _formulation(method, simulator, box)
        equations = equations_of(form, simulator.scene and simulator.scene.system, times)
        return _of_equations(method, simulator, box, form, equations).with_fields(meeting=_meeting(simulator, box))
    p, t = ca.SX.sym("p", len(simulator.parameters)), ca.SX.sym("t")
    none = ca.SX.sym("x", 0)
    rates = ca.Function("rates", [none, p, t], [ca.SX(0, 1)])
    outputs = ca.Function("outputs", [none, p, t], [ca.densify(cast(ca.Function, expression)(p, t))])
    outputs, refused = _with_remainders(method, outputs)
    start = StartEquations(rates, rates, lambda P: np.zeros((len(P), 0)))
    problem = Problem(rates, _later(outputs, times[0]), *_intervals(simulator, box), times - times[0], np.zeros(0),
                      start, refused=refused)  # fmt: skip
    _require_tapes(method, problem)
    return problem


def _of_equations(
    method: object, simulator: DAESimulator, box: Box, form: Formulation, equations: Equations
) -> Problem:
    """The problem of a scene with given equations of motion."""
    times = np.asarray(simulator.times, dtype=float)
    outputs, refused = _with_remainders(method, _outputs(simulator, form, equations))
    rates, outputs, regular, change = equations.rates, _later(outputs, times[0]), equations.regular, None
    rates = _later(rates, times[0])
    if equations.following is not None:
        other = equations.following()
        x, p, t = equations.whole.sx_in()
        states = common("states", [x, p, t], [equations.whole(x, p, t)[other.kept.tolist()]])
        later = Lazy(lambda: _of_equations(method, simulator, box, form, other))
        change = Change(equations.until - times[0], _later(states, times[0]), partial(_over_same_box, later))
    if form.dae.sampling is not None:
        change = _sampled(form.dae, equations.whole, times, 0)
    problem = Problem(rates, outputs, *_intervals(simulator, box), times - times[0],
                      form.dae.state_sizes[equations.kept], _start(form, equations),
                      phase=_phase(form.dae, rates, outputs, times, equations.kept),
                      regular=regular and _later(regular, times[0]), refused=refused, change=change,
                      closing=_joints(form.dae.row_names))  # fmt: skip
    if problem.phase is not None:  # the sides are replaced when the states at the start are known
        problem = problem.on_sides(problem.phase.sides, np.zeros(problem.n), problem.middle, 0.0)
    _require_tapes(method, problem)
    return problem


def _over_same_box(later: Lazy[Problem], time: float, problem: Problem) -> Problem:
    """The later problem over the box of a problem."""
    return later().with_fields(middle=problem.middle, radius=problem.radius, errors=problem.errors)


def _sampled(dae: DAE, whole: ca.Function, times: Array, k: int) -> Change | None:
    """The change of sampled values at an instant after the first time, by its number; None after the last instant."""
    sampling = dae.sampling
    assert sampling is not None
    instants, begin = sampling.instants(times), float(times[0])
    instants = instants[np.diff(instants, prepend=-np.inf) > SAME * min(sampling.periods)]
    if k == len(instants):
        return None
    grain = grain_of(float(times[-1] - begin), bits=50)
    late = grain + 4 * U * float(np.abs(times).max())
    x, p, t = whole.sx_in()
    q, v, s, *_ = dae.arguments(whole(x, p, t), p, t)
    for T, (value, count), law in zip(sampling.periods, sampling.states, sampling.laws, strict=True):
        number = round((instants[k] - sampling.begin) / T)
        own = sampling.begin + T * number
        if abs(own - instants[k]) <= SAME * T:
            s[value], s[count] = law(q, v, s, p, own), s[count] + 1
    states = common("states", [x, p, t], [ca.densify(ca.vertcat(x[: x.numel() - dae.n_s], s))])
    time = float(np.round((instants[k] - begin) / grain) * grain)
    return Change(time, states, partial(_sampled_later, dae, whole, times, k + 1), late)


def _sampled_later(dae: DAE, whole: ca.Function, times: Array, k: int, time: float, problem: Problem) -> Problem:
    """The problem with the next change of sampled values."""
    return problem.with_fields(change=_sampled(dae, whole, times, k))


def _require_tapes(method: object, problem: Problem) -> None:
    """PropagationError if the equations, the switches or the start have unsupported operations."""
    starts = [Tape(problem.start.residual), Tape(problem.start.states)]
    of_switches = [] if problem.valid_tape is None else [problem.valid_tape]
    for tape in (problem.jacobian_tape, problem.sensitivity_tape, *of_switches, *starts):
        _require_remainders(method, ", ".join(tape.unknown(OPERATIONS)))


def _modal_problem(method: object, simulator: ModalSimulator, box: Box) -> Problem:
    """The problem of frequencies and damping. Starting equations determine the modes, and there is no motion."""
    linear, modes = _linear_start(method, simulator, box), simulator.eigenvalues
    intervals = _intervals(simulator, box)
    _require_fixed(method, linear, simulator, _points_of(*intervals[:2]))
    start = with_modes(linear, modes, np.array([*simulator.parameters.values()]))
    x = ca.SX.sym("x", 2 * len(modes))
    a, b = x[::2] - 1, x[1::2]
    share = ca.sqrt(a**2 + b**2)
    outputs = ca.vertcat(share * np.abs(modes) / (2 * np.pi), -a / share)
    return _still_problem(method, start, x, outputs, intervals)


def _critical_problem(method: object, simulator: CriticalSimulator, box: Box) -> Problem:
    """The problem of the critical values of a parameter. An eigenvalue is imaginary or 0 at these values."""
    linear, intervals = _linear_start(method, simulator, box), _intervals(simulator, box)
    p, (low, high) = np.array([*simulator.parameters.values()]), simulator.range
    values = simulator.run(p[None]).Y[0, 0]
    try:
        start = with_limits(linear, simulator.number, high - low, values, p)
    except ValueError:
        raise PropagationError(
            f"{method!r}: at a critical {simulator.outputs[0]}, several eigenvalues are imaginary or 0. Bounds cannot "
            "be proved for this case. Use PolynomialChaos()."
        ) from None
    middle, inner = intervals[0], _points_of(*intervals[:2])
    corners = middle + intervals[1] * np.sign(inner - middle)
    # four inner points and up to eight corners of the box
    samples = np.unique(np.vstack([inner[:4], corners[:8]]), axis=0)
    followed = values + (high - low) * batch(start.states, start.solve(samples), samples)[0]
    for k in range(len(values)):
        _require_fixed(method, linear, simulator, np.insert(samples, simulator.number, followed[:, k], axis=1))
    _require_first(method, simulator, samples, followed)
    x = ca.SX.sym("x", len(values))
    return _still_problem(method, start, x, values + (high - low) * x, intervals)


def _require_first(method: object, simulator: CriticalSimulator, samples: Array, followed: Array) -> None:
    """PropagationError if the limits `followed` (N, m) are not the limits of stability at samples (N, n_p) of the box.

    Another eigenvalue may become imaginary first, even if the followed one stays simple.
    """
    low, high = simulator.range
    is_other = ~(np.abs(simulator.run(samples).Y[:, 0] - followed) <= SLIGHT * (high - low)).all(axis=1)
    if is_other.any():
        p = samples[is_other.argmax()]
        where = values_text(simulator.parameters, p, units_of_parameters(simulator.parameters))
        raise PropagationError(
            f"{method!r}: at {where}, the limit of stability belongs to another eigenvalue than at the nominal "
            "parameters. Bounds cannot be proved for this case. Use smaller intervals, or PolynomialChaos()."
        )


def _linear_start(method: object, simulator: ModalSimulator | CriticalSimulator, box: Box) -> LinearStart:
    """The start of a simulator's scene, and the Jacobian there."""
    runs = Subject(simulator.scene, program_of(simulator.scene).solver).motion
    form, t = _formulation(method, runs, box), float(runs.times[0])
    equations = equations_of(form, runs.scene.system, runs.times[:1])
    return LinearStart(_start(form, equations), equations, form.dae.state_sizes[equations.kept], t)


def _require_fixed(
    method: object, linear: LinearStart, simulator: ModalSimulator | CriticalSimulator, P: Array
) -> None:
    """PropagationError for motions that are steady only in rotating coordinates: the Jacobian has other eigenvalues."""
    P = P[np.isfinite(P).all(axis=1)]
    P = P[np.isfinite(linear.start.solve(P)).all(axis=1)]
    if not linear.has(P, [found.values for found, _ in simulator.family.eigen_of(P)]):
        raise PropagationError(
            f"{method!r}: {simulator.name} starts in a motion that is steady only in rotating coordinates. Bounds "
            "cannot be proved for this case. Use PolynomialChaos()."
        )


def _still_problem(
    method: object, start: StartEquations, x: ca.SX, outputs: ca.SX, intervals: tuple[Array, Array, tuple[int, ...]]
) -> Problem:
    """The problem of constant states that solve starting equations."""
    _require_remainders(method, ", ".join(Tape(start.residual).unknown(OPERATIONS)))
    arguments = [x, ca.SX.sym("p", len(intervals[0])), ca.SX.sym("t")]
    rates = ca.Function("rates", arguments, [ca.SX.zeros(x.numel())])
    # on ellipses, scaled eigenvalues of size 1 move by 0.1, because frequencies are roots, and not smooth at 0
    sizes = 0.1 * np.ones(x.numel())
    return Problem(rates, common("outputs", arguments, [outputs]), *intervals, np.zeros(1), sizes, start,
                   refused=("",) * outputs.numel())  # fmt: skip


def _require_remainders(method: object, unknown: str) -> None:
    """PropagationError if there are unsupported operations."""
    if unknown:
        raise PropagationError(f"{method!r} does not support {unknown}. Use PolynomialChaos().")


def _with_remainders(method: object, outputs: ca.Function) -> tuple[ca.Function, tuple[str, ...]]:
    """The outputs, and the unsupported operations of each output. An output with unsupported operations is nan."""
    if not Tape(outputs).unknown(OPERATIONS):
        return outputs, ("",) * outputs.numel_out(0)
    x, p, t = outputs.sx_in()
    values = ca.vertsplit(outputs(x, p, t))
    alone = (common("output", [x, p, t], [value]) for value in values)
    refused = tuple(", ".join(Tape(f).unknown(OPERATIONS)) for f in alone)
    if all(refused):
        _require_remainders(method, ", ".join(dict.fromkeys(refused)))
    known = [ca.SX(np.nan) if unknown else value for value, unknown in zip(values, refused, strict=True)]
    return common(outputs.name(), [x, p, t], [ca.densify(ca.vertcat(*known))]), refused


def _later(f: ca.Function, begin: float) -> ca.Function:
    """The Function (x, p, t) -> f(x, p, begin + t)."""
    if not begin:
        return f
    x, p, t = f.sx_in()
    return common(f.name(), [x, p, t], [f(x, p, t + begin)])


def _intervals(simulator: Simulator, box: Box) -> tuple[Array, Array, tuple[int, ...]]:
    """Middles and radii of all parameters, and the indices of their variables."""
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
    """The formulation of a scene with the fewest rows of constraints. PropagationError if its motion is not smooth."""
    form = simulator.program.forms.least_constrained
    if rows := _rows_that_may_bind(simulator, form, box):
        raise PropagationError(
            f"{method!r}: some constraints depend on other constraints ({rows}). It cannot be proved that this is "
            "true at all positions. Use PolynomialChaos()."
        )
    if form.dae.impacts is not None:
        what = "joints that open or close" if form.dae.impacts.joints is not None else "impacts"
        raise PropagationError(f"{method!r} cannot prove bounds for scenes with {what}. Use PolynomialChaos().")
    middle, radius, _ = _intervals(simulator, box)
    if contradiction := _contradiction(form, _points_of(middle, radius)):
        raise PropagationError(f"{method!r}: {contradiction}. Use a start that is valid for all parameters of the box.")
    return form


def _rows_that_may_bind(simulator: DAESimulator, form: Formulation, box: Box) -> str:
    """The joints of omitted rows that are not 0 at random positions and parameters of the box; empty if all are 0.

    If an analytic function is 0 at random points, up to rounding, it is 0 everywhere.
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
    turns = rng.normal(size=(RANDOM_POINTS, dae.n_v))
    turned = [dae.retract(form.start.q_nominal, delta).full().ravel() for delta in turns]
    X = np.hstack([turned, rng.normal(size=(RANDOM_POINTS, dae.n_v + dae.n_s))])
    P = _points_of(middle, radius)
    instants = rng.uniform(float(simulator.times[0]), float(simulator.times[-1]), (RANDOM_POINTS, 1))
    residuals = np.abs(batch(f, X, P, instants)[0])
    # smaller residuals are rounding
    binds = residuals.max(axis=0) > 1e-13 * max(1.0, residuals.max())
    names = system.collected.row_names
    left = [name for name, is_bound in zip(names, binds, strict=False) if is_bound and name not in dae.row_names]
    return ", ".join(_joints(left))


def _joints(rows: Sequence[str]) -> tuple[str, ...]:
    """The names of the joints of rows."""
    return tuple(dict.fromkeys(name.rpartition(".")[0] for name in rows))


def _meeting(simulator: DAESimulator, box: Box) -> str:
    """A sentence about a spring or damper with points that may meet, by interpolation between runs; or empty."""
    from scipy.optimize import lsq_linear

    scene, (middle, radius, _) = simulator.scene, _intervals(simulator, box)
    springs = [e for e in (scene.system.elements if scene else ()) if isinstance(e, NonlinearSpring | SpringDamper)]
    own = [e for e in springs if isinstance(e, NonlinearSpring) or not (is_zero(e.length) and is_zero(e.damping))]
    if not own or len(simulator.times) < 2:
        return ""
    outputs = {f"{e.name}{k}": (e.point_b.r - e.point_a.r)[k] for e in own for k in range(3)}
    times = np.linspace(simulator.times[0], simulator.times[-1], _LOOKS)
    P = middle + np.vstack([np.zeros(len(radius)), np.diag(radius)[radius > 0]])
    looked = Subject(scene.with_outputs(outputs).with_times(times), simulator.solver).motion
    d = looked.run(P).Y.reshape(len(P), _LOOKS, len(own), 3)
    for i, e in product(range(_LOOKS - 1), range(len(own))):
        ways = np.vstack([d[1:, i, e], d[0, i + 1, e]]) - d[0, i, e]
        size = np.linalg.norm(ways, axis=1).sum()
        if np.linalg.norm(d[0, i, e]) <= size and lsq_linear(ways.T, -d[0, i, e], (-1, 1)).cost < (_MEETS * size) ** 2:
            where = f"{own[e].title} may reach the length 0 at about t = {times[i]:.3g} s"
            return f"{where}, where its force has no direction. Use earlier times, or PolynomialChaos()"
    return ""


_LOOKS, _MEETS = 401, 0.01
"""Number of times at which points are compared. Distance of points that meet, relative to their motion over the box."""


def _points_of(middle: Array, radius: Array) -> Array:
    """Random points (N, n_p) of a box."""
    return middle + radius * np.random.default_rng(0).uniform(-1, 1, (RANDOM_POINTS, len(middle)))


def _contradiction(form: Formulation, P: Array) -> str:
    """A message if a start at one of the parameters P (N, n_p) contradicts a given start value; otherwise empty."""
    u, ok = form.start.position.solve(P)
    x = batch(form.start.state, u, P)[0]
    broken = ok & ~(batch(form.start.holds, x, u, P)[0] > 0).all(axis=1)
    if not broken.any():
        return ""
    k = int(broken.argmax())
    moved = {name: P[k, i] for i, name in enumerate(form.dae.p_names) if P[k, i] != form.dae.p_nominal[i]}
    where = values_text(moved, moved.values(), form.dae.p_units)
    return f"at {where}, the start values contradict the constraints or each other"


def _phase(dae: DAE, rates: ca.Function, outputs: ca.Function, times: Array, kept: Indices) -> Phase | None:
    """The equations on given sides of the switches of the rates; None without switches. Times start at 0."""
    found = kinks(dae, times)
    if found is None:
        return None
    x, p, t = rates.sx_in()
    none = ca.SX.sym("none")
    both = common("both", [x, p, t, none], [rates(x, p, t), outputs(x, p, t)])
    branch = branches(both, [*((symbol, On.STATE) for symbol in (x, p, t)), (none, On.TIME)])
    own, needed = np.empty(0, dtype=np.intp), branch.outputs[0]
    while len(other := np.flatnonzero(ca.which_depends(needed, branch.sides, 1, False) or [])) > len(own):
        own, needed = other, ca.vertcat(branch.outputs[0], branch.switches[other.tolist()])
    if not len(own):
        return None
    sides, switches = (ca.densify(every[own.tolist()]) for every in (branch.sides, branch.switches))
    left = branch.sides[np.setdiff1d(np.arange(branch.sides.numel()), own).tolist()]
    y = [
        whole if ca.depends_on(smooth, left) else smooth  # keep outputs with other switches as they are
        for smooth, whole in zip(ca.vertsplit(branch.outputs[1]), ca.vertsplit(outputs(x, p, t)), strict=True)
    ]
    arguments, named = [x, p, t, sides], (*dae.q_names, *dae.v_names, *dae.s_names)
    names = (ca.vertcat(*map(ca.SX.sym, own)) for own in ([named[k] for k in kept], dae.p_names))
    f = ca.Function("switches", arguments, [switches])
    texts = f(*names, time_symbol - times[0], sides)
    return Phase(
        ca.Function("rates", arguments, [ca.densify(branch.outputs[0])]),
        ca.Function("outputs", arguments, [ca.densify(ca.vertcat(*y))]),
        f, np.ones(len(own)), tuple(map(label, ca.vertsplit(texts))), str(found), float(times[0]),
    )  # fmt: skip


def _outputs(simulator: DAESimulator, form: Formulation, equations: Equations) -> ca.Function:
    """(x, p, t) -> y. A pickled copy has no scene: it uses multipliers and accelerations of runs."""
    x, p, t = equations.whole.sx_in()
    whole, symbols = equations.whole(x, p, t), form.declared.sx_in()
    depends = any(ca.which_depends(form.declared(*symbols), ca.vertcat(*symbols[3:]), 1, True) or [])
    if depends and simulator.scene is None:
        y = form.y(whole, p, t)
    else:  # sampled values change only between steps
        solved = equations.solved()(x, p, t) if depends else [ca.SX.zeros(s.shape) for s in symbols[3:]]
        y = form.declared(whole, p, t, *solved)
    return common("outputs", [x, p, t], [ca.densify(y)])


def _start(form: Formulation, equations: Equations) -> StartEquations:
    """The starting equations of a formulation, for the states of the equations of motion."""
    start, position = form.start, form.start.position
    p, t = ca.SX.sym("p", len(start.dae.p_names)), ca.SX.sym("t")
    u = ca.SX.sym("u", start.state.numel_in(0))
    residual, states = position.residual(u, p), start_states(form, u, p)[equations.kept.tolist()]
    return StartEquations(
        common("residual", [u, p, t], [ca.densify(residual)]),
        common("states", [u, p, t], [ca.densify(states)]),
        partial(_solved, position.solve),
    )


def _solved(solve: Callable[[Array], tuple[Array, Mask]], P: Array) -> Array:
    """Approximate unknowns (N, n_u) of the start at parameters P (N, n_p); nan if there is no solution."""
    found, ok = solve(P)
    return np.where(ok[:, None], found, np.nan)
