"""Enclosures of ranges without a search: intervals of Legendre or Chebyshev polynomials, Bernstein coefficients."""

import itertools
import math
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np

from symmb._errors import DeclarationError
from symmb._options import require_whole
from symmb._types import Array
from symmb.bound.polynomials.chebyshev import LowerSet
from symmb.bound.polynomials.legendre import MultiIndices, basis_ranges

MOST_NUMBERS = 2**24
"""Largest number of coefficients of a polynomial. They take 128 MB."""


class Range(Protocol):
    """A method to bound many polynomials over the unit box."""

    def bounds(self, alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array]:
        """Lower and upper bounds, each (m,), of the m polynomials with Legendre coefficients (n_b, m)."""
        ...


@dataclass(frozen=True)
class LegendreInclusion:
    """Natural interval arithmetic a_0 + sum a_i [min phi_i, max phi_i], eqs. (23)-(24), for any order.

    The interval encloses the range of the expansion. With more terms, the interval becomes wider than the range.

    Examples
    --------
    The cubic of eq. (13), expanded in eq. (25), gives eq. (27), [-1/10, 9/40]:

    >>> import numpy as np, symmb as mb
    >>> coefficients = np.array([[1 / 12], [-1 / 20], [-1 / 12], [1 / 20]])
    >>> low, high = mb.LegendreInclusion().bounds(np.arange(4)[:, None], coefficients)
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

    The interval encloses the range of the expansion. The interval is equal to the range if there is a single term.

    Examples
    --------
    The cubic of eq. (13) gives [-1/16, 3/16]:

    >>> import numpy as np, symmb as mb
    >>> coefficients = np.array([[1 / 12], [-1 / 20], [-1 / 12], [1 / 20]])
    >>> low, high = mb.ChebyshevInclusion().bounds(np.arange(4)[:, None], coefficients)
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


@dataclass(frozen=True)
class Bernstein:
    """The smallest and the largest Bernstein coefficient, for a few parameters.

    Bernstein coefficients enclose the range of the expansion. The error decreases with the square of the number of
    boxes.

    Parameters
    ----------
    boxes : number of equal parts of the range of each parameter

    Raises
    ------
    DeclarationError
        If boxes is not a positive whole number. Also raised by ``bounds`` for too many parameters, boxes or orders.

    Notes
    -----
    The time grows as (boxes (order + 1))^d. The change from Legendre polynomials loses about 0.3 order d digits.

    Examples
    --------
    The cubic of eq. (13), whose range is [0, 4/27], gives [0, 1/3], and [0, 1/6] over two halves:

    >>> import numpy as np, symmb as mb
    >>> coefficients = np.array([[1 / 12], [-1 / 20], [-1 / 12], [1 / 20]])
    >>> for boxes in (1, 2):
    ...     low, high = mb.Bernstein(boxes).bounds(np.arange(4)[:, None], coefficients)
    ...     print(low.round(12) + 0.0, high.round(12))
    [0.] [0.33333333]
    [0.] [0.16666667]

    References
    ----------
    Garloff, J. Comput. Appl. Math. 1985; Farouki, Comput. Aided Geom. Design 29 (2012), sections 5-7.
    """

    boxes: int = 1

    def __post_init__(self) -> None:
        require_whole(self, "boxes", 1)

    def bounds(self, alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array]:
        """Lower and upper bounds, each (m,), of polynomials with Legendre coefficients (n_b, m)."""
        shape = tuple(alpha.max(axis=0) + 1)
        size = math.prod(self.boxes * int(n) for n in shape)
        if size > MOST_NUMBERS:
            raise DeclarationError(
                f"{self!r}: {len(shape)} parameters of orders up to {max(shape) - 1} have {size:.1e} Bernstein "
                f"coefficients, more than {MOST_NUMBERS:.1e}. Use Exact() or ChebyshevInclusion()."
            )
        changes = [_on_boxes(n - 1, self.boxes) for n in shape]
        m, step = coefficients.shape[1], max(1, 2**18 // size)  # 2^18 numbers take 2 MB, as the cache of a core
        lower, upper = np.empty(m), np.empty(m)
        for start in range(0, m, step):
            part = slice(start, start + step)
            tensor = np.zeros((coefficients[:, part].shape[1], *shape))
            tensor[:, *alpha.T] = coefficients[:, part].T
            for k, change in enumerate(changes):
                tensor = np.moveaxis(np.moveaxis(tensor, k + 1, -1) @ change.T, -1, k + 1)
            values = tensor.reshape(len(tensor), -1)
            lower[part], upper[part] = values.min(axis=1), values.max(axis=1)
        return lower, upper


@cache
def _on_boxes(n: int, boxes: int) -> Array:
    """(boxes (n + 1), n + 1) matrix from Legendre coefficients to Bernstein coefficients on parts of [-1, 1]."""
    # Coefficient j on the part from u to v of [0, 1] is the polar form of n - j arguments u and j arguments v.
    ends = [i / boxes for i in range(boxes + 1)]
    rows = [np.convolve(_power(u, n - j), _power(v, j)) for u, v in itertools.pairwise(ends) for j in range(n + 1)]
    return np.array(rows) @ _from_legendre(n)


def _power(t: float, n: int) -> Array:
    """Coefficients (n + 1,) of (1 - t + t s)^n."""
    return np.array([math.comb(n, i) * (1 - t) ** (n - i) * t**i for i in range(n + 1)])


def _from_legendre(n: int) -> Array:
    """(n + 1, n + 1) matrix from Legendre to Bernstein coefficients (Farouki 2012)."""
    # Terms with alternating signs cancel. They are summed as integers, without rounding.
    comb = math.comb

    def entry(j: int, k: int) -> float:
        some = range(max(0, j + k - n), min(j, k) + 1)
        return sum((-1) ** (k + i) * comb(k, i) ** 2 * comb(n - k, j - i) for i in some) / comb(n, j)

    return np.array([[entry(j, k) for k in range(n + 1)] for j in range(n + 1)])
