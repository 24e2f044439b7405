"""Exact ranges of many polynomials at once, by branch and bound in Chebyshev form."""

from dataclasses import dataclass

import numpy as np

from symmb._limits import windows
from symmb._options import require_between, require_whole
from symmb._types import Array
from symmb.bound.polynomials import ranges
from symmb.bound.polynomials.legendre import MultiIndices
from symmb.bound.polynomials.ranges.inclusion import Range
from symmb.run.codegen import with_compiler

RANGE_ERROR = 1e-5
"""Error of a range by branch and bound divided by the width of the range."""
RANGE_WORK = 200_000
"""Largest number of coefficients in all boxes of a search by branch and bound. With many parameters, ranges are not
proved. The result is then the best values of the search."""


@dataclass(frozen=True, eq=False)
class Extremes:
    """Bounds of m polynomials, and points that nearly attain them.

    Attributes
    ----------
    lower, upper : (m,) bounds, never narrower than the range except for rounding
    at_lower, at_upper : (m, d) points of [-1, 1]^d with values that differ from the bounds by at most tolerance and gap
    below, above : (m,) distance of lower and upper from the values at their points; 0 for distances up to the tolerance
    """

    lower: Array
    upper: Array
    at_lower: Array
    at_upper: Array
    below: Array
    above: Array

    @property
    def gap(self) -> Array:
        """The larger of below and above (m,)."""
        return np.maximum(self.below, self.above)


@dataclass(frozen=True)
class Exact:
    """The exact range of each polynomial, for any number of parameters and any order.

    Parameters
    ----------
    tolerance : largest distance of a bound from the true extreme, divided by the range of the polynomial. For a
        constant, the largest distance is 1e-13 of the coefficients. The bounds are never narrower than the range,
        except for rounding.
    budget : largest number of boxes for each extreme of a polynomial. If the budget is used up, the tolerance is
    increased as needed

    Raises
    ------
    DeclarationError
        If the tolerance is below 1e-12 or at least 1, or the budget is not a positive whole number.

    Notes
    -----
    Two parameters take about ten boxes, six parameters some hundred boxes. Ten or more parameters may use up the
    budget. Errors decrease with the cube of the box size. A tolerance of 1e-8 thus takes less than twice as long as
    1e-3. Without a C compiler, Bernstein or ChebyshevInclusion give wider bounds. The points then come from a search
    along one parameter after the other.

    Examples
    --------
    The cubic of eq. (13), expanded in eq. (25), has the range [0, 4/27], with the maximum at x = 1/3, xi = -1/3:

    >>> import numpy as np, symmb as mb
    >>> coefficients = np.array([[1 / 12], [-1 / 20], [-1 / 12], [1 / 20]])
    >>> found = mb.Exact(tolerance=1e-12).search(np.arange(4)[:, None], coefficients)
    >>> bool(abs(found.lower[0]) < 1e-12), bool(abs(found.upper[0] - 4 / 27) < 1e-12)
    (True, True)
    >>> found.at_upper.round(3)
    array([[-0.333]])

    References
    ----------
    Ratschek and Rokne, New Computer Methods for Global Optimization (1988): branch and bound, monotonicity test.
    """

    tolerance: float = 1e-8
    budget: int = 3000

    def __post_init__(self) -> None:
        require_between(self, "tolerance", "[)", 1e-12, 1.0)
        require_whole(self, "budget", 1)

    def bounds(self, alpha: MultiIndices, coefficients: Array) -> tuple[Array, Array]:
        """Lower and upper bounds, each (m,), of polynomials with Legendre coefficients (n_b, m)."""
        extremes = self.search(alpha, coefficients)
        return extremes.lower, extremes.upper

    def search(self, alpha: MultiIndices, coefficients: Array) -> Extremes:
        """Bounds of polynomials with Legendre coefficients (n_b, m), and points that nearly attain them."""
        return with_compiler(lambda: self._searched(alpha, coefficients, True), lambda: _enclosed(alpha, coefficients))

    def attained(self, alpha: MultiIndices, coefficients: Array) -> Extremes:
        """Values at the best points found. The search ends without a proof when the budget is used up."""

        def compiled() -> tuple[Array, Array, Array, Array]:
            found = self._searched(alpha, coefficients, False)
            return found.lower + found.below, found.upper - found.above, found.at_lower, found.at_upper

        lower, upper, at_lower, at_upper = with_compiler(
            compiled, lambda: ranges.searched_extremes(alpha, coefficients)
        )
        return Extremes(lower, upper, at_lower, at_upper, np.zeros_like(lower), np.zeros_like(upper))

    def _searched(self, alpha: MultiIndices, coefficients: Array, proves: bool) -> Extremes:
        found = [
            ranges.compiled_ranges(alpha, coefficients[:, window], self.tolerance, self.budget, proves)
            for window in windows(max(coefficients.shape[1], 1), len(alpha))
        ]
        return Extremes(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _enclosed(alpha: MultiIndices, coefficients: Array) -> Extremes:
    """Bounds without a C compiler, by other methods, and points found by a search along the parameters."""
    least, most, at_lower, at_upper = ranges.searched_extremes(alpha, coefficients)
    size = float(np.prod(alpha.max(axis=0, initial=0) + 1.0))
    # All boxes have at most 2^14 Bernstein coefficients, because NumPy computes all of them for each polynomial.
    fitting = [boxes for boxes in (2, 1) if size * boxes ** alpha.shape[1] <= 2**14]
    method: Range = ranges.Bernstein(fitting[0]) if fitting else ranges.ChebyshevInclusion()
    lower, upper = method.bounds(alpha, coefficients)
    lower, upper = np.minimum(lower, least), np.maximum(upper, most)
    return Extremes(lower, upper, at_lower, at_upper, least - lower, upper - most)
