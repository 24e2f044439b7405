"""Interval numbers with arrays as ends, and the interval extension of each scalar operation of CasADi.

Ends are rounded outward: by one unit in the last place for sums, products and roots, and by eight units for other
functions. This is more than the errors of the mathematical libraries. If an argument is partly outside the domain of a
function, only the part in the domain is used. If the argument is completely outside, an error is raised. A division by
an interval around 0 has infinite bounds.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import casadi as ca
import numpy as np

from symmb._errors import PropagationError
from symmb._types import Array, Mask
from symmb.declare.symbolic import Entry, operation_name
from symmb.equations.model import Box
from symmb.prove.rounding import FUNCTION_ERROR, U

FUNCTION_ULPS = int(FUNCTION_ERROR / (2 * U))
"""Units in the last place by which values of elementary functions are widened."""


class Interval(NamedTuple):
    """Ends of one interval or of many intervals. Both arrays have the same shape, or NumPy can broadcast them."""

    lower: Array
    upper: Array

    @classmethod
    def exactly(cls, value: float | Array) -> "Interval":
        """The interval of a number."""
        return cls(np.asarray(value, dtype=float), np.asarray(value, dtype=float))


def parameter_intervals(nominal: Mapping[str, float], box: Box) -> list[Interval]:
    """The intervals of a box, and the nominal values of the other parameters, in the order of `nominal`."""
    ends = {
        **{name: (value, value) for name, value in nominal.items()},
        **dict(zip(box.names, box.bounds, strict=True)),
    }
    return [Interval(*map(np.asarray, pair)) for pair in ends.values()]


def operate(code: int | Entry, arguments: tuple[Interval, ...]) -> Interval:
    """Interval extension of the operation with CasADi's code ``OP_...``."""
    if isinstance(code, Entry):
        return _entry(code, *arguments)
    extension = EXTENSIONS.get(code)
    if extension is None:
        raise PropagationError(f"IntervalArithmetic() has no interval extension of {operation_name(code)}.")
    with np.errstate(all="ignore"):
        return extension(*arguments)


def _outward(lower: Array, upper: Array, ulps: int = 1) -> Interval:
    """Ends widened by some units in the last place. An end that is NaN becomes infinite."""
    lower = lower - ulps * np.spacing(np.abs(lower))
    upper = upper + ulps * np.spacing(np.abs(upper))
    return Interval(np.where(np.isnan(lower), -np.inf, lower), np.where(np.isnan(upper), np.inf, upper))


def _hull(*values: Array) -> tuple[Array, Array]:
    """The elementwise minimum and maximum of arrays."""
    return np.minimum.reduce(np.broadcast_arrays(*values)), np.maximum.reduce(np.broadcast_arrays(*values))


def _add(a: Interval, b: Interval) -> Interval:
    return _outward(a.lower + b.lower, a.upper + b.upper)


def _negative(a: Interval) -> Interval:
    return Interval(-a.upper, -a.lower)


def _multiply(a: Interval, b: Interval) -> Interval:
    products = [x * y for x in a for y in b]
    products = [np.where(np.isnan(product), 0.0, product) for product in products]  # 0 times infinity
    lower, upper = _outward(*_hull(*products))
    # outward rounding must not make a product of positive numbers negative: its root would have no value
    not_negative = ((a.lower >= 0) & (b.lower >= 0)) | ((a.upper <= 0) & (b.upper <= 0))
    not_positive = ((a.lower >= 0) & (b.upper <= 0)) | ((a.upper <= 0) & (b.lower >= 0))
    return Interval(
        np.where(not_negative, np.maximum(lower, 0.0), lower), np.where(not_positive, np.minimum(upper, 0.0), upper)
    )


def _inverse(a: Interval) -> Interval:
    straddles = (a.lower < 0) & (a.upper > 0)
    lower = np.where(straddles | (a.upper == 0), -np.inf, 1.0 / np.where(a.upper == 0, 1.0, a.upper))
    upper = np.where(straddles | (a.lower == 0), np.inf, 1.0 / np.where(a.lower == 0, 1.0, a.lower))
    return _outward(lower, upper)


def _magnitude(a: Interval) -> Interval:
    """|a|, without rounding."""
    low, high = _hull(np.abs(a.lower), np.abs(a.upper))
    return Interval(np.where((a.lower <= 0) & (a.upper >= 0), 0.0, low), high)


def _integer_power(a: Interval, n: int) -> Interval:
    if n < 0:
        return _inverse(_integer_power(a, -n))
    if n % 2:
        return _outward(a.lower**n, a.upper**n, FUNCTION_ULPS)
    low, high = _magnitude(a)
    lower, upper = _outward(low**n, high**n, 1 if n == 2 else FUNCTION_ULPS)
    return Interval(np.maximum(lower, 0.0), upper)


def _power(a: Interval, b: Interval) -> Interval:
    exponent = b.lower.flat[0]
    # an integer power also has values for negative bases, where the logarithm has none
    if (b.lower == exponent).all() and (b.upper == exponent).all() and exponent == np.round(exponent):
        return _integer_power(a, int(exponent))
    return _exponential(_multiply(b, _logarithm(a)))


