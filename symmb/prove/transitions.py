"""Changes of the states at one time: the front after a map."""

from dataclasses import replace

import casadi as ca
import numpy as np

from symmb._magnitudes import FACTORS, SAME
from symmb.declare.symbolic import common
from symmb.prove import chebyshev as ch
from symmb.prove import discs
from symmb.prove.errors import ProofError
from symmb.prove.front import Front
from symmb.prove.problem import Problem
from symmb.prove.rounding import above
from symmb.prove.start import bounds_of, polynomials, still
from symmb.prove.tape import Tape

_ROUGH = "sampled values, or other velocities of a loop, cannot be shown to be smooth over the box"


@np.errstate(all="ignore")  # what is not finite proves nothing
def mapped(problem: Problem, front: Front, f: ca.Function) -> Front:
    """The front of the states f(x, p, t).

    With the Jacobian G of f at x and its second derivative H along e = B w at a point between x and x + e,
    f(x + e) = f(x) + G B w + H / 2. The new polynomials are interpolations of f(x) and of G B.

    Raises
    ------
    ProofError         if f cannot be shown to be smooth there
    """
    n, d = problem.n, problem.d
    lengths, of_frame = front.x.shape[1:], front.B.shape[2:]
    x, columns, e, off = (ca.SX.sym(name, size) for name, size in zip("xbew", (n, n * n, n, n), strict=True))
    p, t = ca.SX.sym("p", len(problem.middle)), ca.SX.sym("t")
    values = ca.vertsplit(f(x, p, t))
    which = np.array([k for k, value in enumerate(values) if not ca.is_equal(value, x[k])], dtype=np.intp)
    m, new = len(which), ca.vertcat(*(values[k] for k in which))
    along = ca.jtimes(new, x, ca.reshape(columns, n, n).T)
    y = ca.vertcat(x, columns)
    both = common("mapped", [y, p, t], [ca.densify(ca.vertcat(new, ca.vec(along.T)))])
    same = common("same", [y, p, t], [ca.SX.zeros(n + n * n)])
    states = np.zeros((n + n * n, *np.maximum(lengths, of_frame)))
    states[(slice(n), *map(slice, lengths))] = front.x
    states[(slice(n, None), *map(slice, of_frame))] = front.B.reshape(n * n, *of_frame)
    scales = np.concatenate([problem.scales, np.maximum(ch.sums(states[n:], d), 1e-300)])
    require_known("the laws of sampled values", both)
    step = still(replace(problem, rates=same, outputs=both, scales=scales), front.t, states)
    try:
        x_new, x_lost = polynomials(step, np.arange(m), lengths, FACTORS)
        B_new, B_lost = polynomials(step, np.arange(m, m + m * n), of_frame)
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
    moved = still(replace(problem, scales=np.ones(3 * n)), front.t, centres)
    linear, quadratic = bounds_of(Tape(errors), moved, more)
    if not (np.isfinite(linear).all() and np.isfinite(quadratic).all()):
        raise ProofError(_ROUGH)
    x, B, x_error, B_error = (own.copy() for own in (front.x, front.B, front.x_error, front.B_error))
    x[which], x_error[which] = x_new, above(x_lost + linear + 0.5 * quadratic)
    B[which], B_error[which] = B_new.reshape(m, n, *of_frame), B_lost.reshape(m, n)
    return replace(front, x=x, B=B, x_error=x_error, B_error=B_error)


def require_known(where: str, *functions: ca.Function) -> None:
    """ProofError if functions have operations without an extension to discs."""
    if unknown := ", ".join(name for f in functions for name in Tape(f).unknown(discs.OPERATIONS)):
        raise ProofError(f"{where} contain {unknown}, and proofs do not support this operation")


def drifted(problem: Problem, front: Front, late: float) -> Front:
    """The front with all states within a time `late` before and after [s]. ProofError if the rates are too large."""
    room = SAME * problem.scales  # states hardly move between an instant and its rounded time
    around = still(problem, front.t - 2 * late, front.x, 4 * late)
    moved = above(late * bounds_of(problem.rate_tape, around, above(front.reach + room))[0])
    if not (moved < room).all():
        raise ProofError("the motion changes too fast at an instant")
    return replace(front, x_error=above(front.x_error + moved))
