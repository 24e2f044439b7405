"""Ranges of expressions over boxes of their symbols, as expressions of the ends of the boxes.

The method is natural interval arithmetic without outward rounding.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial, reduce
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from symmb.declare.symbolic.common import common
from symmb.declare.symbolic.instructions import interpret
from symmb.declare.symbolic.pieces import Entry, Smooth, applied
from symmb.declare.symbolic.switching import is_soft

_INFINITE, _ZERO = ca.SX.inf(), ca.SX(0)


class _SplitRange(NamedTuple):
    """Ranges of a value below and above a knot in the range `at`. `own` are the two parts of `at`."""

    at: Any
    own: Any
    before: Any
    behind: Any

    def of(self, a: "SymbolicRange") -> tuple["SymbolicRange", "SymbolicRange"]:
        """The two parts of a range; for a range without parts, the whole range twice."""
        if a.parts is not None and a.parts.own is self.own:
            return a.parts.before, a.parts.behind
        is_same = all(x.element_hash() == y.element_hash() for x, y in zip(a[:2], self.at[:2], strict=True))
        return self.own if is_same else (a, a)


class SymbolicRange(NamedTuple):
    """A range from low to high, SX scalars. The range of a single value contains the same expression twice.

    `jumps` is 1 if the value may jump within the range of its arguments. If the value is a product of a condition and
    a factor, `chosen` contains the ranges of both. `parts` are the ranges on both sides of a knot of a table.
    """

    low: ca.SX
    high: ca.SX
    jumps: ca.SX = ca.SX(0)
    chosen: Any = None
    parts: Any = None

    @property
    def is_point(self) -> bool:
        return self.low.element_hash() == self.high.element_hash()


def ranges(f: ca.Function, inputs: Sequence[Sequence[SymbolicRange]]) -> list[list[SymbolicRange]]:
    """Ranges of the nonzeros of an SX Function's outputs for ranges of the nonzeros of its inputs.

    A range is infinite if a denominator may vanish, or if an operation has no rule.

    Examples
    --------
    >>> x = ca.SX.sym("x")
    >>> ranges(ca.Function("f", [x], [x + 1]), [[SymbolicRange(ca.SX(2), ca.SX(5))]])
    [[SymbolicRange(low=SX(3), high=SX(6), jumps=SX(0), chosen=None, parts=None)]]
    """
    return interpret(f, inputs, _operation, lambda number: _point(ca.SX(number)))


def ranges_along(values: ca.SX, x: ca.SX, p: ca.SX, t: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Ranges of values (m,) of x (n,), p and t along a part of a path, and ranges of their rates times the duration.

    The symbols (4 n + 3,) are the smallest and largest x, the smallest and largest rates of x times the duration,
    start, end and duration. The expressions (4 m,) are the smallest and largest values, and the smallest and largest
    rates times the duration. Rates across a jump are infinite.
    """
    n = x.numel()
    dx, dt, box = ca.SX.sym("dx", n), ca.SX.sym("dt"), ca.SX.sym("box", 4 * n + 3)
    along_x = ca.jtimes(values, x, dx) if n and values.numel() else ca.SX(values.numel(), 1)
    changes = along_x + ca.jacobian(values, t) * dt
    f = common("f", [x, dx, t, dt, p], [ca.densify(values), ca.densify(changes)])
    low, high, least, most = (ca.vertsplit(box[k * n : (k + 1) * n]) for k in range(4))
    own = [
        [SymbolicRange(*ends) for ends in zip(low, high, strict=True)],
        [SymbolicRange(*ends) for ends in zip(least, most, strict=True)],
    ]
    time = [[SymbolicRange(box[4 * n], box[4 * n + 1])], [_point(box[4 * n + 2])]]
    found = ranges(f, [*own, *time, [_point(parameter) for parameter in ca.vertsplit(p)]])
    values_found, changes_found = found
    endless = [ca.if_else(value.jumps, _INFINITE, 0) for value in values_found]
    return box, ca.vertcat(
        ca.SX(0, 1),
        *(value.low for value in values_found),
        *(value.high for value in values_found),
        *(change.low - more for change, more in zip(changes_found, endless, strict=True)),
        *(change.high + more for change, more in zip(changes_found, endless, strict=True)),
    )


def _operation(code: int | Entry, arguments: tuple[SymbolicRange, ...]) -> SymbolicRange:
    # An operation of single values stays one expression, so equal parts keep their common subexpression.
    if all(a.is_point for a in arguments):
        return _point(applied(code, *(a.low for a in arguments)))
    result = _result(code, arguments)
    steps = code in _STEPS and not any(a.is_point and is_soft(a.low) for a in arguments)
    own = ca.ne(result.low, result.high) if steps else result.jumps
    jumps = [jump for jump in (own, *(a.jumps for a in arguments)) if not jump.is_zero()]
    return result._replace(jumps=reduce(ca.logic_or, jumps, ca.SX(0)))


