"""Degrees of the equations over a step. Polynomials are interpolated exactly in enough nodes, without aliasing."""

from collections import defaultdict

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.prove.tape import Tape
from symmb.prove.time_step import TimeStep

Degree = tuple[Array, float | None]
"""Highest degrees of a number in time and in the parameters, and its value if it is a constant of the graph, otherwise
None. The degrees are infinite if the number is not a polynomial."""


def degrees_of_equations(step: TimeStep) -> tuple[Array, Array]:
    """Highest degrees (1 + d,) in time and in the parameters of the rates along the motion, and of their Jacobian.

    A state counts as a constant 0 only if the computed coefficients of both the state and its rate are 0.
    """
    none = np.zeros(step.x.c.ndim - 1)
    rates, slopes = (np.max([none, *part], axis=0) for part in _run(step, step.problem.jacobian_tape))
    return rates, slopes


def degrees_of_outputs(step: TimeStep) -> Array:
    """Highest degrees (n_y, d) in the parameters of the outputs along the motion."""
    (outputs,) = _run(step, step.problem.output_tape)
    return np.array([degree[1:] for degree in outputs])


def _run(step: TimeStep, tape: Tape) -> list[list[Array]]:
    """Degrees (1 + d,) of the outputs of a tape along the motion."""
    none = np.zeros(step.x.c.ndim - 1)
    x: list[Degree] = [
        (none + step.degrees if c.any() or rate.any() else none, None)
        for c, rate in zip(step.x.c, step.x.rate, strict=True)
    ]
    p: list[Degree] = [(none + (np.arange(len(none)) == 1 + j) * (j >= 0), None) for j in step.problem.variables]
    inputs = [x, p, [(none + (np.arange(len(none)) == 0), None)]]
    return [[degree for degree, _ in part] for part in tape.run(_OPERATIONS, lambda value: (none, value), inputs)]


def highest(c: Array) -> Array:
    """Highest degrees in each variable of polynomials (m, n0, ..., nd)."""
    used = np.asarray(c.any(axis=0))
    places = [np.flatnonzero(np.moveaxis(used, axis, 0).reshape(size, -1).any(axis=1))
              for axis, size in enumerate(used.shape)]  # fmt: skip
    return np.array([found.max(initial=0) for found in places], dtype=float)


def _largest(a: Degree, b: Degree) -> Degree:
    """Degrees of a sum."""
    return np.maximum(a[0], b[0]), None


def _sum(a: Degree, b: Degree) -> Degree:
    """Degrees of a product."""
    return a[0] + b[0], None


def _other(*arguments: Degree) -> Degree:
    """A function of constants is constant. Other functions do not count as polynomials."""
    constant = not any(degree.any() for degree, _ in arguments)
    return arguments[0][0] * 0.0 if constant else np.full(len(arguments[0][0]), np.inf), None


def _power(a: Degree, exponent: Degree) -> Degree:
    n = exponent[1]
    if n is not None and n >= 1 and n == int(n):
        return n * a[0], None
    return _other(a, exponent)


_OPERATIONS = defaultdict(
    lambda: _other,
    {
        ca.OP_ASSIGN: lambda a: a,
        ca.OP_NEG: lambda a: (a[0], None),
        ca.OP_TWICE: lambda a: (a[0], None),
        ca.OP_ADD: _largest,
        ca.OP_SUB: _largest,
        ca.OP_MUL: _sum,
        ca.OP_SQ: lambda a: _sum(a, a),
        ca.OP_DIV: lambda a, b: _sum(a, _other(b)),
        ca.OP_POW: _power,
        ca.OP_CONSTPOW: _power,
        ca.OP_CALL: lambda entry, group, at: (0.0 * at[0], None),  # within a piece of a table
    },
)
"""CasADi's operations on degrees."""
