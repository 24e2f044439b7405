"""Legendre inclusion function: interval arithmetic over the basis, eq. (23)."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from symmb._types import Array
from symmb.bounds._legendre import MultiIndices, basis_ranges


class Range(Protocol):
    """A way to bound many polynomials over the unit box."""

    def bounds(self, alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array]:
        """Lower and upper bounds, each (m,), of the m polynomials with Legendre coefficients (n_b, m)."""
        ...


@dataclass(frozen=True)
class LegendreInclusion:
    """Natural interval arithmetic a_0 + sum a_i [min phi_i, max phi_i], eqs. (23)-(24), for any order.

    It contains the range of the expansion, and ever more widely the more terms there are.

    Examples
    --------
    The cubic of eq. (13), expanded in eq. (25), gives eq. (27), [-1/10, 9/40]:

    >>> coefficients = np.array([[1 / 12], [-1 / 20], [-1 / 12], [1 / 20]])
    >>> low, high = LegendreInclusion().bounds(np.arange(4)[:, None], coefficients)
    >>> low.round(12), high.round(12)
    (array([-0.1]), array([0.225]))
    """

    def bounds(self, alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array]:
        """Lower and upper bounds, each (m,)."""
        low, high = basis_ranges(alpha)
        positive, negative = np.maximum(coefficients, 0.0), np.minimum(coefficients, 0.0)
        return low @ positive + high @ negative, high @ positive + low @ negative