def _result(code: int | Entry, arguments: tuple[SymbolicRange, ...]) -> SymbolicRange:
    """The range by the rule of the operation, applied to both parts if pieces of a table meet in an argument."""
    parts = next((a.parts for a in arguments if a.parts is not None), None)
    if parts is not None:
        before, behind = (_operation(code, side) for side in zip(*map(parts.of, arguments), strict=True))
        return _hull(*before[:2], *behind[:2])._replace(parts=parts._replace(before=before, behind=behind))
    if isinstance(code, Entry):
        return _entry(code, *arguments)
    return _RULES[code](*arguments) if code in _RULES else _ANYWHERE


def _entry(entry: Entry, group: SymbolicRange, at: SymbolicRange) -> SymbolicRange:
    """The range of an entry: of one piece, of two pieces that meet, or of all pieces."""
    pieces, column = entry
    key = (pieces.name, *(end.element_hash() for end in (*group[:2], *at[:2])))
    if key not in _MET:  # all columns have the same parts
        first, last = pieces(group.low, at.low), pieces(group.high, at.high)
        place = ca.if_else(last[-1] > first[-1], last[0], at.high)
        own = SymbolicRange(at.low, ca.fmin(at.high, place)), SymbolicRange(ca.fmax(at.low, place), at.high)
        _MET.clear()
        _MET[key] = group, at, own, first, last
    _, at, own, *both = _MET[key]
    are_near = both[1][-1] - both[0][-1] <= 1
    ends = [float(end(pieces.data[2 + column])) for end in (np.min, np.max)]
    sides = [SymbolicRange(*(ca.if_else(are_near, values[column], end) for end in ends)) for values in both]
    found = _hull(*sides[0][:2], *sides[1][:2])
    # One expression may use many splines. Combinations of the sides of all their knots would be too many.
    return found if isinstance(pieces, Smooth) else found._replace(parts=_SplitRange(at, own, *sides))


_MET: dict[tuple[Any, ...], Any] = {}
"""The ranges of the last entry, by their hashes."""


def _point(value: ca.SX) -> SymbolicRange:
    return SymbolicRange(value, value)


_ANYWHERE = SymbolicRange(-_INFINITE, _INFINITE)


# CasADi's operators and functions take six times as long as `SX.binary`, which gives the same expressions.
_times, _plus, _minus, _least, _most = (
    partial(ca.SX.binary, code) for code in (ca.OP_MUL, ca.OP_ADD, ca.OP_SUB, ca.OP_FMIN, ca.OP_FMAX)
)


def _hull(*values: ca.SX) -> SymbolicRange:
    return SymbolicRange(reduce(_least, values), reduce(_most, values))


def _where(test: ca.SX, a: SymbolicRange, b: SymbolicRange) -> SymbolicRange:
    return SymbolicRange(ca.if_else(test, a.low, b.low), ca.if_else(test, a.high, b.high))


def _is_positive(a: SymbolicRange) -> bool:
    """Whether the form of a range shows that its lower end is at least 0."""
    low = a.low
    if low.is_constant():
        return float(low) >= 0
    return low.op() in (ca.OP_SQ, ca.OP_FABS, ca.OP_SQRT, ca.OP_EXP) or (
        low.op() == ca.OP_FMAX and any(low.dep(k).is_constant() and float(low.dep(k)) >= 0 for k in range(2))
    )


def _negative(a: SymbolicRange) -> SymbolicRange:
    return SymbolicRange(-a.high, -a.low)


def _rising(code: int, low: float, high: float, a: SymbolicRange) -> SymbolicRange:
    """The range of a nondecreasing operation with a domain from low to high."""
    is_bounded = math.isfinite(low) or math.isfinite(high)
    ends = [ca.fmin(ca.fmax(end, low), high) if is_bounded else end for end in a[:2]]
    return SymbolicRange(*(ca.SX.unary(code, end) for end in ends))


def _sum(a: SymbolicRange, b: SymbolicRange) -> SymbolicRange:
    if a.chosen and b.chosen:
        (condition, one), (other, two) = a.chosen, b.chosen
        # CasADi splits if_else(c, x, y) into c * x + !c * y. The plain sum of both ranges would be too wide.
        if ca.is_equal(other.low, ca.logic_not(condition.high), 1):
            return _either(condition, one, two)
    return SymbolicRange(_plus(a.low, b.low), _plus(a.high, b.high))


