"""The orders of polynomials of many parameters: lower ones for parameters whose effect is nearly linear."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from symmb._magnitudes import ROUNDING
from symmb._types import Array, Indices
from symmb.prove import chebyshev as ch
from symmb.prove.basis import terms_of
from symmb.prove.errors import ProofError
from symmb.prove.flow import motion
from symmb.prove.problem import Problem
from symmb.prove.start import nominal_front

MOST_TERMS = 1001
"""Largest number of terms of a polynomial of more than two parameters, as for order 10 of four parameters. A step then
takes seconds."""
_MISSING = 3e-4
"""Size of the first missing terms of polynomials of many parameters, relative to the effect of all parameters."""
_STEPS, _TIME_TERMS, _SHORTEST = 400, 12, 1e-4
"""Largest number of steps, terms in time, and shortest step over the horizon, of the motions that are compared."""


def with_orders(problem: Problem, order: int) -> tuple[Problem, int]:
    """The problem with weights of its parameters, and the highest weighted degree, which is at most `order`.

    If all polynomials up to the degree `order` have too many terms, the second-order terms of computed motions are
    compared. Terms of the order k of a parameter j decrease about as r_j^k, so that the weights are the logarithms of
    r_j. The degree is then only as high as needed to make the first missing terms small.
    """
    if problem.d <= ch.TENSOR_PARAMETERS:
        return problem, order
    problem = replace(problem, weights=(1,) * problem.d)
    if terms_of(problem.weights, order) <= MOST_TERMS:
        return problem, order
    sizes = 0.5 * np.log(np.clip(_second_orders(problem), 1e-16, 0.9))
    order = min(order, max(2, int(np.ceil(np.log(_MISSING) / sizes.max())) - 1))
    weights = np.clip(np.round(sizes / sizes.max()), 1, order).astype(int)
    while order > 1 and terms_of(tuple(weights.tolist()), order) > MOST_TERMS:
        order -= 1
    # a linear term has at most the highest degree
    return replace(problem, weights=tuple(np.minimum(weights, order).tolist())), order


def _second_orders(problem: Problem) -> Array:
    """Largest second-order terms (d,) of each parameter, relative to the effect of all parameters."""
    found, exponents = np.full(problem.d, 1e-16), problem.basis(problem.lengths(2)[0]).exponents
    for _, x in computed_motion(problem):
        found = np.maximum(found, _relative(x, exponents))
    return found


def computed_motion(problem: Problem) -> Iterator[tuple[float, Array]]:
    """Times and states (n, T) of motions of degree 2 in many parameters, without a proof.

    They end at the first change of the equations, at the last time, or where steps become very short.
    """
    t, end = 0.0, float(problem.times[-1])
    try:
        x = nominal_front(problem, 2)
        h = end / 50.0
        for _ in range(_STEPS):
            yield t, x
            if not h > _SHORTEST * end or t >= end:
                break
            c = motion(problem, x, t, h, _TIME_TERMS).c
            tail = float(
                (np.abs(c[:, -2:]).sum(axis=(1, 2)) / np.maximum(problem.scales, np.abs(c).sum(axis=(1, 2)))).max()
            )
            if tail <= np.sqrt(ROUNDING):
                x, t = c.sum(axis=1), t + h
            h *= float(np.clip((ROUNDING / max(tail, 1e-30)) ** (1.0 / _TIME_TERMS), 0.3, 1.5))
    except ProofError:
        pass


def _relative(x: Array, exponents: Indices) -> Array:
    """Second-order terms (d,) of states (n, T), relative to all terms of a state."""
    moved = np.abs(x[:, 1:]).sum(axis=1)
    # rounding errors of states without an effect are no second-order terms
    moved = np.maximum(moved, max(1e-6 * moved.max(initial=0.0), 1e-9 * np.abs(x).max(initial=1e-300)))
    share = (np.abs(x) / moved[:, None]).max(axis=0)
    is_second = exponents.sum(axis=1) == 2
    # half of a product belongs to each factor
    return (share[is_second, None] * exponents[is_second]).sum(axis=0) / 2.0
