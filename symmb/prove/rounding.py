"""Bounds of rounding errors of double precision numbers.

Error bounds are sums of products of nonnegative numbers. A factor covers the rounding of the bounds themselves.
"""

from typing import TypeVar

import numpy as np

from symmb._errors import PropagationError

T = TypeVar("T", float, np.ndarray)

U = 2.0**-53
"""Largest relative error of a sum, a product, a quotient or a square root."""
FUNCTION_ERROR = 16 * U
"""Relative error of an elementary function: eight units in the last place, four times the errors of C
libraries. This is checked in tests/methods/test_interval.py."""
COMPLEX_ERROR = 32 * U
"""Error of an operation on complex numbers, relative to the modulus of the result."""
LARGEST_ZERO = 1e-250
"""Bounds up to this size belong to an exact 0. They only cover underflow."""
ERROR_OF_MODULI = 1e-9
"""Relative part of a sum of moduli that covers the rounding of the terms, the centres and the radii."""


def require_rounding_to_nearest() -> None:
    """Raise PropagationError if the arithmetic of this thread does not round to nearest, or loses small numbers.

    Libraries of interval arithmetic, among others, change the rounding mode of the thread that imports them.
    """
    one, little, least = np.array([1.0, 2.0**-54, 2.0**-1022])
    if not (one + little == one == one - little and least / 2 > 0):
        raise PropagationError(
            "Proofs need arithmetic that rounds to nearest, but another library has changed the rounding mode of this "
            "process. Run the proof in a process of its own, or load that library after it."
        )


def above(bound: T) -> T:
    """An upper bound of the exact value of a computed sum of nonnegative terms."""
    # the factor covers rounding of up to eight million terms (Higham 2002, eq. 4.4); the summand covers underflow
    return bound * (1.0 + 2.0**-30) + 1e-290


def of_sum(terms: int) -> float:
    """Error of a sum of products in any order, relative to the sum of the moduli of the products.

    Source: Higham (2002), Accuracy and Stability of Numerical Algorithms, eq. (3.5).
    """
    return above(terms * U / (1.0 - terms * U))


def grain_of(end: float, bits: int = 30) -> float:
    """The unit of times over a horizon [s], a power of 2. The horizon has at most 2^bits units.

    Times of steps have 30 bits, and given times have 50. Sums of such times are exact, because a double has 53 bits.
    """
    return 2.0 ** (float(np.ceil(np.log2(end or 1.0))) - bits)
