"""Taylor: coefficients against SymPy's derivatives, ranges against the paper's."""

from math import comb, factorial
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp
from black_boxes import errors_of

from symmb import Box, PropagationError, Taylor, propagate
from symmb.bound.methods.taylor import _mixed
from symmb.bound.polynomials.legendre import homogeneous
from symmb.bound.reductions import bounded

TIMES = np.array([0.0, 0.5, 2.0])


def symbolic(expressions, symbols, parameters):
    """Outputs that are SymPy expressions of parameters and t, with jets by differentiation along directions."""
    t, eps = sp.Symbol("t"), sp.Symbol("eps")

    def jets(p0, directions, order):
        result = np.empty((order + 1, len(directions), len(TIMES), len(expressions)))
        for m, direction in enumerate(directions):
            moved = {s: float(p) + float(u) * eps for s, p, u in zip(symbols, p0, direction, strict=True)}
            for n, expression in enumerate(expressions):
                along = expression.subs(moved, simultaneous=True)
                for j in range(order + 1):
                    f = sp.lambdify(t, along.diff(eps, j).subs(eps, 0) / factorial(j), "numpy")
                    result[j, m, :, n] = f(TIMES)
        return result

    own = {"expressions": expressions, "symbols": symbols, "parameters": parameters, "jets": jets}
    return SimpleNamespace(times=TIMES, outputs=tuple(f"y{k}" for k in range(len(expressions))), **own)


A, B, C, D = sp.symbols("a b c d")
T = sp.Symbol("t")
FOUR = symbolic(
    expressions=(sp.exp(A * B - C) * sp.cos(T * D), A * B * C * D + T * A**3),
    symbols=(A, B, C, D),
    parameters={"a": 1.0, "b": 0.5, "c": 0.2, "d": 2.0},
)


def _around(names):
    return Box(**{name: (FOUR.parameters[name] - 0.1, FOUR.parameters[name] + 0.3) for name in names})


def _reference(simulator, box, order):
    """Interval sum of all derivatives over the box, written with SymPy's derivatives one by one."""
    radius = dict(zip(box.names, box.radius, strict=True))
    lower = np.zeros((len(TIMES), len(simulator.expressions)))
    upper = lower.copy()
    free = [s for s in simulator.symbols if s.name in box.names]
    middle = simulator.parameters | dict(zip(box.names, box.center, strict=True))
    center = {s: middle[s.name] for s in simulator.symbols}
    for n, expression in enumerate(simulator.expressions):
        for degree in range(order + 1):
            for beta in homogeneous(len(free), degree):
                derivative, scale = expression, 1.0
                for s, power in zip(free, beta, strict=True):
                    derivative = derivative.diff(s, power)
                    scale *= radius[s.name] ** power / factorial(power)
                value = np.broadcast_to(sp.lambdify(T, derivative.subs(center), "numpy")(TIMES), TIMES.shape) * scale
                if degree and any(power % 2 for power in beta):
                    low, high = -np.abs(value), np.abs(value)
                else:
                    low, high = (value, value) if not degree else (np.minimum(value, 0), np.maximum(value, 0))
                lower[:, n] += low
                upper[:, n] += high
    return lower, upper


@pytest.mark.parametrize(("names", "order"), [("abcd", 1), ("abcd", 2), ("dba", 3), ("c", 6)])
def test_any_order_and_number_of_parameters(names, order):
    box = _around(names)
    result = bounded(Taylor(order), FOUR, box)
    np.testing.assert_allclose([result.lower, result.upper], _reference(FOUR, box, order), atol=1e-11)
    assert result.evaluations == comb(len(names) + order, order)


@pytest.mark.parametrize(("names", "order", "subintervals"), [("ab", 2, 3), ("c", 3, 4), ("abd", 1, 2)])
def test_union_over_subintervals(names, order, subintervals):
    box = _around(names)
    result = bounded(Taylor(order, subintervals), FOUR, box)
    cuts = [np.linspace(low, high, subintervals + 1) for low, high in box.bounds]
    parts = [
        _reference(FOUR, Box(**{name: (c[i], c[i + 1]) for name, c, i in zip(names, cuts, part, strict=True)}), order)
        for part in np.ndindex(*(subintervals,) * len(names))
    ]
    lower, upper = np.array(parts).swapaxes(0, 1)
    np.testing.assert_allclose([result.lower, result.upper], [lower.min(axis=0), upper.max(axis=0)], atol=1e-11)
    assert result.evaluations == len(parts) * comb(len(names) + order, order)


def test_equation_27_range_of_the_paper_s_cubic():
    x = sp.Symbol("x")
    result = bounded(Taylor(order=3), symbolic((x**3 - 2 * x**2 + x,), (x,), {"x": 0.0}), Box(x=(0, 1)))
    np.testing.assert_allclose(errors_of(result, -1 / 4, 3 / 8), 0, atol=1e-12)


@pytest.mark.parametrize(("d", "order"), [(2, 2), (3, 4), (6, 3), (5, 4)])
def test_mixed_coefficients_from_directions(d, order):
    unit = np.array(homogeneous(d, order)) / order
    for degree in range(1, order + 1):
        beta = np.array(homogeneous(d, degree))
        known = np.random.default_rng(degree).normal(size=(len(beta), 1, 1))
        along = np.einsum("mb,bty->mty", np.prod(unit[:, None] ** beta[None], axis=2), known)
        np.testing.assert_allclose(_mixed(beta, unit, along), known, atol=1e-11)


def test_derivatives_that_are_not_finite():
    broken = symbolic((A,), (A,), {"a": 1.0})
    broken.jets = lambda p0, directions, order: np.full((order + 1, len(directions), 3, 1), np.nan)
    with pytest.raises(PropagationError, match="derivatives that are not finite"):
        propagate(broken, Taylor(), Box(a=(0, 1)))
