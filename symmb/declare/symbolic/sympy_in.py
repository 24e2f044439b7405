"""Conversion from SymPy to CasADi SX. Symbols are bound by name, and all other nodes are converted one by one."""

import sys
from collections.abc import Callable, Mapping
from functools import cache, reduce
from typing import Any

import casadi as ca

from symmb._errors import DeclarationError, Faults

SAME_NAMES = "exp log sin cos tan asin acos atan atan2 sinh cosh tanh asinh acosh atanh erf erfinv".split()
"""Functions with the same name and meaning in CasADi and SymPy."""


def is_sympy(value: object) -> bool:
    """Whether `value` is a SymPy expression or matrix. This check does not load SymPy.

    Examples
    --------
    >>> import sympy
    >>> is_sympy(sympy.Symbol("l1") ** 2), is_sympy(2.0)
    (True, False)
    """
    sympy = sys.modules.get("sympy")
    return sympy is not None and isinstance(value, (sympy.Basic, sympy.MatrixBase))


def from_sympy(expression: Any, symbols: Mapping[str, ca.SX]) -> ca.SX:
    """SX of a SymPy expression, truth value or matrix. Symbols are bound by name: "l1", "rod1.theta", "t".

    Zero entries become structural zeros. Raises DeclarationError for unknown names, for functions without a counterpart
    in CasADi, for NaN, and for a Piecewise without a final branch.

    Examples
    --------
    >>> import casadi as ca, sympy
    >>> l1, theta = sympy.symbols("l1 rod1.theta")
    >>> from_sympy(l1**2 * sympy.sin(theta), {"l1": ca.SX.sym("l1"), "rod1.theta": ca.SX.sym("rod1.theta")})
    SX((sq(l1)*sin(rod1.theta)))
    """
    import sympy

    _check_names(expression, symbols)

    @cache
    def convert(node: Any) -> ca.SX:
        if node.is_Symbol:
            return symbols[node.name]
        if node is sympy.nan or node is sympy.zoo:
            raise DeclarationError(
                f"SymPy expression contains {node}: it divides by zero, or contains objects that are not from SymPy."
            )
        if node.is_Number or node.is_NumberSymbol:
            return ca.SX(float(node))
        if isinstance(node, sympy.Piecewise):
            return _piecewise(node, convert)
        if node.func not in _counterparts():
            raise DeclarationError(_no_counterpart(node))
        return _counterparts()[node.func](*map(convert, node.args))

    if isinstance(expression, sympy.MatrixBase):
        matrix = ca.SX(*expression.shape)
        for (row, column), entry in expression.todok().items():
            matrix[row, column] = convert(entry)
        return matrix
    return convert(expression)


def _check_names(expression: Any, symbols: Mapping[str, ca.SX]) -> None:
    faults = Faults()
    for name in sorted({symbol.name for symbol in expression.free_symbols} - set(symbols)):
        import difflib

        near = difflib.get_close_matches(name, symbols, n=1)
        hint = f"Did you mean '{near[0]}'?" if near else f"Known names: {', '.join(symbols) or 'none'}."
        faults.append(f"Unknown symbol '{name}' in a SymPy expression. {hint}")
    faults.raise_any()


def _no_counterpart(node: Any) -> str:
    import sympy

    if isinstance(node, (sympy.core.function.AppliedUndef, sympy.Derivative)):
        return (
            f"SymPy expression contains {node}, a function of time. Write coordinates and velocities as "
            "plain Symbols with the names of the system, such as Symbol('rod1.theta')."
        )
    return f"SymPy function '{node.func.__name__}' in {node} has no CasADi counterpart. Use other functions."


def _piecewise(node: Any, convert: Callable[[Any], ca.SX]) -> ca.SX:
    import sympy

    if sympy.Or(*(condition for _, condition in node.args)) != sympy.true:
        raise DeclarationError(f"{node} is not defined for all values. Add the final branch (value, True).")
    *branches, (value, _) = node.args
    result = convert(value)
    for value, condition in reversed(branches):
        result = ca.if_else(convert(condition), convert(value), result)
    return result


@cache
def _counterparts() -> dict[Any, Callable[..., ca.SX]]:
    import sympy as sp

    def fold(function: Callable[[Any, Any], Any]) -> Callable[..., ca.SX]:
        return lambda *arguments: reduce(function, arguments)

    return {
        sp.Add: fold(lambda a, b: a + b),
        sp.Mul: fold(lambda a, b: a * b),
        sp.Pow: lambda a, b: a**b,
        **{getattr(sp, name): getattr(ca, name) for name in SAME_NAMES},
        sp.sec: lambda a: 1 / ca.cos(a),
        sp.csc: lambda a: 1 / ca.sin(a),
        sp.cot: lambda a: ca.cos(a) / ca.sin(a),
        sp.erfc: lambda a: 1 - ca.erf(a),
        sp.Abs: ca.fabs,
        sp.sign: ca.sign,
        sp.floor: ca.floor,
        sp.ceiling: ca.ceil,
        sp.Mod: lambda a, b: a - b * ca.floor(a / b),
        sp.Min: fold(ca.fmin),
        sp.Max: fold(ca.fmax),
        sp.Heaviside: lambda x, at_zero: ca.if_else(x > 0, 1, ca.if_else(x < 0, 0, at_zero)),
        sp.Eq: lambda a, b: a == b,
        sp.Ne: lambda a, b: a != b,
        sp.Lt: lambda a, b: a < b,
        sp.Le: lambda a, b: a <= b,
        sp.Gt: lambda a, b: a > b,
        sp.Ge: lambda a, b: a >= b,
        sp.Not: ca.logic_not,
        sp.And: fold(ca.logic_and),
        sp.Or: fold(ca.logic_or),
        sp.true.func: lambda: ca.SX(1),
        sp.false.func: lambda: ca.SX(0),
    }
