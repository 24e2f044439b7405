"""Arithmetic on discs in the complex plane, which bounds analytic functions on a polyellipse by values on its boundary.

A number is a disc for each patch of the distinguished boundary of a polyellipse. The centre moves linearly with the
place in the patch. Radii thus stay small if terms cancel. By induction over the instructions, each number is an
analytic function on the polyellipse, and its values at each place of a patch are in the disc. Operations that are not
entire require that all discs lie in a region in which the operation is analytic: a half plane, a strip or the unit
disc. Analytic functions have the extremes of their real and imaginary parts and of their moduli on the distinguished
boundary (maximum principle, in each variable). All values on the polyellipse are thus in the same region. If a function
cannot be shown to be analytic, its radius is infinite.

Radii follow from majorants: series with known sums. Their coefficients are at least the moduli of the function's Taylor
coefficients about the centre.

References
----------
Gargantini and Henrici, Numerische Mathematik 18 (1972), circular arithmetic. Krantz, Function Theory of Several
Complex Variables (2001), section 1.2, the distinguished boundary. Neumaier, Reliable Computing 9 (2003), majorants of
remainders.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

import casadi as ca
import numpy as np
from scipy.special import erf

from symmb._types import Array, Mask
from symmb.declare.symbolic import Entry
from symmb.prove.rounding import COMPLEX_ERROR, above
from symmb.prove.tape import operations_by_sides


@dataclass(frozen=True, eq=False)
class Disc:
    """Numbers centre + slopes . eps + r with real eps_j, |eps_j| <= 1, and |r| <= radius, one for each patch.

    eps is the place in the patch, the same for all numbers. The last axis of `slopes` belongs to eps.
    """

    centre: Any
    slopes: Any
    radius: Array

    @cached_property
    def size(self) -> Array:
        """Modulus of the centre, or a slightly larger number."""
        return _size(self.centre)

    @cached_property
    def slope(self) -> Array:
        """Largest distance from the centre that is due to the place in the patch."""
        if self.slopes is _NO_SLOPES:
            return _NO_SWING
        sizes = _size(self.slopes)
        return reduce(np.add, [sizes[..., j] for j in range(sizes.shape[-1])])  # faster than a sum over few

    @property
    def swing(self) -> Array:
        """Largest distance from the centre."""
        return self.slope + self.radius


_NO_SLOPES, _NO_SWING = np.zeros(1), np.zeros(())
"""Slopes of a constant, and the sum of their moduli."""
_LEAST_SQUARE = 1e-300
"""A term that covers the underflow of squares. Squares above this value do not underflow."""


def disc(centres: Array | float, radii: Array | float = 0.0) -> Disc:
    """Discs with constant centres."""
    return Disc(np.asarray(centres), _NO_SLOPES, above(np.asarray(radii, dtype=float)))


def reach(a: Disc) -> Array:
    """Largest modulus in each disc; infinite if it is not known."""
    total = above(np.abs(a.centre) + a.swing)  # nan is the difference of two overflows
    return np.where(np.isnan(total), np.inf, total)


def _size(z: Any) -> Array:
    """Upper bounds of moduli. NumPy's own moduli are ten times slower, but do not overflow."""
    if not np.iscomplexobj(z):
        return np.abs(z)
    size = np.sqrt(z.real * z.real + z.imag * z.imag + _LEAST_SQUARE)
    return size if np.all(size < np.inf) else np.abs(z)


def _times(factor: Any, slopes: Any) -> Any:
    """Slopes times a factor for each patch."""
    return slopes if slopes is _NO_SLOPES else np.asarray(factor)[..., None] * slopes


def _plus(a: Any, b: Any) -> Any:
    """The sum of slopes."""
    return b if a is _NO_SLOPES else a if b is _NO_SLOPES else a + b


def _rounded(centre: Any, slopes: Any, radius: Array, size: Array) -> Disc:
    """The disc with a radius that covers the rounding of its parts. `size` is the sum of their moduli."""
    return Disc(centre, slopes, above(radius + COMPLEX_ERROR * size))


def _function(a: Disc, value: Any, slope: Any, rest: Array, size: Array, slope_size: Array | None = None) -> Disc:
    """f(a) from the value and the slope of f at the centres. `rest` bounds the remainder of this linear function.

    Rounding errors are relative to `size` for the value, and to `slope_size` for the slope.
    """
    steepness = _size(slope)
    rounded = size + (steepness if slope_size is None else slope_size) * a.slope
    return _rounded(value, _times(slope, a.slopes), steepness * a.radius + rest * (1.0 + COMPLEX_ERROR), rounded)