def _either(condition: SymbolicRange, a: SymbolicRange, b: SymbolicRange) -> SymbolicRange:
    """The range of a value that is a if the condition holds, and b otherwise."""
    some, every = condition.high, condition.low
    low = ca.fmin(ca.if_else(some, a.low, _INFINITE), ca.if_else(every, _INFINITE, b.low))
    return SymbolicRange(low, ca.fmax(ca.if_else(some, a.high, -_INFINITE), ca.if_else(every, -_INFINITE, b.high)))


def _product(a: SymbolicRange, b: SymbolicRange) -> SymbolicRange:
    if b.is_point or _is_positive(b):
        a, b = b, a
    if a.is_point and a.low.is_constant():
        ends = SymbolicRange(_times(a.low, b.low), _times(a.low, b.high))
        return ends if float(a.low) >= 0 else SymbolicRange(ends.high, ends.low)
    if a.is_point:
        return _hull(_times(a.low, b.low), _times(a.low, b.high))
    if _is_positive(a):
        low, high = _times(a.low, b.low), _times(a.high, b.high)
        if _is_positive(b):
            return SymbolicRange(low, high)
        return SymbolicRange(_least(low, _times(a.high, b.low)), _most(_times(a.low, b.high), high))
    return _hull(*(_times(x, y) for x in a[:2] for y in b[:2]))


def _inverse(a: SymbolicRange) -> SymbolicRange:
    if a.is_point:
        return _point(1 / a.low)
    return _where(a.low * a.high > 0, SymbolicRange(1 / a.high, 1 / a.low), _ANYWHERE)


def _size(a: SymbolicRange) -> SymbolicRange:
    return SymbolicRange(_most(_most(a.low, -a.high), _ZERO), _most(-a.low, a.high))


def _square(a: SymbolicRange) -> SymbolicRange:
    size = a if _is_positive(a) else _size(a)  # shorter expressions if the sign is known
    return SymbolicRange(size.low**2, size.high**2)


def _power(a: SymbolicRange, exponent: SymbolicRange) -> SymbolicRange:
    if not (exponent.is_point and exponent.low.is_constant()):
        positive = SymbolicRange(*(ca.log(ca.fmax(end, 0)) for end in a[:2]))
        return SymbolicRange(*(ca.exp(end) for end in _product(positive, exponent)[:2]))
    n = float(exponent.low)
    if n < 0:
        return _inverse(_power(a, _point(ca.SX(-n))))
    if n % 2 == 1:
        return SymbolicRange(a.low**n, a.high**n)
    base = _size(a) if n % 1 == 0 else SymbolicRange(*(ca.fmax(end, 0) for end in a[:2]))
    return SymbolicRange(base.low**n, base.high**n)


def _turned(f: Callable[[ca.SX], ca.SX], a: SymbolicRange, top: float) -> SymbolicRange:
    """The range of a sine or cosine. The value is 1 if the argument is `top` plus whole turns."""

    def has(angle: float) -> ca.SX:
        return ca.floor((a.high - angle) / (2 * math.pi)) >= ca.ceil((a.low - angle) / (2 * math.pi))

    ends = _hull(f(a.low), f(a.high))
    return SymbolicRange(ca.if_else(has(top + math.pi), -1, ends.low), ca.if_else(has(top), 1, ends.high))


def _tangent(a: SymbolicRange) -> SymbolicRange:
    def branch(end: ca.SX) -> ca.SX:
        return ca.floor(end / math.pi + 0.5)

    return _where(branch(a.low) >= branch(a.high), SymbolicRange(ca.tan(a.low), ca.tan(a.high)), _ANYWHERE)


def _angle(y: SymbolicRange, x: SymbolicRange) -> SymbolicRange:
    corners = _hull(*(ca.atan2(a, b) for a in y[:2] for b in x[:2]))
    on_cut = ca.logic_and(x.low <= 0, ca.logic_and(y.low <= 0, y.high >= 0))
    return _where(on_cut, SymbolicRange(ca.SX(-math.pi), ca.SX(math.pi)), corners)._replace(jumps=on_cut)


def _within_period(
    rounded: Callable[[ca.SX], ca.SX], a: SymbolicRange, b: SymbolicRange, share: float
) -> SymbolicRange:
    """The range of a - b rounded(a / b), at most `share` times b. The value jumps if the rounded number jumps."""
    if not b.is_point:
        size = share * _size(b).high
        return SymbolicRange(-size, size, ca.SX(1))
    low, high = (rounded(end / b.low) for end in a[:2])
    size, jumps = share * ca.fabs(b.low), ca.ne(low, high)
    found = _where(jumps, SymbolicRange(-size, size), SymbolicRange(a.low - b.low * low, a.high - b.low * low))
    return found._replace(jumps=jumps)


def _with_sign(a: SymbolicRange, b: SymbolicRange) -> SymbolicRange:
    size = _size(a)
    either = _where(b.high < 0, _negative(size), SymbolicRange(-size.high, size.high))
    found = _where(b.low > 0, size, either)  # -0 has a sign
    return found._replace(jumps=ca.logic_and(b.low <= 0, b.high >= 0))


