"""Conversion from CasADi SX to SymPy, instruction by instruction.

Truth values stay SymPy Booleans in conditions, and become Piecewise((1, condition), (0, True)) only if a number is
needed. Relations, Piecewise, Max, Abs and similar functions are not evaluated, because SymPy's evaluation takes seconds
for the matrices of a mechanism.
"""

import math
import re
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache
from typing import Any

import casadi as ca

from symmb._errors import DeclarationError
from symmb.declare.symbolic.common import common
from symmb.declare.symbolic.instructions import interpret, operation_name
from symmb.declare.symbolic.pieces import Entry
from symmb.declare.symbolic.sympy_in import SAME_NAMES


def to_sympy(expr: ca.SX, symbols: Sequence[ca.SX], names: Sequence[str]) -> Any:
    """SymPy matrix of an SX matrix (n, m). Each SX symbol becomes a real SymPy Symbol with its name, such as
    "rod1.theta".

    Structural zeros are 0. Floats that are simple fractions, or simple fractions of pi, become exact numbers; all other
    floats become a Float with the same bits. Raises DeclarationError for a symbol that is not listed, a NaN constant,
    or an operation without counterpart in SymPy.

    Examples
    --------
    >>> import casadi as ca
    >>> l, theta = ca.SX.sym("l"), ca.SX.sym("theta")
    >>> to_sympy(l**3 / 12 - 0.5 * l * ca.sin(theta), [l, theta], ["l1", "rod1.theta"])
    Matrix([[l1**3/12 - l1*sin(rod1.theta)/2]])
    """
    import sympy

    known = {symbol.element_hash() for symbol in symbols}
    missing = [symbol.name() for symbol in ca.symvar(expr) if symbol.element_hash() not in known]
    if missing:
        raise DeclarationError(f"Expression contains symbols that are not listed: {', '.join(missing)}.")
    f = ca.Function("expr", [ca.vertcat(ca.SX(0, 1), *symbols)], [expr])
    values = [sympy.Symbol(name, real=True) for name in names]
    [nonzeros] = interpret(f, [values], _operation, _constant)
    return _matrix(expr, nonzeros)


def with_names(
    parts: Sequence[ca.SX], symbols: Sequence[ca.SX], names: Sequence[str]
) -> tuple[dict[Any, Any], list[Any]]:
    """SymPy matrices of long expressions with names for shared parts: a dictionary symbol -> part, and the matrices.

    The arguments are those of `to_sympy`, but with several matrices.

    Examples
    --------
    >>> import casadi as ca
    >>> x, y = ca.SX.sym("x"), ca.SX.sym("y")
    >>> distance = ca.sqrt(x**2 + y**2)
    >>> with_names([distance / (1 + distance)], [x, y], ["x", "y"])
    ({a1: sqrt(x**2 + y**2)}, [Matrix([[a1/(a1 + 1)]])])
    """
    import sympy

    f = common("expr", [ca.vertcat(ca.SX(0, 1), *symbols)], list(parts))
    letter = next(c for c in "abcdefghijkuvwz" if not any(re.fullmatch(rf"{c}_?\d+", name) for name in names))
    uses: list[list[int]] = []

    def count(_: Any, of: tuple[list[int], ...]) -> list[int]:
        for part in of:
            part[0] += 1
        uses.append([0])
        return uses[-1]

    interpret(f, [[[0] for _ in names]], count, lambda _: [0])
    definitions: dict[Any, Any] = {}
    used = iter(uses)

    def named(code: int | Entry, of: tuple[tuple[Any, int], ...]) -> tuple[Any, int]:
        value, length = _operation(code, tuple(value for value, _ in of)), sum((n for _, n in of), 1)
        is_shared = next(used)[0] > 1 and length >= 4 and code != ca.OP_IF_ELSE_ZERO
        if _is_condition(value) or value.is_Atom or not (is_shared or length > 40):
            return value, length
        symbol = sympy.Symbol(f"{letter}{len(definitions) + 1}", real=True)
        definitions[symbol] = value
        return symbol, 0

    outputs = interpret(f, [[(sympy.Symbol(name, real=True), 0) for name in names]], named, lambda c: (_constant(c), 0))
    return definitions, [_matrix(part, [e for e, _ in of]) for part, of in zip(parts, outputs, strict=True)]


def _matrix(expr: ca.SX, nonzeros: Sequence[Any]) -> Any:
    import sympy

    matrix = sympy.zeros(*expr.shape)
    for row, column, value in zip(*expr.sparsity().get_triplet(), nonzeros, strict=True):
        matrix[row, column] = _number(value)
    return matrix


def _constant(value: float) -> Any:
    import sympy

    if math.isnan(value):
        raise DeclarationError("The expression contains a NaN constant. Do not mix SX and SymPy in an expression.")
    if math.isinf(value):
        return sympy.oo if value > 0 else -sympy.oo
    fraction = Fraction(value).limit_denominator(1000)
    if float(fraction) == value and abs(fraction.numerator) < 2**53:
        return sympy.Rational(fraction.numerator, fraction.denominator)
    # pi / 6 and pi * (1 / 6) differ in the last bit. This difference is allowed.
    turn = Fraction(value / math.pi).limit_denominator(360)
    if abs(turn * math.pi - value) <= math.ulp(value) and abs(turn.numerator) < 2**20:
        return sympy.Rational(turn.numerator, turn.denominator) * sympy.pi
    return sympy.Float(value)


