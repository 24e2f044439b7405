"""Inclusion functions: interval arithmetic with the Legendre basis, eq. (23), or with Chebyshev polynomials."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from symmb._types import Array
from symmb.bound.polynomials.chebyshev import LowerSet
from symmb.bound.polynomials.legendre import MultiIndices, basis_ranges


class Range(Protocol):
    """A method to bound many polynomials over the unit box."""

    def bounds(self, alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array]:
        """Lower and upper bounds, each (m,), of the m polynomials with Legendre coefficients (n_b, m)."""
        ...


@dataclass(frozen=True)
class LegendreInclusion:
    """Natural interval arithmetic a_0 + sum a_i [min phi_i, max phi_i], eqs. (23)-(24), for any order.

    The interval encloses the range of the expansion. The excess grows with the number of terms.

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


@dataclass(frozen=True)
class ChebyshevInclusion:
    """Interval arithmetic c_0 +- sum |c_i| with Chebyshev polynomials, because |T_i| <= 1, for any order.

    The interval encloses the range of the expansion, and is the range if there is a single term.

    Examples
    --------
    The cubic of eq. (13) gives [-1/16, 3/16]:

    >>> coefficients = np.array([[1 / 12], [-1 / 20], [-1 / 12], [1 / 20]])
    >>> low, high = ChebyshevInclusion().bounds(np.arange(4)[:, None], coefficients)
    >>> low.round(12), high.round(12)
    (array([-0.0625]), array([0.1875]))

    References
    ----------
    Wu, Zhang, Chen and Luo, Appl. Math. Modelling 37 (2013) 4578: the Chebyshev interval method.
    """

    def bounds(self, alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array]:
        """Lower and upper bounds, each (m,)."""
        C = LowerSet.of(alpha).from_legendre(coefficients)
        width = np.abs(C[1:]).sum(axis=0)
        return C[0] - width, C[0] + width
