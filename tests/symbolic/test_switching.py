"""What depends on time alone, and where expressions have kinks: against functions written by hand."""

import casadi as ca
import numpy as np
import pytest

from symmb.declare.symbolic.switching import On, laws, switching

x, p, t = ca.SX.sym("x"), ca.SX.sym("p"), ca.SX.sym("t")
INPUTS = [(x, On.STATE), (p, On.PARAMETERS), (t, On.TIME)]


def found(expression):
    return switching(ca.Function("f", [x, p, t], [ca.densify(ca.SX(expression))]), INPUTS)


KINKS = [
    (ca.fabs(x - 1), ("fabs",), 1.0), (ca.sign(p * x - 2), ("sign",), 1.0), (ca.fmin(x, 2 - x), ("fmin",), 1.0),
    (ca.fmax(x, p), ("fmax",), 2.0), (ca.if_else(x < 3, x, 2.0), ("comparison",), 3.0),
    (x * ca.floor(t + x), ("floor",), 1.0), (ca.fmod(x, 3.0), ("fmod",), 3.0),
    (ca.fabs(p) + x / ca.fmax(x**2, 1e-24), (), None), (ca.tanh(x) * ca.sqrt(p), (), None),
]  # fmt: skip


@pytest.mark.parametrize(("expression", "names", "where"), KINKS, ids=lambda value: str(value)[:40])
def test_kinks_are_found_with_what_changes_sign_there(expression, names, where):
    """At p = 2 and t = 0."""
    result = found(expression)
    assert result.kinks == names
    if where is not None:
        g = ca.Function("g", [x, p, t], [result.switches])
        below, above = (np.sign(g(where + d, 2.0, 0.0).full().ravel()) for d in (-1e-6, 1e-6))
        assert (below * above == -1).any()


def test_laws_are_the_largest_parts_that_depend_on_time_but_not_on_the_state():
    expression = x * ca.exp(-p * t) + ca.if_else(t > 1, x**2, 0) + p * ca.sin(t) * ca.cos(t)
    values = ca.Function("signals", [p, t], [laws(expression, p, t)])(2.0, 1.5).full().ravel()
    np.testing.assert_allclose(sorted(values), sorted([np.exp(-3.0), 1.0, 2 * np.sin(1.5) * np.cos(1.5)]))
    assert laws(x * p, p, t).numel() == 0
