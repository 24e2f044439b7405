"""Interval arithmetic: every operation encloses its values, hardly wider than they are."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from faults import refused

from symmb import Box, IntervalArithmetic, PropagationError, propagate
from symmb.prove.interval import EXTENSIONS, Interval, operate


def plain(expressions, symbols, times=(0.0, 1.0), t=None):
    """Expressions of parameters and time, as a simulator."""
    names, expressions = [s.name() for s in symbols], ca.vertcat(*expressions)
    f = ca.Function("f", [ca.vertcat(*symbols), ca.SX.sym("t") if t is None else t], [expressions])
    outputs = tuple(f"y{k}" for k in range(expressions.numel()))
    return SimpleNamespace(parameters=dict.fromkeys(names, 0.0), times=np.array(times), outputs=outputs, expression=f)


def _bounds(expression, **box):
    symbols = [ca.SX.sym(name) for name in box]
    simulator = plain([expression(*symbols)], symbols)
    result = propagate(simulator, IntervalArithmetic(), Box(**box))
    return float(result.lower[0, 0]), float(result.upper[0, 0])


@pytest.mark.parametrize(
    ("f", "x", "expected"),
    [
        (lambda x: x**3 - 2 * x**2 + x, (0, 1), (-2, 2)),  # the paper's cubic; its range is [0, 4/27]
        (lambda x: x - x, (-1, 1), (0, 0)),  # CasADi cancels it
        (lambda x: x / (1 + x), (0, 1), (0, 1)),
        (lambda x: 1 / (1 + 25 * x**2), (-1, 1), (1 / 26, 1)),
        (lambda x: x**2, (-2, 1), (0, 4)),
        (lambda x: 1 / x, (-1, 1), (-np.inf, np.inf)),
        (lambda x: 1 / x, (0, 2), (0.5, np.inf)),
        (lambda x: ca.sqrt(x), (-1, 4), (0, 2)),  # where it is defined
        (lambda x: ca.if_else(x > 1, x, 5), (2, 3), (2, 3)),
        (lambda x: ca.if_else(x > 1, x, 5), (0, 1), (5, 5)),
        (lambda x: ca.tan(x), (1, 2), (-np.inf, np.inf)),
        (lambda x: ca.sin(x), (1, 8), (-1, 1)),
        (lambda x: ca.cos(x), (-0.5, 0.5), (np.cos(0.5), 1)),
        (lambda x: ca.cos(x), (100 * np.pi - 0.5, 100 * np.pi + 0.1), (np.cos(0.5), 1)),
        (lambda x: x**-3, (1, 2), (1 / 8, 1)),
        (lambda x: x**1.5, (1, 4), (1, 8)),
        (lambda x: ca.atan2(x, -1), (-1, 1), (-np.pi, np.pi)),
    ],
)
def test_known_ranges(f, x, expected):
    np.testing.assert_allclose(_bounds(f, x=x), expected, atol=1e-12)


RANGES = {
    (-3, 3): "NEG SQ TWICE EXP EXPM1 ATAN SINH COSH TANH ASINH FABS SIGN FLOOR CEIL",
    (-1, 1): "ASIN ACOS NOT ASSIGN",
    (-9, 9): "SIN COS",
    (0.1, 3): "INV LOG",
    (0, 3): "SQRT",
    (1, 3): "ACOSH",
    (-0.9, 3): "LOG1P",
    (-0.9, 0.9): "ATANH",
    (-1.5, 1.5): "TAN",
    (-2, 2): "ERF",
}
UNARY = {f"OP_{name}": ends for ends, names in RANGES.items() for name in names.split()}
NAMES = {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}
BINARY = [NAMES[code] for code in EXTENSIONS if NAMES[code] not in UNARY]
WIDER = {"OP_FMOD", "OP_REMAINDER", "OP_COPYSIGN", "OP_ATAN2", "OP_EQ", "OP_NE", "OP_DIV", "OP_POW", "OP_CONSTPOW"}


def _points(low, high, n):
    """n points that fill an interval, and 0 where it is inside."""
    points = np.linspace(low, high, n)
    return np.append(points, 0.0) if low <= 0 <= high else points


def _values(name, *arguments):
    """CasADi's own evaluation of one operation at many points."""
    code = getattr(ca, name)
    symbols = [ca.SX.sym(f"x{k}") for k in range(len(arguments))]
    expression = (ca.SX.unary if len(arguments) == 1 else ca.SX.binary)(code, *symbols)
    f = ca.Function("f", symbols, [expression])
    return np.asarray(f(*[np.ravel(a)[None, :] for a in arguments])).ravel()


def _intervals(low, high, n, rng):
    ends = np.sort(rng.uniform(low, high, (n, 2)), axis=1)
    ends[: n // 4] = np.sort(np.round(ends[: n // 4]).clip(low, high), axis=1)  # whole numbers and zeros too
    return ends


def check_enclosure(name, places, *ends, is_tight, share):
    """Values at places lie inside of an operation on intervals, which is wider by a share of its width at most."""
    with np.errstate(all="ignore"):
        values = _values(name, *places)
    values = values[np.isfinite(values)]
    lower, upper = operate(getattr(ca, name), tuple(Interval(*map(np.array, pair)) for pair in ends))
    if len(values):
        assert lower <= values.min() and values.max() <= upper
        slack = 1e-12 + share * (upper - lower) if is_tight else np.inf
        assert values.min() - lower <= slack and upper - values.max() <= slack


@pytest.mark.parametrize("name", UNARY)
def test_unary_operation_encloses_and_is_tight(name):
    is_tight = name not in ("OP_SIGN", "OP_FLOOR", "OP_CEIL", "OP_NOT")  # these jump between the points
    for ends in _intervals(*UNARY[name], 60, np.random.default_rng(1)):
        check_enclosure(name, [_points(*ends, 201)], ends, is_tight=is_tight, share=2e-3)


@pytest.mark.parametrize("name", BINARY)
def test_binary_operation_encloses_and_is_tight(name):
    rng = np.random.default_rng(2)
    positive = name in ("OP_POW", "OP_CONSTPOW")
    for both in zip(_intervals(0.1 if positive else -3, 3, 60, rng), _intervals(-3, 3, 60, rng), strict=True):
        places = np.meshgrid(*(_points(*ends, 51) for ends in both))
        check_enclosure(name, places, *both, is_tight=name not in WIDER, share=0.05)


def test_rounding_is_outward():
    lower, upper = _bounds(lambda x, y: x + y, x=(0.1, 0.1), y=(0.2, 0.2))
    assert lower < 0.30000000000000004 < upper and upper - lower < 2e-16


def test_vectorised_over_times_and_sparse_outputs():
    x, t = ca.SX.sym("x"), ca.SX.sym("t")
    simulator = plain([x * t, 0, ca.sin(t)], [x], np.linspace(0, 3, 301), t)
    result = propagate(simulator, IntervalArithmetic(), Box(x=(-1, 2)))
    np.testing.assert_allclose(result.upper[:, 0], 2 * simulator.times, atol=1e-12)
    assert not result.lower[:, 1].any() and not result.upper[:, 1].any()
    np.testing.assert_allclose(result.lower[:, 2], np.sin(simulator.times), atol=1e-14)


def test_operations_without_extension_and_arguments_outside_the_domain_are_named():
    refused("no interval extension of erfinv", lambda: _bounds(ca.erfinv, x=(0, 0.5)), error=PropagationError)
    told = r"argument of sqrt is in \[-2, -1\], outside the domain \(0.0, inf\)"
    refused(told, lambda: _bounds(ca.sqrt, x=(-2, -1)), error=PropagationError)
