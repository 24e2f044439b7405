"""Common subexpression elimination for expressions and Functions."""

from collections.abc import Sequence
from typing import Any

import casadi as ca

from symmb.declare.symbolic.instructions import interpret
from symmb.declare.symbolic.pieces import Entry, applied, is_compared_fast


def common(name: str, *parts: Any) -> ca.Function:
    """A `casadi.Function` in which equal expressions are evaluated once."""
    f = ca.Function(name, *parts)
    if not f.is_a("SXFunction") or is_compared_fast(f):
        arguments: Any = (name, *parts, {"cse": True})
        return ca.Function(*arguments)
    known: dict[tuple[Any, ...], ca.SX] = {}

    def operation(code: int | Entry, of: tuple[ca.SX, ...]) -> ca.SX:
        key = (code, *(a.element_hash() for a in of))
        if key not in known:
            known[key] = applied(code, *of)
        return known[key]

    def constant(value: float) -> ca.SX:
        return known.setdefault((repr(value),), ca.SX(value))

    inputs = f.sx_in()
    nonzeros = interpret(f, [ca.vertsplit(x.nz[:]) if x.nnz() else [] for x in inputs], operation, constant)
    outputs = [
        ca.SX(f.sparsity_out(i), ca.vertcat(*values)) if values else ca.SX(f.sparsity_out(i))
        for i, values in enumerate(nonzeros)
    ]
    return ca.Function(name, inputs, outputs, f.name_in(), f.name_out())


def shared(expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """Expressions with the same values that share their common subexpressions."""
    symbols = [ca.vertcat(ca.SX(0, 1), *ca.symvar(ca.veccat(*expressions)))]  # CasADi warns about many inputs
    f = ca.Function("all", symbols, expressions)
    return ca.cse(expressions) if is_compared_fast(f) else common("all", symbols, expressions).call(symbols)
