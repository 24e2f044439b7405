"""Arithmetic on polynomials of total degree with a remainder, for several parameters.

At each place, a number is a polynomial of real variables in [-1, 1] and a disc in the complex plane. Exact values are
in the disc about the value of the polynomial. Terms beyond the degree of the basis are bounded by the sums of their
moduli, and the radius of the disc includes them. Places are nodes of time, or patches of an ellipse of time as in
`discs`. The variables are then the place in the patch and the parameters. The statements of `discs` about analytic
functions hold here only for time. An operation that is not entire must be analytic at all values.

References
----------
Makino and Berz, International Journal of Pure and Applied Mathematics 4 (2003), Taylor models. Neumaier, Reliable
Computing 9 (2003), Taylor forms.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.prove import discs
from symmb.prove.basis import Basis
from symmb.prove.discs import Disc
from symmb.prove.rounding import COMPLEX_ERROR, FUNCTION_ERROR, U, above

_REAL_ERROR = 4 * U
"""Relative error of an operation on real numbers."""


@dataclass(frozen=True, eq=False)
class Model:
    """Polynomials with coefficients c (T, P) of the first monomials of a basis, and radii (P,), at P places."""

    c: Array
    radius: Array
    basis: Basis

    @cached_property
    def degree(self) -> int:
        """Highest degree of the monomials."""
        return self.basis.counts.index(len(self.c))

    @cached_property
    def norms(self) -> Array:
        """(degree + 1, P) sums of the moduli of the coefficients of each degree."""
        starts = [0, *self.basis.counts[: self.degree]]
        return np.add.reduceat(np.abs(self.c), starts, axis=0)

    @cached_property
    def moved(self) -> Array:
        """(P,) largest distance of the polynomial from its constant term."""
        return self.norms[1:].sum(axis=0)

    @cached_property
    def norm(self) -> Array:
        """(P,) largest modulus of the polynomial."""
        return self.norms[0] + self.moved

    @property
    def swing(self) -> Array:
        """(P,) largest distance from the constant term."""
        return above(self.moved + self.radius)

    @cached_property
    def around(self) -> Disc:
        """Discs that contain all values at each place. The range of a product of squares has the centre 1/2."""
        half = self.basis.of_squares[: len(self.c), None]
        middle = self.c[0] + (half * self.c).sum(axis=0)
        moved = (np.abs(self.c[1:]) * (1.0 - half[1:])).sum(axis=0)
        return discs.disc(middle, moved + self.radius + _relative(self.c) * len(self.c) * self.norm)

    @cached_property
    def inverse(self) -> "Model":
        """1 / a, computed once for several quotients."""
        return _inverse(self)

    @property
    def disc(self) -> Disc:
        """The model as a disc. The variables are the places in the patch."""
        if self.degree == 0:
            centre, radius = (self.c[0, 0], self.radius[0]) if self.c.size == 1 else (self.c[0], self.radius)
            return Disc(centre, discs.disc(0.0).slopes, radius)
        linear, others = self.basis.linear, np.ones(len(self.c), dtype=bool)
        has = linear < len(self.c)
        slopes = np.zeros((self.c.shape[1], len(linear)), dtype=self.c.dtype)
        slopes[:, has] = self.c[linear[has]].T
        others[0], others[linear[has]] = False, False
        return Disc(self.c[0], slopes, above(self.radius + np.abs(self.c[others]).sum(axis=0)))

    def in_chebyshev(self, places: int) -> Array:
        """(T, places) coefficients of the Chebyshev products that correspond to all monomials of the basis."""
        c = self.basis.to_chebyshev @ _padded(self.c, self.basis.counts[-1])
        return np.broadcast_to(c, (len(c), places))


def constant(basis: Basis, value: float) -> Model:
    """The Taylor model of a number."""
    return Model(np.full((1, 1), value), np.zeros(1), basis)


def reach(a: Model) -> float:
    """Largest modulus; infinite if it is not known."""
    most = float(above(a.norm + a.radius).max())
    return most if most == most else math.inf


def _padded(c: Array, terms: int) -> Array:
    """The coefficients c, filled with zeros to (terms, P)."""
    if len(c) == terms:
        return c
    whole = np.zeros((terms, *c.shape[1:]), dtype=c.dtype)
    whole[: len(c)] = c
    return whole


def _relative(c: Array) -> float:
    """Relative error of an operation on coefficients."""
    return COMPLEX_ERROR if np.iscomplexobj(c) else _REAL_ERROR


def _sum(a: Model, b: Model, sign: float) -> Model:
    """a + b or a - b."""
    terms = max(len(a.c), len(b.c))
    c = _padded(a.c, terms) + sign * _padded(b.c, terms)
    exact = Model(c, a.radius, a.basis)
    return Model(c, above(a.radius + b.radius + _relative(c) * exact.norm), a.basis)


def _scaled(a: Model, factor: float) -> Model:
    """The model times a power of 2 or -1."""
    return Model(factor * a.c, abs(factor) * a.radius, a.basis)


def _multiply(a: Model, b: Model, most: int | None = None) -> Model:
    """The product up to the degree `most`; None: the degree of the basis."""
    basis = a.basis
    most = basis.degree if most is None else most
    group = 1
    if min(a.degree, b.degree) == 0 and max(a.degree, b.degree) <= most:
        c = a.c * b.c
    else:
        pairs = basis.pairs(a.degree, b.degree, most)
        c, group = pairs.product(a.c, b.c), pairs.largest
    # Constant terms have one rounding error. Sums of the other products have many. Constant terms are often larger by
    # orders of magnitude, so a common bound would be too wide.
    small = a.norms[0] * b.moved + a.moved * b.norm
    rounded = _relative(c) * (a.norms[0] * b.norms[0] + (group + 1.0) * small)
    radius = a.norm * b.radius + a.radius * (b.norm + b.radius) + _lost(a, b, most) + rounded
    return Model(c, above(radius), basis)


def _lost(a: Model, b: Model, most: int) -> Array | float:
    """Sums (P,) of the moduli of those terms of a product that exceed the degree `most`."""
    lost: Array | float = 0.0
    tails = np.cumsum(b.norms[::-1], axis=0)[::-1]
    for k, own in enumerate(a.norms):
        if most - k + 1 < len(tails):
            lost = lost + own * tails[max(most - k + 1, 0)]
    return lost


def _composed(a: Model, derivatives: list[Array], rounded: Array, rest: Array, about: Array | None = None) -> Model:
    """f(a) from the coefficients (P,) of its Taylor series.

    Parameters
    ----------
    about : (P,) centres of the series; None: the constant terms
    rounded : (P,) errors of the series by rounding of its coefficients
    rest : (P,) bounds of the remainder of the series
    """
    basis, n = a.basis, a.basis.degree
    if a.degree == 0:
        powers = sum(above(np.abs(own)) * a.radius**k for k, own in enumerate(derivatives) if k)
        return Model(derivatives[0][None], above(powers + rounded + rest), basis)
    off = np.zeros_like(a.c[0]) if about is None else a.c[0] - about
    w = Model(np.concatenate([off[None], a.c[1:]]), above(a.radius + _relative(a.c) * np.abs(off)), basis)
    lost = above(np.zeros(1))  # by underflow
    found = Model(derivatives[n][None], lost, basis)
    # Horner's scheme. w has no constant term if the series is about the constant term of a. After the k remaining
    # products, terms of `found` beyond the degree n - k would exceed the degree n. They are not computed.
    for k in range(n - 1, -1, -1):
        found = _multiply(found, w, n - k if about is None else n)
        found = _sum(found, Model(derivatives[k][None], lost, basis), 1.0)
    return Model(found.c, above(found.radius + rounded + rest), basis)


def _if(holds: Any, a: Model) -> Model:
    """The model; with an infinite radius if the operation may not be analytic."""
    return a if np.all(holds) else Model(np.ones_like(a.c[:1]), np.full(np.shape(a.radius), np.inf), a.basis)


def _expansion(a: Model) -> tuple[Array, Array, Array | None]:
    """Centres (P,) of a series with a singularity at 0, ratios q (P,) of distance to modulus, and `about`.

    Ratios from 1 on are nan. `about` is the argument of `_composed`. The centres are the constant terms if all values
    are close to them. Otherwise they are the middles of the ranges, as for sqrt(w^2 + small^2) if the square comes
    close to 0. Up to the ratio 1/2 a series converges well: with degree 8 the remainder is 1 / 2^9.
    """
    own, around = above(a.swing / np.abs(a.c[0])) * (1.0 + COMPLEX_ERROR), a.around
    if (own < 0.5).all() or a.degree == 0:
        return a.c[0], np.where(own < 1.0, own, np.nan), None
    q = above(around.radius / np.abs(around.centre)) * (1.0 + COMPLEX_ERROR)
    return around.centre, np.where(q < 1.0, q, np.nan), around.centre


def _inverse(a: Model) -> Model:
    """1 / a. The remainder of the geometric series is its first term divided by 1 - q."""
    middle, q, about = _expansion(a)
    value, n = 1.0 / middle, a.basis.degree
    size, relative = np.abs(value), (n + 4.0) * _relative(value)
    own = [value]
    for _ in range(n):
        own.append(-own[-1] * value)
    rest = size * q ** (n + 1) / _gap(q)
    return _if(discs.is_regular(a.around), _composed(a, own, relative * size / _gap(q), above(rest), about))


def _gap(q: Array) -> Array:
    """A lower bound of 1 - q."""
    return (1.0 - q) * (1.0 - COMPLEX_ERROR) - COMPLEX_ERROR * q


def _sqrt(a: Model) -> Model:
    """The square root. The binomial coefficients of 1 / 2 decrease in modulus, so a geometric series is a bound."""
    middle, q, about = _expansion(a)
    root, n = np.sqrt(middle), a.basis.degree
    size, value, factor = np.abs(root), 1.0 / middle, 1.0
    own, power = [root], root
    for k in range(1, n + 1):
        factor, power = factor * (1.5 - k) / k, power * value
        own.append(factor * power)
    factor *= abs(0.5 - n) / (n + 1)
    rest = size * abs(factor) * q ** (n + 1) / _gap(q)
    relative = (4.0 * n + 8.0) * _relative(root)
    return _if(discs.is_positive(a.around), _composed(a, own, relative * size / _gap(q), above(rest), about))


def _entire(a: Model, turn: list[Array], size: Array) -> Model:
    """An entire function. Its derivatives at the constant terms repeat the values `turn`, and are at most `size`."""
    n, q = a.basis.degree, a.swing
    own = [turn[k % len(turn)] / math.factorial(k) for k in range(n + 1)]
    grown = np.exp(q)
    relative = COMPLEX_ERROR * (1.0 + np.abs(a.c[0])) if np.iscomplexobj(a.c) else np.full(1, FUNCTION_ERROR + 2 * U)
    rest = size * q ** (n + 1) / math.factorial(n + 1) * grown * (1.0 + 4.0 * FUNCTION_ERROR)
    return _composed(a, own, above(relative * size * grown) * (1.0 + 1e-9), above(rest))


def _circular(f: Callable, slope: Callable, is_hyperbolic: bool = False) -> Callable[[Model], Model]:
    """sin, cos, sinh or cosh, from the function and its derivative. The second derivatives are -f or f."""

    def operation(a: Model) -> Model:
        value, own = f(a.c[0]), slope(a.c[0])
        turn = [value, own] if is_hyperbolic else [value, own, -value, -own]
        return _entire(a, turn, (np.abs(value) + np.abs(own)) * (1.0 + np.abs(a.c[0]) if is_hyperbolic else 1.0))

    return operation


_SIN, _COS = _circular(np.sin, np.cos), _circular(np.cos, lambda z: -np.sin(z))
_SINH, _COSH = _circular(np.sinh, np.cosh, True), _circular(np.cosh, np.sinh, True)


def _tanh(a: Model) -> Model:
    """tanh as sinh / cosh, or by discs if their radius is smaller."""
    found = _multiply(_SINH(a), _COSH(a).inverse)
    by_discs = _of_discs(ca.OP_TANH)(a)
    return found if (found.radius < by_discs.radius).all() else by_discs


def _exp(a: Model) -> Model:
    value = np.exp(a.c[0])
    return _entire(a, [value], above(np.abs(value)) * (1.0 + np.abs(a.c[0])))


def _power(a: Model, b: Model) -> Model:
    """a^b. Integer powers up to 16 are products, and other powers are computed by discs."""
    exponent = float(np.real(b.c[0]).flat[0])
    is_constant = b.c.size == 1 and float(b.radius.max()) <= above(0.0)
    if not is_constant or exponent != int(exponent) or not 0 < abs(exponent) <= 16:
        return _of_discs(ca.OP_POW)(a, b)
    found, base, left = None, a, abs(int(exponent))
    while left:
        if left % 2:
            found = base if found is None else _multiply(found, base)
        left //= 2
        base = _multiply(base, base) if left else base
    assert found is not None
    return found if exponent > 0 else found.inverse


def _of_discs(code: int) -> Callable[..., Model]:
    """An operation that is computed on discs. Its result is linear in the variables."""

    def operation(*arguments: Model) -> Model:
        return _from_disc(discs.OPERATIONS[code](*(a.disc for a in arguments)), arguments[-1].basis)

    return operation


def _from_disc(found: Disc, basis: Basis) -> Model:
    """The disc as a Taylor model of degree at most 1."""
    centre, slopes, radius = np.atleast_1d(found.centre), np.asarray(found.slopes), np.atleast_1d(found.radius)
    if slopes.ndim < 2 or basis.degree == 0:
        return Model(centre[None], above(radius + found.slope), basis)
    has = basis.linear < len(basis.exponents)
    places = np.broadcast_shapes(centre.shape, slopes.shape[:1])
    c = np.zeros((basis.counts[max(np.array(basis.weights)[has])], *places), dtype=np.result_type(centre, slopes))
    c[0], c[basis.linear[has]] = centre, slopes.T[has]
    return Model(c, above(radius + np.abs(slopes[:, ~has]).sum(axis=1)), basis)


_OWN: dict[int, Callable[..., Model]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: _sum(a, b, 1.0),
    ca.OP_SUB: lambda a, b: _sum(a, b, -1.0),
    ca.OP_MUL: _multiply,
    ca.OP_DIV: lambda a, b: _multiply(a, b.inverse),
    ca.OP_NEG: lambda a: _scaled(a, -1.0),
    ca.OP_SQ: lambda a: _multiply(a, a),
    ca.OP_TWICE: lambda a: _scaled(a, 2.0),
    ca.OP_INV: lambda a: a.inverse,
    ca.OP_SQRT: _sqrt,
    ca.OP_SIN: _SIN,
    ca.OP_COS: _COS,
    ca.OP_TAN: lambda a: _multiply(_SIN(a), _COS(a).inverse),
    ca.OP_EXP: _exp,
    ca.OP_SINH: _SINH,
    ca.OP_COSH: _COSH,
    ca.OP_TANH: _tanh,
    ca.OP_EXPM1: lambda a: _sum(_exp(a), constant(a.basis, 1.0), -1.0),
    ca.OP_HYPOT: lambda a, b: _sqrt(_sum(_multiply(a, a), _multiply(b, b), 1.0)),
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_CALL: lambda entry, group, at: _from_disc(discs.OPERATIONS[ca.OP_CALL](entry, group.disc, at.disc), at.basis),
}

OPERATIONS: dict[int, Callable[..., Model]] = {code: _of_discs(code) for code in discs.OPERATIONS} | _OWN
"""CasADi's operations on Taylor models."""
