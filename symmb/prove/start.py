"""The states at one time as a front: proved solutions of the starting equations, and states after a change."""

import math
from collections.abc import Iterator
from dataclasses import replace

import casadi as ca
import numpy as np

from symmb._magnitudes import FACTORS, LAST_DIGITS, SAME, SLIGHT
from symmb._types import Array, Indices
from symmb.declare.symbolic import common
from symmb.prove import chebyshev as ch
from symmb.prove import discs, points
from symmb.prove.basis import richer
from symmb.prove.ellipses import MOST_PATCHES, ellipses, reaches
from symmb.prove.errors import ProofError
from symmb.prove.flow import Curve, integrated
from symmb.prove.front import Front
from symmb.prove.outputs import interpolation
from symmb.prove.problem import Problem
from symmb.prove.rounding import above, of_sum
from symmb.prove.several_parameters import discs_on_motion, equations_at_nodes, on_step, run
from symmb.prove.tape import Tape
from symmb.prove.taylor_models import constant, reach
from symmb.prove.terms import Grid, grid
from symmb.prove.time_step import TimeStep

NO_START = "there are parameters for which the scene cannot be started"
"""The message if no part of a box can be proved."""
_ROUGH = "sampled values, or a change to other velocities of a loop, cannot be shown to be smooth over the box"
"""The message if the states after a change cannot be proved."""
_NO_FRAME = Curve(np.zeros((0, 0)), np.zeros(0), np.zeros((0, 0)))
"""The frame of a step without motion."""


