"""Short forms of the entries of matrices that are small enough to be simplified fast."""

from collections.abc import Sequence
from typing import Any

import casadi as ca

from symmb.declare.symbolic.instructions import interpret
from symmb.declare.symbolic.sympy_out import to_sympy


def simplified(expr: ca.SX, symbols: Sequence[ca.SX], names: Sequence[str]) -> Any:
    """The matrix of `to_sympy` with short entries; None if the entries are too long.

    Examples
    --------
    >>> import casadi as ca
    >>> m, l, theta = ca.SX.sym("m"), ca.SX.sym("l"), ca.SX.sym("theta")
    >>> x, y = l / 2 * ca.cos(theta), l / 2 * ca.sin(theta)
    >>> simplified(m * (x**2 + y**2) + m * l**2 / 12, [m, l, theta], ["m", "l", "theta"])
    Matrix([[l**2*m/3]])
    """
    f = ca.Function("expr", [ca.vertcat(ca.SX(0, 1), *symbols)], [expr])
    [sizes] = interpret(f, [[(0, 1)] * len(names)], _sizes, lambda _: (0, 1))
    # Matrices with at most this number of operations, and entries with at most this number of terms, are simplified.
    # All matrices of a system with three degrees of freedom take about a second. Larger limits take longer, and
    # smaller limits leave long entries.
    if sum(length for length, _ in sizes) > 800:
        return None
    matrix = to_sympy(expr, symbols, names)
    for row, column, (_, terms) in zip(*expr.sparsity().get_triplet(), sizes, strict=True):
        if terms <= 100:
            matrix[row, column] = _shortest(matrix[row, column])
    return matrix


def _sizes(code: Any, of: tuple[tuple[int, int], ...]) -> tuple[int, int]:
    """The number of operations of an expression without shared parts, and the number of terms after expansion."""
    length, terms = sum((n for n, _ in of), 1), [n for _, n in of]
    if code in (ca.OP_ADD, ca.OP_SUB):
        return length, sum(terms)
    if code in (ca.OP_MUL, ca.OP_SQ, ca.OP_DIV):
        return length, terms[0] * (terms[1] if code == ca.OP_MUL else terms[0] if code == ca.OP_SQ else 1)
    return (length, terms[0]) if code in (ca.OP_NEG, ca.OP_TWICE) else (length, 1)


def _shortest(expression: Any) -> Any:
    """The shortest of: the derived form, a sum of harmonics, or a sum of powers of sines or cosines."""
    import sympy
    from sympy.simplify.fu import TR5, TR6, TR8

    others: dict[Any, Any] = {}
    polynomial = sympy.expand(_polynomial(expression, others))
    harmonics = sympy.expand(TR8(polynomial))
    powers = sympy.expand(sympy.expand_trig(harmonics))
    sums = dict.fromkeys([harmonics, sympy.expand(TR5(powers)), sympy.expand(TR6(powers))])
    forms = [
        form.xreplace({new: old for old, new in others.items()}) for s in sums for form in (s, _grouped(s, others))
    ]
    shortest = min(forms, key=lambda form: form.count_ops())
    # Expanded products of sums are longer, but may still be easier to read.
    return shortest if shortest.count_ops() <= 1.25 * expression.count_ops() else expression


def _polynomial(expression: Any, others: dict[Any, Any]) -> Any:
    """The expression with symbols for all parts (such as roots) except products, sums, powers, sines and cosines."""
    import sympy

    is_power = expression.is_Pow and expression.exp.is_Integer
    if expression.is_Atom or (is_power and expression.base.is_Symbol):
        return expression
    if expression.is_Add or expression.is_Mul or isinstance(expression, sympy.sin | sympy.cos):
        return expression.func(*[_polynomial(part, others) for part in expression.args])
    if is_power:
        inverse = expression.base if expression.exp > 0 else 1 / expression.base
        base = _polynomial(inverse, others) if expression.exp > 0 else others.setdefault(inverse, _name(others))
        return base ** abs(expression.exp)
    return others.setdefault(expression, _name(others))


def _name(others: dict[Any, Any]) -> Any:
    import sympy

    return sympy.Symbol(f"{len(others)}", real=True)


def _grouped(total: Any, others: dict[Any, Any]) -> Any:
    """A sum in which terms with equal sines, cosines and other factors are collected, if they have common symbols."""
    import sympy

    groups: dict[Any, list[Any]] = {}
    for term in sympy.Add.make_args(total):
        coefficient, wave = term.as_independent(sympy.sin, sympy.cos, *others.values(), as_Add=False)
        groups.setdefault(wave, []).append(coefficient)
    terms = []
    for wave, coefficients in groups.items():
        plain: Any = sympy.Add(*coefficients)
        content, rest = plain.primitive()
        common = rest if rest.has(sympy.Float) else sympy.factor(rest)
        has_symbols = common.is_Pow or (common.is_Mul and not all(f.is_Number or f.is_Add for f in common.args))
        is_round = content.p > 1 or content.q % 5  # 0.005 (981 m - 200 k) is not a short form of 4.905 m - k
        terms.append(content * (common if has_symbols and is_round else rest) * wave)
    return sympy.Add(*terms)
