"""Univariate Taylor coefficients of SX expressions along a curve."""

import math
from collections.abc import Sequence
from functools import lru_cache

import casadi as ca

from symmb._errors import PropagationError
from symmb.declare.symbolic.common import common

HIGHEST_ORDER = 100
"""Highest order of jets. Each order has more operations than the order before, typically three times as many."""
_MOST_OPERATIONS = 4e6
"""Maximum number of operations of a coefficient. Coefficients of order 8 of a double pendulum have this number and
compile in a minute."""


def jets(expression: ca.SX, curve: Sequence[Sequence[ca.SX]]) -> list[ca.SX]:
    """Taylor coefficients in eps (k + 1 SX) of an expression f(x_0) along curves of its arguments.

    A curve has the coefficients x_0, ..., x_k, symbols with the same shape. With x(eps) = x_0 + x_1 eps + x_2 eps^2 +
    ... the coefficients satisfy j f_j = D f_{j-1}. Here D is the directional derivative in which every x_i changes by
    (i + 1) x_{i+1}. Raises PropagationError if the coefficients have too many operations.
    """
    order = len(curve[0]) - 1
    coefficients, sizes = [expression], [0.0]
    for j in range(1, order + 1):
        at = ca.vertcat(*[x for c in curve for x in c[:j]])
        towards = ca.vertcat(*[(i + 1) * c[i + 1] for c in curve for i in range(j)])
        coefficients.append(ca.jtimes(coefficients[-1], at, towards) / j)
        sizes.append(float(ca.n_nodes(coefficients[-1])))
        # From order 3 on, the number of operations grows by a nearly constant factor.
        growth = sizes[-1] / sizes[-2] if j >= 3 and sizes[-2] else 1.0
        expected = math.log10(max(sizes[-1], 1.0)) + (order - j) * math.log10(max(growth, 1.0))
        if expected > math.log10(_MOST_OPERATIONS):
            raise PropagationError(
                f"Derivatives of order {order} need about 1e{expected:.0f} operations, but only "
                f"{_MOST_OPERATIONS:.0e} can be compiled within minutes. Use a lower order."
            )
    return coefficients


@lru_cache(maxsize=64)
def jet_function(f: ca.Function, terms: int) -> ca.Function:
    """The Function of `terms` Taylor coefficients of f, from as many coefficients of each input of f."""
    curves = [[ca.SX.sym(f"a{i}_{j}", f.numel_in(i)) for j in range(terms)] for i in range(f.n_in())]
    coefficients = jets(f(*[curve[0] for curve in curves]), curves)
    return common("jets", [a for curve in curves for a in curve], coefficients)
