"""Arithmetic on discs in the complex plane: analytic functions on a polyellipse, bounded from its boundary.

A number is (centres, radii) over patches that cover the distinguished boundary of a polyellipse. By induction over the
instructions, each is an analytic function on the polyellipse whose values on the boundary of each patch are in the
disc of the patch. Operations that are not entire ask that all discs lie where the operation is analytic, in a half
plane, a strip or the unit disc. Real and imaginary parts and moduli of analytic functions take their extremes on the
distinguished boundary, so that then all values on the polyellipse are there (maximum principle, in each variable).
What cannot be shown to be analytic gets an infinite radius.

Radii follow from majorants: the Taylor coefficients of a function about a centre are at most those of another one in
modulus, and the sum of the others' terms is known.

References
----------
Gargantini and Henrici, Numerische Mathematik 18 (1972), circular arithmetic. Krantz, Function Theory of Several
Complex Variables (2001), section 1.2, the distinguished boundary. Neumaier, Reliable Computing 9 (2003), majorants of
remainders.
"""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from scipy.special import erf

from symmb._types import Array, Mask
from symmb.enclosures.rounding import COMPLEX, above
from symmb.symbolic import Entry

Disc = tuple[Any, Array]
"""Centres, real or complex, and radii."""


_FADDEEVA = 50.0
"""Relative error of SciPy's complex error function over that of other operations: it aims at 1e-13 (Faddeeva)."""


def disc(centres: Array | float, radii: Array | float = 0.0) -> Disc:
    """Discs about centres."""
    return np.asarray(centres), above(np.asarray(radii, dtype=float))


def reach(a: Disc) -> Array:
    """Largest modulus in each disc; infinite where it is not known."""
    total = above(np.abs(a[0]) + a[1])
    return np.where(np.isnan(total), np.inf, total)


def _rounded(centres: Any, radii: Array, magnitude: Array | None = None) -> Disc:
    of = np.abs(centres) if magnitude is None else magnitude
    return centres, above(radii + COMPLEX * of)


def _if(holds: Any, a: Disc) -> Disc:
    """The discs, with infinite radii unless all patches are where the operation is analytic."""
    return a if np.all(holds) else (np.ones_like(a[0]), np.full(np.shape(a[1]), np.inf))


def _less_above(a: Array, b: Array) -> Mask:
    """a < b by more than their rounding."""
    return above(a) * (1.0 + COMPLEX) < b


def _add(a: Disc, b: Disc) -> Disc:
    return _rounded(a[0] + b[0], a[1] + b[1])


def _subtract(a: Disc, b: Disc) -> Disc:
    return _rounded(a[0] - b[0], a[1] + b[1])


def _negative(a: Disc) -> Disc:
    return -a[0], a[1]


def _multiply(a: Disc, b: Disc) -> Disc:
    size = np.abs(b[0])
    return _rounded(a[0] * b[0], np.abs(a[0]) * b[1] + a[1] * (size + b[1]))


def _square(a: Disc) -> Disc:
    return _rounded(a[0] * a[0], a[1] * (2.0 * np.abs(a[0]) + a[1]))


def _right(a: Disc) -> Mask:
    """Whether discs are in the open right half plane."""
    return _less_above(a[1], a[0].real)


def is_positive(a: Disc) -> bool:
    """Whether all discs of a real number are above 0."""
    return bool(np.all(_right(a)))


def _left(a: Disc) -> Mask:
    return _less_above(a[1], -a[0].real)


def _one_sided(a: Disc) -> bool:
    return bool(np.all(_right(a)) or np.all(_left(a)))


def _gap(far: Array, near: Array) -> Array:
    """A lower bound of far - near, where it is positive."""
    return (far * (1.0 - COMPLEX) - near * (1.0 + COMPLEX)) * (1.0 - COMPLEX)


def _inverse(a: Disc) -> Disc:
    size = np.abs(a[0])
    return _if(_one_sided(a), _rounded(1.0 / a[0], a[1] / size / _gap(size, a[1]) * (1.0 + COMPLEX)))