def _if(holds: Any, a: Disc) -> Disc:
    """The discs, or discs with infinite radii if the operation may not be analytic on all patches."""
    return a if np.all(holds) else Disc(np.ones_like(a.centre), _NO_SLOPES, np.full(np.shape(a.radius), np.inf))


def _add(a: Disc, b: Disc) -> Disc:
    exact = Disc(a.centre + b.centre, _plus(a.slopes, b.slopes), a.radius + b.radius)
    return _rounded(exact.centre, exact.slopes, exact.radius, exact.size + exact.slope)


def _subtract(a: Disc, b: Disc) -> Disc:
    return _add(a, _negative(b))


def _negative(a: Disc) -> Disc:
    return Disc(-a.centre, _times(-1.0, a.slopes), a.radius)


def _multiply(a: Disc, b: Disc) -> Disc:
    slopes = _plus(_times(a.centre, b.slopes), _times(b.centre, a.slopes))
    # a bound of the terms of the product that are not linear in the place
    radius = a.size * b.radius + b.size * a.radius + a.swing * b.swing
    return _rounded(a.centre * b.centre, slopes, radius, a.size * (b.size + b.slope) + b.size * a.slope)


def _square(a: Disc) -> Disc:
    return _function(a, a.centre * a.centre, 2.0 * a.centre, a.swing**2, a.size**2)


def _right(a: Disc) -> Mask:
    """Whether discs are in the open right half plane, in spite of rounding."""
    # places in a patch are real, so that only the real parts of slopes move the discs to the left
    across = 0.0 if a.slopes is _NO_SLOPES else np.abs(a.slopes.real).sum(axis=-1)
    return above(across + a.radius) * (1.0 + COMPLEX_ERROR) < a.centre.real


def is_positive(a: Disc) -> bool:
    """Whether all discs of a real number are above 0."""
    return bool(np.all(_right(a)))


def is_regular(a: Disc) -> bool:
    """Whether all discs are on one side of 0."""
    return np.isfinite(_side(a))


def _gap(far: Array, near: Array) -> Array:
    """A lower bound of far - near, if it is positive."""
    return (far * (1.0 - COMPLEX_ERROR) - near * (1.0 + COMPLEX_ERROR)) * (1.0 - COMPLEX_ERROR)


def _inverse(a: Disc) -> Disc:
    """1 / (c + w) = 1 / c - w / c^2 + w^2 / (c^2 (c + w)), if |w| < |c|."""
    size, value = np.abs(a.centre), 1.0 / a.centre
    share, gap = a.swing / size, _gap(size, a.swing)
    is_known = (gap > 0.0) & (size < _LEAST_SQUARE**-0.5)  # 1 / c^2 does not underflow
    rest = np.where(is_known, share * share / gap * (1.0 + COMPLEX_ERROR), np.inf)
    return _if(is_regular(a), _function(a, value, -value * value, rest, 1.0 / size))


def _divide(a: Disc, b: Disc) -> Disc:
    return _multiply(a, _inverse(b))


def _share(a: Disc) -> Array:
    """Ratio of the largest distance to the modulus of the centre, at most 1."""
    return np.minimum(above(a.swing / np.abs(a.centre)) * (1.0 + COMPLEX_ERROR), 1.0)


def _sqrt(a: Disc) -> Disc:
    """The square root. The majorant of sqrt(1 - q) - 1 + q / 2 is q^2 / 2 / (1 + sqrt(1 - q))^2."""
    root, q = np.sqrt(a.centre), _share(a)
    size = np.abs(root)
    rest = np.where(q < 1.0, size * 0.5 * q * q / (1.0 + np.sqrt(1.0 - q)) ** 2, np.inf)
    return _if(np.all(_right(a)), _function(a, root, 0.5 / root, rest, size))


def _log_part(a: Disc) -> Disc:
    """The logarithm. The majorant of log(1 + q) - q is -log(1 - q) - q, at most q^2 / 2 / (1 - q)."""
    value, q = np.log(a.centre), _share(a)
    rest = np.minimum(above(-np.log1p(-q)), above(0.5 * q * q / (1.0 - q)))
    return _function(a, value, 1.0 / a.centre, rest, np.abs(value) + 1.0)


def _log(a: Disc) -> Disc:
    return _if(np.all(_right(a)), _log_part(a))


def _exp(a: Disc) -> Disc:
    """The exponential. exp(w) - 1 - w is at most |w|^2 / 2 exp|w|. This may be huge if the value at c underflows."""
    value, swing = np.exp(a.centre), a.swing
    size = above(np.abs(value))
    return _function(a, value, value, size * 0.5 * swing**2 * np.exp(swing), size * (1.0 + np.abs(a.centre)))


