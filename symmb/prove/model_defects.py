"""Bounds of the defects of the motion and of its frame over a step, for several parameters."""

from dataclasses import dataclass
from functools import reduce

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.prove import chebyshev as ch
from symmb.prove.curves import TimeStep
from symmb.prove.defects import ALIASED_GROWTH, LEAST_REMAINDER
from symmb.prove.ellipses import Control, node_counts, nodes_needed
from symmb.prove.errors import not_smooth
from symmb.prove.patches import largest_on
from symmb.prove.rounding import above, of_sum
from symmb.prove.several_parameters import at_nodes, equations_at_nodes, inputs_on_step, on_step, run
from symmb.prove.taylor_models import DEGREES_BEYOND_POLYNOMIALS, OPERATIONS, Model, basis_of, reach

_ALIASED_SHARE = 0.1
"""Fraction of the defect of the last step that may be due to aliasing."""
_COMPARED_ELLIPSE, _MOST_NARROWINGS, _NARROWEST_ELLIPSE = 1.2, 12, 1.02
"""Ratio of compared ellipses, most attempts with smaller ellipses, and the smallest parameter of an ellipse."""


@dataclass(frozen=True)
class _Ellipse:
    """An ellipse of time, bounds of the rates (n,) and of their Jacobian (n, n) on it, and the nodes that it needs."""

    rho: float
    rates: Array
    slopes: Array
    nodes: float


def _tried(step: TimeStep, rho: float, wanted: float) -> _Ellipse:
    """The ellipse with the parameter rho. The number of nodes is infinite if the equations have no bound there."""
    n = step.problem.n
    rates, slopes = (np.array([reach(a) for a in found])
                     for found in on_step(step, step.problem.jacobian_tape, rho=rho))  # fmt: skip
    nodes = np.inf
    if np.isfinite(rates).all() and np.isfinite(slopes).all():
        on = largest_on([rho, *[1.0] * step.problem.d], step.x.rate)
        nodes = nodes_needed([rho], wanted / float((rates + on).max()))
    return _Ellipse(rho, rates, slopes.reshape(n, n).T, nodes)


def _adapted(step: TimeStep, control: Control) -> _Ellipse:
    """The ellipse of the last step, a smaller one, or a neighbour with fewer nodes. ProofError if no ellipse works."""
    best = _tried(step, control.rho, control.wanted)
    for _ in range(_MOST_NARROWINGS):
        if np.isfinite(best.nodes) or best.rho <= _NARROWEST_ELLIPSE:
            break
        best = _tried(step, 1.0 + 0.5 * (best.rho - 1.0), control.wanted)
    if not np.isfinite(best.nodes):
        inputs = inputs_on_step(step, 0.0, best.rho)
        constant = inputs[2][0].basis.constant
        lost = step.problem.jacobian_tape.first(OPERATIONS, constant, inputs, lambda a: not np.isfinite(reach(a)))
        raise not_smooth(lost)
    control.turn += 1
    wider = _COMPARED_ELLIPSE if control.turn % 2 else 1.0 / _COMPARED_ELLIPSE
    other = _tried(step, 1.0 + wider * (best.rho - 1.0), control.wanted)
    best = min(best, other, key=lambda found: found.nodes)
    control.rho = best.rho
    return best