def _divide(a: Disc, b: Disc) -> Disc:
    return _multiply(a, _inverse(b))


def _share(a: Disc) -> Array:
    """Radius over modulus of the centre, below 1."""
    return np.minimum(above(a[1] / np.abs(a[0])) * (1.0 + COMPLEX), 1.0)


def _sqrt(a: Disc) -> Disc:
    root = np.sqrt(a[0])
    return _if(np.all(_right(a)), _rounded(root, np.abs(root) * _share(a) / (1.0 + np.sqrt(1.0 - _share(a)))))


def _log_part(a: Disc) -> Disc:
    value = np.log(a[0])
    return _rounded(value, above(-np.log1p(-_share(a))), np.abs(value) + 1.0)


def _log(a: Disc) -> Disc:
    return _if(np.all(_right(a)), _log_part(a))


def _log1p(a: Disc) -> Disc:
    return _log(_add(disc(1.0), a))


def _exp(a: Disc) -> Disc:
    value = np.exp(a[0])
    return _rounded(value, np.abs(value) * np.expm1(a[1]) * (1.0 + COMPLEX), np.abs(value) * (1.0 + np.abs(a[0])))


def _circular(f: Callable, g: Callable) -> Callable[[Disc], Disc]:
    """sin, cos, sinh or cosh, with the modulus of their derivative: f(c + w) = f(c) C(w) + f'(c) S(w)."""

    def operation(a: Disc) -> Disc:
        value, slope = f(a[0]), np.abs(g(a[0]))
        grown = np.abs(value) * 2.0 * np.sinh(0.5 * a[1]) ** 2 + slope * np.sinh(a[1])
        return _rounded(value, grown * (1.0 + COMPLEX), (np.abs(value) + slope) * (1.0 + np.abs(a[0])))

    return operation


_SIN, _COS = _circular(np.sin, np.cos), _circular(np.cos, np.sin)
_SINH, _COSH = _circular(np.sinh, np.cosh), _circular(np.cosh, np.sinh)


def _by_slope(value: Array, a: Disc, steepest: Array, analytic: bool | Mask) -> Disc:
    """A function whose derivative has at most the modulus `steepest` in each disc, which is convex."""
    usable = analytic and bool(np.all(np.isfinite(steepest) & (steepest >= 0)))
    return _if(usable, _rounded(value, a[1] * steepest * (1.0 + COMPLEX), np.abs(value) + steepest * np.abs(a[0])))


def _tanh(a: Disc) -> Disc:
    """1 / cosh^2, with |cosh z|^2 = sinh^2 x + cos^2 y for z = x + i y, in a half plane or a strip without poles."""
    x = np.maximum(_gap(np.abs(np.real(a[0])), a[1]), 0.0)
    y = above(np.abs(np.imag(a[0])) + a[1])
    least = np.sinh(x) ** 2 + np.where(y < _STRIP, np.cos(y) ** 2, 0.0)
    return _by_slope(np.tanh(a[0]), a, above(1.0 / least), _one_sided(a) or bool(np.all(y < _STRIP)))


_STRIP = 1.57
"""Half the width of a strip in which tanh is analytic, so far below pi / 2 that a cosine has small relative errors."""


def _in_unit_disc(a: Disc) -> bool:
    return bool(np.all(reach(a) < 1.0))


def _off_imaginary_cuts(a: Disc) -> bool:
    return _one_sided(a) or bool(np.all(above(np.abs(np.imag(a[0])) + a[1]) < 1.0))


def _least_of_quadratic(a: Disc, sign: float) -> Array:
    """A lower bound of |1 + sign z^2| in each disc; not positive where there is none."""
    z = a[0]
    return _gap(
        np.abs(1.0 + sign * z * z), above(2.0 * np.abs(z) * a[1] + a[1] ** 2 + COMPLEX * (1.0 + np.abs(z) ** 2))
    )


