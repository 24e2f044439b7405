"""Points of the unit box: quadrature rules, interpolation grids, samplers, and the fit of expansions.

Nodes and weights are those of the uniform density on [-1, 1]^d.
"""

from symmb.bound.nodes.fit import Fit
from symmb.bound.nodes.grid import Grid, Index, along_axes, below, line
from symmb.bound.nodes.quadrature import ChebyshevGauss, ClenshawCurtis, Gauss, Leja, Nodes, SparseGrid
from symmb.bound.nodes.regression import fitted
from symmb.bound.nodes.samplers import LatinHypercube, Random, Sampler, Sobol, corners, grid
from symmb.bound.nodes.sparse_regression import GROUPS, SparseFit, Terms
from symmb.bound.nodes.tensor_fit import group_squares
