"""Legendre and Chebyshev polynomials of several variables, and expansions in them.

The ranges of expansions over the box are in `polynomials.ranges`.
"""

from symmb.bound.polynomials.basis import Basis, HyperbolicCross, TensorDegree, TotalDegree
from symmb.bound.polynomials.chebyshev import legendre_to_chebyshev
from symmb.bound.polynomials.expansion import Expansion, Moments, moments
from symmb.bound.polynomials.legendre import (
    Index,
    MultiIndices,
    basis_values,
    below,
    homogeneous,
    in_other_coordinates,
    mean_squares,
    with_lower,
)