def _asin(a: Disc) -> Disc:
    steepest = 1.0 / np.sqrt(_least_of_quadratic(a, -1.0))
    return _by_slope(np.arcsin(a[0]), a, steepest, _in_unit_disc(a))


def _acos(a: Disc) -> Disc:
    steepest = 1.0 / np.sqrt(_least_of_quadratic(a, -1.0))
    return _by_slope(np.arccos(a[0]), a, steepest, _in_unit_disc(a))


def _atan(a: Disc) -> Disc:
    return _by_slope(np.arctan(a[0]), a, 1.0 / _least_of_quadratic(a, 1.0), _off_imaginary_cuts(a))


def _asinh(a: Disc) -> Disc:
    return _by_slope(np.arcsinh(a[0]), a, 1.0 / np.sqrt(_least_of_quadratic(a, 1.0)), _off_imaginary_cuts(a))


def _acosh(a: Disc) -> Disc:
    steepest = 1.0 / np.sqrt(_gap(np.abs(a[0] - 1.0), a[1])) / np.sqrt(_gap(np.abs(a[0] + 1.0), a[1]))
    return _by_slope(np.arccosh(a[0]), a, steepest, bool(np.all(_right(_subtract(a, disc(1.0))))))


def _atanh(a: Disc) -> Disc:
    return _by_slope(np.arctanh(a[0]), a, 1.0 / _least_of_quadratic(a, -1.0), _in_unit_disc(a))


def _erf(a: Disc) -> Disc:
    """|erf'| = 2 / sqrt(pi) exp(-Re z^2). SciPy's complex values have relative errors up to 1e-13, near 0 more."""
    low = np.real(a[0] * a[0]) - 2.0 * np.abs(a[0]) * a[1] - a[1] ** 2
    value, (_, radius) = erf(a[0]), _by_slope(erf(a[0]), a, 1.1284 * np.exp(-low), True)
    return _rounded(value, radius, _FADDEEVA * np.abs(value) + 1.0)


def _power(a: Disc, b: Disc) -> Disc:
    if b[0].size > 1 or not np.all(b[1] <= above(0.0)):
        return _exp(_multiply(b, _log(a)))
    n = float(np.real(b[0]))
    size = np.abs(a[0])
    if n == int(n) and n >= 0:
        return _rounded(a[0] ** n, (above(size + a[1]) ** n - size**n) + COMPLEX * n * above(size + a[1]) ** n)
    if n == int(n):
        return _inverse(_power(a, disc(-n)))
    value = a[0] ** n
    grown = np.abs(value) * np.expm1(above(-abs(n) * np.log1p(-_share(a))))
    spread = np.abs(value) * (1.0 + abs(n) * np.abs(np.log(a[0])))
    return _if(np.all(_right(a)), _rounded(value, grown * (1.0 + COMPLEX), spread))


def _arctan2(y: Disc, x: Disc) -> Disc:
    """(log(x + i y) - log(x - i y)) / 2i where both are in the right half plane, else the same turned by pi / 2."""
    turned = ((0.0, y, x), (0.5 * np.pi, _negative(x), y), (-0.5 * np.pi, x, _negative(y)))
    for angle, s, c in turned:
        plus, minus = (_add(c, (1j * sign * s[0], s[1])) for sign in (1.0, -1.0))
        if np.all(_right(plus)) and np.all(_right(minus)):
            difference = _subtract(_log_part(plus), _log_part(minus))
            return _rounded(angle - 0.5j * difference[0], 0.5 * difference[1], np.abs(difference[0]) + 2.0)
    return _if(False, _add(x, y))


def _sign(a: Disc) -> Disc:
    side = 1.0 if np.all(_right(a)) else -1.0
    return _if(_one_sided(a), disc(side))


def _choose(a: Disc, b: Disc, larger: bool) -> Disc:
    side = _sign(_subtract(a, b))
    if not np.all(np.isfinite(side[1])):
        return _if(False, _add(a, b))
    return a if bool(np.real(side[0]) > 0) == larger else b


