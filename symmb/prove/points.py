"""Arithmetic on values at many points, with one common bound of their rounding errors.

A number is (values, error, lowest, highest). The exact value at each point differs from the computed value by at most
the error. The computed values are between lowest and highest.
"""

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from scipy.special import erf

from symmb._types import Array
from symmb.declare.symbolic import Entry
from symmb.prove.errors import ProofError
from symmb.prove.rounding import FUNCTION_ERROR, U, above
from symmb.prove.tape import operations_by_sides

Point = tuple[Array | float, float, float, float]


def point(values: Array | float, error: float = 0.0) -> Point:
    """A number from values and a bound of their errors."""
    if isinstance(values, np.ndarray):
        lowest, highest = float(values.min()), float(values.max())
    else:
        lowest = highest = float(values)
    if not (math.isfinite(lowest + highest + error)):
        raise ProofError("a value is infinite, or not a number")
    return values, above(error), lowest, highest


def size(a: Point) -> float:
    """Largest modulus of the computed values."""
    return max(-a[2], a[3])


def _rounded(values: Array | float, error: float, relative: float = U) -> Point:
    """The result of an operation: the propagated error of the arguments, plus the rounding error of the operation."""
    p = point(values, error)
    return p[0], above(error + relative * size(p)), p[2], p[3]


def _add(a: Point, b: Point) -> Point:
    return _rounded(a[0] + b[0], a[1] + b[1])


def _subtract(a: Point, b: Point) -> Point:
    return _rounded(a[0] - b[0], a[1] + b[1])


def _multiply(a: Point, b: Point) -> Point:
    return _rounded(a[0] * b[0], size(a) * b[1] + a[1] * (size(b) + b[1]))


def _square(a: Point) -> Point:
    return _rounded(a[0] * a[0], a[1] * (2.0 * size(a) + a[1]))


def _negative(a: Point) -> Point:
    return -a[0], a[1], -a[3], -a[2]


def _distance_from_zero(a: Point) -> float:
    """A lower bound of the moduli of the exact values. All values must have the same sign."""
    least = a[2] if a[2] > 0 else -a[3]
    if not least * (1.0 - 4.0 * U) > a[1]:
        raise ProofError("a denominator, or the argument of a root, a logarithm or a modulus, may be 0")
    return (least - a[1]) * (1.0 - 4.0 * U)


def _inverse(a: Point) -> Point:
    least = _distance_from_zero(a)
    return _rounded(1.0 / a[0], a[1] / least / least)


def _divide(a: Point, b: Point) -> Point:
    return _multiply(a, _inverse(b))


def _function(f: Callable[..., Array], slope: Callable[[float, float], float]) -> Callable[[Point], Point]:
    """The operation of an elementary function. Its derivative is at most slope(low, high) on an interval."""

    def operation(a: Point) -> Point:
        low, high = math.nextafter(a[2] - 2.0 * a[1], -math.inf), math.nextafter(a[3] + 2.0 * a[1], math.inf)
        try:
            steepest = slope(low, high)
        except (ValueError, ZeroDivisionError, OverflowError):
            raise ProofError(
                f"an argument of {f.__name__} may be outside its domain, or its value may be too large"
            ) from None
        return _rounded(f(a[0]), above(steepest * 1.001) * a[1], FUNCTION_ERROR)

    return operation


def _largest(low: float, high: float) -> float:
    return max(-low, high)


def _least(low: float, high: float) -> float:
    return 0.0 if low <= 0.0 <= high else min(abs(low), abs(high))


def _steepest_sine(low: float, high: float) -> float:
    """The largest derivative of the inverse sine. 1 - most and 1 + most have no cancellation."""
    most = _largest(low, high)
    return 1.0 / math.sqrt((1.0 - most) * (1.0 + most))


def _constant_power(a: Point, exponent: Point) -> Point:
    """x^n for a constant n. Its derivative is computed as (n / x) x^n, which overflows only if x^n overflows."""
    n, most = float(exponent[0]), size(a) + a[1]
    if n == int(n) and n < 0:
        return _inverse(_constant_power(a, point(-n)))
    if n != int(n) and a[2] <= a[1]:
        raise ProofError("the base of a power may be 0")
    steepest = most if n == int(n) or n > 1 else _distance_from_zero(a)
    try:
        return _rounded(a[0] ** n, above(abs(n) * 1.001 * steepest**n) * (a[1] / steepest), FUNCTION_ERROR)
    except OverflowError:
        raise ProofError("a power is too large") from None


def _is_constant(a: Point) -> bool:
    """Whether all values are the same number without an error. An error that covers only underflow is ignored."""
    return a[1] <= above(0.0) and a[2] == a[3]


def _power(a: Point, b: Point) -> Point:
    if _is_constant(b):
        return _constant_power(a, point(b[2]))
    return _OF[ca.OP_EXP](_multiply(b, _OF[ca.OP_LOG](a)))


def _arctan2(y: Point, x: Point) -> Point:
    """The angle of (x, y). Its gradient has the length 1 / r."""
    if x[2] > x[1]:
        least = _distance_from_zero(x)
    elif y[2] > y[1] or y[3] < -y[1]:
        least = _distance_from_zero(y)
    else:
        raise ProofError("the point (x, y) of atan2(y, x) may be on the negative x axis")
    return _rounded(np.arctan2(y[0], x[0]), above(1.001 * (x[1] + y[1])) / least, FUNCTION_ERROR)


def _side(a: Point) -> float:
    """1 if all values are above 0, and -1 if all values are below 0."""
    _distance_from_zero(a)
    return 1.0 if a[2] > 0 else -1.0