def _increasing(
    function: Callable[[Array], Array],
    domain: tuple[float, float] = (-np.inf, np.inf),
    values: tuple[float, float] = (-np.inf, np.inf),
    ulps: int = FUNCTION_ULPS,
) -> Callable[[Interval], Interval]:
    """Extension of a function that does not decrease."""

    def extension(a: Interval) -> Interval:
        outside = (a.upper < domain[0]) | (a.lower > domain[1])
        if outside.any():
            raise PropagationError(
                f"IntervalArithmetic(): the argument of {getattr(function, '__name__', 'a function')} is in "
                f"[{np.min(a.lower):.6g}, {np.max(a.upper):.6g}], outside the domain {domain}. Use a smaller box."
            )
        lower, upper = _outward(
            function(np.maximum(a.lower, domain[0])), function(np.minimum(a.upper, domain[1])), ulps
        )
        return Interval(np.maximum(lower, values[0]), np.minimum(upper, values[1]))

    return extension


def _arccos(a: Interval) -> Interval:
    lower, upper = _arcsin(_negative(a))  # arccos a = pi/2 + arcsin(-a)
    return _outward(lower + np.pi / 2, upper + np.pi / 2, 2)


def _reaches(a: Interval, point: float, period: float) -> Mask:
    """Whether point + k period may be in the interval for some integer k, with rounding."""
    # the multiples of the period are rounded, so that a peak just outside of the interval counts as inside
    slack = 4 * np.spacing(np.maximum(np.abs(a.lower), np.abs(a.upper)) + period)
    first = point + period * np.ceil((a.lower - slack - point) / period)
    return (first <= a.upper + slack) | ~np.isfinite(first)


def _wave(function: Callable[[Array], Array], peak: float) -> Callable[[Interval], Interval]:
    """Extension of the sine or the cosine. The function is 1 at ``peak``."""

    def extension(a: Interval) -> Interval:
        lower, upper = _outward(*_hull(function(a.lower), function(a.upper)), FUNCTION_ULPS)
        return Interval(
            np.where(_reaches(a, peak + np.pi, 2 * np.pi), -1.0, np.maximum(lower, -1.0)),
            np.where(_reaches(a, peak, 2 * np.pi), 1.0, np.minimum(upper, 1.0)),
        )

    return extension


def _tangent(a: Interval) -> Interval:
    lower, upper = _outward(np.tan(a.lower), np.tan(a.upper), FUNCTION_ULPS)
    pole = _reaches(a, np.pi / 2, np.pi)
    return Interval(np.where(pole, -np.inf, lower), np.where(pole, np.inf, upper))


def _atan2(y: Interval, x: Interval) -> Interval:
    corners = [np.arctan2(b + 0.0, a + 0.0) for b in y for a in x]
    lower, upper = _outward(*_hull(*corners), FUNCTION_ULPS)
    cut = (x.lower < 0) & (y.lower < 0) & (y.upper >= 0)
    whole = _outward(np.asarray(-np.pi), np.asarray(np.pi))
    return Interval(np.where(cut, whole.lower, lower), np.where(cut, whole.upper, upper))


def _fmod(a: Interval, b: Interval) -> Interval:
    """a - b trunc(a / b): the interval a if |a| < |b|, otherwise all possible values."""
    size, step = _magnitude(a), _magnitude(b)
    within = size.upper < step.lower
    most = np.minimum(size.upper, step.upper)
    return Interval(
        np.where(within, a.lower, np.where(a.lower >= 0, 0.0, -most)),
        np.where(within, a.upper, np.where(a.upper <= 0, 0.0, most)),
    )


def _remainder(a: Interval, b: Interval) -> Interval:
    """a minus the nearest multiple of b."""
    size, step = _magnitude(a), _magnitude(b)
    within = size.upper < 0.5 * step.lower
    return Interval(np.where(within, a.lower, -0.5 * step.upper), np.where(within, a.upper, 0.5 * step.upper))


def _copysign(a: Interval, b: Interval) -> Interval:
    low, high = _magnitude(a)
    return Interval(np.where(b.lower > 0, low, -high), np.where(b.upper < 0, -low, high))


def _truth(sure: Mask, possible: Mask) -> Interval:
    return Interval(np.where(sure, 1.0, 0.0), np.where(possible, 1.0, 0.0))


def _is_true(a: Interval) -> Interval:
    return _truth((a.lower > 0) | (a.upper < 0), (a.lower != 0) | (a.upper != 0))


def _not(a: Interval) -> Interval:
    truth = _is_true(a)
    return Interval(1.0 - truth.upper, 1.0 - truth.lower)


def _equal(a: Interval, b: Interval) -> Interval:
    same = (a.lower == a.upper) & (b.lower == b.upper) & (a.lower == b.lower)
    return _truth(same, (a.lower <= b.upper) & (b.lower <= a.upper))


