"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .fit import Fit as Fit
from .grid import Grid as Grid, Index as Index, along_axes as along_axes, below as below, line as line
from .quadrature import (
    ChebyshevGauss as ChebyshevGauss,
    ClenshawCurtis as ClenshawCurtis,
    Gauss as Gauss,
    Leja as Leja,
    Nodes as Nodes,
    SparseGrid as SparseGrid,
)
from .regression import fitted as fitted
from .samplers import (
    LatinHypercube as LatinHypercube,
    Random as Random,
    Sampler as Sampler,
    Sobol as Sobol,
    corners as corners,
    grid as grid,
)
from .sparse_regression import GROUPS as GROUPS, SparseFit as SparseFit, Terms as Terms
from .tensor_fit import group_squares as group_squares