def _entry(entry: Entry, group: Point, at: Point) -> Point:
    """An entry of a table. All points must be in the same piece of the table."""
    if not _is_constant(group):
        raise ProofError("the range of a table's argument may extend over two pieces of the table")
    value, before, after = entry.between(group[2], at[2])
    for knot, side in ((before, 1.0), (after, -1.0)):
        if math.isfinite(knot) and _side(_subtract(at, point(knot))) != side:
            raise ProofError("the range of a table's argument may extend over two pieces of the table")
    return point(value)


_FUNCTIONS: dict[int, tuple[Callable[..., Array], Callable[[float, float], float]]] = {
    ca.OP_SQRT: (np.sqrt, lambda low, high: 0.5 / math.sqrt(low)),
    ca.OP_SIN: (np.sin, lambda low, high: 1.0),
    ca.OP_COS: (np.cos, lambda low, high: 1.0),
    ca.OP_EXP: (np.exp, lambda low, high: math.exp(high)),
    # the root raises an error below 0, where 1 / low would be a wrong bound
    ca.OP_LOG: (np.log, lambda low, high: 1.0 / math.sqrt(low) ** 2),
    ca.OP_SINH: (np.sinh, lambda low, high: math.cosh(_largest(low, high))),
    ca.OP_COSH: (np.cosh, lambda low, high: math.cosh(_largest(low, high))),
    ca.OP_TANH: (np.tanh, lambda low, high: 1.0),
    ca.OP_ASIN: (np.arcsin, _steepest_sine),
    ca.OP_ACOS: (np.arccos, _steepest_sine),
    ca.OP_ATAN: (np.arctan, lambda low, high: 1.0 / (1.0 + _least(low, high) ** 2)),
    ca.OP_ASINH: (np.arcsinh, lambda low, high: 1.0 / math.hypot(1.0, _least(low, high))),
    ca.OP_ACOSH: (np.arccosh, lambda low, high: 1.0 / math.sqrt(low - 1.0) / math.sqrt(low + 1.0)),
    ca.OP_ATANH: (np.arctanh, lambda low, high: _steepest_sine(low, high) ** 2),
    ca.OP_LOG1P: (np.log1p, lambda low, high: 1.0 / math.sqrt(1.0 + low) ** 2),
    ca.OP_EXPM1: (np.expm1, lambda low, high: math.exp(high)),
    ca.OP_ERF: (erf, lambda low, high: 1.1284 * math.exp(-(_least(low, high) ** 2))),  # 2 / sqrt(pi)
}
"""Elementary functions, and bounds of the moduli of their derivatives on intervals."""
_OF = {code: _function(f, slope) for code, (f, slope) in _FUNCTIONS.items()}

OPERATIONS: dict[int, Callable[..., Point]] = (
    _OF
    | {
        ca.OP_ASSIGN: lambda a: a,
        ca.OP_ADD: _add,
        ca.OP_SUB: _subtract,
        ca.OP_MUL: _multiply,
        ca.OP_DIV: _divide,
        ca.OP_NEG: _negative,
        ca.OP_SQ: _square,
        ca.OP_TWICE: lambda a: (2.0 * a[0], 2.0 * a[1], 2.0 * a[2], 2.0 * a[3]),
        ca.OP_INV: _inverse,
        ca.OP_TAN: lambda a: _divide(_OF[ca.OP_SIN](a), _OF[ca.OP_COS](a)),
        ca.OP_POW: _power,
        ca.OP_CONSTPOW: _power,
        ca.OP_ATAN2: _arctan2,
        ca.OP_HYPOT: lambda a, b: _OF[ca.OP_SQRT](_add(_square(a), _square(b))),
        ca.OP_CALL: _entry,
    }
    | operations_by_sides(_subtract, _negative, _side, lambda a: _is_constant(a) and a[2] == 0.0, point)
)
"""CasADi's operations on numbers with error bounds. A comparison gives 0 or 1, and the same result at all points."""


def plain(values: Array | float) -> Array | float:
    """A number for `PLAIN`: the values without an error bound."""
    return values


PLAIN: dict[int, Callable[..., Any]] = {code: f for code, (f, _) in _FUNCTIONS.items()} | {
    ca.OP_ASSIGN: plain,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_SQ: np.square,
    ca.OP_TWICE: lambda a: a + a,
    ca.OP_INV: lambda a: 1.0 / a,
    ca.OP_TAN: np.tan,
    ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_HYPOT: np.hypot,
    ca.OP_FABS: np.abs,
    ca.OP_SIGN: np.sign,
    ca.OP_FMIN: np.minimum,
    ca.OP_FMAX: np.maximum,
    ca.OP_LT: lambda a, b: np.less(a, b) * 1.0,
    ca.OP_LE: lambda a, b: np.less_equal(a, b) * 1.0,
    ca.OP_EQ: lambda a, b: np.equal(a, b) * 1.0,
    ca.OP_NE: lambda a, b: np.not_equal(a, b) * 1.0,
    ca.OP_NOT: lambda a: np.equal(a, 0.0) * 1.0,
    ca.OP_AND: lambda a, b: np.logical_and(a, b) * 1.0,
    ca.OP_OR: lambda a, b: np.logical_or(a, b) * 1.0,
    ca.OP_IF_ELSE_ZERO: lambda condition, a: np.where(condition, a, 0.0),
    ca.OP_CALL: lambda entry, group, at: entry.pieces.read(group, at)[entry.column],
}
"""CasADi's operations on values without error bounds."""
