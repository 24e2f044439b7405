"""Bounds of rounding errors of double precision numbers.

Error bounds are sums of products of numbers that are not negative. Their own rounding is covered by a factor.
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
"""The same of an operation on complex numbers, over its modulus."""
_ROUNDING_OF_BOUNDS = 1.0 + 2.0**-30
"""Covers the rounding of a bound, a sum of up to eight million terms that are not negative (Higham 2002, eq. 4.4)."""
_UNDERFLOW = 1e-290
"""Covers underflow."""
LARGEST_ZERO = 1e-250
"""Bounds up to it are those of 0: they cover underflow only."""
OF_MODULI = 1e-9
"""Share of a sum of moduli that covers the rounding of its terms, of centres and of radii."""


def above(bound: T) -> T:
    """A number that is not below the exact value of a computed sum of terms that are not negative."""
    return bound * _ROUNDING_OF_BOUNDS + _UNDERFLOW


def of_sum(terms: int) -> float:
    """Relative error of a sum of products, over the sum of the products' moduli, in whatever order it is computed.

    Source: Higham (2002), Accuracy and Stability of Numerical Algorithms, eq. (3.5).
    """
    return above(terms * U / (1.0 - terms * U))


def grain_of(end: float) -> float:
    """The unit of times of steps over a horizon [s], a power of 2: times of steps are then sums without rounding."""
    return 2.0 ** float(np.ceil(np.log2(end or 1.0))) / _GRAINS_OF_STEPS


def fine_grain_of(end: float) -> float:
    """The unit of times that are given: sums of so many are exact as well, with two bits to spare."""
    return grain_of(end) * _GRAINS_OF_STEPS / _GRAINS_OF_TIMES


_GRAINS_OF_STEPS, _GRAINS_OF_TIMES = 2.0**30, 2.0**50
"""Units of both kinds in the least power of 2 that is not below a horizon."""