@np.errstate(all="ignore")
def first_front(problem: Problem, order: int) -> Front:
    """The front at the start, with the diagonal frame of the scales. ProofError if the start cannot be enclosed."""
    start, n = problem.start, problem.n
    own = Problem(start.residual, start.states, problem.middle, problem.radius, problem.variables, np.zeros(1),
                  np.ones(start.residual.numel_in(0)), start, weights=problem.weights)  # fmt: skip
    step = constant_step(own, 0.0, _unknowns(own, order))
    e = _distance(step)
    x, lost = polynomials(step, np.arange(n), problem.lengths(order))
    slopes = bounds_of(own.sensitivity_tape, step, e)[1]
    of_unknowns = above(slopes.reshape(len(e), n).T @ e) if len(e) else np.zeros(n)
    B = np.zeros((n, n, *problem.lengths(max(2, order // 2))))
    B[(np.arange(n), np.arange(n), *(0,) * problem.axes)] = problem.scales
    error = above(lost + of_unknowns)
    if not np.isfinite(error).all():
        raise ProofError("the starting values cannot be shown to be smooth over the box")
    return Front(0.0, x, B, np.zeros(n), error, np.zeros((n, n)))


def constant_step(problem: Problem, t: float, x: Array, h: float = 1e-9) -> TimeStep:
    """A short step of length h [s] from time t with constant states (n, N + 1, ...)."""
    return TimeStep(problem, t, h, integrated(x, np.zeros((len(x), 1, *x.shape[1:])), h), _NO_FRAME, _NO_FRAME.c)


def polynomials(step: TimeStep, which: Indices, lengths: tuple[int, ...], rtol: float = SLIGHT) -> tuple[Array, Array]:
    """Coefficients (m, *lengths) of some outputs at the start of a step, and bounds (m,) of their errors.

    ProofError if the outputs cannot be shown to be smooth.
    """
    c, remainder = _approximated(step, which, lengths, rtol)
    sizes, size = ch.sums(c, len(lengths)), math.prod(c.shape[1:])
    # smaller coefficients change no digit of the state
    c = np.where(np.abs(c) < 1e-17 / size * sizes[(..., *(None,) * len(lengths))], 0.0, c)
    whole = c[(slice(None), *map(slice, lengths))].copy()
    c[(slice(None), *map(slice, lengths))] = 0.0
    return whole, above(remainder + ch.sums(c, len(lengths)) + 1e-17 * sizes)


def _approximated(
    step: TimeStep, which: Indices, lengths: tuple[int, ...], rtol: float = SLIGHT
) -> tuple[Array, Array]:
    """Coefficients (m, n1, ...) of some outputs at the start of a step, and bounds (m,) of their errors.

    The axes are at least as long as `lengths`.
    """
    some = tuple(which.tolist())
    if step.problem.weights:
        c, remainder = _modelled(step, step.problem.tape_of_outputs(some), lengths)
    else:
        rho, most = _largest(step, step.problem.output_tape)
        c, remainder = interpolation(step, np.array([step.t0]), some, rho, most[which], np.zeros(len(some)), rtol)
    return c[:, 0], remainder[:, 0]


def nominal_front(problem: Problem, order: int) -> Array:
    """Approximate coefficients (n, order + 1, ...) of the states at the first time, without a proof."""
    nodes = grid(problem, problem.lengths(order), 2)
    u, p = _solutions(problem, nodes)
    with np.errstate(all="ignore"):
        tape = Tape(problem.start.states)
        found = tape.run(points.PLAIN, points.plain, [list(u), p, [0.0]])[0]
    x = np.stack([np.broadcast_to(value, nodes.shape) for value in found])
    if not np.isfinite(x).all():
        raise ProofError(NO_START)
    return nodes.fit(x)


def _unknowns(problem: Problem, order: int) -> Array:
    """Approximate solution u (n_u, order + 1, ...) of the starting equations as polynomials of the parameters."""
    if not problem.n:
        return np.zeros((0, *problem.lengths(order)))
    nodes = grid(problem, problem.lengths(order), 2)
    c = nodes.fit(_solutions(problem, nodes)[0])
    return np.where(np.abs(c) < LAST_DIGITS, 0.0, c)


def _solutions(problem: Problem, nodes: Grid) -> tuple[Array, list[Array | float]]:
    """Approximate solutions u (n_u, ...) of the starting equations at nodes, and the parameters there.

    ProofError if a solution is missing.
    """
    p = nodes.parameters(0)
    P = np.stack([np.broadcast_to(value, nodes.shape).ravel() for value in p], axis=1)
    u = problem.start.solve(P)
    if not np.isfinite(u).all():
        raise ProofError(NO_START)
    return u.T.reshape(u.shape[1], *nodes.shape), p


def _largest(step: TimeStep, tape: Tape) -> tuple[list[float], Array]:
    """Ellipses of the parameters, and bounds of the outputs of a tape on them. ProofError if there are no bounds."""
    for count in _counts(step.problem.d):
        for spread in (0.5, 0.1, 0.02):
            rho = [1.0, *ellipses(step, (spread, spread))[1:]]
            most = reaches(step.discs_of(tape, (1, count), rho=rho)[0])
            if np.isfinite(most).all():
                return rho[1:], most
    raise ProofError("the starting values cannot be shown to be smooth over the box")


def _modelled(step: TimeStep, tape: Tape, lengths: tuple[int, ...]) -> tuple[Array, Array]:
    """Coefficients (m, 1, T) of the outputs of a tape at the start of a step, and their errors (m, 1)."""
    source = step.problem.basis(lengths[0])
    basis = richer(source)
    x, p, _ = equations_at_nodes(step, 1, basis)
    found = run(tape, [x, p, [constant(basis, step.t0)]])[0]
    own = np.array([a.in_chebyshev(1)[:, 0] for a in found]).reshape(len(found), -1)
    rest = np.array([above(a.radius + of_sum(len(a.c) + 2) * a.norm).max() for a in found]).reshape(-1, 1)
    return own[:, None], np.where(np.isnan(rest), np.inf, rest)


def bounds_of(tape: Tape, step: TimeStep, e: Array) -> list[Array]:
    """Bounds of the outputs of a tape, over the box and for all states within e (n,) of the motion."""
    d = step.problem.d
    if step.problem.weights:
        return [np.array([reach(a) for a in part]) for part in on_step(step, tape, e)]
    found: list[Array] = []
    for count in _counts(d):
        found = [reaches(part) for part in step.discs_of(tape, (1, count), e)]
        if all(np.isfinite(part).all() for part in found):
            break
    return found


def _counts(d: int) -> Iterator[int]:
    """Numbers of patches that are tried for each of d variables.

    More patches are tried than for steps, because pivots of starting equations nearly cancel. There is only one start.
    """
    return (count for count in (1, 8, 32, 128) if count**d <= MOST_PATCHES)


def _distance(step: TimeStep) -> Array:
    """Bounds (n_u,) of the distance of the solution from the polynomials u.

    Y is approximately the inverse of the Jacobian J in the middle of a part of the box. If |Y r(u)| + |I - Y J(u + [-e,
    e])| e < e, exactly one solution is within e for all parameters of the part.

    Source: Krawczyk (1969); Neumaier (1990), Interval Methods for Systems of Equations, theorem 5.1.8.
    """
    problem, n = step.problem, step.problem.n
    if not n:
        return np.zeros(0)
    residuals = replace(step, problem=replace(problem, outputs=problem.rates))
    c, rest = _approximated(residuals, np.arange(n), step.x.c.shape[2:])
    off = above(ch.sums(c, problem.axes) + rest)
    # one inverse may not contract over the whole box; about a thousand parts with one inverse each take seconds
    for count in (count for count in (1, 8, 32) if count**problem.d <= 1024 and not (problem.weights and count > 1)):
        e = _contracted(step, off, count)
        if e is not None:
            return e
    raise ProofError(problem.start.unproved)


def _contracted(step: TimeStep, off: Array, count: int) -> Array | None:
    """Bounds (n_u,) of the distance of a solution if the residual is at most `off` (n_u,); None if not proved.

    Each variable has `count` parts.
    """
    n = step.problem.n

    def jacobians(e: Array) -> tuple[Array, Array]:
        """Middles and radii (k, n, n) of the Jacobian on the parts, for unknowns within e (n,)."""
        slopes = discs_on_motion(step, step.problem.jacobian_tape, e, (1, count))[1]
        shape = np.broadcast_shapes(*(np.shape(a.centre) for a in slopes))
        J = np.stack([np.broadcast_to(np.real(a.centre), shape).ravel() for a in slopes], axis=-1)
        R = np.stack([np.broadcast_to(a.swing, shape).ravel() for a in slopes], axis=-1)
        J, R = (a.reshape(-1, n, n).swapaxes(1, 2) for a in (J, R))
        return J, R

    try:
        Y = np.linalg.inv(jacobians(np.zeros(n))[0])
    except np.linalg.LinAlgError:
        return None
    # Each part has an inverse. All parts have the same e, because polynomials and error belong to the whole box.
    g = above(np.abs(Y) @ off)
    e = above(2.0 * g.max(axis=0))
    for _ in range(8):
        J, R = jacobians(e)
        D = np.abs(np.eye(n) - Y @ J) + np.abs(Y) @ (above(R) + of_sum(n + 3) * np.abs(J)) + of_sum(n + 3)
        grown = above(D) @ e
        new = above(g + grown).max(axis=0)
        if (new < e).all():
            return new
        e = above(1.5 * new)
    return None


@np.errstate(all="ignore")  # values that are not finite prove nothing
def mapped(problem: Problem, front: Front, f: ca.Function) -> Front:
    """The front of the states f(x, p, t).

    G is the Jacobian of f at x. H is the second derivative along e = B w at a point between x and x + e. Then f(x + e)
    = f(x) + G B w + H / 2. The new polynomials interpolate f(x) and G B.

    Raises
    ------
    ProofError         if f cannot be shown to be smooth there
    """
    n, d = problem.n, problem.axes
    lengths, of_frame = front.x.shape[1:], front.B.shape[2:]
    k = front.B.shape[1]
    x, columns, e, off = (ca.SX.sym(name, size) for name, size in zip("xbew", (n, n * k, n, n), strict=True))
    p, t = ca.SX.sym("p", len(problem.middle)), ca.SX.sym("t")
    values = ca.vertsplit(f(x, p, t))
    which = np.array([i for i, value in enumerate(values) if not ca.is_equal(value, x[i])], dtype=np.intp)
    m, new = len(which), ca.vertcat(*(values[i] for i in which))
    along = ca.jtimes(new, x, ca.reshape(columns, k, n).T)
    y = ca.vertcat(x, columns)
    both = common("mapped", [y, p, t], [ca.densify(ca.vertcat(new, ca.vec(along.T)))])
    same = common("same", [y, p, t], [ca.SX.zeros(n + n * k)])
    states = np.zeros((n + n * k, *np.maximum(lengths, of_frame)))
    states[(slice(n), *map(slice, lengths))] = front.x
    states[(slice(n, None), *map(slice, of_frame))] = front.B.reshape(n * k, *of_frame)
    scales = np.concatenate([problem.scales, np.maximum(ch.sums(states[n:], d), 1e-300)])
    require_known("the laws of sampled values", both)
    step = constant_step(replace(problem, rates=same, outputs=both, scales=scales), front.t, states)
    try:
        x_new, x_lost = polynomials(step, np.arange(m), lengths, FACTORS)
        B_new, B_lost = polynomials(step, np.arange(m, m + m * k), of_frame)
    except ProofError:
        raise ProofError(_ROUGH) from None

    y = ca.vertcat(x, e, off)
    of_errors = ca.jtimes(new, x, off), ca.jtimes(ca.jtimes(new, x, e), x, e)
    errors = common("errors", [y, p, t], [ca.densify(part) for part in of_errors])
    require_known("the laws of sampled values", errors)
    beside = above(front.x_error + front.B_error @ front.w)
    reach = above(ch.sums(front.B, d) @ front.w + beside)
    centres = np.zeros((3 * n, *lengths))
    centres[:n] = front.x
    more = np.concatenate([reach, reach, beside])
    moved = constant_step(replace(problem, scales=np.ones(3 * n)), front.t, centres)
    linear, quadratic = bounds_of(Tape(errors), moved, more)
    if not (np.isfinite(linear).all() and np.isfinite(quadratic).all()):
        raise ProofError(_ROUGH)
    x, B, x_error, B_error = (own.copy() for own in (front.x, front.B, front.x_error, front.B_error))
    x[which], x_error[which] = x_new, above(x_lost + linear + 0.5 * quadratic)
    B[which], B_error[which] = B_new.reshape(m, k, *of_frame), B_lost.reshape(m, k)
    return replace(front, x=x, B=B, x_error=x_error, B_error=B_error)


def require_known(where: str, *functions: ca.Function) -> None:
    """ProofError if functions have operations without an extension to discs."""
    if unknown := ", ".join(name for f in functions for name in Tape(f).unknown(discs.OPERATIONS)):
        raise ProofError(f"{where} contain {unknown}, and proofs do not support this operation")


def drifted(problem: Problem, front: Front, late: float) -> Front:
    """The front with the states up to a time `late` earlier and later [s]. ProofError if the rates are too large."""
    room = SAME * problem.scales  # states hardly move between an instant and its rounded time
    around = constant_step(problem, front.t - 2 * late, front.x, 4 * late)
    moved = above(late * bounds_of(problem.rate_tape, around, above(front.reach + room))[0])
    if not (moved < room).all():
        raise ProofError("the motion changes too fast at a time at which sampled values change")
    return replace(front, x_error=above(front.x_error + moved))
