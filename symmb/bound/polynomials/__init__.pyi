"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .basis import (
    Basis as Basis,
    HyperbolicCross as HyperbolicCross,
    TensorDegree as TensorDegree,
    TotalDegree as TotalDegree,
)
from .chebyshev import legendre_to_chebyshev as legendre_to_chebyshev
from .expansion import Expansion as Expansion, Moments as Moments, moments as moments
from .legendre import (
    Index as Index,
    MultiIndices as MultiIndices,
    basis_values as basis_values,
    below as below,
    homogeneous as homogeneous,
    in_other_coordinates as in_other_coordinates,
    mean_squares as mean_squares,
    with_fixed as with_fixed,
    with_lower as with_lower,
)