def _entry(entry: Entry, group: Interval, at: Interval) -> Interval:
    """The smallest and the largest entry of the pieces between both ends, without rounding."""
    pieces, column = entry
    first, last = np.broadcast_arrays(pieces.find(group.lower, at.lower), pieces.find(group.upper, at.upper))
    values = pieces.data[2 + column]
    ends = np.stack([first, last + 1], axis=-1).ravel()  # reduceat needs an entry at each end
    lower, upper = (end.reduceat(np.append(values, values[-1]), ends)[::2] for end in (np.minimum, np.maximum))
    return Interval(lower.reshape(first.shape), upper.reshape(first.shape))


def _error_function(x: Array) -> Array:
    from scipy.special import erf  # this import takes longer than a study of a small scene

    return erf(x)


def _if_else_zero(condition: Interval, a: Interval) -> Interval:
    sure, possible = _is_true(condition)
    lower = np.where(possible == 0, 0.0, np.where(sure == 1, a.lower, np.minimum(a.lower, 0.0)))
    upper = np.where(possible == 0, 0.0, np.where(sure == 1, a.upper, np.maximum(a.upper, 0.0)))
    return Interval(lower, upper)


def _minimum(a: Interval, b: Interval) -> Interval:
    return Interval(np.minimum(a.lower, b.lower), np.minimum(a.upper, b.upper))


def _maximum(a: Interval, b: Interval) -> Interval:
    return Interval(np.maximum(a.lower, b.lower), np.maximum(a.upper, b.upper))


_exponential = _increasing(np.exp, values=(0.0, np.inf))
_arcsin = _increasing(np.arcsin, domain=(-1.0, 1.0))
_logarithm = _increasing(np.log, domain=(0.0, np.inf))
_rising_cosh = _increasing(np.cosh, domain=(0.0, np.inf), values=(1.0, np.inf))
_root = _increasing(np.sqrt, domain=(0.0, np.inf), values=(0.0, np.inf), ulps=1)

EXTENSIONS: dict[int, Callable[..., Interval]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: _add,
    ca.OP_SUB: lambda a, b: _add(a, _negative(b)),
    ca.OP_MUL: _multiply,
    ca.OP_DIV: lambda a, b: _multiply(a, _inverse(b)),
    ca.OP_NEG: _negative,
    ca.OP_INV: _inverse,
    ca.OP_SQ: lambda a: _integer_power(a, 2),
    ca.OP_TWICE: lambda a: Interval(2.0 * a.lower, 2.0 * a.upper),
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_SQRT: _root,
    ca.OP_EXP: _exponential,
    ca.OP_EXPM1: _increasing(np.expm1, values=(-1.0, np.inf)),
    ca.OP_LOG: _logarithm,
    ca.OP_LOG1P: _increasing(np.log1p, domain=(-1.0, np.inf)),
    ca.OP_SIN: _wave(np.sin, np.pi / 2),
    ca.OP_COS: _wave(np.cos, 0.0),
    ca.OP_TAN: _tangent,
    ca.OP_ASIN: _arcsin,
    ca.OP_ACOS: _arccos,
    ca.OP_ATAN: _increasing(np.arctan),
    ca.OP_ATAN2: _atan2,
    ca.OP_SINH: _increasing(np.sinh),
    ca.OP_COSH: lambda a: _rising_cosh(_magnitude(a)),
    ca.OP_TANH: _increasing(np.tanh, values=(-1.0, 1.0)),
    ca.OP_ASINH: _increasing(np.arcsinh),
    ca.OP_ACOSH: _increasing(np.arccosh, domain=(1.0, np.inf), values=(0.0, np.inf)),
    ca.OP_ATANH: _increasing(np.arctanh, domain=(-1.0, 1.0)),
    ca.OP_ERF: _increasing(_error_function, values=(-1.0, 1.0)),
    ca.OP_HYPOT: lambda a, b: _root(_add(_integer_power(a, 2), _integer_power(b, 2))),
    ca.OP_FABS: _magnitude,
    ca.OP_SIGN: _increasing(np.sign, ulps=0),
    ca.OP_FLOOR: _increasing(np.floor, ulps=0),
    ca.OP_CEIL: _increasing(np.ceil, ulps=0),
    ca.OP_FMOD: _fmod,
    ca.OP_REMAINDER: _remainder,
    ca.OP_COPYSIGN: _copysign,
    ca.OP_FMIN: _minimum,
    ca.OP_FMAX: _maximum,
    ca.OP_LT: lambda a, b: _truth(a.upper < b.lower, a.lower < b.upper),
    ca.OP_LE: lambda a, b: _truth(a.upper <= b.lower, a.lower <= b.upper),
    ca.OP_EQ: _equal,
    ca.OP_NE: lambda a, b: _not(_equal(a, b)),
    ca.OP_NOT: _not,
    ca.OP_AND: lambda a, b: _minimum(_is_true(a), _is_true(b)),
    ca.OP_OR: lambda a, b: _maximum(_is_true(a), _is_true(b)),
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
}
"""Interval extensions by operation code. Each is exact except for rounding. Interval arithmetic is too wide only
because it treats two occurrences of an argument as independent. OP_ERFINV is omitted: CasADi's values have errors of
3e-8, so that no enclosure of the inverse error function would contain them."""