def _circular(f: Callable, slope: Callable) -> Callable[[Disc], Disc]:
    """sin, cos, sinh or cosh: f(c + w) = f(c) C(w) + f'(c) S(w), |S(w) - w| <= |w|^3 / 6 cosh|w|."""

    def operation(a: Disc) -> Disc:
        value, own, swing = f(a.centre), slope(a.centre), a.swing
        size, steepness = np.abs(value), np.abs(own)
        # |C(w) - 1| <= cosh|w| - 1, written without cancellation for small discs
        rest = size * 2.0 * np.sinh(0.5 * swing) ** 2 + steepness * swing**3 / 6.0 * np.cosh(swing)
        spread = (size + steepness) * (1.0 + np.abs(a.centre))
        return _function(a, value, own, rest, spread, spread)

    return operation


_SIN, _COS = _circular(np.sin, np.cos), _circular(np.cos, lambda z: -np.sin(z))
_SINH, _COSH = _circular(np.sinh, np.cosh), _circular(np.cosh, np.sinh)


def _by_slope(value: Array, a: Disc, steepest: Array, analytic: bool | Mask) -> Disc:
    """A function of discs. The modulus of its derivative is at most `steepest` in each disc."""
    usable = analytic and bool(np.all(np.isfinite(steepest) & (steepest >= 0)))
    size = np.abs(value) + steepest * np.abs(a.centre)
    return _if(usable, _rounded(value, _NO_SLOPES, a.swing * steepest * (1.0 + COMPLEX_ERROR), size))


def _tanh(a: Disc) -> Disc:
    """tanh in a half plane or a strip without poles, with the slope 1 / cosh^2, |cosh z|^2 = sinh^2 x + cos^2 y."""
    x = np.maximum(_gap(np.abs(np.real(a.centre)), a.swing), 0.0)
    y = above(np.abs(np.imag(a.centre)) + a.swing)
    in_strip = y < 1.57  # below pi / 2, so that the cosine has small relative errors
    least = np.sinh(x) ** 2 + np.where(in_strip, np.cos(y) ** 2, 0.0)
    return _by_slope(np.tanh(a.centre), a, above(1.0 / least), is_regular(a) or bool(np.all(in_strip)))


def _in_unit_disc(a: Disc) -> bool:
    return bool(np.all(reach(a) < 1.0))


def _off_imaginary_cuts(a: Disc) -> bool:
    return is_regular(a) or bool(np.all(above(np.abs(np.imag(a.centre)) + a.swing) < 1.0))


def _arc(f: Callable, sign: float, root: Callable, is_analytic: Callable[[Disc], bool]) -> Callable[[Disc], Disc]:
    """An inverse function. Its derivative has the modulus 1 / root(|1 + sign z^2|)."""

    def operation(a: Disc) -> Disc:
        z, swing = a.centre, a.swing
        rest = above(2.0 * np.abs(z) * swing + swing**2 + COMPLEX_ERROR * (1.0 + np.abs(z) ** 2))
        least = _gap(np.abs(1.0 + sign * z * z), rest)
        return _by_slope(f(z), a, 1.0 / root(least), is_analytic(a))

    return operation


def _acosh(a: Disc) -> Disc:
    below, beyond = (_gap(np.abs(a.centre + sign), a.swing) for sign in (-1.0, 1.0))
    steepest = 1.0 / np.sqrt(below) / np.sqrt(beyond)
    return _by_slope(np.arccosh(a.centre), a, steepest, bool(np.all(_right(_subtract(a, disc(1.0))))))


def _erf(a: Disc) -> Disc:
    """erf, with |erf'| = 2 / sqrt(pi) exp(-Re z^2). SciPy's complex values have larger relative errors near 0."""
    z, swing = a.centre, a.swing
    low = np.real(z * z) - 2.0 * np.abs(z) * swing - swing**2
    value = erf(z)
    found = _by_slope(value, a, 1.1284 * np.exp(-low), True)
    # SciPy's complex error function aims at 1e-13 (Faddeeva), 50 times the error of other operations
    return _rounded(value, _NO_SLOPES, found.radius, 50.0 * np.abs(value) + 1.0)