def defects_of_models(step: TimeStep, w: Array, control: Control) -> tuple[Array, Array, list[float]]:
    """Bounds of |C d| (n,) and of |C (A B - B')| (n, n), and the ellipses on which the equations are bounded.

    Aliasing may be a small fraction of the remainder w (n,). ProofError if the equations may not be analytic.
    """
    chosen, n, d = _adapted(step, control), step.problem.n, step.problem.d
    rho = [chosen.rho, *[1.0] * d]
    C_on = largest_on(rho, step.C.reshape(n * n, *step.C.shape[2:])).reshape(n, n)
    most = above(C_on @ (chosen.rates + largest_on(rho, step.x.rate)))
    wanted = np.maximum(_ALIASED_SHARE * control.wanted, ALIASED_GROWTH * w / step.h)
    (count,) = node_counts([chosen.rho], float((wanted / most).min()))
    own = _defect(step, count)
    defect = above(own + ch.aliasing([chosen.rho], [count]) * most)
    control.wanted = float(own.max())
    w = above(w + step.h * defect)
    B_on, rate_on = (largest_on(rho, c).reshape(n, n) for c in (step.B.c, step.B.rate))
    most = above(C_on @ (chosen.slopes @ (B_on + step.B.error_on(rho).reshape(n, n)) + rate_on))
    w = np.maximum(w, LEAST_REMAINDER * w.max())
    (count,) = node_counts([chosen.rho], ALIASED_GROWTH * float((w / (step.h * (most @ w))).min()))
    return defect, above(_frame(step, count) + ch.aliasing([chosen.rho], [count]) * most), rho


_subtract, _multiply, _add = OPERATIONS[ca.OP_SUB], OPERATIONS[ca.OP_MUL], OPERATIONS[ca.OP_ADD]


def _product(A: list[list[Model]], B: list[list[Model]]) -> list[list[Model]]:
    """The product of two matrices of Taylor models."""
    return [[reduce(_add, map(_multiply, row, column)) for column in zip(*B, strict=True)] for row in A]


def _matrix(entries: list[Model], n: int) -> list[list[Model]]:
    """The entries as rows of n entries."""
    return [entries[i : i + n] for i in range(0, len(entries), n)]


def _defect(step: TimeStep, count: int) -> Array:
    """Bounds (n,) of the interpolation of C d in time."""
    n, basis = step.problem.n, basis_of(step.problem.d, step.x.c.shape[2] - 1 + DEGREES_BEYOND_POLYNOMIALS)
    (f,) = run(step.problem.rate_tape, equations_at_nodes(step, count, basis))
    rate = at_nodes(step.x.rate, np.zeros(n), count, basis)
    d = [[_subtract(a, b)] for a, b in zip(rate, f, strict=True)]
    C = _matrix(at_nodes(step.C.reshape(n * n, *step.C.shape[2:]), np.zeros(n * n), count, basis), n)
    return np.array([_bound(row[0], count) for row in _product(C, d)])


def _frame(step: TimeStep, count: int) -> Array:
    """Bounds (n, n) of the interpolation of C (A B - B') in time."""
    # Taylor models of the defect of a frame have one degree more than the frame
    n, basis = step.problem.n, basis_of(step.problem.d, step.B.c.shape[2])
    entries = run(step.problem.jacobian_tape, equations_at_nodes(step, count, basis))[1]
    A = [entries[i::n] for i in range(n)]  # column-major
    B = _matrix(at_nodes(step.B.c, step.B.error, count, basis), n)
    C, rate = (
        _matrix(at_nodes(c.reshape(n * n, *c.shape[-step.problem.d - 1 :]), np.zeros(n * n), count, basis), n)
        for c in (step.C, step.B.rate)
    )
    d = [[_subtract(a, b) for a, b in zip(*rows, strict=True)] for rows in zip(_product(A, B), rate, strict=True)]
    return np.array([[_bound(a, count) for a in row] for row in _product(C, d)])


def _bound(a: Model, count: int) -> float:
    """A bound of the interpolation in time at `count` nodes, for all parameters.

    Each coefficient of the Chebyshev polynomials of the parameters is interpolated separately.
    """
    c = np.broadcast_to(a.basis.to_chebyshev @ a.coefficients(), (a.basis.counts[-1], count))
    lebesgue = above(2.0 / np.pi * np.log(count) + 1.0)
    rounded = of_sum(len(c) + 2) * a.norm
    radius = float(above(np.broadcast_to(a.radius + rounded, count)).max())
    most = float(ch.bound_of_samples(c, np.zeros(len(c)), 1).sum() + lebesgue * radius)
    return above(most) if most == most else np.inf