def _chosen(condition: SymbolicRange, a: SymbolicRange) -> SymbolicRange:
    """The range of a value that is a if a condition holds, else 0. If the condition may change: the union of both."""
    if condition.is_point:
        return SymbolicRange(*(ca.if_else(condition.low, end, 0) for end in a[:2]))
    either = SymbolicRange(*(ca.if_else(condition.high, end, 0) for end in (ca.fmin(a.low, 0), ca.fmax(a.high, 0))))
    return _where(condition.low, a, either)._replace(chosen=(condition, a))


_RISING: dict[int, tuple[float, float]] = dict.fromkeys(
    (
        *(ca.OP_ASSIGN, ca.OP_TWICE, ca.OP_SIGN, ca.OP_FLOOR, ca.OP_CEIL, ca.OP_EXP, ca.OP_EXPM1, ca.OP_ATAN),
        *(ca.OP_SINH, ca.OP_TANH, ca.OP_ASINH, ca.OP_ERF),
    ),
    (-math.inf, math.inf),
) | {
    ca.OP_SQRT: (0.0, math.inf),
    ca.OP_LOG: (0.0, math.inf),
    ca.OP_LOG1P: (-1.0, math.inf),
    ca.OP_ACOSH: (1.0, math.inf),
    ca.OP_ASIN: (-1.0, 1.0),
    ca.OP_ATANH: (-1.0, 1.0),
}
"""Nondecreasing operations, with the ends of their domain."""
_RULES: dict[int, Callable[..., SymbolicRange]] = {
    ca.OP_ADD: _sum,
    ca.OP_SUB: lambda a, b: SymbolicRange(_minus(a.low, b.high), _minus(a.high, b.low)),
    ca.OP_NEG: _negative,
    ca.OP_MUL: _product,
    ca.OP_DIV: lambda a, b: _product(a, _inverse(b)),
    ca.OP_INV: _inverse,
    ca.OP_SQ: _square,
    ca.OP_FABS: _size,
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_SIN: lambda a: _turned(ca.sin, a, math.pi / 2),
    ca.OP_COS: lambda a: _turned(ca.cos, a, 0.0),
    ca.OP_TAN: _tangent,
    ca.OP_ACOS: lambda a: SymbolicRange(ca.acos(ca.fmin(a.high, 1)), ca.acos(ca.fmax(a.low, -1))),
    ca.OP_ATAN2: _angle,
    ca.OP_COSH: lambda a: SymbolicRange(*map(ca.cosh, _size(a)[:2])),
    ca.OP_HYPOT: lambda a, b: SymbolicRange(*map(ca.hypot, _size(a)[:2], _size(b)[:2])),
    ca.OP_FMIN: lambda a, b: SymbolicRange(ca.fmin(a.low, b.low), ca.fmin(a.high, b.high)),
    ca.OP_FMAX: lambda a, b: SymbolicRange(ca.fmax(a.low, b.low), ca.fmax(a.high, b.high)),
    ca.OP_FMOD: lambda a, b: _within_period(lambda q: ca.if_else(q < 0, ca.ceil(q), ca.floor(q)), a, b, 1.0),
    ca.OP_REMAINDER: lambda a, b: _within_period(lambda q: ca.floor(q + 0.5), a, b, 0.5),
    ca.OP_COPYSIGN: _with_sign,
    ca.OP_LT: lambda a, b: SymbolicRange(a.high < b.low, a.low < b.high),
    ca.OP_LE: lambda a, b: SymbolicRange(a.high <= b.low, a.low <= b.high),
    ca.OP_EQ: lambda a, b: SymbolicRange(ca.SX(0), ca.logic_and(a.low <= b.high, b.low <= a.high)),
    ca.OP_NE: lambda a, b: SymbolicRange(ca.logic_or(a.high < b.low, b.high < a.low), ca.SX(1)),
    ca.OP_NOT: lambda a: SymbolicRange(ca.logic_not(a.high), ca.logic_not(a.low)),
    ca.OP_AND: lambda a, b: SymbolicRange(ca.logic_and(a.low, b.low), ca.logic_and(a.high, b.high)),
    ca.OP_OR: lambda a, b: SymbolicRange(ca.logic_or(a.low, b.low), ca.logic_or(a.high, b.high)),
    ca.OP_IF_ELSE_ZERO: _chosen,
    **{code: partial(_rising, code, *domain) for code, domain in _RISING.items()},
}
"""The rules of the operations. For a condition, low is 1 if it always holds, and high is 1 if it holds somewhere."""
_STEPS = {ca.OP_FLOOR, ca.OP_CEIL, ca.OP_SIGN, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE}
"""Operations that are constant except for jumps."""