def _modulus(a: Disc) -> Disc:
    return _if(_one_sided(a), a if np.all(_right(a)) else _negative(a))


def _truth(of: Callable[[float], float]) -> Callable[[Disc, Disc], Disc]:
    """A comparison of a and b, from the sign of a - b."""

    def operation(a: Disc, b: Disc) -> Disc:
        side = _sign(_subtract(a, b))
        return _if(np.isfinite(side[1]), disc(of(float(np.real(side[0]).flat[0]))))

    return operation


def _holds(condition: Disc) -> float:
    """1 where a condition, which may be any number, is not 0, and 0 where it is; not a number where it is not known."""
    if np.all(condition[0] == 0.0) and np.all(condition[1] <= above(0.0)):
        return 0.0
    return 1.0 if _one_sided(condition) else np.nan


def _decided(truth: float) -> Disc:
    return _if(truth == truth, disc(truth))


def _if_else_zero(condition: Disc, a: Disc) -> Disc:
    truth = _holds(condition)
    return _if(truth == truth, a if truth else disc(0.0))


def _entry(entry: Entry, group: Disc, at: Disc) -> Disc:  # if all patches are in one piece of a table
    value, *knots = entry.between(*(float(np.real(a[0]).flat[0]) for a in (group, at)))
    first, last = (disc(knot) for knot in np.clip(knots, -1e300, 1e300))
    is_known = np.ptp(group[0]) == 0.0 and np.all(group[1] <= above(0.0))
    return _if(is_known and is_positive(_subtract(at, first)) and is_positive(_subtract(last, at)), disc(value))


OPERATIONS: dict[int, Callable[..., Disc]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: _add,
    ca.OP_SUB: _subtract,
    ca.OP_MUL: _multiply,
    ca.OP_DIV: _divide,
    ca.OP_NEG: _negative,
    ca.OP_SQ: _square,
    ca.OP_TWICE: lambda a: (2.0 * a[0], 2.0 * a[1]),
    ca.OP_INV: _inverse,
    ca.OP_SQRT: _sqrt,
    ca.OP_SIN: _SIN,
    ca.OP_COS: _COS,
    ca.OP_TAN: lambda a: _divide(_SIN(a), _COS(a)),
    ca.OP_EXP: _exp,
    ca.OP_LOG: _log,
    ca.OP_SINH: _SINH,
    ca.OP_COSH: _COSH,
    ca.OP_TANH: _tanh,
    ca.OP_ASIN: _asin,
    ca.OP_ACOS: _acos,
    ca.OP_ATAN: _atan,
    ca.OP_ASINH: _asinh,
    ca.OP_ACOSH: _acosh,
    ca.OP_ATANH: _atanh,
    ca.OP_LOG1P: _log1p,
    ca.OP_EXPM1: lambda a: _subtract(_exp(a), disc(1.0)),
    ca.OP_ERF: _erf,
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_ATAN2: _arctan2,
    ca.OP_HYPOT: lambda a, b: _sqrt(_add(_square(a), _square(b))),
    ca.OP_FABS: _modulus,
    ca.OP_SIGN: _sign,
    ca.OP_FMIN: lambda a, b: _choose(a, b, larger=False),
    ca.OP_FMAX: lambda a, b: _choose(a, b, larger=True),
    ca.OP_LT: _truth(lambda side: float(side < 0)),
    ca.OP_LE: _truth(lambda side: float(side < 0)),
    ca.OP_EQ: _truth(lambda side: 0.0),
    ca.OP_NE: _truth(lambda side: 1.0),
    ca.OP_NOT: lambda a: _decided(1.0 - _holds(a)),
    ca.OP_AND: lambda a, b: _decided(_holds(a) * _holds(b)),
    ca.OP_OR: lambda a, b: _decided(float(np.maximum(_holds(a), _holds(b)))),
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
    ca.OP_CALL: _entry,
}
"""Operations of CasADi on discs."""
