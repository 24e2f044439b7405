"""The states at the first time as a front: the starting equations are solved, and the solution is proved."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from symmb._types import Array
from symmb.enclosures import chebyshev as ch
from symmb.enclosures import discs, points
from symmb.enclosures.curves import TimeStep
from symmb.enclosures.ellipses import TOO_MANY, ellipses, reaches
from symmb.enclosures.errors import ProofError
from symmb.enclosures.flow import Curve, fit, integrated, parameters_at
from symmb.enclosures.front import Front
from symmb.enclosures.outputs import interpolation
from symmb.enclosures.patches import Patches
from symmb.enclosures.problem import Problem
from symmb.enclosures.ranges import cut
from symmb.enclosures.rounding import above, of_sum
from symmb.enclosures.several_parameters import equations_at_nodes, on_step, run
from symmb.enclosures.tape import Tape
from symmb.enclosures.taylor_models import basis_of, reach

_SHARE = 1e-17
"""Share of a state below which coefficients of its start are cut."""

_NOISE = 1e-15
"""Coefficients of scaled unknowns that are rounding, and would be large on ellipses."""
_COUNTS = (1, 8, 32, 128)
"""Patches of each variable that are tried: a start solves equations whose pivots nearly cancel, and it is made once."""

NO_START = "there are parameters for which the scene cannot be started"
"""Why no part of a box can be proved."""
_NONE = Curve(np.zeros((0, 0)), np.zeros(0), np.zeros((0, 0)))
"""No frame."""


def first_front(problem: Problem, order: int) -> Front:
    """The start of the states, with the frame of their scales.

    Raises
    ------
    ProofError         if the start cannot be enclosed
    """
    with np.errstate(all="ignore"):
        return _first_front(problem, order)


def _first_front(problem: Problem, order: int) -> Front:
    start, n, d = problem.start, problem.n, problem.d
    own = Problem(start.residual, start.states, problem.middle, problem.radius, problem.variables, np.zeros(1),
                  np.ones(start.residual.numel_in(0)), start)  # fmt: skip
    u = integrated(_unknowns(own, order), np.zeros((own.n, 1, *(order + 1,) * d)), 1.0)
    step = TimeStep(own, 0.0, 1.0, u, _NONE, _NONE.c)
    e = _distance(step)
    every = tuple(range(n))
    if d > ch.FEW:
        c, rest = _modelled(step, own.output_tape, order)
    else:
        rho, most = _largest(step, start_of="outputs")
        c, rest = interpolation(step, np.zeros(1), every, rho, most, np.zeros(n))
    of_unknowns = above(_slopes(step, e).reshape(len(e), n).T @ e) if len(e) else np.zeros(n)
    c = c[:, 0]
    size = ch.sums(c, d)
    x, lost = _cut_to(c, order + 1)
    x_short, gone = cut(x, _SHARE * size)
    x = np.zeros((n, *(order + 1,) * d))
    x[(slice(None), *(slice(0, m) for m in x_short.shape[1:]))] = x_short
    frame_terms = max(2, order // 2) + 1
    B = np.zeros((n, n, *(frame_terms,) * d))
    B[(np.arange(n), np.arange(n), *(0,) * d)] = problem.scales
    error = above(rest[:, 0] + of_unknowns + lost + gone)
    if not np.isfinite(error).all():
        raise ProofError("the starting values cannot be shown to be smooth over the box")
    return Front(0.0, x, B, np.zeros(n), error, np.zeros((n, n)))


def nominal_front(problem: Problem, order: int) -> Array:
    """Coefficients (n, order + 1, ...) of about the states at the first time, without a proof.

    Raises
    ------
    ProofError         if there are parameters without a start
    """
    counts = [order + 3] * problem.d
    p = parameters_at(problem, [ch.nodes(m) for m in counts], leading=0)
    u = _solutions(problem, p, counts)
    with np.errstate(all="ignore"):
        tape = Tape(problem.start.states)
        found = tape.run(points.PLAIN, points.plain, [list(u), p, [0.0]])[0]
    x = np.stack([np.broadcast_to(value, counts) for value in found])
    if not np.isfinite(x).all():
        raise ProofError(NO_START)
    return fit(x, [order + 1] * problem.d)


def _cut_to(c: Array, terms: int) -> tuple[Array, Array]:
    """Coefficients up to a number of terms in each variable, and the sums of the others (m,)."""
    part = (slice(None), *(slice(0, terms),) * (c.ndim - 1))
    kept, others = ch.graded(c[part], c.ndim - 1), c.copy()
    others[part] -= kept
    return kept, ch.sums(others, c.ndim - 1)


def _unknowns(problem: Problem, order: int) -> Array:
    """Approximate solution u (n_u, order + 1, ...) of the starting equations as polynomials of the parameters."""
    n_u, d = problem.n, problem.d
    counts = [order + 3] * d
    if not n_u:
        return np.zeros((0, *(order + 1,) * d))
    p = parameters_at(problem, [ch.nodes(m) for m in counts], leading=0)
    c = fit(_solutions(problem, p, counts), [order + 1] * d)
    return np.where(np.abs(c) < _NOISE, 0.0, c)


def _solutions(problem: Problem, p: list[Array | float], counts: list[int]) -> Array:
    """Approximate solutions u (n_u, *counts) of the starting equations at nodes of the parameters."""
    P = np.stack([np.broadcast_to(value, counts).ravel() for value in p], axis=1)
    u = problem.start.solve(P)
    if not np.isfinite(u).all():
        raise ProofError(NO_START)
    return u.T.reshape(u.shape[1], *counts)


def _patches(step: TimeStep, rho: list[float], count: int = 1) -> Patches:
    return Patches(rho, [1, *[count] * (len(rho) - 1)], step.degrees)


def _largest(step: TimeStep, start_of: str) -> tuple[list[float], Array]:
    """Ellipses of the parameters, and bounds of the states or of the residual on them."""
    problem = step.problem
    tape = problem.output_tape if start_of == "outputs" else problem.rate_tape
    for count in _counts(problem.d):
        for spread in (0.5, 0.1, 0.02):
            rho = [1.0, *ellipses(step, (spread, spread))[1:]]
            most = reaches(tape.run(discs.OPERATIONS, discs.disc, step.on_patches(_patches(step, rho, count)))[0])
            if np.isfinite(most).all():
                return rho[1:], most
    raise ProofError("the starting values cannot be shown to be smooth over the box")


def _modelled(step: TimeStep, tape: Tape, order: int) -> tuple[Array, Array]:
    """Coefficients (m, 1, order + 1, ...) of values of the unknowns in several parameters, and their errors (m, 1)."""
    d = step.problem.d
    basis = basis_of(d, order + _MORE)
    x, p, _ = equations_at_nodes(step, 1, basis)
    found = run(tape, [x, p, [basis.constant(0.0)]])[0]
    kept = basis.counts[order]
    c, rest = np.zeros((len(found), 1, *(order + 1,) * d)), np.zeros((len(found), 1))
    for k, a in enumerate(found):
        own = basis.to_chebyshev @ a.coefficients()[:, 0]
        c[(k, 0, *basis.exponents[:kept].T)] = own[:kept]
        rest[k] = above(a.radius + np.abs(own[kept:]).sum() + of_sum(len(own) + 2) * a.norm).max()
    return c, np.where(np.isnan(rest), np.inf, rest)


_MORE = 3
"""Degrees of Taylor models of a start beyond those of the motion."""


def _slopes(step: TimeStep, e: Array) -> Array:
    """Bounds of the derivatives of the states by the unknowns, over the box and within e (n_u,) of them."""
    d = step.problem.d
    if d > ch.FEW:
        return np.array([reach(a) for a in on_step(step, step.problem.sensitivity_tape, e)[1]])
    found = np.empty(0)
    for count in _counts(d):
        real = step.on_patches(_patches(step, [1.0] * (d + 1), count), e)
        found = reaches(step.problem.sensitivity_tape.run(discs.OPERATIONS, discs.disc, real)[1])
        if np.isfinite(found).all():
            break
    return found


def _counts(d: int) -> Iterator[int]:
    """Patches of each of d variables that are tried."""
    return (count for count in _COUNTS if count**d <= TOO_MANY)


def _distance(step: TimeStep) -> Array:
    """Bounds (n_u,) of the distance of the solution from the polynomials u.

    With Y about the inverse of the Jacobian J at the middle, |Y r(u)| + |I - Y J(u + [-e, e])| e < e proves one
    solution within e, the only one there.

    Source: Krawczyk (1969); Neumaier (1990), Interval Methods for Systems of Equations, theorem 5.1.8.
    """
    problem, n = step.problem, step.problem.n
    if not n:
        return np.zeros(0)
    d = problem.d
    residual = Problem(problem.rates, problem.rates, problem.middle, problem.radius, problem.variables, problem.times,
                       problem.scales, problem.start)  # fmt: skip
    same = replace(step, problem=residual)
    if d > ch.FEW:
        c, rest = _modelled(step, problem.rate_tape, step.degrees[1])
    else:
        rho, most = _largest(step, "rates")
        c, rest = interpolation(same, np.zeros(1), tuple(range(n)), rho, most, np.zeros(n))
    off = above(ch.sums(c[:, 0], d) + rest[:, 0])
    real = _patches(step, [1.0] * (d + 1))
    middle = problem.jacobian_tape.run(discs.OPERATIONS, discs.disc, step.on_patches(real))[1]
    try:
        Y = np.linalg.inv(np.array([float(np.real(a.centre).mean()) for a in middle]).reshape(n, n).T)
    except np.linalg.LinAlgError:
        raise ProofError("the solution of the starting equations cannot be proved") from None
    g = above(np.abs(Y) @ off)
    e = above(2.0 * g)
    for _ in range(8):
        slopes = problem.jacobian_tape.run(discs.OPERATIONS, discs.disc, step.on_patches(real, e))[1]
        shape = np.broadcast_shapes(*(np.shape(a.centre) for a in slopes))
        J = np.stack([np.broadcast_to(np.real(a.centre), shape).ravel() for a in slopes], axis=-1)
        R = np.stack([np.broadcast_to(a.swing, shape).ravel() for a in slopes], axis=-1)
        J, R = (a.reshape(-1, n, n).swapaxes(1, 2) for a in (J, R))
        D = np.abs(np.eye(n) - Y @ J) + np.abs(Y) @ (above(R) + of_sum(n + 3) * np.abs(J)) + of_sum(n + 3)
        new = above(g + above(D.max(axis=0)) @ e)
        if (new < e).all():
            return new
        e = above(1.5 * new)
    raise ProofError("the solution of the starting equations cannot be proved")