def _power(a: Disc, b: Disc) -> Disc:
    if b.centre.size > 1 or not np.all(b.swing <= above(0.0)):
        return _exp(_multiply(b, _log(a)))
    n = float(np.real(b.centre))
    if n == int(n) and n < 0:
        return _inverse(_power(a, disc(-n)))
    value, size, swing = a.centre**n, np.abs(a.centre), a.swing
    if n in (0.0, 1.0):
        return a if n else disc(value)
    slope = n * a.centre ** (n - 1.0)
    if n == int(n):
        far = above(size + swing)
        rest = 0.5 * n * (n - 1.0) * swing**2 * far ** (n - 2.0)
        return _function(a, value, slope, rest, n * far**n, n * n * far ** (n - 1.0))
    q = _share(a)
    rest = above(np.abs(value)) * 0.5 * abs(n) * (abs(n) + 1.0) * q * q * np.exp(-(abs(n) + 2.0) * np.log1p(-q))
    spread = np.abs(value) * (1.0 + abs(n) * np.abs(np.log(a.centre)))
    return _if(np.all(_right(a)), _function(a, value, slope, rest, spread, (abs(n) + 1.0) * spread / size))


def _arctan2(y: Disc, x: Disc) -> Disc:
    """The angle (log(x + i y) - log(x - i y)) / 2i. Both arguments must be in the right half plane, perhaps after a
    rotation by pi / 2.
    """
    turned = ((0.0, y, x), (0.5 * np.pi, _negative(x), y), (-0.5 * np.pi, x, _negative(y)))
    for angle, s, c in turned:
        plus, minus = (_add(c, _by_i(s, sign)) for sign in (1.0, -1.0))
        if np.all(_right(plus)) and np.all(_right(minus)):
            difference = _by_i(_subtract(_log_part(plus), _log_part(minus)), -0.5)
            size = np.abs(difference.centre) + 2.0
            return _rounded(angle + difference.centre, difference.slopes, difference.radius, size)
    return _if(False, _add(x, y))


def _by_i(a: Disc, factor: float) -> Disc:
    """The discs times an imaginary number. Its modulus is a power of 2."""
    return Disc(1j * factor * a.centre, _times(1j * factor, a.slopes), abs(factor) * a.radius)


def _side(a: Disc) -> float:
    """1 or -1 if all discs are in the right or in the left half plane, otherwise nan."""
    return 1.0 if np.all(_right(a)) else -1.0 if np.all(_right(_negative(a))) else np.nan


def _is_zero(a: Disc) -> bool:
    return bool(np.all(a.centre == 0.0) and np.all(a.swing <= above(0.0)))


def _entry(entry: Entry, group: Disc, at: Disc) -> Disc:
    """An entry of a table. All patches must be in the same piece of the table."""
    value, *knots = entry.between(*(float(np.real(a.centre).flat[0]) for a in (group, at)))
    first, last = (disc(knot) for knot in np.clip(knots, -1e300, 1e300))
    is_known = np.ptp(group.centre) == 0.0 and np.all(group.swing <= above(0.0))
    return _if(is_known and is_positive(_subtract(at, first)) and is_positive(_subtract(last, at)), disc(value))


OPERATIONS: dict[int, Callable[..., Disc]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: _add,
    ca.OP_SUB: _subtract,
    ca.OP_MUL: _multiply,
    ca.OP_DIV: _divide,
    ca.OP_NEG: _negative,
    ca.OP_SQ: _square,
    ca.OP_TWICE: lambda a: Disc(2.0 * a.centre, _times(2.0, a.slopes), 2.0 * a.radius),
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
    ca.OP_ASIN: _arc(np.arcsin, -1.0, np.sqrt, _in_unit_disc),
    ca.OP_ACOS: _arc(np.arccos, -1.0, np.sqrt, _in_unit_disc),
    ca.OP_ATAN: _arc(np.arctan, 1.0, np.positive, _off_imaginary_cuts),
    ca.OP_ASINH: _arc(np.arcsinh, 1.0, np.sqrt, _off_imaginary_cuts),
    ca.OP_ACOSH: _acosh,
    ca.OP_ATANH: _arc(np.arctanh, -1.0, np.positive, _in_unit_disc),
    ca.OP_LOG1P: lambda a: _log(_add(disc(1.0), a)),
    ca.OP_EXPM1: lambda a: _subtract(_exp(a), disc(1.0)),
    ca.OP_ERF: _erf,
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_ATAN2: _arctan2,
    ca.OP_HYPOT: lambda a, b: _sqrt(_add(_square(a), _square(b))),
    ca.OP_CALL: _entry,
} | operations_by_sides(_subtract, _negative, _side, _is_zero, lambda value: _if(value == value, disc(value)))
"""CasADi's operations on discs."""
