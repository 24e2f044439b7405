"""The first switch that a step passes: the search of c/switches.h on NumPy arrays."""

from collections.abc import Callable

import numpy as np

from symmb._types import Array, Indices
from symmb.schemes.roots import roots

PARTS = 6
"""Equal parts of a step, in each of which a switch and its rate may change sign once."""


def first_pass(
    values: Callable[[Array, Indices], tuple[Array, Array]], u: Array, rates: Array
) -> tuple[Array, Indices]:
    """The first switch that falls below 0 in each of L lanes: share of the step (L,), inf without one, and number.

    Parameters
    ----------
    values : shares (k,), lanes (k,) -> switches (m, k) on their sides, and their rates (m, k)
    u, rates : (m, L) at the begin of the step
    """
    L = u.shape[1]
    when, which, every = np.full(L, np.inf), np.zeros(L, dtype=np.intp), np.arange(L)
    for part in range(PARTS):
        low, high = part / PARTS, (part + 1) / PARTS
        end, end_rates = values(np.full(L, high), every)
        open_ = np.isinf(when)
        falls = open_ & (end < 0)
        turns = open_ & (end >= 0) & (rates < 0) & (end_rates > 0)
        number, lane = np.nonzero(falls | turns)
        if number.size:
            behind, there = np.full(len(lane), high), end[number, lane]
            turned = turns[number, lane]
            if turned.any():  # it may be passed twice: its least value decides
                some = number[turned], lane[turned]
                behind[turned] = _sign_change(values, 1, *some, low, behind[turned], rates[some], end_rates[some])
                there[turned] = values(behind[turned], lane[turned])[0][some[0], np.arange(turned.sum())]
            passed = there < 0
            number, lane, behind, there = number[passed], lane[passed], behind[passed], there[passed]
            theta = _sign_change(values, 0, number, lane, low, behind, np.maximum(u[number, lane], 0.0), there)
            for k in np.argsort(-theta, kind="stable"):  # the earliest comes last
                when[lane[k]], which[lane[k]] = theta[k], number[k]
        u, rates = end, end_rates
    return when, which


def _sign_change(
    values: Callable[[Array, Indices], tuple[Array, Array]],
    kind: int,
    number: Indices,
    lane: Indices,
    low: float,
    high: Array,
    at_low: Array,
    at_high: Array,
) -> Array:
    """Where switches, or with kind 1 their rates, change sign between shares low and high (k,)."""
    every = np.arange(len(lane))

    def value(theta: Array) -> Array:
        return values(theta, lane)[kind][number, every]

    if not len(lane):
        return np.empty(0)
    return roots(value, np.full(len(lane), low), high, at_low, at_high)
