"""Univariate Taylor coefficients of SX expressions along a curve."""

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca


def jets(expression: ca.SX, curve: Sequence[Sequence[ca.SX]]) -> list[ca.SX]:
    """Taylor coefficients in eps of f(x(eps)) from those of its arguments.

    With x(eps) = x_0 + x_1 eps + x_2 eps^2 + ... the coefficients obey j f_j = D f_{j-1}, where D is the derivative in
    the direction in which every x_i moves by (i + 1) x_{i+1}.

    Parameters
    ----------
    expression : SX f, written in the symbols x_0
    curve : for each argument its coefficients x_0, ..., x_k, all SX symbols of one shape

    Returns
    -------
    list of k + 1 SX of the shape of f
    """
    order = len(curve[0]) - 1
    coefficients = [expression]
    for j in range(1, order + 1):
        at = ca.vertcat(*[x for c in curve for x in c[:j]])
        towards = ca.vertcat(*[(i + 1) * c[i + 1] for c in curve for i in range(j)])
        coefficients.append(ca.jtimes(coefficients[-1], at, towards) / j)
    return coefficients


@lru_cache(maxsize=64)
def jet_function(f: ca.Function, terms: int) -> ca.Function:
    """The Taylor coefficients of f, one output each, from so many coefficients of each of its inputs in turn."""
    curves = [[ca.SX.sym(f"a{i}_{j}", f.numel_in(i)) for j in range(terms)] for i in range(f.n_in())]
    coefficients = jets(f(*[curve[0] for curve in curves]), curves)
    return ca.Function("jets", [a for curve in curves for a in curve], coefficients, {"cse": True})