def _operation(code: int | Entry, arguments: tuple[Any, ...]) -> Any:
    if isinstance(code, Entry):
        return _entry(code, _number(arguments[1]))
    if code in _logic():
        return _logic()[code](*map(_condition, arguments))
    if code == ca.OP_IF_ELSE_ZERO:
        return _piecewise(_number(arguments[1]), _condition(arguments[0]), 0)
    if code in _algebra():
        return _algebra()[code](*map(_number, arguments))
    raise DeclarationError(f"CasADi operation {operation_name(code)} has no SymPy counterpart.")


def _entry(entry: Entry, at: Any) -> Any:
    """An entry of a table as a Piecewise with one case for each piece."""
    import sympy

    values = [_constant(value) for value in entry.pieces.data[2 + entry.column].tolist()]
    cases = [sympy.Lt(at, _constant(knot), evaluate=False) for knot in entry.pieces.knots.tolist()]
    return _cases([*zip(values, [*cases, sympy.true], strict=True)])


def _number(value: Any) -> Any:
    return _piecewise(1, value, 0) if _is_condition(value) else value


def _condition(value: Any) -> Any:
    import sympy

    return value if _is_condition(value) else sympy.Ne(value, 0, evaluate=False)


def _is_condition(value: Any) -> bool:
    # is_Boolean is false for relations, and isinstance(..., Boolean) true for symbols
    return value.is_Boolean or value.is_Relational


def _piecewise(value: Any, condition: Any, otherwise: Any) -> Any:
    import sympy

    rest = otherwise.args if isinstance(otherwise, sympy.Piecewise) else [(otherwise, sympy.true)]
    return _cases([(value, condition), *rest])


def _cases(pairs: Sequence[Any]) -> Any:
    """A Piecewise without evaluation, because SymPy merges nested conditions and fails for infinite bounds."""
    import sympy
    from sympy.functions.elementary.piecewise import ExprCondPair

    made = [sympy.Tuple.__new__(ExprCondPair, sympy.sympify(value), condition) for value, condition in pairs]
    return sympy.Basic.__new__(sympy.Piecewise, *made)


def _add(a: Any, b: Any) -> Any:
    """The sum of a and b. The two parts into which CasADi splits if_else(c, x, y) are joined again."""
    import sympy

    if isinstance(a, sympy.Piecewise) and isinstance(b, sympy.Piecewise):
        first, second, zero = a.args[0], b.args[0], ((0, True),)
        if a.args[1:] == b.args[1:] == zero and second.args[1] == sympy.Not(first.args[1]):
            return _piecewise(first.args[0], first.args[1], second.args[0])
    return a + b


def _remainder(a: Any, b: Any) -> Any:
    """IEEE remainder a - n b. n is a / b, rounded to the nearest integer, with ties to even."""
    import sympy

    twice = 2 * a / b
    return a - b * (sympy.ceiling((twice - 1) / 4) + sympy.floor((twice + 1) / 4))


@cache
def _logic() -> dict[int, Callable[..., Any]]:
    import sympy

    return {ca.OP_NOT: sympy.Not, ca.OP_AND: sympy.And, ca.OP_OR: sympy.Or}


@cache
def _algebra() -> dict[int, Callable[..., Any]]:
    import sympy as sp

    def raw(head: Any) -> Callable[..., Any]:
        return lambda *arguments: head(*arguments, evaluate=False)

    magnitude, modulo = raw(sp.Abs), raw(sp.Mod)
    return {
        ca.OP_ASSIGN: lambda a: a,
        ca.OP_LIFT: lambda a, _: a,
        ca.OP_ADD: _add,
        ca.OP_SUB: lambda a, b: a - b,
        ca.OP_MUL: lambda a, b: a * b,
        ca.OP_DIV: lambda a, b: a / b,
        ca.OP_NEG: lambda a: -a,
        ca.OP_INV: lambda a: 1 / a,
        ca.OP_TWICE: lambda a: 2 * a,
        ca.OP_SQ: lambda a: a**2,
        ca.OP_POW: sp.Pow,
        ca.OP_CONSTPOW: sp.Pow,
        ca.OP_SQRT: sp.sqrt,
        ca.OP_HYPOT: lambda a, b: sp.sqrt(a**2 + b**2),
        **{getattr(ca, f"OP_{name.upper()}"): getattr(sp, name) for name in SAME_NAMES},
        ca.OP_EXPM1: lambda a: sp.exp(a) - 1,
        ca.OP_LOG1P: lambda a: sp.log(1 + a),
        ca.OP_LT: raw(sp.Lt),
        ca.OP_LE: raw(sp.Le),
        ca.OP_EQ: raw(sp.Eq),
        ca.OP_NE: raw(sp.Ne),
        ca.OP_FMIN: raw(sp.Min),
        ca.OP_FMAX: raw(sp.Max),
        ca.OP_FABS: magnitude,
        ca.OP_SIGN: raw(sp.sign),
        ca.OP_FLOOR: raw(sp.floor),
        ca.OP_CEIL: raw(sp.ceiling),
        ca.OP_COPYSIGN: lambda a, b: _piecewise(magnitude(a), sp.Ge(b, 0, evaluate=False), -magnitude(a)),
        # fmod has the sign of its first argument, but SymPy's Mod has the sign of the second
        ca.OP_FMOD: lambda a, b: sp.sign(a) * modulo(magnitude(a), magnitude(b)),
        ca.OP_REMAINDER: _remainder,
    }
