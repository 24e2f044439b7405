"""Bounds of rounding errors of double precision numbers.

Error bounds are sums of products of nonnegative numbers. A factor covers the rounding of the bounds themselves.
"""

from typing import TypeVar

import numpy as np

T = TypeVar("T", float, np.ndarray)

U = 2.0**-53
"""Largest relative error of a sum, a product, a quotient or a square root."""
FUNCTION = 16 * U
"""Relative error of an elementary function: eight units in the last place, four times those of C libraries.
tests/bounds/test_interval.py"""
COMPLEX = 32 * U
"""Error of an operation on complex numbers, relative to the modulus of the result."""
_ROUNDING_OF_BOUNDS = 1.0 + 2.0**-30
"""Factor that covers the rounding of a bound: a sum of up to eight million nonnegative terms (Higham 2002, eq. 4.4)."""
_UNDERFLOW = 1e-290
"""Summand that covers underflow."""
LARGEST_ZERO = 1e-250
"""Bounds up to this size belong to an exact 0: they cover only underflow."""
OF_MODULI = 1e-9
"""Relative part of a sum of moduli that covers the rounding of the terms, the centres and the radii."""


def above(bound: T) -> T:
    """An upper bound of the exact value of a computed sum of nonnegative terms."""
    return bound * _ROUNDING_OF_BOUNDS + _UNDERFLOW


def of_sum(terms: int) -> float:
    """Error of a sum of products in any order, relative to the sum of the moduli of the products.

    Source: Higham (2002), Accuracy and Stability of Numerical Algorithms, eq. (3.5).
    """
    return above(terms * U / (1.0 - terms * U))


def grain_of(end: float) -> float:
    """The unit of the times of steps over a horizon [s], a power of 2. Sums of such times have no rounding errors."""
    return 2.0 ** float(np.ceil(np.log2(end or 1.0))) / _GRAINS_OF_STEPS


def fine_grain_of(end: float) -> float:
    """The unit of given times over a horizon [s]. Sums of such times are exact as well, with two bits to spare."""
    return grain_of(end) * _GRAINS_OF_STEPS / _GRAINS_OF_TIMES


_GRAINS_OF_STEPS, _GRAINS_OF_TIMES = 2.0**30, 2.0**50
"""Numbers of units in the smallest power of 2 that is at least the horizon: for steps, and for given times."""
