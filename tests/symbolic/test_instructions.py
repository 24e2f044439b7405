"""The instruction walk against CasADi's own evaluation."""

import math

import casadi as ca
import numpy as np
from faults import refused

from symmb.declare.symbolic.instructions import interpret, operation_name

FLOATS = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_SIN: math.sin,
    ca.OP_TWICE: lambda a: 2 * a,
    ca.OP_ATAN2: math.atan2,
}


def _floats(code, arguments):
    return FLOATS[code](*arguments)


def test_same_numbers_as_casadi_on_sparse_outputs():
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    matrix = ca.SX(3, 2)
    matrix[0, 0], matrix[2, 1] = ca.sin(x[0]) * y - 4, ca.atan2(x[1], y)
    f = ca.Function("f", [x, y], [matrix, x**2 + 2 * y, ca.SX(2, 2), ca.SX.zeros(2, 1), x])
    values = interpret(f, [[0.3, -1.2], [0.7]], _floats, float)
    for got, expected in zip(values, f([0.3, -1.2], 0.7), strict=True):
        np.testing.assert_allclose(got, expected.nonzeros(), rtol=1e-15)


def test_operands_have_an_order_and_operations_have_names():
    x = ca.SX.sym("x", 2)
    assert interpret(ca.Function("f", [x], [x[0] - x[1]]), [[5.0, 3.0]], _floats, float) == [[2.0]]
    assert operation_name(ca.OP_IF_ELSE_ZERO) == "if_else_zero"
    assert operation_name(12345) == "operation 12345"


def test_wrong_inputs_and_functions_are_told():
    x, m = ca.SX.sym("x", 2), ca.MX.sym("m")
    f = ca.Function("f", [x], [x])
    refused(r"\[2\] structural nonzeros, got \[3\]", interpret, f, [[1.0, 2.0, 3.0]], _floats, float)
    refused("'g' is not an SX Function", interpret, ca.Function("g", [m], [m]), [[1.0]], _floats, float)
    kept = ca.Function("inner", [x], [ca.sin(x)], {"never_inline": True})
    outer = ca.Function("outer", [x], [kept(x)])
    refused("'outer' calls another Function", interpret, outer, [[1.0, 2.0]], _floats, float)
